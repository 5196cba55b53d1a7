"""The position of a mover from its coil: an extended Kalman filter of one side's current on the magnetic table.

    di/dt = (u - R i - lambda_g v) / (lambda_i + L_s),   dg/dt = v,   dv/dt = w,   dR/dt = 0

lambda_i and lambda_g are the slopes of the side's flux linkage, L_s its leakage, w white. Reading and voltage have
white noise. The filter is Jazwinski's (Stochastic Processes and Filtering Theory, 1970, ch. 8) with slopes by central
differences of one step. The same recursion of the covariance along the true states is the Cramer-Rao bound: without w
and voltage noise that of constants (Taylor, IEEE Trans. Autom. Control 24, 1979), with them the posterior one for small
errors (Tichavsky, Muravchik and Nehorai, IEEE Trans. Signal Processing 46, 1998).

At the knee of saturation two gaps have the same inductance, and a filter that starts on the wrong side may stay there.
So several run from starts spread over what is known before, each weighted by the likelihood of the readings (Alspach
and Sorenson, IEEE Trans. Autom. Control 17, 1972).
"""

from typing import NamedTuple

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.computing.compiled import compiled
from msl_fem.computing.copied_rows import copy_into, set_congruent
from msl_fem.errors import InputError
from msl_fem.files.quantity import format_quantity
from msl_fem.plant.effects import EffectValues
from msl_fem.plant.plant import PlantParameters, Surface
from msl_fem.plant.preparation import small_signal_inductance
from msl_fem.table.coenergy_surface import evaluate_slopes

CURRENT, GAP, GAP_RATE, RESISTANCE = range(4)
N_OBSERVED = 4
_STEPS = np.array([1e-5, 1e-5, 1e-4, 1e-4])
"""For the slopes: of the table's largest current, of its range of gaps, in m/s, in ohm."""
_STARTS = np.linspace(-2.4, 2.4, 7)
_NARROWER = 0.6
"""Starts of the gap and the spread of each, over the spread known before: together some normal distribution."""


class ObserverNoise(NamedTuple):
    """What the filter expects: one sigma, of white noise each sample."""

    current: float  # A, of the reading
    voltage: float  # V, of what is known of the sample's mean voltage
    acceleration: float  # m/s2, of the mean over a sample


class SensingCoil(NamedTuple):
    """A side as the observer knows it."""

    gap: Array
    current: Array
    coefficients: Array
    share: float  # magnet current over side current
    magnets: float
    depth: float  # of the stack over that of the table: its ends carry flux too
    leakage: float  # H
    period: float  # s
    noise: ObserverNoise


def coil_of(
    surface: Surface, plant: PlantParameters, *, period: float, noise: ObserverNoise, known: EffectValues | None = None
) -> SensingCoil:
    """Side 1 of a plant, with leakage inductance and depth of the effects `known`; what the other side's current adds
    to its flux linkage is not known."""
    leakage, depth = 0.0, 1.0
    if known is not None:
        inductance = small_signal_inductance(plant, surface)
        leakage = inductance * known.get("leakage_inductance", "share_1")
        depth += known.get("fringing", "depth_error")
    magnets, share = float(plant.magnets), plant.current_share
    return SensingCoil(
        surface.gap, surface.current, surface.coefficients, share, magnets, depth, leakage, period, noise
    )


