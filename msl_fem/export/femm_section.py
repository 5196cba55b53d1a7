"""The section of a magnet as a magnetics problem of FEMM (.fem): outlines, irons with their curves, the coil, A = 0."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from msl_fem.actuator import Actuator
from msl_fem.computing.arrays import Array
from msl_fem.errors import InputError
from msl_fem.export.dxf_section import drawn_gap
from msl_fem.export.plane_graph import distance_to, outlines_of_faces, point_inside, signed_area
from msl_fem.files.whole_file import whole_file
from msl_fem.magnetics.section import Region, Section, both_halves, is_taken_off
from msl_fem.magnetics.solver.mesh import elementary_edges, regions_at
from msl_fem.materials.material import AnalyticIron, Iron, load_iron

CORE, ARMATURE, COIL, AIR = 1, 2, 3, 0
"""Groups of the blocks, and of the outlines around them: FEMM moves an armature and sums its force by its group."""
BEYOND = (0.02, 0.05, 0.1, 0.2, 0.4, 0.8)
"""T beyond a curve's last point: of these the saturated part is written, which FEMM continues straight."""
BY_FORMULA = np.linspace(0.0, 2.6, 105)
"""T: the points of an iron given by a formula."""
WHOLE_TURNS = 1e-6
PER_GAP, NEAR = 3, 1.5
"""Elements of an edge at the gap, over the gap; and how many gaps away from the other iron an edge is at the gap."""
Edge = tuple[int, int, str, str]
"""Points, and the regions to the left and to the right."""


def femm_text(actuator: Actuator, gap: float | None = None, *, current: float = 1.0) -> str:
    """The problem at a gap in m, by default the nominal one, with a current in A in its circuit "coil".

    Lengths are in mm. Both halves of a plane section are drawn, and the radial half of a body of revolution. Blocks of
    the core are of group 1, of the armature 2, of the coil 3; A = 0 on the box that the magnet's own solutions have.

    Source of the format: D. Meeker, FEMM 4.2 User's Manual, and files written by that program.

    Raises
    ------
    ActuatorError : the magnet is not known by its dimensions
    InputError : no gap is given and the actuator states none, the magnet is a mesh, or a block of its coil has no whole
        number of turns
    """
    section = actuator.magnet_kind("a problem of FEMM").section(drawn_gap(actuator, gap))
    whole = _whole(section)
    points, edges = elementary_edges(whole)
    outlines = outlines_of_faces(points, np.array([edge[:2] for edge in edges]))
    inside = [point_inside(outlines, k) for k in range(len(outlines))]
    regions = regions_at(np.array(inside), whole)
    irons = {name: load_iron(iron, folder=actuator.folder) for name, (iron, _) in section.iron.items()}
    names = ["air", "coil", *irons]
    materials = [_material("air", permeability=1.0), _material("coil", permeability=1.0)]
    materials += [_iron(name, irons[name], section.iron[name][1]) for name in irons]
    circuit = {"TotalAmps_re": current, "TotalAmps_im": 0, "CircuitType": 1}
    lines = [
        *_head(section), *_properties("BdryProps", [_boundary()]), *_properties("BlockProps", materials),
        *_properties("CircuitProps", [_property("Circuit", "coil", circuit)]),
        *_geometry(points, edges, outlines, regions, whole), *_counted("NumArcSegments", []),
        *_counted("NumHoles", []), *_labels(outlines, inside, regions, names, whole),
    ]  # fmt: skip
    return "\n".join(lines) + "\n"


def _whole(section: Section) -> Section:
    """Irons, coils and what is cut out of them in one box of air, both halves, coils by the sign of their turns."""
    painted = [_box(section)]
    density: dict[str, float] = {}
    for region in section.regions:
        if region.name not in section.iron and region.name not in section.turns_density and not is_taken_off(region):
            continue
        turns = section.turns_density.get(region.name)
        rings = [np.array(region.vertices)]
        if section.symmetry in ("flux line", "equipotential"):
            rings = both_halves(rings[0])
        for ring, image in zip(rings, (1.0, -1.0 if section.symmetry == "flux line" else 1.0), strict=False):
            name = region.name if turns is None else f"{region.name}{'+' if turns * image > 0 else '-'}"
            if turns is not None:
                density[name] = turns * image
            else:
                name = name if name in section.iron else "air"
            painted.append(Region(name, tuple(map(tuple, ring.tolist()))))
    return replace(section, regions=tuple(painted), turns_density=density)


def _box(section: Section) -> Region:
    """The box of the magnet's own solutions, as far out as their mesh is stretched."""
    x, y = np.array([v for region in section.regions for v in region.vertices]).T
    low, high = section.far * y.min(), section.gap + section.far * (y.max() - section.gap)
    if section.symmetry == "none":
        low, high = y.min(), y.max()
    left = float(x.min()) if section.symmetry in ("axis", "none") else -section.far * float(x.max())
    right = float(x.max()) * (1.0 if section.symmetry == "none" else section.far)
    return Region("air", ((left, float(low)), (right, float(low)), (right, float(high)), (left, float(high))))


def _group(region: str, section: Section) -> int:
    """The group of a region's block; "" is what lies outside the box."""
    if region in section.turns_density:
        return COIL
    if region not in section.iron:
        return AIR
    return ARMATURE if region.startswith("armature") else CORE


def _edge_group(edge: Edge, section: Section) -> int:
    """That of the part on either side, the armature's before the others'."""
    groups = {_group(region, section) for region in edge[2:]}
    return ARMATURE if ARMATURE in groups else max(groups)


