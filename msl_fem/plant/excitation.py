"""Excitations from texts ("sine:frequency=2 Hz,amplitude=0.4 mm,duration=1 s") or a TOML file, and a run's inputs."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import ValidationError

from msl_fem.actuator import Actuator
from msl_fem.computing.arrays import Array
from msl_fem.errors import InputError
from msl_fem.files.quantity import format_quantity
from msl_fem.files.schema import bare_number, first_complaint, has_unknown_key, read_toml
from msl_fem.plant.excitation_kinds import KINDS, Excitation, ExcitedSides, Unit, sample_count

MOST_SAMPLES = 20_000_000
_PURE_NUMBERS = ("channel", "seed", "periods")


def parse_excitation(text: str, *, unit: Unit = "A") -> Excitation:
    """The excitation that a text "name:key=value,key=value" describes; `unit` is that of amplitude and bias.

    A text that says `loop=closed` describes a reference: its amplitude and bias are in m.

    Raises
    ------
    InputError : an unknown name or key, a missing or a double key, a value of the wrong dimension or out of its range
    """
    name, _, rest = text.partition(":")
    content: dict[str, Any] = {"name": name.strip()}
    for part in rest.split(",") if rest.strip() else []:
        key, equals, value = (word.strip() for word in part.partition("="))
        if not equals or not key or not value:
            raise InputError(f"excitation '{text}': '{part.strip()}' is no key=value; write like \"frequency=2 Hz\"")
        if key in content:
            raise InputError(f"excitation '{text}': {key} is there twice; state it once")
        content[key] = value
    return _excitation_of(content, unit=unit, where=f"excitation '{text}'")


def load_excitations(spec: str, *, unit: Unit = "A") -> tuple[Excitation, ...]:
    """The excitations of a text, or of a TOML file with one `[[excitation]]` each (`name` and the keys of the text).

    The path of a CSV file alone is the signal in it: `csv:file=PATH`.

    Raises
    ------
    InputError : as `parse_excitation`; no such file, not TOML; the message names the file and the key path
    """
    if spec.strip().lower().endswith(".csv") and "=" not in spec:
        return (_excitation_of({"name": "csv", "file": spec.strip()}, unit=unit, where="excitation"),)
    if not spec.strip().lower().endswith(".toml"):
        return (parse_excitation(spec, unit=unit),)
    path = Path(spec.strip())
    content = read_toml(path, error=InputError, wanted="a file of excitations")
    entries = content.pop("excitation", None)
    if content or not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        odd = f"{next(iter(content))}: unknown key" if content else "excitation: is missing"
        raise InputError(f"{path}: {odd}; the file has one [[excitation]] for each")
    excitations = []
    for position, entry in enumerate(entries):
        complaint = bare_number(entry, _PURE_NUMBERS, path=f"excitation.{position}.", words=("channel",))
        if complaint:
            raise InputError(f"{path}: {complaint}")
        beside = {"file": str(path.parent / entry["file"])} if isinstance(entry.get("file"), str) else {}
        excitations.append(_excitation_of({**entry, **beside}, unit=unit, where=f"{path}: excitation.{position}"))
    return tuple(excitations)


def _excitation_of(content: dict[str, Any], *, unit: Unit, where: str) -> Excitation:
    kind = KINDS.get(str(content.get("name")))
    if kind is None:
        raise InputError(f"{where}: '{content.get('name')}' is no excitation; there are {', '.join(KINDS)}")
    if "unit" in content:
        raise InputError(f"{where}: unit: unknown key; remove it")
    try:
        return kind.model_validate({**content, "unit": "m" if content.get("loop") == "closed" else unit})
    except ValidationError as err:
        if not has_unknown_key(err):
            raise InputError(f"{where}: {first_complaint(err)}") from err
        kinds: dict[str, list[str]] = {"extra_forbidden": [], "missing": []}
        for one in err.errors():
            if one["type"] in kinds:
                kinds[one["type"]].append(str(one["loc"][-1]))
        lacking = f", {' and '.join(kinds['missing'])} missing" if kinds["missing"] else ""
        raise InputError(
            f"{where}: {' and '.join(kinds['extra_forbidden'])} unknown{lacking}; {content['name']} takes {_keys(kind)}"
        ) from err


def _keys(kind: type[Excitation]) -> str:
    """The keys of a kind, those first that must be stated."""
    fields = {name: field for name, field in kind.model_fields.items() if name not in ("name", "unit")}
    needed = [name for name, field in fields.items() if field.is_required()]
    optional = [name for name in fields if name not in needed]
    return ", ".join(needed) + (f", and may have {', '.join(optional)}" if optional else "")


def samples(excitation: Excitation, *, rate: float, sides: int, generator: np.random.Generator | None = None) -> Array:
    """The commands of an excitation, (n_sample, n_side) in its unit, the first at t = 0, n_sample = duration * rate.

    With s the signal and b the bias, the channels are
    - 1, 2: b + s on that side, b on the other;
    - common: b + s on both sides;
    - differential: b + s on side 1, b - s on side 2; without a bias one side or the other by the sign of s: side 1
      takes max(s, 0), side 2 max(-s, 0);
    - independent: b + s_1 and b + s_2 with two independent draws.

    Where no channel is stated, one side takes b + s, two take what is usual for the kind. Nothing is clipped: an
    excitation that can make a current negative is refused, whatever its seed. `generator` is a fresh one of the
    excitation's seed if not given.

    Raises
    ------
    InputError : a frequency not below half the rate, a channel that the sides do not have, a current below zero
    """
    channel = _channel(excitation, sides)
    _check_sampling(excitation, rate)
    _check_sign(excitation, channel)
    generator = np.random.default_rng(excitation.seed) if generator is None else generator
    command = np.full((sample_count(excitation, rate), sides), excitation.bias)
    signal = excitation.amplitude * excitation.signal(rate, generator)[0]
    if channel == "common":
        command += signal[:, None]
    elif channel == "independent":
        command[:, 0] += signal
        command[:, 1:] += excitation.amplitude * excitation.signal(rate, generator)[0][:, None]
    elif channel == "differential" and excitation.bias == 0:
        command = np.maximum(np.column_stack([signal, -signal]), 0.0)
    elif channel == "differential":
        command += np.column_stack([signal, -signal])
    else:
        command[:, int(channel) - 1] += signal
    return np.maximum(command, 0.0) if excitation.unit == "A" else command  # a rounding below zero, see _check_sign


def _channel(excitation: Excitation, sides: int) -> ExcitedSides:
    """The stated channel or the usual one, if the sides have it."""
    if sides not in (1, 2):
        raise InputError(f"{excitation.name}: an actuator of {sides} sides; 1 or 2 can be excited")
    channel = excitation.channel or ("1" if sides == 1 else excitation.usual_channel)
    if sides == 1 and channel in ("2", "differential", "independent"):
        raise InputError(f"{excitation.name}: channel={channel} needs two sides, there is one; use channel=1 or common")
    if channel == "independent" and excitation.usual_channel != "independent":
        raise InputError(
            f"{excitation.name}: channel=independent needs a signal with random phases; "
            "use channel=1, 2, common or differential, or band-limited-noise or multisine"
        )
    return channel


def _check_sampling(excitation: Excitation, rate: float) -> None:
    if 2 * excitation.highest_frequency >= rate:
        raise InputError(
            f"{excitation.name}: {format_quantity(excitation.highest_frequency, 'Hz')} is not below half the sampling "
            f"rate, {format_quantity(rate / 2, 'Hz')}; lower it or sample faster"
        )
    if excitation.duration * rate > MOST_SAMPLES:
        raise InputError(
            f"{excitation.name}: {excitation.duration * rate:.3g} samples are more than {MOST_SAMPLES:.3g}; "
            "shorten the duration"
        )


def _check_sign(excitation: Excitation, channel: ExcitedSides) -> None:
    """InputError where the command of a current could become negative."""
    if excitation.unit != "A" or (channel == "differential" and excitation.bias == 0):
        return
    lowest, highest = excitation.span()
    depth = max(-lowest, highest) if channel == "differential" else -lowest
    if depth * excitation.amplitude > excitation.bias * (1 + 1e-9):
        raise InputError(
            f"{excitation.name}: amplitude {format_quantity(excitation.amplitude, 'A')} would make currents negative; "
            f"with bias {format_quantity(excitation.bias, 'A')} at most "
            f"{format_quantity(excitation.bias / depth, 'A')} is allowed; raise the bias, or use "
            "channel=differential without a bias"
        )


@dataclass(frozen=True, eq=False)
class Reference:
    """What a closed loop is to follow: time in s, position in m, its exact derivatives in m/s and m/s2, (n_sample,)."""

    time: Array
    position: Array
    velocity: Array
    acceleration: Array


def reference(excitation: Excitation, *, rate: float, generator: np.random.Generator | None = None) -> Reference:
    """The position bias + amplitude s(t) with its analytic derivatives; where s jumps they are those beside the jump.

    Raises
    ------
    InputError : the excitation was not read with the unit m; a frequency not below half the rate
    """
    if excitation.unit != "m":
        raise InputError(f"{excitation.name}: amplitude is in {excitation.unit}; a reference needs one in m")
    _check_sampling(excitation, rate)
    generator = np.random.default_rng(excitation.seed) if generator is None else generator
    position, velocity, acceleration = excitation.amplitude * excitation.signal(rate, generator)
    time = np.arange(position.size) / rate
    return Reference(time, excitation.bias + position, velocity, acceleration)


DRIVE_UNIT: dict[str, Unit] = {"current": "A", "voltage": "V", "force": "N"}


@dataclass(frozen=True, eq=False)
class Inputs:
    """Commands to the drive and the disturbance, which is held for one sample.

    Attributes
    ----------
    commands : (n_sample, n_side) in A, V or N by the drive's kind; a force drive has one column
    rate : samples a second, Hz
    disturbance : (n_sample,) N on the mass, or one number for all samples
    hold : commands are held over their samples ("zero-order"), or run straight from one to the next ("linear"; the
        last one is held)
    """

    commands: Array
    rate: float
    disturbance: ArrayLike = 0.0
    hold: Literal["zero-order", "linear"] = "zero-order"

    def __post_init__(self) -> None:
        commands = np.asarray(self.commands, dtype=float)
        commands = commands[:, None] if commands.ndim == 1 else commands
        if commands.ndim != 2 or commands.shape[0] < 1 or commands.shape[1] not in (1, 2):
            raise InputError(f"commands have the shape {commands.shape}, expected (n_sample, 1) or (n_sample, 2)")
        disturbance = np.asarray(self.disturbance, dtype=float)
        if disturbance.shape not in ((), commands.shape[:1]):
            raise InputError(
                f"disturbance has the shape {disturbance.shape}, expected ({commands.shape[0]},) or one number"
            )
        disturbance = np.broadcast_to(disturbance, commands.shape[:1]).copy()
        for name, values in (("commands", commands), ("disturbance", disturbance)):
            if not np.isfinite(values).all():
                row = int(np.argwhere(~np.isfinite(values))[0][0])
                raise InputError(f"{name} are not finite at sample {row}; give numbers")
        if not (self.rate > 0 and np.isfinite(self.rate)):
            raise InputError(f"rate {self.rate:g} Hz must be positive and finite")
        object.__setattr__(self, "commands", commands)
        object.__setattr__(self, "disturbance", disturbance)

    @property
    def time(self) -> Array:
        """Instants of the samples in s, (n_sample,)."""
        return np.arange(self.commands.shape[0]) / self.rate

    @cached_property
    def span(self) -> tuple[float, float]:
        """The least and the largest command."""
        return float(self.commands.min()), float(self.commands.max())

    def for_sides(self, n_side: int) -> Array:
        """The commands as the kernel takes them, (n_sample, 2).

        Raises
        ------
        InputError : they are for another number of sides
        """
        if self.commands.shape[1] != n_side:
            raise InputError(
                f"commands have {self.commands.shape[1]} columns, the actuator's drive has {n_side}; give one a side"
            )
        padded = np.zeros((self.commands.shape[0], 2))
        padded[:, :n_side] = self.commands
        return padded


def excitation_inputs(
    actuator: Actuator, excitation: Excitation | str, *, rate: float, generator: np.random.Generator | None = None
) -> Inputs:
    """The inputs that an excitation, or its text, gives to an actuator's drive, sampled at `rate` (Hz).

    Raises
    ------
    InputError : the excitation's unit is not the drive's; as `excitation.samples` and, of a text, `parse_excitation`
    """
    kind = actuator.drive.kind if actuator.drive else "none"
    if isinstance(excitation, str):
        excitation = parse_excitation(excitation, unit=DRIVE_UNIT.get(kind, "A"))
    if DRIVE_UNIT.get(kind) != excitation.unit:
        raise InputError(
            f"{excitation.name}: amplitude is in {excitation.unit}, the drive of {actuator.name} is of the kind "
            f"'{kind}'; read the excitation with the unit {DRIVE_UNIT.get(kind, 'of a drive')}"
        )
    sides = actuator.sides.count if kind != "force" and actuator.sides else 1
    return Inputs(samples(excitation, rate=rate, sides=sides, generator=generator), rate)
