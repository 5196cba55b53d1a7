"""A design beyond the paper: one law for a family of plants, with filter and a second-order section in the search.

What hurts the reference actuator's LQR most is not a parameter but what is left out of the linear plant: a second mass
on the mover makes it unstable at 3 % size (docs/control.md). The structure stays; regulator, filter, lead of the gap
and a second-order section are searched for the least worst peak sensitivity over frozen positions and deviating plants
(multi-model design: Ackermann, Robust Control, 2nd ed., 2002, ch. 3). What errors of mass and spring leave of the
tracking goes with the compliance |P S|, so the search weighs this against the peak: it lessens peak times compliance
squared (the trade of S against P S: Skogestad, Postlethwaite, Multivariable Feedback Control, 2nd ed., 2005, sec. 2.6).
"""

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from msl_fem.computing.arrays import Array
from msl_fem.computing.statespace import StateSpace
from msl_fem.control.design import (
    ControllerChoice,
    ControllerDesign,
    DesignKind,
    LinearDesign,
    Wish,
    check_wish,
    completed,
)
from msl_fem.control.design_model import AtPosition, DesignModel
from msl_fem.control.held_input import delayed_hold
from msl_fem.control.linear_loop import LinearLaw
from msl_fem.control.linear_plant import LinearPlant
from msl_fem.control.lqg import FilterNoise, LqrGains, LqrWeights, filter_of_gain, lqr_gains
from msl_fem.control.lqr_design import (
    DEFAULT_WISH,
    feedback_bandwidth,
    following_gains,
    stage_with_overlap,
    usual_filter,
    usual_noise,
    working_places,
)
from msl_fem.errors import ComputationError, InputError

_START = (0.9, 3.6, 7.0, 1.12, 1.3, 0.95, 0.32, 0.43, 1.0)
"""Frequency over the bandwidth, velocity and integral weights; gains over the Kalman filter's; lead over the belief's;
the section: its frequency over half the loop rate, damping of zeros and of poles."""
_MISSED, HOPELESS = 100.0, 30.0
_N_GRID, _N_DENSE, _EVALUATIONS, _ROUNDS = 90, 90, 200, 2
_SLOW = np.linspace(0.008, 0.04, 9)  # of the loop rate: where the compliance counts, 20 to 100 Hz at 2.5 kHz


@dataclass(frozen=True)
class Deviation:
    """How a plant differs from the believed one.

    Attributes
    ----------
    mass_share, frequency, damping_ratio : of the mass that hangs on a spring (structural_mode); Hz of the share alone
    lag : s, time constant of a first-order lag between command and force (eddy currents, amplifier, delay)
    gain : force that a command gives, over the believed one
    """

    mass_share: float = 0.0
    frequency: float = 400.0
    damping_ratio: float = 0.01
    lag: float = 0.0
    gain: float = 1.0


@lru_cache(maxsize=512)
def deviating_plant(plant: LinearPlant, deviation: Deviation, magnet_stiffness: float) -> StateSpace:
    """Position over commanded force as `LinearPlant.sampled`, of a plant that deviates.

    With q the second mass against the first, mu its share, w its frequency alone (Den Hartog, Mechanical Vibrations,
    4th ed., ch. 3): (1 - mu) m x'' = f - c x' - (k - kappa) x + mu m (w^2 q + 2 zeta w q'), q'' = -x'' - w^2 q - ...
    """
    d = deviation
    lags = [1.0 / tau for tau in (deviation.lag,) if tau > 0]
    rates = lags + ([] if math.isinf(plant.lag) else [plant.prompt_lag()])
    n = 4 + len(rates)  # position, velocity, second mass against the first, its rate, then the chain of lags to a force
    a = np.zeros((n, n))
    b = np.zeros((n, 1))
    w = 2 * math.pi * d.frequency
    ratio = d.mass_share / (1 - d.mass_share)
    a[0, 1] = a[2, 3] = 1.0
    a[1, :4] = (
        -(plant.stiffness - magnet_stiffness) / plant.mass / (1 - d.mass_share),
        -plant.damping / plant.mass / (1 - d.mass_share),
        ratio * w**2,
        ratio * 2 * d.damping_ratio * w,
    )
    push = d.gain / plant.mass / (1 - d.mass_share)
    if rates:
        a[1, -1] = push
    else:
        b[1] = push
    for k, rate in enumerate(rates):
        a[4 + k, 4 + k] = -rate
        if k:
            a[4 + k, 3 + k] = rate
        else:
            b[4] = rate
    a[3], b[3] = -a[1], -b[1]
    a[3, 2:4] += -(w**2), -2 * d.damping_ratio * w
    return delayed_hold(a, b, plant.period, plant.dead_time, plant.delay)


