"""Runs over stretches cut into segments of several, which are advanced at the same time.

A stretch begins from a start of its own; from the one before it has what else a state holds. Where all of that settles
within a time that is short against a run (lags of drive and sensor, commands that wait), a segment begins so much
earlier that it has settled: first what commands alone move, then, from a start that none of it has moved, what follows
mover and coils. Heat, eddy currents, the memory of iron, second masses and a flexure's relaxation, which
act on the mover that moves them or last long, do not settle so: such runs stay in one piece.

A stop of friction forgets where it was as the mover goes on by twice its width (Brokate and Sprekels, Hysteresis and
Phase Transitions, 1996, ch. 2). It acts on that mover, so what is left of it fades from stretch to stretch; whether the
mover went so far is looked at behind the run, which else is made in one piece.
"""

from collections.abc import Sequence
from dataclasses import astuple, dataclass
from functools import lru_cache, partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from msl_fem.computing.arrays import Array
from msl_fem.computing.lanes import LANES
from msl_fem.computing.threads import in_threads
from msl_fem.plant.effects import electrical, expressions, magnetic, mechanical, sensing, thermal
from msl_fem.plant.effects.magnetic import N_EDDY
from msl_fem.plant.effects.mechanisms import N_IRON_STOP, N_STOP
from msl_fem.plant.excitation import Inputs
from msl_fem.plant.lane_block import FEW, Lanes, Parts
from msl_fem.plant.layout import OUT_X
from msl_fem.plant.plant import CURRENT_DRIVE, PlantParameters

SETTLED = 40.0
"""Time constants in which what a lag has kept is gone, to the last bit."""
WORTH, WORTH_OF_FEW = 1.25, 3.0
"""Times that a run must be longer than the longest of its segments, to be cut, of lanes of which eight would fill a
block together, and of such as are faster one by one."""
_LASTING = [
    electrical.HEAT_PER_JOULE,
    electrical.HEAT_START,
    thermal.RISE_1,
    thermal.RISE_2,
    thermal.CORE_RISE,
    magnetic.EDDY,
    *range(magnetic.EDDY_MODE, magnetic.EDDY_MODE + N_EDDY),
    *range(magnetic.HYSTERESIS_SLOPE, magnetic.HYSTERESIS_SLOPE + N_IRON_STOP),
    mechanical.MODE_STIFFNESS,
    mechanical.CREEP_STIFFNESS,
    mechanical.SLOW_CREEP_STIFFNESS,
    mechanical.COMPLIANCE,
    sensing.FORCE_COSINE,
    sensing.FORCE_SINE,
    sensing.THIRD_COSINE,
    sensing.THIRD_SINE,
    expressions.LAWS,
]
"""Coefficients of what does not settle."""
TRAVELS = 4
"""Stretches in which the mover has to go far enough for the stops of friction to have forgotten where they began."""


@dataclass(frozen=True)
class Segment:
    """Samples from and to that a segment tells, and the stretch with which it begins to settle."""

    begin: int
    end: int
    stretch: int


@dataclass(frozen=True)
class Settling:
    """Samples in which what a state keeps over a start has settled: of what commands alone move, and of what follows
    mover and coils; infinite where something does not. And how far (m) the mover has to go for friction to settle."""

    of_commands: float
    of_motion: float
    of_friction: float = 0.0


def lasts(e: Array | None) -> bool:
    """Whether something of a state with effects of these coefficients (N_COEFFICIENT,) outlives a start."""
    return e is not None and (bool(np.any(e[_LASTING] != 0.0)) or _reach(e) > 0.0)


def _reach(e: Array) -> float:
    """How far (m) a mover goes until the widest stop of its friction has forgotten where it was."""
    slopes, widths = (e[first : first + N_STOP] for first in (mechanical.FRICTION_SLOPE, mechanical.FRICTION_WIDTH))
    return 2.0 * float(np.max(widths, where=slopes != 0.0, initial=0.0))


