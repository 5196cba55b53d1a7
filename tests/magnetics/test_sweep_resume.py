"""Sweeps as processes of their own: killed, interrupted, robbed of a worker, and two at once."""

import contextlib
import json
import os
import signal
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT
from ready_commands import Command

from msl_fem.actuator import load_actuator
from msl_fem.cli.app import app
from msl_fem.cli.output import run_guarded
from msl_fem.computing.row_cache import RowCache
from msl_fem.errors import NotConverged
from msl_fem.magnetics.field.magnet_field import MagnetField
from msl_fem.magnetics.sweep.table_sweep import SweepSettings, sweep
from msl_fem.table.magnetic_table import MagneticTable, read_table

E1 = ROOT / "geometries" / "e1.toml"
GAPS, CURRENTS = np.geomspace(2e-4, 8e-4, 7), np.array([1.0, 2.0, 4.0, 8.0])
ROWS = 7 + 6 + 3
LONG = 300.0  # s: nobody waits so long, a loaded machine takes what it takes
needs_proc = pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="finds child processes in /proc")


def arguments(output: Path, *more: str) -> list[str]:
    gaps, currents = ",".join(f"{g * 1e3:.17g}" for g in GAPS), ",".join(f"{i:g}" for i in CURRENTS)
    grid = ["--gaps", f"{gaps} mm", "--currents", f"{currents} A"]
    return ["table", str(E1), *grid, "--accuracy", "fast", "-o", str(output), "--json", *more]


def start(output: Path, *more: str) -> Command:
    """In a session of its own, so that a signal to its group is Ctrl-C in its terminal."""
    return Command(arguments(output, *more), output.parent)


def finish(process: Command) -> dict[str, object]:
    out, err = process.communicate(timeout=LONG)
    assert process.returncode == 0, err
    return dict(json.loads(out))


def rows_of(output: Path) -> set[Path]:
    return set(output.with_name(f".{output.name}.rows").glob("*.npz"))


def wait_until(condition: Callable[[], bool]) -> None:
    end = time.monotonic() + LONG
    while not condition():
        assert time.monotonic() < end, "nothing happened"
        time.sleep(0.002)


def children(pid: int) -> set[int]:
    return {int(n) for n in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()}


def pool_workers(pid: int) -> set[int]:
    """Children that solve rows: copies of the process, under its command."""
    command = Path(f"/proc/{pid}/cmdline").read_bytes()
    found = set()
    for n in children(pid):
        with contextlib.suppress(OSError):  # it has just gone
            found |= {n} if Path(f"/proc/{n}/cmdline").read_bytes() == command else set()
    return found


def alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except OSError:
        return False


def leftovers(folder: Path) -> list[str]:
    return sorted(p.name for p in folder.rglob("*.part"))


@pytest.fixture(scope="module")
def undisturbed() -> MagneticTable:
    gaps = [float(f"{g * 1e3:.17g}") * 1e-3 for g in GAPS]
    return sweep(load_actuator(E1), gaps, CURRENTS, settings=SweepSettings(accuracy="fast"))[0]


def largest_difference(one: MagneticTable, other: MagneticTable) -> float:
    """Of all arrays, each relative to its largest value."""
    pairs = [({**one.nodes, **one.extras}[k], v) for k, v in {**other.nodes, **other.extras}.items()]
    return max(float(np.abs(a - b).max() / np.abs(b).max()) for a, b in pairs)


@needs_proc
def test_killed_sweep_goes_on_and_solves_no_finished_row_twice(tmp_path, undisturbed) -> None:
    output = tmp_path / "t.nc"
    process = start(output, "--workers", "2")
    wait_until(lambda: len(rows_of(output)) >= 3)
    helpers = children(process.pid)
    process.send_signal(signal.SIGKILL)
    process.communicate(timeout=LONG)
    assert process.returncode == -signal.SIGKILL
    wait_until(lambda: not any(map(alive, helpers)))
    assert not output.exists()
    kept = {path: path.stat().st_mtime_ns for path in rows_of(output)}
    assert 3 <= len(kept) < ROWS
    stamps: dict[Path, int] = {}
    process = start(output, "--workers", "2", "--resume")
    while process.poll() is None:  # the rows vanish at the end, so look while it runs
        for path in kept:
            with contextlib.suppress(FileNotFoundError):
                stamps[path] = path.stat().st_mtime_ns
        time.sleep(0.01)
    assert finish(process)["reused_rows"] == len(kept)
    assert stamps == kept, "no finished row was written anew"
    assert largest_difference(read_table(output), undisturbed) < 1e-9
    assert rows_of(output) == set()


