"""Which design gets a field next: of many that the closed equations foresee, the one that the front gains most by.

A field costs as much as a hundred designs of the closed equations, which are right to a few per cent. How far they were
off at designs that fields have judged is added to what they say nearby (the output space mapping of Bandler et al.
1994, multiplicative in the objectives), so that what is foreseen beside a judged design is nearly what its field says.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import optuna
from optuna.distributions import BaseDistribution
from optuna.samplers import BaseSampler
from optuna.trial import FrozenTrial, TrialState

from msl_fem.computing.arrays import Array
from msl_fem.design.sizing.design import Design
from msl_fem.design.sizing.evaluation import DesignEvaluator, direction, objective_values
from msl_fem.design.sizing.parameters import ParameterSpan, SearchSpace, design_from
from msl_fem.design.sizing.trials import ASKED_FOR, VERDICT, EvaluatedTrial, distributions, evaluated_trial, unbeaten

FIRST_OBJECTIVE = 0.3
"""Share of the trials that look for the best in the first objective alone."""
MIXED, STEPS = 12, 20
"""Designs foreseen for a trial: between designs of the front, and steps from the best of those."""
LARGEST_STEP, SMALLEST_STEP = 0.08, 0.008
"""Of a parameter's span."""
PENALTY = 10.0
"""Of a relative violation, against the logarithm of an objective."""
NOT_BUILT = 1e3
"""Worse than all that can be built."""
SLOPE, ROUGH, CURVED, NOISE = 1.0, 0.5, 0.4, 0.02
"""Standard deviations of the corrections over a span and beside a plane, the distance in spans over which they vary,
and the scatter of fields on meshes of their own: of each other, as their size divides out."""


@dataclass(frozen=True)
class Foreseen:
    """Costs (logarithms of the objectives, the less the better) and violations by name; no costs if not built."""

    design: Design
    costs: Array | None
    violations: dict[str, float]
    flux_densities: Mapping[str, float] = field(default_factory=dict)

    @property
    def violation(self) -> float:
        return sum(max(size, 0.0) for size in self.violations.values())


@dataclass(frozen=True)
class Judged:
    """A design that fields have judged: its place in the unit cube, and what they say.

    Attributes
    ----------
    loads : logarithms, by part of the iron how many times the closed equations' flux density it carries, where the
        wound pole carries theirs
    off : by which the closed equations with these loads miss the costs
    off_violations : and the violations
    """

    design: Design
    place: Array
    costs: Array
    feasible: bool
    loads: dict[str, float]
    off: Array
    off_violations: dict[str, float]


