"""The size of an effect, and the strength that has the size asked for.

Size is RECORDS.md's: the RMS change of the record at equal input, over that channel's RMS, the largest over position
and currents, in current drive over voltages too. Record means all its runs together, without noise, with and without
the effect at the same true parameters; RMS is the root of the mean square, constant part included.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from msl_fem.bench.plant import Array
from msl_fem.bench.readings import readings
from msl_fem.bench.rig import Rig
from msl_fem.bench.running import Response
from msl_fem.bench.setting import Effect, Setting, runs_of
from msl_fem.errors import ComputationError, InputError

CLOSE_ENOUGH = 0.005
VISIBLE = 1e-7
_MOST_TRIALS = 25


@dataclass(frozen=True, eq=False)
class Hidden:
    """An effect at the strength found.

    Attributes
    ----------
    size : as defined; `channels` the ratio of every channel
    parameters : of the effect, SI units
    """

    effect: Effect
    strength: float
    size: float
    channels: dict[str, float]
    parameters: dict[str, float]

    def report(self) -> dict[str, Any]:
        """What the answer file says of it."""
        return {
            "effect": self.effect.name,
            "size": self.size,
            "parameters": self.parameters,
            "size_by_channel": self.channels,
        }


def channels(rig: Rig, responses: Sequence[Response]) -> dict[str, Array]:
    """The readings of all runs of a record behind one another, (n_sample,) each."""
    each = [readings(rig, one, run=n) for n, one in enumerate(responses)]
    return {name: np.concatenate([one[name] for one in each]) for name in each[0]}


def changes(changed: dict[str, Array], plain: dict[str, Array]) -> dict[str, float]:
    """RMS change over RMS of every channel; 0 for a channel that is nought in both."""
    found = {}
    for name, values in plain.items():
        whole = float(np.sqrt(np.mean(values**2)))
        change = float(np.sqrt(np.mean((changed[name] - values) ** 2)))
        found[name] = change / whole if whole > 0 else (math.inf if change > 0 else 0.0)
    return found


@dataclass(frozen=True, eq=False)
class _Trials:
    """Sizes by strength, without and with the effect."""

    setting: Setting
    effect: Effect
    plain: dict[str, Array]

    def __call__(self, strength: float) -> dict[str, float] | None:
        """Changes of the channels; None where the runs leave the range."""
        try:
            rig, _ = self.effect.hide(self.setting, self.setting.rig, strength)
            responses = runs_of(rig, self.setting.commands, self.setting.leads, rate=self.setting.rate)
        except ComputationError:
            return None
        return changes(channels(rig, responses), self.plain)


def hidden_of_size(setting: Setting, effect: Effect, size: float, *, exact: bool = False) -> Hidden:
    """The effect at the strength that has the size (0.03: three per cent) within half a per cent of it.

    An effect that coincides with a believed parameter is made at least six of its tolerances large, unless `exact`.

    Raises
    ------
    InputError : the effect cannot be seen in this drive, or its largest strength is too small
    """
    if effect.needs_magnets and setting.drive == "force":
        raise InputError(f"{effect.name}: not visible here, the rig has no magnets; hide a mechanical effect")
    trials = _Trials(setting, effect, channels(setting.rig, setting.responses))
    strength, found = _search(trials, size)
    if effect.least is not None and not exact:
        least = effect.least(setting)
        if least > strength:
            at_least = trials(least)
            if at_least is None:
                raise InputError(
                    f"{effect.name}: six tolerances of the believed parameter take the mover out of its range; lower "
                    "the excitation, or hide the size as asked (--exact-size)"
                )
            strength, found = least, at_least
    _, parameters = effect.hide(setting, setting.rig, strength)
    return Hidden(effect, strength, max(found.values()), found, parameters)


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
        found = trials(strength)
        made = math.inf if found is None else max(found.values())
        if found is not None and abs(made / size - 1) <= CLOSE_ENOUGH:
            return strength, found
        (below if made < size else above).append(_Point(strength, made))
        ended = made < size and strength >= largest
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
