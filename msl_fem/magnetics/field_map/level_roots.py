"""The smallest current at which a criterion takes a level, by Newton's iteration on field solutions."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from msl_fem.errors import NotConverged
from msl_fem.magnetics.field_map.readings import Potentials, Reader, Reading
from msl_fem.magnetics.kinds.e_core import MagnetField
from msl_fem.magnetics.solver.magnetostatics import FieldSolution, field_response
from msl_fem.materials.constants import MU_0

Array = NDArray[np.float64]
TOLERANCE = 1e-5
"""Of the current: the last Newton step, whose error is about its square; or the width of the bracket."""
MOST_SOLUTIONS = 60
FIRST_SHARE = 0.5  # of the current that drives the first level across both gaps, without iron
LARGEST_RISE = 2.0  # of the current, in a step into the unknown


@dataclass(frozen=True, eq=False)
class Point:
    """A field solution at a gap, its derivative dA/di, and what the criterion reads there."""

    solution: FieldSolution
    by_current: Array
    reading: Reading

    @property
    def current(self) -> float:
        return self.solution.current


class Root(NamedTuple):
    """The current of a level and the point next to it; nan where the level is not reached, with the last point."""

    current: float
    point: Point


class Climb:
    """The field of one gap along the current; every solution starts from the tangent of the nearest one known.

    The criterion rises with the current, and mostly ever slower as the iron saturates: Newton's iteration on the
    current, with the criterion's exact derivative, then comes from below and never passes the root. What does not
    behave so is bracketed.
    """

    def __init__(self, field: MagnetField, reader: Reader, gap: float) -> None:
        self.field, self.gap = field, gap
        self._reader = reader
        self.known: list[Point] = []
        self.newton_iterations = 0

    def at(self, current: float) -> Point:
        """The field at a current; raises NotConverged."""
        solution = self._solve(current)
        response = field_response(self.field.model, solution)
        potentials = Potentials(solution.potential, response.by_current, response.by_gap)
        point = Point(solution, response.by_current, self._reader(self.field.model, potentials))
        self.known.append(point)
        self.newton_iterations += len(solution.trail)
        return point

    def _solve(self, current: float) -> FieldSolution:
        if self.known:
            near = min(self.known, key=lambda point: abs(point.current - current))
            start = near.solution.potential + near.by_current * (current - near.current)
            try:
                return self.field.solve(current, self.gap, start=start)
            except NotConverged:
                pass
        return self.field.solve(current, self.gap)

    def root(self, level: float, most: float) -> Root:
        """The smallest current up to `most` at which the criterion takes the level.

        Where the criterion passes a level several times within one step along the current, which needs a section that
        unloads as the current rises, it may be a later one.

        Raises
        ------
        NotConverged : a field solution, or the search itself
        """
        low, high = self._bracket(level)
        guess = self._first(level) if low is None and high is None else self._next(level, low, high)
        last_step = np.inf
        for _ in range(MOST_SOLUTIONS):
            if high is None and guess >= most:
                if low is not None and low.current >= most:
                    return Root(np.nan, low)
                guess = most
            point = self.at(guess)
            left = level - point.reading.value
            low, high = (point, high) if left > 0 else (low, point)
            step = left / point.reading.current_slope if point.reading.current_slope > 0 else np.inf
            if abs(step) <= TOLERANCE * point.current and point.current + step <= most:
                return Root(point.current + step, point)
            if low is not None and high is not None and high.current - low.current <= TOLERANCE * high.current:
                return Root(_between(low, high, level), point)
            guess = point.current + step
            slow = abs(step) > 0.5 * last_step
            last_step = abs(step)
            if not _inside(guess, low, high) or (slow and high is not None):
                guess, last_step = self._next(level, low, high), np.inf
            elif high is None:
                guess = min(guess, LARGEST_RISE * point.current)
        raise NotConverged(
            f"no current that brings {level:g} T was found at gap {self.gap * 1e3:g} mm in {MOST_SOLUTIONS} field "
            "solutions; leave the gap or the level out, or choose another criterion"
        )

    def _bracket(self, level: float) -> tuple[Point | None, Point | None]:
        """The neighbours of the level's first crossing among the points known."""
        points = sorted(self.known, key=lambda point: point.current)
        above = next((k for k, point in enumerate(points) if point.reading.value >= level), len(points))
        return (points[above - 1] if above else None), (points[above] if above < len(points) else None)

    def _first(self, level: float) -> float:
        return FIRST_SHARE * level * 2 * self.gap / (MU_0 * self.field.magnet.coil.turns)

    def _next(self, level: float, low: Point | None, high: Point | None) -> float:
        """A current inside the bracket, by regula falsi kept off its ends, or beyond the last point known."""
        if high is None:
            assert low is not None, "a point is known"
            slope = low.reading.current_slope
            step = (level - low.reading.value) / slope if slope > 0 else np.inf
            return low.current + min(step, (LARGEST_RISE - 1) * low.current)
        start, value = (low.current, low.reading.value) if low is not None else (0.0, 0.0)
        share = (level - value) / max(high.reading.value - value, 1e-300)
        return start + min(max(share, 0.1), 0.9) * (high.current - start)


def _inside(current: float, low: Point | None, high: Point | None) -> bool:
    start = low.current if low is not None else 0.0
    return start < current and (high is None or current < high.current)


def _between(low: Point, high: Point, level: float) -> float:
    share = (level - low.reading.value) / (high.reading.value - low.reading.value)
    return low.current + share * (high.current - low.current)
