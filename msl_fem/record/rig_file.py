"""rig.toml: what the experimenter states about the bench, and the actuator and the control laws that follow from it."""

import contextlib
from collections.abc import Mapping
from pathlib import Path, PureWindowsPath
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field, GetCoreSchemaHandler, ValidationError, model_validator
from pydantic_core import CoreSchema, core_schema

from msl_fem.actuator import PURE_NUMBERS, Actuator, CurrentNoise, Frequency, PositionNoise, load_actuator
from msl_fem.computing.arrays import Array
from msl_fem.computing.laws import LawExpression, expressions_of_table
from msl_fem.errors import InputError, RecordError
from msl_fem.files.schema import FrozenModel, In, bare_number, first_complaint, read_toml
from msl_fem.record.columns import CHANNELS

Role = Literal["fit", "held-out"]
Origin = Literal["measured", "simulated"]
BeliefWord = Literal["as-designed", "plain"]
GapZero = Literal["gauge", "mover"]
Tolerated = Annotated[float, In(""), Field(ge=0, lt=1)]
Matrix = tuple[tuple[float, ...], ...]
RIG_FILE = "rig.toml"
STATIC_FILE = "static.csv"
OVERRIDES = ("magnet", "sides", "motion", "drive", "position_sensor", "current_sensor")
"""Sections of the actuator file that rig.toml may state anew, key by key."""
READINGS = ("position_m", "current_1_A", "current_2_A")
"""Columns that a law may look at."""
OUTPUTS = ("command_1_A", "command_2_A", "current_1_A", "current_2_A", "voltage_1_V", "voltage_2_V", "force_N")
"""Columns that a law may make."""
_NUMBERS = ("a", "b", "c", "d", "signs")  # lists of plain numbers


class Sampling(FrozenModel):
    """Sampling of the runs; `hold` says how inputs run between samples."""

    rate: Frequency
    hold: Literal["zero-order", "linear"] = "zero-order"


class Noise(FrozenModel):
    """One sigma of each instrument, from its data sheet; None where it is not known."""

    position: PositionNoise | None = None
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
    """One sigma, relative where no unit is given, of how well parameters of rig and instruments are known."""

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
    current_zero: Annotated[float, In("A"), Field(ge=0)] = 5e-3
    force_zero: Annotated[float, In("N"), Field(ge=0)] = 0.05
    command_zero: Annotated[float, OfDrive(), Field(ge=0)] = 5e-3
    voltage_gain: Tolerated = 0.005
    command_gain: Tolerated = 0.005
    current_gain: Tolerated = 0.005
    force_gain: Tolerated = 0.005
    static_gap_zero: Annotated[float, In("m"), Field(ge=0)] = 2e-6
    leakage_inductance: Tolerated = 0.01
    mutual_inductance: Tolerated = 0.003


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
    """The `[static]` of rig.toml; without a role, static.csv has a column of it.

    `gap` says whether its gaps were set by gauges, with a zero of their own, or by the mover of the runs.
    """

    role: Role | None = None
    gap: GapZero = "gauge"


class StatedEffects(FrozenModel):
    """The `[[effects.expression]]` of rig.toml: causes of the user's own that a diagnosis tries too."""

    expression: tuple[dict[str, Any], ...] = ()


class RigFile(FrozenModel):
    """rig.toml as it stands, quantities in SI units."""

    schema_version: Literal[1] = Field(alias="schema")
    origin: Origin
    actuator: Annotated[str, Field(min_length=1)]
    sampling: Sampling | None = None
    noise: Noise = Noise()
    tolerance: Tolerance = Tolerance()
    belief: BeliefWord | None = None
    controller: dict[str, Any] | None = None
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
    dimensional = {key: value for key, value in content.items() if key not in ("controller", "tolerance")}
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


class _Law(FrozenModel):
    """What both kinds state; `runs` names the runs that it drove (none: all of them)."""

    runs: tuple[str, ...] = ()
    outputs: Annotated[tuple[str, ...], Field(min_length=1, max_length=2)]
    source: str = ""

    @model_validator(mode="after")
    def _makes_what_a_drive_takes(self) -> "_Law":
        for name in self.outputs:
            if name not in OUTPUTS:
                raise ValueError(f"outputs: '{name}' drives nothing; a law makes {', '.join(OUTPUTS)}")
        if len(set(self.outputs)) < len(self.outputs):
            raise ValueError("outputs: a column is there twice; state it once")
        return self


