"""The fixed step of a run, from the fastest rates of drive, mover and what is hidden."""

import math

import numpy as np

from msl_fem.bench.diffusion import fastest_ladder_rate
from msl_fem.bench.plant import VOLTAGE_DRIVE, Plant
from msl_fem.errors import InputError
from msl_fem.files.quantity import format_quantity
from msl_fem.table.magnetic_table import MagneticTable

STEP_OF_DRIVE, STEP_OF_PIECES, MOST_SUBSTEPS = 0.22, 0.8, 400


def default_substeps(plant: Plant, table: MagneticTable | None, *, rate: float) -> int:
    """Steps a sample such that a step times the fastest rate of drive and mover is at most 0.22, of all else 0.8.

    Raises
    ------
    InputError : more than 400 steps a sample
    """
    c, m = plant.circuit, plant.motion
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
    wanted = max(max(slow) / STEP_OF_DRIVE, max(fast) / STEP_OF_PIECES) / rate
    if not wanted <= MOST_SUBSTEPS:
        raise InputError(
            f"the fastest rate needs {wanted:.3g} steps a sample at {format_quantity(rate, 'Hz')}, at most "
            f"{MOST_SUBSTEPS} are taken; sample faster, or look at mass, stiffness and bandwidth"
        )
    return max(1, math.ceil(wanted - 1e-9))


def _mechanical_rates(plant: Plant) -> list[float]:
    """Fastest rates in 1/s of the mechanical pieces that are on."""
    found = [float(plant.flexure.branch_rate.max())]
    if plant.support.mass > 0:
        found.append(math.sqrt(plant.support.stiffness / plant.support.mass))
    if plant.attached.share > 0:
        found.append(plant.attached.frequency / math.sqrt(1 - plant.attached.share))
    f = plant.friction
    if f.coulomb > 0:  # at the mover's largest speed; the bristles as a spring in parallel to the mover's
        reach = min(plant.motion.travel, 1e-3)
        speed = 0.2 * reach * math.sqrt(max(plant.motion.stiffness, 1.0) / plant.motion.mass)
        found += [f.bristle_stiffness * speed / f.coulomb, math.sqrt(f.bristle_stiffness / plant.motion.mass)]
    return found
