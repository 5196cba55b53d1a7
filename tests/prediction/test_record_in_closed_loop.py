"""The coupled model in closed loop along a record: exact without the reference, and no run that diverges unsaid."""

from dataclasses import replace

import numpy as np
import pytest
from looped_servo import BIAS, CONTROLLER, DELAY, EVERY, looped_record, reference
from shifted_records import shifted

from msl_fem.actuator import Actuator, Controller
from msl_fem.comparison import CompareSettings, compare, nrmse
from msl_fem.errors import InputError
from msl_fem.plant.effects import EffectValues
from msl_fem.prediction import ModelHypothesis, Start, closed_run, kernel_plant, open_loop_stable, run_data
from msl_fem.prediction.hypothesis import KernelPlant
from msl_fem.prediction.run_data import RunData
from msl_fem.record import Record
from msl_fem.table.magnetic_table import MagneticTable

AT_REST = Start((BIAS, BIAS), 0.0, 0.0)


@pytest.fixture(scope="module")
def bench(servo: Actuator) -> Actuator:
    """As rig.toml of the record makes it: its controller at the stated rate; small steps for an exact comparison."""
    return servo.model_copy(update={"controller": Controller(rate=2.5e3, delay_samples=DELAY)})


def data_of(record: Record, run: int = 0) -> RunData:
    return run_data(record, record.runs[run])


def plant_of(
    bench: Actuator, table: MagneticTable, values: EffectValues | None = None, **factors: float
) -> KernelPlant:
    return kernel_plant(ModelHypothesis(bench, table, values), rate=1e4, factors=factors)


@pytest.mark.parametrize("noisy", [False, True])
def test_the_true_model_retraces_the_loop_without_its_reference(
    bench: Actuator, table: MagneticTable, noisy: bool
) -> None:
    """To the integrator's error without noise; with it, what is left is noise and the motion that it made."""
    record = looped_record(bench, table, noisy=noisy)
    data = data_of(record)
    assert not open_loop_stable(ModelHypothesis(bench, table), data)
    assert data.law is not None
    assert (data.law.every, data.law.delay) == (EVERY, EVERY * DELAY)
    run = closed_run(plant_of(bench, table), data, AT_REST)
    assert run.ended is None
    left = data.measured["position_m"] - run.readings["position_m"]
    moved = np.ptp(reference(2000))
    if noisy:
        assert 50e-9 < left.std() < 65e-9
        assert left.std() < 0.02 * data.measured["position_m"].std()
    else:
        assert np.abs(left).max() < 2e-4 * moved
        for channel in ("current_1_A", "voltage_2_V"):
            assert nrmse(data.measured[channel], run.readings[channel]) < 2e-3


def test_readings_errors_are_in_the_loop(bench: Actuator, table: MagneticTable) -> None:
    """With the sensor's true errors known, late and bent readings are retraced as well; unknown, they are not."""
    values = EffectValues({
        "time_delay": {"position": 1.7e-4}, "position_sensor_nonlinearity": {"gain_error": 0.03},
    })  # fmt: skip
    data = data_of(looped_record(bench, table, noisy=False, effects=values))
    known = closed_run(plant_of(bench, table, values), data, AT_REST).readings["position_m"]
    unknown = closed_run(plant_of(bench, table), data, AT_REST).readings["position_m"]
    measured = data.measured["position_m"]
    assert nrmse(measured, known) < 2e-4
    assert nrmse(measured, unknown) > 20 * nrmse(measured, known)


def test_a_gain_of_the_reading_is_in_the_loop(bench: Actuator, table: MagneticTable) -> None:
    values = EffectValues({"position_sensor_nonlinearity": {"gain_error": 0.03}})
    data = data_of(looped_record(bench, table, noisy=False, effects=values))
    run = closed_run(plant_of(bench, table, position_gain=1.03), data, AT_REST)
    assert nrmse(data.measured["position_m"], run.readings["position_m"]) < 2e-4


def test_a_wrong_mass_shows(bench: Actuator, table: MagneticTable) -> None:
    data = data_of(looped_record(bench, table, noisy=False))
    errors = [
        nrmse(data.measured["position_m"], closed_run(plant, data, AT_REST).readings["position_m"])
        for plant in (plant_of(bench, table), plant_of(bench, table, moving_mass=1.02))
    ]
    assert errors[1] > 50 * errors[0]


def test_a_loop_that_does_not_hold_the_model_says_where_it_ended(bench: Actuator, table: MagneticTable) -> None:
    """The magnets of the model pull five times as much: the gains that held the plant do not hold it."""
    data = data_of(looped_record(bench, table, noisy=False))
    run = closed_run(plant_of(bench, table, magnetic_scale=5.0), data, AT_REST)
    assert run.ended is not None
    assert 0 < run.ended < 2000
    assert "at sample" in run.reason
    assert np.isnan(run.readings["position_m"][run.ended :]).all()


def test_a_law_without_states_and_one_for_another_drive(bench: Actuator, table: MagneticTable) -> None:
    record = looped_record(bench, table, noisy=False)
    only_d = {
        "kind": "state-space", "outputs": ["command_1_A", "command_2_A"], "d": [[0.0], [0.0]],
    }  # fmt: skip
    open_loop = replace(record, controller={**CONTROLLER, "linear": [only_d]})
    run = closed_run(plant_of(bench, table, moving_mass=1.02), data_of(open_loop), AT_REST)
    assert run.ended is not None, "a law that does nothing holds nothing"
    voltage = replace(record, controller={"linear": [{**only_d, "outputs": ["voltage_1_V"], "d": [[0.0]]}]})
    with pytest.raises(InputError, match="makes voltage_1_V, the drive of fast_tool_servo takes command_1_A"):
        data_of(voltage)
    odd = replace(record, actuator=bench.model_copy(update={"controller": Controller(rate=3e3)}))
    with pytest.raises(InputError, match="whole multiple"):
        data_of(odd)


def test_compare_judges_an_unstable_plant_in_closed_loop(bench: Actuator, table: MagneticTable) -> None:
    """Believed 2 % heavier: the re-fit wins in closed loop, no free run is given, ARMAX says why it is not there."""
    record = looped_record(bench, table, noisy=True, roles=("fit", "held-out"))
    believed = shifted(bench, {"moving_mass": 1.02})
    found = compare(replace(record, actuator=believed), CompareSettings(table=table))
    held = {j.model: j for j in found.accuracies if j.role == "held-out" and j.channel == "position_m"}
    closed = {name: j.nrmse["closed_loop"] for name, j in held.items()}
    assert all(held[name].nrmse["free_run"] is None for name in ("coupled", "coupled, re-fitted"))
    floor = next(f["nrmse"] for f in found.noise_floor() if f["role"] == "held-out" and f["channel"] == "position_m")
    assert floor < closed["coupled, re-fitted"] < 1.4 * floor
    assert closed["coupled"] > 1.5 * closed["coupled, re-fitted"]
    assert held["armax"].nrmse["closed_loop"] is None
    assert "closed_loop: armax takes currents" in held["armax"].reason
    assert "in closed loop" in found.verdict
    assert all("nrmse_closed_loop" in row for row in found.to_json()["models"])
