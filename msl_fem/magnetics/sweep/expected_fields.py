"""Fields of one coil where they are asked, by a reduced model: starts of the full solver."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.magnetics.reduced.reduced_model import FieldPoints, ReducedModel


@dataclass(frozen=True, eq=False)
class ExpectedFields:
    """Potentials in a reduced space.

    Attributes
    ----------
    vectors : (n_dof, N) the space's functions
    states : coordinate (m) and current (A), which is above 0, to the state (N,)
    """

    vectors: Array
    states: Mapping[tuple[float, float], Array]

    def potential(self, coordinate: float, current: float) -> Array:
        """(n_dof,) at a gap, or a position; odd in the current."""
        if not current:
            return np.zeros(len(self.vectors))
        return np.asarray(np.sign(current) * (self.vectors @ self.states[coordinate, abs(current)]))


def expected_fields(model: ReducedModel, asked: Iterable[tuple[float, float]]) -> ExpectedFields:
    """The potentials at coordinates and currents, by a reduced model of one coil."""
    points = np.array(sorted({(coordinate, abs(current)) for coordinate, current in asked}))
    found = model.solve(FieldPoints(points[:, 0], points[:, 1:]))
    states = {(q, i): state for (q, i), state in zip(points.tolist(), found.states, strict=True)}
    return ExpectedFields(model.basis.vectors, states)
