"""Poles of any bandwidth, and inputs that run straight between samples: closed forms, orders, and no cost."""

import numpy as np
import pytest
from coupled_twin import changed, linear_table, locked, mass_and_spring, reference_run
from effect_sets import effects
from scipy.linalg import expm

from msl_fem.actuator import Actuator
from msl_fem.errors import CostWarning, InputError
from msl_fem.plant.effects import EffectValues
from msl_fem.plant.excitation import Inputs
from msl_fem.plant.lane_block import LaneSettings
from msl_fem.plant.lane_run import run_lanes
from msl_fem.plant.plant import plant_parameters, surface_of
from msl_fem.plant.poles import fall_for_squares, fall_moments, falls_together, moments_together
from msl_fem.plant.simulate import Options, Simulation, simulate
from msl_fem.plant.step_count import MANY_STEPS, default_substeps
from msl_fem.table.magnetic_table import MagneticTable

FAST_DRIVE = {"bandwidth": 10e6}
CHANNELS = ("current", "position", "velocity", "voltage")


def wandering(n: int, *, seed: int = 3, hold: str = "zero-order") -> Inputs:
    """Currents about 0.5 A, changed at every sample."""
    noise = np.random.default_rng(seed).standard_normal((n, 2))
    rise = np.minimum(np.arange(n) / 20, 1.0)[:, None]
    return Inputs(rise * (0.5 + 0.03 * noise), 1e4, 3.0 * noise[:, 0], hold)  # type: ignore[arg-type]


def largest_error(one: Simulation, two: Simulation | dict[str, np.ndarray], channel: str) -> float:
    other = two[channel] if isinstance(two, dict) else getattr(two, channel)
    return float(np.abs(getattr(one, channel) - other).max() / np.abs(other).max())


@pytest.mark.parametrize("limit", [0.0, 0.4, 0.9])
@pytest.mark.parametrize("z", [0.6, 5.0, 300.0])
def test_three_values_have_the_moments_of_a_fall(z: float, limit: float) -> None:
    """By quadrature of the fall itself: straight at first where a limit acts, then exponential with one slope."""
    slope = 1.0 / (limit + 1.0 / z)
    corner = slope / z if limit else 1.0
    s = np.unique(np.r_[np.linspace(0, 1, 40_001), np.geomspace(1e-8, 1, 40_001)])
    f = np.where(s < limit, 1 - slope * s, corner * np.exp(-z * np.maximum(s - limit, 0.0)))
    exact = [float(np.trapezoid(g, s)) for g in (f, f * f, (1 - s) * f)]
    m_0, square, m_s, last = fall_moments(z, limit, corner)
    b, m, e = fall_for_squares(m_0, square, m_s, 1.0 + last)
    assert [(b + 4 * m + e) / 6, (b * b + 4 * m * m + e * e) / 6, (b + 2 * m) / 6] == pytest.approx(exact, rel=1e-6)
    assert last == pytest.approx(f[-1], rel=1e-12)


@pytest.mark.parametrize("away", [(1.0, 0.4), (-1.0, 0.3), (0.02, -1.0)])
@pytest.mark.parametrize(
    "z", [(2.0, -0.5, -0.7, 1.5), (8.0, 2.0, 0.5, 30.0), (3.0, 0.0, 0.0, 3.0), (4.0, 0.0, 0.0, 1.0)]
)
def test_three_values_have_the_moments_of_two_coupled_falls(
    z: tuple[float, float, float, float], away: tuple[float, float]
) -> None:
    """By Simpson's rule on the matrix exponential, which changes its sign on the way in some of the cases."""
    s = np.linspace(0.0, 1.0, 4001)
    matrix = np.array(z).reshape(2, 2)
    step = expm(-matrix * s[1])
    f = np.empty((s.size, 2))
    f[0] = away
    for n in range(1, s.size):
        f[n] = step @ f[n - 1]
    weights = np.ones(s.size)
    weights[1:-1:2], weights[2:-1:2] = 4.0, 2.0
    weights /= 3 * (s.size - 1)
    faster, slower, (p_1, q_1, p_2, q_2) = falls_together(z, *away)
    assert np.sort([faster, slower]) == pytest.approx(np.sort(np.linalg.eigvals(matrix)), rel=1e-12)
    fast, slow = fall_moments(faster, 0.0, 1.0), fall_moments(slower, 0.0, 1.0)
    between = (1.0 - fast[3] * slow[3]) / (faster + slower)
    for side, (p, q) in enumerate([(p_1, q_1), (p_2, q_2)]):
        g = f[:, side]
        m_0, square, m_s, last = moments_together(fast, slow, between, p, q)
        b, m, e = fall_for_squares(m_0, square, m_s, g[0] + last)
        exact = [float(weights @ h) for h in (g, g * g, (1 - s) * g)]
        assert [(b + 4 * m + e) / 6, (b * b + 4 * m * m + e * e) / 6, (b + 2 * m) / 6] == pytest.approx(
            exact, abs=1e-9, rel=1e-8
        )
        assert last == pytest.approx(g[-1], abs=1e-11)


