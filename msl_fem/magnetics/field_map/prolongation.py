"""A potential of one polynomial degree written in a higher one on the same mesh: where Newton's iteration starts."""

import numpy as np
from scipy import sparse

from msl_fem.magnetics.solver.magnetostatics import FieldModel


def prolongation(coarse: FieldModel, fine: FieldModel) -> sparse.csr_matrix:
    """The matrix (n_dof of `fine`, n_dof of `coarse`) that reproduces a potential exactly; both on one mesh.

    Degrees of freedom are values at points, so a row holds the coarse element's functions at the fine one's point.
    """
    dofs = fine.basis.element_dofs  # (local, element)
    place = np.full(fine.n_dof, -1)
    place[dofs.ravel()] = np.arange(dofs.size)
    element = place % dofs.shape[1]
    mapping = coarse.basis.mapping
    at = mapping.invF(fine.basis.doflocs[:, :, None], tind=element)
    n = np.arange(fine.n_dof)
    values, columns = [], []
    for k in range(coarse.basis.Nbfun):
        values.append(np.asarray(coarse.basis.elem.gbasis(mapping, at, k, tind=element)[0])[:, 0])
        columns.append(coarse.basis.element_dofs[k, element])
    rows = np.tile(n, len(values))
    return sparse.csr_matrix(
        (np.concatenate(values), (rows, np.concatenate(columns))), shape=(fine.n_dof, coarse.n_dof)
    )
