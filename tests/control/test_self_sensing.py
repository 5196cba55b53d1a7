"""The gap from the coil: the bound by another route, an observer that reaches it, and what it cannot know."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import saturating_reluctance

from msl_fem.actuator import Actuator
from msl_fem.control.position_observer import (
    CURRENT,
    GAP,
    N_OBSERVED,
    RESISTANCE,
    ObserverNoise,
    SensingCoil,
    bound_along,
    coil_of,
    observe,
)
from msl_fem.control.self_sensing import Carrier, SelfSensing, second_gaps, self_sensing
from msl_fem.errors import InputError
from msl_fem.maps import Guard, operating_map
from msl_fem.plant.effects import EffectValues
from msl_fem.plant.plant import plant_parameters, surface_of
from msl_fem.table.magnetic_table import MagneticTable

RATE, N, OHM, NOISE = 50e3, 500, 2.0, 2e-3
TIME = np.arange(N) / RATE
VOLTAGE = 3.0 + 5.0 * np.sin(2 * np.pi * 1e3 * TIME)
SHORT = Carrier(window=4e-3)


def coil(table: MagneticTable, servo: Actuator, **noise: float) -> SensingCoil:
    """One magnet a side, as the closed form has it."""
    plant = plant_parameters(servo)._replace(magnets=1, current_share=1.0)
    expected = ObserverNoise(NOISE, noise.get("voltage", 0.0), noise.get("acceleration", 0.0))
    return coil_of(surface_of(table), plant, period=1 / RATE, noise=expected)


def current_of(gap: float | np.ndarray, start: float = 1.5) -> np.ndarray:
    """The coil's current by the closed form, its flux linkage stepped and solved for the current in each sample."""
    gaps = np.broadcast_to(gap, N)
    currents = [start]
    for k, u in enumerate(VOLTAGE[:-1]):
        before = after = currents[-1]
        linked = saturating_reluctance(np.array(before), gaps[k])["flux_linkage"]
        for _ in range(3):  # Newton on lambda(i) + h R (i + before)/2 = lambda(before) + h u: trapezoids
            now = saturating_reluctance(np.array(after), gaps[k + 1])
            less = now["flux_linkage"] - linked - (u - 0.5 * OHM * (after + before)) / RATE
            after -= float(less / (now["incremental_inductance"] + 0.5 * OHM / RATE))
        currents.append(after)
    return np.array(currents)


def states_of(current: np.ndarray, gap: float) -> np.ndarray:
    states = np.zeros((current.size, N_OBSERVED))
    states[:, CURRENT], states[:, GAP], states[:, RESISTANCE] = current, gap, OHM
    return states


def test_the_bound_is_the_information_of_all_readings(table: MagneticTable, servo: Actuator) -> None:
    """Only the gap unknown: 1/P = 1/spread^2 + sum (di/dg)^2/sigma^2, by differences of runs."""
    gap, h, spread = 4e-4, 2e-7, 5e-5
    slope = (current_of(gap + h) - current_of(gap - h)) / (2 * h)
    information = 1 / spread**2 + np.cumsum(slope**2) / NOISE**2
    variances = np.array([0.0, spread**2, 0.0, 0.0])
    it = bound_along(coil(table, servo), VOLTAGE, states_of(current_of(gap), gap), variances=variances)
    bound = np.sqrt(it[:, GAP, GAP])
    assert bound[-1] < 0.05 * spread
    np.testing.assert_allclose(bound, information**-0.5, rtol=2e-3)


def test_the_observer_reaches_the_bound_and_knows_its_error(table: MagneticTable, servo: Actuator) -> None:
    gap, spread = 4e-4, np.array([0.02, 5e-5, 0.0, 0.02 * OHM])
    it, generator = coil(table, servo, voltage=0.05), np.random.default_rng(5)
    current = current_of(gap)
    errors, spreads = [], []
    for _ in range(40):
        start = states_of(current, gap)[0] + spread * generator.standard_normal(4)
        reading = current + NOISE * generator.standard_normal(N)
        known = VOLTAGE + 0.05 * generator.standard_normal(N)
        found, covariance = observe(it, known, reading, start=start, variances=spread**2)
        errors.append(found[-1, GAP] - gap)
        spreads.append(np.sqrt(covariance[-1, GAP, GAP]))
    bound = np.sqrt(bound_along(it, VOLTAGE, states_of(current, gap), variances=spread**2)[-1, GAP, GAP])
    rms = np.sqrt(np.mean(np.square(errors)))
    assert 0.7 * bound < rms < 1.35 * bound
    np.testing.assert_allclose(spreads, bound, rtol=0.05)


