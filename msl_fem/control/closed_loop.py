"""The loop: controller at its rate around the coupled model, compiled as one; its run as a record."""

from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Protocol

import numpy as np

from msl_fem.actuator import Actuator
from msl_fem.computing.arrays import Array
from msl_fem.computing.compiled import compiled
from msl_fem.control.controller import (
    COMING,
    D_HAT,
    FORCE,
    INNOVATION,
    N_DISCOURAGED,
    N_FORCE_LIMITED,
    N_HEAT_LIMITED,
    N_PREFERRED,
    N_VIOLATION,
    RISE_1,
    RISE_2,
    V_HAT,
    ControllerParameters,
    controller_state,
    controller_step,
)
from msl_fem.control.current_step import N_LIMITED
from msl_fem.control.design import ControllerDesign
from msl_fem.control.driven_plant import driven_plant
from msl_fem.control.inverse import force_limits
from msl_fem.control.power_stage import CurrentLoopInPlant, advance_on_current_loop
from msl_fem.control.stepper import reference_rows
from msl_fem.errors import ComputationError, InputError
from msl_fem.files.quantity import format_quantity
from msl_fem.files.shown import Tabular
from msl_fem.plant.effects import EffectValues
from msl_fem.plant.instruments import N_READING, reading_noise
from msl_fem.plant.layout import (
    COIL_1,
    COIL_2,
    I1,
    I2,
    NOT_FINITE,
    OK,
    OUTSIDE_RANGE,
    X,
)
from msl_fem.plant.plant import PlantParameters
from msl_fem.plant.sampled_plant import SampledPlant, advance_sample, plant_at_rest, read_instruments
from msl_fem.table.magnetic_table import MagneticTable

_N_OUT = 16
_REGIONS = (("preferred", N_PREFERRED), ("discouraged", N_DISCOURAGED), ("unacceptable", N_VIOLATION))
_NO_CURRENT = 1e-18  # A

# Columns of the compiled loop's output
(_POSITION, _MEASURED, _CURRENT_1, _CURRENT_2, _VOLTAGE_1, _VOLTAGE_2, _COMMAND_1, _COMMAND_2, _VELOCITY_HAT,
 _DISTURBANCE_HAT, _INNOVATION, _FORCE, _ACTING_1, _ACTING_2, _READ_1, _READ_2) = range(16)  # fmt: skip


class ReferenceArrays(Protocol):
    """What a closed loop is to follow: time in s, position in m, its derivatives in m/s and m/s2, (n_sample,)."""

    @property
    def time(self) -> Array: ...
    @property
    def position(self) -> Array: ...
    @property
    def velocity(self) -> Array: ...
    @property
    def acceleration(self) -> Array: ...


@dataclass(frozen=True, eq=False)
class PlantUnderTest:
    """What the controller acts on: an actuator, its table and its effects, of which the controller knows nothing."""

    actuator: Actuator
    table: MagneticTable
    effects: EffectValues | None = None


