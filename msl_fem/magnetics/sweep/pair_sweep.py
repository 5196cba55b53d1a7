"""A (position, current, current) grid of solutions of both sides to a PairTable with its errors stated."""

import time
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from msl_fem.actuator import Actuator
from msl_fem.computing.arrays import Array
from msl_fem.computing.blas_threads import one_blas_thread
from msl_fem.computing.jobs import Executor, Progress, run_jobs
from msl_fem.computing.row_cache import Arrays, RowCache, content_key
from msl_fem.errors import InputError, NotConverged
from msl_fem.magnetics.field.accuracy import LEVELS
from msl_fem.magnetics.field.magnet_field import CLOSEST
from msl_fem.magnetics.field.pair_field import PairField, pair_magnet, pair_mesh
from msl_fem.magnetics.solver.magnetostatics import FieldSolution
from msl_fem.magnetics.sweep.predictor import RowPredictor
from msl_fem.magnetics.sweep.rows import SOLVER_VERSION
from msl_fem.magnetics.sweep.table_sweep import (
    SweepReport,
    SweepSettings,
    default_grid,
    drive_limit,
    refuse_failures,
    sweep,
)
from msl_fem.magnetics.triangles import TriangleMesh
from msl_fem.table.magnetic_table import SECTION
from msl_fem.table.pair_table import MIRRORED, PAIR_NODES, PairTable

DEFAULT_POSITIONS, DEFAULT_CURRENTS = 19, 16
"""Of the whole travel, and of one sign of a current, 0 included."""
_DENSER_ENDS, _PROBED, _TRIED = 0.4, 33, (0.0, 0.4, 0.8, 1.0)
_EVEN = 0.3
CHECKS = 6
"""Every so many midpoints of the second current are solved to state the interpolation error."""


@dataclass(frozen=True)
class PairSweepRow:
    """One position (m), one current of side 1 (A) and those of side 2; `refine` takes one polynomial degree more."""

    position: float
    current_1: float
    currents_2: tuple[float, ...]
    refine: bool = False

    @property
    def cost(self) -> int:
        return len(self.currents_2) * (4 if self.refine else 1)


@dataclass(frozen=True)
class PairSweepJob:
    """What a process needs to make the field of both sides."""

    actuator: Actuator
    mesh: TriangleMesh
    gap_sum: float
    order: int

    def field(self, refine: bool = False) -> PairField:
        return PairField(self.actuator, self.mesh, gap_sum=self.gap_sum, order=self.order + refine)

    def solver(self) -> "PairSweepSolver":
        return PairSweepSolver(self)


class PairSweepSolver:
    """Solves rows of a job; the model, and the refined one where it is needed, are made once."""

    def __init__(self, job: PairSweepJob) -> None:
        self.job = job
        self._fields: dict[bool, PairField] = {}

    def field(self, refine: bool = False) -> PairField:
        if refine not in self._fields:
            self._fields[refine] = self.job.field(refine)
        return self._fields[refine]

    @one_blas_thread
    def solve(self, row: PairSweepRow) -> Arrays:
        """Arrays (n_2,) of `PAIR_NODES` and the flux densities; a point that does not converge is named in `failed`.

        The row is walked from its smallest current outwards, each field from where those before it lead.
        """
        started = time.process_time()
        points: list[dict[str, float]] = [{} for _ in row.currents_2]
        failed: list[str] = []
        order = np.argsort(np.abs(row.currents_2), kind="stable")
        walker = {1: _Walker(self.field(row.refine), row), -1: _Walker(self.field(row.refine), row)}
        for k in order:
            current = row.currents_2[k]
            try:
                points[k] = walker[1 if current >= 0 else -1].solve(current)
            except NotConverged:
                failed.append(f"{row.current_1:g} and {current:g} A at {row.position * 1e3:g} mm")
        names = dict.fromkeys(name for point in points for name in point)
        arrays = {name: np.array([point.get(name, np.nan) for point in points]) for name in names}
        arrays["cpu_seconds"] = np.array(time.process_time() - started)
        return arrays | ({"failed": np.array(failed)} if failed else {})


