"""The bench's own integrator: Dormand and Prince's formula of order 5 with fixed steps between the commands' instants.

(Dormand and Prince, J. Comput. Appl. Math. 6, 1980, formula RK5(4)7M; its seventh stage serves the error estimate alone
and is left out.) Steps end at every instant at which a command changes, a delayed one within a sample too. The memory
of the hysteresis is carried on after every step, so that a turn lies at a step's end.
"""

import math

import numpy as np

from msl_fem.bench.equations import CURRENT, FLUX, LINKED, fill_side_currents, state_rates
from msl_fem.bench.iron import fastest_ladder_rate, settle_memory
from msl_fem.bench.law_program import READING, law_of_motion
from msl_fem.bench.plant import (
    CURRENT_DRIVE,
    FORCE_DRIVE,
    VOLT_SECONDS_1,
    VOLT_SECONDS_2,
    VOLTAGE_DRIVE,
    Array,
    Bench,
    BenchPlant,
    SensorElectronics,
    V,
    X,
)
from msl_fem.computing.compiled import compiled
from msl_fem.computing.copied_rows import copy_into
from msl_fem.errors import InputError
from msl_fem.files.quantity import format_quantity
from msl_fem.table.magnetic_table import MagneticTable

OK, OUTSIDE_TABLE, NOT_FINITE, OUTSIDE_RANGE = 0, 1, 2, 3
# Columns of a run: true values at the sample, the position as its sensor's electronics give it; mean until the next row
OUT_I1, OUT_I2, OUT_X, OUT_V, OUT_READING, OUT_FLUX_1, OUT_FLUX_2, OUT_VOLTAGE_1, OUT_VOLTAGE_2 = range(9)
N_OUT = 9
N_STAGE = 6
STEP_OF_DRIVE = 0.22  # at most: a step times the fastest rate of drive and mover
STEP_OF_PIECES = 0.8  # and of all else
MOST_SUBSTEPS = 400
_A = np.array([
    [0, 0, 0, 0, 0],
    [1 / 5, 0, 0, 0, 0],
    [3 / 40, 9 / 40, 0, 0, 0],
    [44 / 45, -56 / 15, 32 / 9, 0, 0],
    [19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729, 0],
    [9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656],
])  # fmt: skip
_B = np.array([35 / 384, 0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84])
_C = np.array([0, 1 / 5, 3 / 10, 4 / 5, 8 / 9, 1])


@compiled
def lagged(rate: float, step: float, before: float, x0: float, d0: float, x1: float, d1: float) -> float:
    """y at the end of a step (s), where y' = rate (x - y), y = `before` at its start, x the cubic of its end slopes.

    A polynomial input has the particular answer p = x - x'/w + x''/w^2 - x'''/w^3, so y1 = p1 + exp(-w h)(y0 - p0). An
    endless rate gives x1.
    """
    if np.isinf(rate):
        return x1
    third = (6.0 * (d0 + d1) * step - 12.0 * (x1 - x0)) / (step * step * step)
    second_0 = (6.0 * (x1 - x0) - (4.0 * d0 + 2.0 * d1) * step) / (step * step)
    second_1 = second_0 + third * step
    p0 = x0 - (d0 - (second_0 - third / rate) / rate) / rate
    p1 = x1 - (d1 - (second_1 - third / rate) / rate) / rate
    return p1 + np.exp(-rate * step) * (before - p0)


@compiled
def _step(
    bench: Bench, span: tuple[float, float], y: Array, command: Array, pushes: tuple[float, float], stages: Array
) -> bool:
    """Puts the state after a step into the last row of `stages`; False where a stage left the table.

    `span` is (time, step) in s, `pushes` the force from outside at both ends in N; stages (N_STAGE + 1, size).
    """
    time, step = span
    trial = stages[N_STAGE]
    for s in range(N_STAGE):
        _combine(y, step, _A[s], stages, s, trial)
        instant = (time + _C[s] * step, pushes[0] + _C[s] * (pushes[1] - pushes[0]))
        if not state_rates(bench, trial, command, instant, stages[s]):
            return False
    _combine(y, step, _B, stages, N_STAGE, trial)
    return True


@compiled
def _combine(y: Array, step: float, weights: Array, k: Array, count: int, trial: Array) -> None:
    """trial = y + step times the sum of the first `count` rows of k by their weights."""
    for m in range(y.size):
        trial[m] = y[m]
    for r in range(count):
        weight = step * weights[r]
        for m in range(y.size):
            trial[m] += weight * k[r, m]


