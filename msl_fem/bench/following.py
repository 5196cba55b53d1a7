"""Runs of a rig in closed loop: a controller that is handed in reads the position with all its errors, and commands."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from msl_fem.bench.circuit import N_SIDE
from msl_fem.bench.integrate import N_OUT, OK, OUT_READING, look, sample, scratch_of
from msl_fem.bench.plant import CURRENT_DRIVE, Array, Bench, Plant, arranged, as_record
from msl_fem.bench.preisach import virgin_memory
from msl_fem.bench.readings import drift_path, play_step
from msl_fem.bench.rig import Rig, surface_of
from msl_fem.bench.running import Response, complaint, random_path, response_of, rest
from msl_fem.bench.step_size import default_substeps
from msl_fem.errors import ComputationError, InputError


class LoopController(Protocol):
    """What closes a loop: asked at its own rate, its command acts `delay_samples` of its periods later."""

    @property
    def rate(self) -> float: ...
    @property
    def delay_samples(self) -> int: ...
    def start(self) -> None: ...
    def command(self, reference: Array, measured: float) -> Array: ...


@dataclass(frozen=True, eq=False)
class Following:
    """A closed-loop run that is asked for.

    Attributes
    ----------
    reference : (n_sample, 3) position, velocity, acceleration wanted
    controller : knows the belief, and what it reads
    noise : (n_sample,) m, of the position's reading in the loop; None: none
    resolution : m, of the reading; 0: none
    """

    reference: Array
    controller: LoopController
    noise: Array | None = None
    resolution: float = 0.0


def follow(rig: Rig, asked: Following, *, rate: float, seed: int = 0) -> Response:
    """The run from rest without currents; commands are those that act from their sample on.

    `Response.measured` is the position as the controller read it.

    Raises
    ------
    InputError : no current drive, a rate that is no whole multiple of the controller's
    ComputationError : the loop does not hold the rig
    """
    plant, controller = arranged(rig.plant), asked.controller
    if plant.circuit.drive != CURRENT_DRIVE:
        raise InputError(f'{rig.name}: the controller commands currents; use drive.kind = "current"')
    every = round(rate / controller.rate)
    if every < 1 or abs(every * controller.rate / rate - 1) > 1e-9:
        raise InputError(f"{rig.name}: {rate:g} samples a second are no whole multiple of {controller.rate:g} Hz")
    n, sides = len(asked.reference), plant.magnets.sides
    late = every * controller.delay_samples
    wanted, commands = np.zeros((n + late, 2)), np.zeros((n, 2))
    bench = _bench(rig, plant)
    y = rest(plant)
    scratch = scratch_of(bench, y)
    pushes, out = random_path(rig, n, rate=rate, seed=seed), np.zeros((n, N_OUT))
    clock = (0.0, 1.0 / rate, rig.delay, default_substeps(plant, rig.table, rate=rate))
    noise = np.zeros(n) if asked.noise is None else asked.noise
    drift, measured, played = drift_path(rig, n, rate=rate, run=seed), np.zeros(n), np.nan
    controller.start()
    for k in range(n):
        status = look(bench, y, scratch[0], out[k])
        if status == OK:
            played = play_step(played, out[k, OUT_READING], rig.instruments.play)
            measured[k] = played + drift[k] + noise[k]
            if asked.resolution > 0:
                measured[k] = np.round(measured[k] / asked.resolution) * asked.resolution
            if k % every == 0:
                wanted[k + late :, :sides] = controller.command(asked.reference[k], float(measured[k]))
            commands[k] = wanted[k]
            status = sample(bench, y, scratch, k, commands, pushes, clock, out[k])
        if status != OK:
            said = complaint(rig, plant, status, time=k / rate, y=y, way_out="the loop does not hold it")
            raise ComputationError(said)
    return response_of(out, commands[:, :sides], rate=rate, sides=sides, end_state=y, measured=measured)


def _bench(rig: Rig, plant: Plant) -> Bench:
    memory = np.array([virgin_memory(), virgin_memory()])
    return Bench(as_record(plant), surface_of(rig.table), memory, np.zeros((2, N_SIDE)), np.zeros((2, 2)))
