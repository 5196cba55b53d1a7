"""A servo that its magnets make unstable, held by a PID, as a record."""

import numpy as np

from msl_fem.actuator import Actuator
from msl_fem.plant.instruments import reading_noise
from msl_fem.plant.layout import OK
from msl_fem.plant.sampled_plant import advance_sample, plant_at_rest, read_instruments, sampled_plant
from msl_fem.record import Noise, Record, Run, Sampling
from msl_fem.table.magnetic_table import MagneticTable

RATE, EVERY, DELAY = 1e4, 4, 1
BIAS = 1.0  # A on both sides: the open loop is stable up to 0.91 A
PID = {
    "kind": "pid", "outputs": ["command_1_A", "command_2_A"], "signs": [1, -1], "kp": "1.5 A/mm", "ki": "40 A/mm/s",
    "kd": "4.5 A s/m",
}  # fmt: skip
CONTROLLER = {"rate": "2.5 kHz", "delay_samples": DELAY, "linear": [PID]}


def reference(count: int) -> np.ndarray:
    """A staircase with ramps between its steps, in m."""
    steps = np.repeat(np.random.default_rng(3).uniform(-2e-5, 2e-5, count // 200 + 1), 200)[:count]
    return np.convolve(steps, np.ones(50) / 50)[:count]


def looped_record(
    actuator: Actuator, table: MagneticTable, *, noisy: bool, count: int = 2000, effects=None, roles=("fit",)
) -> Record:
    """Runs of the true actuator under the PID; the noise of the readings is in the loop."""
    runs = []
    for n, role in enumerate(roles):
        columns = looped_run(actuator, table, count, effects, np.random.default_rng(n + 1) if noisy else None)
        runs.append(Run(f"loop_{n + 1}", "steps in closed loop", role, columns))
    noise = Noise(position=actuator.position_sensor.noise, current=actuator.current_sensor.noise)
    return Record(
        "simulated", actuator, sampling=Sampling(rate=RATE), noise=noise, controller=CONTROLLER, runs=tuple(runs)
    )


def looped_run(actuator, table, count, effects, generator) -> dict[str, np.ndarray]:
    plant = sampled_plant(actuator, table, rate=RATE, effects=effects)
    state, history = plant_at_rest(plant, currents=(BIAS, BIAS), position=0.0)
    noise, wanted = reading_noise(actuator, count, generator=generator), reference(count)
    readings, voltage, rows = np.zeros(3), np.zeros(2), []
    total, before, queue = 0.0, 0.0, [0.0] * (DELAY + 1)
    period = EVERY / RATE
    for k in range(count):
        read_instruments(plant, state, history, k, noise[k], readings)
        if k % EVERY == 0:
            error = wanted[k] - readings[0]
            total += error
            made = 1.5e3 * error + 4e4 * period * total + 4.5 * (error - before) / period
            before = error
            queue = [*queue[1:], made]
        command = np.array([BIAS + queue[0], BIAS - queue[0]])
        row = [k / RATE, *command, *readings[1:], readings[0], wanted[k]]
        assert advance_sample(plant, state, command, 0.0, voltage) == OK
        rows.append([*row, *voltage])
    names = "time_s command_1_A command_2_A current_1_A current_2_A position_m reference_m voltage_1_V voltage_2_V"
    return dict(zip(names.split(), np.array(rows).T, strict=True))