@dataclass
class Forecast:
    """What the closed equations, corrected by the fields so far, foresee of a design.

    Between the judged designs the corrections are those of a Gaussian process (kriging, as Kennedy and O'Hagan 2000).
    """

    evaluator: DesignEvaluator
    space: SearchSpace
    judged: dict[int, Judged] = field(default_factory=dict)
    """By the number of the trial."""

    def learn(self, trials: Sequence[FrozenTrial]) -> None:
        """Takes in the trials with values that are new."""
        for trial in trials:
            if trial.number not in self.judged and VERDICT in trial.user_attrs:
                found = self._learned(evaluated_trial(trial))
                if found is not None:
                    self.judged[trial.number] = found
        if self.judged:
            self._fit()

    def _learned(self, trial: EvaluatedTrial) -> Judged | None:
        place = self.place(trial.parameters)
        plain = self.closed(place)
        if plain.costs is None:
            return None
        loads = _loads(trial.figures.get("section_flux_densities_T", {}), plain.flux_densities)
        closed = self.closed(place, loads)
        if closed.costs is None:
            return None
        costs = self._costs(trial.values)
        real = {c.name: c.violation for c in trial.constraints}
        off = {name: real[name] - size for name, size in closed.violations.items() if name in real}
        return Judged(closed.design, place, costs, trial.feasible, loads, costs - closed.costs, off)

    def _fit(self) -> None:
        known = list(self.judged.values())
        self._parts = sorted({name for j in known for name in j.loads})
        self._limits = sorted({name for j in known for name in j.off_violations})
        self._places = np.array([j.place for j in known])
        rows = [
            [*j.off, *(j.loads.get(n, 0.0) for n in self._parts), *(j.off_violations.get(n, 0.0) for n in self._limits)]
            for j in known
        ]
        alike = _likeness(self._places, self._places) + NOISE**2 * np.eye(len(known))
        self._weights = np.linalg.solve(alike, np.array(rows))

    def _costs(self, values: Sequence[float]) -> Array:
        signs = [-1.0 if direction(o) == "maximize" else 1.0 for o in self.evaluator.requirement.objectives]
        return np.array(signs) * np.log(values)

    def closed(self, place: Array, loads: Mapping[str, float] | None = None) -> Foreseen:
        """What the closed equations say, with the logarithms of loads by part of the iron."""
        design = design_from(self.parameters(place), self.space, self.evaluator)
        factors = {name: math.exp(load) for name, load in (loads or {}).items()}
        evaluation = self.evaluator.by_closed_form(design, loads=factors)
        violations = {c.name: c.violation for c in evaluation.constraints}
        if evaluation.performance is None:
            return Foreseen(design, None, violations)
        values = objective_values(evaluation.performance, self.evaluator.requirement.objectives)
        return Foreseen(design, self._costs(values), violations, evaluation.performance.flux_densities)

    def of(self, place: Array) -> Foreseen:
        """With the corrections that the judged designs tell."""
        if not self.judged:
            return self.closed(place)
        told = (_likeness(place[None], self._places) @ self._weights)[0]
        n_costs = len(self.evaluator.requirement.objectives)
        n_told = n_costs + len(self._parts)
        closed = self.closed(place, dict(zip(self._parts, told[n_costs:n_told], strict=True)))
        off = dict(zip(self._limits, told[n_told:], strict=True))
        violations = {name: size + off.get(name, 0.0) for name, size in closed.violations.items()}
        costs = None if closed.costs is None else closed.costs + told[:n_costs]
        return replace(closed, costs=costs, violations=violations)

    def place(self, parameters: Mapping[str, float]) -> Array:
        """Between 0 and 1 along each parameter's span."""
        return np.array([_share(parameters[name], span) for name, span in self.space.spans.items()])

    def parameters(self, place: Array) -> dict[str, float]:
        """Those of a place."""
        spans = self.space.spans.items()
        return {name: _value(float(share), span) for share, (name, span) in zip(place, spans, strict=True)}


def _loads(real: Mapping[str, float], closed: Mapping[str, float]) -> dict[str, float]:
    """Logarithms, by section how many times the closed equations' flux density it has where the first has theirs."""
    shared = [name for name in closed if name in real]
    ratios = {name: math.log(real[name] / closed[name]) for name in shared}
    return {name: ratios[name] - ratios[shared[0]] for name in shared}


def _likeness(places: Array, others: Array) -> Array:
    """The covariance of a Gaussian process: a plane and what varies over CURVED of a span beside it."""
    distance2 = np.sum((places[:, None] - others[None]) ** 2, axis=2)
    return 1 + (places - 0.5) @ (others - 0.5).T * SLOPE**2 + ROUGH**2 * np.exp(-distance2 / (2 * CURVED**2))


def _value(share: float, span: ParameterSpan) -> float:
    value = span.low * (span.high / span.low) ** share if span.log else span.low + (span.high - span.low) * share
    return min(max(value, span.low), span.high)


def _share(value: float, span: ParameterSpan) -> float:
    if span.log:
        return math.log(value / span.low) / math.log(span.high / span.low)
    return (value - span.low) / (span.high - span.low)


