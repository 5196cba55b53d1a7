"""The plant sample by sample, for loops that run compiled with it, and its runs under any controller.

A loop reads, decides and acts:

    state, history = plant_at_rest(plant)
    for k in range(n):
        read_instruments(plant, state, history, k, noise[k], readings)  # (position m, currents of the sides A)
        ...                                                             # readings -> command
        status = advance_sample(plant, state, command, disturbance[k], voltage)

Fed the commands of an open-loop run, the readings are those of `simulate`.
"""

from typing import NamedTuple, Protocol

import numpy as np

from msl_fem.actuator import Actuator
from msl_fem.computing.arrays import Array
from msl_fem.computing.compiled import compiled
from msl_fem.computing.whole_multiples import whole_multiple
from msl_fem.errors import ComputationError, InputError
from msl_fem.files.quantity import format_quantity
from msl_fem.plant.effects import EffectValues, neutral_vector
from msl_fem.plant.effects.mechanical import MODE_READING
from msl_fem.plant.effects.sensing import SENSOR_BANDWIDTH
from msl_fem.plant.energy import energy_audit
from msl_fem.plant.excitation import Reference
from msl_fem.plant.instruments import (
    AFTER,
    BEFORE,
    N_HISTORY,
    N_READING,
    Instruments,
    instruments_of,
    read_sample,
    reading_noise,
)
from msl_fem.plant.kernel import advance
from msl_fem.plant.layout import (
    ADDED_READING,
    AT_CURRENT_LIMIT_1,
    COIL_1,
    COIL_READING,
    COIL_READING_SLOPE,
    COIL_SLOPE_1,
    COIL_START_1,
    I1,
    I2,
    MODE,
    MODE_RATE,
    OK,
    SENSOR,
    V,
    X,
    initial_state,
)
from msl_fem.plant.plant import PlantParameters, Surface, plant_parameters, surface_of
from msl_fem.plant.preparation import effect_coefficients, start_effects
from msl_fem.plant.simulate import STATUS, Simulation
from msl_fem.plant.step_count import STEP_OF_FASTEST, default_substeps
from msl_fem.table.magnetic_table import MagneticTable

# What is kept of a sample: commands, readings, voltages, true currents, position, velocity
_COMMAND, _READ, _VOLTAGE, _CURRENT = slice(0, 2), slice(2, 5), slice(5, 7), slice(7, 9)
_POSITION, _VELOCITY, _N_KEPT = 9, 10, 11


class SampledPlant(NamedTuple):
    """All that `read_instruments` and `advance_sample` take of a plant."""

    surface: Surface
    parameters: PlantParameters
    effects: Array | None  # (N_COEFFICIENT,) of the kernel
    instruments: Instruments
    step: float  # s
    n_step: int  # a sample


def sampled_plant(
    actuator: Actuator, table: MagneticTable | None, *, rate: float, effects: EffectValues | None = None,
    largest_step: float = STEP_OF_FASTEST,
) -> SampledPlant:  # fmt: skip
    """The plant of an actuator, with or without effects, that is sampled at `rate` (Hz).

    `largest_step` is the largest Runge-Kutta step times the fastest rate; the default is that of `simulate`.

    Raises
    ------
    InputError : a section of the actuator is missing, magnets without a table, the plant cannot have one of the effects
    """
    parameters = plant_parameters(actuator)
    if parameters.sides and table is None:
        raise InputError(f"{actuator.name} has magnets and there is no table; make one with 'msl-fem table'")
    surface = surface_of(table if parameters.sides else None)
    n_step = default_substeps(parameters, table, rate=rate, effects=effects, largest_step=largest_step)
    step = 1.0 / (rate * n_step)
    coefficients = None
    if effects is not None:
        coefficients = effect_coefficients(parameters, surface, effects, step=step, n_step=n_step)
    vector = neutral_vector() if effects is None else effects.vector()
    instruments = instruments_of(vector, rate=rate, resolution=actuator.position_sensor.resolution)
    return SampledPlant(surface, parameters, coefficients, instruments, step, n_step)


def plant_at_rest(
    plant: SampledPlant, *, currents: tuple[float, float] = (0.0, 0.0), position: float | None = None
) -> tuple[Array, Array]:
    """(state, history) of a plant that does not move, memories of its effects fresh.

    `position` is in m; without one it is where the suspension holds the mover without currents (0 where there is none).
    """
    p = plant.parameters
    if position is None:
        position = p.constant_force / p.stiffness if p.stiffness > 0 else 0.0
    state = initial_state(p, float(currents[0]), float(currents[1]), float(position), 0.0)
    if plant.effects is not None:
        start_effects(plant.surface, p, plant.effects, state)
    depth = 2 + int(np.ceil(plant.instruments.delay.max()))
    return state, np.zeros((depth, N_HISTORY))


@compiled
def read_instruments(plant: SampledPlant, state: Array, history: Array, k: int, noise: Array, readings: Array) -> None:
    """What the instruments read at sample k = 0, 1, 2 ..., before its command acts, into readings (N_READING,).

    `noise` (N_READING,) in m and A is added; `history` remembers what delayed channels need, so call it once a sample.
    """
    remember_sample(plant.parameters, plant.effects, state, history, k)
    read_sample(plant.instruments, plant.parameters.sides, history, k, noise, readings)


@compiled
def remember_sample(p: PlantParameters, effects: Array | None, state: Array, history: Array, k: int) -> None:
    """Puts the channels at sample k into the history."""
    depth = history.shape[0]
    row, before = history[k % depth], history[(k - 1) % depth]
    row[0] = state[SENSOR] + state[ADDED_READING]
    row[AFTER] = row[BEFORE] = _sensor_slope(p, effects, state)
    for j in range(2):
        row[1 + j] = state[COIL_1 + j]
        row[BEFORE + 1 + j] = state[COIL_SLOPE_1 + j]
        if k > 0:
            before[AFTER + 1 + j] = state[COIL_START_1 + j]


