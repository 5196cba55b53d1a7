"""The physics of the effects of coil, amplifier and time, where the answer is known."""

from itertools import pairwise

import numpy as np
import pytest
from coupled_twin import changed, linear_table, locked
from effect_sets import effects, rig, rough
from scipy.integrate import quad, solve_ivp

from msl_fem.actuator import Actuator
from msl_fem.plant.effects import EffectValues
from msl_fem.plant.effects.mechanisms import fall_stages
from msl_fem.plant.excitation import Inputs
from msl_fem.plant.plant import plant_parameters
from msl_fem.plant.simulate import Options, simulate
from msl_fem.plant.step_count import default_substeps
from msl_fem.table.magnetic_table import MagneticTable

FINE = Options(substeps=64)


@pytest.mark.parametrize("share", [0.0, 0.3, 0.99, 1.0])
@pytest.mark.parametrize("decay", [1e-6, 0.5, 1.999, 2.001, 60.0])
def test_stage_values_have_the_signal_s_moments(share: float, decay: float) -> None:
    """What Runge-Kutta makes of the three values: the integrals of the signal, up to the second order of the step."""
    begin, middle, end, last = fall_stages(share, decay)

    def signal(s: float) -> float:
        return 1.0 if s < share else float(np.exp(-decay * (s - share)))

    def integral(order: int) -> float:
        ends = ((0, share), (share, 1))
        return sum(quad(lambda s: signal(s) * (1 - s) ** order, *end, epsabs=1e-13, limit=200)[0] for end in ends)

    assert (begin + 4 * middle + end) / 6 == pytest.approx(integral(0), abs=1e-11)
    assert (begin + 2 * middle) / 6 == pytest.approx(integral(1), abs=1e-11)
    assert (begin + middle) / 12 == pytest.approx(integral(2) / 2, abs=1e-11)
    assert last == pytest.approx(signal(1.0), rel=1e-12)


def test_a_coil_warms_by_what_it_dissipates(servo: Actuator) -> None:
    """At a held current d rho/dt = beta R (1 + rho) i^2 - rho/tau from rho_0, in closed form; v = R (1 + rho) i."""
    values = effects("coil_heating", rise_per_joule=0.02, initial_rise=0.05, cooling_rate=0.5)
    run = simulate(
        locked(servo), linear_table(), Inputs(np.full((300, 2), [3.0, 0.0]), 1e3), effects=values,
        options=Options(currents=(3.0, 0.0)),
    )  # fmt: skip
    gain = 0.02 * 2.0 * 9.0
    rate, rest = gain - 0.5, gain / (gain - 0.5)
    rho = (0.05 + rest) * np.exp(rate * run.time) - rest
    assert run.current[:, 0] == pytest.approx(3.0, rel=1e-9)
    middle = (rho[1:] + rho[:-1]) / 2
    assert run.voltage[:-1, 0] == pytest.approx(2.0 * (1 + middle) * 3.0, rel=1e-7)
    assert run.voltage[:, 1] == pytest.approx(0.0, abs=1e-12)


def test_the_amplifier_s_lag_is_a_pole_more(servo: Actuator) -> None:
    """Two first-order lags in series answer a step, of 2 ms and of 1/(2 pi 100 Hz), whatever the step of time."""
    bench = changed(locked(servo), drive={"bandwidth": 100.0})
    for tau, substeps in ((2e-3, 20), (1e-6, 4)):
        run = simulate(
            bench, linear_table(), Inputs(np.full((200, 2), 1.0), 1e4), effects=effects("amplifier_bandwidth", lag=tau),
            options=Options(substeps=substeps),
        )  # fmt: skip
        w = 2 * np.pi * 100.0
        fast, slow = np.exp(-run.time / tau), np.exp(-w * run.time)
        exact = 1 - (slow - w * tau * fast) / (1 - w * tau)
        assert run.current[:, 0] == pytest.approx(exact, abs=1e-6)


def test_a_bandwidth_error_is_another_bandwidth(servo: Actuator, table: MagneticTable) -> None:
    one = simulate(servo, table, rough(60), effects=effects("amplifier_bandwidth", bandwidth_error=0.2))
    wider = changed(servo, drive={"bandwidth": 1200.0})
    two = simulate(wider, table, rough(60), options=Options(substeps=one.substeps))
    assert one.current == pytest.approx(two.current, rel=1e-12)


