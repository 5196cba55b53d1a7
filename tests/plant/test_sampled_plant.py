"""The plant sample by sample reads what the open-loop run reads."""

import numpy as np
import pytest
from coupled_twin import changed
from effect_sets import ALL_EFFECTS, effects, rig, rough

from msl_fem.actuator import Actuator
from msl_fem.computing.arrays import Array
from msl_fem.errors import InputError
from msl_fem.plant.effects import EffectValues
from msl_fem.plant.excitation import Inputs
from msl_fem.plant.instruments import reading_noise
from msl_fem.plant.layout import OK, OUTSIDE_TABLE
from msl_fem.plant.sampled_plant import SampledPlant, advance_sample, plant_at_rest, read_instruments, sampled_plant
from msl_fem.plant.simulate import simulate
from msl_fem.table.magnetic_table import MagneticTable

LATE = {"command": 1.37e-4, "position": 7.3e-4, "current": 1.1e-5}


def fed(
    plant: SampledPlant, state: Array, history: Array, commands: Array, disturbance: Array, noise: Array, out: Array
) -> int:
    """A loop that is none: the commands are those of a list; rows of readings and voltages."""
    status, voltage = OK, np.zeros(2)
    for k in range(commands.shape[0]):
        read_instruments(plant, state, history, k, noise[k], out[k, :3])
        if status == OK:
            status = advance_sample(plant, state, commands[k], disturbance[k], voltage)
        out[k, 3:] = voltage
    return status


def sample_by_sample(plant: SampledPlant, inputs: Inputs, noise: Array) -> tuple[int, Array]:
    state, history = plant_at_rest(plant)
    n = inputs.commands.shape[0]
    commands, out = np.zeros((n, 2)), np.zeros((n, 5))
    commands[:, : inputs.commands.shape[1]] = inputs.commands
    return fed(plant, state, history, commands, np.asarray(inputs.disturbance), noise, out), out


@pytest.mark.parametrize(
    "values",
    [
        None,
        EffectValues({}),
        ALL_EFFECTS,
        effects("time_delay", **LATE),
        effects("structural_mode", mass_share=0.05, load_reading=1.0),
    ],
    ids=["plain", "neutral", "all", "late", "load"],
)
def test_readings_are_those_of_the_open_loop_run(
    servo: Actuator, table: MagneticTable, values: EffectValues | None
) -> None:
    bench = changed(servo, position_sensor={"resolution": 1e-10})
    inputs = rough(400)
    run = simulate(bench, table, inputs, effects=values, generator=np.random.default_rng(5))
    noise = reading_noise(bench, 400, generator=np.random.default_rng(5))
    status, out = sample_by_sample(sampled_plant(bench, table, rate=inputs.rate, effects=values), inputs, noise)
    assert status == OK
    assert out[:, 0] == pytest.approx(run.measured_position, rel=1e-12, abs=1.1e-10)  # a step of the resolution
    assert np.abs(out[:, 0] - run.measured_position).mean() < 1e-14, "hardly a sample is rounded the other way"
    assert out[:, 1:3] == pytest.approx(run.measured_current, rel=1e-12, abs=1e-13)
    assert out[:, 3:] == pytest.approx(run.voltage, rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("bandwidth", [None, 300.0])
def test_a_rig_that_a_force_drives_reads_its_position(bandwidth: float | None) -> None:
    bench = changed(rig(), position_sensor={"bandwidth": bandwidth, "noise": 1e-9})
    inputs = rough(300, sides=1)
    late = effects("time_delay", position=3.4e-4)
    run = simulate(bench, None, inputs, effects=late, generator=np.random.default_rng(2))
    noise = reading_noise(bench, 300, generator=np.random.default_rng(2))
    _, out = sample_by_sample(sampled_plant(bench, None, rate=inputs.rate, effects=late), inputs, noise)
    assert out[:, 0] == pytest.approx(run.measured_position, rel=1e-12, abs=1e-20)
    assert (out[:, 1:3] == 0).all()
    assert out[:, 3] == pytest.approx(run.force, rel=1e-12)


def test_a_plant_that_leaves_its_table_says_so(servo: Actuator, table: MagneticTable) -> None:
    strong = changed(servo, drive={"current_limit": None, "voltage_limit": None}, motion={"range": None})
    plant = sampled_plant(strong, table, rate=1e4)
    status, _ = sample_by_sample(plant, Inputs(np.full((400, 2), 11.9) * [1, 0], 1e4), np.zeros((400, 3)))
    assert status == OUTSIDE_TABLE


def test_what_the_plant_cannot_have_is_refused(servo: Actuator) -> None:
    with pytest.raises(InputError, match="there is no table"):
        sampled_plant(servo, None, rate=1e4)
    with pytest.raises(InputError, match="needs magnets"):
        sampled_plant(rig(), None, rate=1e4, effects=effects("eddy_currents", time_constant=1e-4))
