"""Iterative learning of a reference that repeats: what is left of the error corrects the reference, trial by trial.

Serial learning (Bristow, Tharayil, Alleyne, IEEE Control Systems Magazine 26(3), 2006): the loop is not touched, what
it is asked for is. With r the reference over a period, c_j its correction and e_j = r - y_j the settled error, by their
Fourier series

    c_j+1 = Q (c_j + L e_j),     L = gain/T(f),     T the loop's response on the belief

Over a period all is known, so L is the model's inverse though that looks ahead, and Q, real, has no phase: 1 up to a
band, from there to 1.5 bands a half cosine down to 0. On a plant with the response T' errors obey

    c_j+1 = Q (1 - L T') c_j + Q L e_0:    they converge without growing where |Q (1 - L T')| < 1 at all frequencies,
    e -> (1 - Q)/(1 - Q (1 - L T')) e_0

(Norrlof, Gunnarsson, Int. J. Control 75, 2002; with settled periods in the frequency domain: Longman, Int. J. Control
73, 2000). The band is the widest that keeps the condition with a reserve on the belief and on all scenario plants.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.control.closed_loop import ClosedLoopRun, PlantUnderTest, ReferenceArrays, run_closed_loop
from msl_fem.control.design import ControllerDesign
from msl_fem.control.linear_loop import Complex
from msl_fem.control.scenario_response import Scenario, response_over_belief
from msl_fem.control.stepper import reference_rows
from msl_fem.control.unseen_plants import N_PLANT, SUSPECTS, DrawPlant, Progress, UnseenPlants, each_drawn, unheld_rows
from msl_fem.errors import ComputationError, InputError
from msl_fem.files.numbers import json_value
from msl_fem.plant.excitation import Reference

GAIN = 0.7
"""Of the error, that a trial corrects on the belief: a part of the noise stays out."""
CONTRACTION = 0.9
"""At most, over frequencies and scenario plants: what the band is chosen by."""
_SETTLED = 0.5  # of a trial
_FALL = 1.5  # bands, at which the filter is 0
_NARROWER = 0.93
_REPEATS = 1e-6  # of the span: what a period may miss


@dataclass(frozen=True, eq=False)
class LearningLaw:
    """How a periodic reference is learned.

    Attributes
    ----------
    samples : of a period
    period : s, of a sample
    frequency : (n,) Hz of the harmonics, from 0
    response : (n,) of the loop on the belief
    robustness : (n,) the filter Q
    gain : of the error, that a trial corrects on the belief
    band : Hz, up to which Q is 1
    on_belief : max |Q (1 - L T)|
    contraction : max |Q (1 - L T')| over the scenario plants with which the loop is stable, and the belief
    worst_at : Hz, where that is
    scenarios, unstable : how many plants there are, and with how many the loop is unstable without learning already
    """

    samples: int
    period: float
    frequency: Array
    response: Complex
    robustness: Array
    gain: float
    band: float
    on_belief: float
    contraction: float
    worst_at: float
    scenarios: int
    unstable: int

    @property
    def converges(self) -> bool:
        """Whether the condition holds on the belief and on all scenario plants."""
        return self.contraction < 1.0 and not self.unstable

    def learned(self, correction: Array, error: Array) -> Array:
        """(samples,) the next correction in m from one, and from the error (samples,) of a period with it."""
        told = np.fft.rfft(correction) + self.gain * np.fft.rfft(error) / self.response
        return np.asarray(np.fft.irfft(self.robustness * told, self.samples))

    def to_json(self) -> dict[str, Any]:
        """The JSON object."""
        return {
            "period_s": self.samples * self.period,
            "gain": self.gain,
            "band_Hz": json_value(self.band),
            "contraction_on_belief": json_value(self.on_belief),
            "contraction": json_value(self.contraction),
            "contraction_worst_at_Hz": self.worst_at,
            "scenario_plants": self.scenarios,
            "scenario_plants_unstable": self.unstable,
            "converges": self.converges,
        }


def learning_law(
    design: ControllerDesign, samples: int, scenarios: Sequence[Scenario] = (), *, gain: float = GAIN,
    band: float | None = None,
) -> LearningLaw:  # fmt: skip
    """The law for a period of so many samples.

    Parameters
    ----------
    scenarios : plants on which it is to converge, beside the belief
    band : Hz, up to which everything is learned; inf: all, without a filter; None: the widest that keeps `CONTRACTION`

    Raises
    ------
    InputError : a gain outside 0 ... 2; not even the lowest harmonic can be learned
    """
    if not 0 < gain < 2:
        raise InputError(f"a learning gain of {gain:g} does not converge; it must be between 0 and 2, like {GAIN:g}")
    period = design.law.plant.period
    frequency = np.asarray(np.fft.rfftfreq(samples, period), dtype=np.float64)
    response = np.ones(frequency.size, dtype=complex)
    response[1:] = design.law.reference_response(frequency[1:])
    others = [response_over_belief(design, scenario, frequency[1:]) for scenario in scenarios]
    stable = [over for over in others if np.isfinite(over).all()]
    missed = np.full((1 + len(stable), frequency.size), abs(1 - gain))
    if stable:
        missed[1:, 1:] = np.abs(1 - gain * np.array(stable))
    chosen = _widest(frequency, missed) if band is None else band
    q = robustness_filter(frequency, chosen)
    left = q * missed
    worst = left.max(axis=0)
    return LearningLaw(
        samples, period, frequency, response, q, gain, chosen, float(left[0].max()), float(worst.max()),
        float(frequency[np.argmax(worst)]), len(scenarios), len(scenarios) - len(stable),
    )  # fmt: skip


def robustness_filter(frequency: Array, band: float) -> Array:
    """(n,) Q at frequencies in Hz: 1 up to the band, a half cosine down to 0 at one and a half of it; inf: 1."""
    if np.isinf(band):
        return np.ones(frequency.size)
    fallen = np.clip((frequency / band - 1.0) / (_FALL - 1.0), 0.0, 1.0)
    return np.asarray(0.5 * (1 + np.cos(np.pi * fallen)))


def _widest(frequency: Array, missed: Array) -> float:
    """Hz, the widest band that keeps `CONTRACTION`."""
    band = frequency[-1] / _FALL
    while band >= frequency[1]:
        q = robustness_filter(frequency, band)
        kept = q > 0
        if (q[kept] * missed[:, kept]).max() <= CONTRACTION:
            return float(band)
        band *= _NARROWER
    raise InputError(
        f"nothing of a reference of {frequency[1]:.4g} Hz can be learned: already its fundamental grows on a plant "
        "within the tolerances; take a lower frequency, a smaller gain, or --design robust"
    )


def repeating(reference: ReferenceArrays) -> int:
    """Samples after which a reference repeats, twice or more in it after half of its time.

    Raises
    ------
    InputError : it does not
    """
    r = np.stack([reference.position, reference.velocity, reference.acceleration])
    scale = np.ptp(r, axis=1, keepdims=True)
    r = r / np.where(scale > 0, scale, 1.0)
    for n in range(2, r.shape[1] // 4 + 1):
        if np.abs(r[:, n] - r[:, 0]).max() < _REPEATS and np.abs(r[:, n:] - r[:, :-n]).max() < _REPEATS:
            return n
    raise InputError(
        "the reference does not repeat four times in whole samples of the loop; learning needs one that does: take a "
        "sine of a frequency that fits, or a longer duration"
    )


@dataclass(frozen=True, eq=False)
class Learned:
    """What a plant's trials came to.

    Attributes
    ----------
    law : that they were learned by
    errors : (n_trial + 1,) m, settled RMS of the reading less the reference, before and after each; nan after a trial
        that lost the plant
    correction : (samples, 3) m, m/s, m/s2 of the reference over a period
    rows : (samples, 6) of a settled period, as the controller's step takes them
    first, run : without learning, and the last that was held
    """

    law: LearningLaw
    errors: Array
    correction: Array
    rows: Array
    first: ClosedLoopRun
    run: ClosedLoopRun

    def to_json(self) -> dict[str, Any]:
        """The JSON object."""
        return self.law.to_json() | {"error_rms_m": [json_value(float(e)) for e in self.errors]}


def learn(
    design: ControllerDesign, reference: ReferenceArrays, law: LearningLaw, *, plant: PlantUnderTest, trials: int,
    generator: np.random.Generator | None = None,
) -> Learned:  # fmt: skip
    """The trials of a periodic reference on a plant, each from rest, its settled half taken for the error.

    Raises
    ------
    InputError : as `run_closed_loop` before anything was learned
    ComputationError : the plant is not held without learning
    """
    correction = np.zeros(law.samples)
    errors = np.full(trials + 1, np.nan)
    track = _corrected(reference, correction, law)
    first = run = run_closed_loop(design, track, plant=plant, generator=generator)
    for n in range(trials + 1):
        left = _settled_periods(reference, run, law.samples)
        errors[n] = np.sqrt(np.mean(left**2))
        if n == trials:
            break
        following = law.learned(correction, left.mean(axis=0))
        try:
            run = run_closed_loop(design, _corrected(reference, following, law), plant=plant, generator=generator)
        except (ComputationError, InputError):
            break
        correction = following
    track = _corrected(reference, correction, law)
    rows = reference_rows(
        design, np.stack([track.position, track.velocity, track.acceleration], axis=1), period=law.period
    )
    return Learned(law, errors, derivatives(correction, law.period), rows[law.samples : 2 * law.samples], first, run)


def derivatives(correction: Array, period: float) -> Array:
    """(n, 3) a periodic correction (n,) in m, `period` s apart, with its first and second derivative."""
    spectrum = np.fft.rfft(correction)
    jw = 2j * np.pi * np.fft.rfftfreq(correction.size, period)
    if correction.size % 2 == 0:
        jw[-1] = 0.0
    return np.stack([np.fft.irfft(spectrum * jw**power, correction.size) for power in range(3)], axis=1)


def _corrected(reference: ReferenceArrays, correction: Array, law: LearningLaw) -> Reference:
    """The reference with a period's correction all along."""
    n = reference.time.size
    more = derivatives(correction, law.period)[np.arange(n) % law.samples]
    return Reference(
        reference.time, reference.position + more[:, 0], reference.velocity + more[:, 1],
        reference.acceleration + more[:, 2],
    )  # fmt: skip


def _settled_periods(reference: ReferenceArrays, run: ClosedLoopRun, samples: int) -> Array:
    """(n_period, samples) m, reference less reading over whole periods of the settled part."""
    left = np.asarray(reference.position) - run.measured
    whole = left.size // samples
    return left[: whole * samples].reshape(whole, samples)[int(np.ceil(_SETTLED * whole)) :]


def learned_on_unseen_plants(
    design: ControllerDesign, reference: ReferenceArrays, law: LearningLaw, draw: DrawPlant, *, trials: int,
    n: int = N_PLANT, seed: int = 1, suspects: tuple[str, ...] = SUSPECTS, progress: Progress | None = None,
) -> tuple[UnseenPlants, UnseenPlants]:  # fmt: skip
    """(without learning, after the trials): the loop on the plants of `on_unseen_plants`, each learned from nothing."""
    rows = unheld_rows(2, n)
    amplitude = 0.5 * float(np.ptp(reference.position))
    for k, plant, generator in each_drawn(draw, n, seed=seed, progress=progress):
        try:
            found = learn(design, reference, law, plant=plant, trials=trials, generator=generator)
        except ComputationError:
            continue
        for stage, error, run in zip(rows[:, k], found.errors[[0, -1]], (found.first, found.run), strict=True):
            stage[:] = error / amplitude, run.guard_violations, run.guard_share
    before, after = (UnseenPlants(suspects, *stage.T) for stage in rows)
    return before, after
