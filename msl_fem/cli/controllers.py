"""The design that the options of `control` and `export` ask for."""

from dataclasses import dataclass, replace
from json import loads as parse_json
from pathlib import Path

import numpy as np

from msl_fem.actuator import Actuator
from msl_fem.cli.controller_maps import Maps
from msl_fem.cli.currents_commanded import currents_commanded
from msl_fem.cli.losses import ThermalTexts, thermal_limit
from msl_fem.cli.options import AUTO, read_option
from msl_fem.cli.told import Told, told_from
from msl_fem.control import (
    DESIGNS,
    ControllerChoice,
    ControllerDesign,
    DesignModel,
    ForceTerm,
    IdentifiedPlant,
    design_model_as_believed,
    design_model_of_terms,
    design_model_with_effects,
    designed,
)
from msl_fem.control.asked_voltage import AskedVoltage, asked_voltage
from msl_fem.control.closed_loop import ReferenceArrays
from msl_fem.control.design import with_thermal_limit
from msl_fem.errors import InputError
from msl_fem.files.schema import reason, small_text
from msl_fem.identification import ArmaxModel, KnownMass, model_from_json, physical_parameters
from msl_fem.identification.data import rational_term
from msl_fem.losses.thermal_limit import ThermalLimit
from msl_fem.plant.believed import PLAIN_BELIEF, Belief
from msl_fem.plant.extended_model import ExtendedModel, load_extended_model
from msl_fem.table.magnetic_table import MagneticTable


@dataclass(frozen=True)
class DesignOptions:
    """What the command line asks of a design, as it was written."""

    model: str = "table"
    design: str = "lqr"
    bandwidth: str | None = None
    peak_sensitivity: float | None = None
    feedforward: bool = True
    preview: bool = True
    bias: str | None = None
    overlap: str = "0 N"
    current_loop: str | None = None
    temperature_rise: str | None = None
    ambient: str | None = None
    thermal_resistance: str | None = None

    @property
    def stated(self) -> list[str]:
        """The options that differ from their defaults, as they are written."""
        usual = DesignOptions()
        names = [name for name in self.__dataclass_fields__ if getattr(self, name) != getattr(usual, name)]
        return [f"--{'no-' if getattr(self, name) is False else ''}{name.replace('_', '-')}" for name in names]

    def choice(self) -> ControllerChoice:
        """The choice in SI units; InputError for a wrong unit, with the option's name."""
        return ControllerChoice(
            kind=self.design,
            bandwidth=None if self.bandwidth is None else read_option("--bandwidth", self.bandwidth, "Hz"),
            peak_sensitivity=self.peak_sensitivity,
            feedforward=self.feedforward,
            overlap=0.0 if self.overlap == AUTO else read_option("--overlap", self.overlap, "N"),
            bias=None if self.bias is None else read_option("--bias", self.bias, "A"),
            preview=self.preview,
        )

    def thermal_limit(self) -> ThermalLimit | None:
        """What the windings are allowed; None where nothing is stated. InputError for a wrong unit."""
        texts = ThermalTexts()
        texts = ThermalTexts(
            rise=self.temperature_rise or texts.rise,
            ambient=self.ambient or texts.ambient,
            resistance=self.thermal_resistance,
        )
        return None if texts == ThermalTexts() else thermal_limit(texts)

    def told(self, folder: Path | None, table: Path | None) -> Told | None:
        """What `--from` tells, a record by its diagnosis with the table given; InputError beside `--model`."""
        if folder is None:
            return None
        if self.model != "table":
            raise InputError(f"--from {folder} and --model {self.model} both tell the controller; give one of them")
        return told_from(folder, table).commanding_currents(self.current_loop)

    def known(self) -> ExtendedModel | ArmaxModel | None:
        """What `--model` tells the controller; None: table and actuator file."""
        if self.model == "table":
            return None
        found = known_model(Path(self.model))
        return currents_commanded(found, self.current_loop) if isinstance(found, ExtendedModel) else found


def design_of(
    options: DesignOptions, known: ExtendedModel | ArmaxModel | None, actuator: Actuator, table: MagneticTable,
    maps: Maps, *, belief: Belief = PLAIN_BELIEF,
) -> ControllerDesign:  # fmt: skip
    """The design that options ask for, of what is known (None: the actuator's file, the table and the belief)."""
    return design_of_model(options, model_of(known, actuator, table, maps, belief=belief))