class ScreenedSampler(BaseSampler):
    """Draws the design that is foreseen to push the front farthest.

    By how much is Svenson and Santner's maximin improvement (2016): the least, over the designs of the front, of the
    largest share by which an objective is better. So gaps of the front are filled and its ends pushed out.

    What a trial draws depends on the seed, its number and the trials finished before it, on nothing else: a resumed
    search does not repeat the numbers it began with, and commands on one storage at once draw different ones.
    """

    def __init__(self, seed: int, space: SearchSpace, evaluator: DesignEvaluator) -> None:
        self._seed = seed
        self._ranges = distributions(space)
        self._forecast = Forecast(evaluator, space)

    def infer_relative_search_space(self, study: "optuna.Study", trial: FrozenTrial) -> dict[str, BaseDistribution]:
        """All parameters, but of a trial whose parameters are given."""
        return {} if trial.params or ASKED_FOR in trial.system_attrs else dict(self._ranges)

    def sample_relative(
        self, study: "optuna.Study", trial: FrozenTrial, search_space: dict[str, BaseDistribution]
    ) -> dict[str, Any]:
        """The parameters of the design that is foreseen to be the best of many."""
        if not search_space:
            return {}
        self._forecast.learn(study.get_trials(deepcopy=False, states=(TrialState.COMPLETE,)))
        draws = np.random.default_rng(np.random.SeedSequence([self._seed, trial.number]))
        return self._forecast.parameters(self._drawn(draws))

    def _drawn(self, draws: np.random.Generator) -> Array:
        """Between designs of the front, or anywhere where there are too few; then steps uphill from the best."""
        known = {j.design for j in self._forecast.judged.values()}
        judged = [j for j in self._forecast.judged.values() if j.feasible]
        front = [judged[k] for k in unbeaten(np.array([j.costs for j in judged]))]
        alone = draws.random() < FIRST_OBJECTIVE
        gain = gain_beyond(front, alone=alone)
        begin = [min(front, key=lambda j: float(j.costs[0]))] if alone and front else front
        found: list[tuple[float, Array]] = []

        def look(place: Array) -> None:
            foreseen = self._forecast.of(place)
            idle = foreseen.costs is None or foreseen.design in known
            worth = -NOT_BUILT * (1 + foreseen.violation) if idle else gain(foreseen)
            found.append((worth, place))

        for _ in range(MIXED):
            look(_between(begin, draws) if begin else draws.random(len(self._ranges)))
        for _ in range(STEPS):
            look(_stepped(max(found, key=lambda f: f[0])[1], draws))
        return max(found, key=lambda f: f[0])[1]

    def sample_independent(
        self, study: "optuna.Study", trial: FrozenTrial, param_name: str, param_distribution: BaseDistribution
    ) -> Any:
        """Of a trial whose parameters are given."""
        raise LookupError(f"the parameter {param_name} of trial {trial.number} is missing")


def gain_beyond(front: Sequence[Judged], *, alone: bool) -> Callable[[Foreseen], float]:
    """What is foreseen to be gained beyond the front, in shares of the objectives."""
    known = np.array([j.costs for j in front])

    def gain(foreseen: Foreseen) -> float:
        assert foreseen.costs is not None
        broken = PENALTY * foreseen.violation
        if not front:
            return -float(foreseen.costs.sum()) - broken
        better = known - foreseen.costs
        return float(better[:, 0].min() if alone else better.max(axis=1).min()) - broken

    return gain


def _between(front: Sequence[Judged], draws: np.random.Generator) -> Array:
    """A place between two designs of the front that are neighbours in one objective, a step away."""
    by_cost = sorted(front, key=lambda j: float(j.costs[0]))
    k = int(draws.integers(len(by_cost)))
    one, other = by_cost[k], by_cost[min(k + 1, len(by_cost) - 1)]
    share = draws.random()
    return _stepped((1 - share) * one.place + share * other.place, draws)


def _stepped(place: Array, draws: np.random.Generator) -> Array:
    """Every second parameter or so a normally distributed step away, all steps of one random scale."""
    scale = LARGEST_STEP * (SMALLEST_STEP / LARGEST_STEP) ** draws.random()
    step = scale * draws.standard_normal(place.size) * (draws.random(place.size) < 0.5)
    return np.clip(place + step, 0.0, 1.0)
