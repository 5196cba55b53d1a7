"""What `--from` tells a controller: a diagnosis in its folder, or a record that is diagnosed first."""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from json import loads as parse_json
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, ValidationError

from msl_fem.actuator import Actuator
from msl_fem.cli.currents_commanded import currents_commanded
from msl_fem.cli.output import say
from msl_fem.cli.sweeping import table_for
from msl_fem.control.posterior_plants import Posterior, posterior_of
from msl_fem.control.stated_posterior import Number
from msl_fem.errors import InputError
from msl_fem.files.schema import first_complaint, small_text
from msl_fem.files.sole_run import sole_run
from msl_fem.files.whole_file import whole_file
from msl_fem.plant.effects import EffectValues
from msl_fem.plant.extended_model import ExtendedModel, load_extended_model
from msl_fem.record import load_record
from msl_fem.record.rig_file import RIG_FILE

DIAGNOSIS, MODEL = "diagnosis.json", "extended_model.toml"
MARK = "diagnosed_record.txt"
"""In the folder of a diagnosis that `--from RECORD` made: which record and table it is of."""
_OF_MOTION = ("moving_mass", "stiffness", "damping", "nominal_gap")


class _Stated(BaseModel):
    model_config = ConfigDict(strict=True)  # a text is no number


class _Parameter(_Stated):
    believed: Number
    fitted: Number = 0.0


class _BelievedValue(_Stated):
    effect: str
    parameter: str
    value: Number


class _Believed(_Stated):
    values: list[_BelievedValue] = []


class _StatedBelief(_Stated):
    """The entries of diagnosis.json that say what was believed."""

    parameters: dict[str, _Parameter]
    belief: _Believed = _Believed()


@dataclass(frozen=True)
class Told:
    """What a diagnosis tells a controller.

    Attributes
    ----------
    model : the extended model
    posterior : what is left unsure of it
    believed : the plant as it was believed before the record
    """

    model: ExtendedModel
    posterior: Posterior
    believed: ExtendedModel

    def commanding_currents(self, bandwidth: str | None) -> "Told":
        """The same with a current loop about the amplifier of a voltage drive, see `currents_commanded`."""
        model, believed = (currents_commanded(it, bandwidth) for it in (self.model, self.believed))
        return Told(model, self.posterior, believed)


def told_from(folder: Path, table: Path | None) -> Told:
    """What a folder tells; a record is diagnosed into `RECORD.diagnosis` beside it, unless that has been done.

    Raises
    ------
    InputError : as `told_by`; a record that cannot be diagnosed
    """
    return told_by(_diagnosed(folder, table) if (folder / RIG_FILE).is_file() else folder)


def told_by(folder: Path) -> Told:
    """The extended model and the posterior in a folder of `diagnose -o`.

    Raises
    ------
    InputError : the folder has no diagnosis, or one in which nothing was fitted
    """
    folder = folder.parent if folder.name == DIAGNOSIS else folder
    file, model = folder / DIAGNOSIS, folder / MODEL
    if not file.is_file():
        raise InputError(
            f"--from {folder}: has no {DIAGNOSIS} and is no record; run 'msl-fem diagnose RECORD -o {folder}' first, "
            "or give the record itself"
        )
    if not model.is_file():
        raise InputError(f"--from {folder}: has no {MODEL}: nothing was fitted; see its {DIAGNOSIS} for the reason")
    try:
        content = parse_json(small_text(file))
    except (OSError, ValueError, RecursionError) as err:
        raise InputError(f"--from {file}: cannot be read ({err}); diagnose the record again") from err
    extended = load_extended_model(model)
    try:
        posterior = posterior_of(content)
    except InputError as err:
        raise InputError(f"--from {file}: {err}") from err
    try:
        believed = believed_before(extended.actuator, content)
    except ValidationError as err:
        raise _not_believed(file, first_complaint(err)) from err
    except ValueError as err:
        raise _not_believed(file, str(err)) from err
    return Told(extended, posterior, believed)


def _not_believed(file: Path, why: str) -> InputError:
    return InputError(f"--from {file}: its parameters say no believed values ({why}); diagnose it again")


def believed_before(fitted: Actuator, diagnosis: Mapping[str, Any]) -> ExtendedModel:
    """The plant as it was believed before a diagnosis, from its content and the actuator with what was fitted.

    Raises
    ------
    ValueError : it says no believed values, or some that no plant has
    """
    stated = _StatedBelief.model_validate(diagnosis)
    told = stated.parameters
    changed: dict[str, Any] = {}
    if fitted.motion is not None:
        of_motion = {name: told[name].believed for name in _OF_MOTION if name in told}
        changed["motion"] = type(fitted.motion).model_validate(_content_of(fitted.motion) | of_motion)
    if fitted.drive is not None and "coil_resistance" in told:
        resistance = told["coil_resistance"]
        if not resistance.fitted > 0:
            raise ValueError(f"parameters.coil_resistance.fitted: {resistance.fitted:g} is not above 0")
        believed = fitted.coil_resistance() * (resistance.believed / resistance.fitted)
        changed["drive"] = type(fitted.drive).model_validate(_content_of(fitted.drive) | {"coil_resistance": believed})
    effects: dict[str, dict[str, float]] = {}
    for one in stated.belief.values:
        effects.setdefault(one.effect, {})[one.parameter] = one.value
    return ExtendedModel(fitted.model_copy(update=changed), EffectValues(effects))


def _content_of(section: BaseModel) -> dict[str, Any]:
    return section.model_dump(by_alias=True, exclude_none=True)


def _diagnosed(record_folder: Path, table: Path | None) -> Path:
    """The folder of the record's diagnosis; one that was interrupted goes on."""
    # here, for the import takes longer than a small command
    from msl_fem.cli.believed import belief_about
    from msl_fem.cli.diagnose import diagnosis_into, fingerprint

    folder = record_folder.absolute().with_name(f"{record_folder.absolute().name}.diagnosis")
    record = load_record(record_folder)
    magnet_table = table_for(record.actuator, table)
    mark = fingerprint(record, magnet_table)
    with sole_run(folder):
        if mark_of(folder) == mark and (folder / DIAGNOSIS).is_file():
            say(f"{record_folder} has been diagnosed: {folder}")
            return folder
        belief = belief_about(record, magnet_table)
        diagnosis_into(folder, record, magnet_table, belief, resume=True)
        with whole_file(folder / MARK) as part:
            part.write_text(f"{mark}\n", encoding="utf-8")
    say(f"diagnosed: {folder}")
    return folder


def mark_of(folder: Path) -> str:
    """The mark in a folder; "", which is that of no record, where none can be read."""
    with suppress(OSError, ValueError):
        return small_text(folder / MARK).strip()
    return ""