@compiled
def _read(reading: SensorElectronics, step: float, filters: Array, before: Array, after: Array) -> None:
    """Carry the sensor's electronics (3,) over a step: its further lags, then its believed bandwidth."""
    x0, d0 = _sensed(reading, before[X], before[V])
    x1, d1 = _sensed(reading, after[X], after[V])
    for n in range(3):
        rate = reading.bandwidth
        if n < 2:
            rate = 1.0 / reading.lags[n]
        held = filters[n]
        filters[n] = lagged(rate, step, held, x0, d0, x1, d1)
        if not np.isinf(rate):
            d0, d1 = rate * (x0 - held), rate * (x1 - filters[n])
            x0, x1 = held, filters[n]


@compiled
def _sensed(reading: SensorElectronics, position: float, velocity: float) -> tuple[float, float]:
    """(reading m, its rate m/s) of the transducer: x/(1 - b x) with the gain, as an optical probe's lever gives it."""
    ratio = 1.0 / (1.0 - reading.curvature * position)
    return reading.gain * position * ratio, reading.gain * velocity * ratio * ratio


@compiled
def _limited(plant: BenchPlant, asked: Array, held: Array) -> None:
    """Put the commands (2,) into `held`, clipped at what the amplifier takes."""
    limit = np.inf
    if plant.circuit.drive == CURRENT_DRIVE:
        limit = plant.circuit.current_limit
    elif plant.circuit.drive != FORCE_DRIVE:
        limit = plant.circuit.voltage_limit
    for j in range(2):
        held[j] = min(max(asked[j], -limit), limit)


@compiled
def _good(plant: BenchPlant, trial: Array) -> int:
    for n in range(trial.size):
        if not np.isfinite(trial[n]):
            return NOT_FINITE
    return OUTSIDE_RANGE if abs(trial[X]) > plant.motion.travel else OK


@compiled
def integrate_run(
    bench: Bench, y: Array, commands: Array, pushes: Array, clock: tuple[float, float, float, int], out: Array
) -> tuple[int, int]:
    """(status, whole samples done) of a run from the state y, which is carried to the end.

    Parameters
    ----------
    bench : its memory is carried along with the state
    commands : (n, 2), each held for a sample
    pushes : (n + 1,) N, a force that runs straight between the samples
    clock : time of the first sample, sampling period and the commands' delay in s, steps a sample
    out : (n, N_OUT), receives a row a sample
    """
    scratch = scratch_of(bench, y)
    for n in range(commands.shape[0]):
        status = look(bench, y, scratch[0], out[n])
        if status == OK:
            status = sample(bench, y, scratch, n, commands, pushes, clock, out[n])
        if status != OK:
            return status, n
    return OK, commands.shape[0]


@compiled
def scratch_of(bench: Bench, y: Array) -> tuple[Array, Array, Array]:
    """(filters of the sensor, settled at the state y; stages; commands held), the memory of a run's samples."""
    filters = np.zeros(3)
    filters[:] = _sensed(bench.plant.reading, y[X], y[V])[0]
    return filters, np.zeros((N_STAGE + 1, y.size)), np.zeros(2)


@compiled
def sample(
    bench: Bench,
    y: Array,
    scratch: tuple[Array, Array, Array],
    n: int,
    commands: Array,
    pushes: Array,
    clock: tuple[float, float, float, int],
    row: Array,
) -> int:
    """OK with the state at the end of sample n and its voltages in the row, or why not; arguments as `integrate_run`.

    Commands up to the n-th are looked at.
    """
    plant = bench.plant
    start, period, delay, substeps = clock
    filters, stages, held = scratch
    late = int(delay / period + 1e-9)
    rest = delay - late * period
    rest = 0.0 if rest < 1e-9 * period else rest
    parts = ((0.0, rest), (rest, period))
    y[VOLT_SECONDS_1] = y[VOLT_SECONDS_2] = 0.0
    for part in range(2):
        begin, end = parts[part]
        source = n - late - 1 + part
        held[0] = held[1] = 0.0
        if source >= 0:
            _limited(plant, commands[source], held)
        steps = int(np.ceil(substeps * (end - begin) / period - 1e-9))
        step = (end - begin) / max(steps, 1)
        for s in range(steps):
            share = (begin + s * step) / period
            first = pushes[n] + share * (pushes[n + 1] - pushes[n])
            last = first + step / period * (pushes[n + 1] - pushes[n])
            span = (start + (n + share) * period, step)
            status = _advance(bench, span, y, held, (first, last), stages)
            if status != OK:
                return status
            _read(plant.reading, step, filters, y, stages[N_STAGE])
            copy_into(y, stages[N_STAGE])
    row[OUT_VOLTAGE_1] = y[VOLT_SECONDS_1] / period
    row[OUT_VOLTAGE_2] = y[VOLT_SECONDS_2] / period
    return OK