def test_a_slew_limit_makes_a_ramp() -> None:
    """5 ms for a newton: a step of 6 N is a ramp of 30 ms; the mean force is there to rounding, at any step."""
    run = simulate(
        rig(), None, Inputs(np.full((60, 1), 6.0), 1e3), effects=effects("amplifier_bandwidth", slew_time=5e-3),
        options=Options(substeps=7),
    )  # fmt: skip
    ramp = np.minimum((run.time + 0.5e-3) / 5e-3, 6.0)
    assert run.force == pytest.approx(ramp, rel=1e-12)


@pytest.mark.parametrize(
    ("lag", "late", "share"), [(4e-3, 0.0, 0.0), (4e-3, 3.7e-4, 0.0), (8e-3, 0.0, 0.9), (5e-4, 3.7e-4, 0.0)]
)
def test_a_lag_with_a_slew_limit_follows_its_equation(lag: float, late: float, share: float) -> None:
    """y' = S tanh((s - y)/(lag S)) by another method; steps that slew all the way and steps that hardly do."""
    commands, slope = np.repeat([6.0, -4.0, -3.9, 0.3], 15), 500.0
    amplifier = {"lag": lag, "slew_time": 1 / slope, "delay_share": share}
    values = EffectValues({"amplifier_bandwidth": amplifier, "time_delay": {"command": late}})
    run = simulate(rig(), None, Inputs(commands[:, None], 1e3), effects=values, options=Options(substeps=16))
    pole, jumps = (1 - share) * lag, np.arange(60) * 1e-3 + share * lag + late
    held, state = np.append(0.0, commands), np.zeros(2)
    samples = np.arange(61) * 1e-3
    ends = np.union1d(jumps, samples)
    impulse = [0.0]
    for begin, end in pairwise(ends):
        wanted = held[np.searchsorted(jumps, 0.5 * (begin + end))]
        found = solve_ivp(
            lambda t, y, s=wanted: [slope * np.tanh((s - y[0]) / (pole * slope)), y[0]],
            (begin, end), state, method="Radau", rtol=1e-8, atol=1e-10,
        )  # fmt: skip
        state = found.y[:, -1]
        impulse.append(state[1])
    exact = np.diff(np.array(impulse)[np.searchsorted(ends, samples)]) * 1e3
    assert run.force == pytest.approx(exact, abs=2e-3)


def test_a_lag_that_vanishes_leaves_the_slew_limit() -> None:
    inputs = Inputs(np.repeat([6.0, -4.0, 0.3], 20)[:, None], 1e3)
    forces = [
        simulate(
            rig(), None, inputs, effects=effects("amplifier_bandwidth", slew_time=5e-3, lag=lag), options=FINE
        ).force
        for lag in (0.0, 1e-7, 1e-5)
    ]
    assert forces[1] == pytest.approx(forces[0], abs=1e-4)
    assert forces[2] == pytest.approx(forces[0], abs=1e-2)


@pytest.mark.parametrize("kind", ["current", "voltage"])
def test_a_delay_of_whole_samples_shifts_the_run(servo: Actuator, table: MagneticTable, kind: str) -> None:
    bench = changed(servo, drive={"kind": kind, "bandwidth": 1000.0})
    inputs = rough(120)
    late = simulate(bench, table, Inputs(inputs.commands, 1e4), effects=effects("time_delay", command=3e-4))
    soon = simulate(bench, table, Inputs(inputs.commands, 1e4), effects=EffectValues())
    assert (late.position[:3] == 0).all()
    assert late.current[3:] == pytest.approx(soon.current[:-3], rel=1e-9, abs=1e-12)
    assert late.position[3:] == pytest.approx(soon.position[:-3], rel=1e-9, abs=1e-18)


def test_a_delay_of_a_part_of_a_sample_is_that_part(servo: Actuator, table: MagneticTable) -> None:
    """0.37 of a sample, between steps of the integrator: a run sampled 100 times as fast knows the shifted command."""
    commands = rough(60).commands
    late = simulate(servo, table, Inputs(commands, 1e4), effects=effects("time_delay", command=0.37e-4))
    fine = np.vstack([np.zeros((37, 2)), np.repeat(commands, 100, axis=0)])[:6000]
    exact = simulate(servo, table, Inputs(fine, 1e6))
    assert late.current == pytest.approx(exact.current[::100], abs=1e-6 * 0.5)
    assert late.position == pytest.approx(exact.position[::100], abs=1e-6 * np.abs(late.position).max())