@pytest.mark.parametrize("amounts", [
    {"mutual_inductance": {"share": 0.3}},
    {"mutual_inductance": {"share": -0.1}, "cross_coupling": {"share": 0.05}},
    {"mutual_inductance": {"share": 0.1}, "cross_coupling": {"share": -0.04}, "eddy_currents": {"time_constant": 2e-5}},
])  # fmt: skip
def test_coupled_loops_of_a_locked_magnet_have_a_closed_form(
    servo: Actuator, amounts: dict[str, dict[str, float]]
) -> None:
    """One step a sample against the matrix exponential of the circuits as they stand: v = R i + d lambda/dt, lambda_1 =
    Lambda_1 + share Lambda_2, Lambda_1 = L u_1 + M u_2, and u_1 + G dLambda_1/dt = i_1 + share i_2; the loop applies
    v = R i + L w (target - i). The targets jump in opposite senses, at another ratio each."""
    drive = {"bandwidth": 2e3, "voltage_limit": None}
    bench, rate = changed(locked(servo), drive=drive), 1e4
    values = EffectValues(amounts)
    commands = np.array([[0.3, 0.1], [0.1, 0.3], [0.5, 0.5], [0.5, 0.1], [0.2, 0.4]])
    run = simulate(bench, linear_table(), Inputs(commands, rate), effects=values, options=Options(substeps=1))
    inductance, w = 2 * 1.08e-5 / 6.3e-4, 2 * np.pi * 2e3
    mutual = values.get("mutual_inductance", "share") * inductance
    share, shorted = values.get("cross_coupling", "share"), values.get("eddy_currents", "time_constant") / inductance
    own, mixed = np.array([[inductance, mutual], [mutual, inductance]]), np.array([[1.0, share], [share, 1.0]])
    # mixed own u' = w L (t - i), mixed i = u + G own u'
    left = mixed @ own + w * inductance * shorted * np.linalg.inv(mixed) @ own
    fall = w * inductance * np.linalg.solve(left, np.linalg.inv(mixed))
    u, expected = np.zeros(2), [np.zeros(2)]
    for target in commands:
        goal = mixed @ target
        u = goal + expm(-fall / rate) @ (u - goal)
        change = own @ fall @ (goal - u)
        expected.append(np.linalg.solve(mixed, u + shorted * change))
    # a reading is of the instant in front of the jump
    assert run.current[1:] == pytest.approx(np.array(expected[1:-1]), abs=2e-9)


@pytest.mark.parametrize("bandwidth", [5e3, 2e4])
def test_a_fast_current_loop_agrees_with_an_adaptive_integrator(
    servo: Actuator, table: MagneticTable, bandwidth: float
) -> None:
    bench = changed(servo, drive={"bandwidth": bandwidth, "voltage_limit": None})
    inputs = wandering(30)
    run, reference = simulate(bench, table, inputs), reference_run(bench, table, inputs)
    assert run.substeps < 6
    for channel in CHANNELS:
        assert largest_error(run, reference, channel) < 2e-6, channel
    assert abs(run.audit.imbalance) < 1e-6


