"""A section to a triangle mesh with named regions, graded at the corners where the field is singular."""

import pickle
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

import numpy as np
from netgen.geom2d import SplineGeometry
from netgen.meshing import MeshingParameters, NgException

from msl_fem.computing.arrays import Array
from msl_fem.errors import ComputationError, InputError
from msl_fem.magnetics.section import Section
from msl_fem.magnetics.triangles import TriangleMesh, single_edges

TOLERANCE = 1e-9  # of the box: two vertices closer than this are one
LAYER_RATIO = 1.4  # of a far-field layer's outer to its inner outline
GAPS = {"strip", "gap"}  # regions of air whose edges at iron are meshed in fractions of the gap
MOST_TRIANGLES = 250_000
"""Of a mesh: about half a million unknowns of second degree."""
AROUND = 4.0
"""Triangles in a foil and in the air beside it, over those in the foil: measured."""
PER_EDGE = 4.0
"""Triangles for each element of an edge at the gap."""
GROWTH_CHANGES = (1.0, 0.94, 1.06, 0.88, 1.13, 0.8, 1.2, 0.7)


@dataclass(frozen=True)
class MeshSize:
    """Element sizes, as fractions of the section.

    Attributes
    ----------
    corner : size at the corners that face the gap, of the gap
    gap : largest size in the strip under the iron, of the gap
    iron : largest size in an iron region, of the thinnest one, or of its own thinnest part if thicker
    growth : of the size by the distance from a corner; along an edge each element is 1 + growth times the last
    across : size on the other face of the gap where it is nearest to a corner, of the gap; None leaves it to `growth`.
        It takes care of gaps that are smaller than the mesh's own, where fast growth would leave too little there
    """

    corner: float = 0.02
    gap: float = 1.0
    iron: float = 0.5
    growth: float = 0.35
    across: float | None = None


def triangulate(section: Section, size: MeshSize | None = None) -> TriangleMesh:
    """A conforming mesh of the section; the last ones are kept, and one of them is that of an equal section and size.

    The mesher's advancing front gets stuck on about one section in a hundred; it is then tried again with sizes that
    grow a little faster or slower.

    Raises
    ------
    ComputationError : the mesher gave up on every attempt
    InputError : more than `MOST_TRIANGLES` are expected
    """
    size = size or MeshSize()
    refuse_too_many(section, size)
    return _meshed(_Wanted(pickle.dumps((section, size)), section, size))


@dataclass(frozen=True)
class _Wanted:
    """A section and a size, compared by their content."""

    content: bytes
    section: Section = field(compare=False)
    size: MeshSize = field(compare=False)


@lru_cache(maxsize=16)
def _meshed(wanted: _Wanted) -> TriangleMesh:
    """The mesh of one attempt or another; raises as `triangulate`."""
    section, size = wanted.section, wanted.size
    for change in GROWTH_CHANGES:
        try:
            return _triangulate(section, replace(size, growth=size.growth * change))
        except NgException as err:
            reason = err
    raise ComputationError(
        f"the mesher failed {len(GROWTH_CHANGES)} times on the section at gap {section.gap * 1e3:g} mm ({reason}); "
        "change a dimension slightly, or choose another accuracy"
    ) from reason


def _triangulate(section: Section, size: MeshSize) -> TriangleMesh:
    """One attempt; raises netgen's NgException."""
    vertices, edges = elementary_edges(section)
    at_corner = _corner_sizes(section, size, vertices)
    largest_in = _iron_sizes(section, size)
    box = float(np.abs(vertices).max())
    scale = box  # netgen works best on sizes near one
    geometry = SplineGeometry()
    for k, (x, y) in enumerate(vertices):
        # The strip's ends and other plain points take their size from the surroundings.
        geometry.AppendPoint(x / scale, y / scale, maxh=at_corner.get(k, 1e9) / scale)
    names = tuple(dict.fromkeys(r.name for r in section.regions))
    for start, end, left, right in edges:
        at_gap = {left, right} & GAPS and {left, right} & (section.iron.keys() | {"window"})
        between = _graded(vertices[start], vertices[end], (at_corner.get(start), at_corner.get(end)), size.growth)
        chain = [start, *(geometry.AppendPoint(x / scale, y / scale) for x, y in between), end]
        for a, b in zip(chain[:-1], chain[1:], strict=True):
            geometry.Append(
                ["line", a, b],
                leftdomain=names.index(left) + 1 if left else 0,
                rightdomain=names.index(right) + 1 if right else 0,
                bc="inner" if left and right else "box",
                maxh=size.gap * section.size_gap / scale if at_gap else 1e9,
            )
    for k, name in enumerate(names):
        geometry.SetMaterial(k + 1, name)
        geometry.SetDomainMaxH(k + 1, largest_in.get(name, 0.15 * box) / scale)
    # Triangles in a plane do not overlap as those of folded surfaces may: the check is a tenth of the mesher's time.
    limits = MeshingParameters(maxh=0.2, grading=size.growth, checkoverlap=False)
    if size.across is not None and section.moving is None:
        for x, y in _across_gap(section):
            limits.RestrictH(x / scale, y / scale, 0.0, size.across * section.size_gap / scale)
    mesh = geometry.GenerateMesh(limits)
    found = _from_netgen(mesh, scale, names, section.gap)
    return found if section.moving is not None else _surrounded(_on_strip(found, scale), section.far)


