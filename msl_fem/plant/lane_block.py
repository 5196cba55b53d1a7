"""Eight runs of one plant with different parameters as lanes of one vector: how they begin, and the loop over them.

Each lane has its own plant parameters, effects, starts and, if wanted, its own coenergy surface and inputs; step and
the plant's build (drive, sides, magnets) are the same for all.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from msl_fem.computing.arrays import Array
from msl_fem.computing.compiled import compiled
from msl_fem.computing.lanes import LANES, keep, rows_of
from msl_fem.plant import kernel
from msl_fem.plant.effects import kernel_coefficients
from msl_fem.plant.excitation import Inputs
from msl_fem.plant.layout import (
    BLOCK_1,
    BLOCK_2,
    N_BLOCK,
    N_OUT,
    OUT_FLUX_1,
    OUT_SENSOR_SLOPE,
    OUT_SLOPE_AFTER_1,
    OUT_SLOPE_BEFORE_2,
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
LINE = 64  # bytes of the cache that are read at once, as many as eight numbers have
OF_WHOLE_ROWS = [*range(OUT_FLUX_1, OUT_SENSOR_SLOPE), *range(OUT_SLOPE_AFTER_1, OUT_SLOPE_BEFORE_2 + 1)]
"""Columns for which the kernel has to do more."""
FEW = 1
"""Lanes that are faster one by one: eight together cost as much as one to one and a half alone."""
Begun = tuple[Array, Array | None]
"""(state, coefficients of the effects) with which a lane begins; None without effects."""


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
    in_segments : whether a few lanes over many stretches may be cut (`segments.py`), so that vectors and threads have
        enough to do
    """

    effects: Array | None = None
    starts: Array = field(default_factory=lambda: np.zeros(4))
    surface_index: NDArray[np.int64] | None = None
    more: Array | None = None
    pushes: Array | None = None
    threads: int = 1
    begins: NDArray[np.int64] | None = None
    quantities: frozenset[str] | None = None
    in_segments: bool = False

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

    def stretches(self, n_sample: int) -> NDArray[np.int64]:
        """(n_stretch, 2) the samples from and to of each stretch."""
        if self.begins is None:
            return np.array([[0, n_sample]])
        return np.column_stack([self.begins, [*self.begins[1:], n_sample]])


class Parts(NamedTuple):
    """The parts of a block's way, at whose begins lanes are put to another start.

    samples (n_part, 2) from and to; begins (n_part, LANES) whether a lane is; starts (n_part, 4, LANES) where; lengths
    (n_part, LANES) s since its last start
    """

    samples: NDArray[np.int64]
    begins: NDArray[np.bool_]
    starts: Array
    lengths: Array


@dataclass(frozen=True, eq=False)
class Lanes:
    """Runs of plants under inputs, `substeps` steps a sample, of which the kernel's `columns` are kept.

    Raises
    ------
    InputError : an effect beyond what the kernel takes
    """

    surface: Surface
    plants: Sequence[PlantParameters]
    inputs: Inputs
    substeps: int
    settings: LaneSettings
    columns: NDArray[np.intp] = field(default_factory=lambda: np.arange(N_OUT))

    @property
    def step(self) -> float:
        return 1.0 / (self.inputs.rate * self.substeps)

    @property
    def n_sample(self) -> int:
        return int(self.inputs.commands.shape[0])

    @property
    def sides(self) -> int:
        """Of the inputs."""
        return max(self.plants[0].sides, 1)

    @cached_property
    def begun(self) -> list[Begun]:
        """How each lane begins."""
        found = []
        for lane, plant in enumerate(self.plants):
            effects = None
            if self.settings.effects is not None:
                inductance = small_signal_inductance(plant, self.own_surface(lane))
                own = self.settings.effects[lane]
                effects = kernel_coefficients(plant, own, inductance=inductance, step=self.step, n_step=self.substeps)
            found.append(self._at(lane, self.settings.starts_of(lane)[0], effects))
        return found

    def begun_at(self, lane: int, start: Array) -> Begun:
        """A lane that begins at a start (4,) as if there were nothing before it."""
        return self._at(lane, start, self.begun[lane][1])

    def own_surface(self, lane: int) -> Surface:
        """That of a lane."""
        if self.surface.coefficients.ndim == 4:
            return self.surface
        index = 0 if self.settings.surface_index is None else int(self.settings.surface_index[lane])
        return self.surface._replace(coefficients=self.surface.coefficients[index])

    def block(
        self, lanes: Sequence[int], begun: Sequence[Begun], commands: Array, pushes: Array, parts: Parts
    ) -> Array:
        """(n_column, LANES, n_sample) of eight lanes that begin so and go to the end of the last part, under commands
        (n_sample or more, 2) and pushes (n_sample,) of all, or with an axis (LANES,) more those of each."""
        out = np.empty((self.columns.size, LANES, int(parts.samples[-1, 1])))
        block, linear = self._block(np.array(lanes), begun), self.inputs.hold == "linear"
        asked = np.ascontiguousarray(commands).reshape(-1, *commands.shape[2:])
        pushed = np.ascontiguousarray(pushes)
        written = in_lines(np.empty((AT_A_TIME * N_OUT, LANES)))
        _run_block(
            self._joined, block, asked, pushed, self.step, self.substeps, self.columns, written, out, parts, linear,
            bool(np.isin(self.columns, OF_WHOLE_ROWS).any()),
        )  # fmt: skip
        return out

    def alone(self, lane: int) -> Array:
        """(n_sample, N_OUT) rows of one lane by the kernel for one run, nan from where it ended."""
        state, effects = self.begun[lane]
        inputs = self.settings.inputs_of(self.inputs, lane)
        commands, linear = inputs.for_sides(self.sides), inputs.hold == "linear"
        out = np.empty((self.n_sample, N_OUT))
        stretches = self.settings.stretches(len(out)), self.settings.starts_of(lane)
        _, done = kernel.run(
            self.own_surface(lane), self.plants[lane], effects, state.copy(), commands, np.asarray(inputs.disturbance),
            self.step, self.substeps, out, linear, stretches,
        )  # fmt: skip
        out[done:] = np.nan
        return out

    @cached_property
    def _joined(self) -> Surface:
        """The surfaces behind each other: compiled once, one or many."""
        shape = self.surface.coefficients.shape
        return self.surface._replace(coefficients=self.surface.coefficients.reshape(-1, *shape[-3:]))

    def _at(self, lane: int, start: Array, effects: Array | None) -> Begun:
        state = initial_state(self.plants[lane], *map(float, start))
        if effects is not None:
            start_effects(self.own_surface(lane), self.plants[lane], effects, state)
        return state, effects

    def _block(self, lanes: NDArray[np.intp], begun: Sequence[Begun]) -> "_Block":
        plants = [self.plants[lane] for lane in lanes]
        state = np.column_stack([one for one, _ in begun])
        columns = [e for _, e in begun if e is not None]
        effects = in_lines(np.column_stack(columns)) if columns else None
        work = lane_workspace()
        if self.settings.surface_index is not None:
            first = self.settings.surface_index[lanes] * self.surface.coefficients[0].size
            for block in (BLOCK_1, BLOCK_2, *range(TILTED, TILTED + 4 * N_BLOCK, N_BLOCK)):
                work[block + SURFACE_START] = first
        stops = [p.end_stop.position if p.end_stop else np.inf for p in plants]
        numbers = in_lines(np.array([numbers_of(p) for p in plants]).T)
        p = plants[0]
        return _Block(numbers, effects, in_lines(state), in_lines(work), p.sides, p.magnets, p.drive, min(stops))


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


