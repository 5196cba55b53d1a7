"""The coupled model where its answer is known in closed form."""

import numpy as np
import pytest
from coupled_twin import changed, linear_table, locked, mass_and_spring

from msl_fem.actuator import Actuator
from msl_fem.plant.excitation import Inputs
from msl_fem.plant.operating_point import resting_point
from msl_fem.plant.plant import plant_parameters
from msl_fem.plant.simulate import Options, simulate
from msl_fem.table.magnetic_table import MagneticTable

FINE = Options(substeps=64)
IDEAL = {"kind": "current", "bandwidth": None}


def test_a_locked_coil_rises_exponentially(servo: Actuator) -> None:
    """i = v/R (1 - exp(-t R/L)); two magnets in series: twice the resistance and inductance of one."""
    bench = changed(locked(servo), drive={"kind": "voltage", "bandwidth": None})
    run = simulate(bench, linear_table(), Inputs(np.full((200, 2), [10.0, 4.0]), 1e3), options=FINE)
    time_constant = (2 * 1.08e-5 / 6.3e-4) / 2.0
    rise = 1 - np.exp(-run.time / time_constant)
    assert run.current == pytest.approx(np.outer(rise, [5.0, 2.0]), rel=1e-8, abs=1e-12)
    assert run.flux_linkage == pytest.approx(run.current * 2 * 1.08e-5 / 6.3e-4, rel=1e-9)
    assert run.voltage == pytest.approx(np.full((200, 2), [10.0, 4.0]), rel=1e-12)


def test_a_voltage_drive_lags_its_command(servo: Actuator) -> None:
    """The mean over [t_k, t_k+1) of a first-order rise to 10 V."""
    bench = changed(locked(servo), drive={"kind": "voltage", "bandwidth": 100.0})
    run = simulate(bench, linear_table(), Inputs(np.full((100, 2), 10.0), 1e4), options=FINE)
    w, period = 2 * np.pi * 100.0, 1e-4
    lag = np.exp(-w * run.time) * (1 - np.exp(-w * period)) / (w * period)
    assert run.voltage[:, 0] == pytest.approx(10.0 * (1 - lag), rel=1e-8)


def test_a_mass_on_a_spring_answers_a_step_of_force() -> None:
    """x = F/k (1 - exp(-d t)(cos w t + d/w sin w t)), d = c/2m, w^2 = k/m - d^2."""
    run = simulate(mass_and_spring(), None, Inputs(np.full((1000, 1), 6.0), 1e3), options=FINE)
    d = 8 / (2 * 0.5)
    w = np.sqrt(2000 / 0.5 - d**2)
    t = run.time
    exact = 6 / 2000 * (1 - np.exp(-d * t) * (np.cos(w * t) + d / w * np.sin(w * t)))
    assert run.position == pytest.approx(exact, abs=1e-8 * 6 / 2000)
    assert run.force == pytest.approx(6.0, rel=1e-13)
    assert run.current.shape == (1000, 0)


def test_a_force_drive_lags_its_command() -> None:
    run = simulate(mass_and_spring(bandwidth="20 Hz"), None, Inputs(np.full((50, 1), 6.0), 1e3))
    w = 2 * np.pi * 20
    mean = 6 * (1 - np.exp(-w * run.time) * (1 - np.exp(-w * 1e-3)) / (w * 1e-3))
    assert run.force == pytest.approx(mean, rel=1e-6)


def test_a_sensor_lags_the_position(servo: Actuator) -> None:
    """At constant velocity, a first-order sensor reads what was 1/w ago."""
    bench = changed(servo, motion={"stiffness": 0.0, "damping": 0.0}, position_sensor={"bandwidth": 200.0})
    run = simulate(bench, linear_table(), Inputs(np.zeros((100, 2)), 1e4), options=Options(velocity=0.02))
    w = 2 * np.pi * 200.0
    exact = 0.02 * (run.time - (1 - np.exp(-w * run.time)) / w)
    assert run.measured_position == pytest.approx(exact, rel=1e-9, abs=1e-15)


def test_the_current_loop_is_3_db_down_at_its_bandwidth(servo: Actuator, table: MagneticTable) -> None:
    """Gain 1/sqrt(2) and phase -45 degrees at 1 kHz; exactly, that of the lag behind the command's zero-order hold."""
    rate, n = 200e3, 2000
    phase = 2 * np.pi * 1000.0 * np.arange(2 * n) / rate
    command = 1.0 + 0.1 * np.sin(phase)
    run = simulate(locked(servo), table, Inputs(np.column_stack([command, command]), rate),
                   options=Options(currents=(1.0, 1.0)))  # fmt: skip
    assert not run.samples_at_voltage_limit.any()
    gain = np.mean((run.current[n:, 0] - 1.0) * np.exp(-1j * phase[n:])) / np.mean(
        (command[n:] - 1.0) * np.exp(-1j * phase[n:])
    )
    kept = np.exp(-2 * np.pi * 1000.0 / rate)
    assert gain == pytest.approx((1 - kept) / (np.exp(2j * np.pi * 1000.0 / rate) - kept), rel=1e-7)
    assert abs(gain) == pytest.approx(np.sqrt(0.5), rel=1e-4)


