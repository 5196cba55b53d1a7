"""Runs of the coupled model in closed loop, by whatever controller is handed in."""

from typing import Protocol

import numpy as np

from msl_fem.actuator import Actuator
from msl_fem.errors import ComputationError, InputError
from msl_fem.files.quantity import format_quantity
from msl_fem.plant.effects import EffectValues
from msl_fem.plant.energy import energy_audit
from msl_fem.plant.excitation import Reference
from msl_fem.plant.layout import (
    AT_CURRENT_LIMIT_1,
    COIL_1,
    I1,
    I2,
    OK,
    V,
    X,
)
from msl_fem.plant.plant import FORCE_DRIVE, PlantParameters
from msl_fem.plant.plant_in_loop import (
    N_READING,
    Array,
    act,
    plant_at_rest,
    plant_in_loop,
    read,
    reading_noise,
)
from msl_fem.plant.simulate import STATUS, Simulation
from msl_fem.table.magnetic_table import MagneticTable

# What is kept of a sample: commands, readings, voltages, true currents, position, velocity
_COMMAND, _READ, _VOLTAGE, _CURRENT = slice(0, 2), slice(2, 5), slice(5, 7), slice(7, 9)
_POSITION, _VELOCITY, _N_KEPT = 9, 10, 11


class LoopController(Protocol):
    """What closes a loop: it is asked at its own rate, and its command acts `delay_samples` of its periods later."""

    @property
    def rate(self) -> float:
        """Commands a second, Hz."""
        ...

    @property
    def delay_samples(self) -> int: ...

    def start(self) -> None:
        """Forgets all runs before."""
        ...

    def command(self, reference: Array, measured: float) -> Array:
        """(n_side,) A for position, velocity, acceleration wanted now (3,) and the measured position in m."""
        ...


def clock_of(controller: LoopController, *, rate: float) -> tuple[int, int]:
    """Samples of a run between two commands of its controller, and from a command's computation until it acts.

    Raises
    ------
    InputError : the rate is no whole multiple of the controller's
    """
    every = round(rate / controller.rate)
    if every < 1 or abs(every * controller.rate / rate - 1) > 1e-9:
        raise InputError(
            f"a run at {format_quantity(rate, 'Hz')} cannot be controlled at {format_quantity(controller.rate, 'Hz')}: "
            "its rate must be a whole multiple of the controller's"
        )
    return every, every * controller.delay_samples


def simulate_closed(
    actuator: Actuator, table: MagneticTable | None, wanted: Reference, controller: LoopController,
    *, effects: EffectValues | None = None, generator: np.random.Generator | None = None,
) -> Simulation:  # fmt: skip
    """The run of an actuator whose controller follows a reference, sampled as the reference is, from rest.

    Commands are those that act from their sample on; flux linkages are left out, (n_sample, 0). Noise of the sensors is
    drawn from `generator`, without one there is none. The plant may have `effects` of which the controller knows
    nothing.

    Raises
    ------
    InputError : no current drive, no table; rates that do not fit; the plant cannot have one of the effects
    ComputationError : the loop does not hold the plant; names time, state and the way out
    """
    rate = 1.0 / (wanted.time[1] - wanted.time[0])
    every, delay = clock_of(controller, rate=rate)
    plant = plant_in_loop(actuator, table, rate=rate, effects=effects)
    if plant.parameters.drive == FORCE_DRIVE or actuator.drive is None or actuator.drive.kind != "current":
        raise InputError(f'{actuator.name}: the controller commands currents; use drive.kind = "current"')
    state, history = plant_at_rest(plant)
    start = state.copy()
    n, sides = wanted.position.size, plant.parameters.sides
    followed = np.column_stack([wanted.position, wanted.velocity, wanted.acceleration])
    noise, kept = reading_noise(actuator, n, generator=generator), np.zeros((n, _N_KEPT))
    readings, voltage, waiting = np.zeros(N_READING), np.zeros(2), np.zeros((delay + 1, 2))
    controller.start()
    for k in range(n):
        read(plant, state, history, k, noise[k], readings)
        waiting[:-1] = waiting[1:]
        if k % every == 0:
            waiting[delay, :sides] = controller.command(followed[k], readings[0])
        row = kept[k]
        row[_COMMAND], row[_READ] = waiting[0], readings
        row[_CURRENT], row[_POSITION], row[_VELOCITY] = state[COIL_1 : COIL_1 + 2], state[X], state[V]
        status = act(plant, state, waiting[0], 0.0, voltage)
        if status != OK:
            raise ComputationError(_complaint(actuator, status, k / rate, state))
        row[_VOLTAGE] = voltage
    limits = state[AT_CURRENT_LIMIT_1 : AT_CURRENT_LIMIT_1 + 4].astype(np.int64)
    return Simulation(
        rate=rate,
        time=np.asarray(wanted.time),
        disturbance=np.zeros(n),
        force=np.zeros(n),
        flux_linkage=np.zeros((n, 0)),
        measured_position=kept[:, _READ][:, 0],
        status=STATUS[OK],
        samples_at_current_limit=limits[:sides],
        samples_at_voltage_limit=limits[2 : 2 + sides],
        substeps=plant.n_step,
        audit=energy_audit(plant.surface, plant.parameters, plant.effects, start=start, end=state),
        end_state=state,
        **_of_sides(kept, plant.parameters),
    )


def _of_sides(kept: Array, plant: PlantParameters) -> dict[str, Array]:
    sides = plant.sides
    return {
        "command": kept[:, _COMMAND][:, :sides],
        "voltage": kept[:, _VOLTAGE][:, :sides],
        "current": kept[:, _CURRENT][:, :sides],
        "measured_current": kept[:, _READ][:, 1 : 1 + sides],
        "position": kept[:, _POSITION],
        "velocity": kept[:, _VELOCITY],
    }


def _complaint(actuator: Actuator, status: int, time: float, state: Array) -> str:
    return (
        f"{actuator.name}: {STATUS[status]} after t = {time:.6g} s, at i = {state[I1]:.4g}, {state[I2]:.4g} A, x = "
        f"{format_quantity(state[X], 'm')}: the loop does not hold it; lower the reference"
    )
