"""The other baseline: PID on the position, its force through the same inverse at the measured gap.

    F = K_p (r - y) + K_i T sum(r - y) + K_d (r' - d),   d the difference quotient of y behind a first-order filter

(Astrom and Hagglund, Advanced PID Control, 2006, ch. 3). It differs from the LQR in the linear law alone: no model, no
Kalman filter, no feedforward of the reference's acceleration.
"""

import numpy as np

from msl_fem.control.belief import Belief
from msl_fem.control.believed_plant import BelievedPlant
from msl_fem.control.design import ControllerDesign, Made, completed
from msl_fem.control.kalman import ReducedOrderFilter
from msl_fem.control.linear_loop import LinearLaw
from msl_fem.control.lqr import LqrGains, Weights
from msl_fem.control.lqr_design import DEFAULT_WISH, stage_with_overlap, working_places
from msl_fem.control.weight_search import Wish, check_wish, search_weights

_FORGETTING = 0.3  # of the difference quotient, a sample: a time constant of 0.83 samples


def pid_design(belief: Belief, wish: Wish = DEFAULT_WISH, *, overlap: float = 0.0) -> ControllerDesign:
    """The PID controller of a belief, its gains searched for the same wish as the LQR's weights.

    `Weights` hold w, q_v, q_i of K_p = m w^2, K_d = q_v m w, K_i = q_i m w^3.

    Raises
    ------
    InputError : a wish that no gains keep
    """
    check_wish(wish, belief.plant)
    stage = stage_with_overlap(belief, overlap)

    def law_of(weights: Weights) -> LinearLaw:
        return _law(belief.plant, weights)

    weights = search_weights(law_of, working_places(belief, overlap=overlap), wish)
    return completed(belief, Made("pid", law_of(weights), weights, lambda x: belief.place(x, overlap=overlap), stage))


def _law(plant: BelievedPlant, weights: Weights) -> LinearLaw:
    n, w = plant.sampled().A.shape[0], weights.frequency
    proportional, derivative = plant.mass * w**2, weights.velocity * plant.mass * w
    state = np.zeros(n)
    state[:2] = proportional, derivative
    none = LqrGains(np.zeros(n), 0.0)
    return LinearLaw(
        plant, LqrGains(state, weights.integral * plant.mass * w**3 * plant.period), none, _difference(plant), 0.0,
        feedforward=False, reference_gain=np.array([proportional, derivative, 0.0]),
    )  # fmt: skip


def _difference(plant: BelievedPlant) -> ReducedOrderFilter:
    """The filtered difference quotient as a filter whose model is that nothing moves."""
    rows = np.zeros((3, plant.sampled().A.shape[0] + 2))
    rows[0, 0], rows[1, 1] = 1.0, _FORGETTING
    gain = np.array([(1 - _FORGETTING) / plant.period, 0.0])
    return ReducedOrderFilter(rows, gain, np.full((2, 2), np.nan), float("nan"))
