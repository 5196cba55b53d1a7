"""A law whose gains follow the magnets' stiffness: at each node they are searched for the places that it stands for.

Near a position x that the magnets hold, their negative stiffness is taken off late, and gains that suit the middle do
not suit the ends. At nodes over the reach the factors of state feedback, integral and filter are searched (Nelder and
Mead) so that the peak sensitivity stays below a target, and not far above it where commands come a quarter of a sample
later than believed; slow disturbances are to move the mover as little as with the gains of the middle, as far as that
allows. `scheduled` begins with the law of a family of plants (`robust_design`) and keeps the family's peaks in bounds
at every node, so that a second mass on the mover is borne over the whole reach. `scheduled-rigid` begins with
`lqr_design` and asks for no second mass: it reaches lower peaks where there is none. What no controller of this rate
and delay can do is `linear_loop.sensitivity_bound`.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from msl_fem.computing.arrays import Array
from msl_fem.computing.statespace import StateSpace
from msl_fem.control.controller import pull_stiffness
from msl_fem.control.design import (
    ControllerChoice,
    ControllerDesign,
    DesignKind,
    LinearDesign,
    Wish,
    check_wish,
    completed,
)
from msl_fem.control.design_model import AtPosition, DesignModel, reach_of
from msl_fem.control.gain_schedule import GainSchedule
from msl_fem.control.linear_loop import Complex, LinearLaw, feedback_bandwidth
from msl_fem.control.lqg import LqrWeights
from msl_fem.control.lqr_design import DEFAULT_WISH, LqrOptions, lqr_design, stage_with_overlap
from msl_fem.control.output_stage import OutputStage
from msl_fem.control.robust_design import (
    FAMILY,
    HOPELESS,
    Deviation,
    RobustOptions,
    family_at,
    family_grid,
    family_peaks,
    family_task,
    searched_law,
)
from msl_fem.errors import InputError

TARGET = 2.05
"""Peak sensitivity of the nodes, where it can be had: below 2.2 between them."""
FAMILY_TARGET = 4.0
"""Peak sensitivity up to which each plant of the family is borne, where it can be had."""
RIGID = (Deviation(),)
_SHARES = (0.0, 0.5, 0.7, 0.8, 0.9, 1.0)  # of the reach
_BASE_SHARE = 0.8  # of the reach: the law that all nodes begin with bears the family in the middle and there
_SLOW = 0.04  # of the loop rate: disturbances up to here count
_LEAST_SHARE = 0.15  # of the dynamic stiffness with the middle's gains: less is no integral
_LATE, _LATE_TARGET = 0.25, 3.0  # of a sample, and the peak sensitivity then
_BEYOND_TARGET, _TOO_SOFT, _SOFTER, _LESS = 20.0, 100.0, 3.0, 0.3  # what each costs
_EVALUATIONS = 220
_LARGEST = 4.0  # factor
_GRID = 90
_HOPELESS = 30.0


@dataclass(frozen=True)
class ScheduleOptions:
    """What may be chosen beside the wish.

    Attributes
    ----------
    feedforward : two degrees of freedom; without, the reference acts by the integral alone
    overlap : N, see `inverse.hand_over`
    family : plants that are to be borne at every node, the believed one first
    """

    feedforward: bool = True
    overlap: float = 0.0
    family: tuple[Deviation, ...] = FAMILY


@dataclass(frozen=True, eq=False)
class _Base:
    """The law that the schedule multiplies."""

    law: LinearLaw
    weights: LqrWeights
    stage: OutputStage


@dataclass(frozen=True, eq=False)
class _Node:
    """A stiffness of the schedule, and the place that stands for it."""

    stiffness: float
    at: AtPosition


def scheduled_design(
    model: DesignModel, wish: Wish = DEFAULT_WISH, *, options: ScheduleOptions | None = None
) -> ControllerDesign:
    """The controller of a belief with gains that follow the magnets' stiffness.

    Raises
    ------
    InputError : as `lqr_design` without a family; with one, a wish that no law was found for
    """
    options = options or ScheduleOptions()
    rigid = len(options.family) == 1
    base = _rigid_base(model, wish, options) if rigid else _family_base(model, wish, options)
    nodes = _nodes(model, options.overlap)
    factors = np.zeros(base.law.gains.state.size + 3)
    rows = [np.exp(factors)]
    for node in nodes[1:]:
        factors = _searched(base.law, node.at, factors, options.family)
        rows.append(np.exp(factors))
    schedule = GainSchedule(np.array([node.stiffness for node in nodes]), np.array(rows))
    return completed(
        model,
        LinearDesign(
            SCHEDULED_RIGID if rigid else SCHEDULED,
            base.law,
            base.weights,
            lambda x: model.place(x, overlap=options.overlap),
            base.stage,
            schedule=schedule,
        ),
    )


def _rigid_base(model: DesignModel, wish: Wish, options: ScheduleOptions) -> _Base:
    found = lqr_design(model, wish, options=LqrOptions(options.feedforward, options.overlap))
    return _Base(found.law, found.weights, found.parameters.stage)


def _family_base(model: DesignModel, wish: Wish, options: ScheduleOptions) -> _Base:
    """The law that keeps the wish on the believed plant, and the family within its target, in the middle."""
    check_wish(wish, model.plant)
    stage = stage_with_overlap(model, options.overlap)
    _, high = reach_of(model)
    places = tuple(model.place(share * high, overlap=options.overlap) for share in (0.0, _BASE_SHARE))
    of_family = RobustOptions(options.family, options.overlap, compliance=0.0)
    task = family_task(model, Wish(wish.bandwidth, FAMILY_TARGET), of_family, places=places)
    law, weights = searched_law(task)
    law = _with_factors(
        law, np.exp(_searched(law, places[0], np.zeros(law.gains.state.size + 3), options.family, wish))
    )
    got = feedback_bandwidth(law)
    peak = law.peak_sensitivity(places[0])
    worst = max(family_peaks(law, places[0], law.feedback(task.frequency, places[0]), task.plants[0]))
    if not worst < HOPELESS or not wish.kept_by(got, peak):
        raise InputError(
            f"no law that bears the family gives a {wish}; the nearest got {got:.4g} Hz and {peak:.3g}, the family "
            f"{worst:.3g}: lower the bandwidth, allow more peak sensitivity, raise the loop rate, or take "
            "--design scheduled-rigid where the mover has no second mass"
        )
    return _Base(replace(law, feedforward=options.feedforward), weights, stage)


def _nodes(model: DesignModel, overlap: float) -> tuple[_Node, ...]:
    """Places of the reach in the order of their stiffness, one for each."""
    low, high = reach_of(model)
    positions = [share * end for share in _SHARES for end in (low, high)]
    gap = model.coupled.nominal_gap
    found = {round(pull_stiffness(model.holding_force(x), x, gap), 3): x for x in positions}
    least = min(1.0, max(found))
    ordered = [s for s in sorted(found) if s == min(found) or s >= least]
    return tuple(_Node(s, model.place(found[s], overlap=overlap)) for s in ordered)


def _with_factors(law: LinearLaw, factors: Array) -> LinearLaw:
    return GainSchedule(np.array([0.0, 1.0]), np.stack([factors, factors])).law_at(law, 0.0)


def _searched(
    law: LinearLaw, at: AtPosition, start: Array, family: tuple[Deviation, ...], wish: Wish | None = None
) -> Array:
    """Logarithms of the factors at a place, from those of the node before or from none, whichever is better there; in
    the middle with the wish kept."""
    from scipy.optimize import minimize

    f = family_grid(family, law.plant.period, _GRID)
    usual = np.abs(1 + law.loop_transfer(f, at))
    later = np.exp(-2j * np.pi * f * _LATE * law.plant.period)
    task = _Task(law, at, f, family_at(law.plant, family, at, f), usual, later, f < _SLOW / law.plant.period, wish)
    start = min((start, np.zeros(start.size)), key=task.badness)
    for size in (0.25, 0.12):
        simplex = start + size * (np.vstack([np.zeros(start.size), np.eye(start.size)]) - 0.2)
        options = {"maxfev": _EVALUATIONS, "initial_simplex": simplex, "adaptive": True, "xatol": 1e-3, "fatol": 1e-4}
        start = minimize(task.badness, start, method="Nelder-Mead", options=options).x
    return np.clip(start, -np.log(_LARGEST), np.log(_LARGEST))


@dataclass(frozen=True, eq=False)
class _Task:
    """A node's law and place; frequencies (Hz), the plants there, |1 + L| with the middle's gains, a delay, which
    frequencies are slow."""

    law: LinearLaw
    at: AtPosition
    frequency: Array
    plants: tuple[tuple[StateSpace, Complex], ...]
    usual: Array
    later: Complex
    slow: NDArray[np.bool_]
    wish: Wish | None

    def badness(self, logarithms: Array) -> float:
        limit = np.log(_LARGEST)
        kept = np.clip(logarithms, -limit, limit)
        beyond = float(np.sum(np.abs(logarithms - kept)))
        factors = np.exp(kept)
        law = _with_factors(self.law, factors)
        feedback = law.feedback(self.frequency, self.at)
        peak, *others = family_peaks(law, self.at, feedback, self.plants)
        if peak >= HOPELESS:
            return _HOPELESS * peak + beyond
        transfer = -self.plants[0][1] * feedback
        late = float(1 / np.abs(1 + transfer * self.later).min())
        share = float((np.abs(1 + transfer) / self.usual)[self.slow].min())  # of the dynamic stiffness, at its worst
        cost = _LESS * peak + _BEYOND_TARGET * max(0.0, peak - TARGET) + _SOFTER * max(0.0, 1 - share)
        cost += _BEYOND_TARGET * max(0.0, late - max(_LATE_TARGET, 1.4 * peak))
        cost += _BEYOND_TARGET * max(0.0, max(others, default=0.0) - FAMILY_TARGET)
        if self.wish is not None:
            cost += _TOO_SOFT * self.wish.missed_by(feedback_bandwidth(law, _GRID), peak)
        return cost + _TOO_SOFT * max(0.0, _LEAST_SHARE - share) + beyond


def _scheduled(model: DesignModel, wish: Wish, choice: ControllerChoice) -> ControllerDesign:
    return scheduled_design(model, wish, options=ScheduleOptions(choice.feedforward, choice.overlap))


def _scheduled_rigid(model: DesignModel, wish: Wish, choice: ControllerChoice) -> ControllerDesign:
    return scheduled_design(model, wish, options=ScheduleOptions(choice.feedforward, choice.overlap, RIGID))


SCHEDULED = DesignKind(
    "scheduled",
    "feedback linearization, LQR with integral, section and filter against a family of plants; its gains follow the "
    "magnets' stiffness",
    DEFAULT_WISH,
    frozenset({"feedforward", "overlap"}),
    _scheduled,
)
SCHEDULED_RIGID = DesignKind(
    "scheduled-rigid",
    "feedback linearization, LQR with integral and Kalman filter whose gains follow the magnets' stiffness",
    DEFAULT_WISH,
    frozenset({"feedforward", "overlap"}),
    _scheduled_rigid,
)
