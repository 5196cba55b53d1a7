"""What an effect is fitted into, its size, and the strength that has the size asked for.

Size is the RMS change of the record at equal input, over that channel's RMS, the largest over position
and currents, in current drive over voltages too. Record means all its runs together, without noise, with and without
the effect at the same true parameters; RMS is the root of the mean square, constant part included.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any
from zlib import crc32

import numpy as np

from msl_fem.actuator import Actuator
from msl_fem.bench.instruments import readings
from msl_fem.bench.plant import CURRENT_DRIVE, FORCE_DRIVE, VOLTAGE_DRIVE, Array
from msl_fem.bench.rig import Rig, Truth
from msl_fem.bench.running import Following, Response, follow, run_rig
from msl_fem.errors import ComputationError, InputError
from msl_fem.record import Tolerance
from msl_fem.table.magnetic_table import MagneticTable

DRIVE_WORD = {CURRENT_DRIVE: "current", VOLTAGE_DRIVE: "voltage", FORCE_DRIVE: "force"}
CLOSE_ENOUGH = 0.005
VISIBLE = 1e-7
_MOST_TRIALS = 25


@dataclass(frozen=True)
class Scales:
    """RMS values over the first run, of both sides together where there are two; `step` is that of the command."""

    position: float
    velocity: float
    current: float
    flux_linkage: float
    flux_rate: float
    voltage: float
    step: float
    copper_loss: float
    duration: float
    pull: float


@dataclass(frozen=True, eq=False)
class BenchSetting:
    """Everything that an effect's parameters are chosen by.

    Attributes
    ----------
    actuator, table, tolerance : as believed
    truth : what was drawn
    rig : the true one, without effects
    commands : (n_sample, n_column) of each run in open loop, what a run in closed loop follows
    leads : what each run's commands start from, held until the currents stand; not in closed loop
    responses : of the rig, without noise
    """

    actuator: Actuator
    table: MagneticTable | None
    tolerance: Tolerance
    truth: Truth
    rig: Rig
    commands: tuple[Array | Following, ...]
    leads: tuple[float, ...]
    responses: tuple[Response, ...]
    rate: float
    seed: int
    scales: Scales

    def generator(self, effect: str) -> np.random.Generator:
        """The random generator of an effect: always the same for a seed and an effect."""
        return np.random.default_rng([self.seed, 3, crc32(effect.encode())])

    @property
    def drive(self) -> str:
        return DRIVE_WORD[self.rig.plant.circuit.drive]


RigWithEffect = tuple[Rig, dict[str, float]]
"""The rig with an effect in it, and all parameters of the effect in SI units."""


@dataclass(frozen=True)
class BenchEffect:
    """An effect that can be hidden.

    Attributes
    ----------
    name : of RECORDS' catalogue, or one outside it
    parameter, unit : what its strength is
    hide : the rig with the effect at a strength above 0
    start : a strength that makes an effect of some per cent
    largest : the largest strength that makes sense
    least : the strength that is six tolerances of the believed parameter with which the effect coincides; None: none
    needs_magnets : whether a rig that an external force drives cannot have it
    """

    name: str
    parameter: str
    unit: str
    hide: Callable[[BenchSetting, Rig, float], RigWithEffect]
    start: Callable[[BenchSetting], float]
    largest: Callable[[BenchSetting], float]
    least: Callable[[BenchSetting], float] | None = None
    needs_magnets: bool = False


def lag_to_start_with(setting: BenchSetting) -> float:
    """s: a lag of the command of some per cent; a current drive's voltages show less than a voltage drive's motion."""
    return (0.1 if setting.drive == "current" else 0.3) / setting.rate


def runs_of(
    rig: Rig, commands: tuple[Array | Following, ...], leads: tuple[float, ...], *, rate: float
) -> tuple[Response, ...]:
    """The rig's runs of all commands, each after its lead-in, or in closed loop; raises as `run_rig` and `follow`."""
    responses = []
    for n, (asked, lead) in enumerate(zip(commands, leads, strict=True)):
        if isinstance(asked, Following):
            responses.append(follow(rig, asked, rate=rate, seed=n))
        else:
            responses.append(run_rig(rig, asked, rate=rate, lead_in=lead, seed=n))
    return tuple(responses)


def scales_of(response: Response, rig: Rig) -> Scales:
    """The scales of a run."""

    def rms(values: Array) -> float:
        return float(np.sqrt(np.mean(values**2))) if values.size else 0.0

    magnets = rig.plant.magnets
    pull = 0.0
    if rig.table is not None and response.current.size:
        gap = np.clip(magnets.nominal_gap, rig.table.gap[0], rig.table.gap[-1])
        largest = rig.table.current[-1]
        inside = np.clip(magnets.share * response.current[::20, 0], -largest, largest)
        pull = rms(magnets.per_side * rig.table.force(inside, gap))
    return Scales(
        position=rms(response.position),
        velocity=rms(response.velocity),
        current=rms(response.current),
        flux_linkage=rms(response.flux_linkage),
        flux_rate=rms(np.diff(response.flux_linkage, axis=0) * response.rate),
        voltage=rms(response.voltage),
        step=rms(np.diff(response.command, axis=0)),
        copper_loss=rig.plant.circuit.resistance * rms(response.current) ** 2,
        duration=response.command.shape[0] / response.rate,
        pull=pull,
    )


@dataclass(frozen=True, eq=False)
class EffectAtSize:
    """An effect at the strength found.

    Attributes
    ----------
    size : as defined; `channels` the ratio of every channel
    parameters : of the effect, SI units
    """

    effect: BenchEffect
    strength: float
    size: float
    channels: dict[str, float]
    parameters: dict[str, float]

    def to_json(self) -> dict[str, Any]:
        """What the answer file says of it."""
        return {
            "effect": self.effect.name,
            "size": self.size,
            "parameters": self.parameters,
            "size_by_channel": self.channels,
        }


