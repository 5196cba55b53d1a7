"""rig.toml: what the experimenter states about the bench, and the actuator that follows from it."""

from pathlib import Path, PureWindowsPath
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationError, model_validator

from msl_fem.actuator import PURE_NUMBERS, Actuator, load_actuator
from msl_fem.errors import RecordError
from msl_fem.files.schema import FrozenModel, bare_number, first_complaint, read_toml
from msl_fem.record.record import Noise, Origin, Role, Sampling, Tolerance

RIG_FILE = "rig.toml"
STATIC_FILE = "static.csv"
OVERRIDES = ("magnet", "sides", "motion", "drive", "position_sensor", "current_sensor")
"""Sections of the actuator file that rig.toml may state anew, key by key."""


class RunEntry(FrozenModel):
    """A `[[run]]` of rig.toml."""

    file: Annotated[str, Field(min_length=1)]
    excitation: str = ""
    role: Role

    @model_validator(mode="after")
    def _stays_in_the_folder(self) -> "RunEntry":
        path = PureWindowsPath(self.file)  # knows both kinds of slash
        if path.root or path.drive or ".." in path.parts or "\0" in self.file:
            raise ValueError(f"file '{self.file}' leaves the record's folder; copy the file into it")
        return self


class StaticEntry(FrozenModel):
    """The `[static]` of rig.toml; without a role, static.csv has a column of it."""

    role: Role | None = None


class RigFile(FrozenModel):
    """rig.toml as it stands, quantities in SI units."""

    schema_version: Literal[1] = Field(alias="schema")
    origin: Origin
    actuator: Annotated[str, Field(min_length=1)]
    sampling: Sampling | None = None
    noise: Noise = Noise()
    tolerance: Tolerance = Tolerance()
    controller: dict[str, Any] | None = None
    run: tuple[RunEntry, ...] = ()
    static: StaticEntry | None = None
    overrides: dict[str, dict[str, Any]] = Field(default_factory=dict, exclude=True)


def read_rig(folder: Path) -> RigFile:
    """The content of a record's rig.toml.

    Raises
    ------
    RecordError : no such file, not TOML, an unknown or a missing key, a wrong unit; names the file and the key path
    """
    file = folder / RIG_FILE
    content = read_toml(file, error=RecordError, wanted="a record, which is a folder with a rig.toml")
    overrides = {key: content.pop(key) for key in OVERRIDES if isinstance(content.get(key), dict)}
    dimensional = {key: value for key, value in content.items() if key not in ("controller", "tolerance")}
    dimensional |= {**overrides, "controller": _timing(content.get("controller"))}
    complaint = bare_number(dimensional, PURE_NUMBERS)
    if "overrides" in content:
        complaint = "overrides: unknown key; state the actuator's sections by their own names"
    if complaint:
        raise RecordError(f"{file}: {complaint}")
    try:
        return RigFile.model_validate({**content, "overrides": overrides})
    except ValidationError as err:
        raise RecordError(f"{file}: {first_complaint(err)}") from err


def rig_actuator(rig: RigFile, folder: Path) -> Actuator:
    """The actuator that rig.toml names, with what rig.toml states in place of the actuator file's values.

    A section with a name of the actuator file's overrides key by key; `[noise]` is that of the sensors; `rate` and
    `delay_samples` of `[controller]` are the controller's.

    Raises
    ------
    RecordError : no such actuator, or the two do not fit together
    ActuatorError : the actuator file is none
    """
    believed = load_actuator(_actuator_file(rig.actuator, folder))
    stated: dict[str, Any] = dict(rig.overrides)
    for section, sigma in (("position_sensor", rig.noise.position), ("current_sensor", rig.noise.current)):
        if sigma is not None:
            if "noise" in stated.get(section, {}):
                name = section.removesuffix("_sensor")
                raise RecordError(
                    f"{folder / RIG_FILE}: {section}.noise and noise.{name} state the same; remove {section}.noise"
                )
            stated[section] = {**stated.get(section, {}), "noise": sigma}
    timing = _timing(rig.controller)
    if timing and (believed.controller or "rate" in timing):
        stated["controller"] = timing
    if not stated:
        return believed
    content = _merged(believed.model_dump(by_alias=True, exclude_none=True), stated)
    try:
        return Actuator.model_validate({**content, "file": believed.file})
    except ValidationError as err:
        said = first_complaint(err, unions=["magnet"])
        raise RecordError(f"{folder / RIG_FILE}: with the actuator '{rig.actuator}': {said}") from err


def _timing(controller: object) -> dict[str, Any]:
    """What the free text of `[controller]` has in common with the actuator's section."""
    stated = controller if isinstance(controller, dict) else {}
    return {key: value for key, value in stated.items() if key in ("rate", "delay_samples")}


def _merged(base: dict[str, Any], stated: dict[str, Any]) -> dict[str, Any]:
    merged = dict(base)
    for key, value in stated.items():
        inner = merged.get(key)
        merged[key] = _merged(inner, value) if isinstance(inner, dict) and isinstance(value, dict) else value
    return merged


def _actuator_file(text: str, folder: Path) -> Path:
    """A path relative to rig.toml, else `geometries/<name>.toml` of the current or the record's folder or above."""
    beside = folder / text
    if beside.is_file():
        return beside
    if Path(text).name == text:
        for start in (Path.cwd(), folder.resolve()):
            for parent in (start, *start.parents):
                candidate = parent / "geometries" / f"{text}.toml"
                if candidate.is_file():
                    return candidate
    raise RecordError(
        f"{folder / RIG_FILE}: actuator: '{text}' is neither a file beside rig.toml nor one of geometries/ here or "
        "above; give a path relative to rig.toml"
    )