def observe(
    coil: SensingCoil, voltage: Array, reading: Array, *, start: Array, variances: Array
) -> tuple[Array, Array]:
    """Estimates and covariances after each reading, those of the start that makes all readings together most likely.

    Parameters
    ----------
    voltage : (n,) V, mean over the period after each reading
    reading : (n,) A
    start, variances : (N_OBSERVED,) before the first reading: current A, gap m, its rate m/s, resistance ohm

    Returns
    -------
    (n, N_OBSERVED) estimates and (n, N_OBSERVED, N_OBSERVED) covariances. Estimates stay inside the table: what is
    drawn beyond its border by a reading is put onto it.
    """
    spread, none = np.sqrt(variances[GAP]), np.zeros((0, N_OBSERVED))
    narrower = np.array(variances, float)
    narrower[GAP] *= _NARROWER**2
    found = []
    for offset in _STARTS:
        begun = np.array(start, float)
        begun[GAP] += offset * spread
        if coil.gap[0] < begun[GAP] < coil.gap[-1]:
            states, covariances, likelihood = _recursion(coil, voltage, reading, none, begun, narrower)
            found.append((likelihood - 0.5 * offset**2, states, covariances))
    if not found:
        raise InputError(
            f"no start of the observer lies in the table's gaps, {format_quantity(coil.gap[0], 'm')} to "
            f"{format_quantity(coil.gap[-1], 'm')}: the gap is said to be {format_quantity(float(start[GAP]), 'm')}"
        )
    _, states, covariances = max(found, key=lambda one: one[0])
    return states, covariances


def bound_along(coil: SensingCoil, voltage: Array, states: Array, *, variances: Array) -> Array:
    """(n, N_OBSERVED, N_OBSERVED): the least covariance, at the true `states` (n, N_OBSERVED), of any estimate."""
    return _recursion(coil, voltage, states[:, CURRENT], states, states[0], variances)[1]


def inductance_of(coil: SensingCoil, current: float, gap: float) -> float:
    """The side's incremental inductance with its leakage, in H."""
    return float(_circuit(coil, current, gap)[0])


def _recursion(
    coil: SensingCoil, voltage: Array, reading: Array, truth: Array, start: Array, variances: Array
) -> tuple[Array, Array, float]:
    """States, covariances and the readings' log-likelihood."""
    n = len(reading)
    states, covariances = np.empty((n, N_OBSERVED)), np.empty((n, N_OBSERVED, N_OBSERVED))
    u, read, true = (np.ascontiguousarray(values, float) for values in (voltage, reading, truth))
    before = np.diag(np.asarray(variances, float))
    likelihood = _filter(coil, u, read, true, np.array(start, float), before, states, covariances)
    return states, covariances, float(likelihood)


@compiled
def _filter(coil, voltage, reading, truth, z, covariance, states, covariances):  # type: ignore[no-untyped-def]
    """Readings and steps in turn, their log-likelihood; with `truth` slopes are taken there, nothing is estimated."""
    likelihood, noise = 0.0, coil.noise.current**2
    ahead, gain = np.empty(N_OBSERVED), np.empty(N_OBSERVED)
    slopes, kept = np.empty((N_OBSERVED, N_OBSERVED)), np.empty((N_OBSERVED, N_OBSERVED))
    product = np.empty((N_OBSERVED, N_OBSERVED))
    for k in range(reading.size):
        if truth.shape[0]:
            copy_into(z, truth[k])
        expected, surprise = covariance[CURRENT, CURRENT] + noise, reading[k] - z[CURRENT]
        likelihood -= 0.5 * (surprise * surprise / expected + np.log(expected))
        for row in range(N_OBSERVED):
            gain[row] = covariance[row, CURRENT] / expected
            for column in range(N_OBSERVED):
                kept[row, column] = 1.0 if row == column else 0.0
            kept[row, CURRENT] -= gain[row]
            if not truth.shape[0]:
                z[row] += gain[row] * surprise
        if not truth.shape[0]:
            _put_inside(coil, z)
        set_congruent(covariance, kept, covariance, product)
        _add_product(noise, gain, covariance)  # Joseph's form
        copy_into(states[k], z)
        for row in range(N_OBSERVED):
            copy_into(covariances[k, row], covariance[row])
        inductance = _slopes(coil, voltage[k], z, slopes)
        set_congruent(covariance, slopes, covariance, product)
        _add_noise(coil, inductance, covariance)
        _step(coil, voltage[k], z, ahead)
        copy_into(z, ahead)
        _put_inside(coil, z)
    return likelihood


