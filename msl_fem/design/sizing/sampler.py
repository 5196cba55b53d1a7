"""Which design is judged next: Optuna's TPE sampler, and variations of the best designs so far."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import optuna
from optuna.distributions import BaseDistribution, FloatDistribution
from optuna.samplers import BaseSampler, TPESampler
from optuna.trial import FrozenTrial, TrialState

STARTUP = 20
"""Trials before the TPE sampler learns; until then it draws at random."""
VARIED = 0.5
"""Share of the trials that vary a good design; half of them the best in the first objective, half any of the front."""
_LARGEST_STEP, _SMALLEST_STEP = 0.08, 0.008  # of a parameter's span
_LEAST_KNOWN = 4  # feasible trials before there is something to vary


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