class StateSpaceLaw(_Law):
    """s[k+1] = a s[k] + b y[k], u[k] = c s[k] + d y[k], in SI units, at the controller's rate.

    y are the readings `inputs`, u the commands `outputs`. The reference and constants are left out: of a linear law its
    answer to what is read is all that a simulation beside the record needs.
    """

    kind: Literal["state-space"]
    inputs: Annotated[tuple[str, ...], Field(min_length=1, max_length=3)] = ("position_m",)
    a: Matrix = ()
    b: Matrix = ()
    c: Matrix = ()
    d: Matrix

    @model_validator(mode="after")
    def _fits_together(self) -> "StateSpaceLaw":
        for name in self.inputs:
            if name not in READINGS:
                raise ValueError(f"inputs: '{name}' is not read; a law reads {', '.join(READINGS)}")
        n = len(self.a)
        for name, shape in self._shapes().items():
            rows = getattr(self, name)
            if len(rows) != shape[0] or any(len(row) != shape[1] for row in rows):
                raise ValueError(
                    f"{name}: is not {shape[0]} rows of {shape[1]} numbers, as {n} states, inputs {list(self.inputs)} "
                    f"and outputs {list(self.outputs)} ask for"
                )
            if not np.isfinite(np.array(rows, dtype=float)).all():
                raise ValueError(f"{name}: a number is not finite")
        return self

    def matrices(self, period: float) -> tuple[Array, Array, Array, Array]:
        """(a, b, c, d) for a law that is run every `period` seconds: as stated."""
        n, n_out = len(self.a), len(self.outputs)
        shapes = {**self._shapes(), "c": (n_out, n)}  # also without states, where the file states no c
        a, b, c, d = (np.array(getattr(self, name), dtype=float).reshape(shapes[name]) for name in "abcd")
        return a, b, c, d

    def _shapes(self) -> dict[str, tuple[int, int]]:
        """Of the matrices as stated."""
        n, n_in, n_out = len(self.a), len(self.inputs), len(self.outputs)
        return {"a": (n, n), "b": (n, n_in), "c": (n_out if n else 0, n), "d": (n_out, n_in)}


class PidLaw(_Law):
    """u = kp e + ki T sum(e) + kd (e - e before)/T of e = reference - position, T the controller's period.

    The sum holds the present error; with `derivative_time` the difference passes a first-order lag of that time. Each
    output takes u times its entry of `signs` (left out: all 1).
    """

    kind: Literal["pid"]
    kp: str
    ki: str | None = None
    kd: str | None = None
    derivative_time: Annotated[float, In("s"), Field(gt=0)] | None = None
    signs: tuple[float, ...] = ()

    @model_validator(mode="after")
    def _gains_are_of_its_output(self) -> "PidLaw":
        self._gains()
        if self.signs and len(self.signs) != len(self.outputs):
            raise ValueError(f"signs: {len(self.signs)} numbers for {len(self.outputs)} outputs; give one each")
        return self

    @property
    def inputs(self) -> tuple[str, ...]:
        return ("position_m",)

    def _gains(self) -> tuple[float, float, float]:
        unit = CHANNELS[self.outputs[0]].unit
        gains = []
        for name, per in (("kp", "/m"), ("ki", "/m/s"), ("kd", " s/m")):
            text = getattr(self, name)
            try:
                gains.append(0.0 if text is None else In(unit + per).read(text))
            except ValueError as err:
                raise ValueError(f"{name}: {err}") from err
        return gains[0], gains[1], gains[2]

    def matrices(self, period: float) -> tuple[Array, Array, Array, Array]:
        """(a, b, c, d) from position to outputs: states are sum of e, e before and its lagged difference, less the
        reference's part."""
        kp, ki, kd = self._gains()
        keep = 0.0 if self.derivative_time is None else float(np.exp(-period / self.derivative_time))
        slope = (1 - keep) * kd / period
        a = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, -slope, keep]])
        b = np.array([[1.0], [1.0], [slope]])
        c = np.array([[ki * period, -slope, keep]])
        d = np.array([[kp + ki * period + slope]])
        signs = np.array(self.signs or (1.0,) * len(self.outputs))[:, None]
        return a, b, -signs * c, -signs * d


StatedLaw = StateSpaceLaw | PidLaw
_KINDS: dict[str, type[StatedLaw]] = {"state-space": StateSpaceLaw, "pid": PidLaw}


def linear_laws(controller: Mapping[str, Any] | None) -> tuple[StatedLaw, ...]:
    """The laws of `[[controller.linear]]`; none where there are none.

    Raises
    ------
    RecordError : an unknown key or kind, matrices that do not fit together, a gain of a wrong unit; names the key path
    """
    stated = (controller or {}).get("linear", [])
    if not isinstance(stated, list | tuple) or not all(isinstance(entry, Mapping) for entry in stated):
        raise RecordError("controller.linear: is no list of laws; write [[controller.linear]] before each")
    return tuple(_linear_law(entry, f"controller.linear.{n}") for n, entry in enumerate(stated))


def _linear_law(entry: Mapping[str, Any], path: str) -> StatedLaw:
    kind = _KINDS.get(str(entry.get("kind")))
    if kind is None:
        raise RecordError(f"{path}.kind: '{entry.get('kind', '')}' is no law; there are {', '.join(_KINDS)}")
    dimensional = {key: value for key, value in entry.items() if key not in _NUMBERS}
    complaint = bare_number(dimensional, (), path=f"{path}.")
    if complaint:
        raise RecordError(complaint)
    try:
        return kind.model_validate(dict(entry))
    except ValidationError as err:
        key, colon, problem = first_complaint(err).partition(": ")
        at = "" if key in ("", "Value error") or not colon else f".{key}"
        raise RecordError(f"{path}{at}: {problem if colon else key}") from err


def law_of(laws: tuple[StatedLaw, ...], run: str) -> StatedLaw | None:
    """The first law that drove a run; None where none is stated."""
    return next((law for law in laws if not law.runs or run in law.runs), None)
