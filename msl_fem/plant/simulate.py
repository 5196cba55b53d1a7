"""Open-loop runs of the coupled model, and simulated runs as a record, as an experimenter would have written it."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from msl_fem.actuator import Actuator
from msl_fem.computing.arrays import Array
from msl_fem.errors import ComputationError, InputError
from msl_fem.files.quantity import format_quantity
from msl_fem.files.shown import Tabular
from msl_fem.plant import kernel, layout
from msl_fem.plant.effects import EffectValues, neutral_vector
from msl_fem.plant.energy import EnergyAudit, energy_audit
from msl_fem.plant.excitation import Inputs
from msl_fem.plant.instruments import (
    Channels,
    current_reading,
    currents_before_noise,
    position_before_noise,
    position_reading,
)
from msl_fem.plant.layout import (
    AT_CURRENT_LIMIT_1,
    I1,
    I2,
    NOT_FINITE,
    OK,
    OUTSIDE_RANGE,
    OUTSIDE_TABLE,
    V,
    X,
    initial_state,
)
from msl_fem.plant.operating_point import stability_limit
from msl_fem.plant.plant import FORCE_DRIVE, PlantParameters, Surface, plant_parameters, surface_of
from msl_fem.plant.preparation import effect_coefficients, start_effects
from msl_fem.plant.step_count import default_substeps
from msl_fem.plant.two_sides import shared_by_sides
from msl_fem.record import Noise, Record, Role, Run, Sampling
from msl_fem.table.magnetic_table import MagneticTable

STATUS = {
    OK: "completed",
    OUTSIDE_TABLE: "a gap or a current left the table",
    NOT_FINITE: "the state is no longer finite",
    OUTSIDE_RANGE: "the mover left its range",
}


@dataclass(frozen=True)
class Options:
    """How a run is integrated.

    Attributes
    ----------
    currents, position, velocity : where it starts, A of each side, m, m/s
    substeps : Runge-Kutta steps a sample; None: `default_substeps`
    partial : give what was reached instead of raising where a run cannot go on
    locked : the mover is held where it starts, whatever pulls at it; effects act all the same
    """

    currents: tuple[float, float] = (0.0, 0.0)
    position: float = 0.0
    velocity: float = 0.0
    substeps: int | None = None
    partial: bool = False
    locked: bool = False


@dataclass(frozen=True, eq=False, repr=False)
class Simulation(Tabular):
    """A simulated run. Samples are instantaneous and taken before the command of that instant acts.

    Attributes
    ----------
    rate : samples a second, Hz
    time : (n_sample,) s
    command : (n_sample, n_side) as asked, A, V or N by the drive's kind
    disturbance : (n_sample,) N
    voltage : (n_sample, n_side) V, mean over [t_k, t_k+1); (n_sample, 0) in a force drive
    force : (n_sample,) N, mean over [t_k, t_k+1) of what a force drive gives; 0 with magnets
    current, flux_linkage : (n_sample, n_side) A, Wb, true values of the sides; (n_sample, 0) in a force drive
    position, velocity : (n_sample,) m, m/s, true values
    measured_position, measured_current : as the sensors give them, with bandwidth, noise and resolution
    status : "completed", or why the run ended before its time
    samples_at_current_limit, samples_at_voltage_limit : (n_side,) samples in which the drive met its limit
    substeps : Runge-Kutta steps a sample
    audit : the energy ledger; its imbalance shows the integrator's error
    end_state : (N_STATE,) of the kernel, to go on from
    """

    rate: float
    time: Array
    command: Array
    disturbance: Array
    voltage: Array
    force: Array
    current: Array
    flux_linkage: Array
    position: Array
    velocity: Array
    measured_position: Array
    measured_current: Array
    status: str
    samples_at_current_limit: NDArray[np.int64]
    samples_at_voltage_limit: NDArray[np.int64]
    substeps: int
    audit: EnergyAudit
    end_state: Array

    def facts(self) -> dict[str, str]:
        """How long, how far, with which currents, and whether it came to its end."""
        facts = {
            "samples": f"{self.time.size} at {format_quantity(self.rate, 'Hz')}",
            "position": f"at most {format_quantity(_largest(self.position), 'm')}",
        }
        for side, current in enumerate(self.current.T, start=1):
            facts[f"current {side}"] = f"at most {format_quantity(_largest(current), 'A')}"
        return facts | {"energy imbalance": f"{self.audit.imbalance:.1e}", "status": self.status}

    def frame_columns(self) -> dict[str, Array]:
        """time_s, true signals, then those that the sensors read: measured_position_m, measured_current_1_A."""
        columns = {"time_s": self.time, "position_m": self.position, "velocity_m_per_s": self.velocity}
        for side in range(self.current.shape[1]):
            columns[f"current_{side + 1}_A"] = self.current[:, side]
            columns[f"voltage_{side + 1}_V"] = self.voltage[:, side]
            columns[f"flux_linkage_{side + 1}_Wb"] = self.flux_linkage[:, side]
            columns[f"measured_current_{side + 1}_A"] = self.measured_current[:, side]
        driven = {} if self.current.shape[1] else {"force_N": self.force}
        measured = {"measured_position_m": self.measured_position, "disturbance_N": self.disturbance}
        return columns | driven | measured

    @property
    def complete(self) -> bool:
        return self.status == STATUS[OK]


def _largest(values: Array) -> float:
    """The largest size of a signal; 0 of an empty one."""
    return float(np.abs(values).max(initial=0.0))


def simulate(
    actuator: Actuator,
    table: MagneticTable | None,
    inputs: Inputs,
    *,
    effects: EffectValues | None = None,
    options: Options | None = None,
    generator: np.random.Generator | None = None,
) -> Simulation:
    """The open-loop run of an actuator under sampled inputs.

    `table` is None for a rig that an external force drives; `effects` are those that the plant has beside the plain
    model. Sensor noise is drawn from `generator`; without one there
    is none, the sensors' bandwidth and resolution stay.

    Raises
    ------
    InputError : a section of the actuator is missing, inputs do not fit it, the start lies outside table or range, the
        plant cannot have one of the effects
    ComputationError : the run left the table or the mechanical range; names time, state and the way out
    """
    options = options or Options()
    plant = plant_parameters(actuator)
    _check_start(actuator, plant, table, options)
    surface = surface_of(table if plant.sides else None)
    substeps = options.substeps or default_substeps(
        plant, table, rate=inputs.rate, effects=effects, commands=inputs.commands
    )
    state = initial_state(plant, *map(float, (*options.currents, options.position, options.velocity)))
    e = None
    if effects is not None:
        e = effect_coefficients(plant, surface, effects, step=1.0 / (inputs.rate * substeps), n_step=substeps)
        start_effects(surface, plant, e, state)
    start = state.copy()
    moved = plant._replace(mass=math.inf, end_stop=None) if options.locked else plant
    status, out = integrate(surface, moved, inputs, state=state, substeps=substeps, effects=e)
    if status != OK and not options.partial:
        raise ComputationError(_complaint(actuator, table, status, time=len(out) / inputs.rate, state=state))
    n = len(out)
    limits = state[AT_CURRENT_LIMIT_1 : AT_CURRENT_LIMIT_1 + 4].astype(np.int64)
    read = Channels.of(out, plant.sides)
    v = neutral_vector() if effects is None else effects.vector()
    return Simulation(
        rate=inputs.rate,
        time=inputs.time[:n],
        command=inputs.commands[:n],
        disturbance=np.asarray(inputs.disturbance)[:n],
        measured_position=position_reading(
            actuator, position_before_noise(read, v, rate=inputs.rate), generator=generator
        ),
        measured_current=current_reading(
            actuator, currents_before_noise(read, v, rate=inputs.rate), generator=generator
        ),
        status=STATUS[status],
        samples_at_current_limit=limits[: plant.sides],
        samples_at_voltage_limit=limits[2 : 2 + plant.sides],
        substeps=substeps,
        audit=energy_audit(surface, plant, e, start=start, end=state),
        end_state=state,
        **_channels(plant, out),
    )


def _channels(plant: PlantParameters, out: Array) -> dict[str, Array]:
    """The true signals in the rows (n_done, N_OUT) of the kernel; those of the sides as (n_done, n_side)."""
    sides = slice(0, plant.sides)
    return {
        "voltage": out[:, layout.OUT_VOLTAGE_1 : layout.OUT_VOLTAGE_2 + 1][:, sides],
        "force": out[:, layout.OUT_VOLTAGE_1] if plant.drive == FORCE_DRIVE else np.zeros(len(out)),
        "current": out[:, layout.OUT_I1 : layout.OUT_I2 + 1][:, sides],
        "flux_linkage": out[:, layout.OUT_FLUX_1 : layout.OUT_FLUX_2 + 1][:, sides],
        "position": out[:, layout.OUT_X],
        "velocity": out[:, layout.OUT_V],
    }


def integrate(
    surface: Surface,
    plant: PlantParameters,
    inputs: Inputs,
    *,
    state: Array,
    substeps: int,
    effects: Array | None = None,
) -> tuple[int, Array]:
    """(status, rows (n_done, N_OUT) of the whole samples done) from `state`, which is carried to the end.

    `effects` are the kernel's coefficients for these substeps.

    Raises
    ------
    InputError : the inputs have another number of columns than the drive
    """
    commands = inputs.for_sides(max(plant.sides, 1))
    out = np.empty((commands.shape[0], layout.N_OUT))
    step = 1.0 / (inputs.rate * substeps)
    push = np.asarray(inputs.disturbance)
    linear = inputs.hold == "linear"
    status, done = kernel.run(surface, plant, effects, state, commands, push, step, substeps, out, linear)
    return int(status), out[:done]


def _check_start(actuator: Actuator, plant: PlantParameters, table: MagneticTable | None, options: Options) -> None:
    """InputError where the run cannot begin; OutOfTable among them."""
    if options.substeps is not None and options.substeps < 1:
        raise InputError(f"substeps {options.substeps} must be 1 or more, or None for the default")
    start = (*options.currents, options.position, options.velocity)
    if not np.isfinite(start).all():
        raise InputError(f"the start {start} is not finite; give currents, position and velocity as numbers")
    if abs(options.position) > plant.travel:
        raise InputError(
            f"the start at {format_quantity(options.position, 'm')} lies outside the range of "
            f"{format_quantity(plant.travel, 'm')} to either side; start inside"
        )
    if any(options.currents[plant.sides :]):
        raise InputError(f"{actuator.name} has {plant.sides} sides with coils; start the others with 0 A")
    if plant.sides and table is None:
        raise InputError(f"{actuator.name} has magnets and there is no table; make one with 'msl-fem table'")
    for j in range(plant.sides if table else 0):
        assert table is not None
        table.evaluate(plant.current_share * options.currents[j], plant.nominal_gap - (1 - 2 * j) * options.position)
    shared_by_sides(plant, table, currents=options.currents, position=np.array(options.position))


def _complaint(actuator: Actuator, table: MagneticTable | None, status: int, *, time: float, state: Array) -> str:
    sides = actuator.sides.count if actuator.sides is not None else 2
    currents = ", ".join(f"{value:.4g}" for value in (state[I1], state[I2])[:sides])
    where = f"i = {currents} A, x = {format_quantity(state[X], 'm')}, x' = {state[V]:.4g} m/s"
    rectangle = f" ({table.rectangle})" if table is not None and status == OUTSIDE_TABLE else ""
    met = f"{actuator.name}: {STATUS[status]}{rectangle} after t = {time:.6g} s, at {where}"
    if table is not None and status == OUTSIDE_TABLE and (stops := _gaps_at_stops_outside(actuator, table)):
        return f"{met}; the end stops let the mover reach gaps of {stops}: make the table over them (table --gaps)"
    limit = stability_limit(actuator, table) if table is not None else math.inf
    known = f" (at x = 0 it is stable up to {limit:.3g} A RMS on all sides)" if 0 < limit < math.inf else ""
    return (
        f"{met}; the open loop does not bear these inputs{known}: lower the amplitude or the bias, or "
        "follow a reference in closed loop ('msl-fem control')"
    )


def _gaps_at_stops_outside(actuator: Actuator, table: MagneticTable) -> str:
    """The gaps at the end stops, where the table does not reach both; else empty."""
    motion = actuator.motion
    if motion is None or motion.end_stop is None or motion.nominal_gap is None:
        return ""
    low, high = motion.nominal_gap - motion.end_stop, motion.nominal_gap + motion.end_stop
    inside = table.gap[0] <= low and high <= table.gap[-1]
    return "" if inside else f"{format_quantity(low, 'm')} ... {format_quantity(high, 'm')}"


@dataclass(frozen=True, eq=False)
class NamedRun:
    """A simulation with what rig.toml says about a run: its name (also the file's), excitation in words, and role.

    `reference` is what a closed loop was to follow, (n_sample,) m; `locked` whether the mover was held.
    """

    name: str
    excitation: str
    role: Role
    simulation: Simulation
    reference: Array | None = None
    locked: bool = False


def simulation_record(
    actuator: Actuator, runs: Sequence[NamedRun], *, controller: Mapping[str, Any] | None = None
) -> Record:
    """The record (origin "simulated") of runs of one actuator, all sampled at one rate.

    Currents and position are the sensors' readings, voltages (and the force of a force drive) means over the sample;
    what no instrument reads, such as flux linkage, is left out. The noise is that of the actuator's sensors. Commands
    are those that act from their sample on. `controller` is what rig.toml is to state of one.

    Raises
    ------
    InputError : no runs, or runs of different rates
    RecordError : as `write_record`, when it is written
    """
    rates = {run.simulation.rate for run in runs}
    if len(rates) != 1:
        raise InputError(
            f"the runs of a record have one sampling rate, these have {sorted(rates) or 'none'} Hz; simulate them alike"
        )
    noise = Noise(position=actuator.position_sensor.noise)
    if any(run.simulation.current.shape[1] for run in runs):
        noise = Noise(position=actuator.position_sensor.noise, current=actuator.current_sensor.noise)
    named = tuple(
        Run(run.name, run.excitation, run.role, _columns(actuator, run), mover="locked" if run.locked else "free")
        for run in runs
    )
    sampling = Sampling(rate=rates.pop())
    return Record("simulated", actuator, sampling=sampling, noise=noise, controller=controller, runs=named)


def _columns(actuator: Actuator, run: NamedRun) -> dict[str, Array]:
    """Columns of a run file, by RECORDS' names; commands where they are not what a column has already."""
    simulation = run.simulation
    kind = actuator.drive.kind if actuator.drive else "force"
    sides = range(simulation.current.shape[1])
    columns = {"time_s": simulation.time}
    if kind == "current":
        columns |= {f"command_{j + 1}_A": simulation.command[:, j] for j in sides}
    columns |= {f"voltage_{j + 1}_V": simulation.voltage[:, j] for j in sides}
    columns |= {f"current_{j + 1}_A": simulation.measured_current[:, j] for j in sides}
    if kind == "force":
        columns["force_N"] = simulation.force
    columns["position_m"] = simulation.measured_position
    return columns if run.reference is None else columns | {"reference_m": run.reference}
