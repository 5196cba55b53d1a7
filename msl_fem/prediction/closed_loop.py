"""The coupled model in closed loop along a record's run, by the law that drove it.

A linear law answers to readings and reference apart, u = R r - L y. With the recorded u and y the simulated loop is

    u_sim = u + L y - L y_sim = u - L (y_sim - y),

whatever the reference and the constants were: they need not be known, and noise of the readings cancels, since the
recorded command already answers to it. Of a law that is not linear, the difference of its answers takes that place; it
needs the reference then. Limits of the drive act on u_sim as the kernel has them.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from msl_fem.computing.compiled import compiled
from msl_fem.plant.plant_in_loop import Array, PlantInLoop, act, instruments_of, plant_at_rest, read
from msl_fem.plant.simulate import STATUS
from msl_fem.plant.state import OK
from msl_fem.prediction.believed import KernelPlant
from msl_fem.prediction.free_run import FreeRun, Start, kernel_state
from msl_fem.prediction.run_data import POSITION_COLUMN, LoopLaw, RunData

_READINGS, _VOLTAGES, _N_OUT = slice(0, 3), slice(3, 5), 5


@dataclass(frozen=True, eq=False)
class CallableLaw:
    """A law that is asked sample by sample.

    Attributes
    ----------
    answer : of the sample's number and the simulated position reading, what it adds to the recorded commands, (2,)
    every : samples of the run between two questions
    delay : samples of the run until an answer acts
    """

    answer: Callable[[int, float], Array]
    every: int
    delay: int


def closed_run(plant: KernelPlant, data: RunData, start: Start, asked: CallableLaw | None = None) -> FreeRun:
    """The run of the simulated loop, to its end or to where the plant leaves table or range.

    By `asked`, or by the linear law of the data, which must be there then.
    """
    looped = _in_loop(plant)
    _, history = plant_at_rest(looped, position=start.position)
    n, state = len(data.commands), kernel_state(plant, start)
    out = np.full((n, _N_OUT), np.nan)
    if asked is not None:
        status, done = _run_asking(looped, asked, state, history, data.commands, out)
    else:
        assert data.law is not None
        assert data.read is not None
        status, done = _run(looped, data.law, state, history, data.commands, data.read, out)
    out[done:] = np.nan
    found = {POSITION_COLUMN: out[:, 0]}
    for j in range(plant.parameters.sides):
        found[f"current_{j + 1}_A"] = out[:, 1 + j]
        found[f"voltage_{j + 1}_V"] = out[:, _VOLTAGES][:, j]
    readings = {name: found[name] for name in data.measured}
    if status == OK:
        return FreeRun(readings)
    return FreeRun(readings, int(done), f"{STATUS[int(status)]} at sample {int(done)}")


def _in_loop(plant: KernelPlant) -> PlantInLoop:
    it = instruments_of(plant.readings, rate=plant.rate)
    polynomial, hum = it.polynomial.copy(), it.hum.copy()
    polynomial[0] *= plant.gain
    hum[0] *= plant.gain
    it = it._replace(polynomial=polynomial, hum=hum, drift=plant.gain * it.drift)
    return PlantInLoop(plant.surface, plant.parameters, plant.effects, it, plant.step, plant.substeps)


@compiled
def _run(
    plant: PlantInLoop, law: LoopLaw, state: Array, history: Array, commands: Array, recorded: Array, out: Array
) -> tuple[int, int]:
    """(status, samples done); recorded (n, 3) readings beside commands (n, 2), a row of `out` a sample."""
    n_state, n_out = law.a.shape[0], law.makes.size
    memory, following, waiting = np.zeros(n_state), np.zeros(n_state), np.zeros((law.delay + 1, n_out))
    silence, voltage, command, deviation = np.zeros(3), np.zeros(2), np.zeros(2), np.zeros(law.reads.size)
    for k in range(commands.shape[0]):
        row = out[k]
        read(plant, state, history, k, silence, row[_READINGS])
        for m in range(law.delay):
            waiting[m] = waiting[m + 1]
        if k % law.every == 0:
            for m in range(law.reads.size):
                deviation[m] = row[law.reads[m]] - recorded[k, law.reads[m]]
            waiting[law.delay] = law.c @ memory + law.d @ deviation
            following[:] = law.a @ memory + law.b @ deviation
            memory[:] = following
        command[:] = commands[k]
        for m in range(n_out):
            command[law.makes[m]] += waiting[0, m]
        status = act(plant, state, command, 0.0, voltage)
        row[_VOLTAGES] = voltage
        if status != OK:
            return status, k
    return OK, commands.shape[0]


def _run_asking(
    plant: PlantInLoop, asked: CallableLaw, state: Array, history: Array, commands: Array, out: Array
) -> tuple[int, int]:
    """(status, samples done) as `_run`, by a law that is no compiled one."""
    waiting, silence, voltage = np.zeros((asked.delay + 1, 2)), np.zeros(3), np.zeros(2)
    for k in range(commands.shape[0]):
        read(plant, state, history, k, silence, out[k, _READINGS])
        waiting[:-1] = waiting[1:]
        if k % asked.every == 0:
            waiting[asked.delay] = asked.answer(k, float(out[k, 0]))
        status = act(plant, state, commands[k] + waiting[0], 0.0, voltage)
        out[k, _VOLTAGES] = voltage
        if status != OK:
            return status, k
    return OK, commands.shape[0]