class _Walker:
    """Goes along the currents of side 2 of one sign."""

    def __init__(self, field: PairField, row: PairSweepRow) -> None:
        self.field, self.row = field, row
        self.predictor = RowPredictor()

    def solve(self, current: float) -> dict[str, float]:
        """The numbers at a current; raises NotConverged where neither the neighbour nor zero is a start."""
        solution = self._field_at(current)
        responses = self.field.by_currents(solution)
        self.predictor.take(current, solution, responses[1])
        quantities = self.field.quantities(solution, (self.row.current_1, current), responses)
        numbers = {name: float(getattr(quantities, name)) for name in PAIR_NODES}
        numbers |= {SECTION + name: value.mean for name, value in self.field.flux_densities(solution).items()}
        return numbers | {"tail": float(self.field.on_tail(solution)), "newton_iterations": len(solution.trail)}

    def _field_at(self, current: float) -> FieldSolution:
        where = self.row.position, self.row.current_1, current
        start = self.predictor.at(current)
        if start is not None:
            try:
                return self.field.solve(*where, start=start)
            except NotConverged:
                self.predictor.forget()
        return self.field.solve(*where)


def default_pair_grid(actuator: Actuator) -> tuple[Array, Array]:
    """Positions (m), the same on both sides of the middle, and currents (A) of both signs.

    The positions leave the gaps of `default_grid` and are a little denser at the ends. The currents are denser where
    opposing ones saturate the armature, see `_about_the_knee`.

    Raises
    ------
    InputError : the actuator states no nominal gap, range or current limit
    """
    gaps, _ = default_grid(actuator)
    motion = actuator.motion
    assert motion is not None
    assert motion.nominal_gap is not None
    largest = min(motion.nominal_gap - gaps[0], gaps[-1] - motion.nominal_gap)
    share = np.linspace(-1, 1, DEFAULT_POSITIONS)
    positions = largest * share * (1 + _DENSER_ENDS * (1 - np.abs(share)))
    limit = drive_limit(actuator)
    assert limit is not None
    tried = largest * np.array(_TRIED)
    return positions, _about_the_knee(actuator, motion.nominal_gap, tried, limit)


@one_blas_thread
def _about_the_knee(actuator: Actuator, gap: float, positions: Array, limit: float) -> Array:
    """Currents from 0 to the limit (A), some evenly, most by the root of the flux linkage's curvature.

    That curvature is of equal opposing currents, its mean over the positions, from a few solutions on a coarse mesh:
    the interpolant's error is largest there. Rounded, so that a sweep that goes on finds its rows.
    """
    level = LEVELS["fast"]
    field = PairField(actuator, pair_mesh(pair_magnet(actuator), gap, "fast"), gap_sum=2 * gap, order=level.order)
    probe = limit * np.linspace(0.0, 1.0, _PROBED) ** 2
    density = np.full(_PROBED, _EVEN / limit)
    for position in positions:
        flux = _flux_of_opposing(field, float(position), probe)
        bend = np.sqrt(np.abs(np.gradient(np.gradient(flux, probe), probe)))
        density += bend / np.trapezoid(bend, probe) / len(positions)
    placed = np.r_[0.0, np.cumsum((density[1:] + density[:-1]) / 2 * np.diff(probe))]
    chosen = np.interp(np.linspace(0, placed[-1], DEFAULT_CURRENTS), placed, probe)
    return np.r_[0.0, np.round(chosen[1:-1] / limit, 3) * limit, limit]


