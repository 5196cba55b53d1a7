"""LQR whose gains follow the magnets' stiffness: at each node they are searched for the places that it stands for.

Near a position x that the magnets hold, their negative stiffness is taken off late, and gains that suit the middle do
not suit the ends. The middle keeps the gains of `lqr_design`. At nodes over the reach the factors of state feedback,
integral and filter are searched (Nelder and Mead) so that the peak sensitivity stays below a target, and not far above
it where commands come a quarter of a sample later than believed; slow disturbances are to move the mover as little as
with the gains of the middle, as far as that allows. What no controller of this rate and delay can do is
`linear_loop.sensitivity_bound`.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from msl_fem.computing.arrays import Array
from msl_fem.control.controller import pull_stiffness
from msl_fem.control.design import ControllerChoice, ControllerDesign, DesignKind, LinearDesign, Wish, completed
from msl_fem.control.design_model import AtPosition, DesignModel, reach_of
from msl_fem.control.gain_schedule import GainSchedule
from msl_fem.control.linear_loop import Complex, LinearLaw, grid
from msl_fem.control.lqr_design import DEFAULT_WISH, LqrOptions, lqr_design

TARGET = 2.05
"""Peak sensitivity of the nodes, where it can be had: below 2.2 between them."""
_SHARES = (0.0, 0.5, 0.7, 0.8, 0.9, 1.0)  # of the reach
_SLOW = 0.04  # of the loop rate: disturbances up to here count
_LEAST_SHARE = 0.15  # of the dynamic stiffness with the middle's gains: less is no integral
_LATE, _LATE_TARGET = 0.25, 3.0  # of a sample, and the peak sensitivity then
_BEYOND_TARGET, _TOO_SOFT, _SOFTER, _LESS = 20.0, 100.0, 3.0, 0.3  # what each costs
_EVALUATIONS = 220
_LARGEST = 4.0  # factor
_GRID = 90
_HOPELESS = 1e3


@dataclass(frozen=True, eq=False)
class _Node:
    """A stiffness of the schedule, and the place that stands for it."""

    stiffness: float
    at: AtPosition


def scheduled_design(
    model: DesignModel, wish: Wish = DEFAULT_WISH, *, options: LqrOptions | None = None
) -> ControllerDesign:
    """The LQR controller of a belief with gains that follow the magnets' stiffness; raises as `lqr_design`."""
    options = options or LqrOptions()
    base = lqr_design(model, wish, options=options)
    nodes = _nodes(model, options.overlap)
    factors = np.zeros(base.law.gains.state.size + 3)
    rows = [np.exp(factors)]
    for node in nodes[1:]:
        factors = _searched(base.law, node.at, factors)
        rows.append(np.exp(factors))
    schedule = GainSchedule(np.array([node.stiffness for node in nodes]), np.array(rows))
    return completed(
        model,
        LinearDesign(
            SCHEDULED,
            base.law,
            base.weights,
            lambda x: model.place(x, overlap=options.overlap),
            base.parameters.stage,
            schedule=schedule,
        ),
    )


def _nodes(model: DesignModel, overlap: float) -> tuple[_Node, ...]:
    """Places of the reach in the order of their stiffness, one for each."""
    low, high = reach_of(model)
    positions = [share * end for share in _SHARES for end in (low, high)]
    gap = model.coupled.nominal_gap
    found = {round(pull_stiffness(model.holding_force(x), x, gap), 3): x for x in positions}
    least = min(1.0, max(found))
    ordered = [s for s in sorted(found) if s == min(found) or s >= least]
    return tuple(_Node(s, model.place(found[s], overlap=overlap)) for s in ordered)


def _searched(law: LinearLaw, at: AtPosition, start: Array) -> Array:
    """Logarithms of the factors at a place, from those of the node before."""
    from scipy.optimize import minimize

    f = grid(law.plant.period, _GRID)
    usual = np.abs(1 + law.loop_transfer(f, at))
    later = np.exp(-2j * np.pi * f * _LATE * law.plant.period)
    task = _Task(law, at, f, usual, later, f < _SLOW / law.plant.period)
    for size in (0.25, 0.12):
        simplex = start + size * (np.vstack([np.zeros(start.size), np.eye(start.size)]) - 0.2)
        options = {"maxfev": _EVALUATIONS, "initial_simplex": simplex, "adaptive": True, "xatol": 1e-3, "fatol": 1e-4}
        start = minimize(task.badness, start, method="Nelder-Mead", options=options).x
    return np.clip(start, -np.log(_LARGEST), np.log(_LARGEST))


@dataclass(frozen=True, eq=False)
class _Task:
    """A node's law and place; |1 + L| with the middle's gains over frequencies (Hz), a delay, which are slow."""

    law: LinearLaw
    at: AtPosition
    frequency: Array
    usual: Array
    later: Complex
    slow: NDArray[np.bool_]

    def badness(self, logarithms: Array) -> float:
        limit = np.log(_LARGEST)
        kept = np.clip(logarithms, -limit, limit)
        beyond = float(np.sum(np.abs(logarithms - kept)))
        factors = np.exp(kept)
        law = GainSchedule(np.array([0.0, 1.0]), np.stack([factors, factors])).law_at(self.law, 0.0)
        radius = law.spectral_radius(self.at)
        if radius >= 1:
            return _HOPELESS * radius + beyond
        transfer = law.loop_transfer(self.frequency, self.at)
        size = np.abs(1 + transfer)
        peak = float(1 / size.min())
        late = float(1 / np.abs(1 + transfer * self.later).min())
        share = float((size / self.usual)[self.slow].min())  # of the dynamic stiffness, at its worst
        cost = _LESS * peak + _BEYOND_TARGET * max(0.0, peak - TARGET) + _SOFTER * max(0.0, 1 - share)
        cost += _BEYOND_TARGET * max(0.0, late - max(_LATE_TARGET, 1.4 * peak))
        return cost + _TOO_SOFT * max(0.0, _LEAST_SHARE - share) + beyond


def _scheduled(model: DesignModel, wish: Wish, choice: ControllerChoice) -> ControllerDesign:
    return scheduled_design(model, wish, options=LqrOptions(choice.feedforward, choice.overlap))


SCHEDULED = DesignKind(
    "scheduled",
    "feedback linearization, LQR with integral and Kalman filter whose gains follow the magnets' stiffness",
    DEFAULT_WISH,
    frozenset({"feedforward", "overlap"}),
    _scheduled,
)