def settling_of(p: PlantParameters, e: Array | None, *, crossed: float, step: float, n_step: int) -> Settling:
    """That of a plant by the coefficients (N_COEFFICIENT,) of its effects for n_step steps of `step` seconds a sample.
    A slew limit may have to follow commands over all that is `crossed` by them and by what holds a start's currents."""
    sample, bandwidth, sensor, late = n_step * step, p.bandwidth, p.sensor_bandwidth, 0.0
    lag = slew = reach = 0.0
    if e is not None:
        if np.any(e[_LASTING] != 0.0):
            return Settling(np.inf, np.inf)
        reach = _reach(e)
        bandwidth = e[electrical.BANDWIDTH]
        sensor = min(e[sensing.SENSOR_BANDWIDTH], e[sensing.COIL_READING_RATE])
        late = e[electrical.DELAY_SAMPLES] + e[electrical.JUMP_STEP] + e[electrical.JUMP_SHARE]
        slew, decay = e[electrical.SLEW_TIME], e[electrical.DECAY]
        if decay > 0.0:
            lag, slew = step / decay, e[electrical.SOFT] * step / decay
    driven = SETTLED * (lag + (0.0 if p.drive == CURRENT_DRIVE else 1.0 / bandwidth)) + slew * crossed
    waits = 0.0 if e is None or late == 0.0 else e[electrical.DELAY_SAMPLES] + 2.0
    return Settling(float(driven / sample + waits), float(SETTLED / sensor / sample), reach)


def segments_of(
    begins: NDArray[np.int64], n_sample: int, count: int, settling: Settling, *, worth: float = WORTH,
    goes: Array | float = 0.0,
) -> list[Segment]:  # fmt: skip
    """At most `count` segments of about equal length; one where that is not worth it. In each stretch the mover is to
    go about as far as `goes` (n_stretch,), m."""
    whole = [Segment(0, n_sample, 0)]
    if count < 2 or begins.size < 2 * count or not np.isfinite(settling.of_commands + settling.of_motion):
        return whole
    firsts = np.unique(np.searchsorted(begins, np.linspace(0, n_sample, count, endpoint=False)))
    edges, settles = [*begins[firsts], n_sample], firsts
    if settling.of_friction > 0.0:
        enough = np.concatenate([[0], np.cumsum(goes > 2.0 * settling.of_friction + np.zeros(begins.size))])
        settles = np.searchsorted(enough, enough[firsts] - TRAVELS, side="right") - 1
        settles = np.maximum(settles, 0)  # where it begins a run is as it is
    for samples in (settling.of_motion, settling.of_commands):
        settles = np.maximum(np.searchsorted(begins, begins[settles] - np.ceil(samples), side="right") - 1, 0)
    made = [Segment(int(a), int(b), int(s)) for a, b, s in zip(edges[:-1], edges[1:], settles, strict=True)]
    longest = max(one.end - begins[one.stretch] for one in made)
    return whole if worth * longest > n_sample else made


def segments_for(lanes: Lanes, which: NDArray[np.intp]) -> list[Segment]:
    """Those in which so few lanes are run that vectors and threads would have nothing to do; one where lanes may not be
    cut."""
    settings, begins = lanes.settings, lanes.settings.begins
    count = LANES * settings.threads // which.size
    whole = count < 2 or not settings.in_segments or settings.own_inputs
    if whole or begins is None:
        return [Segment(0, lanes.n_sample, 0)]
    timing = partial(settling_of, step=lanes.step, n_step=lanes.substeps)
    of = []
    for lane in which:
        p, effects = lanes.plants[lane], lanes.begun[lane][1]
        held = settings.starts_of(lane)[:, :2] * (1.0 if p.drive == CURRENT_DRIVE else p.resistance)
        crossed = np.ptp([held.min(), held.max(), *lanes.inputs.span])
        of.append(timing(p, effects, crossed=float(crossed)))
    longest = Settling(*(max(values) for values in zip(*map(astuple, of), strict=True)))
    worth = WORTH if which.size > FEW else WORTH_OF_FEW
    goes: Array | float = 0.0
    if longest.of_friction > 0.0:
        positions = np.array([settings.starts_of(lane)[:, 2] for lane in which])
        goes = np.abs(np.diff(positions, axis=1, append=positions[:, -1:])).min(axis=0)
    return segments_of(begins, lanes.n_sample, count, longest, worth=worth, goes=goes)


