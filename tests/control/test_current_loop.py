"""The current loop: its pole and lag in closed form, its limits, and the position loop that sees it."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from servo_controllers import TABLE, believed, servo, servo_design, servo_map, sine

from msl_fem.actuator import Actuator
from msl_fem.actuator.current_loop import CurrentLoop
from msl_fem.control import DesignModel, PlantUnderTest, closed_loop_response, design_model_of, run_closed_loop
from msl_fem.control.current_loop import CurrentLoopDesign, held_coil, measured_lag
from msl_fem.control.current_step import ACTING, BEGUN, N_LIMITED, N_STATE, UNKNOWN, current_step, side_linkage
from msl_fem.control.design import ControllerDesign, completed
from msl_fem.control.lqr_design import lqr_design
from msl_fem.control.power_stage import PowerStage, bridge_voltage, converted
from msl_fem.control.stepper import Stepper
from msl_fem.errors import ActuatorError, InputError
from msl_fem.plant.effects import EffectValues
from msl_fem.plant.excitation import Reference, parse_excitation, reference
from msl_fem.plant.sampled_plant import simulate_closed

IDEAL = PowerStage(0.0, 0.0, 0.0, 100.0, 8)
Loop = dict[str, float | int]


def rig(*, drive: dict[str, object] | None = None, **loop: float | int) -> Actuator:
    section = CurrentLoop.model_validate({"dead_time": "0.5 us"}).model_copy(update=loop) if loop else None
    return servo(drive={"kind": "voltage", "bandwidth": None, "current_loop": section} | (drive or {}))


def belief(**settings: object) -> DesignModel:
    return design_model_of(rig(**settings), TABLE, servo_map())


def loop_of(**settings: object) -> CurrentLoopDesign:
    found = belief(**settings).current_loop
    assert found is not None
    return found


@cache
def usual() -> CurrentLoopDesign:
    return loop_of()


@cache
def on_voltage() -> ControllerDesign:
    return lqr_design(belief())


def linkages(loop: CurrentLoopDesign, currents: np.ndarray) -> np.ndarray:
    p = loop.parameters
    return np.array([side_linkage(p, 0, float(i), 0.0, p.inverse.gap_1)[0] for i in currents])


@pytest.mark.parametrize(("low", "high"), [(0.5, 0.6), (4.0, 4.4), (8.0, 8.2)])
def test_the_flux_linkage_has_one_pole_behind_a_period_of_delay_at_any_current(low: float, high: float) -> None:
    """lambda[k] = high - (high - low) pole^(k-2): closed form; of a constant inductance the current is the same."""
    loop = usual()
    p = loop.parameters._replace(voltage_limit=1e9, voltage_step=0.0)
    n, start = 40, 5
    wanted = np.where(np.arange(n) < start, low, high)
    found = linkages(loop, held_coil(p, IDEAL, wanted))
    begin, end = linkages(loop, np.array([low, high]))
    after = np.arange(n) - start
    expected = np.where(after < 2, begin, end - (end - begin) * p.pole ** np.maximum(after - 1, 0))
    np.testing.assert_allclose(found, expected, atol=6e-3 * (end - begin))  # R T/L is 0.5 % at most


@pytest.mark.parametrize("bias", [0.7, 4.0, 8.0])
@pytest.mark.parametrize("bandwidth", [500.0, 2000.0])
def test_the_measured_lag_is_that_of_the_closed_form(bandwidth: float, bias: float) -> None:
    loop = usual()
    p = loop.parameters._replace(pole=float(np.exp(-2 * np.pi * bandwidth * loop.parameters.period)), voltage_step=0.0)
    promised = replace(loop, parameters=p).promised_lag
    found = measured_lag(p, IDEAL, bandwidth=bandwidth, amplitude=0.02, bias=bias)
    assert found == pytest.approx(promised, rel=0.01)


def test_delay_and_lag_of_first_order_have_mean_and_variance_of_the_loop() -> None:
    loop = usual()
    p, start = loop.parameters._replace(voltage_limit=1e9, voltage_step=0.0), 5
    found = linkages(loop, held_coil(p, IDEAL, np.where(np.arange(80) < start, 4.0, 4.4)))
    pulse = np.diff(found[start:]) / (
        found[-1] - found[start]
    )  # of a voltage that is held the flux linkage is straight
    middle = (np.arange(pulse.size) + 0.5) * p.period
    mean = float(pulse @ middle)
    variance = float(pulse @ (middle**2 + p.period**2 / 12)) - mean**2
    plant = belief().plant
    assert mean == pytest.approx(loop.promised_lag, rel=0.01)
    late = loop.promised_lag - loop.dead_time
    assert late == pytest.approx(np.sqrt(variance), rel=0.04)  # the integral's slow part takes 3 %
    assert plant.dead_time == loop.dead_time
    assert 1.0 / plant.prompt_lag() == pytest.approx(loop.lag - loop.dead_time)
    assert belief(bandwidth=500.0).plant.dead_time < plant.dead_time


def test_converters_and_dead_time_change_the_lag_little_and_leave_no_lasting_error() -> None:
    loop = loop_of(dead_time=1e-6)
    assert loop.stage.dead_time_voltage == pytest.approx(3.2)
    assert loop.lag == pytest.approx(loop.promised_lag, rel=0.03)
    wrong = loop.parameters._replace(resistance=0.7 * loop.parameters.resistance)
    found = held_coil(wrong, loop.stage, np.where(np.arange(900) < 5, 0.9, 1.0))
    assert found[400:].mean() == pytest.approx(1.0, abs=0.6 * loop.stage.current_step)
    forgetful = held_coil(wrong._replace(forget=0.0), loop.stage, np.full(900, 1.0))
    assert abs(forgetful[400:].mean() - 1.0) > 2 * loop.stage.current_step


def test_the_step_meets_the_voltage_limit_where_that_sets_the_bandwidth() -> None:
    loop = loop_of(drive={"voltage_limit": 20.0})
    assert loop.limited_by == "voltage limit"
    assert loop.bandwidth < 2000.0
    assert loop.step_voltage == pytest.approx(20.0)
    assert usual().limited_by == "delay"
    assert usual().bandwidth == pytest.approx(2000.0)
    p = loop.parameters._replace(voltage_step=0.0)
    for more, cut in ((0.98, 0.0), (1.05, 1.0)):
        state, voltage, wanted = np.zeros(N_STATE), np.zeros(2), np.array([more * loop.step, 0.0])
        current_step(p, state, wanted, np.zeros(2), 0.0, 0.0, voltage)
        assert state[N_LIMITED] == cut
        assert abs(voltage[0]) <= 20.0


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"bandwidth": 1500.0, "drive": {"voltage_limit": 20.0}}, "V where the drive has 20 V; wish for at most"),
        ({"bandwidth": 4000.0}, "not to be had at 20 kHz with one period of delay"),
        ({"drive": {"bandwidth": 1000.0}, "bandwidth": 300.0}, "with an amplifier of 1 kHz; wish for at most 200 Hz"),
        ({"rate": 11e3}, "no whole multiple of controller.rate 2.5 kHz; state one, like 20 kHz"),
        ({"drive": {"voltage_limit": None}}, "voltage_limit is missing"),
    ],
)
def test_a_loop_that_cannot_be_is_refused_in_one_line(settings: dict[str, object], said: str) -> None:
    with pytest.raises(InputError, match=said) as refused:
        belief(**settings)
    assert "\n" not in str(refused.value)


def test_a_wish_below_the_bounds_is_kept() -> None:
    assert loop_of(bandwidth=700.0, rate=25e3).to_json() | {"lag_s": 0.0} == loop_of(
        bandwidth=700.0, rate=25e3
    ).to_json() | {"lag_s": 0.0, "bandwidth_Hz": 700.0, "rate_Hz": pytest.approx(25e3), "limited_by": "wish"}


def test_a_section_beside_a_current_drive_is_refused() -> None:
    with pytest.raises(ValueError, match="a current drive has its loop inside"):
        type(servo().drive).model_validate({"kind": "current", "current_loop": {}})  # type: ignore[union-attr]


def test_a_reading_that_is_no_number_gives_no_voltage() -> None:
    p, state, voltage = usual().parameters, np.zeros(N_STATE), np.zeros(2)
    state[[UNKNOWN, BEGUN]] = 3.0, 1.0
    current_step(p, state, np.ones(2), np.array([0.5, np.nan]), 0.0, 0.0, voltage)
    assert (state[[UNKNOWN, BEGUN, ACTING]] == 0.0).all()
    assert (voltage == 0.0).all()
    current_step(p, state, np.ones(2), np.array([0.5, 0.5]), 0.0, 0.0, voltage)
    assert (voltage > 0.0).all()
    assert state[UNKNOWN] == 0.0


def test_what_dead_time_takes_is_that_of_a_switched_bridge() -> None:
    """A bridge of two legs over one period: in dead time the current's sign decides which rail a leg has."""
    supply, period, dead, n = 80.0, 5e-5, 1e-6, 100_000
    t = (np.arange(n) + 0.5) * period / n
    for wanted in (-20.0, 0.0, 35.0):
        duty = 0.5 * (1 + wanted / supply)
        upper = np.abs(t - period / 2) < 0.5 * duty * period  # of leg A; leg B is its opposite
        edges = np.array([0.5 * (1 - duty), 0.5 * (1 + duty)]) * period
        off = np.minimum(*(np.where(t >= edge, t - edge, np.inf) for edge in edges)) < dead
        leg_a = np.where(off, 0.0, np.where(upper, 1.0, 0.0))  # a current out of A comes from the lower diode
        leg_b = np.where(off, 1.0, np.where(upper, 0.0, 1.0))  # and into B goes through the upper one
        mean = supply * (leg_a - leg_b).mean()
        stage = PowerStage(2 * dead / period * supply, 0.05, 0.0, 12.0, 8)
        assert bridge_voltage(stage, wanted, 1.0) == pytest.approx(mean, abs=0.01)
        assert bridge_voltage(stage, wanted, 0.0) == wanted