def _flux_of_opposing(field: PairField, position: float, currents: Array) -> Array:
    """(n,) Wb of side 1 under equal opposing currents (n,) from 0 on, each field from the one before."""
    flux, potential = np.zeros(currents.size), None
    for n in range(1, currents.size):
        current = float(currents[n])
        solution = field.solve(position, current, -current, start=potential)
        responses = field.by_currents(solution)
        flux[n] = field.quantities(solution, (current, -current), responses).flux_linkage_1
        potential = solution.potential + (responses[0] - responses[1]) * (
            currents[min(n + 1, currents.size - 1)] - current
        )
    return flux


def pair_sweep(
    actuator: Actuator,
    positions: ArrayLike,
    currents: ArrayLike,
    *,
    gap_sum: float,
    settings: SweepSettings | None = None,
    progress: Progress | None = None,
) -> tuple[PairTable, SweepReport]:
    """The table of both sides, and what it took.

    Only positions towards side 1 and one sign of its current are solved; the others follow by exchanging the sides and
    by reversing both currents, which the field does exactly (`pair_field`).

    Parameters
    ----------
    positions : (n,) m, 3 or more; those below 0 are the mirror image of those above and may be left out
    currents : (m,) A, 2 or more beside 0; both signs of each are taken
    gap_sum : both gaps together, in m
    progress : called with the numbers of finished and of all rows, those of the one-sided table included

    Raises
    ------
    InputError, ComputationError : as `sweep`
    """
    settings = settings or SweepSettings()
    if settings.end_effects:
        raise InputError("a table of both sides has no correction of end effects; leave --end-effects out")
    magnet = pair_magnet(actuator)
    half_x, half_i = _sizes(positions), _sizes(currents)
    _check_grid(half_x, half_i, gap_sum)
    started = time.process_time()
    gaps = np.unique(np.r_[gap_sum / 2 - half_x, gap_sum / 2 + half_x])
    gap_grid, current_grid = _one_sided_grid(gaps, half_i)
    one_sided, alone = sweep(actuator, gap_grid, current_grid, settings=settings)
    level = LEVELS[settings.accuracy]
    mesh = pair_mesh(magnet, float(np.sqrt(gaps[0] * gaps[-1])), settings.accuracy)
    job = PairSweepJob(actuator, mesh, gap_sum, level.order)
    both = np.r_[-half_i[:0:-1], half_i]
    nodes = [PairSweepRow(float(x), float(i), _needed(float(x), float(i), both)) for x in half_x for i in half_i]
    between = _between_nodes(half_x, half_i)
    refined = _refined(half_x, half_i)
    cache = RowCache(settings.cache) if settings.cache is not None else None
    if cache is not None:
        cache.check_writable()
    done = run_jobs(
        job,
        [*nodes, *between, *refined],
        executor=Executor(settings.workers, settings.scheduler),
        cache=cache,
        key=_key(job),
        resume=settings.resume,
        progress=progress,
    )
    refuse_failures(done)
    grid = done[: len(nodes)]
    arrays = _by_symmetry(half_x, half_i, nodes, grid)
    whole_x = np.r_[-half_x[:0:-1], half_x]
    table = PairTable(
        one_sided,
        gap_sum,
        whole_x,
        both,
        both.copy(),
        nodes={name: arrays[name] for name in PAIR_NODES},
        extras={name: values for name, values in arrays.items() if name.startswith(SECTION)},
    )
    mesh_error = level.safety * _mesh_error(table, refined, done[-len(refined) :])
    interpolation_error, reciprocity_error = _interpolation_error(table, between, done[len(nodes) : -len(refined)])
    notes = list(alone.notes)
    table = replace(
        table,
        mesh_error=max(mesh_error, one_sided.mesh_error),
        interpolation_error=interpolation_error,
        reciprocity_error=reciprocity_error,
        provenance=dict(one_sided.provenance)
        | {"sides": "both, sharing the armature; equal signs of the currents aid", "notes": notes},
    )
    fresh = [row for row in done if "reused" not in row]
    elsewhere = settings.workers > 1 or settings.scheduler is not None
    in_workers = sum(float(row["cpu_seconds"]) for row in fresh) if elsewhere else 0.0
    others = alone.cpu_seconds if elsewhere else 0.0
    report = SweepReport(
        points=whole_x.size * both.size**2,
        failed=0,
        unknowns=job.field().model.free.size,
        newton_iterations=int(sum(row["newton_iterations"].sum() for row in grid)),
        mesh_error=table.mesh_error,
        interpolation_error=interpolation_error,
        reciprocity_error=reciprocity_error,
        cpu_seconds=time.process_time() - started + in_workers + others,
        solutions=alone.solutions + sum(len(row.currents_2) for row in [*nodes, *between]),
        reused_rows=sum("reused" in row for row in done) + alone.reused_rows,
        notes=tuple(notes),
    )
    return table, report


