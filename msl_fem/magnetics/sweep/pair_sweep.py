"""A (position, current, current) grid of solutions of both sides to a PairTable with its errors stated.

Two meshes share the work: an accurate one for what each side does alone, which is most of all forces, and a coarse one
for the rest, in which its errors fall out. Fields of the accurate mesh between the nodes tell what is left.
"""

import time
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from msl_fem.actuator import Actuator
from msl_fem.computing.arrays import Array
from msl_fem.computing.jobs import Executor, Progress, run_jobs
from msl_fem.computing.row_cache import Arrays, RowCache
from msl_fem.magnetics.field.accuracy import LEVELS
from msl_fem.magnetics.field.magnet_field import chosen_ends
from msl_fem.magnetics.field.pair_field import pair_magnet
from msl_fem.magnetics.sweep.expected_fields import expected_fields
from msl_fem.magnetics.sweep.pair_grid import check_pair_grid, half_of, one_sided_grid
from msl_fem.magnetics.sweep.pair_rows import PairSweepJob, PairSweepRow, alone_of, job_key, pair_job
from msl_fem.magnetics.sweep.pair_symmetry import by_symmetry, needed, with_each_alone
from msl_fem.magnetics.sweep.reduced_rows import reduced_side_rows
from msl_fem.magnetics.sweep.table_sweep import SweepReport, SweepSettings, refuse_failures, sweep
from msl_fem.table.magnetic_table import SECTION
from msl_fem.table.pair_table import PAIR_NODES, PairTable

CHECKS = 4
"""Every so many midpoints of each current are solved to state the interpolation error."""


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
    by reversing both currents, which the field does exactly (`pair_field`). `mesh_error` is of the accurate mesh;
    `interpolation_error`, by its fields between the nodes, counts what the coarse one gets wrong.

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
    pair_magnet(actuator)
    ends = chosen_ends(actuator, settings.end_effects)
    half_x, half_i = half_of(positions), half_of(currents)
    check_pair_grid(half_x, half_i, gap_sum)
    started = time.process_time()
    gaps = np.unique(np.r_[gap_sum / 2 - half_x, gap_sum / 2 + half_x])
    one_sided, alone = sweep(actuator, *one_sided_grid(gaps, half_i), settings=settings)
    whole_x, both = (np.r_[-half[:0:-1], half] for half in (half_x, half_i))
    job = pair_job(actuator, gaps, gap_sum=gap_sum, accuracy=settings.accuracy, end_effects=ends)
    common = [
        PairSweepRow(float(x), float(i), needed(float(x), float(i), both), common=True) for x in half_x for i in half_i
    ]
    one_on = [PairSweepRow(float(x), 0.0, tuple(half_i.tolist())) for x in whole_x]
    between, judged = _between_nodes(half_x, half_i), _judged(half_x, half_i)
    refined = [replace(row, refine=True) for row in judged]
    field = job.field()
    reduced = None if settings.full else reduced_side_rows(field, one_on, settings.accuracy)
    easy = [] if reduced is None else reduced.answers
    if reduced is not None:
        job = replace(job, alone=expected_fields(reduced.model, alone_of([*between, *judged])))
    solved = [*common, *([] if easy else one_on), *between]
    done = _answers(job, job_key(job, field), [*solved, *judged, *refined], settings, progress)
    parts = iter([*done[: len(common)], *easy, *done[len(common) :]])
    answers = [[next(parts) for _ in rows] for rows in (common, one_on, between, judged, refined)]
    arrays = with_each_alone(
        by_symmetry(half_x, half_i, common, answers[0]), by_symmetry(half_x, half_i, one_on, answers[1])
    )
    table = PairTable(
        one_sided,
        gap_sum,
        whole_x,
        both,
        both.copy(),
        nodes={name: arrays[name] for name in PAIR_NODES},
        extras={name: values for name, values in arrays.items() if name.startswith(SECTION)},
    )
    largest = float(np.abs(table.nodes["force"]).max())
    mesh_error = LEVELS[settings.accuracy].safety * _mesh_error(largest, answers[3], answers[4])
    if reduced is not None:
        mesh_error += reduced.certificate.error_estimate
    interpolation_error, reciprocity_error = _interpolation_error(table, between, answers[2])
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
        unknowns=field.model.free.size,
        newton_iterations=int(sum(row["newton_iterations"].sum() for row in done)),
        mesh_error=table.mesh_error,
        interpolation_error=interpolation_error,
        reciprocity_error=reciprocity_error,
        cpu_seconds=time.process_time() - started + in_workers + others,
        certificate=alone.certificate if reduced is None else reduced.certificate,
        solutions=alone.solutions
        + sum(len(row.currents_2) for row in solved)
        + (0 if reduced is None else reduced.solutions),
        reused_rows=sum("reused" in row for row in done) + alone.reused_rows,
        notes=tuple(notes),
    )
    return table, report


def _answers(
    job: PairSweepJob, key: str, rows: list[PairSweepRow], settings: SweepSettings, progress: Progress | None
) -> list[Arrays]:
    """The rows' answers, in order; ComputationError where a field did not converge."""
    cache = RowCache(settings.cache) if settings.cache is not None else None
    if cache is not None:
        cache.check_writable()
    done = run_jobs(
        job,
        rows,
        executor=Executor(settings.workers, settings.scheduler),
        cache=cache,
        key=key,
        resume=settings.resume,
        progress=progress,
    )
    refuse_failures(done)
    return done


def _between_nodes(half_x: Array, half_i: Array) -> list[PairSweepRow]:
    """Rows midway between positions and currents of side 1, each at some midpoints of side 2, staggered."""
    both = np.r_[-half_i[:0:-1], half_i]
    middle_x, middle_1, middle_2 = ((v[1:] + v[:-1]) / 2 for v in (half_x, half_i, both))
    rows, apart = [], min(CHECKS, middle_1.size)
    for m, x in enumerate(middle_x):
        for n, i in enumerate(middle_1[m % apart :: apart]):
            currents = middle_2[(m + n) % CHECKS :: CHECKS].tolist()
            rows.append(PairSweepRow(float(x), float(i), tuple(currents or middle_2.tolist()), checked=True))
    return rows


def _judged(half_x: Array, half_i: Array) -> list[PairSweepRow]:
    """Rows to refine, in the middle and at both ends: a middle current and the largest one, aiding and opposing."""
    middle = float(half_i[half_i.size // 2])
    largest = float(half_i[-1])
    positions = sorted({0.0, float(half_x[half_x.size // 2]), float(half_x[-1])})
    return [PairSweepRow(x, middle, (-largest, -middle, middle), checked=True) for x in positions]


def _mesh_error(largest: float, judged: list[Arrays], refined: list[Arrays]) -> float:
    """Largest change of the force with one degree more, of the table's largest force (N)."""
    changes = [np.abs(fine["force"] - plain["force"]).max() for plain, fine in zip(judged, refined, strict=True)]
    return float(max(changes)) / largest


def _interpolation_error(table: PairTable, rows: list[PairSweepRow], checks: list[Arrays]) -> tuple[float, float]:
    """Largest difference of force, of full scale; and of force or a flux linkage, each of its full scale."""
    error = {"force": 0.0, "flux_linkage_1": 0.0, "flux_linkage_2": 0.0}
    for row, check in zip(rows, checks, strict=True):
        between = table.evaluate(row.position, row.current_1, np.array(row.currents_2))
        for name in error:
            error[name] = max(error[name], float(np.abs(check[name] - between[name]).max()))
    relative = {name: value / float(np.abs(table.nodes[name]).max()) for name, value in error.items()}
    return relative["force"], max(relative.values())