@compiled
def advance_sample(plant: SampledPlant, state: Array, command: Array, disturbance: float, voltage: Array) -> int:
    """`kernel.advance` over one sample: OK with the state moved on, or why not.

    command (2,) A, V or N by the drive's kind and `disturbance` (N on the mass) are held; voltage (2,) receives the
    mean voltages of the sides in V, in force drive the mean force in N.
    """
    status = advance(
        plant.surface, plant.parameters, plant.effects, state, command, disturbance, plant.step, plant.n_step, voltage
    )  # fmt: skip
    return int(status)


@compiled
def _sensor_slope(p: PlantParameters, effects: Array | None, state: Array) -> float:
    """Slope in time of the sensor's answer, m/s."""
    if effects is None:
        x, v, bandwidth = state[X], state[V], p.sensor_bandwidth
    else:
        share, bandwidth = effects[MODE_READING], effects[SENSOR_BANDWIDTH]
        x = state[X] + share * state[MODE] + state[COIL_READING]
        v = state[V] + share * state[MODE_RATE] + state[COIL_READING_SLOPE]
    if np.isinf(bandwidth):
        return float(v)
    return float(bandwidth * (x - state[SENSOR]))


class LoopController(Protocol):
    """What closes a loop: it is asked at its own rate, and its command acts `delay_samples` of its periods later: on a
    current drive, or around a voltage drive on a current loop, which is asked at a rate of its own."""

    @property
    def rate(self) -> float:
        """Commands a second, Hz."""
        ...

    @property
    def delay_samples(self) -> int: ...

    @property
    def current_loop_rate(self) -> float | None:
        """Voltages a second, Hz; None: the drive takes the commands."""
        ...

    def start(self) -> None:
        """Forgets all runs before."""
        ...

    def rows(self, samples: Array, *, period: float) -> Array:
        """What `command` takes, a row a sample, of a reference's position, velocity, acceleration (n_sample, 3)."""
        ...

    def command(self, reference: Array, measured: float) -> Array:
        """(n_side,) A for a row of the reference and the measured position in m."""
        ...

    def voltage(self, wanted: Array, read: Array, measured: float) -> Array:
        """(n_side,) V, to act a period of the current loop later, for the currents (2,) A that are wanted now and those
        that are read, and the position in m as `command` had it last."""
        ...


def clock_of(controller: LoopController, *, rate: float) -> tuple[int, int]:
    """Samples of a run between two commands of its controller, and from a command's computation until it acts.

    Raises
    ------
    InputError : the rate is no whole multiple of the controller's
    """
    every = _samples_between("controller", controller.rate, rate)
    return every, every * controller.delay_samples


def _samples_between(what: str, own: float, rate: float) -> int:
    every = whole_multiple(rate, own)
    if every is None:
        raise InputError(
            f"a run at {format_quantity(rate, 'Hz')} cannot be controlled at {format_quantity(own, 'Hz')}: "
            f"its rate must be a whole multiple of the {what}'s"
        )
    return every


def _samples_of_current_loop(actuator: Actuator, controller: LoopController, *, rate: float) -> int | None:
    """Samples of a run between two voltages of the controller's current loop; None: its commands act on the drive."""
    kind, own = actuator.drive and actuator.drive.kind, controller.current_loop_rate
    if kind == "voltage" and own is not None:
        return _samples_between("current loop", own, rate)
    if kind != "current" or own is not None:
        raise InputError(
            f"{actuator.name}: the controller commands currents, and around a voltage drive it needs a current loop; "
            'use drive.kind = "current", or design the controller for the drive that is there'
        )
    return None


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
    InputError : a drive that the controller does not drive, no table; rates that do not fit; the plant cannot have
        one of the effects
    ComputationError : the loop does not hold the plant; names time, state and the way out
    """
    rate = 1.0 / (wanted.time[1] - wanted.time[0])
    every, delay = clock_of(controller, rate=rate)
    plant = sampled_plant(actuator, table, rate=rate, effects=effects)
    inner = _samples_of_current_loop(actuator, controller, rate=rate)
    state, history = plant_at_rest(plant)
    start = state.copy()
    n, sides = wanted.position.size, plant.parameters.sides
    samples = np.column_stack([wanted.position, wanted.velocity, wanted.acceleration])
    followed = controller.rows(samples, period=1.0 / rate)
    noise, kept = reading_noise(actuator, n, generator=generator), np.zeros((n, _N_KEPT))
    readings, voltage, waiting = np.zeros(N_READING), np.zeros(2), np.zeros((delay + 1, 2))
    given, coming, at = np.zeros(2), np.zeros(2), 0.0
    controller.start()
    for k in range(n):
        read_instruments(plant, state, history, k, noise[k], readings)
        waiting[:-1] = waiting[1:]
        if k % every == 0:
            at = float(readings[0])
            waiting[delay, :sides] = controller.command(followed[k], at)
        if inner is not None and k % inner == 0:
            given[:] = coming
            coming[:sides] = controller.voltage(waiting[0], readings[1:3], at)
        acting = waiting[0] if inner is None else given
        row = kept[k]
        row[_COMMAND], row[_READ] = acting, readings
        row[_CURRENT], row[_POSITION], row[_VELOCITY] = state[COIL_1 : COIL_1 + 2], state[X], state[V]
        status = advance_sample(plant, state, acting, 0.0, voltage)
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
