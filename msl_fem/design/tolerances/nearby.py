"""Magnets near the nominal one without a field of their own: adjoint solutions of the nominal one's fields.

A number Q(A, p) of the field A, for which R(A, p) = 0, is at another p, with the adjoint T a = dQ/dA, T = dR/dA,

    Q(p) = Q(A, p) - a . R(A, p) + O(|dA|^2),

A the nominal field throughout (e.g. Giles and Pierce, Flow, Turbulence and Combustion 65, 2000). So each number takes
one substitution with the nominal field's factors, for all dimensions; each magnet only a residual on its mesh. Central
differences are the exact derivatives but for the square of their step, as what is left out is even in it.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.computing.row_cache import Arrays
from msl_fem.magnetics.field.magnet_field import MagnetField
from msl_fem.magnetics.field_map.readings import sheet_flux_density
from msl_fem.magnetics.solver.magnetostatics import FieldSolution


@dataclass(frozen=True, eq=False)
class SectionRoot:
    """A nominal field at which a section's mean flux density in the iron is near a level.

    Attributes
    ----------
    level : T
    slope : T/A of the mean along the current
    """

    solution: FieldSolution
    section: str
    level: float
    slope: float


class NearbyMagnets:
    """Answers about magnets near the nominal one.

    Parameters
    ----------
    nominal : its field, whose mesh is moved with the dimensions
    roots : by section, level and gap; None where the level is not reached
    point : the nominal field where force and flux linkage are asked for
    """

    def __init__(
        self, nominal: MagnetField, roots: Mapping[tuple[int, int, int], SectionRoot | None], point: FieldSolution
    ) -> None:
        self._roots, self._point = roots, point
        self._adjoint = {
            place: _substituted(nominal, root.solution, _mean_gradient(nominal, root))[0]
            for place, root in roots.items()
            if root is not None
        }
        pull, _ = nominal.model.strip_products(point.potential, point.gap)
        self._force, self._flux = _substituted(nominal, point, pull, nominal.model.source)

    def answer(self, field: MagnetField, off: float) -> Arrays:
        """Of a magnet with a field on the moved mesh, all of whose gaps are larger by `off`.

        `section_current` A (n_section, n_level, n_gap), nan where the nominal magnet does not reach a level, `force` N
        and `flux_linkage` Wb at the point.
        """
        currents = np.full(np.max(list(self._roots), axis=0) + 1, np.nan)
        for place, root in self._roots.items():
            if root is not None:
                a = root.solution.potential
                mean = field.probes.section_flux_density(a)[root.section].mean
                mean -= float(self._adjoint[place] @ _residual(field, root.solution, off))
                currents[place] = root.solution.current + (root.level - mean) / root.slope
        return {"section_current": currents} | self._at_point(field, off)

    def _at_point(self, field: MagnetField, off: float) -> Arrays:
        a, residual = self._point.potential, _residual(field, self._point, off)
        pull, _ = field.model.strip_products(a, self._point.gap + off)
        scale = field.probes.scale
        force = scale * float(a @ pull / 2 - self._force @ residual)
        flux = scale * float(field.model.source @ a - self._flux @ residual)
        return {"force": np.array(force), "flux_linkage": np.array(flux + field.leakage * self._point.current)}


def _residual(field: MagnetField, solution: FieldSolution, off: float) -> Array:
    gradient, _ = field.model.assemble(solution.potential, solution.gap + off)
    return gradient - solution.current * field.model.source


def _substituted(field: MagnetField, solution: FieldSolution, *sides: Array) -> list[Array]:
    """Right-hand sides divided by the tangent at a solution."""
    field.model.tangent.factor(solution.tangent)
    return [field.model.tangent.substitute(side) for side in sides]


def _mean_gradient(field: MagnetField, root: SectionRoot) -> Array:
    """(n_dof,) derivative of the section's mean with respect to the potential."""
    cut, a = field.probes.cuts[root.section], root.solution.potential
    x, y = cut.along_x @ a, cut.along_y @ a
    ones, zeros = np.ones_like(x), np.zeros_like(x)
    iron = field.model.irons[cut.region].iron
    _, slopes = sheet_flux_density(iron, (x, y), [(ones, zeros), (zeros, ones)])
    by_x, by_y = (cut.weight * slope[1:-1] for slope in slopes)
    return np.asarray(cut.along_x[1:-1].T @ by_x + cut.along_y[1:-1].T @ by_y)
