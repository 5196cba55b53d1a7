"""Many runs of one plant with different parameters, advanced together: for derivatives with respect to parameters.

Eight runs are the lanes of one vector (`lanes.py`). Each has its own plant parameters, effects, start and, if wanted,
its own coenergy surface and additions to the inputs; step and the plant's build (drive, sides, magnets) are the same
for all. What a lane gives is what `kernel.run` gives alone, to the last bit; in segments (`segments.py`) to the last
digits.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from msl_fem.computing.arrays import Array
from msl_fem.computing.lanes import LANES
from msl_fem.computing.threads import in_threads
from msl_fem.errors import InputError
from msl_fem.plant.effects import PARAMETER_INDEX, ByName, neutral_vector
from msl_fem.plant.effects.mechanisms import position_delay
from msl_fem.plant.excitation import Inputs
from msl_fem.plant.instruments import Channels, currents_before_noise, is_faithful, position_before_noise
from msl_fem.plant.lane_block import FEW, Lanes, LaneSettings, Parts, numbers_of
from msl_fem.plant.layout import (
    N_OUT,
    OUT_FLUX_1,
    OUT_I1,
    OUT_SENSOR,
    OUT_SENSOR_SLOPE,
    OUT_SLOPE_AFTER_1,
    OUT_SLOPE_BEFORE_1,
    OUT_V,
    OUT_VOLTAGE_1,
    OUT_X,
)
from msl_fem.plant.plant import PlantParameters, Surface
from msl_fem.plant.segments import run_segments, segments_for

_READINGS = {
    "position": (OUT_SENSOR, 0),
    "velocity": (OUT_V, None),
    "current": (OUT_I1, 1),
    "voltage": (OUT_VOLTAGE_1, None),
}
"""Of each quantity the kernel's first column and which instrument reads it first."""


