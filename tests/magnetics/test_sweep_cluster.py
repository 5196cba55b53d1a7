"""Rows on a dask.distributed cluster of separate processes: the same table, through deaths of workers and scheduler."""

import dataclasses
import os
import signal
import socket
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT

from msl_fem.actuator import Actuator, load_actuator
from msl_fem.computing import jobs
from msl_fem.errors import ComputationError, InputError
from msl_fem.magnetics.sweep.table_sweep import SweepReport, SweepSettings, sweep
from msl_fem.table.magnetic_table import MagneticTable

dask = pytest.importorskip("dask", reason="the extra 'cluster' (dask.distributed) is not installed")
distributed = pytest.importorskip("distributed", reason="the extra 'cluster' (dask.distributed) is not installed")

GRID = (np.geomspace(2e-4, 8e-4, 5), np.array([1.0, 3.0, 5.0, 8.0]))
ROWS = 5 + 4 + 3
FAST = SweepSettings(accuracy="fast")
LONG = 300.0  # s: nobody waits so long, a loaded machine takes what it takes


@pytest.fixture(autouse=True, scope="module")
def patience() -> Iterator[None]:
    """Who is there is waited for as long as it takes; tests of those who are not wait less."""
    with pytest.MonkeyPatch.context() as patch, dask.config.set({"distributed.comm.timeouts.connect": f"{LONG:g}s"}):
        patch.setattr(jobs, "CONNECT", LONG)
        patch.setattr(jobs, "FIRST_WORKER", LONG)
        yield


@pytest.fixture(scope="module")
def e1() -> Actuator:
    return load_actuator(ROOT / "geometries" / "e1.toml")


@pytest.fixture(scope="module")
def undisturbed(e1: Actuator) -> tuple[MagneticTable, SweepReport]:
    return sweep(e1, *GRID, settings=FAST)


@pytest.fixture(scope="module")
def cluster() -> Iterator["distributed.LocalCluster"]:
    """Two worker processes on this machine."""
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=":0", silence_logs=50
    ) as made:
        yield made


def largest_difference(one: MagneticTable, other: MagneticTable) -> float:
    """Of all arrays, each relative to its largest value."""
    pairs = [({**one.nodes, **one.extras}[k], v) for k, v in {**other.nodes, **other.extras}.items()]
    return max(float(np.abs(a - b).max() / np.abs(b).max()) for a, b in pairs)


def test_killed_worker_costs_time_and_no_row(e1, undisturbed, cluster, tmp_path: Path) -> None:
    """SIGKILL to one of two workers in the middle; rows are on disk as they arrive, and the table is the same."""
    with distributed.Client(cluster) as client:
        workers = client.run(os.getpid)
    assert len(set(workers.values()) | {os.getpid()}) == 3, "separate processes"
    seen: list[tuple[int, int]] = []

    def kill_one(done: int, total: int) -> None:
        if done == 2:
            os.kill(next(iter(workers.values())), signal.SIGKILL)
        seen.append((done, len(list(tmp_path.glob("*.npz")))))
        assert total == ROWS

    settings = dataclasses.replace(FAST, scheduler=cluster.scheduler_address, cache=tmp_path)
    table, report = sweep(e1, *GRID, settings=settings, progress=kill_one)
    assert seen == [(n, n) for n in range(ROWS + 1)]
    assert largest_difference(table, undisturbed[0]) < 1e-9
    assert table.mesh_error == pytest.approx(undisturbed[1].mesh_error, rel=1e-6)
    assert table.interpolation_error == pytest.approx(undisturbed[1].interpolation_error, rel=1e-6)
    assert report.failed == report.reused_rows == 0
    assert report.cpu_seconds > 0.3 * undisturbed[1].cpu_seconds, "the workers' time is counted"
    with distributed.Client(cluster) as client:
        client.wait_for_workers(2, timeout=LONG)
        assert set(client.run(os.getpid).values()) != set(workers.values()), "one was really killed"


def test_finished_rows_need_no_cluster(e1, undisturbed, tmp_path: Path) -> None:
    """Rows are keyed by what determines them, not by where they were solved."""
    sweep(e1, *GRID, settings=dataclasses.replace(FAST, cache=tmp_path))
    elsewhere = dataclasses.replace(FAST, cache=tmp_path, resume=True, scheduler="tcp://127.0.0.1:1")
    table, report = sweep(e1, *GRID, settings=elsewhere)
    assert report.reused_rows == ROWS
    assert largest_difference(table, undisturbed[0]) == 0


def test_lost_workers_are_said_and_rows_kept(e1, cluster, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The last test of the cluster: both leave."""
    monkeypatch.setattr(jobs, "PATIENCE", 0.3)

    def leave(done: int, total: int) -> None:
        if done == 1:
            cluster.scale(0)
            end = time.monotonic() + LONG
            while cluster.scheduler.workers:  # else they might solve all rows before they go
                assert time.monotonic() < end, "the workers do not leave"
                time.sleep(0.02)

    settings = dataclasses.replace(FAST, scheduler=cluster.scheduler_address, cache=tmp_path, resume=True)
    with pytest.raises(ComputationError, match=r"no worker of the cluster tcp://.* is left.*--resume"):
        sweep(e1, *GRID, settings=settings, progress=leave)
    kept = len(list(tmp_path.glob("*.npz")))
    assert 1 <= kept < ROWS
    monkeypatch.setattr(jobs, "FIRST_WORKER", 0.3)
    with pytest.raises(InputError, match=r"has no workers; start one with 'dask worker tcp://"):
        sweep(e1, *GRID, settings=settings)
    assert sweep(e1, *GRID, settings=dataclasses.replace(settings, scheduler=None))[1].reused_rows == kept


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:{port}", "nonsense://here:1", "nonsense", ""])
def test_address_without_scheduler_is_an_input_error(e1, address: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(jobs, "CONNECT", 0.5)
    with socket.socket() as taken:  # a port where nobody listens
        taken.bind(("127.0.0.1", 0))
        address = address.format(port=taken.getsockname()[1])
        with pytest.raises(InputError, match=r"no scheduler answers at '.*' within 0\.5 s; give the address"):
            sweep(e1, *GRID, settings=dataclasses.replace(FAST, scheduler=address))


def test_missing_library_is_an_input_error(e1, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match=r"not installed; install msl-fem\[cluster\]"):
        sweep(e1, *GRID, settings=dataclasses.replace(FAST, scheduler="tcp://127.0.0.1:8786"))