def channels(rig: Rig, responses: Sequence[Response]) -> dict[str, Array]:
    """The readings of all runs of a record behind one another, (n_sample,) each."""
    runs = [readings(rig, response, run=n) for n, response in enumerate(responses)]
    return {name: np.concatenate([columns[name] for columns in runs]) for name in runs[0]}


def changes(changed: dict[str, Array], plain: dict[str, Array]) -> dict[str, float]:
    """RMS change over RMS of every channel; 0 for a channel that is nought in both."""
    ratios = {}
    for name, values in plain.items():
        whole = float(np.sqrt(np.mean(values**2)))
        change = float(np.sqrt(np.mean((changed[name] - values) ** 2)))
        if whole > 0:
            ratios[name] = change / whole
        else:
            ratios[name] = math.inf if change > 0 else 0.0
    return ratios


@dataclass(frozen=True, eq=False)
class _Trials:
    """Sizes by strength, without and with the effect."""

    setting: BenchSetting
    effect: BenchEffect
    plain: dict[str, Array]

    def __call__(self, strength: float) -> dict[str, float] | None:
        """Changes of the channels; None where the runs leave the range."""
        try:
            rig, _ = self.effect.hide(self.setting, self.setting.rig, strength)
            responses = runs_of(rig, self.setting.commands, self.setting.leads, rate=self.setting.rate)
        except ComputationError:
            return None
        return changes(channels(rig, responses), self.plain)


def effect_of_size(setting: BenchSetting, effect: BenchEffect, size: float, *, exact: bool = False) -> EffectAtSize:
    """The effect at the strength that has the size (0.03: three per cent) within half a per cent of it.

    An effect that coincides with a believed parameter is made at least six of its tolerances large, unless `exact`.

    Raises
    ------
    InputError : the effect cannot be seen in this drive, or its largest strength is too small
    """
    if effect.needs_magnets and setting.drive == "force":
        raise InputError(f"{effect.name}: not visible here, the rig has no magnets; hide a mechanical effect")
    trials = _Trials(setting, effect, channels(setting.rig, setting.responses))
    strength, ratios = _search(trials, size)
    if effect.least is not None and not exact:
        least = effect.least(setting)
        if least > strength:
            at_least = trials(least)
            if at_least is None:
                raise InputError(
                    f"{effect.name}: six tolerances of the believed parameter take the mover out of its range; lower "
                    "the excitation, or hide the size as asked (--exact-size)"
                )
            strength, ratios = least, at_least
    _, parameters = effect.hide(setting, setting.rig, strength)
    return EffectAtSize(effect, strength, max(ratios.values()), ratios, parameters)


@dataclass(frozen=True)
class _Point:
    """A strength that was tried, and its size; inf where the runs left the range."""

    strength: float
    size: float


def _search(trials: _Trials, size: float) -> tuple[float, dict[str, float]]:
    """Strength and changes at a size, found between a point that is too small and one that is too large."""
    largest = trials.effect.largest(trials.setting)
    below: list[_Point] = []
    above: list[_Point] = []
    strength = min(trials.effect.start(trials.setting), largest)
    for _ in range(_MOST_TRIALS):
        ratios = trials(strength)
        reached = math.inf if ratios is None else max(ratios.values())
        if ratios is not None and abs(reached / size - 1) <= CLOSE_ENOUGH:
            return strength, ratios
        if reached < size:
            below.append(_Point(strength, reached))
        else:
            above.append(_Point(strength, reached))
        ended = reached < size and strength >= largest
        if ended or (below and above and above[-1].strength < below[-1].strength * (1 + 1e-4)):
            break
        strength = min(_next(below, above, size, largest), largest)
    raise InputError(_too_small(trials, max((point.size for point in below), default=0.0), size))


def _next(below: list[_Point], above: list[_Point], size: float, largest: float) -> float:
    """The strength to try next: on the power law through the last points, or half way where that does not help."""
    if not below:
        last = above[-1]
        return last.strength / 4 if math.isinf(last.size) else last.strength * max(size / last.size, 0.02)
    low = below[-1]
    if low.size < VISIBLE:
        return math.sqrt(low.strength * above[-1].strength) if above else largest
    if not above:
        order = _order(below[-2], low) if len(below) > 1 else 1.0
        return low.strength * min((size / low.size) ** (1 / order), 50.0)
    high = above[-1]
    half = math.sqrt(low.strength * high.strength)
    if math.isinf(high.size) or len(below) + len(above) > 12:
        return half
    guess = low.strength * (size / low.size) ** (1 / _order(low, high))
    return guess if low.strength < guess < high.strength else half


def _order(a: _Point, b: _Point) -> float:
    """The power of the strength with which the size goes between two points."""
    if b.strength == a.strength or b.size <= a.size:
        return 1.0
    return min(max(math.log(b.size / a.size) / math.log(b.strength / a.strength), 0.3), 3.0)


def _too_small(trials: _Trials, largest: float, size: float) -> str:
    name, drive = trials.effect.name, trials.setting.drive
    if largest < VISIBLE:
        return (
            f"{name}: not visible in this {drive} drive with this excitation; hide another effect, or change the "
            "drive or the excitation"
        )
    return (
        f"{name}: a size of {100 * size:.3g} % cannot be reached in this {drive} drive with this excitation; at most "
        f"{100 * largest:.3g} % can, ask for less or excite more"
    )
