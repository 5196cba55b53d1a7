"""The flux that fringes out of a gap between two blocks of iron that end together, from a plane section of its own.

Two blocks of iron lie a gap apart, joined by an iron bridge at the left; a coil in the gap, along the bridge, drives a
magnetomotive force of 1 A across all of the gap to its right. The air beyond the right end holds the fringe.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from msl_fem.magnetics.solver.magnetostatics import FieldModel, solve_field
from msl_fem.magnetics.solver.mesh import MeshSize, triangulate
from msl_fem.magnetics.solver.section import Region, Section
from msl_fem.materials.constants import MU_0
from msl_fem.materials.material import linear_iron

Array = NDArray[np.float64]
PERMEABILITY = 1e7
SIZE = MeshSize(corner=0.02, gap=0.5, iron=1.0, growth=0.4)


@dataclass(frozen=True)
class EndTurns:
    """A rectangle of turns in front of the upper block's end, and its current in A (that of the gap is 1)."""

    x: tuple[float, float]
    y: tuple[float, float]
    current: float


@dataclass(frozen=True)
class EndSection:
    """Blocks of heights `upper` and `lower` that end at x = 0, the lower one's top at y = 0, a `gap` between; in m.

    With `mirror` the lower edge of the lower block is a plane of symmetry, which no flux crosses.
    """

    gap: float
    upper: float
    lower: float
    turns: EndTurns | None = None
    mirror: bool = False

    def excess(self, *, height: float | None = None) -> float:
        """Permeance beyond the end, per unit width and mu_0, of the lower block's flux.

        All of that flux, or only what ends below a height on the upper block's end face. The difference of A between
        two points is the flux that passes between them; within the gap the field is uniform.

        Raises
        ------
        ComputationError : the mesher failed
        """
        g, length = self.gap, 4 * self.gap
        bridge, coil = min(self.upper, self.lower), g / 2
        left = -length - coil
        far = 12 * (self.upper + self.lower + g)
        bottom = -self.lower if self.mirror else -far
        regions = [
            _box("air", left - bridge, bottom, far, far),
            _box("iron", left - bridge, g, 0, g + self.upper),
            _box("iron", left - bridge, -self.lower, 0, 0),
            _box("iron", left - bridge, 0, left, g),
            _box("gap", -length, 0, 0, g),
            _box("coil", left, 0, -length, g),
        ]
        turns = {"coil": 1 / (coil * g)}
        if self.turns is not None:
            (x0, x1), (y0, y1) = self.turns.x, self.turns.y
            regions.append(_box("turns", x0, y0, x1, y1))
            turns["turns"] = self.turns.current / ((x1 - x0) * (y1 - y0))
        corners = ((0, g, 1.0), (0, 0, 1.0), (0, g + self.upper, 0.2), (0, -self.lower, 0.2))
        section = Section(tuple(regions), corners, (), {"iron": ("", 1.0)}, turns, 1.0, g)
        model = FieldModel(
            triangulate(section, SIZE), {"iron": linear_iron(PERMEABILITY)}, turns_density=turns, order=3
        )
        potential = solve_field(model, 1.0, g).potential
        inside = _at_vertex(model, potential, -length, 0.0)
        outside = _on_side(model, potential, height + g) if height is not None else 0.0
        return abs(inside - outside) / MU_0 - length / g


def _box(name: str, x0: float, y0: float, x1: float, y1: float) -> Region:
    return Region(name, ((x0, y0), (x1, y0), (x1, y1), (x0, y1)))


def _at_vertex(model: FieldModel, potential: Array, x: float, y: float) -> float:
    points = model.mesh.points
    k = int(np.argmin(np.hypot(points[0] - x, points[1] - y)))
    return float(potential[model.basis.nodal_dofs[0, k]])


def _on_side(model: FieldModel, potential: Array, y: float) -> float:
    """The potential at a height of the end face x = 0, between its mesh points."""
    points = model.mesh.points
    on = np.flatnonzero(points[0] == 0.0)
    on = on[np.argsort(points[1, on])]
    return float(np.interp(y, points[1, on], potential[model.basis.nodal_dofs[0, on]]))
