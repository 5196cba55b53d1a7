"""Many runs of one plant with different parameters, advanced together: for derivatives with respect to parameters.

Eight runs are the lanes of one vector (`lanes.py`). Each has its own plant parameters, effects, start and, if wanted,
its own coenergy surface and additions to the inputs; step and the plant's build (drive, sides, magnets) are the same
for all. What a lane gives is what `kernel.run` gives alone, to the last bit.
"""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from msl_fem.computing.arrays import Array
from msl_fem.computing.compiled import compiled
from msl_fem.computing.lanes import LANES, keep, rows_of
from msl_fem.errors import InputError
from msl_fem.plant import kernel
from msl_fem.plant.effects import PARAMETER_INDEX, kernel_coefficients, neutral_vector
from msl_fem.plant.effects.mechanisms import position_delay
from msl_fem.plant.excitation import Inputs
from msl_fem.plant.instruments import Channels, currents_before_noise, position_before_noise
from msl_fem.plant.layout import (
    BLOCK_1,
    BLOCK_2,
    N_BLOCK,
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
    SURFACE_START,
    TILTED,
    initial_state,
    lane_workspace,
)
from msl_fem.plant.plant import PlantParameters, Surface
from msl_fem.plant.preparation import small_signal_inductance, start_effects
from msl_fem.plant.restart import restart
from msl_fem.plant.side import cells_of

AT_A_TIME = 512
"""Samples of eight lanes that the kernel writes before they are put where they stay: 0.6 MB."""
FEW = 2
"""Lanes that are faster one by one: eight together cost as much as two and a half to four alone."""


@dataclass(frozen=True, eq=False)
class LaneSettings:
    """What the lanes are, beside their plants.

    Attributes
    ----------
    effects : (n_lane, n_parameter) of the catalogue, or None: plain models
    starts : (n_lane, 4) or (4,) currents of the sides (A), position (m), velocity (m/s); of several stretches
        (n_lane, n_stretch, 4)
    begins : (n_stretch,) samples at which the runs are put to starts of their own, the first is 0; what else a state
        holds (heat, memory of iron and friction, what waits in a delay) goes on. None: one stretch
    surface_index : (n_lane,) which surface, where their coefficients have an axis more in front; None: the first
    more : (n_lane, n_sample, n_side) added to the commands of each lane; None: nothing
    pushes : (n_lane, n_sample) N, added to the disturbance of each lane; None: nothing
    threads : that advance blocks of eight lanes at the same time
    quantities : which of "position", "velocity", "current", "voltage" are kept; None: all that the kernel tells
    """

    effects: Array | None = None
    starts: Array = field(default_factory=lambda: np.zeros(4))
    surface_index: NDArray[np.int64] | None = None
    more: Array | None = None
    pushes: Array | None = None
    threads: int = 1
    begins: NDArray[np.int64] | None = None
    quantities: frozenset[str] | None = None

    def starts_of(self, lane: int) -> Array:
        """(n_stretch, 4) where a lane begins its stretches."""
        return np.atleast_2d(self.starts if self.starts.ndim == 1 else self.starts[lane])

    def inputs_of(self, inputs: Inputs, lane: int) -> Inputs:
        """Those of a lane."""
        if not self.own_inputs:
            return inputs
        commands = inputs.commands if self.more is None else inputs.commands + self.more[lane]
        push = inputs.disturbance if self.pushes is None else np.asarray(inputs.disturbance) + self.pushes[lane]
        return replace(inputs, commands=commands, disturbance=push)

    @property
    def own_inputs(self) -> bool:
        return self.more is not None or self.pushes is not None

    def stretches(self, n_sample: int, *, linear: bool = False) -> NDArray[np.int64]:
        """(n_stretch, 2) the samples from and to of each stretch; where commands run straight from one sample to the
        next, and the first sample behind it, which the next stretch writes anew."""
        if self.begins is None:
            return np.array([[0, n_sample]])
        return np.column_stack([self.begins, [*(self.begins[1:] + linear), n_sample]])


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
    values = {key: np.asarray(effects)[..., n] for key, n in PARAMETER_INDEX.items()}
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
    step, linear = 1.0 / (inputs.rate * substeps), inputs.hold == "linear"
    n_sample = inputs.commands.shape[0]

    begun = [_begun(surface, p, settings, lane, step, substeps) for lane, p in enumerate(plants)]
    different, place = _different(plants, settings, begun)
    groups = _groups(different)
    effects = neutral_vector() if settings.effects is None else settings.effects
    columns = _columns(settings.quantities, sides, late=_is_late(effects))
    shape = surface.coefficients.shape
    joined = surface._replace(coefficients=surface.coefficients.reshape(-1, *shape[-3:]))  # compiled once, one or many

    def block_of(group: NDArray[np.intp]) -> Array:
        if group.size == 1:
            lane = int(group[0])
            rows = _alone(surface, plants[lane], settings, lane, inputs, substeps)
            if settings.begins is None or np.isfinite(rows[:, OUT_X]).all():  # else time has stood still in it
                return rows.T[columns][:, None]
        lanes = [int(group[min(k, group.size - 1)]) for k in range(LANES)]  # the last one fills up
        block = _block(surface, plants, settings, np.array(lanes), begun)
        out = np.empty((columns.size, LANES, n_sample))
        commands, pushes = _inputs_of_block(inputs, settings, lanes, max(sides, 1))
        starts = np.ascontiguousarray(np.array([settings.starts_of(lane) for lane in lanes]).transpose(1, 2, 0))
        parts = settings.stretches(n_sample, linear=linear)
        commands = commands.reshape(-1, *commands.shape[2:])
        _run_block(joined, block, commands, pushes, step, substeps, columns, out, parts, starts, linear)
        return out

    if settings.threads > 1 and len(groups) > 1:
        with ThreadPoolExecutor(settings.threads) as pool:
            blocks = list(pool.map(block_of, groups))
    else:
        blocks = [block_of(group) for group in groups]
    for group, block in zip(groups, blocks, strict=True):
        for column, lane in enumerate(group):
            x = block[np.searchsorted(columns, OUT_X), column]
            if plants[lane].end_stop is not None and np.isnan(x).any():
                block[:, column] = _alone(surface, plants[lane], settings, int(lane), inputs, substeps).T[columns]
    stands = np.concatenate([LANES * k + np.arange(group.size) for k, group in enumerate(groups)])
    return LaneRun(tuple(blocks), columns, stands[place], effects, sides, inputs.rate)