@dataclass(frozen=True, eq=False, repr=False)
class ClosedLoopRun(Tabular):
    """A run that stayed within the table and the travel from beginning to end.

    Attributes
    ----------
    time, reference, position, measured : (n_sample,) s and m; samples taken before the instant's command acts
    current, current_read : (n_sample, 2) A of the sides, true and as the sensors read them
    command, acting : (n_sample, 2) A of the sides, the command computed at the sample, and that which acts from it on
    voltage : (n_sample, 2) V of the sides, mean over the sample's period
    force, velocity_hat, disturbance_hat, innovation : (n_sample,) N, m/s, N, m of the controller
    region_counts : number of commands by the guard's region of what was wanted; `unacceptable` ones were cut
    force_limited : number of commands cut for the drive's or the table's current
    heat_limited : number of commands cut as the windings would get too warm
    winding_rise : K over ambient, of the warmer side's windings at the end, as the controller believes
    tracking_rms : m, of position - reference over the run
    peak_current : A, the largest of a side
    copper_loss : W, mean of R i^2 of all sides
    voltage_limited : number of voltages that the current loop cut at the limit; None without a current loop
    """

    time: Array
    reference: Array
    position: Array
    measured: Array
    current: Array
    current_read: Array
    command: Array
    acting: Array
    voltage: Array
    force: Array
    velocity_hat: Array
    disturbance_hat: Array
    innovation: Array
    region_counts: dict[str, int]
    force_limited: int
    heat_limited: int
    winding_rise: float
    tracking_rms: float
    peak_current: float
    copper_loss: float
    voltage_limited: int | None = None

    def facts(self) -> dict[str, str]:
        """How well it followed, with which currents, and what the guard had to do."""
        return {
            "samples": f"{self.time.size} in {format_quantity(float(np.ptp(self.time)), 's')}",
            "tracking error": f"{format_quantity(self.tracking_rms, 'm')} RMS",
            "peak current": format_quantity(self.peak_current, "A"),
            "copper loss": format_quantity(self.copper_loss, "W"),
            "guard violations": f"{self.guard_violations}",
        }

    def frame_columns(self) -> dict[str, Array]:
        """time_s, reference and position, each side's current and voltage, what the controller estimates."""
        columns = {"time_s": self.time, "reference_m": self.reference, "position_m": self.position}
        columns["measured_position_m"] = self.measured
        for side in range(self.current.shape[1]):
            columns[f"current_{side + 1}_A"] = self.current[:, side]
            columns[f"command_{side + 1}_A"] = self.command[:, side]
            columns[f"voltage_{side + 1}_V"] = self.voltage[:, side]
        return columns | {
            "force_N": self.force,
            "velocity_hat_m_per_s": self.velocity_hat,
            "disturbance_hat_N": self.disturbance_hat,
            "innovation_m": self.innovation,
        }

    @property
    def guard_violations(self) -> int:
        """Commands that the guard forbade."""
        return self.region_counts["unacceptable"]

    @property
    def guard_share(self) -> float:
        """Share of the commands beyond the guard's first level."""
        return 1.0 - self.region_counts["preferred"] / self.time.size

    def to_json(self) -> dict[str, Any]:
        """The JSON object of the run's figures."""
        cut = {} if self.voltage_limited is None else {"voltage_limited": self.voltage_limited}
        return cut | {
            "tracking_rms_m": self.tracking_rms,
            "peak_current_A": self.peak_current,
            "copper_loss_W": self.copper_loss,
            "guard_violations": self.guard_violations,
            "guard_regions": dict(self.region_counts),
            "force_limited": self.force_limited,
            "heat_limited": self.heat_limited,
            "winding_rise_K": self.winding_rise,
        }


class _Inputs(NamedTuple):
    """What comes from outside.

    Reference (n, 6), noise of the readings (n, N_READING), disturbance (n,) N, test signal on the reading (n,) m.
    """

    reference: Array
    noise: Array
    disturbance: Array
    injection: Array


def run_closed_loop(
    design: ControllerDesign,
    reference: ReferenceArrays,
    *,
    plant: PlantUnderTest,
    generator: np.random.Generator | None = None,
    disturbance: Array | None = None,
    injection: Array | None = None,
) -> ClosedLoopRun:
    """The run of a controller on a plant that rests without currents when it begins.

    Parameters
    ----------
    reference : samples at the loop's rate
    generator : of the sensors' noise; without one there is none
    disturbance : (n_sample,) N on the mass, held over the samples
    injection : (n_sample,) m, a test signal that the controller takes with the measured position

    Raises
    ------
    InputError : a reference that is not at the loop's rate, or needs positions or forces outside the believed domain;
        the plant has no current drive or cannot have one of its effects
    ComputationError : the plant left its table or its travel or was not finite; such a run is not returned
    """
    samples = checked_reference(design, reference)
    n, period = samples.shape[0], design.law.plant.period
    of_plant = plant.actuator, plant.table, plant.effects
    true, inner = driven_plant(of_plant, design.current_loop, (n, 1 / period), generator=generator)
    inputs = _Inputs(
        reference=reference_rows(design, samples, period=period),
        noise=reading_noise(plant.actuator, n, generator=generator),
        disturbance=_of_samples("disturbance", disturbance, n),
        injection=_of_samples("test signal", injection, n),
    )
    state, history = plant_at_rest(true)
    memory = controller_state(design.parameters)
    out = np.zeros((n, _N_OUT))
    status, done = loop(true, (state, history), design.parameters, memory, inputs, out, inner)
    if status != OK:
        raise ComputationError(_why(status, done * period, state, plant))
    found = _result(reference, true.parameters, memory, out)
    return found if inner is None else replace(found, voltage_limited=int(inner.state[N_LIMITED]))


