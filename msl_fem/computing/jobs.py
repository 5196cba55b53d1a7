"""Jobs: rows of independent work, each done once, in this process, in several, or on a dask.distributed cluster.

A job makes a solver wherever it runs, and the solver answers rows. `run_jobs` answers all rows of a job: from the
folder of finished rows what is there, the rest by an `Executor`, and keeps each answer as soon as it is there.
`Executor.start` gives the workers themselves, for a search that makes its rows on the way.
"""

import contextlib
import gc
import itertools
import logging
import multiprocessing
import os
import pickle
import queue
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Generic, Protocol, TypeVar

from msl_fem.computing.interrupts import interrupts_held_back
from msl_fem.computing.row_cache import content_key
from msl_fem.errors import ComputationError, InputError

if TYPE_CHECKING:
    from distributed import Client

Progress = Callable[[int, int], None]
"""Called with the numbers of finished and of all rows."""
GO_ON = "finished rows are kept: run again with --resume"
CONNECT = 5.0
"""Seconds within which a scheduler must answer."""
FIRST_WORKER = 5.0
"""Seconds within which it must have a worker."""
PATIENCE = 10.0
"""Seconds without a finished row after which is asked whether any worker is left."""
RETRIES = 3
"""How often a row is given to a worker anew, beyond the scheduler's own attempts, when workers die with it."""

Row = TypeVar("Row")
Row_contra = TypeVar("Row_contra", contravariant=True)
Answer = TypeVar("Answer")
Answer_co = TypeVar("Answer_co", covariant=True)
Fields = TypeVar("Fields", bound=Mapping[str, Any])


class Solver(Protocol[Row_contra, Answer_co]):
    """What answers the rows of a job."""

    def solve(self, row: Row_contra, /) -> Answer_co: ...


class Job(Protocol[Row_contra, Answer_co]):
    """Can be sent to another process, and makes its solver there."""

    def solver(self) -> Solver[Row_contra, Answer_co]: ...


class Costly(Protocol):
    """A row that says how much work it is, compared with the others."""

    @property
    def cost(self) -> int: ...


CostlyRow = TypeVar("CostlyRow", bound=Costly)


class Cache(Protocol[Answer]):
    """Where answers are kept."""

    def get(self, key: str) -> Answer | None: ...

    def put(self, key: str, answer: Answer, /) -> None: ...


@dataclass(frozen=True)
class Workers(Generic[Row, Answer]):
    """Those who solve.

    Attributes
    ----------
    capacity : how many rows they solve at once
    submit : gives them a row
    wait : those of the futures that are finished, one at least
    """

    capacity: int
    submit: Callable[[Row], "Future[Answer]"]
    wait: Callable[[list["Future[Answer]"]], list["Future[Answer]"]]


@dataclass(frozen=True)
class Executor:
    """Where rows are solved: by processes here (1: by this one), or by the workers of a dask.distributed scheduler.

    A cluster needs this package on its workers, and files of B-H curves under the same path as here; a row whose
    worker dies goes to another one.

    Attributes
    ----------
    scheduler : its address, like "tcp://192.168.0.7:8786"; None: processes here
    work, item, go_on : what messages call the work and its parts, and how to go on with it
    """

    workers: int = 1
    scheduler: str | None = None
    work: str = "sweep"
    item: str = "row"
    go_on: str = GO_ON

    def start(self, job: Job[Row, Answer], most: int) -> contextlib.AbstractContextManager[Workers[Row, Answer]]:
        """The workers for at most so many rows; they end with the block, at once where an error or Ctrl-C ends it.

        Raises
        ------
        InputError : dask.distributed is not installed, or the address gives no cluster
        ComputationError : a process died, or the cluster was lost on the way
        """
        if self.scheduler is not None:
            return _on_cluster(job, self.scheduler, self)
        count = min(self.workers, most)
        return _in_processes(job, count, self) if count > 1 else _in_this_process(job)