@dataclass(frozen=True, eq=False)
class LaneRun:
    """The readings of all lanes before noise, nan from where a lane left its table or range; each is put together when
    it is first asked for.

    Attributes
    ----------
    blocks : of eight different lanes each, (n_column, LANES, n_sample); the last ones may be of one each
    columns : (n_column,) which of the kernel's columns they are, in ascending order
    place : (n_lane,) where each lane stands in the blocks, LANES times the block and the lane there
    effects : (n_lane, n_parameter), or (n_parameter,) neutral ones of all
    position : (n_lane, n_sample) m, as the sensor reads it
    current, voltage, flux_linkage : (n_lane, n_sample, n_side) A, V, Wb; voltages are means until the next sample
    true_position, velocity : (n_lane, n_sample) m, m/s
    done : (n_lane,) whole samples
    """

    blocks: tuple[Array, ...]
    columns: NDArray[np.intp]
    place: NDArray[np.intp]
    effects: Array
    sides: int
    rate: float

    def only(self, lanes: slice) -> "LaneRun":
        """Some of the lanes, of the same blocks."""
        effects = self.effects if self.effects.ndim == 1 else self.effects[lanes]
        return replace(self, place=self.place[lanes], effects=effects)

    def rows(self, lane: int) -> Array:
        """(n_sample, n_column) of a lane as the kernel wrote them."""
        block, own = divmod(int(self.place[lane]), LANES)
        return self.blocks[block][:, own].T

    @cached_property
    def position(self) -> Array:
        slope = self._of_lanes(OUT_SENSOR_SLOPE) if self._late else self._nothing(1)[..., 0]
        channels = Channels(self._of_lanes(OUT_SENSOR), slope, *(self._nothing(self.sides) for _ in range(3)))
        return position_before_noise(channels, self.effects, rate=self.rate)

    @cached_property
    def current(self) -> Array:
        slopes = [self._nothing(self.sides)] * 2
        if self._late:
            slopes = [self._of_sides(OUT_SLOPE_AFTER_1), self._of_sides(OUT_SLOPE_BEFORE_1)]
        sensor = self._nothing(1)[..., 0]
        channels = Channels(sensor, sensor, self._of_sides(OUT_I1), *slopes)
        return currents_before_noise(channels, self.effects, rate=self.rate)

    @cached_property
    def voltage(self) -> Array:
        return self._of_sides(OUT_VOLTAGE_1, max(self.sides, 1))

    @cached_property
    def flux_linkage(self) -> Array:
        return self._of_sides(OUT_FLUX_1)

    @cached_property
    def true_position(self) -> Array:
        return self._of_lanes(OUT_X)

    @cached_property
    def velocity(self) -> Array:
        return self._of_lanes(OUT_V)

    def as_read(self, quantity: str, side: int = 0) -> Sequence[Array]:
        """(n_sample,) of each lane: "position", "velocity", or a side's "current" or "voltage"; where the instruments
        add nothing, what the kernel wrote, not to be changed."""
        column, instrument = _READINGS[quantity][0] + side, _READINGS[quantity][1]
        if instrument is None or is_faithful(self.effects, instrument + side, rate=self.rate):
            at = int(np.searchsorted(self.columns, column))
            each = (divmod(int(place), LANES) for place in self.place)
            return [self.blocks[block][at, own] for block, own in each]
        return list(self.position if quantity == "position" else self.current[..., side])

    @cached_property
    def done(self) -> NDArray[np.int64]:
        good: NDArray[np.bool_] = ~np.isnan(self.true_position + self.voltage[..., 0])
        return np.where(np.all(good, axis=1), good.shape[1], np.argmin(good, axis=1))

    @property
    def n_lane(self) -> int:
        return self.place.size

    @property
    def _late(self) -> bool:
        return _is_late(self.effects)

    def _nothing(self, columns: int) -> Array:
        return np.broadcast_to(0.0, (self.n_lane, self.blocks[0].shape[2], columns))

    def _of_lanes(self, n: int) -> Array:
        return self._of_sides(n, 1)[..., 0]

    def _of_sides(self, n: int, columns: int | None = None) -> Array:
        """Columns from n of the kernel's rows, (n_lane, n_sample, columns)."""
        count = self.sides if columns is None else columns
        at = np.searchsorted(self.columns, np.arange(n, n + count))
        found = np.empty((count, self.n_lane, self.blocks[0].shape[2]))
        for k, block in enumerate(self.blocks):
            own = np.flatnonzero(self.place // LANES == k)
            for j in range(count):
                found[j, own] = block[at[j], self.place[own] % LANES]
        return np.moveaxis(found, 0, -1)


def _is_late(effects: Array) -> bool:
    """Whether a reading is delayed: nothing else looks at slopes."""
    values = ByName(effects)
    return bool(np.any(position_delay(values)) or np.any(values["time_delay", "current"]))


def _columns(quantities: frozenset[str] | None, sides: int, *, late: bool) -> NDArray[np.intp]:
    """The kernel's columns of which these quantities are made, in ascending order, the position among them."""
    if quantities is None:
        return np.arange(N_OUT)
    each = range(max(sides, 1))
    columns = {
        "position": [OUT_SENSOR, *([OUT_SENSOR_SLOPE] if late else [])],
        "velocity": [OUT_V],
        "voltage": [OUT_VOLTAGE_1 + j for j in each],
        "current": [OUT_I1 + j for j in each],
    }
    if late:
        columns["current"] += [first + j for first in (OUT_SLOPE_AFTER_1, OUT_SLOPE_BEFORE_1) for j in each]
    return np.array(sorted({OUT_X}.union(*(columns[name] for name in quantities))))


def run_lanes(
    surface: Surface,
    plants: Sequence[PlantParameters],
    inputs: Inputs,
    *,
    substeps: int,
    settings: LaneSettings | None = None,
) -> LaneRun:
    """The runs of all plants under the same inputs, `substeps` Runge-Kutta steps a sample.

    Lanes that differ in what instruments read alone are run once. A lane whose mover meets an end stop is run again
    alone.

    Raises
    ------
    InputError : the plants differ in their build, or settings do not fit them
    """
    settings = settings or LaneSettings()
    _check(surface, plants, inputs, settings)
    sides = plants[0].sides
    effects = neutral_vector() if settings.effects is None else settings.effects
    columns = _columns(settings.quantities, sides, late=_is_late(effects))
    lanes = Lanes(surface, plants, inputs, substeps, settings, columns)
    different, place = _different(lanes)
    groups, blocks = _in_segments(lanes, different)
    if not blocks:
        groups = _groups(different)
        blocks = in_threads(lambda group: _block_of(lanes, group), groups, settings.threads)
    for group, block in zip(groups, blocks, strict=True):
        for column, lane in enumerate(group):
            x = block[np.searchsorted(columns, OUT_X), column]
            if plants[lane].end_stop is not None and np.isnan(x).any():
                block[:, column] = lanes.alone(int(lane)).T[columns]
    stands = np.concatenate([LANES * k + np.arange(group.size) for k, group in enumerate(groups)])
    return LaneRun(tuple(blocks), columns, stands[place], effects, sides, inputs.rate)


def _in_segments(lanes: Lanes, different: NDArray[np.intp]) -> tuple[list[NDArray[np.intp]], list[Array]]:
    """(lanes that are together in a block, their blocks) of runs that are made in segments; none where they are not."""
    segments = segments_for(lanes, different)
    if len(segments) == 1:
        return [], []
    groups = [different[n : n + LANES] for n in range(0, different.size, LANES)]
    found = [run_segments(lanes, group, segments) for group in groups]
    blocks = [block for block in found if block is not None]
    return (groups, blocks) if len(blocks) == len(groups) else ([], [])


def _block_of(lanes: Lanes, group: NDArray[np.intp]) -> Array:
    """(n_column, at most LANES, n_sample) of a group of lanes."""
    settings = lanes.settings
    if group.size == 1:
        rows = lanes.alone(int(group[0]))
        if settings.begins is None or np.isfinite(rows[:, OUT_X]).all():  # else time has stood still in it
            return rows.T[lanes.columns][:, None]
    own = [int(group[min(k, group.size - 1)]) for k in range(LANES)]  # the last one fills up
    samples = settings.stretches(lanes.n_sample)
    lengths = np.diff(samples[:, 0], prepend=0) * lanes.substeps * lanes.step
    starts = np.array([settings.starts_of(lane) for lane in own]).transpose(1, 2, 0)
    every = np.ones((len(samples), LANES), dtype=bool)
    parts = Parts(samples, every, np.ascontiguousarray(starts), np.repeat(lengths[:, None], LANES, axis=1))
    return lanes.block(own, [lanes.begun[lane] for lane in own], *_inputs_of_block(lanes, own), parts)


def _groups(lanes: NDArray[np.intp]) -> list[NDArray[np.intp]]:
    """Lanes that are run together, eight each; of those left over a `FEW` one by one."""
    over = lanes.size % LANES
    together = lanes.size - (over if over <= FEW else 0)
    return [*(lanes[n : n + LANES] for n in range(0, together, LANES)), *lanes[together:, None]]


def _inputs_of_block(lanes: Lanes, own: Sequence[int]) -> tuple[Array, Array]:
    """Commands (n_sample, 2) and disturbance (n_sample,) of all lanes, or with an axis (LANES,) more those of each."""
    inputs = lanes.inputs
    if not lanes.settings.own_inputs:
        return inputs.for_sides(lanes.sides), np.asarray(inputs.disturbance)
    each = [lanes.settings.inputs_of(inputs, lane) for lane in own]
    commands, pushes = ([one.for_sides(lanes.sides) for one in each], [np.asarray(one.disturbance) for one in each])
    return np.stack(commands, axis=-1), np.stack(pushes, axis=-1)


def told_apart(
    surface: Surface,
    plants: Sequence[PlantParameters],
    *,
    rate: float,
    substeps: int,
    settings: LaneSettings,
) -> NDArray[np.intp]:
    """(n_lane,) the number of the run that `run_lanes` makes for each lane; one serves all that it sees as alike."""
    return _different(Lanes(surface, plants, Inputs(np.zeros((1, 2)), rate), substeps, settings))[1]


def _different(lanes: Lanes) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """(the lanes that the kernel sees as different, which of them each lane is)."""
    settings = lanes.settings
    seen: dict[tuple[bytes, ...], int] = {}
    first: list[int] = []
    place = []
    for lane, (plant, (state, effects)) in enumerate(zip(lanes.plants, lanes.begun, strict=True)):
        index = 0 if settings.surface_index is None else int(settings.surface_index[lane])
        later = settings.starts[lane] if settings.begins is not None else state
        parts = (np.array(numbers_of(plant)), state, later, np.array([]) if effects is None else effects)
        own = lane if settings.own_inputs else None
        key = (*(part.tobytes() for part in parts), str((index, plant.end_stop, own)).encode())
        if key not in seen:
            seen[key] = len(first)
            first.append(lane)
        place.append(seen[key])
    return np.array(first, dtype=np.intp), np.array(place, dtype=np.intp)


def _check(surface: Surface, plants: Sequence[PlantParameters], inputs: Inputs, settings: LaneSettings) -> None:
    builds = {(p.sides, p.magnets, p.drive, np.isinf(p.bandwidth), np.isinf(p.sensor_bandwidth)) for p in plants}
    if len(builds) != 1:
        raise InputError(
            f"the lanes' plants differ in sides, magnets, drive or in which bandwidths they have: {sorted(builds)}; "
            "run those that are alike together"
        )
    n_surface = 1 if surface.coefficients.ndim == 4 else surface.coefficients.shape[0]
    shapes = {
        "effects": (settings.effects, (len(plants), len(PARAMETER_INDEX))),
        "surface_index": (settings.surface_index, (len(plants),)),
        "more": (settings.more, (len(plants), *inputs.commands.shape)),
        "pushes": (settings.pushes, (len(plants), inputs.commands.shape[0])),
        "starts": (settings.starts if settings.starts.ndim > 1 else None, _shape_of_starts(len(plants), settings)),
    }
    for name, (given, shape) in shapes.items():
        if given is not None and given.shape != shape:
            raise InputError(f"{name} has the shape {given.shape}; {len(plants)} lanes need {shape}")
    index = settings.surface_index
    if index is not None and (index.min() < 0 or index.max() >= n_surface):
        raise InputError(f"surface_index goes from {index.min()} to {index.max()}; there are {n_surface} surfaces")


def _shape_of_starts(n_lane: int, settings: LaneSettings) -> tuple[int, ...]:
    return (n_lane, 4) if settings.begins is None else (n_lane, settings.begins.size, 4)