@needs_proc
@pytest.mark.parametrize(
    ("workers", "rows", "number"),
    [("1", 2, signal.SIGINT), ("2", 2, signal.SIGINT), ("2", 0, signal.SIGINT), ("2", 2, signal.SIGTERM)],
)
def test_interrupted_ends_with_130_and_one_line_that_says_how_to_go_on(
    workers, rows, number, tmp_path, undisturbed, msl_fem
) -> None:
    """In the middle, and while the worker processes start; by Ctrl-C, or as systems and batch queues end jobs."""
    output = tmp_path / "t.nc"
    process = start(output, "--workers", workers)
    wait_until(lambda: len(rows_of(output)) >= rows and (workers == "1" or len(pool_workers(process.pid)) == 2))
    helpers = children(process.pid)
    os.killpg(process.pid, number)
    out, err = process.communicate(timeout=LONG)
    assert process.returncode == 130
    assert out == ""
    said = [line for line in err.splitlines() if line.strip() and not line.startswith("field solutions")]
    assert len(said) == 1, err
    assert "interrupted" in said[0]
    assert "--resume" in said[0]
    wait_until(lambda: not any(map(alive, helpers)))
    assert not output.exists()
    assert leftovers(tmp_path) == []
    kept = len(rows_of(output))
    assert kept >= rows
    if number == signal.SIGTERM:  # once: a killed one goes on alike, above
        assert msl_fem(*arguments(output, "--resume", "--workers", "1")).json["reused_rows"] == kept
        assert largest_difference(read_table(output), undisturbed) < 1e-9


@needs_proc
def test_sigterm_to_the_command_alone_ends_its_processes_at_once(tmp_path) -> None:
    output = tmp_path / "t.nc"
    process = start(output, "--workers", "2")
    wait_until(lambda: len(rows_of(output)) >= 1)
    helpers = children(process.pid)
    process.send_signal(signal.SIGTERM)
    process.communicate(timeout=LONG)
    assert process.returncode == 130
    assert not any(map(alive, helpers))
    assert leftovers(tmp_path) == []


@needs_proc
def test_worker_killed_in_the_pool_is_one_clear_error_and_keeps_rows(tmp_path) -> None:
    output = tmp_path / "t.nc"
    process = start(output, "--workers", "2")
    wait_until(lambda: len(rows_of(output)) >= 2)
    os.kill(min(pool_workers(process.pid)), signal.SIGKILL)
    out, err = process.communicate(timeout=LONG)
    assert process.returncode == 1
    assert out == ""
    said = [line for line in err.splitlines() if line.strip() and not line.startswith("field solutions")]
    assert len(said) == 1, err
    assert said[0].startswith("failed: a worker process of the sweep died")
    assert "--resume" in said[0]
    assert not output.exists()
    assert len(rows_of(output)) >= 2


def test_two_sweeps_into_one_file_at_once_leave_it_whole(tmp_path, undisturbed, msl_fem) -> None:
    """One in a process of its own, which has begun, and one here."""
    output = tmp_path / "same.nc"
    process = start(output, "--workers", "1", "--resume")
    wait_until(lambda: len(rows_of(output)) >= 1)
    assert msl_fem(*arguments(output, "--workers", "1", "--resume")).json["failed"] == 0
    assert finish(process)["failed"] == 0
    assert largest_difference(read_table(output), undisturbed) < 1e-9
    assert [p.name for p in tmp_path.iterdir()] == ["same.nc"], "no rows, no partial files"


def test_failed_point_is_named_at_the_end_and_all_else_is_kept(tmp_path, capfd, monkeypatch, undisturbed) -> None:
    """One point of the grid does not converge: exit 1 names it, once its row's other points and all rows are done."""
    output = tmp_path / "t.nc"
    solve = MagnetField.solve
    solved: list[tuple[float, float]] = []

    def stand_in(self, i, g, *, start=None):
        if i == 4.0 and abs(g - GAPS[3]) < 1e-9:
            raise NotConverged("made to fail")
        solved.append((i, g))
        return solve(self, i, g, start=start)

    with monkeypatch.context() as patch:
        patch.setattr(MagnetField, "solve", stand_in)
        assert run_guarded(lambda: app(arguments(output, "--workers", "1"))) == 1
    err = capfd.readouterr().err
    assert "failed: 1 points of the sweep did not converge (4 A at 0.4 mm); leave them out of the grid" in err
    assert max(g for _, g in solved) == pytest.approx(GAPS[-1])
    assert any(i > 4 and abs(g - GAPS[3]) < 1e-9 for i, g in solved), "the rest of its row is solved too"
    assert not output.exists()
    assert len(rows_of(output)) >= ROWS - 2, "all rows but those with the failed point"
    assert run_guarded(lambda: app(arguments(output, "--workers", "1", "--resume"))) == 0
    assert largest_difference(read_table(output), undisturbed) < 1e-9


def test_what_a_killed_sweep_left_unfinished_goes_with_the_rows(tmp_path) -> None:
    """But not what another sweep is writing this moment."""
    cache = RowCache(tmp_path / "rows")
    cache.put("a", {"force": np.array([1.0])})
    old, new = (tmp_path / "rows" / f".{key}.npz.x1.part" for key in "bc")
    old.write_bytes(b"half")
    new.write_bytes(b"half")
    os.utime(old, (time.time() - 3600,) * 2)
    cache.clear()
    assert [p.name for p in (tmp_path / "rows").iterdir()] == [new.name]
    new.unlink()
    cache.clear()
    assert not (tmp_path / "rows").exists()


def test_workers_and_scheduler_exclude_each_other(tmp_path, capfd) -> None:
    asked = arguments(tmp_path / "t.nc", "--workers", "2", "--scheduler", "tcp://127.0.0.1:1")
    assert run_guarded(lambda: app(asked)) == 2
    assert "give --workers or --scheduler, not both" in capfd.readouterr().err