def run_jobs(
    job: Job[CostlyRow, Fields],
    rows: Sequence[CostlyRow],
    *,
    executor: Executor,
    cache: Cache[Fields] | None = None,
    key: str = "",
    resume: bool = False,
    progress: Progress | None = None,
) -> list[Fields]:
    """The answers to a job's rows, in order; each is kept at once, but for those that have a `failed`.

    Parameters
    ----------
    key : names all of the job that determines its answers; with the row's fields it is the name of a kept answer
    resume : take kept answers from the cache

    Raises
    ------
    InputError : no cluster at the scheduler's address
    ComputationError : the executor lost what it runs on; finished rows are in the cache
    """
    keys = [content_key({"job": key, **asdict(row)}) for row in rows] if cache is not None else []  # type: ignore[call-overload]
    answers: dict[int, Fields] = {}
    if cache is not None and resume:
        stored = {n: cache.get(k) for n, k in enumerate(keys)}
        answers = {n: answer for n, answer in stored.items() if answer is not None}
    missing = [n for n in range(len(rows)) if n not in answers]
    with contextlib.ExitStack() as stack:
        # processes are forked here, before a progress bar starts its thread
        workers = stack.enter_context(executor.start(job, len(missing))) if missing else None
        if progress:
            progress(len(answers), len(rows))
        waiting = {workers.submit(rows[n]): n for n in costliest_first(missing, rows)} if workers else {}
        while workers and waiting:
            for future in workers.wait(list(waiting)):
                n, answer = waiting.pop(future), future.result()
                if cache is not None and "failed" not in answer:
                    cache.put(keys[n], answer)
                answers[n] = answer
                if progress:
                    progress(len(answers), len(rows))
    return [answers[n] for n in range(len(rows))]


def costliest_first(numbers: Sequence[int], rows: Sequence[Costly]) -> list[int]:
    """The rows' numbers in the order in which no process waits for a late, costly one."""
    return sorted(numbers, key=lambda n: -rows[n].cost)


def failures(answers: Sequence[Mapping[str, Any]]) -> list[str]:
    """Why rows failed, those that did."""
    return [str(answer["failed"]) for answer in answers if "failed" in answer]


# --- this process, and processes on this machine ---------------------------------------------------------------------


@contextlib.contextmanager
def _in_this_process(job: Job[Row, Answer]) -> Iterator[Workers[Row, Answer]]:
    solver = job.solver()
    rows: dict[Future[Answer], Row] = {}

    def submit(row: Row) -> "Future[Answer]":
        future: Future[Answer] = Future()
        rows[future] = row
        return future

    def solve_first(waiting: list["Future[Answer]"]) -> list["Future[Answer]"]:
        waiting[0].set_result(solver.solve(rows.pop(waiting[0])))
        return waiting[:1]

    yield Workers(1, submit, solve_first)


@contextlib.contextmanager
def _in_processes(job: Job[Row, Answer], count: int, executor: Executor) -> Iterator[Workers[Row, Answer]]:
    context: Any = multiprocessing.get_context(_start_method())
    if context.get_start_method() == "forkserver":
        context.set_forkserver_preload(["__main__", type(job).__module__])
    pool = ProcessPoolExecutor(count, mp_context=context, initializer=_start_worker, initargs=(job,))
    # Not concurrent.futures.wait: interrupted, it leaves futures locked, and the pool's thread waits for them for ever.
    finished: queue.SimpleQueue[Future[Answer]] = queue.SimpleQueue()

    def submit(row: Row) -> "Future[Answer]":
        with interrupts_held_back():
            future = pool.submit(_solve_in_worker, row)
            future.add_done_callback(finished.put)
            return future

    try:
        with interrupts_held_back():
            pool.submit(int)  # starts the processes
        yield Workers(count, submit, lambda waiting: [finished.get()])
    except BrokenProcessPool as err:
        _kill_processes(pool)
        raise ComputationError(
            f"a worker process of the {executor.work} died (out of memory, or killed); {executor.go_on}, with fewer "
            "--workers if memory is short"
        ) from err
    except BaseException:
        _kill_processes(pool)
        raise
    finally:
        with interrupts_held_back():
            pool.shutdown(wait=True, cancel_futures=True)


def _start_method() -> str:
    """Forked processes begin at once, with all modules loaded; only a process of one thread may be forked.

    With more threads one of them may hold a lock that nobody would release in the copy. Then a server is started that
    loads the job's modules once and is forked itself; outside Linux, where system libraries bear no fork, each process
    loads them anew.
    """
    if sys.platform != "linux":
        return "spawn"
    return "fork" if threading.active_count() == 1 else "forkserver"