def test_a_fast_current_loop_meets_its_voltage_limit(servo: Actuator, table: MagneticTable) -> None:
    """Each step begins at the limit of 80 V; the adaptive integrator goes through every one of them."""
    bench = changed(servo, drive=FAST_DRIVE)
    inputs = wandering(3)
    run, reference = simulate(bench, table, inputs), reference_run(bench, table, inputs)
    assert largest_error(run, reference, "current") < 1e-8
    assert largest_error(run, reference, "position") < 1e-5
    assert largest_error(run, reference, "voltage") < 1e-5


@pytest.mark.parametrize(("resistance", "error"), [(2.0, 3e-7), (60.0, 1e-3)])
def test_a_limit_that_ceases_to_act_within_a_step(servo: Actuator, resistance: float, error: float) -> None:
    """One step against four hundred, of a locked coil in which the resistance takes 0.3 or 10 % of the voltage until
    the limit ceases to act: with the slope of the step's begin alone 0.1 and 2 % of the way would be lost."""
    drive = {"bandwidth": 2e3, "voltage_limit": 80.0, "coil_resistance": resistance}
    bench, inputs = changed(locked(servo), drive=drive), Inputs(np.full((3, 2), [0.3, 0.0]), 5e3)
    one, many = (simulate(bench, linear_table(), inputs, options=Options(substeps=n)).current[:, 0] for n in (1, 400))
    assert np.abs(one - many).max() < error * 0.3


def test_ten_megahertz_are_as_none(servo: Actuator, table: MagneticTable) -> None:
    """In steps and in result: what the pole itself does, a sixtieth of a microsecond late."""
    inputs = wandering(300)
    fast, ideal = (changed(servo, drive={"bandwidth": w, "voltage_limit": None}) for w in (10e6, None))
    one, two = simulate(fast, table, inputs), simulate(ideal, table, inputs)
    assert one.substeps == two.substeps
    assert one.position == pytest.approx(two.position, abs=5e-4 * np.abs(two.position).max())
    assert one.current == pytest.approx(two.current, rel=1e-12)
    assert one.voltage == pytest.approx(two.voltage, abs=1e-3 * np.abs(two.voltage).max())


@pytest.mark.parametrize("kind", ["voltage", "force"])
def test_a_fast_pole_of_the_drives_output_is_exact(servo: Actuator, table: MagneticTable, kind: str) -> None:
    inputs = wandering(100) if kind == "voltage" else Inputs(np.random.default_rng(1).standard_normal(100), 1e3)

    def run(bandwidth: float, steps: int | None = None) -> Simulation:
        bench = changed(servo if kind == "voltage" else mass_and_spring(), drive={"kind": kind, "bandwidth": bandwidth})
        return simulate(bench, table if kind == "voltage" else None, inputs, options=Options(substeps=steps))

    assert run(10e6).substeps == run(1.0).substeps
    for bandwidth in (1e3, 10e6):
        coarse, fine = run(bandwidth), run(bandwidth, 400)
        assert coarse.position == pytest.approx(fine.position, abs=1e-5 * np.abs(fine.position).max()), bandwidth


@pytest.mark.parametrize("bandwidth", [None, 1000.0, 10e6])
def test_straight_voltages_of_a_locked_coil_have_a_closed_form(servo: Actuator, bandwidth: float | None) -> None:
    """R L under a ramp, v = s t: i = s/R (t - T + T exp(-t/T)), T = L/R; a drive's pole is late by 1/w in the end."""
    bench = changed(locked(servo), drive={"kind": "voltage", "bandwidth": bandwidth})
    ramp = Inputs(np.outer(np.arange(40), [0.25, 0.1]), 1e3, hold="linear")
    run = simulate(bench, linear_table(), ramp, options=Options(substeps=8))
    t, late = run.time[:, None], 0.0 if bandwidth is None else 1 / (2 * np.pi * bandwidth)
    slope, constant = np.array([250.0, 100.0]), (2 * 1.08e-5 / 6.3e-4) / 2.0
    fall, own = np.exp(-t / constant), np.exp(-t / late) if late else 0.0 * t
    exact = slope / 2 * (t - constant - late + (constant**2 * fall - late**2 * own) / (constant - late))
    assert run.current == pytest.approx(exact, abs=2e-8 * exact.max())
    assert run.voltage[:-1, 0] == pytest.approx(
        250 * (t[:-1, 0] + 5e-4 - late + late**2 * 1e3 * (own[:-1, 0] - own[1:, 0])), abs=1e-7 * 10
    )