Complex = NDArray[np.complex128]
FAMILY = (
    Deviation(),
    *(Deviation(mass_share=0.08, frequency=f) for f in (330.0, 400.0, 500.0, 650.0)),
    Deviation(lag=1e-4),
)
"""The usual family: a second mass of 8 % (3 % size on the reference actuator) at several frequencies, a lag more."""
ROBUST_WISH = Wish(30.0, 2.0)
"""Default: a slower feedback than the LQR's, kept by the whole family in the middle."""


@dataclass(frozen=True)
class RobustOptions:
    """What may be chosen beside the wish.

    Attributes
    ----------
    family : plants that the law is to bear; the first is the believed one
    overlap : N, see `inverse.hand_over`
    compliance : exponent of the largest compliance against the highest peak sensitivity; 0: the peak alone
    """

    family: tuple[Deviation, ...] = FAMILY
    overlap: float = 0.0
    compliance: float = 2.0


def robust_design(
    model: DesignModel, wish: Wish = ROBUST_WISH, *, options: RobustOptions | None = None
) -> ControllerDesign:
    """The robust controller of a belief.

    The wish's peak sensitivity is to hold for the whole family in the middle.

    Raises
    ------
    InputError : a wish that no law was found for; the message says what was got
    """
    options = options or RobustOptions()
    check_wish(wish, model.plant)
    stage = stage_with_overlap(model, options.overlap)
    task = family_task(model, wish, options)
    law, weights = searched_law(task)
    got = feedback_bandwidth(law)
    peak = _worst(task, law, 0)
    if not peak < HOPELESS or not wish.kept_by(got, peak):
        raise InputError(
            f"no law gives the whole family a {wish}; the nearest got {got:.4g} Hz "
            f"and {peak:.3g}: lower the bandwidth, allow more peak sensitivity, or raise the loop rate"
        )
    return completed(
        model, LinearDesign(ROBUST, law, weights, lambda x: model.place(x, overlap=options.overlap), stage)
    )


def _robust(model: DesignModel, wish: Wish, choice: ControllerChoice) -> ControllerDesign:
    return robust_design(model, wish, options=RobustOptions(overlap=choice.overlap))


ROBUST = DesignKind(
    "robust",
    "feedback linearization, LQR with integral and section against a family of plants, Kalman filter",
    ROBUST_WISH,
    frozenset({"overlap"}),
    _robust,
)


@dataclass(frozen=True, eq=False)
class FamilyTask:
    """What is searched for, and the plants at each place with their responses over the frequencies."""

    plant: LinearPlant
    wish: Wish
    filter_gain: Array
    noise: FilterNoise
    model_gains: LqrGains
    frequency: Array
    places: tuple[AtPosition, ...]
    plants: tuple[tuple[tuple[StateSpace, Complex], ...], ...]
    compliance: float


def family_task(
    model: DesignModel, wish: Wish, options: RobustOptions, *, places: tuple[AtPosition, ...] | None = None
) -> FamilyTask:
    """The search for a wish that the whole family is to keep in the middle; without `places` at the usual ones."""
    frequency = family_grid(options.family, model.plant.period, _N_GRID, lowest=2e-3)
    places = places or working_places(model, overlap=options.overlap)
    plants = tuple(family_at(model.plant, options.family, place, frequency) for place in places)
    gain = usual_filter(model).gain
    following = following_gains(model.plant, DEFAULT_WISH)
    noise, compliance = usual_noise(model), options.compliance
    return FamilyTask(model.plant, wish, gain, noise, following, frequency, places, plants, compliance)


def family_grid(family: tuple[Deviation, ...], period: float, n: int, *, lowest: float = 5e-4) -> Array:
    """Frequencies in Hz from `lowest` of the loop rate to its half, `n` over all and dense about the family's modes."""
    rate = 1 / period
    modes = [d.frequency for d in family if d.mass_share]
    grids = [np.geomspace(lowest * rate, 0.499 * rate, n)]
    if modes:
        grids.append(np.geomspace(0.75 * min(modes), min(1.25 * max(modes), 0.499 * rate), _N_DENSE))
    return np.unique(np.concatenate(grids))