def _geometry(points: Array, edges: list[Edge], outlines: list[Array], regions: list[str], whole: Section) -> list[str]:
    """The points and segments, those at the gap with the size of their elements."""
    groups = [_edge_group(edge, whole) for edge in edges]
    point_group = [0] * len(points)
    for edge, group in zip(edges, groups, strict=True):
        for node in edge[:2]:
            point_group[node] = max(point_group[node], group if group != COIL else 0) or group
    facing = {
        own: [ring for ring, region in zip(outlines, regions, strict=True) if _group(region, whole) == other]
        for own, other in ((CORE, ARMATURE), (ARMATURE, CORE))
    }
    rows = []
    for (start, end, *sides), group in zip(edges, groups, strict=True):
        near = group in facing and distance_to(facing[group], (points[start] + points[end]) / 2) < NEAR * whole.size_gap
        size = 1e3 * whole.size_gap / PER_GAP if near else -1
        on_axis = whole.axisymmetric and points[start][0] == points[end][0] == 0.0
        rows.append(_row(start, end, size, int("" in sides and not on_axis), 0, group))
    numbered = [_row(*(1e3 * point), 0, group) for point, group in zip(points, point_group, strict=True)]
    return [*_counted("NumPoints", numbered), *_counted("NumSegments", rows)]


def _labels(
    outlines: list[Array], inside: list[Array], regions: list[str], names: list[str], whole: Section
) -> list[str]:
    """A block label for each face, with the turns of a coil's."""
    rows = []
    for outline, point, region in zip(outlines, inside, regions, strict=True):
        density = whole.turns_density.get(region)
        turns = 1.0 if density is None else density * signed_area(outline)
        if abs(turns - round(turns)) > WHOLE_TURNS * abs(turns):
            raise InputError(f"a block of the coil has {turns:g} turns; FEMM counts whole ones, change coil.turns")
        name = "coil" if density is not None else region
        group, circuit = _group(region, whole), int(density is not None)
        rows.append(_row(*(1e3 * point), names.index(name) + 1, -1, circuit, 0, group, round(turns), 0))
    return _counted("NumBlockLabels", rows)


def _head(section: Section) -> list[str]:
    return [
        "[Format]      =  4.0", "[Frequency]   =  0", "[Precision]   =  1e-008", "[MinAngle]    =  30",
        "[DoSmartMesh] =  1", f"[Depth]       =  {section.depth * 1e3!r}", "[LengthUnits] =  millimeters",
        f"[ProblemType] =  {'axisymmetric' if section.axisymmetric else 'planar'}", "[Coordinates] =  cartesian",
        "[ACSolver]    =  0", "[PrevType]    =  0", '[PrevSoln]    =  ""',
        '[Comment]     =  "Written by msl-fem; force on the armature: group 2"', "[PointProps]   = 0",
    ]  # fmt: skip


def _boundary() -> list[str]:
    zero = ("A_0", "A_1", "A_2", "Phi", "c0", "c0i", "c1", "c1i", "Mu_ssd", "Sigma_ssd", "innerangle", "outerangle")
    return _property("Bdry", "A=0", {"BdryType": 0} | dict.fromkeys(zero, 0))


def _material(name: str, *, permeability: float, fill: float = 1.0, bh: Array | None = None) -> list[str]:
    stated: dict[str, float] = {"Mu_x": permeability, "Mu_y": permeability}
    zero = ("H_c", "H_cAngle", "J_re", "J_im", "Sigma", "d_lam", "Phi_h", "Phi_hx", "Phi_hy", "LamType")
    stated |= dict.fromkeys(zero, 0) | {"LamFill": fill, "NStrands": 0, "WireD": 0}
    points = [] if bh is None else [f"      {b!r}\t{h!r}" for b, h in bh.tolist()]
    stated["BHPoints"] = len(points)
    *head, end = _property("Block", name, stated)
    return [*head, *points, end]


def _iron(name: str, iron: Iron | AnalyticIron, fill: float) -> list[str]:
    """The iron itself, its stacking factor beside it: FEMM homogenises sheets in the plane as `laminated` does."""
    if iron.name.startswith("linear:"):
        return _material(name, permeability=float(iron.name.removeprefix("linear:")), fill=fill)
    b = BY_FORMULA if isinstance(iron, AnalyticIron) else iron.flux_density
    beyond = b[-1] + np.array(BEYOND)
    curve = np.r_[b, beyond], np.r_[iron.magnetise(b)[0], iron.magnetise(beyond)[0]]
    return _material(name, permeability=1.0, fill=fill, bh=np.column_stack(curve))


def _property(kind: str, name: str, numbers: Mapping[str, float]) -> list[str]:
    """One entry of a list of properties."""
    rows = [f"    <{key}> = {value!r}" for key, value in numbers.items()]
    return [f"  <Begin{kind}>", f'    <{kind}Name> = "{name}"', *rows, f"  <End{kind}>"]


def _counted(key: str, rows: list[str]) -> list[str]:
    return [f"[{key}] = {len(rows)}", *rows]


def _properties(key: str, entries: list[list[str]]) -> list[str]:
    return [f"[{key}]  = {len(entries)}", *(line for entry in entries for line in entry)]


def _row(*values: float) -> str:
    return "\t".join(repr(int(v)) if float(v).is_integer() else repr(float(v)) for v in values)


def write(actuator: Actuator, target: Path, *, name: str | None = None) -> tuple[Path, ...]:
    """The file written at the nominal gap. Raises as `femm_text`, and InputError where it cannot be written."""
    return write_femm(femm_text(actuator), target)


def write_femm(text: str, target: Path) -> tuple[Path, ...]:
    """The file of a problem's text, whole or not at all; InputError where it cannot be written."""
    with whole_file(target) as partial:
        partial.write_text(text, encoding="ascii", newline="\n")
    return (target,)
