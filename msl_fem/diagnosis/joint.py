"""Runs and the rows of a static map of one magnet as one likelihood: table, scale and gap are the same unknowns."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from msl_fem.diagnosis.fit import Fit, Likelihood, Weights
from msl_fem.diagnosis.prepare import visited
from msl_fem.diagnosis.simulator import Points
from msl_fem.diagnosis.static_maps import StaticLikelihood, prepared_map, why_no_map
from msl_fem.diagnosis.table_error import TableError, Visited, table_error
from msl_fem.diagnosis.unknowns import Unknowns
from msl_fem.prediction import KernelPlant, ModelHypothesis, RunData
from msl_fem.record import Record

Array = NDArray[np.float64]
NOTE = "the rows of the static map count beside the runs"


@dataclass(frozen=True, eq=False)
class JointLikelihood(Likelihood):
    """The numbers of the runs, then those of the map; `static` may be missing. Its table error is that of `problem`."""

    static: StaticLikelihood | None

    def of_runs(self, points: Points) -> Array:
        """`spectra` of the runs alone."""
        return super().spectra(points)

    def spectra(self, points: Points) -> Array:
        """Residuals of the runs in the frequency domain over their white sigma, then the map's; (n_row, n_number)."""
        found = self.of_runs(points)
        return found if self.static is None else np.hstack([found, self.static.spectra(points)])

    @property
    def labels(self) -> NDArray[np.intp]:
        """(n_number,) the band of each number of the runs, then the channel of each of the map."""
        own, n = super().labels, self.bands.n_band * len(super().channel_names)
        return own if self.static is None else np.concatenate([own, self.static.labels + n])

    @property
    def ceilings(self) -> Array:
        """(n_label,) of the runs' bands, then of the map."""
        own = super().ceilings
        return own if self.static is None else np.concatenate([own, self.static.ceilings])

    def excess_of_runs(self, found: Fit) -> dict[str, float]:
        """Channel to RMS residual over the noise's sigma."""
        return super().excess(found)

    def excess(self, found: Fit) -> dict[str, float]:
        """Channel to RMS residual over the noise, of runs and map."""
        made = self.excess_of_runs(found)
        if self.static is not None:
            made |= self.static.excess(replace(found, residual=found.residual[self._of_runs :]))
        return made

    def runs_part(self, found: Fit) -> tuple[Likelihood, Fit]:
        """The runs alone, and a fit as they see it."""
        n = self._of_runs
        weights = Weights(found.weights.density, found.weights.root[:n], found.weights.nats)
        alone = replace(found, residual=found.residual[:n], jacobian=found.jacobian[:n], weights=weights)
        return Likelihood(self.problem, self.bands, self.substeps), alone

    @property
    def _of_runs(self) -> int:
        """How many numbers the runs have."""
        return 2 * sum(n * len(self.problem.channels(run)) for run, n in enumerate(self.bands.lines))


def joined(
    record: Record, belief: ModelHypothesis, likelihood: Likelihood, unknowns: Unknowns
) -> tuple[Likelihood, Unknowns]:
    """The likelihood of runs with a record's static map beside it, where there is one that a fit can use."""
    if record.static is None or belief.table is None or why_no_map(record.static):
        return likelihood, unknowns
    static = prepared_map(record, belief.table)[0]
    error = common_error(record, belief, likelihood.problem.plant, (likelihood.problem.runs, static))
    problem = replace(likelihood.problem, table_error=error)
    static = replace(static, problem=replace(static.problem, table_error=error))
    both = JointLikelihood(problem, likelihood.bands, likelihood.substeps, static)
    return both, replace(unknowns, n_table=0 if error is None else len(error.modes))


def common_error(
    record: Record, belief: ModelHypothesis, plant: KernelPlant, data: tuple[Sequence[RunData], StaticLikelihood | None]
) -> TableError | None:
    """The table's error over all that runs and map visit."""
    (runs, static), tolerance = data, record.tolerance.table
    if belief.table is None or not tolerance:
        return None
    seen = visited(plant, runs)
    if static is not None:
        rows = static.measured.rows
        current, gap = np.abs(rows.current), rows.gap
        seen = Visited(
            (min(seen.current[0], float(current.min())), max(seen.current[1], float(current.max()))),
            (min(seen.gap[0], float(gap.min())), max(seen.gap[1], float(gap.max()))),
        )
    return table_error(belief.table, seen, tolerance=tolerance)
