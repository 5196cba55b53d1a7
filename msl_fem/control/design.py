"""A controller from physical wishes, bandwidth and peak sensitivity: the weights are searched, what was got is said."""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from msl_fem.actuator import Actuator
from msl_fem.control.believed_plant import BelievedPlant, believed_plant
from msl_fem.control.controller import ControllerParameters
from msl_fem.control.inverse import Inverse, force_domain, held_stiffness, inverse_of
from msl_fem.control.kalman import FilterNoise, reduced_order_filter
from msl_fem.control.linear_loop import LinearLaw, flat_band, grid, sensitivity_bound
from msl_fem.control.linear_loop import bandwidth as _bandwidth
from msl_fem.control.lqr import Weights, lqr_gains
from msl_fem.control.weight_search import Wish, check_wish, feedback_bandwidth, search_weights
from msl_fem.coupled_model.plant import plant_parameters, surface_of
from msl_fem.errors import InputError
from msl_fem.operating_map.guard import Guard
from msl_fem.operating_map.level_currents import OperatingMap
from msl_fem.table import MagneticTable

Array = NDArray[np.float64]

BANDWIDTH = 60.0
"""Default wish in Hz: -3 dB from reference to position by the integral alone, without the feedforward."""
PEAK_SENSITIVITY = 2.0
"""Default bound on max |S| of the believed plant in its middle (ISO 14839-3 zone A ends at 3, 2 leaves 29 deg)."""
_WORKING_SHARE = 0.8  # of the travel: frozen positions up to here are made as robust as the wishes allow
_FORCE_ERROR = 0.01  # of the largest force at the nominal gap: white error and change of disturbance a sample
_LEAST_NOISE = 0.06  # of F T^2/m, what an error F of the force moves in a sample
_MODEL_DAMPING = 1.6  # velocity weight of the model's regulator: steps without overshoot
_N_FROZEN, _N_REACH = 11, 101


@dataclass(frozen=True)
class FrozenPosition:
    """The loop near a position that the magnets hold against the suspension.

    Attributes
    ----------
    position : m
    magnet_stiffness : N/m, dF/dx at the held currents, against the suspension
    peak_sensitivity : max |S| at the plant's input; inf where unstable
    bound : what no linear controller at this rate and delay can go below
    """

    position: float
    magnet_stiffness: float
    peak_sensitivity: float
    bound: float


@dataclass(frozen=True, eq=False)
class ControllerDesign:
    """A controller, what it believes, and what it promises on the believed plant.

    Attributes
    ----------
    belief : the actuator that it believes in
    law, weights : the linear part, and the weights that were found
    parameters : what the compiled controller takes
    feedback_bandwidth : Hz, -3 dB from reference to position by the integral alone
    bandwidth, flat_band : Hz, of the law as designed: -3 dB (nan where never), and within 1 dB of 0 dB
    peak_sensitivity : max |S| in the middle of the travel
    frozen : the loop at positions over the reach
    reach : m, lowest and highest position that the magnets can hold within guard, drive, table and travel
    """

    belief: Actuator
    law: LinearLaw
    weights: Weights
    parameters: ControllerParameters
    feedback_bandwidth: float
    bandwidth: float
    flat_band: float
    peak_sensitivity: float
    frozen: tuple[FrozenPosition, ...]
    reach: tuple[float, float]

    def to_json(self) -> dict[str, Any]:
        """The JSON object: what was got, the reach, the frozen positions, and the law with its gains."""
        return {
            "bandwidth_Hz": _number(self.bandwidth),
            "flat_band_Hz": self.flat_band,
            "feedback_bandwidth_Hz": _number(self.feedback_bandwidth),
            "peak_sensitivity": self.peak_sensitivity,
            "reach_m": list(self.reach),
            "frozen": [
                {"position_m": p.position, "peak_sensitivity": _number(p.peak_sensitivity), "lower_bound": p.bound}
                for p in self.frozen
            ],
            "law": {
                "kind": "feedback linearization, LQR with integral, reduced-order Kalman filter",
                "feedforward": self.law.feedforward,
                "states": list(self.law.plant.sampled().states),
                "gain": self.law.gains.state.tolist(),
                "integral_gain": self.law.gains.integral,
                "model_gain": self.law.model_gains.state.tolist(),
                "filter_gain": self.law.estimator.gain.tolist(),
                "gap_lead_s": self.law.gap_lead,
                "rate_Hz": 1 / self.law.plant.period,
                "delay_samples": self.law.plant.delay,
            },
        }


def _number(value: float) -> float | None:
    """For JSON, which has no nan or infinity."""
    return value if math.isfinite(value) else None


