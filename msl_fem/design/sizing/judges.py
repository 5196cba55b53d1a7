"""Who judges the designs of a search: this process, several processes, or the workers of a dask cluster."""

import contextlib
import multiprocessing
import pickle
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from typing import Any

from msl_fem.design.sizing.design import Design
from msl_fem.design.sizing.judge import Judge, Verdict
from msl_fem.errors import ComputationError
from msl_fem.magnetics.sweep.cluster import PATIENCE, RETRIES, connected, quiet_log
from msl_fem.magnetics.sweep.rows import deaf_children, end_with_parent

GO_ON = "judged designs are kept: run the same command again"
Outcome = Verdict | str
"""A verdict, or why the design's field failed."""


@dataclass(frozen=True)
class Judges:
    """Those who judge.

    Attributes
    ----------
    capacity : how many designs they judge at once
    submit : gives them a design, and has a future's methods
    wait : the futures that are finished, one at least
    """

    capacity: int
    submit: Callable[[Design], Any]
    wait: Callable[[list[Any]], list[Any]]


def judged(judge: Judge, design: Design) -> Outcome:
    """The field's verdict, or why there is none."""
    try:
        return judge.by_field(design)
    except ComputationError as err:
        return str(err)


@contextlib.contextmanager
def judges_here(judge: Judge) -> Iterator[Judges]:
    """This process."""

    def submit(design: Design) -> "Future[Outcome]":
        done: Future[Outcome] = Future()
        done.set_result(judged(judge, design))
        return done

    yield Judges(1, submit, lambda waiting: list(waiting))


@contextlib.contextmanager
def judges_in_processes(judge: Judge, workers: int) -> Iterator[Judges]:
    """So many processes on this machine.

    Raises
    ------
    ComputationError : one of them died
    """
    pool = ProcessPoolExecutor(
        workers, mp_context=multiprocessing.get_context("spawn"), initializer=_start, initargs=(judge,)
    )

    def submit(design: Design) -> "Future[Outcome]":
        with deaf_children():
            return pool.submit(_judge_in_process, design)

    try:
        yield Judges(workers, submit, _finished)
    except BrokenProcessPool as err:
        raise ComputationError(
            f"a worker process of the search died (out of memory, or killed); {GO_ON}, with fewer --workers if memory "
            "is short"
        ) from err
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _finished(waiting: "list[Future[Outcome]]") -> "list[Future[Outcome]]":
    from_any = threading.Event()
    for future in waiting:
        future.add_done_callback(lambda _: from_any.set())
    from_any.wait()
    return [future for future in waiting if future.done()]


_judge: Judge | None = None


def _start(judge: Judge) -> None:
    global _judge
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=end_with_parent, daemon=True).start()
    _judge = judge


def _judge_in_process(design: Design) -> Outcome:
    assert _judge is not None, "the pool's initialiser has run"
    return judged(_judge, design)


@contextlib.contextmanager
def judges_on_cluster(judge: Judge, address: str) -> Iterator[Judges]:
    """The workers of the dask scheduler at an address.

    Raises
    ------
    InputError : no scheduler answers there, or it has no workers
    ComputationError : the cluster was lost on the way
    """
    packed = pickle.dumps(judge)
    with quiet_log(), connected(address) as client:
        import distributed  # optional, and there: it has just connected

        def wait(waiting: list[Any]) -> list[Any]:
            while True:
                try:
                    with client.as_current():
                        return list(distributed.wait(waiting, timeout=PATIENCE, return_when="FIRST_COMPLETED").done)
                except TimeoutError:
                    if not client.nthreads():
                        raise ComputationError(f"no worker of the cluster {address} is left; {GO_ON}") from None

        try:
            capacity = sum(client.nthreads().values())
            yield Judges(
                capacity, lambda d: client.submit(_judge_on_worker, packed, d, pure=False, retries=RETRIES), wait
            )
        except distributed.KilledWorker as err:
            raise ComputationError(
                f"workers of the cluster {address} die with a design (out of memory?); {GO_ON}"
            ) from err
        except (OSError, CancelledError) as err:
            raise ComputationError(f"the connection to the cluster {address} was lost; {GO_ON}") from err


def _judge_on_worker(packed: bytes, design: Design) -> Outcome:
    """Runs in a worker of a cluster, which need not have made the judge to unpickle it."""
    judge: Judge = pickle.loads(packed)
    return judged(judge, design)
