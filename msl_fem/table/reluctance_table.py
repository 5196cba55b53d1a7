"""The textbook's magnet as a table: a linear magnetic circuit of two gaps and iron, for comparison.

    lambda = N^2 i/R(g),  W' = N^2 i^2/(2 R),  F = N^2 i^2 R'/(2 R^2),
    R = l/(mu_0 mu_r A_c) + g/(mu_0 A_c) + g/(mu_0 2 A_o)

Roters, Electromagnetic Devices (1941), ch. IV; Gutierrez and Ro, IEEE Trans. Magn. 34(5), 1998, with equal areas.
No fringes, no leakage, no saturation: what people use before a field solution.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from msl_fem.actuator import ECore
from msl_fem.materials.constants import MU_0
from msl_fem.materials.material import AnalyticIron, Iron
from msl_fem.table.magnetic_table import MagneticTable

Array = NDArray[np.float64]
STRAIGHT = 1.2
"""T: up to here the source paper takes the B-H curve as straight, and here its slope from 0 gives mu_r."""
SMALL = 0.1  # of a table's largest current, where its flux linkage is taken as that of unsaturated iron


@dataclass(frozen=True)
class LinearCircuit:
    """Inductance L = scale/(g + offset): scale in H m, offset in m (the iron as a length of air)."""

    scale: float
    offset: float


def circuit_of(magnet: ECore, core: Iron | AnalyticIron, armature: Iron | AnalyticIron) -> LinearCircuit:
    """The magnetic circuit of an E-core; the irons as laminated, so that areas are those of the stack.

    One path: centre leg, yoke, outer leg, back through the armature; each part with the area that its flux has.
    """
    centre = magnet.centre_leg_width * magnet.stack_depth
    outer = 2 * magnet.outer_leg_width * magnet.stack_depth
    gap_per_metre = 1 / centre + 1 / outer
    across = magnet.centre_leg_width / 2 + magnet.window_width + magnet.outer_leg_width / 2
    leg = magnet.window_height + magnet.yoke_thickness / 2
    iron = leg / centre + leg / outer + across / (2 * magnet.yoke_thickness * magnet.stack_depth)
    plate = (across + magnet.armature_thickness) / (2 * magnet.armature_thickness * magnet.stack_depth)
    offset = (iron / _mu_r(core) + plate / _mu_r(armature)) / gap_per_metre
    return LinearCircuit(MU_0 * magnet.coil.turns**2 / gap_per_metre, offset)


def circuit_fitted(table: MagneticTable) -> LinearCircuit:
    """The circuit that a table follows at small currents: least squares of 1/L, weighted to equal relative errors."""
    inductance = np.asarray(table.flux_linkage(SMALL * table.current[-1], table.gap)) / (SMALL * table.current[-1])
    design = np.column_stack([table.gap, np.ones(table.gap.size)]) * inductance[:, None]
    slope, intercept = np.linalg.lstsq(design, np.ones(table.gap.size), rcond=None)[0]
    return LinearCircuit(1 / slope, intercept / slope)


def reluctance_table(circuit: LinearCircuit, gap: ArrayLike, current: ArrayLike) -> MagneticTable:
    """The table of a linear circuit at nodes (n_gap,) in m and (n_current,) in A, the first of them 0; exact."""
    g, i = np.array(gap, dtype=float), np.array(current, dtype=float)
    inductance = circuit.scale / (g + circuit.offset)
    slope, curvature = -inductance / (g + circuit.offset), 2 * inductance / (g + circuit.offset) ** 2
    return MagneticTable(
        gap=g,
        current=i,
        nodes={
            "coenergy": np.outer(inductance, i**2) / 2,
            "flux_linkage": np.outer(inductance, i),
            "force": np.outer(-slope, i**2) / 2,
            "incremental_inductance": np.outer(inductance, np.ones_like(i)),
            "force_current_slope": np.outer(-slope, i),
            "force_gap_slope": np.outer(-curvature, i**2) / 2,
        },
        provenance={"solver": "none: linear magnetic circuit without fringes, leakage and saturation"},
    )


def _mu_r(iron: Iron | AnalyticIron) -> float:
    """Relative permeability of the chord from 0 to STRAIGHT."""
    field_strength, _ = iron.magnetise(np.array([STRAIGHT]))
    return float(STRAIGHT / (MU_0 * field_strength[0]))
