"""The runner of jobs by itself: answers in order, failures never kept, resume, and what may be forked."""

import ast
import os
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
from interrupted_jobs import Number, Squares

from msl_fem.computing import jobs
from msl_fem.computing.jobs import Executor, failures, run_jobs
from msl_fem.computing.row_cache import Arrays, RowCache


class FailingSquares(Squares):
    """Negative numbers fail."""

    def solve(self, row: Number) -> Arrays:
        if row.value < 0:
            return {"failed": np.array(f"{row.value:g} is negative")}
        return {"square": np.array(row.value**2), "process": np.array(os.getpid())}


ROWS = [Number(3.0, 1), Number(-1.0, 5), Number(2.0, 3)]


@pytest.mark.parametrize("workers", [1, 2])
def test_answers_are_in_order_and_failures_are_named_and_not_kept(workers: int, tmp_path: Path) -> None:
    told: list[tuple[int, int]] = []
    cache = RowCache(tmp_path / "rows")
    answers = run_jobs(
        FailingSquares(),
        ROWS,
        executor=Executor(workers),
        cache=cache,
        key="squares",
        progress=lambda done, total: told.append((done, total)),
    )
    assert [float(answers[n]["square"]) for n in (0, 2)] == [9.0, 4.0]
    assert failures(answers) == ["-1 is negative"]
    assert told == [(n, 3) for n in range(4)]
    assert len(list(cache.folder.glob("*.npz"))) == 2
    elsewhere = {int(answers[n]["process"]) for n in (0, 2)} - {os.getpid()}
    assert bool(elsewhere) == (workers > 1)


def test_kept_answers_are_taken_for_the_same_job_and_row_alone(tmp_path: Path) -> None:
    cache = RowCache(tmp_path)

    def reused(key: str, rows: list[Number]) -> list[bool]:
        answers = run_jobs(FailingSquares(), rows, executor=Executor(), cache=cache, key=key, resume=True)
        return ["reused" in answer for answer in answers]

    assert reused("squares", ROWS) == [False, False, False]
    assert reused("squares", [*ROWS, Number(5.0)]) == [True, False, True, False]
    assert reused("other squares", ROWS) == [False, False, False]


def test_costly_rows_come_first() -> None:
    assert jobs.costliest_first([0, 1, 2], ROWS) == [1, 2, 0]


@pytest.mark.skipif(os.name != "posix" or not Path("/proc").is_dir(), reason="forks on Linux alone")
def test_a_process_of_several_threads_is_not_forked() -> None:
    """A lock that another thread holds would never be released in the copy."""
    assert jobs._start_method() == ("fork" if threading.active_count() == 1 else "forkserver")
    held = threading.Event()
    other = threading.Thread(target=held.wait)
    other.start()
    try:
        assert jobs._start_method() == "forkserver"
        answers = run_jobs(FailingSquares(), ROWS, executor=Executor(2))
        assert float(answers[0]["square"]) == 9.0
    finally:
        held.set()
        other.join()


def script_of_jobs(*arguments: str) -> subprocess.CompletedProcess[str]:
    script = Path(__file__).with_name("interrupted_jobs.py")
    return subprocess.run([sys.executable, str(script), *arguments], capture_output=True, text=True, timeout=120)


@pytest.mark.skipif(sys.platform != "linux", reason="forks on Linux alone")
def test_interrupted_anywhere_it_ends() -> None:
    """Also where libraries hold locks that their threads wait for: one run in thousands hung, until it was killed."""
    done = script_of_jobs()
    ends = ast.literal_eval(done.stdout)
    assert set(ends) <= {0, 130}, done.stderr
    assert ends[130] > 40


def test_an_idle_process_that_is_killed_does_not_leave_the_other_waiting() -> None:
    assert script_of_jobs("killed").stdout.startswith("a worker process of the sweep died")
