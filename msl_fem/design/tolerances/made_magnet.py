"""The field of a magnet as made: dimensions, iron and stacking off their nominal values, on the nominal mesh moved.

The mesh follows the section: every vertex of the nominal section has its counterpart in the deviating one, and between
them coordinates are mapped linearly along x and along y. So a small deviation changes the discretisation smoothly, and
its errors drop out of differences.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from msl_fem.actuator import ECore
from msl_fem.design.tolerances.deviation import LENGTHS
from msl_fem.errors import ComputationError
from msl_fem.magnetics.kinds.e_core import MagnetField, e_core_section
from msl_fem.magnetics.solver.mesh import TriangleMesh
from msl_fem.magnetics.solver.postprocess import Probes
from msl_fem.magnetics.solver.section import Section
from msl_fem.materials.constants import MU_0
from msl_fem.materials.material import AnalyticIron, Iron, laminated, load_iron

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Nominal:
    """The magnet as drawn and its mesh."""

    magnet: ECore
    mesh: TriangleMesh
    folder: Path
    order: int


def made_field(nominal: Nominal, deviation: Mapping[str, float]) -> MagnetField:
    """The field of the magnet with these deviations but that of the gap; relative for the B-H curve, absolute else.

    Raises
    ------
    ActuatorError, ValueError : dimensions that make no magnet
    """
    magnet = made_magnet(nominal.magnet, deviation)
    drawn, made = e_core_section(nominal.magnet, nominal.mesh.gap), e_core_section(magnet, nominal.mesh.gap)
    mesh = moved_mesh(nominal.mesh, drawn, made)
    field = MagnetField(magnet, mesh, folder=nominal.folder, order=nominal.order)
    polarisation, strength = (deviation.get(name, 0.0) for name in ("bh_polarisation", "bh_field_strength"))
    if polarisation or strength:
        irons = {
            region: laminated(
                scaled_iron(load_iron(name, folder=nominal.folder), 1 + polarisation, 1 + strength), stacking
            )
            for region, (name, stacking) in field.section.iron.items()
        }
        field.irons, field.model = irons, field.model.with_irons(irons)
        field.probes = Probes(field.model, field.section)
    return field


def made_magnet(magnet: ECore, deviation: Mapping[str, float]) -> ECore:
    """The magnet with deviating dimensions and stacking factors; windows and coil keep theirs."""
    content = magnet.model_dump()
    for name in LENGTHS:
        content[name] += deviation.get(name, 0.0)
    off = deviation.get("stacking_factor", 0.0)
    if off:
        iron = magnet.iron
        content["iron"] |= {
            "core_stacking_factor": min(iron.core_stacking + off, 1.0),
            "armature_stacking_factor": min(iron.armature_stacking + off, 1.0),
        }
    return ECore.model_validate(content)


def moved_mesh(mesh: TriangleMesh, drawn: Section, made: Section) -> TriangleMesh:
    """The mesh of one section as that of another with the same topology.

    Raises
    ------
    ComputationError : sections of different topology, or lines that change their order
    """
    points = np.stack([_moved(mesh.points[axis], _lines(drawn, axis), _lines(made, axis)) for axis in (0, 1)])
    return replace(mesh, points=points)


def _lines(section: Section, axis: int) -> Array:
    """Coordinates of the vertices in order, those on the painted box's edges as the whole box's, where they end up."""
    painted = np.array([vertex[axis] for region in section.regions for vertex in region.vertices], dtype=float)
    low, high = painted.min(), painted.max()
    start = section.gap if axis == 1 else 0.0
    lines = np.where(painted == low, low * section.far, painted)
    return np.where(painted == high, start + (high - start) * section.far, lines)


def _moved(coordinate: Array, old: Array, new: Array) -> Array:
    if old.shape != new.shape:
        raise ComputationError("the deviating section has other vertices than the nominal one")
    order = np.lexsort((new, old))
    x, y = old[order], new[order]
    fresh = np.r_[True, np.diff(x) > 1e-9 * np.abs(x).max()]
    first = np.flatnonzero(fresh)
    group = np.cumsum(fresh) - 1
    if np.abs(y - y[first][group]).max() > 1e-9 * np.abs(x).max() or (np.diff(y[first]) <= 0).any():
        raise ComputationError(
            "a deviation parts lines of the section that coincide, or changes their order; make the tolerance smaller"
        )
    return np.asarray(np.interp(coordinate, x[first], y[first]))


def scaled_iron(iron: Iron | AnalyticIron, polarisation: float, strength: float) -> Iron | AnalyticIron:
    """The iron whose polarisation J is `polarisation` times the nominal one's at 1/`strength` times the field strength.

    J'(H) = p J(H / s), B' = J' + mu_0 H: dB/dH stays above mu_0, and J_s scales with p.
    """
    if isinstance(iron, Iron):
        h = strength * iron.field_strength
        b = polarisation * (iron.flux_density - MU_0 * iron.field_strength) + MU_0 * h
        return replace(iron, flux_density=b, field_strength=h)
    return _scaled_formula(iron, polarisation, strength)


def _scaled_formula(iron: AnalyticIron, p: float, s: float) -> AnalyticIron:
    def forward(b: Array) -> tuple[Array, Array, Array, Array]:
        """B' and dB'/dB for B of the nominal iron, with its H and dH/dB."""
        h, slope = iron.magnetise(b)
        return p * (b - MU_0 * h) + s * MU_0 * h, p * (1 - MU_0 * slope) + s * MU_0 * slope, h, slope

    def backward(wanted: Array) -> Array:
        b = wanted / max(p, 1e-12)
        for _ in range(60):
            value, slope, _, _ = forward(b)
            step = (value - wanted) / slope
            b = np.maximum(b - step, 0.0)
            if not b.size or np.abs(step).max() <= 1e-15 * max(np.abs(b).max(), 1e-12):
                break
        return b

    def law(wanted: Array) -> tuple[Array, Array]:
        _, along, h, slope = forward(backward(wanted))
        return s * h, s * slope / along

    def energy_law(wanted: Array) -> Array:
        """The integral of s H dB', dB' = p dB + (s - p) mu_0 dH."""
        b = backward(wanted)
        h = iron.magnetise(b)[0]
        return s * p * iron.energy_density(b) + s * (s - p) * MU_0 * h**2 / 2

    return replace(iron, law=law, energy_law=energy_law, source=f"{iron.source}, J by {p:g}, H by {s:g}")