def _iron_sizes(section: Section, size: MeshSize) -> dict[str, float]:
    """Largest element size in m by iron region.

    All iron takes that of the thinnest region, unless its own parts are thicker: with the size of an armature's foil a
    core would have as many elements as its area holds squares of the foil's thickness.
    """
    boxes = {
        r.name: float(min(np.ptp(np.array(r.vertices), axis=0))) for r in section.regions if r.name in section.iron
    }
    thinnest = min(boxes.values())
    own = {name: min(box, section.thinnest_in(name) or 0.0) for name, box in boxes.items()}
    return {name: size.iron * max(thinnest, own[name]) for name in boxes}


def refuse_too_many(section: Section, size: MeshSize) -> None:
    """InputError where the mesh would be larger than what is solved, with the part that makes it so.

    Expected are equilateral triangles of the largest size in the iron, as many again beside it as are usual, and along
    the iron's edges at the gap some of the size there; what the grading adds at corners is a few thousand.
    """
    counts: dict[str, float] = {}
    sizes = _iron_sizes(section, size)
    for region in section.regions:
        if region.name in sizes:
            width, height = np.ptp(np.array(region.vertices), axis=0)
            counts[region.name] = AROUND * width * height / (np.sqrt(3) / 4 * sizes[region.name] ** 2)
            at_gap = PER_EDGE * width / (size.gap * section.gap)
            counts["gap"] = counts.get("gap", 0.0) + at_gap
    total = sum(counts.values())
    if total > MOST_TRIANGLES:
        name = max(counts, key=counts.__getitem__)
        thin = section.gap if name == "gap" else sizes[name] / size.iron
        raise InputError(
            f"the section needs about {total:.2g} triangles, at most {MOST_TRIANGLES:.2g} are solved: most are for the "
            f"{name}, {thin * 1e3:.3g} mm thin; make it thicker, or what is as wide narrower"
        )


def _corner_sizes(section: Section, size: MeshSize, vertices: Array) -> dict[int, float]:
    """Element size at each vertex that is a corner to grade to, in m."""
    sizes = {}
    for x, y, strength in section.corners:
        k = int(np.argmin(np.hypot(vertices[:, 0] - x, vertices[:, 1] - y)))
        sizes[k] = size.corner * section.size_gap / strength**1.5
    return sizes


def _across_gap(section: Section) -> list[tuple[float, float]]:
    """The points of a face of the gap that lie opposite a corner of the other."""
    near = TOLERANCE * section.gap
    on_a_face = [(x, y) for x, y, _ in section.corners if min(abs(y), abs(y - section.gap)) <= near]
    return [(x, section.gap - y) for x, y in on_a_face]


def _graded(start: Array, end: Array, sizes: tuple[float | None, float | None], growth: float) -> Array:
    """Points (n, 2) inside an edge whose distances grow from the sizes at its ends by 1 + `growth`, None: no size.

    The mesher finds an edge's sizes by sampling it, and can step over those at a corner; these points do not let it.
    """
    along = end - start
    length = float(np.linalg.norm(along))
    reach = length / 2 if None not in sizes else length
    places = [np.empty(0)]
    for size, backwards in zip(sizes, (False, True), strict=True):
        if size is not None:
            n = max(1, round(np.log1p(growth * reach / size) / np.log1p(growth)))
            series = np.expm1(np.log1p(growth) * np.arange(1, n + 1))
            place = reach * series / series[-1]
            place = place[:-1] if backwards or reach == length else place  # the middle once, the far end not at all
            places.append(length - place[::-1] if backwards else place)
    return start + np.concatenate(places)[:, None] * along / length


def _from_netgen(mesh: Any, scale: float, names: tuple[str, ...], gap: float) -> TriangleMesh:
    points = np.array(mesh.Coordinates(), dtype=float)[:, :2].T * scale
    elements = mesh.Elements2D().NumPy()
    triangles = elements["nodes"][:, :3].T.astype(np.int64) - 1
    region = elements["index"].astype(np.int64) - 1
    return TriangleMesh(points, triangles, region, names, gap)


