"""The search: designs asked from Optuna, evaluated by fields, told back; it goes on where an earlier run ended."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import optuna
from optuna.samplers import BaseSampler
from optuna.trial import TrialState

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
from msl_fem.design.sizing.screening import ScreenedSampler
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

GUESS, CLOSEST = "closed-form guess", "closed-form closest"
"""Names of the first designs."""
EVALUATED_ARE_KEPT = "judged designs are kept: run the same command again"
_PENALTY = 10.0  # of a relative violation, in the closed equations' search


@dataclass(frozen=True)
class SearchSettings:
    """How a search runs.

    Attributes
    ----------
    storage : an Optuna storage URL
    trials : evaluated designs at the end, those of earlier runs counted
    seed : of all random numbers
    workers, scheduler : processes here, or the address of a dask scheduler
    sampler : makes an Optuna sampler of a seed, the space and what evaluates designs
    """

    storage: str
    trials: int = 50
    seed: int = 1
    workers: int = 1
    scheduler: str | None = None
    sampler: Callable[[int, SearchSpace, DesignEvaluator], BaseSampler] = ScreenedSampler


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
        study.sampler = settings.sampler(settings.seed, space, evaluator)
        with only_our_content(settings.storage):
            begun = in_flight(study, space) if presence.alone else []
        presence.let_others_in()
        with only_our_content(settings.storage):  # a trial that is made may take over what a lost one left
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
