"""Runs in which a machine or a hand moves a driven magnet: the map that is measured along their path.

What the machine reads and what inertia, damper and spring take leave the magnet's force:

    magnets F(i, g) = m x'' + d x' + k x - F_read - F_constant,   g = nominal gap - x

so each run is rows of a static map, in the order of its time. Positions, currents and forces pass one filter (A.
Savitzky, M. Golay, Anal. Chem. 36, 1964, 1627-1639; cubic), of which also velocity and acceleration are; rows stand one
filter apart, so that their noise is independent. What mass, damping and stiffness are not known by widens each row's
sigma. Eddy currents are not in it: the motion and the current have to be slower than they are.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import savgol_coeffs, savgol_filter

from msl_fem.computing.arrays import Array
from msl_fem.errors import InputError
from msl_fem.plant import PlantParameters, plant_parameters
from msl_fem.record import Record, Run, StaticMap
from msl_fem.table.magnetic_table import MagneticTable

ROWS = 400
"""Of a run, at most."""
ORDER, SHORTEST = 3, 7  # of the filter: its polynomial, samples


@dataclass(frozen=True, eq=False)
class _Rows:
    """(n_row,) gap, current, force of one magnet, one sigma of it."""

    gap: Array
    current: Array
    force: Array
    sigma: Array


def with_imposed_maps(record: Record, table: MagneticTable | None) -> tuple[Record, tuple[str, ...]]:
    """The record with the runs of imposed motion of a magnet as rows of its static map, and what was made of them.

    Raises
    ------
    InputError : the record has a static map of its own beside them
    """
    p = plant_parameters(record.actuator) if record.runs else None
    moved = [run for run in record.runs if run.mover == "imposed"]
    if not moved or p is None or p.sides == 0 or table is None:
        return record, ()
    if record.static is not None:
        raise InputError(
            f"run {moved[0].name}: its imposed motion is a map of the magnet, and static.csv is another; make a record "
            "of each"
        )
    parts = [_rows_of(run, record, p, table) for run in moved]
    counts = [part.gap.size for part in parts]
    sigma = np.concatenate([part.sigma for part in parts])
    static = StaticMap(
        np.concatenate([part.gap for part in parts]),
        np.concatenate([part.current for part in parts]),
        np.concatenate([part.force for part in parts]),
        None,
        np.repeat(np.array([run.role for run in moved]), counts),
        sequence=np.repeat(np.arange(float(len(moved))), counts),
        gap_zero="mover",
        sigma={"force_N": sigma} if (sigma > 0).all() else {},
    )
    names = ", ".join(run.name for run in moved)
    told = f"{names}: a map of {sum(counts)} rows along the imposed motion; eddy currents are not in it"
    runs = tuple(run for run in record.runs if run.mover != "imposed")
    return replace(record, runs=runs, static=static), (told,)


def _rows_of(run: Run, record: Record, p: PlantParameters, table: MagneticTable) -> _Rows:
    """The rows of a run, one filter apart."""
    length = max(SHORTEST, run.time.size // ROWS) | 1
    period, at = run.sampling_period, np.arange(length // 2, run.time.size - length // 2, length)

    def filtered(column: str, order: int = 0) -> Array:
        return np.asarray(savgol_filter(run[column], length, ORDER, deriv=order, delta=period)[at])

    x, v, a = (filtered("position_m", order) for order in range(3))
    current, mechanical = filtered("current_1_A"), (p.mass * a, p.damping * v, p.stiffness * x)
    force = (sum(mechanical) - filtered("force_N") - p.constant_force) / p.magnets
    tolerance, noise = record.tolerance, record.noise
    known = (tolerance.moving_mass, tolerance.damping, tolerance.stiffness)
    gap = p.nominal_gap - x
    slope = table.evaluate(current, np.clip(gap, table.gap[0], table.gap[-1]))["force_gap_slope"]
    passed = float(np.linalg.norm(savgol_coeffs(length, ORDER)))
    bent = float(np.linalg.norm(savgol_coeffs(length, ORDER, deriv=2, delta=period))) * p.mass
    by_position = np.hypot(np.nan_to_num(slope) * passed, bent / p.magnets) * (noise.position or 0.0)
    unknown = [share * part / p.magnets for share, part in zip(known, mechanical, strict=True)]
    read = passed * (noise.force or 0.0) / p.magnets
    sigma = np.sqrt(read**2 + by_position**2 + sum(part**2 for part in unknown))
    return _Rows(gap, current, force, sigma if noise.force else np.zeros(gap.size))