def design_of_model(options: DesignOptions, model: DesignModel) -> ControllerDesign:
    """The design that options ask for, of a design model."""
    made, limit = designed(model, options.choice()), options.thermal_limit()
    return made if limit is None else with_thermal_limit(made, limit)


def model_of(
    known: ExtendedModel | ArmaxModel | None, actuator: Actuator, table: MagneticTable, maps: Maps,
    *, belief: Belief = PLAIN_BELIEF,
) -> DesignModel:  # fmt: skip
    """What is designed for, of what is known (None: the actuator's file, the table and the belief)."""
    if known is None:
        return design_model_as_believed(actuator, table, maps.one_side, belief.effects, maps.pair)
    return _design_model(actuator, known, table, maps)


def with_asked_overlap(
    options: DesignOptions, model: DesignModel, reference: ReferenceArrays
) -> tuple[DesignOptions, AskedVoltage]:
    """(the options with the overlap that a reference needs where they leave it open, what it asks of the coils).

    A design without an overlap, and a reference that no overlap helps, get none.
    """
    samples = np.stack([reference.position, reference.velocity, reference.acceleration], axis=1)
    asked = asked_voltage(model, samples, overlap=options.choice().overlap)
    if options.overlap != AUTO:
        return options, asked
    kind = DESIGNS.get(options.design)
    if not asked.needed > 0 or kind is None or "overlap" not in kind.options:
        return replace(options, overlap="0 N"), asked
    return replace(options, overlap=f"{asked.needed:g} N"), asked_voltage(model, samples, overlap=asked.needed)


def known_model(file: Path) -> ExtendedModel | ArmaxModel:
    """What a file tells the controller: TOML an extended model, JSON an identified one."""
    if file.suffix == ".toml":
        return load_extended_model(file)
    if file.suffix != ".json":
        raise InputError(f"--model {file}: give 'table', an identified model (.json) or an extended model (.toml)")
    try:
        content = parse_json(small_text(file))
    except OSError as err:
        raise InputError(
            f"--model {file}: cannot be read ({reason(err)}); give what 'msl-fem identify -o' wrote"
        ) from err
    except (ValueError, RecursionError) as err:
        raise InputError(f"--model {file}: no JSON ({err}); give what 'msl-fem identify -o' wrote") from err
    if not isinstance(content, dict):
        raise InputError(f"--model {file}: no identified model; give what 'msl-fem identify -o' wrote")
    return model_from_json(content)


def _design_model(
    actuator: Actuator, known: ExtendedModel | ArmaxModel, table: MagneticTable, maps: Maps
) -> DesignModel:
    if isinstance(known, ArmaxModel):
        return design_model_of_terms(actuator, identified_plant(known, actuator), maps.one_side, maps.pair)
    return design_model_with_effects(known.actuator, table, maps.one_side, known.effects, maps.pair)


def identified_plant(model: ArmaxModel, actuator: Actuator) -> IdentifiedPlant:
    """Suspension and force terms of an identified model, its scale the actuator's moving mass.

    Raises
    ------
    InputError : a model without rational terms or of another order than a mass on a spring; another nominal gap
    """
    rational, motion = model.rational, actuator.motion
    if rational is None:
        raise InputError("the identified model has no rational terms; identify a record with currents of the sides")
    if motion is None or motion.nominal_gap is None:
        raise InputError(f"{actuator.name} has no motion.nominal_gap; an identified model's terms need it")
    found = physical_parameters(model, mass=KnownMass(motion.moving_mass))
    needed = ["stiffness", "damping", *(f"force_constant[{text}]" for text in map(str, rational.terms))]
    unknown = [name for name in needed if name not in found]
    if unknown:
        raise InputError(f"the identified model has no finite standard error of {', '.join(unknown)}; identify it anew")
    terms = []
    for text in map(str, rational.terms):
        term = rational_term(text)
        constant = found[f"force_constant[{text}]"].value
        terms.append(ForceTerm(term.side, term.current_power, term.gap_power, constant))
    offset = rational.nominal_gap - motion.nominal_gap
    return IdentifiedPlant(found["stiffness"].value, found["damping"].value, tuple(terms), rational.delta + offset)
