"""LQR with integral and a reduced-order Kalman filter from physical wishes: the weights are searched."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from msl_fem.actuator import Actuator
from msl_fem.computing.arrays import Array
from msl_fem.control.design import (
    ControllerChoice,
    ControllerDesign,
    DesignKind,
    LinearDesign,
    Wish,
    check_wish,
    completed,
)
from msl_fem.control.design_model import AtPosition, DesignModel, design_model_of, reach_of
from msl_fem.control.inverse import force_domain
from msl_fem.control.linear_loop import LinearLaw, feedback_bandwidth, grid
from msl_fem.control.linear_plant import LinearPlant
from msl_fem.control.lqg import FilterNoise, LqrGains, LqrWeights, ReducedOrderFilter, lqr_gains, reduced_order_filter
from msl_fem.control.output_stage import HARD_HAND_OVER, INVERSE, OutputStage
from msl_fem.control.shared_force import shared_force
from msl_fem.errors import ComputationError, InputError
from msl_fem.maps.level_currents import OperatingMap
from msl_fem.table.magnetic_table import MagneticTable

_GRID = 120
_OPTIONS = {"maxfev": 120, "xatol": 1e-2, "fatol": 3e-3}
_STARTS = ((1.6, 1.5, 1.0), (0.8, 3.0, 8.0))  # frequency over the bandwidth, velocity and integral weights
_MISSED = 100.0  # a wish missed by its whole counts like a peak sensitivity of this much more
_HOPELESS = 30.0  # an unstable frozen position counts like a peak sensitivity of this, times its spectral radius
BANDWIDTH = 60.0
"""Default wish in Hz: -3 dB from reference to position by the integral alone, without the feedforward."""
PEAK_SENSITIVITY = 2.0
"""Default bound on max |S| of the believed plant in its middle (ISO 14839-3 zone A ends at 3, 2 leaves 29 deg)."""
WORKING_SHARE = 0.8
_FORCE_ERROR = 0.01  # of the largest force at the nominal gap: white error and change of disturbance a sample
_LEAST_NOISE = 0.06  # of F T^2/m, what an error F of the force moves in a sample
_MODEL_DAMPING = 1.6  # velocity weight of the model's regulator: steps without overshoot

LawOf = Callable[[LqrWeights], LinearLaw]
_SIMPLEX = np.vstack([np.zeros(3), 0.4 * np.eye(3)]) - 0.1


@dataclass(frozen=True)
class LqrLaws:
    """The laws that follow from a linear belief and the filter's noise, by the regulator's weights."""

    plant: LinearPlant
    noise: FilterNoise
    wish: Wish
    gap_lead: float
    feedforward: bool

    def __call__(self, weights: LqrWeights) -> LinearLaw:
        gains = lqr_gains(self.plant, weights)
        return LinearLaw(self.plant, gains, self._model_gains, self._estimator, self.gap_lead, self.feedforward)

    @cached_property
    def _model_gains(self) -> LqrGains:
        return following_gains(self.plant, self.wish)

    @cached_property
    def _estimator(self) -> ReducedOrderFilter:
        return reduced_order_filter(self.plant, self.noise)


def search_weights(law_of: LawOf, places: Sequence[AtPosition], wish: Wish) -> LqrWeights:
    """The weights of least worst peak sensitivity over frozen positions (the first is the middle) that keep the wish;
    of equal laws, places and wishes they are searched once.

    Raises
    ------
    InputError : no weights were found that keep it; the message says what was got
    """
    return _searched(law_of, tuple(places), wish)


@lru_cache(maxsize=32)
def _searched(law_of: LawOf, places: tuple[AtPosition, ...], wish: Wish) -> LqrWeights:
    ends = []
    for ratio, velocity, integral in _STARTS:  # the bandwidth jumps where the response dips, so one start may be stuck
        start = np.log([2 * np.pi * ratio * wish.bandwidth, velocity, integral])
        ends.append(_descend(law_of, start, places, wish))
    start = min(ends, key=lambda end: end[0])[1]
    weights = _weights(_descend(law_of, start, places, wish)[1])  # a fresh simplex where the last one has shrunk
    law = law_of(weights)
    got = feedback_bandwidth(law)
    peak = law.peak_sensitivity(places[0])
    if not np.isfinite(peak) or not wish.kept_by(got, peak):
        raise InputError(
            f"no weights give a {wish}; the nearest got {got:.4g} Hz and "
            f"{peak:.3g}: lower the bandwidth, allow more peak sensitivity, or raise the loop rate"
        )
    return weights


def _descend(law_of: LawOf, start: Array, places: Sequence[AtPosition], wish: Wish) -> tuple[float, Array]:
    """(badness, logarithms of the weights) downhill from a start."""
    from scipy.optimize import minimize

    options = {**_OPTIONS, "initial_simplex": start + _SIMPLEX}
    end = minimize(lambda w: _badness(law_of, w, places, wish), start, method="Nelder-Mead", options=options)
    return float(end.fun), np.asarray(end.x)


def _weights(logarithms: Array) -> LqrWeights:
    return LqrWeights(*(float(w) for w in np.exp(np.clip(logarithms, -20, 20))))


def _badness(law_of: LawOf, logarithms: Array, places: Sequence[AtPosition], wish: Wish) -> float:
    try:
        law = law_of(_weights(logarithms))
    except ComputationError:
        return 1e6
    f = grid(law.plant.period, _GRID)
    peaks = [law.peak_sensitivity(place, frequency=f) for place in places]
    if np.isinf(peaks[0]):
        return 1e5
    missed = wish.missed_by(feedback_bandwidth(law, _GRID), peaks[0])
    worst = 0.0
    for place, peak in zip(places, peaks, strict=True):
        hopeless = _HOPELESS * law.spectral_radius(place) if np.isinf(peak) else 0.0
        worst = max(worst, hopeless or min(peak, _HOPELESS))
    return worst + _MISSED * missed


DEFAULT_WISH = Wish(BANDWIDTH, PEAK_SENSITIVITY)


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
    actuator: Actuator,
    table: MagneticTable,
    operating_map: OperatingMap,
    *,
    bandwidth: float = BANDWIDTH,
    peak_sensitivity: float | None = PEAK_SENSITIVITY,
    feedforward: bool = True,
) -> ControllerDesign:
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
    model = design_model_of(actuator, table, operating_map)
    return lqr_design(model, Wish(bandwidth, peak_sensitivity), options=LqrOptions(feedforward=feedforward))


def lqr_design(model: DesignModel, wish: Wish = DEFAULT_WISH, *, options: LqrOptions | None = None) -> ControllerDesign:
    """The LQR controller of a belief.

    The weights of the regulator are searched (Nelder and Mead) for the least peak sensitivity over the frozen positions
    of the inner 80 % of the reach that keeps the wishes. Raises as `design_controller`.
    """
    options = options or LqrOptions()
    check_wish(wish, model.plant)
    stage = stage_with_overlap(model, options.overlap)
    law_of = LqrLaws(model.plant, usual_noise(model), wish, model.plant.lead, options.feedforward)
    places = working_places(model, overlap=options.overlap, share=options.working_share)
    weights = search_weights(law_of, places, wish)
    return completed(
        model, LinearDesign(LQR, law_of(weights), weights, lambda x: model.place(x, overlap=options.overlap), stage)
    )


def _lqr(model: DesignModel, wish: Wish, choice: ControllerChoice) -> ControllerDesign:
    return lqr_design(model, wish, options=LqrOptions(choice.feedforward, choice.overlap))


LQR = DesignKind(
    "lqr",
    "feedback linearization, LQR with integral, reduced-order Kalman filter",
    DEFAULT_WISH,
    frozenset({"feedforward", "overlap"}),
    _lqr,
)


def stage_with_overlap(model: DesignModel, overlap: float) -> OutputStage:
    """The inverse with both sides pulling with `overlap` N at zero force; InputError where they cannot.

    With the table of the pair it takes what the sides' armature shares.
    """
    if overlap == 0.0:
        return HARD_HAND_OVER
    domain = force_domain(model.inverse, 0.0)
    most = min(domain.highest, -domain.lowest)
    if model.inverse.sides < 2 or not 0.0 <= overlap < most:
        raise InputError(
            f"an overlap of {overlap:g} N is not possible; it must be 0 ... {most:.4g} N, what each of two sides can "
            "pull with in the middle"
        )
    if model.shared is None:
        return OutputStage(INVERSE, overlap, 0.0, 1.0)
    reach, polarity = reach_of(model), model.coupled.polarity
    common = shared_force(model.inverse, model.shared, polarity=polarity, overlap=overlap, reach=reach)
    return OutputStage(INVERSE, overlap, 0.0, 1.0, common)


def working_places(model: DesignModel, *, overlap: float = 0.0, share: float = WORKING_SHARE) -> tuple[AtPosition, ...]:
    """The middle, then frozen positions at half and whole of a share of the reach."""
    low, high = reach_of(model)
    positions = (share * x for x in (low, low / 2, high / 2, high))
    places = {model.place(x, overlap=overlap) for x in positions}
    middle = model.place(0.0, overlap=overlap) if model.coupled.constant_force == 0.0 else AtPosition()
    return (middle, *sorted(places - {middle}, key=lambda place: place.magnet_stiffness))


def following_gains(plant: LinearPlant, wish: Wish) -> LqrGains:
    """The state feedback of the model that the loop follows."""
    return lqr_gains(plant, LqrWeights(2 * 2 * np.pi * wish.bandwidth, _MODEL_DAMPING, 0.0))


def usual_filter(model: DesignModel) -> ReducedOrderFilter:
    """The Kalman filter for `usual_noise`."""
    return reduced_order_filter(model.plant, usual_noise(model))


def usual_noise(model: DesignModel) -> FilterNoise:
    """Noise of the sensor with its resolution; errors of the force as a share of the largest at the nominal gap.

    A position noise far below what the force error moves in a sample would make the filter a bare difference quotient,
    which costs phase margin and gains nothing; it is raised to a share of that.
    """
    sensor = model.actuator.position_sensor
    domain = force_domain(model.inverse, 0.0)
    force = _FORCE_ERROR * max(domain.highest, -domain.lowest)
    least = _LEAST_NOISE * force * model.plant.period**2 / model.plant.mass
    position = max(float(np.hypot(sensor.noise, sensor.resolution / np.sqrt(12))), least)
    return FilterNoise(position=position, force=force, disturbance=force)
