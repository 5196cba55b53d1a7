"""A magnet from a magnetics problem of FEMM: its section, irons and coil become a mesh, curves and an actuator file."""

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.errors import InputError
from msl_fem.export.femm_file import MIXED, PERIODIC, PRESCRIBED, FemmMaterial, FemmProblem, read_femm
from msl_fem.export.outlined_magnet import DrawnMagnet, Pull, magnet_of_outlines
from msl_fem.export.plane_graph import encloses, face_at, outlines_of_faces, signed_area
from msl_fem.magnetics.section import Region

IN_PLANE, ALONG = (0,), (1, 2)
"""<LamType> of sheets in the plane of the drawing, and of sheets that run along x or y in it."""
SAME_DENSITY = 1e-3
"""Relative difference of turns per area that are the same."""


@dataclass(frozen=True, eq=False)
class _Part:
    """A face: its outline in m, its name as `magnet_of_outlines` takes it, its material, its signed turns."""

    outline: Array
    name: str
    material: FemmMaterial
    turns: float = 0.0


def magnet_from_femm(
    problem: str | Path,
    target: str | Path,
    *,
    armature: int,
    pull: Pull,
    circuits: tuple[str, ...] | None = None,
) -> Path:
    """Writes an actuator file of the kind "mesh" to `target` (.toml), its mesh and the irons' curves beside it.

    The problem is plane, static and of the whole section, without permanent magnets. Blocks of one circuit, or of
    several in series, become the coil: positive turns carry the circuit's current out of the plane. An outer boundary
    with A = 0 is kept; layers and mixed conditions that stand for open space give way to air.

    Parameters
    ----------
    problem : a .fem file, or an .ans file, whose solution is not read
    armature : the group of the block labels of what moves
    pull : the direction in which the armature is attracted, "+x", "-x", "+y" or "-y"
    circuits : names of those that make up the coil; without, all, whose currents are then equal or all 0

    Raises
    ------
    InputError : the file cannot be read, or its problem is none that a mesh describes; the message says which property
    """
    stated = read_femm(problem)
    _refuse_what_no_mesh_describes(stated, problem)
    parts, box = _parts(stated, armature, circuits, problem)
    core, moved = (_iron(parts, kind, Path(target), problem) for kind in ("core", "armature"))
    drawn = DrawnMagnet(
        turns=_turns(parts, problem), stack_depth=stated.depth, core=core.name, armature=moved.name,
        stacking_factor=core.fill, armature_stacking_factor=moved.fill, pull=pull,
    )  # fmt: skip
    outlines = [Region(part.name, tuple(map(tuple, part.outline.tolist()))) for part in parts]
    gap, source = _clearance(parts, pull, problem), f"FEMM, {Path(problem).name}"
    curves = {one.name: one.curve for one in (core, moved) if one.curve}
    return magnet_of_outlines(outlines, target, drawn, gap=gap, source=source, box=box, beside=curves)


def _refuse_what_no_mesh_describes(problem: FemmProblem, path: str | Path) -> None:
    kind, frequency = problem.head.get("problemtype", "planar").lower(), float(problem.head.get("frequency", "0"))
    if kind != "planar":
        raise InputError(f"{path}: the problem is {kind}; a mesh is a plane section, describe the magnet by dimensions")
    if frequency != 0:
        raise InputError(f"{path}: the frequency is {frequency:g} Hz; a table is of static fields, set it to 0")
    for place in set(problem.edge_boundary.tolist()) - {-1}:
        stated = problem.boundaries[place]
        if int(stated["BdryType"]) in PERIODIC:
            raise InputError(f"{path}: a boundary repeats the section periodically; draw the whole section")
        if int(stated["BdryType"]) == PRESCRIBED and any(stated.get(key, 0.0) for key in ("A_0", "A_1", "A_2")):
            raise InputError(f"{path}: a boundary has A other than 0; let the coil alone make the field")
    for label in problem.labels:
        if label.material is None:
            raise InputError(f"{path}: the block at {_place(label.point)} is left without a mesh; give it a material")
        _refuse_material(problem.materials[label.material], path)


