"""The levitation rig's laws of control: they answer to the recorded readings as the recorded voltages did."""

import numpy as np
import pytest
from conftest import ROOT

from msl_fem.prediction import ModelHypothesis, closed_run, kernel_plant, measured_start, open_loop_stable, run_data
from msl_fem.record import Record, load_record
from msl_fem.table.magnetic_table import read_table

RIG = ROOT / "measurements" / "levitation_rig"
REFERENCE = {"steps": 2e-3, "up_and_down": 4e-3, "stairs": 4e-3}
"""m, of position_m, steady for a second at least; of the second run 10 mm below the coil, where its law is stated."""
LEFT = {"steps": 0.08, "up_and_down": 0.01, "stairs": 0.02}
"""Of the voltages: the volts of a duty follow a table of 11 points, of which the law has one slope; the first run
swings by several volts, the others do not."""
LEAD = 500  # samples after a change of the reference, in which the law forgets its start


def steady(record: Record, name: str) -> slice:
    """The longest stretch of a run at its reference."""
    there = np.isclose(record.run(name)["reference_m"], REFERENCE[name])
    edges = np.flatnonzero(np.diff(np.concatenate([[0], there.astype(int), [0]])))
    first, last = max(zip(edges[::2], edges[1::2], strict=True), key=lambda pair: pair[1] - pair[0])
    return slice(first, last)


@pytest.fixture(scope="module")
def record() -> Record:
    return load_record(RIG)


@pytest.mark.parametrize("name", list(REFERENCE))
def test_the_laws_make_the_recorded_voltages(record: Record, name: str) -> None:
    """Up to what the reference and the constants add: a constant, and of an integral a straight line."""
    run, law = record.run(name), record.law_of(name)
    assert law is not None
    a, b, c, d = law.matrices(1e-3)
    at = steady(record, name)
    readings = np.column_stack([run[column][at] for column in law.inputs])
    readings = readings - readings.mean(axis=0)
    state, made = np.zeros(len(a)), []
    for y in readings:
        made.append(float((c @ state + d @ y)[0]))
        state = a @ state + b @ y
    left, volts = (run["voltage_1_V"][at] - np.array(made))[LEAD:], run["voltage_1_V"][at][LEAD:]
    ramp = np.arange(left.size)
    slow = np.column_stack([np.ones(left.size), ramp])
    left = left - slow @ np.linalg.lstsq(slow, left, rcond=None)[0]
    assert volts.std() > 0.05
    assert left.std() < LEFT[name] * volts.std()


def test_the_rig_is_simulated_in_closed_loop(record: Record) -> None:
    """The open loop is unstable; in closed loop every run is simulated to its end, within its range."""
    table = read_table(RIG / "table.nc")
    belief = ModelHypothesis(record.actuator, table, None, {"nominal_gap": 0.886, "magnetic_scale": 1.026})
    for stated in record.runs:
        data = run_data(record, stated)
        assert not open_loop_stable(belief, data)
        plant = kernel_plant(belief, rate=data.rate)
        run = closed_run(plant, data, measured_start(plant, data))
        assert run.ended is None
        assert np.abs(run.readings["position_m"] - data.measured["position_m"]).max() < 3e-3
