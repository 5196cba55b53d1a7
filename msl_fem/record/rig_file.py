"""rig.toml: what the experimenter states about the bench, and the actuator and the control laws that follow from it."""

import contextlib
from pathlib import Path, PureWindowsPath
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field, GetCoreSchemaHandler, ValidationError, field_validator, model_validator
from pydantic_core import CoreSchema, core_schema

from msl_fem.actuator import PURE_NUMBERS, Actuator, CurrentNoise, Frequency, PositionNoise, load_actuator
from msl_fem.computing.laws import LawExpression, expressions_of_table
from msl_fem.errors import InputError, RecordError
from msl_fem.files.schema import FrozenModel, In, bare_number, first_complaint, read_toml

Role = Literal["fit", "held-out"]
Mover = Literal["free", "locked", "imposed", "absent"]
Origin = Literal["measured", "simulated"]
BeliefWord = Literal["as-designed", "plain"]
GapZero = Literal["gauge", "mover"]
RowOrder = Literal["measured", "unknown"]
Scale = Literal["stated", "free"]
Tolerated = Annotated[float, In(""), Field(ge=0, lt=1)]
RIG_FILE = "rig.toml"
STATIC_FILE = "static.csv"
OVERRIDES = ("magnet", "sides", "motion", "drive", "position_sensor", "current_sensor")
"""Sections of the actuator file that rig.toml may state anew, key by key."""
DEMAGNETISED, UNKNOWN, CYCLED = "demagnetised", "unknown", "cycled:"


class Sampling(FrozenModel):
    """Sampling of the runs; `hold` says how inputs run between samples.

    Attributes
    ----------
    rate : samples a second
    hold : inputs are held over a sample, or run straight to the next
    """

    rate: Frequency
    hold: Literal["zero-order", "linear"] = "zero-order"


class Noise(FrozenModel):
    """One sigma of each instrument, from its data sheet; None where it is not known.

    Attributes
    ----------
    position, velocity, current, voltage, force, flux_linkage : RMS of its white noise
    """

    position: PositionNoise | None = None
    velocity: Annotated[float, In("m/s"), Field(ge=0)] | None = None
    current: CurrentNoise | None = None
    voltage: Annotated[float, In("V"), Field(ge=0)] | None = None
    force: Annotated[float, In("N"), Field(ge=0)] | None = None
    flux_linkage: Annotated[float, In("Wb"), Field(ge=0)] | None = None


class OfDrive:
    """Annotation of a float: a text with the unit of what a drive takes, A, V or N, or an SI number."""

    def read(self, given: object) -> float:
        """The SI value; ValueError where the text is no quantity in A, V or N."""
        for unit in ("V", "N"):
            with contextlib.suppress(ValueError):
                return In(unit).read(given)
        return In("A").read(given)

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.no_info_before_validator_function(self.read, handler(source))


class Tolerance(FrozenModel):
    """One sigma, relative where no unit is given, of how well parameters of rig and instruments are known.

    Attributes
    ----------
    moving_mass, stiffness, damping, coil_resistance, nominal_gap : of the actuator file's value
    position_gain, velocity_gain, current_gain, force_gain, flux_linkage_gain : of what the sensor shows per unit
    voltage_gain, command_gain : of what the amplifier takes or shows per unit
    position_zero, velocity_zero, current_zero, force_zero, flux_linkage_zero, flux_density_zero : of the sensor's zero
    command_zero : of the drive's input; A, V or N by the drive
    magnetic_scale : of force and flux linkage together, as turns or depth change them
    table : of the table's shape
    static_gap_zero : of the gauges that set the gaps of static.csv
    force_asymmetry, flux_linkage_asymmetry, flux_density_asymmetry : of readings above zero against those below
    leakage_inductance, mutual_inductance : of the inductance of a side at the nominal gap
    """

    OF_THE_RIG: ClassVar = (
        "moving_mass", "stiffness", "damping", "coil_resistance", "nominal_gap", "position_gain", "magnetic_scale",
        "table",
    )  # fmt: skip
    """Of the rig and its table; the others are of instruments, of leakage and mutual flux."""
    moving_mass: Tolerated = 0.005
    stiffness: Tolerated = 0.02
    damping: Tolerated = 0.2
    coil_resistance: Tolerated = 0.01
    nominal_gap: Tolerated = 0.005
    position_gain: Tolerated = 0.002
    magnetic_scale: Tolerated = 0.002
    table: Tolerated = 0.001
    position_zero: Annotated[float, In("m"), Field(ge=0)] = 1e-6
    velocity_zero: Annotated[float, In("m/s"), Field(ge=0)] = 1e-3
    velocity_gain: Tolerated = 0.005
    current_zero: Annotated[float, In("A"), Field(ge=0)] = 5e-3
    force_zero: Annotated[float, In("N"), Field(ge=0)] = 0.05
    command_zero: Annotated[float, OfDrive(), Field(ge=0)] = 5e-3
    voltage_gain: Tolerated = 0.005
    command_gain: Tolerated = 0.005
    current_gain: Tolerated = 0.005
    force_gain: Tolerated = 0.005
    static_gap_zero: Annotated[float, In("m"), Field(ge=0)] = 2e-6
    force_asymmetry: Tolerated = 0.0
    flux_linkage_zero: Annotated[float, In("Wb"), Field(ge=0)] = 0.0
    flux_linkage_gain: Tolerated = 0.0
    flux_linkage_asymmetry: Tolerated = 0.0
    flux_density_zero: Annotated[float, In("T"), Field(ge=0)] = 0.0
    flux_density_asymmetry: Tolerated = 0.0
    leakage_inductance: Tolerated = 0.01
    mutual_inductance: Tolerated = 0.003