def test_straight_inputs_keep_the_order_of_the_steps(servo: Actuator) -> None:
    """The ramp of a locked coil of 40 ohm; means of the inputs over the steps would leave order 2."""
    bench = changed(locked(servo), drive={"kind": "voltage", "bandwidth": None, "coil_resistance": 20.0})
    ramp = Inputs(np.outer(np.arange(5), [2.0, 1.0]), 1e3, hold="linear")
    constant, t = (2 * 1.08e-5 / 6.3e-4) / 40.0, 4e-3
    exact = 2e3 / 40 * (t - constant + constant * np.exp(-t / constant))
    ends = [simulate(bench, linear_table(), ramp, options=Options(substeps=n)).current[-1, 0] for n in (4, 8, 16)]
    errors = np.abs(np.array(ends) - exact)
    assert np.log2(errors[:-1] / errors[1:]) == pytest.approx([4.0, 4.0], abs=0.3)


@pytest.mark.parametrize("drive", [{"kind": "current"}, FAST_DRIVE, {"bandwidth": None}, {"kind": "voltage"}])
def test_straight_inputs_are_the_limit_of_fine_ones(
    servo: Actuator, table: MagneticTable, drive: dict[str, object]
) -> None:
    """Held on a grid forty times as fine as the straight line goes, half a fine sample late."""
    fine, bench = 40, changed(servo, drive=drive | {"voltage_limit": None})
    coarse = wandering(40, hold="linear")
    held = np.interp((np.arange(39 * fine) + 0.5) / fine, np.arange(40), coarse.commands[:, 0])
    both = np.interp((np.arange(39 * fine) + 0.5) / fine, np.arange(40), coarse.commands[:, 1])
    push = np.repeat(np.asarray(coarse.disturbance)[:39], fine)
    one = simulate(bench, table, coarse)
    two = simulate(bench, table, Inputs(np.column_stack([held, both]), 1e4 * fine, push))
    assert one.position[:39] == pytest.approx(two.position[::fine], abs=1e-4 * np.abs(two.position).max())
    late = simulate(bench, table, Inputs(coarse.commands, 1e4, coarse.disturbance))
    assert np.abs(late.current[:39] - two.current[::fine]).max() > 1e-2 * np.abs(two.current).max()
    assert np.abs(one.current[:39] - two.current[::fine]).max() < 4e-3 * np.abs(two.current).max()


@pytest.mark.parametrize("hold", ["zero-order", "linear"])
@pytest.mark.parametrize("drive", [FAST_DRIVE, {"bandwidth": 3e3}, {"bandwidth": None}, {"kind": "voltage"}])
def test_neutral_effects_and_lanes_change_no_bit(
    servo: Actuator, table: MagneticTable, drive: dict[str, object], hold: str
) -> None:
    bench, inputs = changed(servo, drive=drive), wandering(40, hold=hold)
    plain, neutral = (simulate(bench, table, inputs, effects=e) for e in (None, EffectValues()))
    for channel in (*CHANNELS, "flux_linkage", "measured_position"):
        assert np.array_equal(getattr(plain, channel), getattr(neutral, channel)), channel
    plants = [plant_parameters(bench), plant_parameters(bench)._replace(mass=1.0)]
    for effect_rows in (None, np.tile(EffectValues().vector(), (2, 1))):
        settings = LaneSettings(effects=effect_rows)
        lanes = run_lanes(surface_of(table), plants, inputs, substeps=plain.substeps, settings=settings)
        assert np.array_equal(lanes.current[0], plain.current)
        assert np.array_equal(lanes.true_position[0], plain.position)