@compiled
def _advance(
    bench: Bench, span: tuple[float, float], y: Array, held: Array, pushes: tuple[float, float], stages: Array
) -> int:
    """OK with the state after a step in the last row of `stages` and the memory carried there, or why not."""
    if not _step(bench, span, y, held, pushes, stages):
        return OUTSIDE_TABLE
    status = _good(bench.plant, stages[N_STAGE])
    if status == OK and bench.plant.hysteresis.amplitude > 0.0 and not _settled(bench, stages[N_STAGE]):
        return OUTSIDE_TABLE
    return status


@compiled
def _relative_position(plant: BenchPlant, y: Array) -> float:
    """Of the mover and the magnets."""
    return y[X] - y[plant.layout.support] if plant.layout.support >= 0 else y[X]


@compiled
def _settled(bench: Bench, y: Array) -> bool:
    """Carries the memory of the hysteresis to the state; False outside the table."""
    if not fill_side_currents(bench, y, _relative_position(bench.plant, y)):
        return False
    for j in range(bench.plant.magnets.sides):
        settle_memory(bench.plant.hysteresis, bench.memory[j], bench.sides[j, LINKED])
    return True


@compiled
def look(bench: Bench, y: Array, filters: Array, row: Array) -> int:
    """OK with the row of a sample filled but for its voltages, or why not."""
    sides = bench.sides
    position = _relative_position(bench.plant, y)
    if not fill_side_currents(bench, y, position):
        return OUTSIDE_TABLE
    gap = bench.plant.magnets.nominal_gap - position
    row[OUT_I1] = sides[0, CURRENT]
    row[OUT_I2] = sides[1, CURRENT]
    row[OUT_X] = y[X]
    row[OUT_V] = y[V]
    row[OUT_READING] = filters[2] + law_of_motion(bench.plant, READING, y, gap, sides, CURRENT)
    row[OUT_FLUX_1] = sides[0, FLUX]
    row[OUT_FLUX_2] = sides[1, FLUX]
    return OK


def bench_substeps(plant: BenchPlant, table: MagneticTable | None, *, rate: float) -> int:
    """Steps a sample such that a step times the fastest rate of drive and mover is at most 0.22, of all else 0.8.

    Raises
    ------
    InputError : more than 400 steps a sample
    """
    c = plant.circuit
    m = plant.motion
    slow = [c.bandwidth if math.isfinite(c.bandwidth) else 0.0, math.sqrt(m.stiffness / m.mass), m.damping / m.mass]
    if table is not None and plant.magnets.sides:
        reach = table.current <= max(c.current_limit * plant.magnets.share, table.current[1])
        gap = float(np.clip(plant.magnets.nominal_gap, table.gap[0], table.gap[-1]))
        magnet = table.evaluate(table.current[reach], gap)
        stiffness = plant.magnets.per_side * plant.magnets.sides * float(np.abs(magnet["force_gap_slope"]).max())
        slow.append(math.sqrt(max(stiffness, m.stiffness) / m.mass))
        if c.drive == VOLTAGE_DRIVE:
            linked = plant.magnets.per_side * plant.magnets.share**2
            slow.append(c.resistance / (linked * float(magnet["incremental_inductance"].min())))
    fast = [plant.amplifier.frequency, fastest_ladder_rate(plant.ladder), *_mechanical_rates(plant)]
    steps = max(max(slow) / STEP_OF_DRIVE, max(fast) / STEP_OF_PIECES) / rate
    if not steps <= MOST_SUBSTEPS:
        raise InputError(
            f"the fastest rate needs {steps:.3g} steps a sample at {format_quantity(rate, 'Hz')}, at most "
            f"{MOST_SUBSTEPS} are taken; sample faster, or look at mass, stiffness and bandwidth"
        )
    return max(1, math.ceil(steps - 1e-9))


def _mechanical_rates(plant: BenchPlant) -> list[float]:
    """Fastest rates in 1/s of the mechanical pieces that are on."""
    rates = [float(plant.flexure.branch_rate.max())]
    if plant.support.mass > 0:
        rates.append(math.sqrt(plant.support.stiffness / plant.support.mass))
    if plant.attached.share > 0:
        rates.append(plant.attached.frequency / math.sqrt(1 - plant.attached.share))
    f = plant.friction
    if f.coulomb > 0:  # at the mover's largest speed; the bristles as a spring in parallel to the mover's
        reach = min(plant.motion.travel, 1e-3)
        speed = 0.2 * reach * math.sqrt(max(plant.motion.stiffness, 1.0) / plant.motion.mass)
        rates.append(f.bristle_stiffness * speed / f.coulomb)
        rates.append(math.sqrt(f.bristle_stiffness / plant.motion.mass))
    return rates
