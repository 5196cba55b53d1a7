"""A potential taken over from one mesh or degree to another of the same section: a start for Newton's iteration.

Nested iteration (e.g. Briggs, Henson and McCormick, A Multigrid Tutorial, 2000, ch. 3).
"""

import numpy as np
from scipy import sparse

from msl_fem.computing.arrays import Array
from msl_fem.computing.compiled import compiled
from msl_fem.magnetics.solver.magnetostatics import FieldModel
from msl_fem.materials.curves import Indices

ON_EDGE = -1e-9  # the least of a point's barycentric coordinates in a triangle that holds it


def prolongation_map(coarse: FieldModel, fine: FieldModel) -> sparse.csr_matrix:
    """(n_fine, n_coarse) a potential's values at the degrees of freedom of another mesh or degree, made at one gap."""
    points = fine.basis.doflocs
    if coarse.mesh is fine.mesh:
        return value_map(coarse, points, elements_of_dofs(fine))
    mesh = coarse.mesh
    return value_map(coarse, points, elements_at(points, mesh.points[:, mesh.triangles]))


def elements_of_dofs(model: FieldModel) -> Indices:
    """(n_dof,) an element that has the degree of freedom."""
    dofs = model.basis.element_dofs
    elements = np.empty(model.n_dof, dtype=np.int64)
    elements[dofs] = np.arange(dofs.shape[1])
    return elements


def value_map(model: FieldModel, points: Array, elements: Indices) -> sparse.csr_matrix:
    """The map (n_point, n_dof) to A at points (2, n_point) in the elements given, at the mesh's gap."""
    basis = model.basis
    local = basis.mapping.invF(points[:, :, None], tind=elements)[:, :, 0]
    values = np.concatenate(
        [np.broadcast_to(basis.elem.lbasis(local, k)[0], elements.shape) for k in range(basis.Nbfun)]
    )
    rows = np.tile(np.arange(elements.size), basis.Nbfun)
    return sparse.csr_matrix((values, (rows, basis.element_dofs[:, elements].ravel())), (elements.size, model.n_dof))


@compiled
def elements_at(points: Array, corners: Array) -> Indices:
    """(n_point,) which of the triangles with corners (2, 3, n) holds a point (2, n_point), or is nearest to holding it.

    The search begins at the triangle of the point before.
    """
    found = np.zeros(points.shape[1], dtype=np.int64)
    n, last = corners.shape[2], 0
    for p in range(points.shape[1]):
        most = -np.inf
        for k in range(n):
            e = (last + k) % n
            ax, ay = corners[0, 1, e] - corners[0, 0, e], corners[1, 1, e] - corners[1, 0, e]
            bx, by = corners[0, 2, e] - corners[0, 0, e], corners[1, 2, e] - corners[1, 0, e]
            x, y = points[0, p] - corners[0, 0, e], points[1, p] - corners[1, 0, e]
            area = ax * by - ay * bx
            first, second = (x * by - y * bx) / area, (ax * y - ay * x) / area
            least = min(first, second, 1.0 - first - second)
            if least > most:
                most, found[p] = least, e
            if least >= ON_EDGE:
                break
        last = found[p]
    return found
