"""A controller and what it promises on the plant that it believes in."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from msl_fem.actuator import Actuator
from msl_fem.control.belief import Belief, reach_of
from msl_fem.control.controller import ControllerParameters
from msl_fem.control.linear_loop import AtPosition, LinearLaw, flat_band, grid, sensitivity_bound
from msl_fem.control.linear_loop import bandwidth as _bandwidth
from msl_fem.control.lqr import Weights
from msl_fem.control.output_stage import HARD_HAND_OVER, Stage
from msl_fem.control.weight_search import feedback_bandwidth

KINDS = {
    "lqr": "feedback linearization, LQR with integral, reduced-order Kalman filter",
    "robust": "feedback linearization, LQR with integral and section against a family of plants, Kalman filter",
    "biased": "Jacobian linearisation about a bias current, LQR with integral, reduced-order Kalman filter",
    "pid": "feedback linearization, PID on the position with filtered derivative",
}
"""The designs, and what each is."""
PlaceAt = Callable[[float], AtPosition]
_ZONE_ENDS = (3.0, 4.0, 5.0)
_N_FROZEN = 21


@dataclass(frozen=True)
class FrozenPosition:
    """The loop near a position that the magnets hold against the suspension.

    Attributes
    ----------
    position : m
    at : what the magnets do there
    peak_sensitivity : max |S| at the plant's input; inf where unstable
    bound : what no linear controller at this rate and delay can go below
    """

    position: float
    at: AtPosition
    peak_sensitivity: float
    bound: float

    @property
    def magnet_stiffness(self) -> float:
        """N/m, dF/dx at the held currents, against the suspension that the law believes in."""
        return self.at.magnet_stiffness

    @property
    def zone(self) -> str:
        """The zone of ISO 14839-3 (2006): A up to 3, B up to 4, C up to 5, D beyond."""
        return "ABCD"[sum(self.peak_sensitivity > limit for limit in _ZONE_ENDS)]


@dataclass(frozen=True, eq=False)
class ControllerDesign:
    """A controller, what it believes, and what it promises on the believed plant.

    Attributes
    ----------
    kind : lqr, robust, biased or pid
    belief : the actuator that it believes in
    law, weights : the linear part, and the weights that were found
    parameters : what the compiled controller takes
    feedback_bandwidth : Hz, -3 dB from reference to position by the integral alone
    bandwidth, flat_band : Hz, of the law as designed: -3 dB (nan where never), and within 1 dB of 0 dB
    peak_sensitivity : max |S| in the middle of the travel
    frozen : the loop at positions over the reach
    reach : m, lowest and highest position that the magnets can hold within guard, drive, table and travel
    suspension : N/m, believed
    domain : the JSON object of where the input transformation has an inverse
    """

    kind: str
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
    suspension: float
    domain: Mapping[str, Any]

    @property
    def stable_reach(self) -> tuple[float, float]:
        """Lowest and highest of the frozen positions, from the middle outwards, that are stable; nan, nan if none."""
        x, stable = [p.position for p in self.frozen], [math.isfinite(p.peak_sensitivity) for p in self.frozen]
        low = high = int(np.argmin(np.abs(x)))
        if not stable[low]:
            return math.nan, math.nan
        while low > 0 and stable[low - 1]:
            low -= 1
        while high < len(x) - 1 and stable[high + 1]:
            high += 1
        return x[low], x[high]

    @property
    def zone_reach(self) -> dict[str, float]:
        """m to either side up to which frozen positions are in a zone of ISO 14839-3 or a better one; 0 where none."""
        found = {}
        for zone in "ABC":
            beyond = [abs(p.position) for p in self.frozen if p.zone > zone]
            inside = [abs(p.position) for p in self.frozen if abs(p.position) < min(beyond, default=math.inf)]
            found[zone] = max(inside, default=0.0)
        return found

    def to_json(self) -> dict[str, Any]:
        """The JSON object: what was got, the reach, the frozen positions, and the law with its gains."""
        stage = self.parameters.stage
        return {
            "design": self.kind,
            "bandwidth_Hz": _number(self.bandwidth),
            "flat_band_Hz": self.flat_band,
            "feedback_bandwidth_Hz": _number(self.feedback_bandwidth),
            "peak_sensitivity": self.peak_sensitivity,
            "reach_m": list(self.reach),
            "stable_reach_m": [_number(x) for x in self.stable_reach],
            "inverse_domain": dict(self.domain),
            "frozen": [
                {
                    "position_m": p.position,
                    "peak_sensitivity": _number(p.peak_sensitivity),
                    "lower_bound": p.bound,
                    "iso_14839_3_zone": p.zone,
                }
                for p in self.frozen
            ],
            "law": {
                "kind": KINDS[self.kind],
                "feedforward": self.law.feedforward,
                "states": list(self.law.plant.sampled().states),
                "gain": self.law.gains.state.tolist(),
                "integral_gain": self.law.gains.integral,
                "model_gain": self.law.model_gains.state.tolist(),
                "filter_gain": self.law.estimator.gain.tolist(),
                "gap_lead_s": self.law.gap_lead,
                "shape": list(self.law.shape),
                "reference_gain": self.law.reference_gain.tolist(),
                "stage": {"overlap_N": stage.overlap, "bias_A": stage.bias},
                "rate_Hz": 1 / self.law.plant.period,
                "delay_samples": self.law.plant.delay,
            },
        }


def _number(value: float) -> float | None:
    """For JSON, which has no nan or infinity."""
    return value if math.isfinite(value) else None


@dataclass(frozen=True, eq=False)
class Made:
    """What a way of designing comes to: the linear law, its weights, the output stage, the magnets at a position."""

    kind: str
    law: LinearLaw
    weights: Weights
    place_at: PlaceAt
    stage: Stage = HARD_HAND_OVER
    reach: tuple[float, float] | None = None


def completed(belief: Belief, made: Made) -> ControllerDesign:
    """The design with its figures on the believed plant; the reach is the belief's where none is stated."""
    law, reach = made.law, made.reach or reach_of(belief)
    f = grid(law.plant.period)
    response = law.reference_response(f)
    positions = np.linspace(*reach, _N_FROZEN)
    return ControllerDesign(
        kind=made.kind,
        belief=belief.actuator,
        law=law,
        weights=made.weights,
        parameters=_parameters(belief, law, made.stage),
        feedback_bandwidth=feedback_bandwidth(law),
        bandwidth=_bandwidth(response, f),
        flat_band=flat_band(response, f),
        peak_sensitivity=law.peak_sensitivity(made.place_at(0.0)),
        frozen=tuple(_frozen(law, float(x), made.place_at(float(x))) for x in positions),
        reach=reach,
        suspension=belief.plant.stiffness,
        domain=belief.domain(),
    )