def _of_samples(name: str, values: Array | None, n: int) -> Array:
    """(n,) zeros where nothing is stated."""
    given = np.zeros(n) if values is None else np.ascontiguousarray(values, dtype=float)
    if given.shape != (n,):
        raise InputError(f"the {name} has shape {given.shape}; the reference has {n} samples")
    return given


@compiled
def loop(
    plant: SampledPlant,
    plant_memory: tuple[Array, Array],
    parameters: ControllerParameters,
    memory: Array,
    inputs: _Inputs,
    out: Array,
    inner: CurrentLoopInPlant | None,
) -> tuple[int, int]:
    """(status, samples done); a row of `out` a sample. Plant (state, history) and controller are moved on."""
    state, history = plant_memory
    waiting = np.zeros((parameters.delay + 1, 2))
    aims = np.zeros(parameters.delay + 1)
    voltage = np.zeros(2)
    command = np.zeros(2)
    readings = np.zeros(N_READING)
    for k in range(out.shape[0]):
        read_instruments(plant, state, history, k, inputs.noise[k], readings)
        controller_step(parameters, memory, inputs.reference[k], readings[0] + inputs.injection[k], command)
        for j in range(parameters.delay):
            waiting[j, 0], waiting[j, 1] = waiting[j + 1, 0], waiting[j + 1, 1]
            aims[j] = aims[j + 1]
        for j in range(2):
            waiting[parameters.delay, j] = command[j]
        aims[parameters.delay] = memory[COMING]
        row = out[k]
        row[_POSITION], row[_MEASURED] = state[X], readings[0]
        row[_CURRENT_1] = state[COIL_1]
        row[_CURRENT_2] = state[COIL_2]
        row[_COMMAND_1], row[_COMMAND_2] = command[0], command[1]
        row[_ACTING_1] = waiting[0, 0]
        row[_ACTING_2] = waiting[0, 1]
        row[_VELOCITY_HAT] = memory[V_HAT]
        row[_DISTURBANCE_HAT] = memory[D_HAT]
        row[_INNOVATION] = memory[INNOVATION]
        row[_FORCE] = memory[FORCE]
        row[_READ_1], row[_READ_2] = readings[1], readings[2]
        if inner is None:
            status = advance_sample(plant, state, waiting[0], inputs.disturbance[k], voltage)
        else:
            status = advance_on_current_loop(
                plant, state, inner, k, waiting[0], row[_MEASURED], aims[0], inputs.disturbance[k], voltage
            )
        row[_VOLTAGE_1], row[_VOLTAGE_2] = voltage[0], voltage[1]
        if plant.effects is None:
            for j in range(I1, I2 + 1):  # an idle side's current decays for ever; below 1e-300 it is slow to compute
                if abs(state[j]) < _NO_CURRENT:
                    state[j] = 0.0
        if status != OK:
            return status, k
    return OK, out.shape[0]


