"""Where the next field of a row is expected: by the tangents of the fields before it."""

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