def design_controller(
    actuator: Actuator, table: MagneticTable, operating_map: OperatingMap, *, bandwidth: float = BANDWIDTH,
    peak_sensitivity: float | None = PEAK_SENSITIVITY, feedforward: bool = True,
) -> ControllerDesign:  # fmt: skip
    """The controller for an actuator that is believed to be as its file, table and map say.

    Parameters
    ----------
    bandwidth : Hz, wished for the feedback: -3 dB from reference to position by the integral alone
    peak_sensitivity : bound on max |S| in the middle of the travel; None: none
    feedforward : two degrees of freedom; without, the reference acts by the integral alone as in the source paper

    The weights of the regulator are searched (Nelder and Mead) for the least peak sensitivity over the frozen positions
    of the inner 80 % of the reach that keeps the wishes.

    Raises
    ------
    ActuatorError : a section that a design needs is missing
    InputError : wishes that no weights fulfil (the message says what was got), or that are not positive; a table and a
        map that do not belong together; nothing that the magnets can hold
    """
    plant, coupled = believed_plant(actuator), plant_parameters(actuator)
    wish = Wish(bandwidth, peak_sensitivity)
    check_wish(wish, plant)
    inverse = inverse_of(coupled, Guard(operating_map), surface_of(table))
    reach = _reach(inverse, plant, coupled.constant_force, coupled.travel)
    estimator = reduced_order_filter(plant, _filter_noise(actuator, inverse, plant))
    model_gains = lqr_gains(plant, Weights(2 * 2 * np.pi * bandwidth, _MODEL_DAMPING, 0.0))

    def law_of(weights: Weights) -> LinearLaw:
        return LinearLaw(plant, lqr_gains(plant, weights), model_gains, estimator, plant.lead, feedforward)

    def stiffness_at(position: float) -> float:
        return held_stiffness(inverse, plant.stiffness * position - coupled.constant_force, position)

    inner = [stiffness_at(_WORKING_SHARE * x) for x in (reach[0], reach[0] / 2, reach[1] / 2, reach[1])]
    weights = search_weights(law_of, sorted({0.0, *inner}), wish)
    law = law_of(weights)
    f = grid(plant.period)
    positions = np.linspace(*reach, _N_FROZEN)
    return ControllerDesign(
        belief=actuator,
        law=law,
        weights=weights,
        parameters=_parameters(law, inverse, coupled.constant_force),
        feedback_bandwidth=feedback_bandwidth(law),
        bandwidth=_bandwidth(law.reference_response(f), f),
        flat_band=flat_band(law.reference_response(f), f),
        peak_sensitivity=law.peak_sensitivity(),
        frozen=tuple(_frozen(law, float(x), stiffness_at(float(x))) for x in positions),
        reach=reach,
    )


def with_measured_gap(design: ControllerDesign) -> ControllerDesign:
    """The same controller, its currents inverted at the measured gap, as in the source paper."""
    law = replace(design.law, gap_lead=0.0)
    return replace(
        design,
        law=law,
        parameters=design.parameters._replace(gap_lead=0.0),
        frozen=tuple(_frozen(law, p.position, p.magnet_stiffness) for p in design.frozen),
    )


def _reach(inverse: Inverse, plant: BelievedPlant, constant_force: float, travel: float) -> tuple[float, float]:
    """Lowest and highest position that can be held, from the middle outwards."""
    ends = []
    for sign in (-1.0, 1.0):
        last = None
        for x in sign * np.linspace(0, min(travel, inverse.nominal_gap), _N_REACH):
            domain = force_domain(inverse, float(x))
            judged = domain.highest > 0 and (inverse.sides == 1 or domain.lowest < 0)
            if not (judged and domain.lowest <= plant.stiffness * x - constant_force <= domain.highest):
                break
            last = float(x)
        if last is None:
            raise InputError(
                "the magnets cannot hold the middle of the travel within the guard, the drive and the table; "
                "look at the operating map at the nominal gap"
            )
        ends.append(last)
    return ends[0], ends[1]


def _filter_noise(actuator: Actuator, inverse: Inverse, plant: BelievedPlant) -> FilterNoise:
    """Noise of the sensor with its resolution; errors of the force as a share of the largest at the nominal gap.

    A position noise far below what the force error moves in a sample would make the filter a bare difference quotient,
    which costs phase margin and gains nothing; it is raised to a share of that.
    """
    sensor, domain = actuator.position_sensor, force_domain(inverse, 0.0)
    force = _FORCE_ERROR * max(domain.highest, -domain.lowest)
    least = _LEAST_NOISE * force * plant.period**2 / plant.mass
    position = max(float(np.hypot(sensor.noise, sensor.resolution / np.sqrt(12))), least)
    return FilterNoise(position=position, force=force, disturbance=force)


def _frozen(law: LinearLaw, position: float, magnet_stiffness: float) -> FrozenPosition:
    return FrozenPosition(
        position,
        magnet_stiffness,
        law.peak_sensitivity(magnet_stiffness=magnet_stiffness),
        sensitivity_bound(law.plant, magnet_stiffness=magnet_stiffness),
    )


def _parameters(law: LinearLaw, inverse: Inverse, constant_force: float) -> ControllerParameters:
    plant, model = law.plant, law.plant.sampled()
    return ControllerParameters(
        inverse=inverse,
        model_a=np.ascontiguousarray(model.A),
        model_b=np.ascontiguousarray(model.B[:, 0]),
        gain=np.ascontiguousarray(law.gains.state),
        integral_gain=law.gains.integral,
        model_gain=np.ascontiguousarray(law.model_gains.state),
        filter_prediction=np.ascontiguousarray(law.estimator.prediction),
        filter_gain=np.ascontiguousarray(law.estimator.gain),
        mass=plant.mass,
        stiffness=plant.stiffness,
        damping=plant.damping,
        constant_force=constant_force,
        delay=plant.delay,
        lead=plant.lead,
        gap_lead=law.gap_lead,
        feedforward=law.feedforward,
    )
