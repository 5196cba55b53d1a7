"""A magnet as boxes with a coil round one of them: what the solver in three dimensions takes, and its grid."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from msl_fem.computing.arrays import Array
from msl_fem.magnetics.three_d.coenergy_law import CoenergyCurves
from msl_fem.magnetics.three_d.hexahedra import integration_points
from msl_fem.magnetics.three_d.scalar_potential import PotentialProblem
from msl_fem.magnetics.three_d.tensor_grid import SizeNear, TensorGrid, graded_planes

Interval = tuple[float, float]
Flags = NDArray[np.bool_]
GROWTH = 0.9  # of an element's length, over the distance from where it must be short
ORDER = 2


@dataclass(frozen=True)
class Box:
    """A box of one material, its sides in m; `iron` is an index, -1 in air. A later box covers an earlier one."""

    iron: int
    x: Interval
    y: Interval
    z: Interval

    def holds(self, x: Array, y: Array, z: Array) -> Flags:
        """Whether points lie inside."""
        inside = np.ones(x.shape, dtype=bool)
        for values, (low, high) in ((x, self.x), (y, self.y), (z, self.z)):
            inside &= (values > low) & (values < high)
        return inside


@dataclass(frozen=True)
class Racetrack:
    """A coil round a rectangle of x and z, from `clearance` to `clearance + width` away from it; lengths in m.

    Its corners are arcs about the rectangle's. `height` is its interval of y.
    """

    x: Interval
    z: Interval
    clearance: float
    width: float
    height: Interval
    turns: float

    def current_potential(self, x: Array, y: Array, z: Array) -> Array:
        """T_0 in y at 1 A, in 1/m, at points: full inside the coil, falling through it, nothing outside its height.

        Its curl is the density of the turns, N over width and height, along the coil's rounds.
        """
        share = np.clip((self.clearance + self.width - self._away(x, z)) / self.width, 0.0, 1.0)
        low, high = self.height
        return np.where((y > low) & (y < high), self.turns / (high - low) * share, 0.0)

    def has_turns(self, x: Array, y: Array, z: Array) -> Flags:
        """Whether points lie in the coil."""
        away = self._away(x, z) - self.clearance
        low, high = self.height
        inside: Flags = (away > 0) & (away < self.width) & (y > low) & (y < high)
        return inside

    def _away(self, x: Array, z: Array) -> Array:
        """Distance from the rectangle."""
        return np.hypot(_beyond(x, self.x), _beyond(z, self.z))


@dataclass(frozen=True)
class TwoRacetracks(Racetrack):
    """Two coils, one above the other round the same rectangle, that bear `currents` (A) where one coil bears 1 A."""

    other: Racetrack
    currents: tuple[float, float]

    def current_potential(self, x: Array, y: Array, z: Array) -> Array:
        """T_0 in y of both at their currents, in 1/m times A, at points."""
        one, two = super().current_potential(x, y, z), self.other.current_potential(x, y, z)
        return self.currents[0] * one + self.currents[1] * two

    def has_turns(self, x: Array, y: Array, z: Array) -> Flags:
        """Whether points lie in one of the coils."""
        inside: Flags = super().has_turns(x, y, z) | self.other.has_turns(x, y, z)
        return inside


def _beyond(values: Array, interval: Interval) -> Array:
    low, high = interval
    return np.maximum(np.maximum(low - values, values - high), 0.0)


@dataclass(frozen=True, eq=False)
class BoxModel:
    """What is solved: boxes in a box of air, whose faces are flux lines; lengths in m.

    Attributes
    ----------
    boxes : painted in order on air
    curves : the irons
    coil : the turns in what is solved
    air : x, y, z of all of it
    breaks : x, y, z of planes that the grid has beside those of boxes, coil and air
    near : x, y, z where the field is singular
    equipotential : the lowest x is a plane that the field crosses at right angles
    copies : of what is solved in the whole magnet
    polar : a body of revolution: x is the radius, z the angle in rad, of the boxes and of the coil
    """

    boxes: tuple[Box, ...]
    curves: CoenergyCurves
    coil: Racetrack
    air: tuple[Interval, Interval, Interval]
    breaks: tuple[tuple[float, ...], ...]
    near: tuple[tuple[SizeNear, ...], ...]
    equipotential: bool = False
    copies: int = 4
    polar: bool = False

    def grid(self, refinement: float) -> TensorGrid:
        """The grid, `refinement` times as fine as the sizes ask."""
        x, y, z = (self._planes(axis, refinement) for axis in range(3))
        return TensorGrid((x, y, z), ORDER)

    def _planes(self, axis: int, refinement: float) -> Array:
        sides = [side for box in self.boxes for side in (box.x, box.y, box.z)[axis]]
        planes = np.array([*sides, *self._coil_planes(axis), *self.breaks[axis]])
        low, high = self.air[axis]
        within = planes[(planes > low) & (planes < high)]
        return graded_planes([low, *within, high], self.near[axis], growth=GROWTH, refinement=refinement)

    def _coil_planes(self, axis: int) -> tuple[float, ...]:
        coil = self.coil
        if axis == 1:
            return coil.height
        low, high = (coil.x, coil.z)[axis // 2]
        reach = coil.clearance, coil.clearance + coil.width
        return (*(low - r for r in reach), *(high + r for r in reach))

    def problem(self, refinement: float) -> PotentialProblem:
        """The problem on the grid of a refinement."""
        grid = self.grid(refinement)
        centres = grid.centres()
        iron = np.full(grid.volumes.size, -1, dtype=np.int64)
        for box in self.boxes:
            iron[box.holds(*centres)] = box.iron
        source = self.coil.current_potential(*grid.points(integration_points(grid.order)[0]))
        held = np.zeros(grid.nodes, dtype=bool)
        if self.equipotential:
            held[0] = True
        else:
            held[-1, -1, -1] = True  # phi is known but for a constant
        return PotentialProblem(grid, iron, self.curves, source, held.ravel(), self.polar)
