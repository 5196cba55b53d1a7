"""A field solution as a VTU file, for ParaView and its like."""

from pathlib import Path

import meshio
import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.files.whole_file import whole_file
from msl_fem.magnetics.field.magnet_field import MagnetField
from msl_fem.magnetics.solver.magnetostatics import FieldSolution
from msl_fem.magnetics.solver.postprocess import triangle_flux_density
from msl_fem.magnetics.three_d.boxes import BoxModel
from msl_fem.magnetics.three_d.scalar_potential import PotentialSolution


def write_vtu(field: MagnetField, solution: FieldSolution, path: Path) -> None:
    """The half section with A_z (Wb/m, at the corners), B (T, mean of each triangle), region's index; solid: not air.

    Raises
    ------
    InputError : the folder cannot be written
    """
    model = field.model
    mesh = model.mesh
    x, y = mesh.at_gap(solution.gap)
    potential = solution.potential[model.basis.nodal_dofs[0]]
    b = triangle_flux_density(model, solution)
    cells = [("triangle", mesh.triangles.T)]
    solid = np.zeros(mesh.region.size, dtype=np.int32)
    solid[mesh.elements(*model.irons, *field.section.turns_density)] = 1
    data = meshio.Mesh(
        np.column_stack([x, y, np.zeros_like(x)]),
        cells,
        point_data={"A_z": potential},
        cell_data={
            "B": [np.column_stack([*b, np.zeros_like(b[0])])],
            "region": [mesh.region.astype(np.int32)],
            "solid": [solid],
        },
    )
    _write(data, path)


def write_solid_vtu(model: BoxModel, solution: PotentialSolution, path: Path) -> None:
    """The boxes that were solved with phi (A, at the corners), B (T) and H (A/m), means of each box, along x, y and z.

    `iron` is the iron's index, -1 in air; `turns` is 1 where the coil lies.

    Raises
    ------
    InputError : the folder cannot be written
    """
    problem, state = solution.problem, solution.state
    grid = problem.grid
    points = np.stack(np.meshgrid(*grid.planes, indexing="ij"), axis=-1).reshape(-1, 3)
    number = np.arange(points.shape[0]).reshape([planes.size for planes in grid.planes])
    low, high = slice(None, -1), slice(1, None)
    round_trip = [(low, low), (high, low), (high, high), (low, high)]
    corners = [number[x, y, z].ravel() for z in (low, high) for x, y in round_trip]
    step = grid.order
    mean = [np.einsum("cqk,q->ck", values, problem.elements.weights) for values in (state.flux_density, state.strength)]
    if problem.polar:
        radius, height, angle = points.T
        points = np.column_stack([radius * np.cos(angle), height, radius * np.sin(angle)])
        mean = [_cartesian(values, grid.centres()[2]) for values in mean]
    data = meshio.Mesh(
        points,
        [("hexahedron", np.column_stack(corners))],
        point_data={"phi": solution.potential.reshape(grid.nodes)[::step, ::step, ::step].ravel()},
        cell_data={
            "B": [mean[0]],
            "H": [mean[1]],
            "iron": [problem.iron.astype(np.int32)],
            "turns": [model.coil.has_turns(*grid.centres()).astype(np.int32)],
        },
    )
    _write(data, path)


def _cartesian(vectors: Array, angle: Array) -> Array:
    """Vectors (n, 3) along the radius, y and the angle, at angles (n,), along x, y and z."""
    along, y, around = vectors.T
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.column_stack([cosine * along - sine * around, y, sine * along + cosine * around])


def _write(data: meshio.Mesh, path: Path) -> None:
    with whole_file(path) as partial:
        meshio.write(partial, data, file_format="vtu")
