"""Records whose runs a stable plant makes from its recorded commands: simulated from their starts, in free run."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.diagnosis.calibration import Calibration, calibration_of
from msl_fem.diagnosis.decision import Rule
from msl_fem.diagnosis.kind import ErrorSignal, Kind, Size
from msl_fem.diagnosis.likelihood import START, Fit, FitProblem, Likelihood, highest_line, make_bands
from msl_fem.diagnosis.next_experiment import Question, farther, separating
from msl_fem.diagnosis.outside import Dependence, dependences
from msl_fem.diagnosis.search import SearchStage
from msl_fem.diagnosis.static_maps import MAP_BESIDE, JointLikelihood, joined
from msl_fem.diagnosis.table_error import Visited, table_error
from msl_fem.diagnosis.unknowns import Unknowns
from msl_fem.diagnosis.variants import variables_of
from msl_fem.plant.effects import EffectValues
from msl_fem.prediction import ModelHypothesis, RunData, free_parameters, free_run, kernel_plant, measured_start
from msl_fem.prediction.free_run import counted, start_sigmas
from msl_fem.record import Record, Tolerance


@dataclass(frozen=True, eq=False)
class FreeRuns(Kind):
    """Free runs, and the rows of a static map beside them; `runs` are all, those held out too."""

    record: Record | None = None
    runs: tuple[RunData, ...] = ()

    prediction: ClassVar[str] = "free-run"

    def errors(self, belief: ModelHypothesis, fit: Fit | None) -> list[ErrorSignal]:
        signals = []
        for run in self.runs:
            readings = _readings(belief, run)
            signals += [ErrorSignal.of_run(run, name, run.measured[name] - readings[name]) for name in counted(run)]
        return signals

    def rule(self, rule: Rule) -> Rule:
        return rule

    def calibration(self, rule: Rule) -> tuple[Calibration | None, str]:
        assert self.record is not None
        problem = self.likelihood.problem
        return calibration_of(self.record, problem.plant.parameters, problem.runs, rule)

    def dependences(
        self, fit: Fit, belief: ModelHypothesis, *, few: bool = False, threads: int = 1
    ) -> list[Dependence]:
        return dependences(*self.likelihood.runs_part(fit), belief, few=few, threads=threads)

    def separating(self, stage: SearchStage, rivals: Sequence[str]) -> str:
        return separating(self._question, stage, rivals)

    def look_further(self, variables: Sequence[str]) -> str:
        return farther(self._question, variables)

    def variables(self) -> dict[str, Mapping[str, Array]]:
        return {run.name: variables_of(run) for run in self.runs}

    def sizes(self, belief: ModelHypothesis, effects: Sequence[str]) -> list[Size]:
        sizes = [_size(belief, self.runs, effect) for effect in effects]
        return [size for size in sizes if size is not None]

    @property
    def _question(self) -> Question:
        return Question(self.belief, self.likelihood.problem, self.unknowns.believed)


def free_runs(record: Record, belief: ModelHypothesis, runs: Sequence[RunData], *, threads: int = 1) -> FreeRuns:
    """A record of free runs, made ready; a static map that a fit can use stands beside its runs."""
    fitted = [run for run in runs if run.role == "fit"]
    likelihood, unknowns = prepared_runs(belief, fitted, record.tolerance, threads=threads)
    likelihood, unknowns = joined(record, belief, likelihood, unknowns)
    notes = (MAP_BESIDE,) if isinstance(likelihood, JointLikelihood) else ()
    return FreeRuns(belief, likelihood, unknowns, notes, record, tuple(runs))


def prepared_runs(
    belief: ModelHypothesis, runs: Sequence[RunData], tolerance: Tolerance, *, threads: int = 1
) -> tuple[Likelihood, Unknowns]:
    """The likelihood of runs under a belief, and what it does not know without any effect."""
    plant = kernel_plant(belief, rate=runs[0].rate, ideal_current=runs[0].ideal_current)
    guesses = tuple(measured_start(plant, run) for run in runs)
    sigmas = tuple(
        START * start_sigmas(plant, run, tolerance=tolerance) for run in runs
    )  # the guess is the belief's, which may be off
    error = None
    if belief.table is not None and plant.parameters.sides and tolerance.table:
        error = table_error(belief.table, Visited.by_runs(plant, runs), tolerance=tolerance.table)
    problem = FitProblem(plant, tuple(runs), guesses, sigmas, error, threads)
    highest = 0.0
    for run, guess in zip(runs, guesses, strict=True):
        highest = max(highest, highest_line(run, free_run(plant, run, guess).readings))
    bands = make_bands([len(run.commands) for run in runs], runs[0].rate, highest=highest)
    believed = tuple(free_parameters(belief, tolerance, runs=runs).items())
    n_table = 0 if error is None else len(error.modes)
    unknowns = Unknowns(believed, n_table, tuple(sigma.size for sigma in sigmas))
    return Likelihood(problem, bands, plant.substeps), unknowns


def _readings(model: ModelHypothesis, run: RunData) -> Mapping[str, Array]:
    plant = kernel_plant(model, rate=run.rate, ideal_current=run.ideal_current)
    return free_run(plant, run, measured_start(plant, run)).readings


def _size(extended: ModelHypothesis, runs: Sequence[RunData], effect: str) -> Size | None:
    """The largest size of an effect over the runs; None where the model does not bear its absence."""
    assert extended.effects is not None
    rest = {name: dict(values) for name, values in extended.effects.stated.items() if name != effect}
    without = replace(extended, effects=EffectValues(rest) if rest else None)
    sizes = []
    for run in runs:
        present, absent = _readings(extended, run), _readings(without, run)
        for name in counted(run):
            change = float(np.sqrt(np.mean((present[name] - absent[name]) ** 2)))
            share = change / float(np.sqrt(np.mean(absent[name] ** 2)))
            sizes.append(Size(effect, run.name, name, share, change))
    return max((size for size in sizes if np.isfinite(size.share)), key=lambda size: size.share, default=None)
