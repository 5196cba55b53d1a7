"""What may deviate in a manufactured magnet and by how much, and its field on the nominal mesh moved.

The mesh follows the section: every vertex of the nominal section has its counterpart in the deviating one, and between
them coordinates are mapped linearly along x and along y. So a small deviation changes the discretisation smoothly, and
its errors drop out of differences.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from msl_fem.actuator import Actuator, MagnetKind
from msl_fem.actuator.tolerances import LENGTHS
from msl_fem.computing.arrays import Array
from msl_fem.errors import ComputationError, InputError
from msl_fem.files.quantity import format_quantity
from msl_fem.magnetics.field.magnet_field import MagnetField
from msl_fem.magnetics.section import Section
from msl_fem.magnetics.sweep.rows import FieldJob
from msl_fem.magnetics.triangles import TriangleMesh
from msl_fem.materials.constants import MU_0
from msl_fem.materials.material import AnalyticIron, Iron, laminated, load_iron

NAMES = ("gap", *LENGTHS, "stacking_factor", "bh_polarisation", "bh_field_strength")
RELATIVE = ("bh_polarisation", "bh_field_strength")
ISO_2768_FINE = ((3e-3, 0.05e-3), (6e-3, 0.05e-3), (30e-3, 0.1e-3), (120e-3, 0.15e-3), (400e-3, 0.2e-3), (1.0, 0.3e-3))
"""Lengths up to (m) and their limits (m): ISO 2768-1, class f."""
GAP_LIMIT, SHEET, STACKING_LIMIT, POLARISATION_LIMIT, FIELD_LIMIT = 20e-6, 0.36e-3, 0.01, 0.02, 0.1
SOURCES = {
    "gap": "faces ground and set by shims: one grade IT7 of ISO 286-1 at 18 ... 30 mm, 21 um, rounded",
    **dict.fromkeys(LENGTHS, "ISO 2768-1, class f, by the length"),
    "stack_depth": "one sheet more or less, 0.36 mm (29 gauge, 0.014 in)",
    "stacking_factor": "chosen: 0.95 ... 0.97 is what coated sheets of 0.35 mm reach; 0 for solid iron",
    "bh_polarisation": "chosen: typical polarisations of producers lie about 2 % above the minima of EN 10106",
    "bh_field_strength": "chosen: batches and cutting stress change the permeability by this much and more",
}


@dataclass(frozen=True)
class ManufacturingTolerance:
    """A quantity's nominal value, its limit plus and minus, both in `unit`, and the limit's source.

    The nominal value of the B-H curve's two factors is 1. The gap's is that of the point it is judged at: None.
    """

    name: str
    nominal: float | None
    limit: float
    unit: str
    source: str


def tolerances_of(
    actuator: Actuator, *, stated: Mapping[str, float] | None = None
) -> tuple[ManufacturingTolerance, ...]:
    """The tolerances of an actuator's magnet: those given, else those of its [tolerances], else defaults.

    Raises
    ------
    InputError : an unknown name, or a limit beyond half of the nominal value
    """
    magnet = actuator.magnet_kind("a tolerance study")
    given = dict(stated or {})
    names = tuple(name for name in NAMES if name not in LENGTHS or name in magnet.TOLERANCED)
    in_files: dict[str, float] = (
        actuator.tolerances.model_dump(exclude_none=True) if actuator.tolerances is not None else {}
    )
    unknown = [name for name in (*given, *in_files) if name not in names]
    if unknown:
        raise InputError(f"tolerance '{unknown[0]}' is unknown; choose from {', '.join(names)}")
    found = []
    for name in names:
        in_file = in_files.get(name)
        default = _default(magnet, name)
        source = SOURCES[name]
        if name in given:
            limit = given[name]
            source = "given"
        elif in_file is not None:
            limit = in_file
            source = actuator.sources.get(f"tolerances.{name}", "[tolerances] of the actuator file")
        else:
            limit = default
        nominal = _nominal(magnet, name)
        unit = "m" if name == "gap" or name in LENGTHS else ""
        _check(name, limit, nominal, unit)
        found.append(ManufacturingTolerance(name, nominal, limit, unit, source))
    return tuple(found)


def _default(magnet: MagnetKind, name: str) -> float:
    if name == "gap":
        return GAP_LIMIT
    if name == "stack_depth":
        return SHEET
    if name in LENGTHS:
        length = float(getattr(magnet, name))
        return next((limit for up_to, limit in ISO_2768_FINE if length <= up_to), 0.5e-3)
    if name == "stacking_factor":
        return STACKING_LIMIT if _nominal(magnet, name) != 1.0 else 0.0
    return POLARISATION_LIMIT if name == "bh_polarisation" else FIELD_LIMIT


def _nominal(magnet: MagnetKind, name: str) -> float | None:
    if name in LENGTHS:
        return float(getattr(magnet, name))
    if name == "stacking_factor":
        return max(magnet.iron.core_stacking, magnet.iron.armature_stacking)
    return None if name == "gap" else 1.0


def _check(name: str, limit: float, nominal: float | None, unit: str) -> None:
    most = 0.5 * nominal if nominal is not None else float("inf")
    if name == "stacking_factor" and nominal is not None:
        most = 1.0 - nominal
    if not 0 <= limit <= most * (1 + 1e-9):
        raise InputError(
            f"tolerance {name} = {format_quantity(limit, unit)} is not allowed; it must be "
            f"0 ... {format_quantity(most, unit)}"
        )


def manufactured_field(
    nominal: FieldJob, deviation: Mapping[str, float], known: MagnetField | None = None
) -> MagnetField:
    """The field of the magnet with these deviations but that of the gap; relative for the B-H curve, absolute else.

    `known` : the nominal magnet's, whose elements serve where its mesh can be moved

    Raises
    ------
    ActuatorError, ValueError : dimensions that make no magnet
    """
    magnet = manufactured_magnet(nominal.magnet, deviation)
    nominal_section = nominal.magnet.section(nominal.mesh.gap)
    deviating = magnet.section(nominal.mesh.gap)
    mesh = moved_mesh(nominal.mesh, nominal_section, deviating) if magnet.TOLERANCED else nominal.mesh
    if known is not None and nominal.mesh.motion is None:
        field = known.of(magnet, mesh.points, end_effects=nominal.end_effects)
    else:
        field = replace(nominal, magnet=magnet, mesh=mesh).field()
    polarisation, strength = (deviation.get(name, 0.0) for name in ("bh_polarisation", "bh_field_strength"))
    if polarisation or strength:
        irons = {
            region: laminated(
                scaled_iron(load_iron(name, folder=nominal.folder), 1 + polarisation, 1 + strength), stacking
            )
            for region, (name, stacking) in field.section.iron.items()
        }
        return field.with_irons(irons)
    return field


def manufactured_magnet(magnet: MagnetKind, deviation: Mapping[str, float]) -> MagnetKind:
    """The magnet with deviating dimensions and stacking factors; windows and coil keep theirs."""
    content = magnet.model_dump()
    for name in magnet.TOLERANCED:
        content[name] += deviation.get(name, 0.0)
    off = deviation.get("stacking_factor", 0.0)
    if off:
        iron = magnet.iron
        content["iron"] |= {
            "core_stacking_factor": min(iron.core_stacking + off, 1.0),
            "armature_stacking_factor": min(iron.armature_stacking + off, 1.0),
        }
    made = type(magnet).model_validate(content)
    return magnet.model_copy(update={name: getattr(made, name) for name in type(made).model_fields})


def moved_mesh(mesh: TriangleMesh, nominal_section: Section, deviating: Section) -> TriangleMesh:
    """The mesh of one section as that of another with the same topology.

    Raises
    ------
    ComputationError : sections of different topology, or lines that change their order
    """
    points = np.stack(
        [_moved(mesh.points[axis], _lines(nominal_section, axis), _lines(deviating, axis)) for axis in (0, 1)]
    )
    return replace(mesh, points=points)


def _lines(section: Section, axis: int) -> Array:
    """Coordinates of the vertices in order, those on the painted box's edges as the whole box's, where they end up."""
    painted = np.array([vertex[axis] for region in section.regions for vertex in region.vertices], dtype=float)
    low = painted.min()
    high = painted.max()
    start = section.gap if axis == 1 else 0.0
    lines = np.where(painted == low, low * section.far, painted)
    return np.where(painted == high, start + (high - start) * section.far, lines)


def _moved(coordinate: Array, old: Array, new: Array) -> Array:
    if old.shape != new.shape:
        raise ComputationError("the deviating section has other vertices than the nominal one")
    order = np.lexsort((new, old))
    x = old[order]
    y = new[order]
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