def run_segments(lanes: Lanes, which: NDArray[np.intp], segments: Sequence[Segment]) -> Array | None:
    """(n_column, n_lane, n_sample) of lanes that are each run in segments; None where friction has not settled."""
    begins = _begins(lanes)
    firsts = [int(begins[one.stretch]) for one in segments]
    found = np.empty((lanes.columns.size, which.size, lanes.n_sample))
    reach = max(0.0 if e is None else _reach(e) for _, e in (lanes.begun[lane] for lane in which))

    def run(units: Sequence[tuple[int, int]]) -> bool:
        filled = [units[min(k, len(units) - 1)] for k in range(LANES)]  # the last one fills up
        own = [int(which[n]) for n, _ in filled]
        begun = [lanes.begun_at(lane, lanes.settings.starts_of(lane)[segments[m].stretch])
                 for lane, (_, m) in zip(own, filled, strict=True)]  # fmt: skip
        shares = _shares(lanes.inputs, lanes.sides, begins.tobytes(), tuple(segments), tuple(m for _, m in filled))
        block = lanes.block(own, begun, shares.commands, shares.pushes, _parts(lanes, own, shares))
        for k, (n, m) in enumerate(units):
            one = segments[m]
            found[:, n, one.begin : one.end] = block[:, k, one.begin - firsts[m] : one.end - firsts[m]]
        return reach == 0.0 or all(settled(block[x, k], segments[m]) for k, (_, m) in enumerate(units))

    def settled(position: Array, one: Segment) -> bool:
        """Whether the mover has gone far enough before a segment, in enough stretches."""
        edges = begins[one.stretch : np.searchsorted(begins, one.begin)] - begins[one.stretch]
        way = position[: one.begin - begins[one.stretch]]
        if one.stretch == 0:
            return True
        least, most = np.minimum.reduceat(way, edges), np.maximum.reduceat(way, edges)
        return int(np.count_nonzero(most - least >= reach)) >= TRAVELS

    x = int(np.searchsorted(lanes.columns, OUT_X))
    units = [(n, m) for m in range(len(segments)) for n in range(which.size)]
    done = in_threads(run, [units[at : at + LANES] for at in range(0, len(units), LANES)], lanes.settings.threads)
    return found if all(done) else None


def _begins(lanes: Lanes) -> NDArray[np.int64]:
    assert lanes.settings.begins is not None
    return lanes.settings.begins


class _Shares(NamedTuple):
    """What eight lanes, each a segment, are given: commands (n + 1, 2, LANES), as they may rise behind a sample to the
    next, pushes (n + 1, LANES), the edges (n_edge,) of stretches in one of them at least and their end, which lanes
    begin another there (n_edge, LANES), which stretch of the run each is in (n_edge, LANES), and samples since its last
    edge (n_edge, LANES)."""

    commands: Array
    pushes: Array
    samples: NDArray[np.int64]
    begins: NDArray[np.bool_]
    stretch: NDArray[np.intp]
    lengths: NDArray[np.int64]


@lru_cache(maxsize=8)
def _shares(
    inputs: Inputs, sides: int, begins: bytes, segments: tuple[Segment, ...], which: tuple[int, ...]
) -> _Shares:
    """Those of some segments of a run; the same in all simulations of it until it is cut anew."""
    every = np.frombuffer(begins, dtype=np.int64)
    commands, pushes = inputs.for_sides(sides), np.asarray(inputs.disturbance)
    length = max(one.end - int(every[one.stretch]) for one in segments)
    asked, pushed = np.empty((length + 1, 2, LANES)), np.empty((length + 1, LANES))
    own = []
    for k, one in enumerate(segments[m] for m in which):
        first = int(every[one.stretch])
        here = len(commands[first : first + length + 1])
        asked[:here, :, k], pushed[:here, k] = commands[first : first + here], pushes[first : first + here]
        asked[here:, :, k], pushed[here:, k] = commands[-1], pushes[-1]  # behind its end a lane may go anywhere
        own.append(every[one.stretch : np.searchsorted(every, one.end)] - first)
    edges = np.unique(np.concatenate(own))
    begun, stretch = np.empty((edges.size, LANES), dtype=bool), np.empty((edges.size, LANES), dtype=np.intp)
    lengths = np.zeros((edges.size, LANES), dtype=np.int64)
    for k, at in enumerate(own):
        begun[:, k] = np.isin(edges, at)
        lengths[begun[:, k], k] = np.diff(at, prepend=0)
        stretch[:, k] = segments[which[k]].stretch + np.cumsum(begun[:, k]) - 1
    return _Shares(asked, pushed, np.column_stack([edges, [*edges[1:], length]]), begun, stretch, lengths)


def _parts(lanes: Lanes, own: Sequence[int], shares: _Shares) -> Parts:
    """Where the lanes of a block, each a segment of a run, are put to another start."""
    starts = np.empty((len(shares.samples), 4, LANES))
    for k, lane in enumerate(own):
        starts[:, :, k] = lanes.settings.starts_of(lane)[shares.stretch[:, k]]
    lengths = np.asarray(shares.lengths * lanes.substeps * lanes.step, dtype=float)
    return Parts(shares.samples, shares.begins, starts, lengths)
