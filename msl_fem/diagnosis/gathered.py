"""Simulations that several fits ask for at the same time, run together: a run costs a quarter in eight lanes of what it
costs alone."""

import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.diagnosis.problem import FitProblem, Points
from msl_fem.plant.effects import neutral_vector

Simulated = Callable[[Points], Array]
"""Points to spectra (n_row, n_number)."""
Item = TypeVar("Item")
Stepped = TypeVar("Stepped")


@dataclass(eq=False)
class _Asked:
    """What a fit waits for."""

    problem: FitProblem
    points: Points
    simulated: Simulated
    answer: Array | None = None
    error: BaseException | None = None

    @property
    def answered(self) -> bool:
        return self.answer is not None or self.error is not None


class GatheredRuns:
    """Where `count` fits meet, each in a thread of its own: once all that have not ended wait for simulations, those of
    one problem are run together, by so many `threads`. Between them `at_once` fits at most do their own sums: for each
    thread that multiplies matrices meanwhile BLAS holds some 30 MB. `by_itself` is for what a fit simulates on its own:
    of one fit at a time, for the memory's sake. What is here at the end is handed on: `ended` is told of it."""

    def __init__(
        self,
        count: int,
        *,
        at_once: int = 2,
        threads: int = 1,
        by_itself: "threading.Lock | None" = None,
        ended: "Callable[[GatheredRuns], None]" = lambda place: None,
    ) -> None:
        self._running, self.threads, self._ended = count, threads, ended
        self._turns = threading.Semaphore(at_once)
        self._asked: list[_Asked] = []
        self._condition = threading.Condition()
        self.by_itself = by_itself or threading.Lock()

    def takes_over(self, other: "GatheredRuns") -> None:
        """The threads of a place that all fits have left, and one turn more to do sums."""
        self.threads += other.threads
        self._turns.release()

    def spectra(self, problem: FitProblem, points: Points, simulated: Simulated) -> Array:
        """What `simulated` makes of these points, together with those of the other fits."""
        asked = _Asked(problem, points, simulated)
        self._turns.release()
        with self._condition:
            self._asked.append(asked)
            self._meet()
            self._condition.wait_for(lambda: asked.answered)
        self._turns.acquire()
        if asked.error is not None:
            raise asked.error
        assert asked.answer is not None
        return asked.answer

    @contextmanager
    def one_of_them(self) -> Iterator[None]:
        """A fit, or one after the other, from its begin to where it asks for nothing more."""
        self._turns.acquire()
        try:
            yield
        finally:
            self._turns.release()
            with self._condition:
                self._running -= 1
                self._meet()
                left = self._running == 0
            if left:
                self._ended(self)

    def _meet(self) -> None:
        if not self._asked or len(self._asked) < self._running:
            return
        waiting, self._asked = self._asked, []
        for problem in {id(asked.problem): asked.problem for asked in waiting}.values():
            _answer([asked for asked in waiting if asked.problem is problem])
        self._condition.notify_all()


_here = threading.local()


def gathered_here() -> GatheredRuns | None:
    """Where the fit of this thread meets others; None where it is alone."""
    return getattr(_here, "gathered", None)


def in_gatherings(
    step: Callable[[Item], Stepped], items: Sequence[Item], *, at_once: int, threads: int
) -> list[Stepped]:
    """A step of each item, so many of them at the same time; it comes to that of one after the other.

    They meet in as many places as there are threads: while those of one do their sums, others are simulated. A place
    that all have left leaves its threads to another one.
    """
    if not items:
        return []
    count = min(len(items), at_once)
    places = min(count, threads)
    by_itself, taking = threading.Lock(), threading.Lock()
    waiting = iter(range(len(items)))
    found: dict[int, Stepped] = {}

    def go_on(gathered: GatheredRuns) -> None:
        _here.gathered = gathered
        with gathered.one_of_them():
            while True:
                with taking:
                    n = next(waiting, None)
                if n is None:
                    return
                found[n] = step(items[n])

    def ended(place: GatheredRuns) -> None:
        with taking:
            running.remove(place)
            if running:
                running[0].takes_over(place)

    each = [
        GatheredRuns(
            len(range(place, count, places)),
            at_once=2 if places == 1 else 1,
            threads=threads // places,
            by_itself=by_itself,
            ended=ended,
        )
        for place in range(places)
    ]
    running = list(each)
    with ThreadPoolExecutor(count) as pool:
        list(pool.map(go_on, [each[n % places] for n in range(count)]))
    return [found[n] for n in range(len(items))]


def _answer(waiting: list[_Asked]) -> None:
    """Runs what is asked of one problem. Beside the effects, fits differ in none of their unknowns."""
    unknowns = replace(waiting[0].points.unknowns, effects=(), fixed=())
    rows = np.concatenate([asked.points.rows[:, : unknowns.size] for asked in waiting])
    effects = np.concatenate([_effects(asked.points) for asked in waiting])
    times = np.concatenate([asked.points.wanted for asked in waiting])
    starts = None
    if any(asked.points.starts is not None for asked in waiting):
        each = [asked.points.starts or asked.problem.starts(len(asked.points.rows)) for asked in waiting]
        starts = tuple(np.concatenate(own) for own in zip(*each, strict=True))
    try:
        found = waiting[0].simulated(Points(unknowns, rows, effects, times, starts))
    except BaseException as err:
        for asked in waiting:
            asked.error = err
        return
    ends = np.cumsum([len(asked.points.rows) for asked in waiting])
    for asked, part in zip(waiting, np.split(found, ends[:-1]), strict=True):
        asked.answer = part


def _effects(points: Points) -> Array:
    """(n_row, N_PARAMETER), neutral ones where there are none."""
    return np.tile(neutral_vector(), (len(points.rows), 1)) if points.effects is None else points.effects