def test_ripple_and_readings() -> None:
    loop = usual()
    ends = np.cumsum(np.r_[1.0, -1.0, -1.0, 1.0]) * 80.0 * loop.parameters.period / 4 / loop.inductance
    assert 2 * loop.stage.ripple == pytest.approx(ends.max() - ends.min())
    for current in (0.1234, -3.3, 40.0):
        assert abs(converted(loop.stage, current) - np.clip(current, -12.0, 12.0)) <= 0.5001 * loop.stage.current_step


def test_the_position_loop_sees_the_measured_lag() -> None:
    fast, slow = belief(), belief(bandwidth=400.0)
    assert fast.current_loop is not None
    assert slow.current_loop is not None
    assert fast.plant.lag == pytest.approx(1.0 / fast.current_loop.lag)
    assert slow.current_loop.lag > 3 * fast.current_loop.lag
    design = on_voltage()
    late = replace(design.law, plant=slow.plant)
    assert late.peak_sensitivity() > 1.05 * design.law.peak_sensitivity()
    assert completed.__module__ == "msl_fem.control.design"


def test_a_voltage_rig_tracks_as_its_linear_loop_says() -> None:
    design, plant = on_voltage(), PlantUnderTest(rig(), TABLE)
    run = run_closed_loop(design, sine(3e-4, 2.0, 0.6), plant=plant, generator=np.random.default_rng(1))
    assert run.tracking_rms < 1e-3 * 3e-4
    assert run.guard_violations == 0
    assert run.voltage_limited is not None
    assert np.abs(run.voltage).max() <= 80.0 + 1e-9
    swung = closed_loop_response(design, plant=plant, frequencies=[40.0, 120.0], amplitude=3e-5, position=2e-4)
    np.testing.assert_allclose(swung.response, swung.predicted, atol=0.05)


