"""Rows of a sweep (one gap, increasing currents), solved in this process or in several, each row once."""

import contextlib
import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from msl_fem.actuator import ECore
from msl_fem.computing.blas_threads import one_blas_thread
from msl_fem.errors import ComputationError, NotConverged
from msl_fem.magnetics.kinds.e_core import MagnetField
from msl_fem.magnetics.solver.magnetostatics import FieldSolution
from msl_fem.magnetics.solver.mesh import TriangleMesh
from msl_fem.magnetics.sweep.cache import RowCache, content_key
from msl_fem.table.magnetic_table import EXTRAS, NODES, SECTION

Array = NDArray[np.float64]
Arrays = dict[str, Array]
Progress = Callable[[int, int], None]
SCALARS = (*NODES, *EXTRAS)


class Solver(Protocol):
    """What solves the rows of a job."""

    def solve(self, row: Any) -> Arrays: ...


class Work(Protocol):
    """A job that a process can be given: it makes its own solver there."""

    def solver(self) -> Solver: ...


class Costly(Protocol):
    """A row that says how much work it is, in solutions of the base model."""

    @property
    def cost(self) -> int: ...


@dataclass(frozen=True)
class Job:
    """What a process needs to solve rows: the magnet and its meshes' sizes are in the mesh already."""

    magnet: ECore
    mesh: TriangleMesh
    folder: Path
    order: int
    end_effects: bool = False

    def solver(self) -> "RowSolver":
        """The solver of the job's rows."""
        return RowSolver(self)


@dataclass(frozen=True)
class Row:
    """One gap (m) and its currents (A), increasing; `refine` solves with one polynomial degree more."""

    gap: float
    currents: tuple[float, ...]
    refine: bool = False

    @property
    def cost(self) -> int:
        """The work it is, in solutions of the base model."""
        return len(self.currents) * (4 if self.refine else 1)


Executor = Callable[[Work, Sequence[tuple[int, Any]]], Iterator[tuple[int, Arrays]]]
"""Solves numbered rows of a job and yields each row's number and arrays as soon as it is finished, in any order."""


class RowSolver:
    """Solves rows of a job; the model, and the refined one where it is needed, are made once."""

    def __init__(self, job: Job) -> None:
        self.job = job
        self._fields: dict[bool, MagnetField] = {}

    def field(self, refine: bool = False) -> MagnetField:
        """The field model of the job's degree, or of one more."""
        if refine not in self._fields:
            job = self.job
            self._fields[refine] = MagnetField(
                job.magnet, job.mesh, folder=job.folder, order=job.order + refine, end_effects=job.end_effects
            )
        return self._fields[refine]

    @one_blas_thread
    def solve(self, row: Row) -> Arrays:
        """Arrays (n_current,) of a row's quantities; a point that does not converge is nan.

        Along the row each field starts from the tangent prediction of the one before; a point that fails from there
        is tried once more from zero.
        """
        started = time.process_time()
        field = self.field(row.refine)
        points: list[dict[str, float]] = []
        state: tuple[Array, Array, float] | None = None
        for current in row.currents:
            start = state[0] + state[1] * (current - state[2]) if state is not None else None
            try:
                solution = _solve_from(field, current, row.gap, start)
            except NotConverged:
                points.append({})
                state = None
                continue
            points.append(_numbers(field, solution))
            state = (solution.potential, field.slope(solution), current)
        names = dict.fromkeys(name for point in points for name in point)
        arrays = {name: np.array([point.get(name, np.nan) for point in points]) for name in names or ("force",)}
        return arrays | {"cpu_seconds": np.array(time.process_time() - started)}


def _solve_from(field: MagnetField, current: float, gap: float, start: Array | None) -> FieldSolution:
    """The solution from a start, or else from zero."""
    try:
        return field.solve(current, gap, start=start)
    except NotConverged:
        if start is None:
            raise
        return field.solve(current, gap)


def _numbers(field: MagnetField, solution: FieldSolution) -> dict[str, float]:
    quantities = field.quantities(solution)
    numbers = {name: float(getattr(quantities, name)) for name in SCALARS}
    numbers |= {SECTION + name: value.mean for name, value in quantities.flux_density.items()}
    return numbers | {"tail": float(bool(quantities.rests_on_tail)), "newton_iterations": len(solution.trail)}


def solve_rows(
    job: Job,
    rows: list[Row],
    *,
    executor: Executor,
    cache: RowCache | None,
    key: str,
    resume: bool,
    progress: Progress | None,
) -> list[Arrays]:
    """The rows' arrays, in order; finished rows go to the cache at once, and with `resume` come from it.

    Raises
    ------
    ComputationError : the executor lost what it runs on; finished rows are in the cache
    """
    keys = [content_key({"job": key, "gap": r.gap, "currents": r.currents, "refine": r.refine}) for r in rows]
    found: dict[int, Arrays] = {}
    if cache is not None and resume:
        for n, row_key in enumerate(keys):
            stored = cache.get(row_key)
            if stored is not None:
                found[n] = stored | {"reused": np.array(True)}
    missing = [n for n in range(len(rows)) if n not in found]
    if progress:
        progress(len(found), len(rows))
    for n, arrays in executor(job, [(n, rows[n]) for n in missing]):
        if cache is not None and np.isfinite(arrays["force"]).all():
            cache.put(keys[n], arrays)
        found[n] = arrays
        if progress:
            progress(len(found), len(rows))
    return [found[n] for n in range(len(rows))]


def in_processes(workers: int) -> Executor:
    """The executor on this machine: so many processes; 1 solves in this process."""
    return lambda job, rows: (
        _solve_here(job, rows) if workers <= 1 or len(rows) < 2 else _solve_in_pool(job, rows, workers)
    )


def dearest_first(rows: Sequence[tuple[int, Costly]]) -> list[tuple[int, Costly]]:
    """The order in which no process waits for a late, dear row."""
    return sorted(rows, key=lambda item: -item[1].cost)


def _solve_here(job: Work, rows: Sequence[tuple[int, Any]]) -> Iterator[tuple[int, Arrays]]:
    solver = job.solver()
    for n, row in rows:
        yield n, solver.solve(row)


def _solve_in_pool(job: Work, rows: Sequence[tuple[int, Any]], workers: int) -> Iterator[tuple[int, Arrays]]:
    pool = ProcessPoolExecutor(
        min(workers, len(rows)),
        mp_context=multiprocessing.get_context("spawn"),
        initializer=_start_worker,
        initargs=(job,),
    )
    try:
        with deaf_children():
            futures = {pool.submit(_solve_in_worker, row): n for n, row in dearest_first(rows)}
        for future in as_completed(futures):
            yield futures[future], future.result()
    except BrokenProcessPool as err:
        raise ComputationError(
            "a worker process of the sweep died (out of memory, or killed); finished rows are kept: "
            "run again with --resume, with fewer --workers if memory is short"
        ) from err
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


@contextlib.contextmanager
def deaf_children() -> Iterator[None]:
    """Processes started in the block never hear Ctrl-C: the parent alone answers it, and ends them."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


_worker: Solver | None = None


def _start_worker(job: Work) -> None:
    global _worker
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=end_with_parent, daemon=True).start()
    _worker = job.solver()


def end_with_parent() -> None:
    """Leave when the parent was killed: a worker that waits for rows would wait for ever."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _solve_in_worker(row: Any) -> Arrays:
    assert _worker is not None, "the pool's initialiser has run"
    return _worker.solve(row)
