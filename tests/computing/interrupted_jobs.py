"""Runs jobs in two processes again and again, each time with Ctrl-C at another line of the libraries of threads.

Prints how the runs ended; a run that does not end prints where its threads are. With `killed`, runs once, and kills a
process that waits for rows. A script: only a process of one thread is forked.
"""

import faulthandler
import multiprocessing
import os
import signal
import sys
import threading
import time
from collections import Counter
from concurrent import futures
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np

from msl_fem.computing.jobs import Executor, run_jobs
from msl_fem.computing.row_cache import Arrays
from msl_fem.errors import ComputationError

PLACES = 48
HUNG, INTERRUPTED, DONE = 1, 130, 0
LIBRARIES = (str(Path(futures.__file__).parent), threading.__file__)


@dataclass(frozen=True)
class Number:
    value: float
    cost: int = 1


class Squares:
    """A job, and what solves it."""

    def solver(self) -> "Squares":
        return self

    def solve(self, row: Number) -> Arrays:
        return {"square": np.array(row.value**2)}


@dataclass
class Interrupter:
    """Counts the lines of the libraries that the main thread runs, and sends SIGINT at one of them."""

    at: int
    line: int = 0

    def __call__(self, frame: FrameType, event: str, argument: object) -> Any:
        return self.count if frame.f_code.co_filename.startswith(LIBRARIES) else None

    def count(self, frame: FrameType, event: str, argument: object) -> Any:
        if event == "line":
            self.line += 1
        if self.line == self.at:
            sys.settrace(None)
            signal.raise_signal(signal.SIGINT)
        return self.count


def interrupted_at(line: int) -> int:
    """How a run ended that was interrupted at a line, in a process of its own."""
    process = os.fork()
    if process:
        return os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])
    faulthandler.dump_traceback_later(20, exit=True)
    os._exit(run(Interrupter(line)))


def run(interrupter: Interrupter) -> int:
    sys.settrace(interrupter)
    try:
        run_jobs(Squares(), [Number(float(n)) for n in range(6)], executor=Executor(2))
    except KeyboardInterrupt:
        return INTERRUPTED
    finally:
        sys.settrace(None)
    return DONE


def idle_one_killed() -> str:
    """What is said of it. Whoever waits for rows holds the lock by which the other one would hear that it is over."""
    try:
        with Executor(2).start(Squares(), 2) as workers:
            time.sleep(0.2)
            for process in multiprocessing.active_children()[:1]:
                process.kill()
            while True:
                workers.wait([workers.submit(Number(1.0))])[0].result()
    except ComputationError as err:
        return str(err)


def interrupted_everywhere() -> dict[int, int]:
    """How many runs ended with which status."""
    whole = Interrupter(-1)
    assert run(whole) == DONE
    ends: Counter[int] = Counter()
    for line in range(1, whole.line, whole.line // PLACES):
        ends[interrupted_at(line)] += 1
        if ends[HUNG]:
            break
    return dict(ends)


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored in whatever a shell started in the background
    print(idle_one_killed() if "killed" in sys.argv else interrupted_everywhere())