def checked_reference(design: ControllerDesign, reference: ReferenceArrays) -> Array:
    """(n_sample, 3) of the reference, which the believed plant can follow at rest and in motion."""
    given = reference.position, reference.velocity, reference.acceleration
    r, v, a = (np.ascontiguousarray(x, dtype=float) for x in given)
    time = np.asarray(reference.time, dtype=float)
    plant = design.law.plant
    if not (r.shape == v.shape == a.shape == time.shape and r.ndim == 1 and r.size >= 2):
        raise InputError("a reference needs time, position, velocity, acceleration of one length, at least 2 samples")
    if not all(np.isfinite(x).all() for x in (r, v, a)):
        raise InputError("a reference's samples must be finite numbers")
    if np.abs(np.diff(time) - plant.period).max() > 1e-6 * plant.period:
        raise InputError(f"the reference must be sampled at the loop's rate of {1 / plant.period:g} Hz")
    low, high = design.reach
    if r.min() < low * (1 + 1e-9) or r.max() > high * (1 + 1e-9):
        raise InputError(
            f"the reference goes from {format_quantity(r.min(), 'm')} to {format_quantity(r.max(), 'm')}, beyond the "
            f"{format_quantity(low, 'm')} ... {format_quantity(high, 'm')} that the magnets can hold within travel, "
            "guard, drive and table; lower its amplitude"
        )
    p = design.parameters
    force = plant.mass * a + plant.damping * v + (design.suspension + p.cubic * r**2) * r - p.constant_force
    lowest, highest = force_limits(p.inverse, r)
    beyond = np.flatnonzero((force < lowest) | (force > highest))
    if beyond.size:
        k = beyond[0]
        raise InputError(
            f"the reference needs {force[k]:.4g} N at {time[k]:.4g} s, x = {format_quantity(r[k], 'm')}, outside the "
            f"{lowest[k]:.4g} ... {highest[k]:.4g} N that guard, drive and table allow; lower amplitude or frequency"
        )
    return np.ascontiguousarray(np.stack([r, v, a], axis=1))


def check_stable_reach(design: ControllerDesign, reference: ReferenceArrays) -> None:
    """InputError where a reference goes to positions at which the loop, frozen there, is believed unstable.

    Moving through such a position may still do; a run tells.
    """
    low, high = design.stable_reach
    r = np.asarray(reference.position, dtype=float)
    if not low <= high:
        raise InputError(
            f"the {design.kind} design is unstable in the middle of its travel already; lower the bandwidth, allow "
            "more peak sensitivity, or raise the loop rate"
        )
    if r.min() < low * (1 + 1e-9) or r.max() > high * (1 + 1e-9):
        raise InputError(
            f"the reference goes from {format_quantity(r.min(), 'm')} to {format_quantity(r.max(), 'm')}; the "
            f"{design.kind} design is stable from {format_quantity(low, 'm')} to {format_quantity(high, 'm')} (frozen "
            "positions on the believed plant): lower the amplitude, choose another design, or raise the loop rate"
        )


def _why(status: int, time: float, state: Array, plant: PlantUnderTest) -> str:
    reason = {NOT_FINITE: "is not finite", OUTSIDE_RANGE: "reached the end of its travel"}.get(
        status, f"left its table ({plant.table.rectangle})"
    )
    return (
        f"{plant.actuator.name}: after {time:.4g} s the plant {reason}, last at x = {format_quantity(state[X], 'm')} "
        f"with {state[I1]:.4g} A and {state[I2]:.4g} A: the loop does not hold it; lower the reference, or wish for "
        "another bandwidth"
    )


def _result(reference: ReferenceArrays, plant: PlantParameters, memory: Array, out: Array) -> ClosedLoopRun:
    current = out[:, [_CURRENT_1, _CURRENT_2]]
    position = out[:, _POSITION].copy()
    target = np.array(reference.position, dtype=float)
    return ClosedLoopRun(
        time=np.array(reference.time, dtype=float),
        reference=target,
        position=position,
        measured=out[:, _MEASURED].copy(),
        current=current,
        current_read=out[:, [_READ_1, _READ_2]],
        command=out[:, [_COMMAND_1, _COMMAND_2]],
        acting=out[:, [_ACTING_1, _ACTING_2]],
        voltage=out[:, [_VOLTAGE_1, _VOLTAGE_2]],
        force=out[:, _FORCE].copy(),
        velocity_hat=out[:, _VELOCITY_HAT].copy(),
        disturbance_hat=out[:, _DISTURBANCE_HAT].copy(),
        innovation=out[:, _INNOVATION].copy(),
        region_counts={name: int(memory[n]) for name, n in _REGIONS},
        force_limited=int(memory[N_FORCE_LIMITED]),
        heat_limited=int(memory[N_HEAT_LIMITED]),
        winding_rise=float(max(memory[RISE_1], memory[RISE_2])),
        tracking_rms=float(np.sqrt(np.mean((position - target) ** 2))),
        peak_current=float(np.abs(current).max()),
        copper_loss=float(plant.resistance * np.mean(np.sum(current**2, axis=1))),
    )