def _sizes(values: ArrayLike) -> Array:
    """0 and the values without their signs, increasing; those that differ by rounding once."""
    sizes = np.unique(np.abs(np.r_[0.0, np.asarray(values, dtype=float)]))
    return sizes[np.r_[True, np.diff(sizes) > CLOSEST * sizes[-1]]]


def _check_grid(half_x: Array, half_i: Array, gap_sum: float) -> None:
    if not gap_sum > 0:
        raise InputError(f"both gaps together must be above 0, they are {gap_sum:g} m")
    bad = half_x[~(half_x < gap_sum / 2)]
    if bad.size:
        raise InputError(
            f"position {bad[0] * 1e3:g} mm leaves no gap; the armature moves less than half of both gaps together, "
            f"{gap_sum / 2 * 1e3:g} mm"
        )
    if half_x.size < 2 or half_i.size < 3:
        raise InputError(
            f"a table of a pair needs at least 1 position beside the middle and 2 currents beside 0; given are "
            f"{half_x.size - 1} and {half_i.size - 1}"
        )


def _one_sided_grid(gaps: Array, half_i: Array) -> tuple[Array, Array]:
    """Gaps and currents of the one-sided table: the pair's own, and one or two between, as it carries the knee."""
    between = np.sqrt(gaps[1:] * gaps[:-1])
    root = np.sqrt(half_i)
    thirds = [(root[:-1] + share * np.diff(root)) ** 2 for share in (1 / 3, 2 / 3)]
    return np.unique(np.r_[gaps, between[: gaps.size // 2]]), np.unique(np.r_[half_i, *thirds])


def _needed(position: float, current_1: float, both: Array) -> tuple[float, ...]:
    """The currents of side 2 that no symmetry gives: in the middle the sides may be exchanged, too."""
    if current_1 == 0.0:
        kept = both >= 0
    elif position == 0.0:
        kept = np.abs(both) <= current_1
    else:
        kept = np.ones(both.size, dtype=bool)
    return tuple(both[kept].tolist())


def _by_symmetry(half_x: Array, half_i: Array, rows: list[PairSweepRow], answers: list[Arrays]) -> dict[str, Array]:
    """The arrays over all positions and both signs of both currents."""
    n_x, n_i = half_x.size, half_i.size
    names = [name for name in answers[0] if name in PAIR_NODES or name.startswith(SECTION)]
    shape = 2 * n_x - 1, 2 * n_i - 1, 2 * n_i - 1
    arrays = {name: np.full(shape, np.nan) for name in names}
    both = np.r_[-half_i[:0:-1], half_i]
    place = {float(v): k for k, v in enumerate(both)}
    at_x = {float(v): k for k, v in enumerate(np.r_[-half_x[:0:-1], half_x])}
    for row, answer in zip(rows, answers, strict=True):
        x, i = row.position, row.current_1
        for k, j in enumerate(row.currents_2):
            for name in names:
                value = answer[name][k]
                # as solved, with both currents reversed, with the sides exchanged, and both
                odd = -1.0 if name.startswith("flux_linkage") or name.startswith("force_current") else 1.0
                other, sign = _exchanged(name)
                arrays[name][at_x[x], place[i], place[j]] = value
                arrays[name][at_x[x], place[_negative(i)], place[_negative(j)]] = odd * value
                arrays[other][at_x[_negative(x)], place[j], place[i]] = sign * value
                arrays[other][at_x[_negative(x)], place[_negative(j)], place[_negative(i)]] = odd * sign * value
    return arrays


def _negative(value: float) -> float:
    return -value if value else 0.0


def _exchanged(name: str) -> tuple[str, float]:
    """What a quantity is called, and its sign, when the sides are exchanged."""
    pairs = MIRRORED | {other: (name, sign) for name, (other, sign) in MIRRORED.items()}
    if name in pairs:
        return pairs[name]
    for here, there in (("_1", "_2"), ("_2", "_1")):
        if name.startswith(SECTION) and name.endswith(here):
            return name[: -len(here)] + there, 1.0
    return name, 1.0


def _between_nodes(half_x: Array, half_i: Array) -> list[PairSweepRow]:
    """Rows midway between positions and currents of side 1, each at some midpoints of side 2, staggered."""
    both = np.r_[-half_i[:0:-1], half_i]
    middle_x, middle_1, middle_2 = ((v[1:] + v[:-1]) / 2 for v in (half_x, half_i, both))
    rows = []
    for m, x in enumerate(middle_x):
        for n, i in enumerate(middle_1[m % 2 :: 2]):
            currents = middle_2[(m + 2 * n) % CHECKS :: CHECKS].tolist()
            rows.append(PairSweepRow(float(x), float(i), tuple(currents or middle_2.tolist())))
    return rows


def _refined(half_x: Array, half_i: Array) -> list[PairSweepRow]:
    """Refined rows in the middle and at both ends: a middle current and the largest one, aiding and opposing."""
    middle = float(half_i[half_i.size // 2])
    largest = float(half_i[-1])
    positions = sorted({0.0, float(half_x[half_x.size // 2]), float(half_x[-1])})
    return [PairSweepRow(x, middle, (-largest, -middle, middle), refine=True) for x in positions]


def _mesh_error(table: PairTable, rows: list[PairSweepRow], refined: list[Arrays]) -> float:
    """Largest change of the force with one degree more, of the table's largest force."""
    change = 0.0
    for row, fine in zip(rows, refined, strict=True):
        m = int(np.argmin(np.abs(table.position - row.position)))
        n = int(np.argmin(np.abs(table.current_1 - row.current_1)))
        at = [int(np.argmin(np.abs(table.current_2 - j))) for j in row.currents_2]
        change = max(change, float(np.abs(fine["force"] - table.nodes["force"][m, n, at]).max()))
    return change / float(np.abs(table.nodes["force"]).max())


def _interpolation_error(table: PairTable, rows: list[PairSweepRow], checks: list[Arrays]) -> tuple[float, float]:
    """Largest difference of force, of full scale; and of force or a flux linkage, each of its full scale."""
    error = {"force": 0.0, "flux_linkage_1": 0.0, "flux_linkage_2": 0.0}
    for row, check in zip(rows, checks, strict=True):
        between = table.evaluate(row.position, row.current_1, np.array(row.currents_2))
        for name in error:
            error[name] = max(error[name], float(np.abs(check[name] - between[name]).max()))
    relative = {name: value / float(np.abs(table.nodes[name]).max()) for name, value in error.items()}
    return relative["force"], max(relative.values())


def _key(job: PairSweepJob) -> str:
    """A name for all that determines the answers of a job."""
    probe = np.linspace(0.0, 3.0, 3001)
    field = job.field()
    return content_key(
        {
            "magnet": field.magnet.model_dump(),
            "irons": {name: iron.magnetise(probe)[0].tolist() for name, iron in field.irons.items()},
            "mesh": [job.mesh.gap, job.mesh.points.shape, job.mesh.points.sum(), job.order],
            "gap_sum": job.gap_sum,
            "solver": SOLVER_VERSION,
            "sides": "both",
        }
    )
