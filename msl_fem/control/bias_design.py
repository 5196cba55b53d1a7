"""The usual baseline: both sides carry a bias current, and the plant is its tangent there.

F_1(i_b + d, g_0 - x) - F_2(i_b - d, g_0 + x) = k_i d + k_s x + ...: the bias makes the force linear in the control
current d, and the mover unstable once k_s exceeds the suspension (Schweitzer, Maslen (ed.), Magnetic Bearings, 2009,
ch. 4; Gutierrez and Ro 1998 call it the Jacobian linearisation and say that its bias is about ten times the control
current).
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from msl_fem.control.belief import Belief, reach_of
from msl_fem.control.design import ControllerDesign, Made, completed
from msl_fem.control.inverse import magnet_current_limit, side_gap, side_surface
from msl_fem.control.kalman import reduced_order_filter
from msl_fem.control.linear_loop import AtPosition, LinearLaw
from msl_fem.control.lqr import Weights, lqr_gains
from msl_fem.control.lqr_design import DEFAULT_WISH, WORKING_SHARE, following_gains, usual_noise
from msl_fem.control.output_stage import BIAS, Stage
from msl_fem.control.weight_search import Wish, check_wish, search_weights
from msl_fem.errors import InputError
from msl_fem.table.coenergy_surface import evaluate

Array = NDArray[np.float64]

_FORCE, _CURRENT_SLOPE, _GAP_SLOPE = 2, 4, 5  # rows of an evaluation of the surface, see `coenergy_surface.evaluate`
_N_POSITION = 51
_DEFAULT_SHARE = 1.0  # of the suspension's stiffness that the default bias takes away


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


def biased_design(belief: Belief, wish: Wish = DEFAULT_WISH, *, options: BiasOptions | None = None) -> ControllerDesign:
    """The LQR controller on the tangent of the plant at a bias current.

    Raises
    ------
    InputError : one side only; a bias that guard or drive forbid in the middle, wishes that cannot be kept
    """
    options = options or BiasOptions()
    if belief.inverse.sides < 2:
        raise InputError(f"{belief.actuator.name} has one side; a bias current needs two that balance")
    check_wish(wish, belief.plant)
    bias = default_bias(belief) if options.bias is None else options.bias
    points = held_points(belief, bias)
    middle = bias_point(belief, bias, 0.0)
    assert middle is not None
    tangent = replace(belief.plant, stiffness=belief.plant.stiffness - middle.magnet_stiffness)
    around = replace(belief, plant=tangent)
    estimator, model_gains = reduced_order_filter(tangent, usual_noise(belief)), following_gains(around, wish)

    def law_of(weights: Weights) -> LinearLaw:
        return LinearLaw(tangent, lqr_gains(tangent, weights), model_gains, estimator, 0.0, options.feedforward)

    def place_of(point: BiasPoint) -> AtPosition:
        gain = point.force_per_current / middle.force_per_current
        return AtPosition(point.magnet_stiffness - middle.magnet_stiffness, 0.0, gain)

    def place_at(position: float) -> AtPosition:
        point = bias_point(belief, bias, position)
        if point is None:
            raise InputError(f"a bias of {bias:.4g} A holds no {position * 1e3:.4g} mm within guard and drive")
        return place_of(point)

    ends = points[0].position, points[-1].position
    places = [place_of(middle)] + [place_at(WORKING_SHARE * x) for x in (ends[0], ends[0] / 2, ends[1] / 2, ends[1])]
    weights = search_weights(law_of, places, wish)
    law, stage = law_of(weights), Stage(BIAS, 0.0, bias, middle.force_per_current)
    return completed(belief, Made("biased", law, weights, place_at, stage, ends))


def default_bias(belief: Belief) -> float:
    """The bias in A at which the magnets take the suspension's stiffness away, at most half of what is allowed."""
    limit = _limit(belief, 0, 0.0)
    low, high = 0.0, 0.5 * limit
    wanted = _DEFAULT_SHARE * belief.plant.stiffness
    for _ in range(50):
        bias = 0.5 * (low + high)
        point = bias_point(belief, bias, 0.0)
        if point is not None and point.magnet_stiffness < wanted:
            low = bias
        else:
            high = bias
    return low


def held_points(belief: Belief, bias: float) -> list[BiasPoint]:
    """The positions over the reach, from the middle outwards, that currents about the bias hold; in order.

    Raises
    ------
    InputError : not even the middle
    """
    if not 0.0 < bias < _limit(belief, 0, 0.0):
        raise InputError(
            f"a bias of {bias:.4g} A is not possible; it must be above 0 and below the {_limit(belief, 0, 0.0):.4g} A "
            "that guard, drive and table allow in the middle"
        )
    found: list[BiasPoint] = []
    for end in reach_of(belief):
        for x in np.linspace(0.0, end, _N_POSITION)[0 if end > 0 else 1 :]:
            point = bias_point(belief, bias, float(x))
            if point is None:
                break
            found.append(point)
    if not found:
        raise InputError(f"a bias of {bias:.4g} A does not hold the middle within guard, drive and table")
    return sorted(found, key=lambda point: point.position)


def bias_point(belief: Belief, bias: float, position: float) -> BiasPoint | None:
    """How the mover is held at a position in m about the bias in A; None where guard, drive or table forbid it.

    The control current is found by bisection: the force grows with it. A side that it would reverse carries nothing.
    """
    wanted = belief.holding_force(position)
    low, high = -_limit(belief, 1, position) - bias, _limit(belief, 0, position) - bias
    low, high = max(low, -_limit(belief, 1, position) + bias), high
    if not low <= high:
        return None
    forces = [_forces(belief, bias, d, position) for d in (low, high)]
    if not forces[0][0] <= wanted <= forces[1][0]:
        return None
    for _ in range(60):
        control = 0.5 * (low + high)
        if _forces(belief, bias, control, position)[0] > wanted:
            high = control
        else:
            low = control
    _, per_current, stiffness = _forces(belief, bias, control, position)
    return BiasPoint(position, control, per_current, stiffness)


def _limit(belief: Belief, side: int, position: float) -> float:
    """A of a side that guard, drive and table allow."""
    limit = magnet_current_limit(belief.inverse, side_gap(belief.inverse, side, position))
    return float(limit / belief.inverse.current_share)


def _forces(belief: Belief, bias: float, control: float, position: float) -> tuple[float, float, float]:
    """(force N, its slope by d in N/A, its slope by x in N/m) of both sides."""
    inverse = belief.inverse
    total = slope = stiffness = 0.0
    for side, toward in ((0, 1.0), (1, -1.0)):
        current = bias + toward * control
        if current > 0.0:
            out = np.empty(6)
            gap = side_gap(inverse, side, position)
            evaluate(*side_surface(inverse, side), current * inverse.current_share, gap, out)
            total += toward * inverse.magnets * float(out[_FORCE])
            slope += inverse.magnets * inverse.current_share * float(out[_CURRENT_SLOPE])
            stiffness -= inverse.magnets * float(out[_GAP_SLOPE])
    return total, slope, stiffness