def _kill_processes(pool: ProcessPoolExecutor) -> None:
    """At once: whoever interrupts a run does not wait for its rows, which go nowhere.

    Of an answer that a process was about to write, the pool's thread would wait for the rest, as long as this process
    itself holds the pipe's other end.
    """
    for process in list((getattr(pool, "_processes", None) or {}).values()):
        process.kill()
    answers: Any = getattr(pool, "_result_queue", None)
    if answers is not None:
        answers._writer.close()


_solver: Solver[Any, Any] | None = None


def _start_worker(job: Job[Any, Any]) -> None:
    global _solver
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    gc.freeze()  # what was forked along, open databases for instance, is not ours to tidy up
    threading.Thread(target=_end_with_parent, daemon=True).start()
    _solver = job.solver()


def _end_with_parent() -> None:
    """Leave when the parent was killed: a worker would wait for rows without end."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _solve_in_worker(row: Any) -> Any:
    assert _solver is not None, "the pool's initialiser has run"
    return _solver.solve(row)


# --- workers of a dask.distributed cluster (the extra `cluster`) -----------------------------------------------------


@contextlib.contextmanager
def _on_cluster(job: Job[Row, Answer], address: str, executor: Executor) -> Iterator[Workers[Row, Answer]]:
    # the workers must be able to unpickle the job without having made it: a message each, no scattered data that
    # could die with its holder
    packed, place = pickle.dumps(job), itertools.count()
    with _connected(address) as (distributed, client):

        def submit(row: Row) -> Any:
            return client.submit(
                _solve_on_cluster_worker, packed, row, retries=RETRIES, pure=False, priority=-next(place)
            )

        def finished(waiting: list[Any]) -> list[Any]:
            while True:
                try:
                    with client.as_current():
                        return list(distributed.wait(waiting, timeout=PATIENCE, return_when=FIRST_COMPLETED).done)
                except TimeoutError:
                    if not client.nthreads():
                        raise ComputationError(
                            f"no worker of the cluster {address} is left; {executor.go_on}"
                        ) from None

        try:
            yield Workers(sum(client.nthreads().values()), submit, finished)
        except distributed.KilledWorker as err:
            raise ComputationError(
                f"workers of the cluster {address} die with a {executor.item} of the {executor.work} (out of memory?); "
                f"{executor.go_on}, with workers of more memory"
            ) from err
        except (OSError, CancelledError) as err:
            raise ComputationError(f"the connection to the cluster {address} was lost; {executor.go_on}") from err


@contextlib.contextmanager
def _connected(address: str) -> Iterator[tuple[Any, "Client"]]:
    """The library, and its client of a scheduler that has at least one worker.

    The client's own log, which has a traceback for each loss that is answered here, is off.
    """
    try:
        import distributed
    except ImportError as err:
        raise InputError(
            "--scheduler needs dask.distributed, which is not installed; install msl-fem[cluster], or use --workers"
        ) from err
    log = logging.getLogger("distributed.client")
    level = log.level
    log.setLevel(logging.CRITICAL)
    try:
        with _client(distributed, address) as client:
            yield distributed, client
    finally:
        log.setLevel(level)


def _client(distributed: Any, address: str) -> "Client":
    way_out = "give the address that 'dask scheduler' prints, like tcp://192.168.0.7:8786, or use --workers"
    try:
        if not address.strip():
            raise ValueError("an empty address would start a cluster")
        # a client of an unknown protocol would hang at its end, so ask for the protocol first
        distributed.comm.registry.get_backend(distributed.comm.addressing.parse_address(address)[0])
        client: Client = distributed.Client(address, timeout=CONNECT, set_as_default=False)
    except (OSError, ValueError, TypeError, ImportError) as err:
        raise InputError(f"no scheduler answers at '{address}' within {CONNECT:g} s; {way_out}") from err
    try:
        client.wait_for_workers(1, timeout=FIRST_WORKER)
    except TimeoutError as err:
        client.close()
        raise InputError(
            f"the scheduler at '{address}' has no workers; start one with 'dask worker {address}'"
        ) from err
    return client


_of_thread = threading.local()


def _solve_on_cluster_worker(packed: bytes, row: Any) -> Any:
    """Runs in a worker of a cluster; each of its threads keeps the solver of its last job."""
    if getattr(_of_thread, "packed", None) != packed:
        _of_thread.solver = pickle.loads(packed).solver()
        _of_thread.packed = packed
    return _of_thread.solver.solve(row)