@pytest.mark.parametrize(
    ("effect", "amounts"),
    [
        ("eddy_currents", {"time_constant": 3e-4}),
        ("magnetic_hysteresis", {"coercive_current": 0.05, "reversal_current": 0.3}),
        ("cross_coupling", {"share": 0.05}),
        ("early_saturation", {"low_field_current": 0.05}),
        ("amplifier_bandwidth", {"lag": 3e-5}),
        ("time_delay", {"command": 1.37e-4}),
    ],
)
def test_effects_in_the_circuit_bear_a_fast_loop(
    servo: Actuator, table: MagneticTable, effect: str, amounts: dict[str, float]
) -> None:
    """What an effect does under a loop of 10 MHz, at the default steps and at many: within 2 %."""
    bench, inputs = changed(servo, drive=FAST_DRIVE | {"voltage_limit": None}), wandering(60)
    values = effects(effect, **amounts)
    plain, coarse = simulate(bench, table, inputs), simulate(bench, table, inputs, effects=values)
    fine = simulate(bench, table, inputs, effects=values, options=Options(substeps=100))
    assert coarse.substeps < 10
    size = np.abs(fine.position - plain.position).max()
    assert coarse.position == pytest.approx(fine.position, abs=0.02 * size)


def test_the_steps_follow_currents_and_excitation(servo: Actuator, table: MagneticTable) -> None:
    """Voltage pulses up to 4 A at the default steps: 1e-7 of full scale, as the documents promise."""
    bench = changed(servo, drive={"kind": "voltage", "bandwidth": None, "voltage_limit": None})
    voltage = np.full((130, 2), 0.5)
    voltage[10:24] = [60.0, 58.0]
    run = simulate(bench, table, Inputs(voltage, 1e4))
    fine = simulate(bench, table, Inputs(voltage, 1e4), options=Options(substeps=100))
    assert np.abs(run.current).max() > 2.4
    assert largest_error(run, fine, "position") < 1e-7
    assert largest_error(run, fine, "current") < 1e-7
    assert default_substeps(plant_parameters(bench), table, rate=1e4, commands=3 * voltage) > run.substeps


def test_many_steps_are_said_with_the_key_and_what_to_write(servo: Actuator, table: MagneticTable) -> None:
    stiff = plant_parameters(changed(servo, motion={"damping": 1e5}))
    with pytest.warns(CostWarning, match=r"motion\.damping over motion\.moving_mass .* takes 171 steps, usual are 50"):
        assert default_substeps(stiff, table, rate=1e4) == 171
    effect = effects("structural_mode", mass_share=0.1, frequency=9e3)
    with pytest.warns(CostWarning, match=r"structural_mode .* write a slower effect, or none"):
        assert default_substeps(plant_parameters(servo), table, rate=1e4, effects=effect) > MANY_STEPS
    with pytest.raises(InputError, match="steps a sample at 10 kHz; at most 100000"):
        default_substeps(stiff._replace(damping=1e9), table, rate=1e4)


def test_each_lane_has_its_own_sensor(servo: Actuator, table: MagneticTable) -> None:
    """Beside one whose sensor lags and is late a sensor without a lag reads what it does in front of it."""
    late = effects("position_sensor_lag", lag=2e-4, delay_share=0.3).vector()
    rows = np.array([late, EffectValues().vector()])
    bench = changed(servo, drive={"kind": "voltage"})
    plants = [plant_parameters(bench)._replace(mass=1e6, sensor_bandwidth=np.inf)] * 2
    inputs, starts = Inputs(np.zeros((60, 2)), 1e4), np.array([0.0, 0.0, 1e-5, 1e-2])
    read = [
        run_lanes(surface_of(table), plants, inputs, substeps=4, settings=LaneSettings(order, starts)).position
        for order in (rows, rows[::-1])
    ]
    assert np.isfinite(read[0]).all()
    np.testing.assert_array_equal(read[0], read[1][::-1])