def _refuse_material(material: FemmMaterial, path: str | Path) -> None:
    number = material.number
    wrong = [
        (number("H_c") != 0, "is a permanent magnet, which no table has"),
        (number("J_re") != 0, "carries a current density of its own; give its block a circuit with turns"),
        (not material.bh.size and number("Mu_x", 1) != number("Mu_y", 1), "conducts flux differently along x and y"),
        (int(number("LamType")) in ALONG and number("LamFill", 1) < 1, "has sheets along x or y in the plane"),
    ]
    for found, said in wrong:
        if found:
            raise InputError(f"{path}: the material {material.name} {said}")


def _place(point: tuple[float, float]) -> str:
    return f"x = {point[0] * 1e3:g} mm, y = {point[1] * 1e3:g} mm"


def _parts(
    problem: FemmProblem, armature: int, circuits: tuple[str, ...] | None, path: str | Path
) -> tuple[list[_Part], Region | None]:
    """The faces in the order of painting, and the outline on which A = 0; None for open space."""
    faces = outlines_of_faces(problem.points, problem.edges)
    signs = _current_signs(problem, circuits, path)
    labelled: dict[int, _Part] = {}
    for label in problem.labels:
        face = face_at(faces, np.array(label.point))
        if face is None:
            raise InputError(f"{path}: the block label at {_place(label.point)} lies in no closed outline")
        assert label.material is not None
        material = problem.materials[label.material]
        turns = label.turns * signs.get(label.circuit, 0.0) if label.circuit is not None else 0.0
        iron = "armature" if label.group == armature else "core"
        name = ("coil_plus" if turns > 0 else "coil_minus") if turns else iron if material.magnetic else "air"
        labelled.setdefault(face, _Part(faces[face], name, material, turns))
    if len(labelled) < len(faces):
        face = next(k for k in range(len(faces)) if k not in labelled)
        x, y = faces[face].mean(axis=0)
        raise InputError(f"{path}: the outline around {_place((x, y))} has no block label; give it one")
    parts = [labelled[k] for k in range(len(faces))]
    for kind in ("core", "armature", "coil_plus", "coil_minus"):
        if not any(part.name == kind for part in parts):
            groups = ", ".join(str(g) for g in sorted({label.group for label in problem.labels}))
            raise InputError(f"{path}: there is no {kind}; the armature is group {armature}, of the groups {groups}")
    return _within_open_space(problem, parts, path)


def _current_signs(problem: FemmProblem, names: tuple[str, ...] | None, path: str | Path) -> dict[int, float]:
    """Index of a circuit to the sign of its current in the coil."""
    known = [circuit.name for circuit in problem.circuits]
    if missing := [name for name in names or () if name not in known]:
        raise InputError(f"{path}: there is no circuit {missing[0]}; there is {', '.join(known) or 'none'}")
    chosen = {k: c for k, c in enumerate(problem.circuits) if names is None or c.name in names}
    used = {label.circuit for label in problem.labels}
    chosen = {k: c for k, c in chosen.items() if k in used}
    if not chosen:
        raise InputError(f"{path}: no block belongs to a circuit; the coil is a circuit with turns")
    if parallel := [c.name for c in chosen.values() if not c.series]:
        raise InputError(f"{path}: the circuit {parallel[0]} is in parallel; turns in series make a coil")
    currents = {c.current for c in chosen.values()}
    if len({abs(current) for current in currents}) > 1:
        listed = ", ".join(f"{c.name} {c.current:g} A" for c in chosen.values())
        raise InputError(f"{path}: circuits in one coil have one current, these have {listed}; name those of the coil")
    return {k: -1.0 if c.current < 0 else 1.0 for k, c in chosen.items()}


def _within_open_space(problem: FemmProblem, parts: list[_Part], path: str | Path) -> tuple[list[_Part], Region | None]:
    """The parts without the layers that stand for open space, and the outer boundary where A = 0 lies on one."""
    solid = [part for part in parts if part.name.startswith("coil") or part.name == "armature"]
    around = [all(encloses(part.outline, other.outline[0]) for other in solid if other is not part) for part in parts]
    constant = [not part.material.bh.size and part.material.number("Mu_x", 1.0) != 1.0 for part in parts]
    mixed = any(int(problem.boundaries[k]["BdryType"]) == MIXED for k in set(problem.edge_boundary.tolist()) if k >= 0)
    if mixed or any(np.logical_and(around, constant)):  # open space
        return [p for k, p in enumerate(parts) if not (around[k] and (constant[k] or p.name == "air"))], None
    if parts[0].name != "air" or not _has_no_potential(problem, parts[0].outline):
        raise InputError(
            f"{path}: the outer boundary is not air with A = 0 all around; draw the whole section, in a box with A = 0"
        )
    return parts[1:], Region("air", tuple(map(tuple, parts[0].outline.tolist())))


