"""A controller, and what it promises on the plant that it believes in."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from msl_fem.actuator import Actuator
from msl_fem.control.controller import ControllerParameters, pull_stiffness
from msl_fem.control.current_loop import CurrentLoopDesign
from msl_fem.control.design_model import AtPosition, DesignModel, reach_of
from msl_fem.control.gain_schedule import BANDWIDTH, GainSchedule, fixed_gains
from msl_fem.control.gap_to_come import position_after
from msl_fem.control.heat import UNGUARDED, ThermalGuard, thermal_guard
from msl_fem.control.linear_loop import LinearLaw, feedback_bandwidth, flat_band, grid, sensitivity_bound
from msl_fem.control.linear_loop import bandwidth as _bandwidth
from msl_fem.control.linear_plant import LinearPlant
from msl_fem.control.lqg import LqrWeights
from msl_fem.control.output_stage import HARD_HAND_OVER, OutputStage
from msl_fem.errors import InputError
from msl_fem.files.numbers import json_value
from msl_fem.losses.thermal_limit import ThermalLimit

ZONE_ENDS = (3.0, 4.0, 5.0)
"""Peak sensitivity up to which a loop is in zone A, B, C of ISO 14839-3 (2006)."""
_N_FROZEN = 21
_SLACK = 2e-3  # share of a wish that may be missed
_SLOWEST = 1e-6  # of the highest bandwidth: a slower feedback is none

PlaceAt = Callable[[float], AtPosition]


def zone_of(peak_sensitivity: float) -> str:
    """The zone of ISO 14839-3 (2006): A up to 3, B up to 4, C up to 5, D beyond."""
    return "ABCD"[sum(peak_sensitivity > limit for limit in ZONE_ENDS)]


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
        """Its `zone_of`."""
        return zone_of(self.peak_sensitivity)


@dataclass(frozen=True, eq=False)
class ControllerDesign:
    """A controller, what it believes, and what it promises on the believed plant.

    Attributes
    ----------
    kind, summary : name of the design, and what it is
    actuator : that it believes in
    law, weights : the linear part, and the weights that were found
    parameters : what the compiled controller takes
    feedback_bandwidth : Hz, -3 dB from reference to position by the integral alone
    bandwidth, flat_band : Hz, of the law as designed: -3 dB (nan where never), and within 1 dB of 0 dB
    peak_sensitivity : max |S| in the middle of the travel
    frozen : the loop at positions over the reach
    reach : m, lowest and highest position that the magnets can hold within guard, drive, table and travel
    suspension : N/m, believed
    domain : the JSON object of where the input transformation has an inverse
    schedule : how the law's gains follow the magnets' stiffness
    current_loop : around a voltage drive
    thermal : that the guard knows of the windings' heat; None: nothing
    """

    kind: str
    summary: str
    actuator: Actuator
    law: LinearLaw
    weights: LqrWeights
    parameters: ControllerParameters
    feedback_bandwidth: float
    bandwidth: float
    flat_band: float
    peak_sensitivity: float
    frozen: tuple[FrozenPosition, ...]
    reach: tuple[float, float]
    suspension: float
    domain: Mapping[str, Any]
    schedule: GainSchedule
    current_loop: CurrentLoopDesign | None = None
    thermal: ThermalGuard | None = None

    def law_at(self, position: float, push: float = 0.0) -> LinearLaw:
        """The law as its gains are where the mover is held at a position in m against a push in N along +x."""
        p = self.parameters
        held = (self.suspension + p.cubic * position**2) * position - p.constant_force - push
        return self.schedule.law_at(self.law, pull_stiffness(held, position, p.nominal_gap))

    @property
    def stable_reach(self) -> tuple[float, float]:
        """Lowest and highest of the frozen positions, from the middle outwards, that are stable; nan, nan if none."""
        x = [p.position for p in self.frozen]
        stable = [math.isfinite(p.peak_sensitivity) for p in self.frozen]
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
        reaches = {}
        for zone in "ABC":
            beyond = [abs(p.position) for p in self.frozen if p.zone > zone]
            inside = [abs(p.position) for p in self.frozen if abs(p.position) < min(beyond, default=math.inf)]
            reaches[zone] = max(inside, default=0.0)
        return reaches

    def to_json(self) -> dict[str, Any]:
        """The JSON object: what was got and the reach."""
        inner = {} if self.current_loop is None else {"current_loop": self.current_loop.to_json()}
        inner |= {} if self.thermal is None else {"thermal_guard": self.thermal.to_json()}
        return inner | {
            "bandwidth_Hz": json_value(self.bandwidth),
            "feedback_bandwidth_Hz": json_value(self.feedback_bandwidth),
            "flat_band_Hz": self.flat_band,
            "peak_sensitivity": json_value(self.peak_sensitivity),
            "reach_m": list(self.reach),
            "stable_reach_m": [json_value(x) for x in self.stable_reach],
            "iso_14839_3_zone_reach_m": self.zone_reach,
            "inverse_domain": dict(self.domain),
        }

    def law_to_json(self) -> dict[str, Any]:
        """The JSON object of the law with its gains, and of the loop at the frozen positions."""
        stage = self.parameters.stage
        return {
            "design": self.kind,
            "frozen": [
                {
                    "position_m": p.position,
                    "peak_sensitivity": json_value(p.peak_sensitivity),
                    "lower_bound": p.bound,
                    "iso_14839_3_zone": p.zone,
                }
                for p in self.frozen
            ],
            "law": {
                "kind": self.summary,
                "feedforward": self.law.feedforward,
                "preview": self.law.preview,
                "states": list(self.law.plant.sampled().states),
                "gain": self.law.gains.state.tolist(),
                "integral_gain": self.law.gains.integral,
                "model_gain": self.law.model_gains.state.tolist(),
                "filter_gain": self.law.estimator.gain.tolist(),
                "schedule": self.schedule.to_json() if self.schedule.moves else None,
                "gap_lead_s": self.law.gap_lead,
                "shape": list(self.law.shape),
                "reference_gain": self.law.reference_gain.tolist(),
                "stage": {"overlap_N": stage.overlap, "bias_A": stage.bias},
                "rate_Hz": 1 / self.law.plant.period,
                "delay_samples": self.law.plant.delay,
            },
        }


@dataclass(frozen=True)
class Wish:
    """What is wished of the feedback.

    Attributes
    ----------
    bandwidth : Hz, -3 dB from reference to position by the integral alone
    peak_sensitivity : bound on max |S| in the middle of the travel; None: none
    """

    bandwidth: float
    peak_sensitivity: float | None

    def __str__(self) -> str:
        bound = "" if self.peak_sensitivity is None else f" and a peak sensitivity of {self.peak_sensitivity:g}"
        return f"bandwidth of {self.bandwidth:g} Hz{bound}"

    def kept_by(self, bandwidth: float, peak_sensitivity: float) -> bool:
        """Whether a loop keeps it."""
        too_high = self.peak_sensitivity is not None and not peak_sensitivity <= self.peak_sensitivity * (1 + _SLACK)
        return not too_high and bandwidth >= self.bandwidth * (1 - _SLACK)

    def missed_by(self, bandwidth: float, peak_sensitivity: float) -> float:
        """By what shares of it a loop misses it, together; a little less than what is accepted counts already."""
        missed = max(0.0, 1 + 0.5 * _SLACK - bandwidth / self.bandwidth)
        if self.peak_sensitivity is not None:
            missed += max(0.0, peak_sensitivity / self.peak_sensitivity - 1 + 0.5 * _SLACK)
        return missed


def check_wish(wish: Wish, plant: LinearPlant) -> None:
    """InputError for what no loop at this rate can be asked for."""
    highest = 0.1 / plant.period
    lowest = _SLOWEST * highest
    if not lowest <= wish.bandwidth <= highest:
        raise InputError(
            f"a bandwidth of {wish.bandwidth:g} Hz is out of range: {lowest:g} ... {highest:g} Hz, up to a tenth of "
            "the loop rate; wish for one within, or raise controller.rate"
        )
    if wish.peak_sensitivity is not None and not wish.peak_sensitivity > 1:
        raise InputError(
            f"a peak sensitivity of {wish.peak_sensitivity:g} cannot be: it is above 1 for any loop; wish for 2"
        )


@dataclass(frozen=True)
class ControllerChoice:
    """What a user asks for; what is None is the design's default.

    Attributes
    ----------
    kind : a name of `designs.DESIGNS`
    bandwidth, peak_sensitivity : Hz, and bound on max |S| in the middle
    feedforward, preview : of lqr and biased; whether references are known ahead
    overlap : N, of all but biased
    bias : A, of biased
    """

    kind: str = "lqr"
    bandwidth: float | None = None
    peak_sensitivity: float | None = None
    feedforward: bool = True
    overlap: float = 0.0
    bias: float | None = None
    preview: bool = True


@dataclass(frozen=True, eq=False)
class DesignKind:
    """A way of designing.

    Attributes
    ----------
    name, summary : as a user asks for it, and what it is
    wish : its default
    options : those of `ControllerChoice` that it has, of feedforward, overlap and bias
    build : the design for a model
    """

    name: str
    summary: str
    wish: Wish
    options: frozenset[str]
    build: Callable[[DesignModel, Wish, ControllerChoice], "ControllerDesign"]


@dataclass(frozen=True, eq=False)
class LinearDesign:
    """What a way of designing comes to: the linear law, its weights, the output stage, the magnets at a position."""

    kind: DesignKind
    law: LinearLaw
    weights: LqrWeights
    place_at: PlaceAt
    stage: OutputStage = HARD_HAND_OVER
    reach: tuple[float, float] | None = None
    schedule: GainSchedule | None = None


def completed(model: DesignModel, linear: LinearDesign) -> ControllerDesign:
    """The design with its figures on the believed plant; the reach is the belief's where none is stated."""
    law, reach = linear.law, linear.reach or reach_of(model)
    f = grid(law.plant.period)
    response = law.reference_response(f)
    positions = np.linspace(*reach, _N_FROZEN)
    schedule = linear.schedule or fixed_gains(law)
    thermal = thermal_guard(model.actuator, law.plant.period)

    def frozen(x: float) -> FrozenPosition:
        stiffness = pull_stiffness(model.holding_force(x), x, model.coupled.nominal_gap)
        return _frozen(schedule.law_at(law, stiffness), x, linear.place_at(x))

    return ControllerDesign(
        kind=linear.kind.name,
        summary=linear.kind.summary,
        actuator=model.actuator,
        law=law,
        weights=linear.weights,
        parameters=_parameters(model, law, linear.stage, schedule, thermal),
        feedback_bandwidth=feedback_bandwidth(law),
        bandwidth=_bandwidth(response, f),
        flat_band=flat_band(response, f),
        peak_sensitivity=law.peak_sensitivity(linear.place_at(0.0)),
        frozen=tuple(frozen(float(x)) for x in positions),
        reach=reach,
        suspension=model.plant.stiffness,
        domain=model.domain(),
        schedule=schedule,
        current_loop=model.current_loop,
        thermal=thermal,
    )


