"""What the reduction asks of the full solver: states near a guess, their slopes, the field without current."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.magnetics.reduced.reduced_model import FieldPoints
from msl_fem.magnetics.solver.magnetostatics import FieldModel, FieldSolution, NewtonSettings, solve_field

ROUGH = NewtonSettings(tolerance=3e-2)
ALONE = NewtonSettings(kept=4)
"""Of a field whose slopes nobody asks."""


@dataclass(frozen=True, eq=False)
class PointNumbers:
    """Of one state, per unit depth in the plane: flux linkages (coil,), and dW/dq at the given potential."""

    flux_linkage: Array
    energy_slope: float


class FullField:
    """A discretised section with one or more coils, on a tangent of its own.

    Parameters
    ----------
    model : the section's
    sources : (n_dof,) of each coil
    """

    def __init__(self, model: FieldModel, sources: Sequence[Array]) -> None:
        self.model = model.with_turns({})
        self.sources = tuple(sources)

    def solve(self, points: FieldPoints, n: int, start: Array, settings: NewtonSettings | None = None) -> FieldSolution:
        """The field at the n-th point from a potential nearby; raises NotConverged."""
        self._drive(points, n)
        return solve_field(self.model, 1.0, float(points.coordinate[n]), start=start, settings=settings)

    def newton_steps(self, points: FieldPoints, n: int, start: Array) -> Array:
        """(n_dof,) the potential after a full step of Newton's, and one more with the same factors."""
        self._drive(points, n)
        gradient, data = self.model.assemble(start, float(points.coordinate[n]))
        self.model.tangent.factor(data)
        after = start - self.model.tangent.substitute(gradient - self.model.source)
        gradient, _ = self.model.assemble(after, float(points.coordinate[n]))
        return after - self.model.tangent.substitute(gradient - self.model.source)

    def responses(self, coordinate: float, potential: Array) -> tuple[Array, ...]:
        """dA/dq and dA/di of each coil, by substitution with the factors at hand."""
        first, _ = self.model.strip_products(potential, coordinate)
        return tuple(self.model.tangent.substitute(np.stack([-first, *self.sources])))

    def without_field(self, coordinate: float) -> tuple[Array, tuple[Array, ...]]:
        """The values of the tangent without current; there dA/di of each coil, and its derivative along q."""
        nothing = np.zeros(self.model.n_dof)
        _, data = self.model.assemble(nothing, coordinate)
        self.model.tangent.factor(data)
        slopes = self.model.tangent.substitute(np.stack(self.sources))
        turns = [self.responses(coordinate, slope)[0] for slope in slopes]
        return data, (*slopes, *turns)

    def numbers(self, coordinate: float, potential: Array) -> PointNumbers:
        """What a potential says."""
        first, _ = self.model.strip_products(potential, coordinate)
        flux = np.array([source @ potential for source in self.sources])
        return PointNumbers(flux, float(potential @ first) / 2)

    def _drive(self, points: FieldPoints, n: int) -> None:
        load = np.zeros(self.model.n_dof)
        for current, source in zip(points.currents[n], self.sources, strict=True):
            load += current * source
        self.model.source = load