class RunEntry(FrozenModel):
    """A `[[run]]` of rig.toml; `mover` says whether it was free to move, held where it was, moved by a hand or a
    machine whose force is measured, or taken away; `levels` are columns that have one value throughout, by name.

    Attributes
    ----------
    file : CSV or NetCDF in the record's folder
    excitation : words on what drove the run
    role : models are fitted to it, or judged by it
    mover : what became of it during the run
    levels : column to its one value
    """

    file: Annotated[str, Field(min_length=1)]
    excitation: str = ""
    role: Role
    mover: Mover = "free"
    levels: dict[str, float] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _stays_in_the_folder(self) -> "RunEntry":
        path = PureWindowsPath(self.file)  # knows both kinds of slash
        if path.root or path.drive or ".." in path.parts or "\0" in self.file:
            raise ValueError(f"file '{self.file}' leaves the record's folder; copy the file into it")
        return self


def cycled_current(before: str) -> float | None:
    """The last current (A) of the cycles before the first row; None where there were none.

    Raises
    ------
    ValueError : `before` is no history
    """
    if before in (DEMAGNETISED, UNKNOWN):
        return None
    text = before.removeprefix(CYCLED)
    if text == before:
        raise ValueError(f'\'{before}\' is no history; write "{DEMAGNETISED}", "{UNKNOWN}" or "{CYCLED}+10 A"')
    current = In("A").read(text.strip().removeprefix("+"))
    if current == 0:
        raise ValueError(f"'{before}' cycles nothing; write \"{DEMAGNETISED}\"")
    return current


class StaticEntry(FrozenModel):
    """The `[static]` of rig.toml; without a role, static.csv has a column of it.

    `gap` says whether its gaps were set by gauges, with a zero of their own, or by the mover of the runs; `order`
    whether the rows stand as they were measured; `before` what the iron had gone through: "demagnetised", "unknown",
    or "cycled:+10 A" (between both currents, that one last); `scale` whether the readings are in their unit, or
    ("free") in proportion to it; `curves` are files of calibration curves, by the columns of static.csv.

    Attributes
    ----------
    role : of all rows
    gap : whose zero the gaps have
    order : whether the rows stand as they were measured
    before : what the iron had gone through
    scale : of the readings
    curves : column to the file of its calibration curve
    """

    role: Role | None = None
    gap: GapZero = "gauge"
    order: RowOrder = "measured"
    before: str = DEMAGNETISED
    scale: Scale = "stated"
    curves: dict[str, str] = Field(default_factory=dict)

    @field_validator("before")
    @classmethod
    def _is_a_history(cls, before: str) -> str:
        cycled_current(before)
        return before


class DutySupply(FrozenModel):
    """The `[supply]` of a drive whose runs have duties instead of voltages.

    Attributes
    ----------
    voltage : of the supply; a side's voltage is its duty times this
    """

    voltage: Annotated[float, In("V"), Field(gt=0)]


class Scheduling(FrozenModel):
    """A `[[scheduling]]`: a column of the runs, beside the drive, that changes parameters of the rig.

    `changes` are "damping" and the like, or amounts of effects, "coulomb_friction.force"; `at` the levels of the column
    between which they go straight (left out: those of the runs); `tolerance` one sigma of the logarithm by which they
    may differ from their value at the first level.

    Attributes
    ----------
    column : name in the runs, with its unit behind the last underscore
    changes : believed parameters, or amounts of effects
    at : its levels, ascending
    tolerance : one sigma of the logarithm
    """

    column: Annotated[str, Field(pattern="^[A-Za-z][A-Za-z0-9_]*_[A-Za-z0-9]+$")]
    changes: Annotated[tuple[str, ...], Field(min_length=1)]
    at: tuple[float, ...] = ()
    tolerance: Annotated[float, Field(gt=0)] = 1.0

    @field_validator("at")
    @classmethod
    def _ascend(cls, at: tuple[float, ...]) -> tuple[float, ...]:
        if at and (len(at) < 2 or any(b <= a for a, b in zip(at, at[1:], strict=False))):
            raise ValueError(f"{list(at)} are no levels; give two or more, in ascending order")
        return at


