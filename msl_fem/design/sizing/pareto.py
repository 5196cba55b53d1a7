"""Which designs are not beaten in all objectives at once, and which of them is taken."""

from collections.abc import Sequence

import numpy as np

from msl_fem.design.sizing.judge import direction
from msl_fem.design.sizing.requirement import Objective
from msl_fem.design.sizing.trial_record import JudgedTrial


def pareto_front(trials: Sequence[JudgedTrial], objectives: tuple[Objective, ...]) -> list[JudgedTrial]:
    """The feasible trials that no other one beats, best in the first objective first.

    A trial is beaten by one that is at least as good in all objectives and better in one; of equal ones the first
    stays.
    """
    feasible = sorted((t for t in trials if t.feasible), key=lambda t: t.number)
    if not feasible:
        return []
    signs = np.array([-1.0 if direction(o) == "maximize" else 1.0 for o in objectives])
    costs = np.array([t.values for t in feasible]) * signs
    front = []
    for k, cost in enumerate(costs):
        at_least_as_good, better = (costs <= cost).all(axis=1), (costs < cost).any(axis=1)
        twin = at_least_as_good & ~better
        if not (at_least_as_good & better).any() and int(np.argmax(twin)) == k:
            front.append(k)
    front.sort(key=lambda k: tuple(costs[k]))
    return [feasible[k] for k in front]
