"""Newton's iteration in a reduced space, at many states in step, with factors that serve for several steps.

Where a step with the factors at hand is small beside the one before, those that follow shrink alike (simplified Newton:
Deuflhard, Newton Methods for Nonlinear Problems, 2004, ch. 2.1.2): a tangent takes ten times the work of such a step.
"""

from dataclasses import dataclass

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.magnetics.reduced.linear_systems import SystemsAt
from msl_fem.magnetics.reduced.reduced_iron import IronTerms
from msl_fem.materials.curves import Indices

ACCEPTED = 1e-5  # relative energy norm of the last of Newton's steps: its square is left, slopes 5e-6 of the largest
LEFT = 2e-8  # the same of the error that is expected after steps with factors that have been kept
FALLING = 0.1  # from a step to the next with the same factors
KEPT = 3  # steps with the same factors
REFINED = 1e-4  # of a slope: a correction by refinement, of which at most a tenth is left, most often its square
MOST_STEPS, MOST_TRIALS, MOST_REFINEMENTS = 60, 30, 8


@dataclass(frozen=True, eq=False)
class FoundStates:
    """What Newton's iteration ends at.

    Attributes
    ----------
    states : (n, N)
    steps : (n,) Newton's, with a tangent of their own; 0: not converged
    systems : with factors near the tangents at the states
    kept : (n,) whether these are of a state further away than the last step
    curvature : (n, 3 n_point) the irons' at the states where they are
    """

    states: Array
    steps: Indices
    systems: SystemsAt
    kept: Array
    curvature: Array

    def responses(self, rights: Array, terms: IronTerms) -> Array:
        """(n, r, N) the inverses of the tangents at the states times `rights` of this shape.

        Refined with the factors at hand, all r alike: so the inverse that answers is symmetric, to rounding.
        """
        at = np.arange(len(self.states))
        answer, at = self.systems.substitute(at, rights), np.flatnonzero(self.kept)
        for _ in range(MOST_REFINEMENTS):
            if not at.size:
                break
            own = answer[at]
            missing = rights[at] - self.systems.products(at, own) - terms.along(self.curvature[at], own)
            change = self.systems.substitute(at, missing)
            answer[at] = own + change
            size, of = np.abs((change * missing).sum(axis=2)), np.abs((own * rights[at]).sum(axis=2))
            at = at[(size > REFINED**2 * of).any(axis=1)]
        return answer


def newton(start: Array, systems: SystemsAt, load: Array, terms: IronTerms) -> FoundStates:
    """States from a start (n, N) under loads (n, N).

    Each minimises the convex c.K c/2 + iron energy - load.c as `solve_field` does, with a line search by the slope.
    """
    states, steps, converged = start.copy(), np.zeros(len(start), dtype=np.int64), np.zeros(len(start), dtype=bool)
    kept, last = np.zeros(len(start), dtype=bool), np.empty((len(start), 3 * terms.iron.weight.size))
    active = np.arange(len(start))
    force, curvature = terms.at(states)
    for _ in range(MOST_STEPS):
        steps[active] += 1
        c, rest = states[active], _rest(systems, load, active, states[active], force)
        positive = systems.factor(active, terms.tangents(curvature))
        step = systems.substitute(active, rest[:, None])[:, 0]
        descent = (step * rest).sum(axis=1)
        scale = np.maximum((c * (load[active] - rest)).sum(axis=1), ((c + step) * load[active]).sum(axis=1))
        done = positive & ((descent <= ACCEPTED**2 * scale) | (scale == 0.0))
        states[active[done]] += step[done]
        converged[active[done]] = True
        left = positive & ~done & (descent > 0)
        active, step, descent, scale = active[left], step[left], descent[left], scale[left]
        if not active.size:
            break
        states[active], force, curvature = line_search(states[active], step, descent, systems, active, load, terms)
        going = np.arange(active.size)
        for _ in range(KEPT):
            rest = _rest(systems, load, active[going], states[active[going]], force[going])
            step = systems.substitute(active[going], rest[:, None])[:, 0]
            before, descent[going] = descent[going], (step * rest).sum(axis=1)
            falls = np.abs(descent[going]) <= FALLING**2 * before
            going, step, before = going[falls], step[falls], before[falls]
            if not going.size:
                break
            states[active[going]] += step
            force[going], curvature[going] = terms.at(states[active[going]])
            near = descent[going] ** 2 <= LEFT**2 * scale[going] * before
            found = active[going[near]]
            converged[found], kept[found], last[found] = True, True, curvature[going[near]]
            going = going[~near]
        left = ~converged[active]
        active, force, curvature = active[left], force[left], curvature[left]
        if not active.size:
            break
    return FoundStates(states, np.where(converged, steps, 0), systems, kept, last)


def _rest(systems: SystemsAt, load: Array, at: Indices, states: Array, force: Array) -> Array:
    """(n_at, N) of the loads what stiffness and irons do not hold at states (n_at, N)."""
    return load[at] - systems.products(at, states[:, None])[:, 0] - force


def line_search(
    states: Array, step: Array, descent: Array, systems: SystemsAt, on: Indices, load: Array, terms: IronTerms
) -> tuple[Array, Array, Array]:
    """States along their steps (n_on, N), the iron's gradient and curvature there; `on` says which of the systems.

    Along a step the slope rises from -descent (n_on,): its root is bracketed (Illinois), as in `solve_field`.
    """
    trial = states + step
    force, curvature = terms.at(trial)
    n = len(states)
    low, low_slope, high, high_slope, t = np.zeros(n), -descent, np.ones(n), np.zeros(n), np.ones(n)
    at = np.arange(n)
    for _ in range(MOST_TRIALS):
        slope = -(step[at] * _rest(systems, load, on[at], trial[at], force[at])).sum(axis=1)
        going = ~((np.abs(slope) <= 0.5 * descent[at]) | ((t[at] == 1.0) & (slope < 0)))
        at, slope = at[going], slope[going]
        if not at.size:
            break
        past = slope > 0
        above, below = at[past], at[~past]
        high[above], high_slope[above] = t[above], slope[past]
        low_slope[above] /= 2
        low[below], low_slope[below] = t[below], slope[~past]
        high_slope[below] /= 2
        t[at] = low[at] - low_slope[at] * (high[at] - low[at]) / (high_slope[at] - low_slope[at])
        trial[at] = states[at] + t[at, None] * step[at]
        force[at], curvature[at] = terms.at(trial[at])
    return trial, force, curvature
