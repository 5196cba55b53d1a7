"""Fields of both sides at one position of the armature, for all pairs of currents: rows for a sweep's processes."""

from dataclasses import dataclass

import numpy as np

from msl_fem.actuator import Actuator
from msl_fem.computing.arrays import Array
from msl_fem.computing.blas_threads import one_blas_thread
from msl_fem.computing.jobs import Arrays
from msl_fem.errors import NotConverged
from msl_fem.magnetics.kinds.accuracy import Accuracy
from msl_fem.magnetics.kinds.e_core import MagnetField, field_of
from msl_fem.magnetics.kinds.two_sided import TwoSidedField, TwoSidedPosition

SIGNS = (1.0, -1.0)
"""Of side 2's current: aiding, opposing."""


@dataclass(frozen=True)
class PairRow:
    """Both gaps (m) and the currents (A) of each side, 0 first; nan for a level that is not reached.

    `check` names the pair that is solved with one polynomial degree more as well; None for no pair.
    """

    gaps: tuple[float, float]
    currents: tuple[tuple[float, ...], tuple[float, ...]]
    check: int | None = None

    @property
    def cost(self) -> int:
        """The number of pairs."""
        return 2 * len(self.currents[0]) * len(self.currents[1])


@dataclass(frozen=True)
class PairJob:
    """What a process needs: the actuator and the accuracy."""

    actuator: Actuator
    accuracy: Accuracy

    def solver(self) -> "PairSolver":
        """The solver of the job's positions."""
        return PairSolver(self)


class PairSolver:
    """Solves all pairs of a position; the meshes are its own."""

    def __init__(self, job: PairJob) -> None:
        self.job = job

    @one_blas_thread
    def solve(self, row: PairRow) -> Arrays:
        """Forces and flux linkages; `failed` says why there are none.

        `net_force` and `flux` (side) are (sign, n, n) over side 1's and side 2's current, `single_force` and
        `single_flux` (side, n) of one magnet without the other core; `checked` the same quantities of one pair with
        one degree more, see `_checked`.
        """
        actuator, accuracy = self.job.actuator, self.job.accuracy
        try:
            both = TwoSidedField(actuator, TwoSidedPosition(*row.gaps), accuracy=accuracy)
            singles = [field_of(actuator, gap, accuracy=accuracy) for gap in row.gaps]
            arrays = _pairs(both, row) | _singles(singles, row)
            if row.check is not None:
                finer = [single.refined() for single in singles]
                arrays["checked"] = _checked(both.refined(), finer, row, row.check)
        except NotConverged as err:
            return {"failed": np.array(str(err))}
        return arrays


def _pairs(field: TwoSidedField, row: PairRow) -> Arrays:
    first, second = row.currents
    shape = (len(SIGNS), len(first), len(second))
    net, flux = np.zeros(shape), np.zeros((2, *shape))
    for s, sign in enumerate(SIGNS):
        for j, i_1 in enumerate(first):
            start = None
            for k, i_2 in enumerate(second):
                if s and (j == 0 or k == 0):  # a sign of one magnet alone changes nothing but that of its flux
                    net[s, j, k], flux[:, s, j, k] = net[0, j, k], flux[:, 0, j, k]
                    continue
                if not (j or k):
                    continue
                if np.isnan(i_1) or np.isnan(i_2):
                    net[s, j, k], flux[:, s, j, k] = np.nan, np.nan
                    continue
                found, solution = field.solve(i_1, sign * i_2, start=start)
                start = solution.potential
                net[s, j, k] = found.net_force
                flux[:, s, j, k] = found.flux_linkage_1, sign * found.flux_linkage_2
    return {"net_force": net, "flux": flux}


def _singles(fields: list[MagnetField], row: PairRow) -> Arrays:
    force, flux = np.zeros((2, len(row.currents[0]))), np.zeros((2, len(row.currents[0])))
    for side, (field, gap, currents) in enumerate(zip(fields, row.gaps, row.currents, strict=True)):
        start = None
        for n, current in enumerate(currents[1:], start=1):
            if np.isnan(current):
                force[side, n] = flux[side, n] = np.nan
                continue
            solution = field.solve(current, gap, start=start)
            start = solution.potential
            found = field.quantities(solution)
            force[side, n], flux[side, n] = found.force, found.flux_linkage
    return {"single_force": force, "single_flux": flux}


def _checked(field: TwoSidedField, singles: list[MagnetField], row: PairRow, n: int) -> Array:
    """(5,) net force aiding, opposing, of side 1 alone in the same section, and of each single magnet."""
    i_1, i_2 = (currents[n] for currents in row.currents)
    forces = [field.solve(*pair)[0].net_force for pair in ((i_1, i_2), (i_1, -i_2), (i_1, 0.0))]
    alone = [
        single.quantities(single.solve(current, gap)).force
        for single, current, gap in zip(singles, (i_1, i_2), row.gaps, strict=True)
    ]
    return np.array([*forces, *alone])