def numbers_of(p: PlantParameters) -> list[float]:
    """The plant's numbers, in the order of `PlantParameters`; nan for its end stop."""
    return [np.nan if value is None or isinstance(value, tuple) else float(value) for value in p]


def in_lines(values: Array) -> Array:
    """A copy of rows of eight numbers, none of which lies across two lines of the cache."""
    room = np.empty(values.size + LINE // 8)
    first = -room.ctypes.data % LINE // 8
    found = room[first : first + values.size].reshape(values.shape)
    found[:] = values
    return found


@compiled
def _run_block(
    surface: Surface, block: _Block, commands: Array, disturbance: Array, step: float, n_sub: int,
    columns: NDArray[np.intp], written: Array, out: Array, parts: Parts, linear: bool, whole: bool,
) -> None:  # fmt: skip
    """`kernel.run` over stretches for eight lanes: into `out` (n_column, LANES, n_sample) some of the kernel's columns;
    a lane that cannot go on is nan from there. Commands (2 n_sample or more,) and disturbance (n_sample,) are those of
    all, or with an axis (LANES,) more those of each. What the kernel has `written` (AT_A_TIME N_OUT, LANES) stays in
    the cache."""
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
    starts, lengths = parts.starts, parts.lengths
    before, state_there, work_there = block.state.copy(), block.state.copy(), block.work.copy()
    asked, pushed, table, kept = rows_of(commands), rows_of(disturbance), rows_of(written), rows_of(before)
    took, n_command = rows_of(lengths), len(commands) // 2
    for m in range(len(parts.samples)):
        others = not np.all(parts.begins[m])
        if others:
            state_there[:] = block.state
            work_there[:] = block.work
        if m:
            restart(cells, p, e, state, kept, rows_of(starts[m]), work, took[m])
        kernel.begin_rows(p, e, state, work, step)
        if others:
            for k in range(LANES):
                if not parts.begins[m, k]:
                    block.state[:, k] = state_there[:, k]
                    block.work[:, k] = work_there[:, k]
        for k in range(LANES):
            if parts.begins[m, k]:
                before[:, k] = block.state[:, k]
        end = parts.samples[m, 1]
        for begin in range(parts.samples[m, 0], end, AT_A_TIME):
            upto = min(begin + AT_A_TIME, end)
            kernel.rows_between(
                None, cells, p, e, state, work, block.reach, asked, pushed, n_command, begin, upto, step, n_sub, table,
                linear, whole,
            )  # fmt: skip
            for n in range(upto - begin):
                for j in range(columns.size):
                    for k in range(LANES):
                        out[j, k, begin + n] = written[n * N_OUT + columns[j], k]
    keep(before)
    keep(starts)
    keep(lengths)
    keep(written)
    keep(commands)
    keep(disturbance)
    keep(block.numbers)
    keep(block.work)
    keep(block.effects)