def test_a_mover_in_motion_is_followed_within_the_stated_covariance(table: MagneticTable, servo: Actuator) -> None:
    """Motion from white acceleration: over sixteen runs the last error is one of its own sigmas."""
    generator, push = np.random.default_rng(8), 60.0
    it, spread = coil(table, servo, voltage=0.02, acceleration=push), np.array([0.02, 2e-5, 1e-3, 0.01 * OHM])
    normalised, followed = [], []
    for _ in range(16):
        start = states_of(np.array([1.5]), 4e-4)[0] + spread * generator.standard_normal(4)
        rate = np.concatenate([[0.0], np.cumsum(push * generator.standard_normal(N - 1) / RATE)])
        gap = 4e-4 + np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) / RATE)])
        reading = current_of(gap) + NOISE * generator.standard_normal(N)
        known = VOLTAGE + 0.02 * generator.standard_normal(N)
        found, covariance = observe(it, known, reading, start=start, variances=spread**2)
        normalised.append((found[-1, GAP] - gap[-1]) / np.sqrt(covariance[-1, GAP, GAP]))
        followed.append((found[-1, GAP] - gap[-1], gap[-1] - 4e-4))
    assert 0.65 < np.sqrt(np.mean(np.square(normalised))) < 1.4
    error, moved = np.sqrt(np.mean(np.square(followed), axis=0))
    assert error < 0.5 * moved


def test_a_prediction_beyond_the_table_stays_a_number(table: MagneticTable, servo: Actuator) -> None:
    """A gap that is said to shrink by 2 m/s leaves the table at once: estimates wait at the border."""
    it = coil(table, servo, voltage=0.02, acceleration=100.0)
    start, spread = np.array([1.5, 1e-4, -2.0, OHM]), np.array([0.02, 2e-5, 0.5, 0.1])
    found, covariance = observe(it, VOLTAGE, current_of(1e-4), start=start, variances=spread**2)
    assert np.isfinite(found).all()
    assert np.isfinite(covariance).all()
    assert found[:, GAP].min() > table.gap[0]


@pytest.fixture(scope="module")
def bench(servo: Actuator, table: MagneticTable) -> tuple[Actuator, MagneticTable, Guard]:
    return servo, table, Guard(operating_map(table, levels=[1.2, 1.6]))


def sensed(bench: tuple[Actuator, MagneticTable, Guard], carrier: Carrier = SHORT, **more: object) -> SelfSensing:
    return self_sensing(*bench, carrier=carrier, shape=(2, 3), runs=6, **more)  # type: ignore[arg-type]


def test_over_the_map_the_bound_is_reached_and_shown(bench: tuple[Actuator, MagneticTable, Guard]) -> None:
    found = sensed(bench)
    assert found.share >= 0.6
    assert found.informed.mean() >= 0.6
    assert found.to_pandas().shape[0] == 6
    assert found.to_json()["share"] == found.share
    assert "times the bound" in repr(found)


def test_without_a_carrier_a_current_at_rest_tells_little(bench: tuple[Actuator, MagneticTable, Guard]) -> None:
    """The coil's voltage is R i at any gap: nothing is better than what was known before."""
    with_it, without = sensed(bench), sensed(bench, replace(SHORT, amplitude=0.0))
    assert without.bound.min() > 3 * with_it.bound.max()
    assert without.share == 0


def test_what_the_observer_does_not_know_is_an_error_of_the_gap(
    bench: tuple[Actuator, MagneticTable, Guard],
) -> None:
    """A leakage of a tenth is taken for a smaller gap; where it is known, it is none."""
    leaking = EffectValues({"leakage_inductance": {"share_1": 0.1}})
    unknown, known = sensed(bench, effects=leaking), sensed(bench, effects=leaking, known=leaking)
    assert unknown.bias[-1, 0] < -10 * known.bound[-1, 0]
    assert known.share >= 0.6


def test_at_the_knee_another_gap_has_the_same_inductance(table: MagneticTable, servo: Actuator) -> None:
    it = coil(table, servo)
    (other,) = second_gaps(it, 1.2e-4, 8.0, 1e-4)
    twin = [saturating_reluctance(np.array(8.0), np.array(g))["incremental_inductance"] for g in (1.2e-4, other)]
    assert twin[0] == pytest.approx(twin[1], rel=1e-3)
    assert second_gaps(it, 4e-4, 0.5, 5e-5).size == 0


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"rate": 3e3}, "3 samples a period; at least 4"),
        ({"window": 1e-4}, "has 5 samples; at least 20"),
        ({"frequency": 0.0}, "must be positive"),
        ({"amplitude": float("nan")}, "must be 0 or more"),
    ],
)
def test_a_carrier_that_cannot_be_is_refused(change: dict[str, float], said: str) -> None:
    with pytest.raises(InputError, match=said):
        replace(SHORT, **change)


def test_an_actuator_without_noise_or_voltage_is_refused(bench: tuple[Actuator, MagneticTable, Guard]) -> None:
    servo, table, guard = bench
    silent = servo.model_copy(update={"current_sensor": servo.current_sensor.model_copy(update={"noise": 0.0})})
    with pytest.raises(InputError, match=r"current_sensor\.noise is 0"):
        self_sensing(silent, table, guard)
    with pytest.raises(InputError, match="more than the drive gives"):
        self_sensing(servo, table, guard, carrier=replace(SHORT, amplitude=500.0))
