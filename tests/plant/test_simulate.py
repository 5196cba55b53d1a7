"""Open-loop runs from Python: what comes out, and what is refused."""

import numpy as np
import pytest
from coupled_twin import changed

from msl_fem.actuator import Actuator
from msl_fem.errors import ActuatorError, ComputationError, InputError, OutOfTable
from msl_fem.plant.excitation import Inputs, excitation_inputs, parse_excitation
from msl_fem.plant.plant import plant_parameters
from msl_fem.plant.simulate import Options, simulate
from msl_fem.table.magnetic_table import MagneticTable


def test_a_noise_run_comes_out_whole(servo: Actuator, table: MagneticTable) -> None:
    spec = "band-limited-noise:channel=independent,band=500 Hz,bias=0.4 A,amplitude=0.08 A,duration=0.5 s,seed=1"
    inputs = excitation_inputs(servo, parse_excitation(spec), rate=1e4)
    run = simulate(servo, table, inputs, generator=np.random.default_rng(0))
    assert run.complete
    assert run.status == "completed"
    assert run.time.shape == (5000,)
    assert run.current.shape == run.voltage.shape == run.flux_linkage.shape == (5000, 2)
    assert (run.command == inputs.commands).all()
    assert 1e-6 < run.position.std() < 2e-4
    assert run.samples_at_current_limit.tolist() == [0, 0]


def test_sensor_noise_has_its_size_and_its_seed(servo: Actuator, table: MagneticTable) -> None:
    ideal = changed(servo, position_sensor={"bandwidth": None})
    inputs = Inputs(np.full((5000, 2), 0.4), 1e4)
    runs = [simulate(ideal, table, inputs, generator=np.random.default_rng(s)) for s in (1, 1, 2)]
    assert (runs[0].measured_position == runs[1].measured_position).all()
    assert (runs[0].measured_position != runs[2].measured_position).any()
    noise = runs[0].measured_position - runs[0].position
    assert noise.std() == pytest.approx(50e-9, rel=0.05)  # 5 standard errors of 5000 samples
    assert (runs[0].measured_current - runs[0].current).std(axis=0) == pytest.approx([2e-3, 2e-3], rel=0.05)
    assert np.corrcoef((runs[0].measured_current - runs[0].current).T)[0, 1] == pytest.approx(0.0, abs=0.07)
    assert (runs[0].position == runs[2].position).all()
    silent = simulate(ideal, table, inputs)
    assert (silent.measured_position == silent.position).all()
    assert (silent.measured_current == silent.current).all()


def test_a_sensor_reads_in_steps_of_its_resolution(servo: Actuator, table: MagneticTable) -> None:
    coarse = changed(servo, position_sensor={"bandwidth": None, "resolution": 2e-7})
    run = simulate(coarse, table, Inputs(np.tile([0.5, 0.4], (200, 1)), 1e4))
    steps = run.measured_position / 2e-7
    assert steps == pytest.approx(np.round(steps), abs=1e-6)
    assert np.abs(run.measured_position - run.position).max() <= 1.0000001e-7
    assert len(set(np.round(steps))) > 5


def test_a_run_that_leaves_its_range_says_so(servo: Actuator, table: MagneticTable) -> None:
    inputs = Inputs(np.tile([3.0, 0.5], (1000, 1)), 1e4)
    with pytest.raises(
        ComputationError, match=r"left its range after t = 0\.0\d+ s, at i = .*, x = 4\d\d.*0\.908 A RMS"
    ):
        simulate(servo, table, inputs)
    reached = simulate(servo, table, inputs, options=Options(partial=True))
    assert not reached.complete
    assert reached.status == "the mover left its range"
    n = reached.time.size
    assert 10 < n < 200
    assert reached.position.shape == reached.command.shape[:1] == reached.disturbance.shape == (n,)
    assert 3e-4 < reached.position[-1] <= reached.end_state[2] <= 5e-4


