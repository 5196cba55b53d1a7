"""Force of a solution in three dimensions by two routes: virtual work of a layer of air, and the stress on a plane.

A displacement v = (0, w, 0) of the mesh, w = 1 on what moves and 0 on what stands, changes H by -grad(w) times the
gradient of phi along y, so that the derivative of the discrete coenergy at constant current is (Coulomb and Meunier,
IEEE Trans. Magn. 20, 1984)

    F_y = integral of w* dw/dy + B . grad(w) (T_0y - H_y),

exact as the potential makes the coenergy least. Maxwell's stress on the plane y = const. is mu_0 (H_y^2 - H^2/2).
"""

from dataclasses import dataclass

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.magnetics.three_d.hexahedra import basis_gradient, integration_points, potential_gradient
from msl_fem.magnetics.three_d.scalar_potential import PotentialSolution
from msl_fem.magnetics.three_d.tensor_grid import TensorGrid
from msl_fem.materials.constants import MU_0

Interval = tuple[float, float]


@dataclass(frozen=True, eq=False)
class DisplacementWeight:
    """w as a product of functions of x, y and z, straight between the grid's planes, where their values are given."""

    x: Array
    y: Array
    z: Array

    def at_points(self, grid: TensorGrid) -> Array:
        """dw/dx, dw/dy and dw/dz at the integration points, (n_cell, n_point, 3) 1/m."""
        share = integration_points(grid.order)[0]
        factors = []
        for axis, nodal in enumerate((self.x, self.y, self.z)):
            rise = np.diff(nodal)
            value = nodal[:-1, None] + rise[:, None] * share[:, axis]
            slope = np.broadcast_to((rise / grid.sizes[axis])[:, None], value.shape)
            factors.append((value, slope))
        parts = []
        for axis in range(3):
            x, y, z = (factors[k][int(k == axis)] for k in range(3))
            parts.append(np.einsum("iq,jq,kq->ijkq", x, y, z).reshape(-1, share.shape[0]))
        return np.stack(parts, axis=-1)


def below(grid: TensorGrid, layer: Interval) -> DisplacementWeight:
    """What lies below a layer of air (its interval of y) moves up, what lies above stands."""
    low, high = layer
    y = np.clip((high - grid.planes[1]) / (high - low), 0.0, 1.0)
    return DisplacementWeight(np.ones(grid.planes[0].size), y, np.ones(grid.planes[2].size))


def between_layers(grid: TensorGrid, lower: Interval, upper: Interval) -> DisplacementWeight:
    """What lies between two layers of air (their intervals of y) moves up, what lies below and above stands."""
    y = np.interp(grid.planes[1], (*lower, *upper), (0.0, 1.0, 1.0, 0.0))
    return DisplacementWeight(np.ones(grid.planes[0].size), y, np.ones(grid.planes[2].size))


def virtual_work(solution: PotentialSolution, weight: DisplacementWeight) -> float:
    """The force in y in N on what moves, of the part that is solved."""
    problem, state = solution.problem, solution.state
    return problem.integral(_work_density(solution, weight, state.coenergy_density))


def _work_density(solution: PotentialSolution, weight: DisplacementWeight, coenergy_density: Array) -> Array:
    slope = weight.at_points(solution.problem.grid)
    pulled = solution.current * solution.problem.source - solution.state.strength[..., 1]
    across = np.einsum("cqk,cqk->cq", solution.state.flux_density, slope)
    return coenergy_density * slope[..., 1] + across * pulled


def force_by_current(solution: PotentialSolution, weight: DisplacementWeight) -> float:
    """dF/di in N/A of the part that is solved, where all of the layer is air without turns."""
    field, change = solution.state.strength, solution.by_current
    slope = weight.at_points(solution.problem.grid)
    product = np.einsum("cqk,cqk->cq", field, change) * slope[..., 1]
    product -= np.einsum("cqk,cqk->cq", change, slope) * field[..., 1]
    product -= np.einsum("cqk,cqk->cq", field, slope) * change[..., 1]
    return MU_0 * solution.problem.integral(product)


def stress_on_plane(solution: PotentialSolution, layer: Interval) -> float:
    """The force in y in N on what lies below a layer of air, by the stress on the plane in its middle box.

    The plane ends on planes of symmetry and flux lines, which bear no force in y.
    """
    problem = solution.problem
    grid = problem.grid
    inside = np.flatnonzero((grid.planes[1][:-1] >= layer[0]) & (grid.planes[1][1:] <= layer[1]))
    row = int(inside[inside.size // 2])
    points, weights = integration_points(grid.order)
    flat = points.copy()
    flat[:, 1] = 0.5
    elements = problem.elements._replace(gradient=basis_gradient(grid.order, flat))
    field = -potential_gradient(solution.potential, elements)
    area = np.ones(field.shape[:2])
    if problem.polar:
        area = grid.points(flat)[0]
        field[..., 2] /= area
    shaped, area = (values.reshape(*grid.cells, *values.shape[1:])[:, row] for values in (field, area))
    stress = MU_0 * area * (shaped[..., 1] ** 2 - np.sum(shaped**2, axis=-1) / 2)
    return float(np.einsum("ikq,i,k,q->", stress, grid.sizes[0], grid.sizes[2], weights))
