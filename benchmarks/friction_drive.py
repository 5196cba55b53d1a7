"""A carriage with viscous and Coulomb friction, no spring: its parameters from a record, its force, its closed loop.

force = M x'' + Fv x' + Fc sign(x') + offset, by linear least squares on low-passed channels: the inverse dynamic model
of robotics (A. Janot, P.-O. Vandanjon, M. Gautier, IEEE Trans. Control Syst. Technol. 22, 2014). Position and force
pass the same zero-phase filter, so that it weighs the equation and does not bend it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.signal import butter, sosfiltfilt

from msl_fem.computing.arrays import Array
from msl_fem.computing.compiled import compiled
from msl_fem.errors import InputError

CREEP = 1e-4  # m/s, width of the smooth step that stands for sign(velocity) in simulation
SUBSTEPS = 10
EDGE = 0.5  # s at either end of a record that the zero-phase filters bend


@dataclass(frozen=True)
class FrictionDrive:
    """Mass (kg), viscous friction (N s/m), Coulomb friction (N) and offset (N) of a drive."""

    mass: float
    viscous: float
    coulomb: float
    offset: float

    @property
    def vector(self) -> Array:
        """The four values in the order mass, viscous, coulomb, offset."""
        return np.array([self.mass, self.viscous, self.coulomb, self.offset])


@dataclass(frozen=True)
class LowPass:
    """Zero-phase Butterworth filters (Hz): of the position before it is differentiated, and of the whole equation."""

    position: float = 50.0
    equation: float = 20.0
    order: int = 4

    def apply(self, signal: Array, cutoff: float, sampling_period: float) -> Array:
        """The signal, low-passed forwards and backwards."""
        if not 0.0 < cutoff < 0.5 / sampling_period:
            raise InputError(f"low-pass at {cutoff:g} Hz: give one below half the sampling rate")
        sections = butter(self.order, cutoff, fs=1.0 / sampling_period, output="sos")
        return np.asarray(sosfiltfilt(sections, signal), dtype=float)


@dataclass(frozen=True)
class CascadeLoop:
    """force = gain (kv (kp (reference - position) - velocity) + added voltage), velocity by backward difference."""

    kp: float
    kv: float
    force_constant: float


def inverse_dynamics(
    position: Array, force: Array, sampling_period: float, *, low_pass: LowPass | None = None
) -> tuple[FrictionDrive, Array]:
    """Drive by least squares of the filtered equation, and one standard deviation of each parameter (4,).

    One row a correlation time of the filter is kept for the deviations, or filtered noise would count many times.
    """
    columns, target = filtered_equation(position, force, sampling_period, low_pass=low_pass)
    every = max(1, round(0.5 / ((low_pass or LowPass()).equation * sampling_period)))
    rows, right = columns[::every], target[::every]
    solution, *_ = np.linalg.lstsq(rows, right, rcond=None)
    residual = right - rows @ solution
    variance = residual @ residual / (right.size - solution.size)
    deviations = np.sqrt(variance * np.diag(np.linalg.inv(rows.T @ rows)))
    return FrictionDrive(*map(float, solution)), deviations


def filtered_equation(
    position: Array, force: Array, sampling_period: float, *, low_pass: LowPass | None = None
) -> tuple[Array, Array]:
    """Columns (n_rows, 4) of acceleration, velocity, its sign, one; and the force (n_rows,); all low-passed.

    Half a second at either end is left out. InputError if nothing remains.
    """
    edge = round(EDGE / sampling_period)
    if position.size <= 2 * edge + 10:
        raise InputError(f"{position.size} samples: the filters' edges take {2 * edge}; record longer")
    kept = slice(edge, position.size - edge)
    filters = low_pass or LowPass()
    smooth = filters.apply(position, filters.position, sampling_period)
    velocity = np.gradient(smooth, sampling_period)
    raw = [np.gradient(velocity, sampling_period), velocity, np.sign(velocity)]
    passed = [filters.apply(column, filters.equation, sampling_period) for column in raw]
    columns = np.column_stack([*passed, np.ones(position.size)])
    return columns[kept], filters.apply(force, filters.equation, sampling_period)[kept]


def closed_loop(
    drive: FrictionDrive,
    loop: CascadeLoop,
    reference: Array,
    *,
    sampling_period: float,
    start: float,
    added: Array | None = None,
) -> tuple[Array, Array]:
    """Position (m) and force (N) of the loop from rest at `start`; `added` is a voltage behind the controller (V)."""
    extra = np.zeros(reference.size) if added is None else np.asarray(added, dtype=float)
    gains = np.array([loop.kp, loop.kv, loop.force_constant])
    position, force = _loop(drive.vector, gains, np.asarray(reference, dtype=float), extra, (sampling_period, start))
    return position, force


def free_run(drive: FrictionDrive, force: Array, *, sampling_period: float, start: float) -> Array:
    """Position (m) of the carriage under a measured force (n_sample,) that is held over each sample, from rest."""
    return _free(drive.vector, np.asarray(force, dtype=float), np.array([sampling_period, start]))


def freely_refined(drive: FrictionDrive, force: Array, position: Array, *, sampling_period: float) -> FrictionDrive:
    """The drive whose free run under the measured force is nearest to the measured position: output error."""
    scale = drive.vector

    def misses(share: Array) -> Array:
        tried = FrictionDrive(*(share * scale))
        simulated = free_run(tried, force, sampling_period=sampling_period, start=position[0])
        return (simulated - position) / np.std(position)

    found = least_squares(misses, np.ones(scale.size), x_scale=0.1, diff_step=1e-4)
    return FrictionDrive(*map(float, found.x * scale))


def refined(
    drive: FrictionDrive, loop: CascadeLoop, reference: Array, position: Array, *, sampling_period: float
) -> FrictionDrive:
    """The drive whose simulated closed loop is nearest to the measured position: closed-loop output error."""
    scale = drive.vector

    def misses(share: Array) -> Array:
        simulated, _ = closed_loop(
            FrictionDrive(*(share * scale)), loop, reference, sampling_period=sampling_period, start=position[0]
        )
        return (simulated - position) / np.std(position)

    found = least_squares(misses, np.ones(scale.size), x_scale=0.1, diff_step=1e-4)
    return FrictionDrive(*map(float, found.x * scale))


@compiled
def _loop(drive, gains, reference, added, timing):  # type: ignore[no-untyped-def]
    """The carriage under the law of its cascade."""
    kp, kv, force_constant = gains
    period, start = timing
    position, force = np.empty(reference.size), np.empty(reference.size)
    x, velocity, last = start, 0.0, start
    for t in range(reference.size):
        position[t] = x
        force[t] = force_constant * (kv * (kp * (reference[t] - x) - (x - last) / period) + added[t])
        last = x
        x, velocity = _sample_later(drive, force[t], x, velocity, period)
    return position, force


@compiled
def _free(drive, force, timing):  # type: ignore[no-untyped-def]
    """The carriage under a force that is given."""
    period, x = timing
    velocity, position = 0.0, np.empty(force.size)
    for t in range(force.size):
        position[t] = x
        x, velocity = _sample_later(drive, force[t], x, velocity, period)
    return position


@compiled
def _sample_later(drive, force, x, velocity, period):  # type: ignore[no-untyped-def]
    """Position and velocity after semi-implicit steps under a force that is held over the sample."""
    mass, viscous, coulomb, offset = drive
    step = period / SUBSTEPS
    for _ in range(SUBSTEPS):
        # Friction taken at the new velocity, or it would overshoot zero where it is steep.
        steep = coulomb * (1.0 - np.tanh(velocity / CREEP) ** 2) / CREEP
        pull = force - viscous * velocity - coulomb * np.tanh(velocity / CREEP) - offset
        velocity += step * pull / (mass + step * (viscous + steep))
        x += step * velocity
    return x, velocity
