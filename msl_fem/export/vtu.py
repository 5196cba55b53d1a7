"""A field solution as a VTU file, for ParaView and its like."""

from pathlib import Path

import meshio
import numpy as np

from msl_fem.files.whole_file import whole_file
from msl_fem.magnetics.field.magnet_field import MagnetField
from msl_fem.magnetics.solver.magnetostatics import FieldSolution
from msl_fem.magnetics.solver.postprocess import triangle_flux_density


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
    with whole_file(path) as partial:
        meshio.write(partial, data, file_format="vtu")
