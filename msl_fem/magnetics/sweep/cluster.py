"""Rows of a sweep solved by the workers of a dask.distributed cluster (the extra `cluster`)."""

import contextlib
import logging
import pickle
import threading
from collections.abc import Iterator, Sequence
from concurrent.futures import CancelledError
from typing import TYPE_CHECKING, Any

from msl_fem.errors import ComputationError, InputError
from msl_fem.magnetics.sweep.rows import Arrays, Executor, Solver, Work, dearest_first

if TYPE_CHECKING:
    from distributed import Client

CONNECT = 5.0
"""Seconds within which a scheduler must answer."""
FIRST_WORKER = 5.0
"""Seconds within which it must have a worker."""
PATIENCE = 10.0
"""Seconds without a finished row after which is asked whether any worker is left."""
RETRIES = 3
"""How often a row is given to a worker anew, beyond the scheduler's own attempts, when workers die with it."""
GO_ON = "finished rows are kept: run again with --resume"


def on_cluster(address: str) -> Executor:
    """The executor on the workers of the scheduler at `address`, like "tcp://192.168.0.7:8786".

    A row whose worker dies goes to another one. The workers need this package, and files of B-H curves under the same
    path as here. The executor raises InputError where dask.distributed is not installed or the address gives no
    cluster, ComputationError where the cluster is lost on the way.
    """
    return lambda job, rows: _solve_on_cluster(address, job, rows) if rows else iter(())


def _solve_on_cluster(address: str, job: Work, rows: Sequence[tuple[int, Any]]) -> Iterator[tuple[int, Arrays]]:
    distributed = _distributed()
    # the workers must be able to unpickle the job without having made it: a message each, no scattered data that
    # could die with its holder
    packed = pickle.dumps(job)
    with quiet_log(), connected(address) as client:
        waiting = {
            client.submit(_solve_on_worker, packed, row, retries=RETRIES, pure=False, priority=-place): n
            for place, (n, row) in enumerate(dearest_first(rows))
        }
        try:
            while waiting:
                try:
                    with client.as_current():
                        finished = distributed.wait(list(waiting), timeout=PATIENCE, return_when="FIRST_COMPLETED").done
                except TimeoutError:
                    _refuse_without_workers(client, address)
                    continue
                for future in finished:
                    yield waiting.pop(future), future.result()
        except distributed.KilledWorker as err:
            raise ComputationError(
                f"workers of the cluster {address} die with a row of the sweep (out of memory?); {GO_ON}, with workers "
                "of more memory"
            ) from err
        except (OSError, CancelledError) as err:
            raise ComputationError(f"the connection to the cluster {address} was lost; {GO_ON}") from err


def _distributed() -> Any:
    try:
        import distributed
    except ImportError as err:
        raise InputError(
            "--scheduler needs dask.distributed, which is not installed; install msl-fem[cluster], or use --workers"
        ) from err
    return distributed


def connected(address: str) -> "Client":
    """A client of a scheduler that has at least one worker."""
    way_out = "give the address that 'dask scheduler' prints, like tcp://192.168.0.7:8786, or use --workers"
    distributed = _distributed()
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


@contextlib.contextmanager
def quiet_log() -> Iterator[None]:
    """Without the client's own log, which has a traceback for each loss that is answered here."""
    log = logging.getLogger("distributed.client")
    before = log.level
    log.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        log.setLevel(before)


def _refuse_without_workers(client: "Client", address: str) -> None:
    if not client.nthreads():
        raise ComputationError(f"no worker of the cluster {address} is left; {GO_ON}")


_own = threading.local()


def _solve_on_worker(packed: bytes, row: Any) -> Arrays:
    """Runs in a worker: one row; each thread keeps the solver of its last job."""
    if getattr(_own, "packed", None) != packed:
        _own.solver, _own.packed = pickle.loads(packed).solver(), packed
    solver: Solver = _own.solver
    return solver.solve(row)