def _on_strip(mesh: TriangleMesh, scale: float) -> TriangleMesh:
    """The mesh with points exactly on the strip's edges, whatever the mesher's rounding."""
    points = mesh.points.copy()
    for line in (0.0, mesh.gap):
        near = np.abs(points[1] - line) < TOLERANCE * scale
        points[1, near] = line
    return replace(mesh, points=points)


def _surrounded(mesh: TriangleMesh, factor: float) -> TriangleMesh:
    """The mesh with its box widened by a factor, in layers of its own outline; the strip's lines go on straight."""
    if factor == 1.0:
        return mesh
    edges = mesh.edges
    outline = single_edges(edges)
    outline = outline[mesh.points[0, edges[:, outline]].max(axis=0) > 0]  # not the symmetry line
    region = mesh.region[outline % mesh.region.size]
    nodes, place = np.unique(edges[:, outline], return_inverse=True)
    x, y = mesh.points[:, nodes]
    n_layer = int(np.ceil(np.log(factor) / np.log(LAYER_RATIO)))
    points, triangles = [mesh.points], [mesh.triangles]
    inner = edges[:, outline]
    for layer in range(1, n_layer + 1):
        stretch = factor ** (layer / n_layer)
        above = np.where(y >= mesh.gap, mesh.gap + (y - mesh.gap) * stretch, y)
        points.append(np.stack([x * stretch, np.where(y <= 0, y * stretch, above)]))
        outer = mesh.points.shape[1] + (layer - 1) * nodes.size + place.reshape(2, -1)
        (a, b), (c, d) = inner, outer
        triangles += [np.stack([a, c, d]), np.stack([a, d, b])]
        inner = outer
    return TriangleMesh(
        np.concatenate(points, axis=1),
        np.concatenate(triangles, axis=1),
        np.concatenate([mesh.region, *[region] * (2 * n_layer)]),
        mesh.names,
        mesh.gap,
    )


def elementary_edges(section: Section) -> tuple[Array, list[tuple[int, int, str, str]]]:
    """Vertices (n, 2) and elementary edges (start, end, region to the left, to the right; "" outside)."""
    every = np.array([v for r in section.regions for v in r.vertices])
    tolerance = TOLERANCE * np.abs(every).max()
    alike = np.abs(every[:, None] - every).max(axis=2) < tolerance
    points = every[np.argmax(alike, axis=1) == np.arange(len(every))]  # the first of those that are one
    pairs = set()
    for region in section.regions:
        ring = np.array(region.vertices)
        for a, b in zip(ring, np.roll(ring, -1, axis=0), strict=True):
            on = _on_segment(points, a, b, tolerance)
            pairs |= {tuple(sorted(pair)) for pair in zip(on[:-1], on[1:], strict=True)}
    ends = np.array(sorted(pairs))
    a, b = points[ends[:, 0]], points[ends[:, 1]]
    normal = np.stack([a[:, 1] - b[:, 1], b[:, 0] - a[:, 0]], axis=1)
    offset = normal / np.linalg.norm(normal, axis=1)[:, None] * 100 * tolerance
    sides = (regions_at((a + b) / 2 + sign * offset, section) for sign in (1, -1))
    edges = [
        (int(start), int(end), left, right)
        for (start, end), left, right in zip(ends, *sides, strict=True)
        if left != right
    ]
    used = sorted({k for edge in edges for k in edge[:2]})
    number = {old: new for new, old in enumerate(used)}
    return points[used], [(number[s], number[e], left, right) for s, e, left, right in edges]


def _on_segment(points: Array, a: Array, b: Array, tolerance: float) -> list[int]:
    """Indices of the points on the segment a-b, in order."""
    along = b - a
    length = np.linalg.norm(along)
    t = (points - a) @ along / length
    off = np.abs((points - a) @ np.array([-along[1], along[0]])) / length
    on = np.flatnonzero((off < tolerance) & (t > -tolerance) & (t < length + tolerance))
    return [int(k) for k in on[np.argsort(t[on])]]


def regions_at(points: Array, section: Section) -> list[str]:
    """The topmost region that covers each of the points (n, 2) (even-odd rule), "" outside all."""
    found = [""] * len(points)
    x, y = points.T[:, :, None]
    for region in section.regions:
        ring = np.array(region.vertices)
        (x0, y0) = ring.T
        (x1, y1) = np.roll(ring, -1, axis=0).T
        crosses = (y0 > y) != (y1 > y)
        with np.errstate(divide="ignore", invalid="ignore"):
            at = x0 + (y - y0) * (x1 - x0) / (y1 - y0)
        for k in np.flatnonzero(np.count_nonzero(crosses & (x < at), axis=1) % 2):
            found[k] = region.name
    return found
