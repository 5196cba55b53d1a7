"""Two baselines: the tangent of the plant about a bias current, and PID.

Bias: both sides carry a bias current. F_1(i_b + d, g_0 - x) - F_2(i_b - d, g_0 + x) = k_i d + k_s x + ...: the bias
makes the force linear in the control current d, and the mover unstable once k_s exceeds the suspension (Schweitzer,
Maslen (ed.), Magnetic Bearings, 2009, ch. 4; Gutierrez and Ro 1998 call it the Jacobian linearisation and say that its
bias is about ten times the control current).

PID on the position, its force through the same inverse at the measured gap:

    F = K_p (r - y) + K_i T sum(r - y) + K_d (r' - d),   d the difference quotient of y behind a first-order filter

(Astrom and Hagglund, Advanced PID Control, 2006, ch. 3). It differs from the LQR in the linear law alone: no model, no
Kalman filter, no feedforward of the reference's acceleration.
"""

from dataclasses import dataclass, replace

import numpy as np

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
from msl_fem.control.inverse import believed_gap, magnet_current_limit, side_surface
from msl_fem.control.linear_loop import LinearLaw
from msl_fem.control.linear_plant import LinearPlant
from msl_fem.control.lqg import LqrGains, LqrWeights, ReducedOrderFilter
from msl_fem.control.lqr_design import (
    DEFAULT_WISH,
    WORKING_SHARE,
    LqrLaws,
    search_weights,
    stage_with_overlap,
    usual_noise,
    working_places,
)
from msl_fem.control.output_stage import BIAS, OutputStage
from msl_fem.errors import InputError
from msl_fem.table.coenergy_surface import evaluate

_FORCE, _CURRENT_SLOPE, _GAP_SLOPE = 2, 4, 5  # rows of an evaluation of the surface, see `coenergy_surface.evaluate`
_N_POSITION = 51
_DEFAULT_SHARE = 1.0  # of the suspension's stiffness that the default bias takes away
_FORGETTING = 0.3  # of the difference quotient, a sample: a time constant of 0.83 samples


@dataclass(frozen=True)
class BiasOptions:
    """What may be chosen beside the wish.

    Attributes
    ----------
    bias : A of a side; None: the one that takes away the whole stiffness of the suspension
    feedforward : two degrees of freedom, or the integral alone
    """

    bias: float | None = None
    feedforward: bool = True


@dataclass(frozen=True)
class BiasPoint:
    """A position held about a bias.

    Attributes
    ----------
    position : m
    control : A, d of i_1 = bias + d, i_2 = bias - d
    force_per_current, magnet_stiffness : N/A of d, N/m against the suspension
    """

    position: float
    control: float
    force_per_current: float
    magnet_stiffness: float


def biased_design(
    model: DesignModel, wish: Wish = DEFAULT_WISH, *, options: BiasOptions | None = None
) -> ControllerDesign:
    """The LQR controller on the tangent of the plant at a bias current.

    Raises
    ------
    InputError : one side only; a bias that guard or drive forbid in the middle, wishes that cannot be kept
    """
    options = options or BiasOptions()
    if model.inverse.sides < 2:
        raise InputError(f"{model.actuator.name} has one side; a bias current needs two that balance")
    check_wish(wish, model.plant)
    bias = default_bias(model) if options.bias is None else options.bias
    points = held_points(model, bias)
    middle = bias_point(model, bias, 0.0)
    assert middle is not None
    tangent = replace(model.plant, stiffness=model.plant.stiffness - middle.magnet_stiffness)
    law_of = LqrLaws(tangent, usual_noise(model), wish, 0.0, options.feedforward)

    def place_of(point: BiasPoint) -> AtPosition:
        gain = point.force_per_current / middle.force_per_current
        return AtPosition(point.magnet_stiffness - middle.magnet_stiffness, 0.0, gain)

    def place_at(position: float) -> AtPosition:
        point = bias_point(model, bias, position)
        if point is None:
            raise InputError(f"a bias of {bias:.4g} A holds no {position * 1e3:.4g} mm within guard and drive")
        return place_of(point)

    ends = points[0].position, points[-1].position
    places = [place_of(middle)] + [place_at(WORKING_SHARE * x) for x in (ends[0], ends[0] / 2, ends[1] / 2, ends[1])]
    weights = search_weights(law_of, places, wish)
    law = law_of(weights)
    stage = OutputStage(BIAS, 0.0, bias, middle.force_per_current)
    return completed(model, LinearDesign(BIASED, law, weights, place_at, stage, ends))


def _biased(model: DesignModel, wish: Wish, choice: ControllerChoice) -> ControllerDesign:
    return biased_design(model, wish, options=BiasOptions(choice.bias, choice.feedforward))


BIASED = DesignKind(
    "biased",
    "Jacobian linearisation about a bias current, LQR with integral, reduced-order Kalman filter",
    DEFAULT_WISH,
    frozenset({"feedforward", "bias"}),
    _biased,
)


def default_bias(model: DesignModel) -> float:
    """The bias in A at which the magnets take the suspension's stiffness away, at most half of what is allowed."""
    limit = _limit(model, 0, 0.0)
    low = 0.0
    high = 0.5 * limit
    target = _DEFAULT_SHARE * model.plant.stiffness
    for _ in range(50):
        bias = 0.5 * (low + high)
        point = bias_point(model, bias, 0.0)
        if point is not None and point.magnet_stiffness < target:
            low = bias
        else:
            high = bias
    return low


