"""The authors' own law of the MR damper fitted to the runs that a diagnosis fits: the bound of its friction's error.

Dahl's law, force = offset + viscous v + friction w, dw/dt = rho (v - |v| w) (P. R. Dahl, AIAA J. 14, 1976, 1675-1682),
on the force as read, without the runs' first two seconds. All but rho is linear; rho is looked for on a grid of a fifth
of an octave.
"""

from dataclasses import dataclass

import numpy as np
from scipy.signal import butter, sosfiltfilt

from msl_fem.computing.arrays import Array
from msl_fem.computing.compiled import compiled

BEGIN, EDGE = 2.0, 0.5  # s before the motion, and at the ends that the position's filter bends
CUTOFF = 25.0  # Hz of the position, whose steps are 5 um
TRAVELS = np.geomspace(5e-6, 1e-3, 40)
SLIDING = 0.5
"""Of the largest speed: from 0.5 to 0.7 the mean friction of a voltage changes by 3 % at most."""


@dataclass(frozen=True)
class DahlLaw:
    """Viscous (N s/m), friction (N), travel 1/rho (m), offset (N); RMS error over the force's standard deviation."""

    viscous: float
    friction: float
    travel: float
    offset: float
    error: float


def fitted_law(runs: list[tuple[Array, Array]], period: float) -> DahlLaw:
    """The law nearest to positions (m) and forces (N) of several runs, by least squares."""
    laws = [_with_travel(runs, period, travel) for travel in TRAVELS]
    return min(laws, key=lambda law: law.error)


def error_of(
    runs: list[tuple[Array, Array]], period: float, *, viscous: float, friction: float, travel: float
) -> float:
    """RMS error over the force's standard deviation of the law with these values, the best offset for each run."""
    left, forces = [], []
    for position, force in runs:
        kept = slice(round(BEGIN / period), force.size - round(EDGE / period))
        smooth = sosfiltfilt(butter(4, CUTOFF, fs=1 / period, output="sos"), position)
        missed = (force - viscous * np.gradient(smooth, period) - friction * bristle(smooth, travel))[kept]
        left.append(missed - missed.mean())
        forces.append(force[kept])
    return float(np.sqrt(np.mean(np.concatenate(left) ** 2)) / np.std(np.concatenate(forces)))


def _with_travel(runs: list[tuple[Array, Array]], period: float, travel: float) -> DahlLaw:
    rows, forces = [], []
    for position, force in runs:
        kept = slice(round(BEGIN / period), force.size - round(EDGE / period))
        smooth = sosfiltfilt(butter(4, CUTOFF, fs=1 / period, output="sos"), position)
        columns = np.column_stack([np.gradient(smooth, period), bristle(smooth, travel), np.ones(force.size)])
        rows.append(columns[kept])
        forces.append(force[kept])
    matrix, right = np.vstack(rows), np.concatenate(forces)
    (viscous, friction, offset), *_ = np.linalg.lstsq(matrix, right, rcond=None)
    left = right - matrix @ np.array([viscous, friction, offset])
    error = float(np.sqrt(np.mean(left**2)) / np.std(right))
    return DahlLaw(float(viscous), float(friction), travel, float(offset), error)


@compiled
def bristle(position: Array, travel: float) -> Array:
    """w of Dahl's law along a path (n_sample,), exact between samples; 0 in the beginning."""
    w = np.zeros(position.size)
    for n in range(1, position.size):
        change = position[n] - position[n - 1]
        towards = np.sign(change)
        w[n] = towards + (w[n - 1] - towards) * np.exp(-abs(change) / travel)
    return w


def sliding_line(position: Array, force: Array, period: float) -> tuple[float, float]:
    """(viscous N s/m, friction N) of the straight line that Dahl's law becomes where the damper slides, w = 1 or -1:
    least squares over the samples of at least `SLIDING` of the largest speed, with a constant force beside."""
    kept = slice(round(BEGIN / period), force.size - round(EDGE / period))
    smooth = sosfiltfilt(butter(4, CUTOFF, fs=1 / period, output="sos"), position)
    velocity = np.gradient(smooth, period)[kept]
    fast = np.abs(velocity) >= SLIDING * np.percentile(np.abs(velocity), 99)
    rows = np.column_stack([velocity, np.sign(velocity), np.ones(velocity.size)])[fast]
    (viscous, friction, _), *_ = np.linalg.lstsq(rows, force[kept][fast], rcond=None)
    return float(viscous), float(friction)