def _groups(lanes: NDArray[np.intp]) -> list[NDArray[np.intp]]:
    """Lanes that are run together, eight each; of those left over a `FEW` one by one."""
    over = lanes.size % LANES
    together = lanes.size - (over if over <= FEW else 0)
    return [*(lanes[n : n + LANES] for n in range(0, together, LANES)), *lanes[together:, None]]


def _inputs_of_block(inputs: Inputs, settings: LaneSettings, lanes: Sequence[int], sides: int) -> tuple[Array, Array]:
    """Commands (n_sample, 2) and disturbance (n_sample,) of all lanes, or with an axis (LANES,) more those of each."""
    if not settings.own_inputs:
        return inputs.for_sides(sides), np.asarray(inputs.disturbance)
    own = [settings.inputs_of(inputs, lane) for lane in lanes]
    commands, pushes = ([one.for_sides(sides) for one in own], [np.asarray(one.disturbance) for one in own])
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
    step = 1.0 / (rate * substeps)
    begun = [_begun(surface, p, settings, lane, step, substeps) for lane, p in enumerate(plants)]
    return _different(plants, settings, begun)[1]


def _different(
    plants: Sequence[PlantParameters], settings: LaneSettings, begun: Sequence["_Begun"]
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """(the lanes that the kernel sees as different, which of them each lane is)."""
    seen: dict[tuple[bytes, ...], int] = {}
    first: list[int] = []
    place = []
    for lane, (plant, (state, effects)) in enumerate(zip(plants, begun, strict=True)):
        index = 0 if settings.surface_index is None else int(settings.surface_index[lane])
        later = settings.starts[lane] if settings.begins is not None else state
        parts = (np.array(_numbers(plant)), state, later, np.array([]) if effects is None else effects)
        own = lane if settings.own_inputs else None
        key = (*(part.tobytes() for part in parts), str((index, plant.end_stop, own)).encode())
        if key not in seen:
            seen[key] = len(first)
            first.append(lane)
        place.append(seen[key])
    return np.array(first, dtype=np.intp), np.array(place, dtype=np.intp)


class _Block(NamedTuple):
    """Eight lanes as the compiled loop takes them; what all have in common as numbers."""

    numbers: Array  # (n_number, LANES) the plants' numbers, by the rows of _ROW
    effects: Array | None  # (N_COEFFICIENT, LANES)
    state: Array  # (N_STATE, LANES)
    work: Array  # (N_WORK, LANES)
    sides: int
    magnets: int
    drive: int
    reach: float  # m, beyond which a lane ends


_ROW = PlantParameters._make(range(len(PlantParameters._fields)))


def _numbers(p: PlantParameters) -> list[float]:
    """The plant's numbers, in the order of `PlantParameters`; nan for its end stop."""
    return [np.nan if value is None or isinstance(value, tuple) else float(value) for value in p]


_Begun = tuple[Array, Array | None]
"""(state, coefficients of the effects) with which a lane begins; None without effects."""


def _block(
    surface: Surface, every: Sequence[PlantParameters], settings: LaneSettings, lanes: NDArray[np.int64],
    begins: Sequence[_Begun],
) -> _Block:  # fmt: skip
    plants, begun = [every[lane] for lane in lanes], [begins[lane] for lane in lanes]
    state = np.column_stack([one for one, _ in begun])
    columns = [e for _, e in begun if e is not None]
    effects = np.ascontiguousarray(np.column_stack(columns)) if columns else None
    work = lane_workspace()
    if settings.surface_index is not None:
        first = settings.surface_index[lanes] * surface.coefficients[0].size
        for block in (BLOCK_1, BLOCK_2, *range(TILTED, TILTED + 4 * N_BLOCK, N_BLOCK)):
            work[block + SURFACE_START] = first
    stops = [p.end_stop.position if p.end_stop else np.inf for p in plants]
    numbers = np.array([_numbers(p) for p in plants]).T
    p = plants[0]
    return _Block(
        np.ascontiguousarray(numbers),
        effects,
        np.ascontiguousarray(state),
        work,
        p.sides,
        p.magnets,
        p.drive,
        min(stops),
    )


def _begun(
    surface: Surface, plant: PlantParameters, settings: LaneSettings, lane: int, step: float, substeps: int
) -> _Begun:  # fmt: skip
    state = initial_state(plant, *map(float, settings.starts_of(lane)[0]))
    if settings.effects is None:
        return state, None
    own = _own_surface(surface, settings, lane)
    inductance = small_signal_inductance(plant, own)
    effects = kernel_coefficients(plant, settings.effects[lane], inductance=inductance, step=step, n_step=substeps)
    start_effects(own, plant, effects, state)
    return state, effects


def _own_surface(surface: Surface, settings: LaneSettings, lane: int) -> Surface:
    if surface.coefficients.ndim == 4:
        return surface
    index = 0 if settings.surface_index is None else int(settings.surface_index[lane])
    return surface._replace(coefficients=surface.coefficients[index])


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


def _alone(
    surface: Surface, plant: PlantParameters, settings: LaneSettings, lane: int, inputs: Inputs, substeps: int
) -> Array:
    """The rows of one lane by the kernel for one run, nan from where it ended."""
    own, step = _own_surface(surface, settings, lane), 1.0 / (inputs.rate * substeps)
    state, effects = _begun(surface, plant, settings, lane, step, substeps)
    inputs = settings.inputs_of(inputs, lane)
    commands = inputs.for_sides(max(plant.sides, 1))
    out = np.empty((commands.shape[0], N_OUT))
    push, linear = np.asarray(inputs.disturbance), inputs.hold == "linear"
    stretches = settings.stretches(len(out), linear=linear), settings.starts_of(lane)
    _, done = kernel.run(own, plant, effects, state, commands, push, step, substeps, out, linear, stretches)
    out[done:] = np.nan
    return out


@compiled
def _run_block(
    surface: Surface, block: _Block, commands: Array, disturbance: Array, step: float, n_sub: int,
    columns: NDArray[np.intp], out: Array, parts: NDArray[np.int64], starts: Array, linear: bool,
) -> None:  # fmt: skip
    """`kernel.run` over stretches for eight lanes, with starts (n_stretch, 4, LANES): into `out` (n_column, LANES,
    n_sample) some of the kernel's columns; a lane that cannot go on is nan from there. Commands (2 n_sample,) and
    disturbance (n_sample,) are those of all, or with an axis (LANES,) more those of each. What the kernel writes stays
    in the cache."""
    e, state, work, cells = rows_of(block.effects), rows_of(block.state), rows_of(block.work), cells_of(surface)
    own = rows_of(block.numbers)
    p = PlantParameters(
        own[_ROW.mass],
        own[_ROW.stiffness],
        own[_ROW.damping],
        own[_ROW.constant_force],
        own[_ROW.nominal_gap],
        own[_ROW.travel],
        block.sides,
        block.magnets,
        own[_ROW.current_share],
        own[_ROW.resistance],
        block.drive,
        own[_ROW.bandwidth],
        own[_ROW.voltage_limit],
        own[_ROW.current_limit],
        own[_ROW.sensor_bandwidth],
        None,
        own[_ROW.leakage_1],
        own[_ROW.leakage_2],
        own[_ROW.mutual],
        own[_ROW.input_gain_1],
        own[_ROW.input_gain_2],
        own[_ROW.input_zero_1],
        own[_ROW.input_zero_2],
        own[_ROW.polarity],
        own[_ROW.inductance],
    )
    written, before = np.empty((AT_A_TIME * N_OUT, LANES)), block.state.copy()
    asked, pushed, table, kept = rows_of(commands), rows_of(disturbance), rows_of(written), rows_of(before)
    for m in range(len(parts)):
        if m:
            length = (parts[m, 0] - parts[m - 1, 0]) * n_sub * step
            restart(cells, p, e, state, kept, rows_of(starts[m]), work, length)
            before[:] = block.state
        kernel.begin_rows(p, e, state, work, step)
        end = parts[m, 1]
        for begin in range(parts[m, 0], end, AT_A_TIME):
            upto = min(begin + AT_A_TIME, end)
            kernel.rows_between(
                None, cells, p, e, state, work, block.reach, asked, pushed, end, begin, upto, step, n_sub, table, linear
            )
            for n in range(upto - begin):
                for j in range(columns.size):
                    for k in range(LANES):
                        out[j, k, begin + n] = written[n * N_OUT + columns[j], k]
    keep(before)
    keep(starts)
    keep(written)
    keep(commands)
    keep(disturbance)
    keep(block.numbers)
    keep(block.work)
    keep(block.effects)
