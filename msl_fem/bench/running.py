"""Runs of a rig: from rest or after a lead-in, or in closed loop; how far the open loop is stable."""

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from msl_fem.bench.equations import N_SIDE
from msl_fem.bench.instruments import Response, drift_path, play_step, smooth_noise
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
    bench_substeps,
    integrate_run,
    look,
    sample,
    scratch_of,
)
from msl_fem.bench.iron import virgin_memory
from msl_fem.bench.plant import CURRENT_DRIVE, VOLTAGE_DRIVE, Array, Bench, BenchPlant, V, X, arranged, as_record
from msl_fem.bench.rig import Rig, magnet_surface
from msl_fem.computing.whole_multiples import whole_multiple
from msl_fem.errors import ComputationError, InputError
from msl_fem.files.quantity import format_quantity
from msl_fem.table.magnetic_table import MagneticTable

SHORTEST_LEAD = 0.02  # s
LEAD_TIMES = 8.0  # time constants


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
    y = beginning(rig, plant, time=-lead / rate)
    clock = (-lead / rate, 1.0 / rate, rig.delay, substeps or bench_substeps(plant, rig.table, rate=rate))
    out = np.zeros((n, N_OUT))
    bench = compiled_bench(rig, plant)
    pushes = random_path(rig, n, rate=rate, seed=seed)
    status, done = integrate_run(bench, y, padded, pushes, clock, out)
    if status != OK:
        way_out = "the open loop does not bear this: lower the amplitude or the bias"
        raise ComputationError(complaint(rig, plant, status, time=(done - lead) / rate, y=y, way_out=way_out))
    return response_of(out[lead:], commands, rate=rate, sides=plant.magnets.sides, end_state=y)


def compiled_bench(rig: Rig, plant: BenchPlant) -> Bench:
    """The arranged plant of a rig as its compiled equations take it, its iron demagnetised."""
    memory = np.array([virgin_memory(), virgin_memory()])
    return Bench(as_record(plant), magnet_surface(rig.table), memory, np.zeros((2, N_SIDE)), np.zeros((2, 2)))


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


def lead_samples(plant: BenchPlant, table: MagneticTable | None, *, rate: float) -> int:
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


def rest(plant: BenchPlant, *, time: float = 0.0) -> Array:
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


def beginning(rig: Rig, plant: BenchPlant, *, time: float = 0.0) -> Array:
    """The state at rest of a rig, as warm as it is then."""
    y = rest(plant, time=time)
    if plant.layout.thermal >= 0:
        y[plant.layout.thermal : plant.layout.thermal + 4] = rig.warm
    return y


def random_path(rig: Rig, count: int, *, rate: float, seed: int) -> Array:
    """The random force at the samples and the end, (count + 1,) N: white noise through two poles at 20 Hz."""
    if rig.random_force == 0:
        return np.zeros(count + 1)
    return rig.random_force * smooth_noise(count + 1, corner=20.0, rate=rate, seed=(rig.random_force_seed, seed))


def complaint(rig: Rig, plant: BenchPlant, status: int, *, time: float, y: Array, way_out: str) -> str:
    """Why a run ended, when and where, and what to do."""
    why = {OUTSIDE_TABLE: "a gap or a current left the table", OUTSIDE_RANGE: "the mover left its range"}
    return (
        f"{rig.name}: {why.get(status, 'the state is no longer finite')} after t = {time:.6g} s, at x = "
        f"{format_quantity(float(y[X]), 'm')}; {way_out}"
    )


def stable_current(rig: Rig) -> float:
    """The side current (A, the same on all sides) up to which x = 0 is stable at constant currents; inf: all of them.

    There the magnets' negative stiffness has used up the spring.
    """
    magnets = rig.plant.magnets
    if rig.table is None or not magnets.sides:
        return math.inf
    current = np.linspace(0.0, float(rig.table.current[-1]), 2001)
    slope = rig.table.evaluate(current, magnets.nominal_gap)["force_gap_slope"]
    left = rig.plant.motion.stiffness + magnets.per_side * magnets.sides * slope
    gone = np.flatnonzero(left <= 0)
    if not gone.size:
        return math.inf
    n = int(gone[0])
    if n == 0:
        return 0.0
    share = left[n - 1] / (left[n - 1] - left[n])
    return float((current[n - 1] + share * (current[n] - current[n - 1])) / magnets.share)


def check_stable_stretches(rig: Rig, response: Response) -> None:
    """Returns where the mean plant of every stretch as long as a natural period is stable, else raises.

    Force and its slope go with the square of the current (below saturation), and the mover averages them over its
    natural period: its stiffness is the spring's and the magnets' at the RMS currents and the mean gaps of a stretch.
    A run of equal currents on both sides would stay at x = 0 whatever they are; no bench would.

    Raises
    ------
    InputError : names the limit
    """
    magnets = rig.plant.magnets
    motion = rig.plant.motion
    if rig.table is None or not magnets.sides or motion.stiffness <= 0:
        return
    period = 2 * math.pi * math.sqrt(motion.mass / motion.stiffness)
    window = min(max(1, round(period * response.rate)), len(response.position))
    rms = np.sqrt(_means(response.current**2, window))
    mean = _means(response.position[:, None], window)[:, 0]
    left = np.full(mean.size, motion.stiffness)
    for j in range(magnets.sides):
        gap = magnets.nominal_gap - (1 - 2 * j) * mean
        left += magnets.per_side * rig.table.evaluate(magnets.share * rms[:, j], gap)["force_gap_slope"]
    if left.min() <= 0:
        worst = int(np.argmin(left))
        currents = ", ".join(f"{current:.3g} A" for current in rms[worst])
        raise InputError(
            f"{rig.name}: from t = {worst * window / response.rate:.4g} s the inputs make {currents} RMS over "
            f"{window / response.rate * 1e3:.3g} ms; at x = 0 it is stable up to {stable_current(rig):.3g} A on all "
            "sides: lower the amplitude or the bias"
        )


