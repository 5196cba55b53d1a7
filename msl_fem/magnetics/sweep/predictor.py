"""Where the next field of a row is expected: by the tangents of the fields before it."""

from dataclasses import dataclass

from msl_fem.computing.arrays import Array
from msl_fem.computing.splines import hermite_cubic
from msl_fem.magnetics.solver.magnetostatics import FieldSolution


class RowPredictor:
    """Goes along the currents of a row.

    From one field by its tangent; from two by the cubic through both and their tangents, whose error goes with the
    fourth power of the step (Hermite's extrapolation).
    """

    def __init__(self) -> None:
        self._seen: list[tuple[float, Array, Array]] = []

    def take(self, current: float, solution: FieldSolution, slope: Array) -> None:
        """A field of the row, and its derivative along the current."""
        self._seen = [*self._seen[-1:], (current, solution.potential, slope)]

    def forget(self) -> None:
        """What was taken is no start for what follows."""
        self._seen = []

    def at(self, current: float) -> Array | None:
        """The potential (n_dof,) expected at a current; None where nothing is known."""
        if not self._seen:
            return None
        last, potential, slope = self._seen[-1]
        if len(self._seen) == 1:
            return potential + slope * (current - last)
        first, before, slope_before = self._seen[0]
        width = last - first
        slopes = width * slope_before, width * slope
        return hermite_cubic((before, potential), slopes, (current - first) / width)


@dataclass(frozen=True, eq=False)
class _Predicted:
    """A potential, its derivative along the current of side 1, and what the prediction along the row missed."""

    potential: Array
    slope: Array
    missed: Array | None


class RowsPredictor:
    """Goes along rows over the same currents of side 2, one after the other, each from its smallest current outwards.

    What a row's prediction missed in the row before, it misses again nearly, so that is added; where a row begins,
    the field of the row before is gone on from.
    """

    def __init__(self) -> None:
        self._current, self._found = 0.0, dict[float, _Predicted]()
        self.begin(0.0)

    def begin(self, current_1: float) -> None:
        """The next row, at a current of side 1."""
        self._step = current_1 - self._current
        self._before, self._found = self._found, {}
        self._along = {sign: RowPredictor() for sign in (1, -1)}
        self._current = current_1

    def at(self, current: float) -> Array | None:
        """The potential (n_dof,) expected at a current of side 2; None where nothing is known."""
        along, before = self._along[-1 if current < 0 else 1].at(current), self._before.get(current)
        if before is None:
            return along
        if along is None:
            return before.potential + self._step * before.slope
        return along if before.missed is None else along + before.missed

    def take(self, current: float, solution: FieldSolution, slopes: tuple[Array, Array]) -> None:
        """A field of the row, and its derivatives along both currents."""
        along = self._along[-1 if current < 0 else 1].at(current)
        missed = None if along is None else solution.potential - along
        self._found[current] = _Predicted(solution.potential, slopes[0], missed)
        for sign, predictor in self._along.items():
            if sign * current >= 0:
                predictor.take(current, solution, slopes[1])

    def forget(self, current: float) -> None:
        """What was taken on this current's side is no start for what follows."""
        self._along[-1 if current < 0 else 1].forget()