def with_measured_gap(design: ControllerDesign) -> ControllerDesign:
    """The same controller, its currents inverted at the measured gap, as in the source paper."""
    law = replace(design.law, gap_lead=0.0)
    return replace(
        design,
        law=law,
        parameters=design.parameters._replace(gap_lead=0.0),
        frozen=tuple(_frozen(law, p.position, p.at) for p in design.frozen),
    )


def _frozen(law: LinearLaw, position: float, at: AtPosition) -> FrozenPosition:
    return FrozenPosition(
        position,
        at,
        law.peak_sensitivity(at),
        sensitivity_bound(law.plant, magnet_stiffness=at.magnet_stiffness),
    )


def _parameters(belief: Belief, law: LinearLaw, stage: Stage) -> ControllerParameters:
    plant, model = law.plant, law.plant.sampled()
    return ControllerParameters(
        inverse=belief.inverse,
        stage=stage,
        model_a=np.ascontiguousarray(model.A),
        model_b=np.ascontiguousarray(model.B[:, 0]),
        gain=np.ascontiguousarray(law.gains.state),
        integral_gain=law.gains.integral,
        shape=np.array(law.shape),
        model_gain=np.ascontiguousarray(law.model_gains.state),
        reference_gain=np.ascontiguousarray(law.reference_gain),
        filter_prediction=np.ascontiguousarray(law.estimator.prediction),
        filter_gain=np.ascontiguousarray(law.estimator.gain),
        mass=plant.mass,
        stiffness=plant.stiffness,
        damping=plant.damping,
        constant_force=belief.coupled.constant_force,
        cubic=belief.cubic,
        delay=plant.delay,
        lead=plant.lead,
        gap_lead=law.gap_lead,
        feedforward=law.feedforward,
    )