def _means(values: Array, window: int) -> Array:
    """Means (n_window, n_column) over stretches of `window` rows, one behind the other."""
    whole = values.shape[0] // window
    return values[: whole * window].reshape(whole, window, -1).mean(axis=1)


class BenchController(Protocol):
    """What closes a loop: asked at its own rate, its command acts `delay_samples` of its periods later. Around a
    voltage drive a current loop at `current_loop_rate` makes voltages of it, each to act one of its periods later."""

    @property
    def rate(self) -> float: ...
    @property
    def delay_samples(self) -> int: ...
    @property
    def current_loop_rate(self) -> float | None: ...
    def start(self) -> None: ...
    def rows(self, samples: Array, *, period: float) -> Array: ...
    def command(self, reference: Array, measured: float) -> Array: ...
    def voltage(self, wanted: Array, read: Array, measured: float) -> Array: ...


@dataclass(frozen=True, eq=False)
class Following:
    """A closed-loop run that is asked for.

    Attributes
    ----------
    reference : (n_sample, n) of position, velocity, acceleration wanted, as the controller's `rows` has it
    controller : knows the belief, and what it reads
    noise : (n_sample,) m, of the position's reading in the loop; None: none
    resolution : m, of the reading; 0: none
    current_noise : (n_sample, 2) A, of the sensors of the current loop, which are not the record's; None: none
    """

    reference: Array
    controller: BenchController
    noise: Array | None = None
    resolution: float = 0.0
    current_noise: Array | None = None


def follow(rig: Rig, asked: Following, *, rate: float, seed: int = 0) -> Response:
    """The run from rest without currents; commands are those that act from their sample on.

    `Response.measured` is the position as the controller read it.

    Raises
    ------
    InputError : a drive that the controller does not drive, a rate that is no whole multiple of the controller's
    ComputationError : the loop does not hold the rig
    """
    plant = arranged(rig.plant)
    controller = asked.controller
    every = _samples_between(rig, "controller", controller.rate, rate)
    inner = None
    if plant.circuit.drive == VOLTAGE_DRIVE and controller.current_loop_rate is not None:
        inner = _samples_between(rig, "current loop", controller.current_loop_rate, rate)
    elif plant.circuit.drive != CURRENT_DRIVE or controller.current_loop_rate is not None:
        raise InputError(
            f"{rig.name}: the controller commands currents, and around a voltage drive it needs a current loop; use "
            'drive.kind = "current", or design the controller for the drive that is there'
        )
    n, sides = len(asked.reference), plant.magnets.sides
    late = every * controller.delay_samples
    due = np.zeros((n + late, 2))
    commands = due[:n] if inner is None else np.zeros((n + inner, 2))
    bench = compiled_bench(rig, plant)
    y = beginning(rig, plant)
    scratch = scratch_of(bench, y)
    pushes = random_path(rig, n, rate=rate, seed=seed)
    out = np.zeros((n, N_OUT))
    clock = (0.0, 1.0 / rate, rig.delay, bench_substeps(plant, rig.table, rate=rate))
    noise = np.zeros(n) if asked.noise is None else asked.noise
    current_noise = np.zeros((n, 2)) if asked.current_noise is None else asked.current_noise
    drift = drift_path(rig, n, rate=rate, run=seed)
    measured = np.zeros(n)
    played, at = np.nan, 0.0
    controller.start()
    for k in range(n):
        status = look(bench, y, scratch[0], out[k])
        if status == OK:
            played = play_step(played, out[k, OUT_READING], rig.instruments.play)
            measured[k] = played + drift[k] + noise[k]
            if asked.resolution > 0:
                measured[k] = np.round(measured[k] / asked.resolution) * asked.resolution
            if k % every == 0:
                at = float(measured[k])
                due[k + late : k + late + every, :sides] = controller.command(asked.reference[k], at)
            if inner is not None and k % inner == 0:
                read = out[k, OUT_I1 : OUT_I1 + 2] + current_noise[k]
                commands[k + inner : k + 2 * inner, :sides] = controller.voltage(due[k], read, at)
            status = sample(bench, y, scratch, k, commands, pushes, clock, out[k])
        if status != OK:
            way_out = "the loop does not hold it"
            raise ComputationError(complaint(rig, plant, status, time=k / rate, y=y, way_out=way_out))
    return response_of(out, commands[:n, :sides], rate=rate, sides=sides, end_state=y, measured=measured)


def _samples_between(rig: Rig, what: str, own: float, rate: float) -> int:
    """Samples of a record at `rate` from one step of a loop at its `own` rate to the next, Hz both."""
    every = whole_multiple(rate, own)
    if every is None:
        raise InputError(
            f"{rig.name}: {format_quantity(rate, 'Hz')} are no whole multiple of the {what}'s "
            f"{format_quantity(own, 'Hz')}; sample at a multiple of it"
        )
    return every