def test_a_moving_gap_induces_voltage_in_a_held_current(servo: Actuator, table: MagneticTable) -> None:
    """Mean voltage = R i + change of flux linkage: up where the gap closes (side 1), down where it opens."""
    bench = changed(servo, drive=IDEAL)
    inputs = Inputs(np.full((100, 2), 0.6), 1e4, 10.0)
    run = simulate(bench, table, inputs, options=Options(currents=(0.6, 0.6)))
    assert run.position[-1] > 1e-5
    gaps = 6e-4 + np.outer(run.position, [-1, 1])
    flux = 2 * table.flux_linkage(0.6, gaps)
    assert run.flux_linkage == pytest.approx(flux, rel=1e-12)
    expected = 2.0 * 0.6 + np.diff(flux, axis=0) * 1e4
    assert run.voltage[:-1] == pytest.approx(expected, rel=1e-9)
    assert (run.voltage[1:-1, 0] > 1.2).all()
    assert (run.voltage[1:-1, 1] < 1.2).all()


def test_a_held_current_does_the_magnets_work(servo: Actuator, table: MagneticTable) -> None:
    """Electrical input beyond the copper loss is i times the change of flux; the magnets' work is that of coenergy."""
    bench = changed(servo, drive=IDEAL)
    held = Options(currents=(0.6, 0.6))
    run = simulate(bench, table, Inputs(np.full((100, 2), 0.6), 1e4, 10.0), options=held)
    start, end = np.array([6e-4, 6e-4]), 6e-4 + run.end_state[2] * np.array([-1, 1])
    flux = 2 * (table.flux_linkage(0.6, end) - table.flux_linkage(0.6, start))
    assert run.audit.electrical - run.audit.copper == pytest.approx(0.6 * flux.sum(), rel=1e-7)
    work = 2 * (table.evaluate(0.6, end)["coenergy"] - table.evaluate(0.6, start)["coenergy"]).sum()
    gained = run.audit.mechanical + run.audit.damping - run.audit.external
    assert gained == pytest.approx(work, rel=1e-7)


def test_a_jump_of_an_ideal_current_is_in_the_mean_voltage(servo: Actuator, table: MagneticTable) -> None:
    """The flux of the jump is in its own sample; beyond the voltage limit it is counted, not hindered."""
    bench = changed(locked(servo), drive={**IDEAL, "voltage_limit": 100.0})
    command = np.zeros((20, 2))
    command[10:] = [1.0, 0.2]
    run = simulate(bench, table, Inputs(command, 1e4))
    assert (run.current[10] == 0.0).all()  # taken before the command acts
    assert (run.current[11] == [1.0, 0.2]).all()
    flux = 2 * table.flux_linkage(np.array([1.0, 0.2]), 6e-4)
    assert run.voltage[10] == pytest.approx(2.0 * command[10] + flux * 1e4, rel=1e-9)
    assert run.samples_at_voltage_limit.tolist() == [1, 0]
    assert abs(run.audit.imbalance) < 1e-12


def test_equal_sides_give_no_net_force(servo: Actuator, table: MagneticTable) -> None:
    both = 0.5 + 0.3 * np.random.default_rng(1).standard_normal((300, 1))
    run = simulate(servo, table, Inputs(np.hstack([both, both]), 1e4))
    assert (run.position == 0).all()
    assert run.current[:, 0].max() > 0.5
    more = simulate(servo, table, Inputs(np.hstack([1.02 * both, both]), 1e4))
    assert more.position[-1] > 1e-6


def test_a_current_s_sign_makes_no_force(servo: Actuator, table: MagneticTable) -> None:
    command = np.column_stack([np.linspace(0, 0.5, 300), np.linspace(0.5, 0, 300)])
    forward, backward = (simulate(servo, table, Inputs(sign * command, 1e4)) for sign in (1, -1))
    assert forward.position == pytest.approx(backward.position, rel=1e-10, abs=1e-18)
    assert forward.voltage == pytest.approx(-backward.voltage, abs=1e-12)
    assert forward.flux_linkage == pytest.approx(-backward.flux_linkage, abs=1e-15)


@pytest.mark.parametrize("bandwidth", [None, 1000.0])
def test_parallel_magnets_move_as_series_at_equal_magnet_current(
    servo: Actuator, table: MagneticTable, bandwidth: float | None
) -> None:
    """Twice the side's current, half its flux and voltage; the same motion and energies."""
    series = changed(servo, drive={"bandwidth": bandwidth, "voltage_limit": None})
    parallel = changed(series, sides={"connection": "parallel"})
    assert plant_parameters(series).resistance == 4 * plant_parameters(parallel).resistance
    command = 0.4 + 0.1 * np.random.default_rng(2).standard_normal((300, 2))
    one, two = simulate(series, table, Inputs(command, 1e4)), simulate(parallel, table, Inputs(2 * command, 1e4))
    assert two.position == pytest.approx(one.position, rel=1e-6, abs=1e-16)
    assert two.current == pytest.approx(2 * one.current, rel=1e-9)
    assert two.flux_linkage == pytest.approx(0.5 * one.flux_linkage, rel=1e-9)
    assert two.voltage == pytest.approx(0.5 * one.voltage, rel=1e-9, abs=1e-9)
    assert two.audit.electrical == pytest.approx(one.audit.electrical, rel=1e-9)


def test_one_side_rests_against_a_constant_force(servo: Actuator, table: MagneticTable) -> None:
    """n F(i, g_0 - x) + F_const = k x, from a run that has come to rest."""
    one = changed(servo, sides={"count": 1}, motion={"constant_force": -25.0, "damping": 600.0})
    run = simulate(one, table, Inputs(np.full((2000, 1), 0.9), 1e4))
    assert run.current.shape == (2000, 1)
    x = run.position[-1]
    assert 2 * table.force(0.9, 6e-4 - x) - 25.0 == pytest.approx(1.4e5 * x, abs=1e-5)
    assert x == pytest.approx(resting_point(one, table, currents=(0.9, 0.0)).position, rel=1e-5)
    assert abs(x) > 1e-5