@pytest.mark.parametrize(
    "loop", [{"periods": 4}, {"periods": 2, "bandwidth": 400.0}, {"periods": 1}, {"periods": 4, "flux_corner": 50.0}]
)
def test_step_by_step_the_loop_is_that_of_a_closed_loop_run(loop: Loop) -> None:
    """Two routes: a `Stepper` in a run sampled as its current loop is, and the compiled run of controller samples."""
    loop = dict(loop)
    assert servo().controller is not None
    rate = servo().controller.rate * loop.pop("periods")
    ideal = {"rate": rate, "dead_time": 0.0, "converter_bits": None, "pulse_steps": None}
    actuator = rig(drive={"bandwidth": None}, **ideal, **loop)
    design = lqr_design(design_model_of(actuator, TABLE, servo_map()))
    wanted = reference(parse_excitation("sine:frequency=20 Hz,amplitude=50 um,duration=0.2 s,loop=closed"), rate=rate)
    ours = simulate_closed(actuator, TABLE, wanted, Stepper(design))
    every = round(rate / servo().controller.rate)
    at = slice(None, None, every)
    of_controller = Reference(wanted.time[at], wanted.position[at], wanted.velocity[at], wanted.acceleration[at])
    theirs = run_closed_loop(design, of_controller, plant=PlantUnderTest(actuator, TABLE))
    ahead = slice(None, -5)  # the reference's last sample, which is known ahead, is a sample's length away
    assert np.ptp(ours.position) > 8e-5
    np.testing.assert_allclose(ours.position[at][ahead], theirs.position[ahead], atol=1e-9)
    np.testing.assert_allclose(ours.current[at][ahead], theirs.current[ahead], atol=2e-4)
    means = ours.voltage.reshape(-1, every, 2).mean(axis=1)
    np.testing.assert_allclose(means[ahead], theirs.voltage[ahead], atol=0.05)