def _has_no_potential(problem: FemmProblem, outline: Array) -> bool:
    """Whether every edge of an outline has the boundary condition A = 0."""
    fixed = [k for k, stated in enumerate(problem.boundaries) if int(stated["BdryType"]) == PRESCRIBED]
    ends = problem.points[problem.edges[np.isin(problem.edge_boundary, fixed)]]
    middles = ends.mean(axis=1)
    sides = (outline + np.roll(outline, -1, axis=0)) / 2
    size = float(np.ptp(outline, axis=0).max())
    return all(bool((np.hypot(*(middles - side).T) < 1e-9 * size).any()) for side in sides)


class _Iron(NamedTuple):
    """The name of a part's iron in an actuator file, its stacking factor, the text of its curve's file, "" of none."""

    name: str
    fill: float
    curve: str = ""


def _iron(parts: list[_Part], kind: str, target: Path, path: str | Path) -> _Iron:
    """The iron of the parts of a kind, its curve in a file beside the target."""
    materials = {id(part.material): part.material for part in parts if part.name == kind}
    if len(materials) > 1:
        names = ", ".join(sorted(m.name for m in materials.values()))
        raise InputError(f"{path}: the {kind} is of several materials, {names}; a mesh's {kind} has one")
    material = next(iter(materials.values()))
    fill = material.number("LamFill", 1.0) if int(material.number("LamType")) in IN_PLANE else 1.0
    if not material.bh.size:
        return _Iron(f"linear:{material.number('Mu_x', 1.0):g}", fill)
    rows = [f"{h!r},{b!r}" for b, h in material.bh.tolist()]
    return _Iron(f"{target.stem}_{kind}.csv", fill, "\n".join(["H_A_per_m,B_T", *rows]) + "\n")


def _turns(parts: list[_Part], path: str | Path) -> int:
    """Of the coil: those of its blocks out of the plane, which are as many as those into it."""
    total = {}
    for kind in ("coil_plus", "coil_minus"):
        own = [(abs(part.turns), signed_area(part.outline)) for part in parts if part.name == kind]
        density = np.array([turns / area for turns, area in own])
        if np.ptp(density) > SAME_DENSITY * density.max():
            raise InputError(f"{path}: blocks of the coil have different turns per area; a mesh's coil has one")
        total[kind] = sum(turns for turns, _ in own)
    if total["coil_plus"] != total["coil_minus"]:
        raise InputError(
            f"{path}: {total['coil_plus']:g} turns go out of the plane and {total['coil_minus']:g} into it; draw the "
            "whole section"
        )
    return int(total["coil_plus"])


def _clearance(parts: list[_Part], pull: Pull, path: str | Path) -> float:
    """m from the armature along the pull to what it meets first of the core."""
    turn = {"+y": 1, "-y": -1, "+x": 1j, "-x": -1j}[pull]
    rings: dict[str, list[Array]] = {"core": [], "armature": []}
    for part in parts:
        if part.name in rings:
            turned = (part.outline[:, 0] + 1j * part.outline[:, 1]) * turn
            rings[part.name].append(np.column_stack([turned.real, turned.imag]))
    below = [_heights(own, rings["core"], 1.0) for own in rings["armature"]]
    above = [_heights(own, rings["armature"], -1.0) for own in rings["core"]]
    gap = float(min(height.min(initial=np.inf) for height in (*below, *above)))
    if not np.isfinite(gap):
        raise InputError(f"{path}: towards {pull} the armature meets no core; state where it is pulled to")
    return float(f"{gap:.9g}")


def _heights(own: Array, others: list[Array], side: float) -> Array:
    """How far above (`side` 1) or below (-1) the middle of each edge of an outline another outline is met."""
    heights = []
    for x, y in (own + np.roll(own, -1, axis=0)) / 2:
        for ring in others:
            (x0, y0), (x1, y1) = ring.T, np.roll(ring, -1, axis=0).T
            crossed = (x0 > x) != (x1 > x)
            with np.errstate(divide="ignore", invalid="ignore"):
                height = side * (y0 + (x - x0) * (y1 - y0) / (x1 - x0) - y)
            heights.append(height[crossed & (height > 0)])
    return np.concatenate(heights) if heights else np.empty(0)
