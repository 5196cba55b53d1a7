"""The field of a solution where it is asked for: at points, over cuts through the iron, and where an iron ends."""

import numpy as np
from numpy.typing import NDArray

from msl_fem.computing.arrays import Array
from msl_fem.magnetics.section import Line, Section
from msl_fem.magnetics.solver.postprocess import SectionFluxDensity
from msl_fem.magnetics.three_d.boxes import BoxModel
from msl_fem.magnetics.three_d.hexahedra import respond_everywhere
from msl_fem.magnetics.three_d.scalar_potential import PotentialSolution
from msl_fem.magnetics.three_d.tensor_grid import basis_slopes, basis_values
from msl_fem.materials.constants import MU_0

Indices = NDArray[np.int64]
ALONG, DEEP = 40, 20  # points of a cut along its line and to the stack's end
ON_TAIL = 0.01  # of an iron's volume


def field_at(model: BoxModel, solution: PotentialSolution, points: Array) -> tuple[Array, Array, Indices]:
    """H in A/m and B in T (n_point, 3), and the iron's index (-1: air), at points (n_point, 3) in m.

    Between two boxes the one that begins there counts. In a body of revolution the vectors are along the radius, y
    and the angle.
    """
    grid = solution.problem.grid
    if model.polar:
        x, y, z = points.T
        points = np.column_stack([np.hypot(x, z), y, np.arctan2(z, x)])
    cells, values, slopes = [], [], []
    for axis, planes in enumerate(grid.planes):
        cell = np.clip(np.searchsorted(planes, points[:, axis], side="right") - 1, 0, planes.size - 2)
        size = grid.sizes[axis][cell]
        share = (points[:, axis] - planes[cell]) / size
        cells.append(cell)
        values.append(basis_values(grid.order, share))
        slopes.append(basis_slopes(grid.order, share) / size[:, None])
    local = np.arange(grid.order + 1)
    nodes = [cell[:, None] * grid.order + local for cell in cells]
    at = solution.potential.reshape(grid.nodes)[
        nodes[0][:, :, None, None], nodes[1][:, None, :, None], nodes[2][:, None, None, :]
    ]
    strength = np.zeros((points.shape[0], 3))
    for axis in range(3):
        x, y, z = (slopes[k] if k == axis else values[k] for k in range(3))
        strength[:, axis] = -np.einsum("na,nb,nc,nabc->n", x, y, z, at, optimize=True)
    if model.polar:
        strength[:, 2] /= points[:, 0]
    strength[:, 1] += solution.current * model.coil.current_potential(*points.T)
    iron = solution.problem.iron.reshape(grid.cells)[tuple(cells)]
    flux = respond_everywhere(strength[:, None, :], iron, model.curves)[1][:, 0]
    return strength, flux, iron


def flux_density_over_cuts(
    model: BoxModel, solution: PotentialSolution, section: Section
) -> dict[str, SectionFluxDensity]:
    """Name of each of the section's cuts to |B| in the sheets over its area, as deep as the stack or all around."""
    return {cut.name: _over_cut(model, solution, cut, section.depth) for cut in section.cuts}


def _over_cut(model: BoxModel, solution: PotentialSolution, cut: Line, depth: float) -> SectionFluxDensity:
    along, deep = (np.arange(ALONG) + 0.5) / ALONG, (np.arange(DEEP) + 0.5) / DEEP * depth / 2
    deep = np.zeros(1) if model.polar else deep
    start, end = np.array(cut.start), np.array(cut.end)
    line = np.repeat(start + along[:, None] * (end - start), deep.size, axis=0)
    area = line[:, 0] if model.polar else np.ones(line.shape[0])
    b = _in_sheets(model, *field_at(model, solution, np.column_stack([line, np.tile(deep, ALONG)])))
    return SectionFluxDensity(float(np.average(b, weights=area)), float(b.max()))


def _in_sheets(model: BoxModel, strength: Array, flux: Array, iron: Indices) -> Array:
    """|B| in T in the sheets, from H and the mean B (..., 3) of the stack, the flux in the plane of the sheets."""
    share = model.curves.stacking[iron]
    size, field = np.linalg.norm(flux, axis=-1), np.linalg.norm(strength[..., :2], axis=-1)
    return (size - (1 - share) * MU_0 * field) / share


def irons_on_saturation_tail(model: BoxModel, solution: PotentialSolution) -> tuple[int, ...]:
    """Indices of the irons of which more than 1 % of the volume lies beyond the last point of their curve."""
    problem, curves = solution.problem, model.curves
    beyond = []
    for index in range(curves.stacking.size):
        cells = problem.iron == index
        state = solution.state
        b = _in_sheets(model, state.strength[cells], state.flux_density[cells], problem.iron[cells, None])
        over = problem.weights[cells][b > curves.b[curves.start[index + 1] - 1]].sum()
        if over > ON_TAIL * problem.weights[cells].sum():
            beyond.append(index)
    return tuple(beyond)