class StatedEffects(FrozenModel):
    """The `[[effects.expression]]` of rig.toml: causes of the user's own that a diagnosis tries too.

    Attributes
    ----------
    expression : each with name, equation, law and parameters
    """

    expression: tuple[dict[str, Any], ...] = ()


class RigFile(FrozenModel):
    """rig.toml as it stands, quantities in SI units.

    Attributes
    ----------
    schema_version : of this form of the file
    origin : of the runs
    actuator : path of the actuator file, from the record's folder
    belief : what is believed beside the table
    controller : the law of a loop that was closed around the rig
    position_sensor_curve : file with the columns reading (V) and value (m), where runs have position_sensor_V
    """

    schema_version: Literal[1] = Field(alias="schema")
    origin: Origin
    actuator: Annotated[str, Field(min_length=1)]
    sampling: Sampling | None = None
    noise: Noise = Noise()
    tolerance: Tolerance = Tolerance()
    belief: BeliefWord | None = None
    controller: dict[str, Any] | None = None
    supply: DutySupply | None = None
    position_sensor_curve: str | None = None
    scheduling: tuple[Scheduling, ...] = ()
    run: tuple[RunEntry, ...] = ()
    static: StaticEntry | None = None
    effects: StatedEffects = StatedEffects()
    overrides: dict[str, dict[str, Any]] = Field(default_factory=dict, exclude=True)

    def causes(self, folder: Path) -> tuple[LawExpression, ...]:
        """The causes that the user states.

        Raises
        ------
        RecordError : one of them is none; names the place
        """
        try:
            return expressions_of_table({"expression": self.effects.expression}, where=str(folder / RIG_FILE))
        except InputError as err:
            raise RecordError(str(err)) from err


def read_rig(folder: Path) -> RigFile:
    """The content of a record's rig.toml.

    Raises
    ------
    RecordError : no such file, not TOML, an unknown or a missing key, a wrong unit; names the file and the key path
    """
    file = folder / RIG_FILE
    content = read_toml(file, error=RecordError, wanted="a record, which is a folder with a rig.toml")
    overrides = {key: content.pop(key) for key in OVERRIDES if isinstance(content.get(key), dict)}
    dimensional = {k: v for k, v in content.items() if k not in ("controller", "tolerance", "scheduling")}
    if isinstance(content.get("run"), list):  # levels have their units in their names
        entries = [entry for entry in content["run"] if isinstance(entry, dict)]
        dimensional["run"] = [{k: v for k, v in entry.items() if k != "levels"} for entry in entries]
    dimensional |= overrides
    dimensional["controller"] = _timing(content.get("controller"))
    complaint = bare_number(dimensional, PURE_NUMBERS)
    if "overrides" in content:
        complaint = "overrides: unknown key; state the actuator's sections by their own names"
    if complaint:
        raise RecordError(f"{file}: {complaint}")
    try:
        return RigFile.model_validate({**content, "overrides": overrides})
    except ValidationError as err:
        raise RecordError(f"{file}: {first_complaint(err, of=RigFile)}") from err


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
    for name, sigma in (("position", rig.noise.position), ("current", rig.noise.current)):
        if sigma is None:
            continue
        section = f"{name}_sensor"
        if "noise" in stated.get(section, {}):
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
        complaint = first_complaint(err, unions=["magnet"])
        raise RecordError(f"{folder / RIG_FILE}: with the actuator '{rig.actuator}': {complaint}") from err


def _timing(controller: object) -> dict[str, Any]:
    """What the free text of `[controller]` has in common with the actuator's section."""
    stated = controller if isinstance(controller, dict) else {}
    return {key: value for key, value in stated.items() if key in ("rate", "delay_samples")}


def _merged(base: dict[str, Any], stated: dict[str, Any]) -> dict[str, Any]:
    merged = dict(base)
    for key, value in stated.items():
        inner = merged.get(key)
        if isinstance(inner, dict) and isinstance(value, dict):
            value = _merged(inner, value)
        merged[key] = value
    return merged


def _actuator_file(text: str, folder: Path) -> Path:
    """A path relative to rig.toml, else `geometries/<name>.toml` of the current or the record's folder or above."""
    beside = folder / text
    if beside.is_file():
        return beside
    if Path(text).name == text:
        here, there = Path.cwd(), folder.resolve()
        for parent in (here, *here.parents, there, *there.parents):
            candidate = parent / "geometries" / f"{text}.toml"
            if candidate.is_file():
                return candidate
    raise RecordError(
        f"{folder / RIG_FILE}: actuator: '{text}' is neither a file beside rig.toml nor one of geometries/ here or "
        "above; give a path relative to rig.toml"
    )