def held_points(model: DesignModel, bias: float) -> list[BiasPoint]:
    """The positions over the reach, from the middle outwards, that currents about the bias hold; in order.

    Raises
    ------
    InputError : not even the middle
    """
    if not 0.0 < bias < _limit(model, 0, 0.0):
        raise InputError(
            f"a bias of {bias:.4g} A is not possible; it must be above 0 and below the {_limit(model, 0, 0.0):.4g} A "
            "that guard, drive and table allow in the middle"
        )
    points: list[BiasPoint] = []
    for end in reach_of(model):
        for x in np.linspace(0.0, end, _N_POSITION)[0 if end > 0 else 1 :]:
            point = bias_point(model, bias, float(x))
            if point is None:
                break
            points.append(point)
    if not points:
        raise InputError(f"a bias of {bias:.4g} A does not hold the middle within guard, drive and table")
    return sorted(points, key=lambda point: point.position)


def bias_point(model: DesignModel, bias: float, position: float) -> BiasPoint | None:
    """How the mover is held at a position in m about the bias in A; None where guard, drive or table forbid it.

    The control current is found by bisection: the force grows with it. A side that it would reverse carries nothing.
    """
    force = model.holding_force(position)
    low = -_limit(model, 1, position) - bias
    high = _limit(model, 0, position) - bias
    low = max(low, -_limit(model, 1, position) + bias)
    if not low <= high:
        return None
    forces = [_forces(model, bias, d, position) for d in (low, high)]
    if not forces[0][0] <= force <= forces[1][0]:
        return None
    for _ in range(60):
        control = 0.5 * (low + high)
        if _forces(model, bias, control, position)[0] > force:
            high = control
        else:
            low = control
    _, per_current, stiffness = _forces(model, bias, control, position)
    return BiasPoint(position, control, per_current, stiffness)


def _limit(model: DesignModel, side: int, position: float) -> float:
    """A of a side that guard, drive and table allow."""
    limit = magnet_current_limit(model.inverse, believed_gap(model.inverse, side, position))
    return float(limit / model.inverse.current_share)


def _forces(model: DesignModel, bias: float, control: float, position: float) -> tuple[float, float, float]:
    """(force N, its slope by d in N/A, its slope by x in N/m) of both sides."""
    inverse = model.inverse
    currents = np.maximum([bias + control, bias - control], 0.0)
    total, slope, stiffness = model.common_forces(currents, position)
    for side, toward in ((0, 1.0), (1, -1.0)):
        current = float(currents[side])
        if current > 0.0:
            out = np.empty(6)
            gap = believed_gap(inverse, side, position)
            evaluate(*side_surface(inverse, side)[:3], current * inverse.current_share, gap, out)
            total += toward * inverse.magnets * float(out[_FORCE])
            slope += inverse.magnets * inverse.current_share * float(out[_CURRENT_SLOPE])
            stiffness -= inverse.magnets * float(out[_GAP_SLOPE])
    return total, slope, stiffness


def pid_design(model: DesignModel, wish: Wish = DEFAULT_WISH, *, overlap: float = 0.0) -> ControllerDesign:
    """The PID controller of a belief, its gains searched for the same wish as the LQR's weights.

    `LqrWeights` hold w, q_v, q_i of K_p = m w^2, K_d = q_v m w, K_i = q_i m w^3.

    Raises
    ------
    InputError : a wish that no gains keep
    """
    check_wish(wish, model.plant)
    stage = stage_with_overlap(model, overlap)

    def law_of(weights: LqrWeights) -> LinearLaw:
        return _law(model.plant, weights)

    weights = search_weights(law_of, working_places(model, overlap=overlap), wish)
    return completed(
        model, LinearDesign(PID, law_of(weights), weights, lambda x: model.place(x, overlap=overlap), stage)
    )


def _pid(model: DesignModel, wish: Wish, choice: ControllerChoice) -> ControllerDesign:
    return pid_design(model, wish, overlap=choice.overlap)


PID = DesignKind(
    "pid",
    "feedback linearization, PID on the position with filtered derivative",
    DEFAULT_WISH,
    frozenset({"overlap"}),
    _pid,
)


def _law(plant: LinearPlant, weights: LqrWeights) -> LinearLaw:
    n, w = plant.sampled().A.shape[0], weights.frequency
    proportional = plant.mass * w**2
    derivative = weights.velocity * plant.mass * w
    state = np.zeros(n)
    state[:2] = proportional, derivative
    none = LqrGains(np.zeros(n), 0.0)
    return LinearLaw(
        plant,
        LqrGains(state, weights.integral * plant.mass * w**3 * plant.period),
        none,
        _difference(plant),
        0.0,
        feedforward=False,
        reference_gain=np.array([proportional, derivative, 0.0]),
    )


def _difference(plant: LinearPlant) -> ReducedOrderFilter:
    """The filtered difference quotient as a filter whose model is that nothing moves."""
    rows = np.zeros((3, plant.sampled().A.shape[0] + 2))
    rows[0, 0], rows[1, 1] = 1.0, _FORGETTING
    gain = np.array([(1 - _FORGETTING) / plant.period, 0.0])
    return ReducedOrderFilter(rows, gain, np.full((2, 2), np.nan), float("nan"))