def with_thermal_limit(design: ControllerDesign, limit: ThermalLimit) -> ControllerDesign:
    """The same controller, its windings guarded by a limit; InputError where their heat is not known."""
    thermal = thermal_guard(design.actuator, design.law.plant.period, limit)
    assert thermal is not None
    return replace(design, thermal=thermal, parameters=design.parameters._replace(thermal=thermal.arrays))


def with_measured_gap(design: ControllerDesign) -> ControllerDesign:
    """The same controller, its currents inverted at the measured gap, as in the source paper."""
    law = replace(design.law, gap_lead=0.0)
    parameters = design.parameters._replace(gap_row=position_after(law.plant, 0.0))
    changed = replace(design, law=law, parameters=parameters)
    return replace(changed, frozen=tuple(_frozen(changed.law_at(p.position), p.position, p.at) for p in design.frozen))


def without_preview(design: ControllerDesign) -> ControllerDesign:
    """The same controller for a reference that is not known ahead."""
    law = replace(design.law, preview=False)
    f = grid(law.plant.period)
    response = law.reference_response(f)
    return replace(design, law=law, bandwidth=_bandwidth(response, f), flat_band=flat_band(response, f))


def _frozen(law: LinearLaw, position: float, at: AtPosition) -> FrozenPosition:
    return FrozenPosition(
        position,
        at,
        law.peak_sensitivity(at),
        sensitivity_bound(law.plant, magnet_stiffness=at.magnet_stiffness),
    )


def _parameters(
    model: DesignModel, law: LinearLaw, stage: OutputStage, schedule: GainSchedule, thermal: ThermalGuard | None
) -> ControllerParameters:
    plant = law.plant
    sampled = plant.sampled()
    return ControllerParameters(
        inverse=model.inverse,
        stage=stage,
        model_a=np.ascontiguousarray(sampled.A),
        model_b=np.ascontiguousarray(sampled.B[:, 0]),
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
        constant_force=model.coupled.constant_force,
        cubic=model.cubic,
        delay=plant.delay,
        lead=plant.lead,
        gap_row=position_after(plant, law.gap_lead),
        feedforward=law.feedforward,
        schedule_at=np.ascontiguousarray(schedule.stiffness),
        schedule=np.ascontiguousarray(schedule.factors),
        schedule_share=1.0 - math.exp(-2 * math.pi * BANDWIDTH * plant.period),
        nominal_gap=model.coupled.nominal_gap,
        thermal=UNGUARDED if thermal is None else thermal.arrays,
    )
