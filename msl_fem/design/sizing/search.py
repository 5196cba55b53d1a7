"""The search: designs asked from Optuna, evaluated by fields, told back; it goes on where an earlier run ended."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import optuna
from optuna.distributions import BaseDistribution, FloatDistribution
from optuna.samplers import BaseSampler, TPESampler
from optuna.trial import FrozenTrial, TrialState

from msl_fem.computing.jobs import Executor, Progress, Workers
from msl_fem.design.sizing.closed_search import ClosedSearch, refuse_contradiction
from msl_fem.design.sizing.design import Design
from msl_fem.design.sizing.evaluation import (
    SOLVED,
    DesignEvaluation,
    DesignEvaluator,
    Outcome,
    direction,
    objective_values,
)
from msl_fem.design.sizing.in_flight import at_work, in_flight
from msl_fem.design.sizing.parameters import SearchSpace, design_from, parameters_of, space_around, textbook_guess
from msl_fem.design.sizing.requirement import Objective
from msl_fem.design.sizing.trials import (
    FIRST,
    VERDICT,
    EvaluatedTrial,
    asked,
    begun_by_one,
    check_content,
    clear_abandoned,
    count_evaluated,
    distributions,
    enqueue_first,
    evaluated_trials,
    evaluation_attribute,
    new_file,
    only_our_content,
    open_storage,
    open_study,
    quiet_optuna,
    storage_trouble,
    store_space,
    stored_space,
)

STARTUP = 20
"""Trials before the TPE sampler learns; until then it draws at random."""
VARIED = 0.5
"""Share of the trials that vary a good design; half of them the best in the first objective, half any of the front."""
_LARGEST_STEP, _SMALLEST_STEP = 0.08, 0.008  # of a parameter's span
_LEAST_KNOWN = 4  # feasible trials before there is something to vary
GUESS, CLOSEST = "closed-form guess", "closed-form closest"
"""Names of the first designs."""
EVALUATED_ARE_KEPT = "judged designs are kept: run the same command again"
_PENALTY = 10.0  # of a relative violation, in the closed equations' search


class MixedSampler(BaseSampler):
    """A tree-structured Parzen estimator (Bergstra et al. 2011; several objectives: Ozaki et al. 2020), and variation.

    The estimator finds the front's course, but its draws are too wide to come near the front's ends, where a user
    looks first; a step of random size from a design of the front (an evolution strategy's mutation) does.

    What a trial draws depends on the seed, its number and the trials finished before it, on nothing else: a resumed
    search does not repeat the numbers it began with, and commands on one storage at once draw different ones.
    """

    def __init__(self, seed: int, ranges: dict[str, BaseDistribution]) -> None:
        self._seed = seed
        self._ranges = {name: span for name, span in ranges.items() if isinstance(span, FloatDistribution)}
        self._begin(0)

    def _begin(self, number: int) -> None:
        of_tpe, own = np.random.SeedSequence([self._seed, number]).spawn(2)
        # without the constant liar, which reads all trials anew for each parameter: draws differ by their seeds
        seed = int(of_tpe.generate_state(1)[0])
        self._tpe = TPESampler(seed=seed, n_startup_trials=STARTUP, constant_liar=False)
        self._generator = np.random.default_rng(own)

    def before_trial(self, study: "optuna.Study", trial: FrozenTrial) -> None:
        """Fix the random numbers of this trial."""
        self._begin(trial.number)
        self._tpe.before_trial(study, trial)

    def infer_relative_search_space(self, study: "optuna.Study", trial: FrozenTrial) -> dict[str, BaseDistribution]:
        """All parameters where a design is varied, none where they are the estimator's, one by one."""
        return dict(self._ranges) if self._generator.random() < VARIED else {}

    def sample_relative(
        self, study: "optuna.Study", trial: FrozenTrial, search_space: dict[str, BaseDistribution]
    ) -> dict[str, Any]:
        """A variation of a good design; nothing where it is not this trial's turn, or none is known."""
        known = study.get_trials(deepcopy=False, states=(TrialState.COMPLETE,)) if search_space else []
        feasible = [t for t in known if all(size <= 0 for size in t.constraints.values())]
        if len(feasible) < _LEAST_KNOWN:
            return {}
        signs = [-1.0 if d == optuna.study.StudyDirection.MAXIMIZE else 1.0 for d in study.directions]
        parent = feasible[self._parent(np.array([t.values for t in feasible]) * signs)]
        return self._varied(parent.params)

    def _parent(self, costs: "np.ndarray") -> int:
        """Index of the best in the first objective, or of any that no other one beats."""
        if self._generator.random() < 0.5:
            return int(np.argmin(costs[:, 0]))
        front = [k for k, c in enumerate(costs) if not ((costs <= c).all(axis=1) & (costs < c).any(axis=1)).any()]
        return int(self._generator.choice(front))

    def _varied(self, parameters: dict[str, float]) -> dict[str, float]:
        """Every second parameter or so a normally distributed step away, all steps of one random scale."""
        scale = _LARGEST_STEP * (_SMALLEST_STEP / _LARGEST_STEP) ** self._generator.random()
        varied = {}
        for name, span in self._ranges.items():
            step = scale * self._generator.standard_normal() * (self._generator.random() < 0.5)
            if span.log:
                value = parameters[name] * (span.high / span.low) ** step
            else:
                value = parameters[name] + step * (span.high - span.low)
            varied[name] = float(min(max(value, span.low), span.high))
        return varied

    def sample_independent(
        self, study: "optuna.Study", trial: FrozenTrial, param_name: str, param_distribution: BaseDistribution
    ) -> Any:
        """The estimator's draw of one parameter."""
        return self._tpe.sample_independent(study, trial, param_name, param_distribution)

    def after_trial(
        self, study: "optuna.Study", trial: FrozenTrial, state: TrialState, values: Sequence[float] | None
    ) -> None:
        """What the estimator does after a trial."""
        self._tpe.after_trial(study, trial, state, values)


@dataclass(frozen=True)
class SearchSettings:
    """How a search runs.

    Attributes
    ----------
    storage : an Optuna storage URL
    trials : evaluated designs at the end, those of earlier runs counted
    seed : of all random numbers
    workers, scheduler : processes here, or the address of a dask scheduler
    sampler : makes an Optuna sampler of a seed and the parameters' ranges
    """

    storage: str
    trials: int = 200
    seed: int = 1
    workers: int = 1
    scheduler: str | None = None
    sampler: Callable[[int, dict[str, BaseDistribution]], BaseSampler] = MixedSampler


@dataclass(frozen=True)
class SearchResult:
    """What a search found: all evaluated trials, in order; `reused` of them were there before."""

    space: SearchSpace
    trials: tuple[EvaluatedTrial, ...]
    failed: int
    reused: int


def search_designs(
    evaluator: DesignEvaluator, settings: SearchSettings, *, progress: Progress | None = None
) -> SearchResult:
    """So many evaluated designs, beginning with the closed equations' guess and their best design for each objective.

    Nothing is lost with the process: each verdict is in the storage as soon as it is there, and designs in flight are
    gone on with, once no other search works in the storage's folder; of a database server they are lost.

    Raises
    ------
    InputError : a storage or scheduler that cannot be reached, a study of another requirement
    RequirementError : no first guess
    ComputationError : processes, cluster or storage were lost on the way; judged designs are kept
    """
    with quiet_optuna(), storage_trouble(settings.storage), at_work(settings.storage) as presence:
        # before a file is made, so that a requirement that cannot be met leaves none
        begin = first_designs(evaluator) if new_file(settings.storage) else None
        storage = open_storage(settings.storage)
        with only_our_content(settings.storage):
            begun_by_one(lambda: check_content(open_study(storage, evaluator), evaluator))
        study, space = begun_by_one(lambda: _begun(open_study(storage, evaluator), evaluator, begin))
        study.sampler = settings.sampler(settings.seed, distributions(space))
        with only_our_content(settings.storage):
            begun = in_flight(study, space) if presence.alone else []
        presence.let_others_in()
        if not presence.alone:
            clear_abandoned(study)
        enqueue_first(study, study.user_attrs[FIRST])
        reused = count_evaluated(study)
        if reused < settings.trials:
            with _executor(settings).start(evaluator, settings.trials - reused) as workers:
                _Run(study, evaluator, space, settings.trials, progress or (lambda *_: None), begun).go(workers)
        trials = evaluated_trials(study)
        return SearchResult(space, tuple(trials), count_evaluated(study) - len(trials), reused)


def _executor(settings: SearchSettings) -> Executor:
    return Executor(settings.workers, settings.scheduler, work="search", item="design", go_on=EVALUATED_ARE_KEPT)


def _begun(
    study: "optuna.Study", evaluator: DesignEvaluator, begin: tuple[SearchSpace, dict[str, Design]] | None
) -> tuple["optuna.Study", SearchSpace]:
    """The study and its space; at its beginning it is made, with the first designs."""
    space = stored_space(study)
    if space is None:
        space, designs = begin or first_designs(evaluator)
        study.set_user_attr(FIRST, {n: parameters_of(d, space, evaluator) for n, d in designs.items()})
        store_space(study, space)
    return study, space


def first_designs(evaluator: DesignEvaluator) -> tuple[SearchSpace, dict[str, Design]]:
    """The space of a search, and by name the designs of the closed equations that it begins with.

    The textbook's guess; where that breaks a constraint, the closest design; from there the best design for each
    objective, and for the product of all.

    Raises
    ------
    RequirementError : the demands clash
    """
    guess = textbook_guess(evaluator)
    space = space_around(guess, evaluator)
    designs = {GUESS: guess}
    start = guess
    evaluation = evaluator.by_closed_form(guess)
    if any(c.violation > 1e-3 for c in evaluation.constraints):  # more than the rounding of its dimensions
        designs[CLOSEST] = start = refuse_contradiction(evaluator, space)
    objectives = evaluator.requirement.objectives
    wishes: dict[str, tuple[Objective, ...]] = {f"closed-form {name}": (name,) for name in objectives}
    if len(objectives) > 1:
        wishes["closed-form compromise"] = objectives
    for name, wish in wishes.items():
        designs[name] = ClosedSearch(evaluator, space, _score(wish)).near(start).design
    return space, designs


def _score(wish: tuple[Objective, ...]) -> Callable[[DesignEvaluation], float]:
    """The logarithm of the objectives' product, and what is broken."""

    def score(evaluation: DesignEvaluation) -> float:
        assert evaluation.performance is not None
        total = math.log1p(_PENALTY * evaluation.violation)
        for name, value in zip(wish, objective_values(evaluation.performance, wish), strict=True):
            total += math.log(value) * (-1 if direction(name) == "maximize" else 1)
        return total

    return score


@dataclass
class _Run:
    """One search on its way."""

    study: "optuna.Study"
    evaluator: DesignEvaluator
    space: SearchSpace
    trials: int
    tell_progress: Progress
    begun: list["optuna.Trial"]
    """Trials of an earlier run that was killed."""

    def go(self, workers: Workers[Design, Outcome]) -> None:
        """Ask, evaluate and tell until there are enough trials."""
        ranges = distributions(self.space)
        waiting: dict[Any, tuple[optuna.Trial, Design]] = {}
        n_evaluated = count_evaluated(self.study)
        self.tell_progress(n_evaluated, self.trials)
        while n_evaluated < self.trials or waiting:
            while len(waiting) < workers.capacity and n_evaluated + len(waiting) < self.trials:
                trial = self.begun.pop(0) if self.begun else asked(self.study, ranges)
                design = design_from(trial.params, self.space, self.evaluator)
                refused = self.evaluator.not_built(design)
                if refused is None:
                    waiting[workers.submit(design)] = trial, design
                else:
                    self._tell(trial, design, refused)
                    n_evaluated += 1
            if waiting:
                for future in workers.wait(list(waiting)):
                    self._tell(*waiting.pop(future), future.result())
            n_evaluated = count_evaluated(self.study)  # other processes may work on the storage as well
            self.tell_progress(min(n_evaluated, self.trials), self.trials)

    def _tell(self, trial: "optuna.Trial", design: Design, outcome: Outcome) -> None:
        """Into the storage: the values of what was solved; what is infeasible with its constraints' sizes."""
        if isinstance(outcome, str):
            trial.set_user_attr(VERDICT, {"failed": outcome})
            self.study.tell(trial, state=TrialState.FAIL)
            return
        # what is broken by name, or how near the nearest limit is: each is a write to the storage
        broken = {c.name: c.violation for c in outcome.constraints if not c.kept}
        for name, size in (broken or {"nearest": max(c.violation for c in outcome.constraints)}).items():
            trial.set_constraint(name, size)
        trial.set_user_attr(VERDICT, evaluation_attribute(design, outcome))
        if outcome.stage == SOLVED and outcome.performance is not None:
            self.study.tell(trial, objective_values(outcome.performance, self.evaluator.requirement.objectives))
        else:
            self.study.tell(trial, state=TrialState.PRUNED)
