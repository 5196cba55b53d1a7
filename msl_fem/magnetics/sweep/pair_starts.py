"""Where the field of both sides lies nearly: what each does alone, and what both have in common by a coarse mesh.

With c the coarse mesh's potentials and a the accurate one's, A = a(i_1, 0) + a(0, i_2) + c(i_1, i_2) - c(i_1, 0) -
c(0, i_2): what a mesh gets wrong of either side falls out of the difference, as in the table itself. It misses the
field by some 2e-3 in the energy norm, the coarse field alone by 6e-2.
"""

from functools import lru_cache

import numpy as np
from scipy import sparse

from msl_fem.computing.arrays import Array
from msl_fem.magnetics.field.pair_field import PairField
from msl_fem.magnetics.solver.magnetostatics import NewtonSettings
from msl_fem.magnetics.solver.prolongation import elements_of_dofs, prolongation_map, value_map
from msl_fem.magnetics.sweep.expected_fields import ExpectedFields

ROUGH = NewtonSettings(tolerance=1e-3)
KEPT = 256  # of the coarse mesh's fields, those of sides alone among them


class PairStarts:
    """Starts of an accurate field of both sides.

    Parameters
    ----------
    field, common : on the accurate and on the coarse mesh
    alone : of the accurate one with side 2 alone on; None where nothing is known but the coarse fields
    """

    def __init__(self, field: PairField, common: PairField, alone: ExpectedFields | None) -> None:
        self._common, self._alone = common, alone
        self._prolongation = prolongation_map(common.model, field.model)
        self._mirror = mirror_map(field)
        self._coarse = lru_cache(KEPT)(self._coarse_field)

    def at(self, position: float, current_1: float, current_2: float) -> Array:
        """(n_dof,) a potential near the field's."""
        both = self._coarse(position, current_1, current_2)
        if self._alone is None:
            return np.asarray(self._prolongation @ both)
        apart = self._coarse(position, current_1, 0.0) + self._coarse(position, 0.0, current_2)
        first = self._mirror @ self._alone.potential(-position, current_1)
        return np.asarray(first + self._alone.potential(position, current_2) + self._prolongation @ (both - apart))

    def _coarse_field(self, position: float, current_1: float, current_2: float) -> Array:
        start = None
        if current_1 and current_2:
            start = self._coarse(position, current_1, 0.0) + self._coarse(position, 0.0, current_2)
        return self._common.solve(position, current_1, current_2, start=start, settings=ROUGH).potential


def mirror_map(field: PairField) -> sparse.csr_matrix:
    """(n_dof, n_dof) from a potential to that with the sides exchanged: its mirror image in the armature's middle."""
    model = field.model
    points, n_element = model.basis.doflocs, model.mesh.region.size
    below = model.mesh.points[1].min() + model.mesh.points[1].max()  # twice the height of the plane of reflection
    image = np.stack([points[0], below - points[1]])
    return value_map(model, image, (elements_of_dofs(model) + n_element // 2) % n_element)
