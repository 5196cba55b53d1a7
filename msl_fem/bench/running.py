"""Runs of a rig: from rest or after a lead-in, without noise."""

import math
from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from msl_fem.bench.circuit import N_SIDE
from msl_fem.bench.integrate import (
    N_OUT,
    OK,
    OUT_FLUX_1,
    OUT_I1,
    OUT_READING,
    OUT_V,
    OUT_VOLTAGE_1,
    OUT_X,
    OUTSIDE_RANGE,
    OUTSIDE_TABLE,
    run,
)
from msl_fem.bench.plant import VOLTAGE_DRIVE, Array, Bench, Plant, V, X, arranged, as_record
from msl_fem.bench.preisach import virgin_memory
from msl_fem.bench.rig import Rig, surface_of
from msl_fem.bench.step_size import default_substeps
from msl_fem.errors import ComputationError, InputError
from msl_fem.files.quantity import format_quantity
from msl_fem.table.magnetic_table import MagneticTable


@dataclass(frozen=True, eq=False)
class Response:
    """A run of the rig without noise, (n_sample, ...) each; samples are taken before their command acts.

    Attributes
    ----------
    command : (n_sample, n_column) as asked
    voltage : (n_sample, n_side) mean until the next sample
    reading : the position after the sensor's electronics, before instruments' errors
    measured : in closed loop the position as its controller read it, with errors and noise; else None
    """

    rate: float
    command: Array
    current: Array
    voltage: Array
    flux_linkage: Array
    position: Array
    velocity: Array
    reading: Array
    end_state: Array
    measured: Array | None = None


def run_rig(
    rig: Rig, commands: Array, *, rate: float, lead_in: float | None = None, substeps: int | None = None, seed: int = 0
) -> Response:
    """The run of commands (n_sample, n_column), from rest without currents.

    With a `lead_in`, that constant command is held on all sides until the currents stand, before the run begins.

    Raises
    ------
    ComputationError : the mover left its range or the table; says when and what to do
    """
    plant = arranged(rig.plant)
    lead = 0 if lead_in is None else lead_samples(plant, rig.table, rate=rate)
    n = commands.shape[0] + lead
    columns = max(plant.magnets.sides, 1)
    if commands.ndim != 2 or commands.shape[1] != columns:
        raise InputError(f"{rig.name}: commands have the shape {commands.shape}, expected (n_sample, {columns})")
    padded = np.zeros((n, 2))
    padded[:lead, :columns] = lead_in
    padded[lead:, :columns] = commands
    y = rest(plant, time=-lead / rate)
    clock = (-lead / rate, 1.0 / rate, rig.delay, substeps or default_substeps(plant, rig.table, rate=rate))
    memory, out = np.array([virgin_memory(), virgin_memory()]), np.zeros((n, N_OUT))
    bench = Bench(as_record(plant), surface_of(rig.table), memory, np.zeros((2, N_SIDE)), np.zeros((2, 2)))
    pushes = random_path(rig, n, rate=rate, seed=seed)
    status, done = run(bench, y, padded, pushes, clock, out)
    if status != OK:
        way_out = "the open loop does not bear this: lower the amplitude or the bias"
        raise ComputationError(complaint(rig, plant, status, time=(done - lead) / rate, y=y, way_out=way_out))
    return response_of(out[lead:], commands, rate=rate, sides=plant.magnets.sides, end_state=y)


def response_of(
    out: Array, command: Array, *, rate: float, sides: int, end_state: Array, measured: Array | None = None
) -> Response:
    """The response in the rows (n_sample, N_OUT) of the integrator."""
    return Response(
        rate=rate,
        command=command,
        current=out[:, OUT_I1 : OUT_I1 + sides],
        voltage=out[:, OUT_VOLTAGE_1 : OUT_VOLTAGE_1 + sides],
        flux_linkage=out[:, OUT_FLUX_1 : OUT_FLUX_1 + sides],
        position=out[:, OUT_X],
        velocity=out[:, OUT_V],
        reading=out[:, OUT_READING],
        end_state=end_state,
        measured=measured,
    )


SHORTEST_LEAD = 0.02
LEAD_TIMES = 8.0


def lead_samples(plant: Plant, table: MagneticTable | None, *, rate: float) -> int:
    """Samples in which the currents settle after a step of the command: eight of their time constants, 20 ms at least.

    The mover need not settle: it has been at rest, and the bias alone moves it little.
    """
    times = [SHORTEST_LEAD]
    if math.isfinite(plant.circuit.bandwidth):
        times.append(LEAD_TIMES / plant.circuit.bandwidth)
    magnets = plant.magnets
    if table is not None and plant.circuit.drive == VOLTAGE_DRIVE:
        inductance = float(table.evaluate(0.0, magnets.nominal_gap)["incremental_inductance"])
        times.append(LEAD_TIMES * magnets.per_side * magnets.share**2 * inductance / plant.circuit.resistance)
    return math.ceil(max(times) * rate)


def rest(plant: Plant, *, time: float = 0.0) -> Array:
    """The state without currents, all memories settled: at rest under the constant force, or swinging with the hum."""
    y = np.zeros(plant.layout.size)
    m, d = plant.motion, plant.disturbance
    if m.stiffness > 0:
        y[X] = m.constant_force / m.stiffness
    if d.hum != 0:
        for order, share in ((1, 1.0), (3, d.hum_third)):
            w = order * d.hum_frequency
            swing = share * d.hum / (m.stiffness - m.mass * w**2 + 1j * m.damping * w)
            turn = np.exp(1j * order * (d.hum_frequency * time + d.hum_phase))
            y[X] += (swing * turn).imag
            y[V] += (1j * w * swing * turn).imag
    if plant.layout.attached >= 0:
        y[plant.layout.attached] = y[X]
    if plant.layout.branches >= 0:
        y[plant.layout.branches : plant.layout.branches + plant.flexure.branches] = y[X]
    return y


def random_path(rig: Rig, count: int, *, rate: float, seed: int) -> Array:
    """The random force at the samples and the end, (count + 1,) N: white noise through two poles at 20 Hz."""
    if rig.random_force == 0:
        return np.zeros(count + 1)
    return rig.random_force * smooth_noise(count + 1, corner=20.0, rate=rate, seed=(rig.random_force_seed, seed))


def smooth_noise(count: int, *, corner: float, rate: float, seed: tuple[int, ...]) -> Array:
    """Gaussian noise (count,) of unit variance, low-passed twice at `corner` (Hz), settled before it begins."""
    pole = math.exp(-2 * math.pi * corner / rate)
    lead = int(8 / (1 - pole))
    value = np.random.default_rng(seed).standard_normal(count + lead)
    for _ in range(2):
        value = np.asarray(lfilter([1.0], [1.0, -pole], value))
    return value[lead:] / math.sqrt((1 + pole**2) / (1 - pole**2) ** 3)


def complaint(rig: Rig, plant: Plant, status: int, *, time: float, y: Array, way_out: str) -> str:
    """Why a run ended, when and where, and what to do."""
    why = {OUTSIDE_TABLE: "a gap or a current left the table", OUTSIDE_RANGE: "the mover left its range"}
    return (
        f"{rig.name}: {why.get(status, 'the state is no longer finite')} after t = {time:.6g} s, at x = "
        f"{format_quantity(float(y[X]), 'm')}; {way_out}"
    )