def test_a_run_that_leaves_the_table_names_the_rectangle(servo: Actuator, table: MagneticTable) -> None:
    wide = changed(servo, motion={"range": None})
    with pytest.raises(ComputationError, match=r"left the table \(gap 0\.05 \.\.\. 1\.2 mm, current up to 12 A"):
        simulate(wide, table, Inputs(np.tile([3.0, 0.5], (1000, 1)), 1e4))


def test_limits_of_the_drive_are_counted(servo: Actuator, table: MagneticTable) -> None:
    command = np.full((50, 2), 0.5)
    command[20:23, 0] = 12.5
    run = simulate(changed(servo, motion={"moving_mass": 1e9}), table, Inputs(command, 1e4))
    assert run.samples_at_current_limit.tolist() == [3, 0]
    assert run.samples_at_voltage_limit[0] >= 3  # 3 samples up, and down again
    assert np.abs(run.voltage).max() <= 80 * (1 + 1e-12)
    assert (run.command == command).all()


def test_a_run_goes_on_from_where_another_ended(servo: Actuator, table: MagneticTable) -> None:
    ideal = changed(servo, position_sensor={"bandwidth": None})
    command = 0.4 + 0.1 * np.random.default_rng(5).standard_normal((200, 2))
    whole = simulate(ideal, table, Inputs(command, 1e4))
    first = simulate(ideal, table, Inputs(command[:120], 1e4))
    i1, i2, x, v = first.end_state[:4]
    rest = simulate(ideal, table, Inputs(command[120:], 1e4), options=Options((i1, i2), x, v))
    assert (rest.position == whole.position[120:]).all()
    assert (rest.voltage == whole.voltage[120:]).all()


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        (Options(position=6e-4), "600 µm lies outside the range of 500 µm"),
        (Options(currents=(13.0, 0.0)), "13 A lies outside the table"),
        (Options(velocity=np.nan), "is not finite"),
        (Options(substeps=0), "substeps 0 must be 1 or more"),
    ],
)
def test_a_start_that_cannot_be_is_refused(
    servo: Actuator, table: MagneticTable, options: Options, complaint: str
) -> None:
    with pytest.raises(InputError, match=complaint):
        simulate(servo, table, Inputs(np.zeros((10, 2)), 1e4), options=options)


def test_inputs_that_do_not_fit_are_refused(servo: Actuator, table: MagneticTable) -> None:
    with pytest.raises(InputError, match="1 columns, the actuator's drive has 2"):
        simulate(servo, table, Inputs(np.zeros(10), 1e4))
    with pytest.raises(InputError, match="not finite at sample 3"):
        Inputs(np.r_[0, 0, 0, np.nan], 1e4)
    with pytest.raises(InputError, match="rate 0 Hz"):
        Inputs(np.zeros(4), 0.0)
    with pytest.raises(InputError, match=r"disturbance has the shape \(3,\)"):
        Inputs(np.zeros(4), 1e3, np.zeros(3))
    with pytest.raises(InputError, match=r"shape \(4, 3\)"):
        Inputs(np.zeros((4, 3)), 1e3)
    with pytest.raises(InputError, match="there is no table"):
        simulate(servo, None, Inputs(np.zeros((10, 2)), 1e4))
    with pytest.raises(InputError, match=r"in V, the drive of fast_tool_servo is of the kind 'current'"):
        excitation_inputs(servo, parse_excitation("sine:frequency=2 Hz,amplitude=1 V,duration=1 s", unit="V"), rate=1e4)


def test_a_start_outside_the_table_is_refused(servo: Actuator, table: MagneticTable) -> None:
    far = changed(servo, motion={"nominal_gap": 2e-3})
    with pytest.raises(OutOfTable, match="2 mm lies outside"):
        simulate(far, table, Inputs(np.zeros((10, 2)), 1e4))


@pytest.mark.parametrize("section", ["motion", "drive", "sides"])
def test_a_missing_section_is_named(servo: Actuator, section: str) -> None:
    with pytest.raises(ActuatorError, match=rf"section \[{section}\] is missing"):
        plant_parameters(servo.model_copy(update={section: None}))