def test_the_drive_of_plant_and_controller_must_be_one() -> None:
    with pytest.raises(InputError, match="current loop of its own"):
        run_closed_loop(on_voltage(), sine(1e-4, 2.0, 0.1), plant=believed())
    with pytest.raises(InputError, match="commands currents"):
        run_closed_loop(servo_design(), sine(1e-4, 2.0, 0.1), plant=PlantUnderTest(rig(), TABLE))


def test_without_a_table_the_loop_has_no_flux_linkage() -> None:
    from msl_fem.control import linear_plant

    with pytest.raises(ActuatorError, match="with a table, on which the current loop rests"):
        linear_plant(rig())


def test_an_observed_flux_takes_eddy_currents_and_the_gaps_error_out_of_the_position_loop() -> None:
    """The table's flux linkage at the coil's current is not that which pulls; the integral of the voltage is."""
    both = EffectValues({"eddy_currents": {"time_constant": 5e-5}, "gap_offset": {"offset": 2e-5}})
    observed = belief(flux_corner=10.0).current_loop
    assert observed is not None
    assert observed.lag == pytest.approx(usual().lag)
    assert observed.to_json()["flux_observed"]
    found = {}
    for name, loop in {"table": usual(), "observed": observed, "blind": _without_dead_time(observed)}.items():
        design = replace(on_voltage(), current_loop=loop)
        for plant in (None, both):
            run = run_closed_loop(
                design, sine(1e-4, 60.0, 0.3), plant=PlantUnderTest(rig(), TABLE, plant),
                generator=np.random.default_rng(1),
            )  # fmt: skip
            late = run.time > 0.15
            found[name, plant is None] = np.sqrt(np.mean((run.position - run.reference)[late] ** 2)) / 1e-4
    assert found["observed", False] < 0.8 * found["table", False]
    assert found["observed", True] < 1.2 * found["table", True]
    assert found["blind", True] > 2 * found["observed", True]  # what integrates must know the bridge's own loss


def test_an_observed_flux_is_led_to_that_of_the_position_at_which_the_currents_were_inverted() -> None:
    """The linkage that belongs to the force is that at the gap to come; the table's loop takes the measured one."""
    observed = belief(flux_corner=10.0).current_loop
    assert observed is not None
    wanted, read, aims = np.array([1.0, 0.0]), np.array([0.999, 0.0]), (0.0, 2e-6)
    for loop, led in ((observed, True), (usual(), False)):
        p, voltage = loop.parameters._replace(voltage_step=0.0), np.zeros((2, 2))
        for aim, out in zip(aims, voltage, strict=True):
            current_step(p, np.zeros(N_STATE), wanted, read, 0.0, aim, out)
        target = [side_linkage(p, 0, 1.0, 0.0, p.inverse.gap_1 - aim)[0] for aim in aims]
        more = (1 - p.pole) * (target[1] - target[0]) / p.period if led else 0.0
        assert voltage[1, 0] - voltage[0, 0] == pytest.approx(more, abs=1e-9)
        assert np.abs(voltage).max() < p.voltage_limit


def _without_dead_time(loop: CurrentLoopDesign) -> CurrentLoopDesign:
    return replace(loop, parameters=loop.parameters._replace(lost=0.0))


def test_a_corner_near_the_loops_pole_is_refused() -> None:
    with pytest.raises(InputError, match="flux_corner 150 Hz must be above 0 and at most 100 Hz"):
        loop_of(flux_corner=150.0)
