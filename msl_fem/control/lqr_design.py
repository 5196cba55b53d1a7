"""LQR with integral and a reduced-order Kalman filter from physical wishes: the weights are searched."""

from dataclasses import dataclass

import numpy as np

from msl_fem.actuator import Actuator
from msl_fem.control.belief import Belief, belief_of, reach_of
from msl_fem.control.design import ControllerDesign, Made, completed
from msl_fem.control.inverse import force_domain
from msl_fem.control.kalman import FilterNoise, ReducedOrderFilter, reduced_order_filter
from msl_fem.control.linear_loop import AtPosition, LinearLaw
from msl_fem.control.lqr import LqrGains, Weights, lqr_gains
from msl_fem.control.output_stage import HARD_HAND_OVER, INVERSE, Stage
from msl_fem.control.weight_search import Wish, check_wish, search_weights
from msl_fem.errors import InputError
from msl_fem.maps.level_currents import OperatingMap
from msl_fem.table.magnetic_table import MagneticTable

BANDWIDTH = 60.0
"""Default wish in Hz: -3 dB from reference to position by the integral alone, without the feedforward."""
PEAK_SENSITIVITY = 2.0
"""Default bound on max |S| of the believed plant in its middle (ISO 14839-3 zone A ends at 3, 2 leaves 29 deg)."""
DEFAULT_WISH = Wish(BANDWIDTH, PEAK_SENSITIVITY)
WORKING_SHARE = 0.8
_FORCE_ERROR = 0.01  # of the largest force at the nominal gap: white error and change of disturbance a sample
_LEAST_NOISE = 0.06  # of F T^2/m, what an error F of the force moves in a sample
_MODEL_DAMPING = 1.6  # velocity weight of the model's regulator: steps without overshoot


@dataclass(frozen=True)
class LqrOptions:
    """What may be chosen beside the wish.

    Attributes
    ----------
    feedforward : two degrees of freedom; without, the reference acts by the integral alone as in the source paper
    overlap : N with which both sides pull at zero force, see `inverse.hand_over`
    working_share : of the reach: frozen positions up to here are made as robust as the wishes allow
    """

    feedforward: bool = True
    overlap: float = 0.0
    working_share: float = WORKING_SHARE


def design_controller(
    actuator: Actuator, table: MagneticTable, operating_map: OperatingMap, *, bandwidth: float = BANDWIDTH,
    peak_sensitivity: float | None = PEAK_SENSITIVITY, feedforward: bool = True,
) -> ControllerDesign:  # fmt: skip
    """The LQR controller for an actuator that is believed to be as its file, table and map say.

    Parameters
    ----------
    bandwidth : Hz, wished for the feedback: -3 dB from reference to position by the integral alone
    peak_sensitivity : bound on max |S| in the middle of the travel; None: none
    feedforward : two degrees of freedom; without, the reference acts by the integral alone as in the source paper

    Raises
    ------
    ActuatorError : a section that a design needs is missing
    InputError : wishes that no weights fulfil (the message says what was got), or that are not positive; a table and a
        map that do not belong together; nothing that the magnets can hold
    """
    belief = belief_of(actuator, table, operating_map)
    return lqr_design(belief, Wish(bandwidth, peak_sensitivity), options=LqrOptions(feedforward=feedforward))


def lqr_design(belief: Belief, wish: Wish = DEFAULT_WISH, *, options: LqrOptions | None = None) -> ControllerDesign:
    """The LQR controller of a belief.

    The weights of the regulator are searched (Nelder and Mead) for the least peak sensitivity over the frozen positions
    of the inner 80 % of the reach that keeps the wishes. Raises as `design_controller`.
    """
    options = options or LqrOptions()
    plant = belief.plant
    check_wish(wish, plant)
    stage = stage_with_overlap(belief, options.overlap)
    estimator, model_gains = usual_filter(belief), following_gains(belief, wish)

    def law_of(weights: Weights) -> LinearLaw:
        gains = lqr_gains(plant, weights)
        return LinearLaw(plant, gains, model_gains, estimator, plant.lead, options.feedforward)

    places = working_places(belief, overlap=options.overlap, share=options.working_share)
    weights = search_weights(law_of, places, wish)
    return completed(
        belief, Made("lqr", law_of(weights), weights, lambda x: belief.place(x, overlap=options.overlap), stage)
    )


def stage_with_overlap(belief: Belief, overlap: float) -> Stage:
    """The inverse with both sides pulling with `overlap` N at zero force; InputError where they cannot."""
    if overlap == 0.0:
        return HARD_HAND_OVER
    domain = force_domain(belief.inverse, 0.0)
    most = min(domain.highest, -domain.lowest)
    if belief.inverse.sides < 2 or not 0.0 <= overlap < most:
        raise InputError(
            f"an overlap of {overlap:g} N is not possible; it must be 0 ... {most:.4g} N, what each of two sides can "
            "pull with in the middle"
        )
    return Stage(INVERSE, overlap, 0.0, 1.0)


def working_places(belief: Belief, *, overlap: float = 0.0, share: float = WORKING_SHARE) -> tuple[AtPosition, ...]:
    """The middle, then frozen positions at half and whole of a share of the reach."""
    low, high = reach_of(belief)
    positions = (share * x for x in (low, low / 2, high / 2, high))
    found = {belief.place(x, overlap=overlap) for x in positions}
    middle = belief.place(0.0, overlap=overlap) if belief.coupled.constant_force == 0.0 else AtPosition()
    return (middle, *sorted(found - {middle}, key=lambda place: place.magnet_stiffness))


def following_gains(belief: Belief, wish: Wish) -> LqrGains:
    """The state feedback of the model that the loop follows."""
    return lqr_gains(belief.plant, Weights(2 * 2 * np.pi * wish.bandwidth, _MODEL_DAMPING, 0.0))


def usual_filter(belief: Belief) -> ReducedOrderFilter:
    """The Kalman filter for `usual_noise`."""
    return reduced_order_filter(belief.plant, usual_noise(belief))


def usual_noise(belief: Belief) -> FilterNoise:
    """Noise of the sensor with its resolution; errors of the force as a share of the largest at the nominal gap.

    A position noise far below what the force error moves in a sample would make the filter a bare difference quotient,
    which costs phase margin and gains nothing; it is raised to a share of that.
    """
    sensor, domain = belief.actuator.position_sensor, force_domain(belief.inverse, 0.0)
    force = _FORCE_ERROR * max(domain.highest, -domain.lowest)
    least = _LEAST_NOISE * force * belief.plant.period**2 / belief.plant.mass
    position = max(float(np.hypot(sensor.noise, sensor.resolution / np.sqrt(12))), least)
    return FilterNoise(position=position, force=force, disturbance=force)