@compiled
def _add_product(factor, gain, covariance):  # type: ignore[no-untyped-def]
    for row in range(N_OBSERVED):
        for column in range(N_OBSERVED):
            covariance[row, column] += factor * gain[row] * gain[column]


@compiled
def _put_inside(coil, z):  # type: ignore[no-untyped-def]
    """The estimate onto the border of the table, a step for the slopes within it, where it lies beyond."""
    top, low, high = coil.current[-1] / coil.share, coil.gap[0], coil.gap[-1]
    z[CURRENT] = min(max(z[CURRENT], -0.999 * top), 0.999 * top)
    z[GAP] = min(max(z[GAP], low + 1e-3 * (high - low)), high - 1e-3 * (high - low))


@compiled
def _slopes(coil, u, z, slopes):  # type: ignore[no-untyped-def]
    """The slopes of a step by the state, central differences; returns the inductance in H."""
    scale = (coil.current[-1] / coil.share, coil.gap[-1] - coil.gap[0], 1.0, 1.0)
    there, after, before = z.copy(), np.empty(N_OBSERVED), np.empty(N_OBSERVED)
    for m in range(N_OBSERVED):
        h = _STEPS[m] * scale[m]
        there[m] = z[m] + h
        _step(coil, u, there, after)
        there[m] = z[m] - h
        _step(coil, u, there, before)
        there[m] = z[m]
        for row in range(N_OBSERVED):
            slopes[row, m] = (after[row] - before[row]) / (2 * h)
    return _circuit(coil, z[CURRENT], z[GAP])[0]


@compiled
def _circuit(coil, i, g):  # type: ignore[no-untyped-def]
    """(d lambda/di + leakage, d lambda/dg) of the side, its magnets carry `share` of its current; beyond the table's
    border, where a prediction may lead, those of the border."""
    top = coil.current[-1]
    there, near = min(max(coil.share * i, -top), top), min(max(g, coil.gap[0]), coil.gap[-1])
    inductance, slope = evaluate_slopes(coil.gap, coil.current, coil.coefficients, there, near)[2:]
    scale = coil.depth * coil.magnets * coil.share
    return scale * coil.share * inductance + coil.leakage, -scale * slope


@compiled
def _step(coil, u, z, out):  # type: ignore[no-untyped-def]
    """One sample on, Runge and Kutta's of order 4 for the current; the gap moves at its rate."""
    h, i, v, r = coil.period, z[CURRENT], z[GAP_RATE], z[RESISTANCE]
    middle, end = z[GAP] + 0.5 * h * v, z[GAP] + h * v
    a = _current_rate(coil, u, i, z[GAP], v, r)
    b = _current_rate(coil, u, i + 0.5 * h * a, middle, v, r)
    c = _current_rate(coil, u, i + 0.5 * h * b, middle, v, r)
    d = _current_rate(coil, u, i + h * c, end, v, r)
    out[CURRENT] = i + h / 6 * (a + 2 * b + 2 * c + d)
    out[GAP], out[GAP_RATE], out[RESISTANCE] = end, v, r


@compiled
def _current_rate(coil, u, i, g, v, r):  # type: ignore[no-untyped-def]
    inductance, slope = _circuit(coil, i, g)
    return (u - r * i - slope * v) / inductance


@compiled
def _add_noise(coil, inductance, covariance):  # type: ignore[no-untyped-def]
    """What a sample adds: the voltage's noise to the current, the mean acceleration to gap and rate."""
    h = coil.period
    to_current = h / inductance * coil.noise.voltage
    to_gap, to_rate = 0.5 * h * h * coil.noise.acceleration, h * coil.noise.acceleration
    covariance[CURRENT, CURRENT] += to_current**2
    covariance[GAP, GAP] += to_gap**2
    covariance[GAP_RATE, GAP_RATE] += to_rate**2
    covariance[GAP, GAP_RATE] += to_gap * to_rate
    covariance[GAP_RATE, GAP] += to_gap * to_rate