@pytest.mark.parametrize("tied", [{}, {"cross_coupling": {"share": 0.03}}], ids=["each side by itself", "tied sides"])
def test_a_voltage_limit_holds_before_and_behind_a_jump_within_a_step(
    servo: Actuator, table: MagneticTable, tied: dict[str, dict[str, float]]
) -> None:
    """Not for the values that stand for the jump, which lie beyond either command: with these the currents were off by
    1.8 mA of the 0.47 A that the limit changes them by."""
    bench = changed(locked(servo), drive={"bandwidth": 2e3, "voltage_limit": 12.0})
    commands = np.repeat([[0.5, 0.5], [0.9, 0.2], [0.3, 0.7]], 20, axis=0)
    values = EffectValues({"time_delay": {"command": 0.372e-4}} | tied)
    late = simulate(bench, table, Inputs(commands, 1e4), effects=values, options=Options(substeps=7))
    fine = np.vstack([np.zeros((93, 2)), np.repeat(commands, 250, axis=0)])[:15000]
    exact = simulate(bench, table, Inputs(fine, 2.5e6), effects=EffectValues(tied))
    free = simulate(changed(bench, drive={"voltage_limit": None}), table, Inputs(fine, 2.5e6))
    assert np.abs(exact.current - free.current).max() > 0.4
    assert late.current == pytest.approx(exact.current[::250], abs=5e-5)


@pytest.mark.parametrize(("limit", "error"), [(None, 1e-6), (12.0, 5e-4)])
def test_a_late_command_of_a_slow_controller_has_the_steps_it_takes(
    servo: Actuator, table: MagneticTable, limit: float | None, error: float
) -> None:
    """In closed form the loop is right for commands that change between steps: in one step a sample the currents were
    off by some per cent of the change, and with a voltage limit by what that changes. Beyond 50 steps it stays so."""
    bench = changed(locked(servo), drive={"bandwidth": 1e3, "voltage_limit": limit})
    commands = np.repeat([[0.5, 0.5], [0.9, 0.2], [0.3, 0.7]], 4, axis=0)
    values = EffectValues({"time_delay": {"command": 1.37e-4}})
    late = simulate(bench, table, Inputs(commands, 2.5e3), effects=values)
    fine = np.vstack([np.zeros((137, 2)), np.repeat(commands, 400, axis=0)])[:4800]
    exact = simulate(bench, table, Inputs(fine, 1e6))
    assert late.current == pytest.approx(exact.current[::400], abs=error)
    faster = plant_parameters(changed(bench, drive={"bandwidth": 2e4}))
    few = default_substeps(faster, table, rate=2.5e3)
    assert default_substeps(faster, table, rate=2.5e3, effects=values) == few < 10


def test_an_ideal_voltage_drive_is_delayed_too(servo: Actuator, table: MagneticTable) -> None:
    bench = changed(servo, drive={"kind": "voltage", "bandwidth": None})
    commands = rough(60).commands
    late = simulate(bench, table, Inputs(commands, 1e4), effects=effects("time_delay", command=0.37e-4))
    mean = 0.63 * commands + 0.37 * np.vstack([np.zeros((1, 2)), commands[:-1]])
    assert late.voltage == pytest.approx(mean, rel=1e-12, abs=1e-15)


def test_a_delayed_slew_begins_within_its_step() -> None:
    """The ramp of 5 ms a newton begins 0.37 ms late, within a step: the mean forces are exact all the same."""
    values = EffectValues({"amplifier_bandwidth": {"slew_time": 5e-3}, "time_delay": {"command": 3.7e-4}})
    run = simulate(rig(), None, Inputs(np.full((60, 1), 6.0), 1e3), effects=values, options=Options(substeps=7))

    def impulse(t: np.ndarray) -> np.ndarray:
        rise = np.clip(t - 3.7e-4, 0.0, 30e-3)
        return rise**2 / (2 * 5e-3) + 6.0 * np.maximum(t - 3.7e-4 - 30e-3, 0.0)

    assert run.force == pytest.approx((impulse(run.time + 1e-3) - impulse(run.time)) * 1e3, rel=1e-9, abs=1e-12)
