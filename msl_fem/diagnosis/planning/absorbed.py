"""What of a cause's change a re-fit of the believed parameters makes up for."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.diagnosis.likelihood import Likelihood, jacobian_columns
from msl_fem.diagnosis.problem import Points
from msl_fem.diagnosis.runs import prepared_runs
from msl_fem.diagnosis.separation import Measure, beside_a_run
from msl_fem.diagnosis.unknowns import fixed_of
from msl_fem.plant.effects import EffectValues
from msl_fem.prediction import BELIEVED, ModelHypothesis, run_data
from msl_fem.record import Record

STEP = 1e-4  # in tolerances, of a measured number's slope


@dataclass(frozen=True, eq=False)
class Left:
    """What a re-fit leaves of a change.

    Attributes
    ----------
    absorbed : share of the change, in units of the noise over all channels
    by_channel : noncentrality of each channel, what is left over the noise squared and summed
    """

    absorbed: float
    by_channel: dict[str, float]

    @property
    def noncentrality(self) -> float:
        return sum(self.by_channel.values())


class BelievedRefit:
    """The believed parameters about a planned record, within their tolerances: its columns are computed once.

    The re-fit is that of the linear model about the belief: least squares of the change over the noise, and of the
    parameters over their tolerances (the starts of the runs with them). With `every` the zeros and gains of the
    instruments and the table's error are unknown too, as in a diagnosis.
    """

    def __init__(self, record: Record, belief: ModelHypothesis, *, every: bool = False) -> None:
        runs = [run_data(record, run) for run in record.runs_of("fit")]
        self.record, self.belief = record, belief
        self.likelihood, self.unknowns = prepared_runs(belief, runs, record.tolerance)
        if not every:
            kept = tuple(p for p in self.unknowns.believed if p[0] in BELIEVED or p[0] in belief.known)
            self.unknowns = replace(self.unknowns, believed=kept, n_table=0)
            self.likelihood = replace(self.likelihood, problem=replace(self.likelihood.problem, table_error=None))
        nothing = np.zeros(self.unknowns.size)
        base = self.likelihood.spectra(Points.of(self.unknowns, nothing[None]))[0]
        self.columns = jacobian_columns(self.likelihood, self.unknowns, nothing, np.arange(nothing.size), base)

    @cached_property
    def _inverse(self) -> Array:
        return np.asarray(np.linalg.inv(self.columns.T @ self.columns + np.eye(self.unknowns.size)))

    def change(self, other: Record) -> Array:
        """(n_number,) of the fit runs' readings in another record less those in this, over the noise."""
        return self.likelihood.transformed(
            [
                [np.atleast_2d(other.run(run.name)[name] - run[name]) for name in self.likelihood.problem.channels(n)]
                for n, run in enumerate(self.record.runs_of("fit"))
            ]
        )[0]

    def moved(self, z: Array, effects: EffectValues | None) -> Array:
        """What the unknowns at z take from the readings where these effects are there, (n_number,) over the noise, all
        orders of it; `columns @ z` is the first. Not finite where the model does not bear it."""
        unknowns = replace(self.unknowns, fixed=fixed_of(replace(self.belief, effects=effects)))
        at, none = self.likelihood.spectra(Points.of(unknowns, np.array([z, np.zeros(z.size)])))
        return np.asarray(at - none)

    def left(self, change: Array) -> Left:
        """What stays of a change (n_number,) once the parameters are fitted to it."""
        z = -self._inverse @ (self.columns.T @ change)
        rest = change + self.columns @ z
        whole, kept = float(change @ change), float(rest @ rest + z @ z)
        absorbed = 1 - np.sqrt(min(kept / whole, 1.0)) if whole > 0 else 0.0
        return Left(float(absorbed), by_channel(self.likelihood, rest))

    def with_measure(self, change: Array, measure: Measure, effects: EffectValues) -> float:
        """Noncentrality of a change where a number is measured beside the runs, effects and all."""
        row, target = self.measured_row(measure), np.append(change, self.measured_change(measure, effects))
        columns = np.vstack([self.columns, row])
        z = -np.linalg.solve(columns.T @ columns + np.eye(row.size), columns.T @ target)
        rest = target + columns @ z
        return float(rest @ rest + z @ z)

    def measured_row(self, measure: Measure) -> Array:
        """(n_unknown,) of a measured number less the model's, over its sigma, as the columns of the readings are."""
        base = self._measured(measure, np.zeros(self.unknowns.size))
        moved = np.array([self._measured(measure, z) for z in STEP * np.eye(self.unknowns.size)])
        return np.asarray(-(moved - base) / STEP)

    def measured_change(self, measure: Measure, effects: EffectValues) -> float:
        """By how much effects, all that there are, change a measured number, over its sigma."""
        nothing = np.zeros(self.unknowns.size)
        return self._measured(measure, nothing, effects) - self._measured(measure, nothing)

    def measured_moved(self, measure: Measure, z: Array, effects: EffectValues | None) -> float:
        """What the unknowns at z take from a measured number, over its sigma, where these effects are there."""
        nothing = np.zeros(self.unknowns.size)
        return self._measured(measure, nothing, effects) - self._measured(measure, z, effects)

    @property
    def channels(self) -> list[str]:
        """Columns whose noise is known, which a fit therefore compares."""
        return self.likelihood.channel_names

    def measures(self) -> Sequence[Measure]:
        """What can be measured beside a run."""
        return tuple(beside_a_run(self.likelihood.problem))

    def _measured(self, measure: Measure, z: Array, effects: EffectValues | None = None) -> float:
        vector = self.unknowns.effect_vector(z) if effects is None else effects.vector()
        return measure.value(self.unknowns.factors(z), z[self.unknowns.table_rows], vector) / measure.sigma


def by_channel(likelihood: Likelihood, values: Array) -> dict[str, float]:
    """Sum of squares of numbers (n_number,) by channel, all runs together."""
    found: dict[str, float] = {}
    for name, part in channel_parts(likelihood):
        found[name] = found.get(name, 0.0) + float(values[part] @ values[part])
    return found


def channel_parts(likelihood: Likelihood) -> Iterator[tuple[str, slice]]:
    """Each channel of each piece, and its places among the numbers."""
    at = 0
    for piece, (run, _) in enumerate(likelihood.problem.pieces):
        n = 2 * likelihood.bands.lines[piece]
        for name in likelihood.problem.channels(run):
            yield name, slice(at, at + n)
            at += n