def family_at(
    plant: LinearPlant, family: tuple[Deviation, ...], at: AtPosition, frequency: Array
) -> tuple[tuple[StateSpace, Complex], ...]:
    """The family's plants at a place, each with its response (n_frequency,)."""
    members = [deviating_plant(plant, deviation, at.magnet_stiffness) for deviation in family]
    return tuple((member, member.response(frequency)[:, 0, 0]) for member in members)


def _law(task: FamilyTask, logarithms: Array) -> tuple[LinearLaw, LqrWeights]:
    plant = task.plant
    ratio = np.exp(np.clip(logarithms, -12, 12))
    weights = LqrWeights(2 * np.pi * task.wish.bandwidth * float(ratio[0]), float(ratio[1]), float(ratio[2]))
    estimator = filter_of_gain(plant, task.filter_gain * ratio[3:5], task.noise)
    section = _section(ratio[6:9], plant.period)
    lead = plant.lead * float(ratio[5])
    return LinearLaw(plant, lqr_gains(plant, weights), task.model_gains, estimator, lead, shape=section), weights


def _section(ratio: Array, period: float) -> tuple[float, ...]:
    """(s^2 + 2 z_n w s + w^2)/(s^2 + 2 z_d w s + w^2) by the bilinear transformation that keeps w in its place.

    Franklin, Powell, Workman, Digital Control of Dynamic Systems, 3rd ed., sec. 6.1. Its gain at rest is 1.
    """
    share = min(ratio[0], 0.95)
    over = ratio[1]
    under = ratio[2]
    t = np.tan(0.5 * np.pi * share)  # w in the transformed plane, share of half the loop rate
    end = 1 + 2 * under * t + t**2
    return tuple(
        float(c / end)
        for c in (
            1 + 2 * over * t + t**2,
            2 * (t**2 - 1),
            1 - 2 * over * t + t**2,
            2 * (t**2 - 1),
            1 - 2 * under * t + t**2,
        )
    )


def family_peaks(
    law: LinearLaw, at: AtPosition, feedback: Complex, plants: tuple[tuple[StateSpace, Complex], ...]
) -> list[float]:
    """The peak sensitivity of each plant for a law's feedback at a place; from HOPELESS up where it is unstable."""
    peaks = []
    for plant, response in plants:
        radius = law.spectral_radius(at, plant=plant)
        peak = HOPELESS * radius if radius >= 1 else float(np.max(1 / np.abs(1 - response * feedback)))
        peaks.append(peak if radius >= 1 else min(peak, HOPELESS))
    return peaks


def _worst(task: FamilyTask, law: LinearLaw, place: int) -> float:
    """The family's highest peak sensitivity at a place; from HOPELESS up where a member is unstable."""
    at = task.places[place]
    return max(family_peaks(law, at, law.feedback(task.frequency, at), task.plants[place]))


def searched_law(task: FamilyTask) -> tuple[LinearLaw, LqrWeights]:
    """The law that is best by a task, and its weights."""
    return _law(task, _searched(task))


def _searched(task: FamilyTask) -> Array:
    from scipy.optimize import minimize

    point = np.log(_START)
    peak_alone = replace(task, compliance=0.0)
    for sought in (peak_alone,) * _ROUNDS + ((task,) if task.compliance else ()):  # the family is borne first
        simplex = point + np.vstack([np.zeros(point.size), 0.3 * np.eye(point.size)])
        options = {"maxfev": _EVALUATIONS, "initial_simplex": simplex, "adaptive": True, "xatol": 1e-2, "fatol": 1e-3}
        point = minimize(lambda z, sought=sought: _badness(sought, z), point, method="Nelder-Mead", options=options).x
    return np.asarray(point)


def _badness(task: FamilyTask, logarithms: Array) -> float:
    try:
        law, _ = _law(task, logarithms)
    except ComputationError:
        return 1e6
    peaks = [_worst(task, law, n) for n in range(len(task.places))]
    if peaks[0] >= HOPELESS:
        return 1e3 * peaks[0]
    cost = max(peaks) * (_compliance(law) ** task.compliance if task.compliance else 1.0)
    return cost + _MISSED * task.wish.missed_by(feedback_bandwidth(law, _N_GRID), peaks[0])


def _compliance(law: LinearLaw) -> float:
    """The largest |P S| in the middle at the slow frequencies, over that of the mass alone in their midst."""
    p = law.plant
    f = _SLOW / p.period
    jw = 2j * np.pi * f
    stiffness = np.abs((1 + law.loop_transfer(f)) * (p.mass * jw**2 + p.damping * jw + p.stiffness))
    return float(p.mass * np.abs(jw[f.size // 2]) ** 2 / stiffness.min())
