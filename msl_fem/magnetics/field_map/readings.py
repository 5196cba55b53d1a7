"""A criterion read on a field: the flux density at points in the iron, its derivatives, and where it occurs."""

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from msl_fem.computing.arrays import Array
from msl_fem.errors import InputError
from msl_fem.files.quantity import format_quantity
from msl_fem.magnetics.field.magnet_field import MagnetField
from msl_fem.magnetics.solver.magnetostatics import FieldModel
from msl_fem.magnetics.solver.postprocess import gradient_maps
from msl_fem.magnetics.triangles import TriangleMesh, single_edges
from msl_fem.maps.level_currents import MAX, PERCENTILE, Criterion
from msl_fem.materials.constants import MU_0
from msl_fem.materials.material import AnalyticIron, Iron

Indices = NDArray[np.int64]
SMALLEST = 1e-12  # T: |B| has no direction below
ASIDE = 1e-4  # rad
ON_CIRCLE = 1 + 1e-9  # of a circle's radius, so that its points lie outside
AREA_DIVISIONS, EDGE_DIVISIONS, CIRCLE_POINTS = 4, 4, 180
WINDOW = 0.005  # of the iron's area on either side of a percentile: the slope is the mean there


class IronPoints:
    """Points (2, n) of a model's iron, each in an element, and the maps from the potential to the field there."""

    def __init__(self, model: FieldModel, points: Array, elements: Indices) -> None:
        self.points = points
        self.region = np.array(model.mesh.names)[model.mesh.region[elements]]
        self._along_x, self._along_y = gradient_maps(model, points, elements)

    def flux_density(self, model: FieldModel, potential: Array, *directions: Array) -> tuple[Array, list[Array]]:
        """|B| in the iron (n,), and its derivatives along changes of the potential."""
        b_x = self._along_x @ potential
        b_y = self._along_y @ potential
        changes = [(self._along_x @ d, self._along_y @ d) for d in directions]
        sheets = np.empty(b_x.size)
        slopes = [np.empty(b_x.size) for _ in directions]
        for name in np.unique(self.region):
            here = self.region == name
            sheets[here], found = sheet_flux_density(
                model.irons[str(name)].iron, (b_x[here], b_y[here]), [(x[here], y[here]) for x, y in changes]
            )
            for slope, values in zip(slopes, found, strict=True):
                slope[here] = values
        return sheets, slopes


def sheet_flux_density(
    iron: Iron | AnalyticIron, gradient: tuple[Array, Array], changes: list[tuple[Array, Array]]
) -> tuple[Array, list[Array]]:
    """|B| in the iron from the averaged field's components, and its derivatives along changes of these."""
    b = np.hypot(*gradient)
    s = iron.stacking_factor
    gain = np.ones_like(b) if s == 1.0 else (1 - (1 - s) * MU_0 * iron.magnetise(b)[1]) / s
    unit = np.stack(gradient) / np.maximum(b, SMALLEST)
    return iron.iron_flux_density(b), [gain * (unit[0] * x + unit[1] * y) for x, y in changes]


def area_points(field: MagnetField, divisions: int) -> tuple[Array, Indices, Array]:
    """Centroids (2, n) of the iron's triangles, each cut into divisions^2 alike, their elements and areas in m2.

    In a body of revolution an area is multiplied by the circumference of its centroid's circle: the volume in m3.
    """
    mesh = field.model.mesh
    elements = mesh.elements(*field.irons)
    steps = [(i, j) for i in range(divisions) for j in range(divisions - i)]
    up = [((i + 1 / 3) / divisions, (j + 1 / 3) / divisions) for i, j in steps]
    down = [((i + 2 / 3) / divisions, (j + 2 / 3) / divisions) for i, j in steps if i + j < divisions - 1]
    share = np.array(up + down).T
    origin, first, second = mesh.points[:, mesh.triangles[:, elements]].transpose(1, 0, 2)
    along = first - origin
    across = second - origin
    points = (
        origin[:, :, None] + along[:, :, None] * share[0] + across[:, :, None] * share[1]
    )  # (2, element, sub-triangle)
    area = np.abs(along[0] * across[1] - along[1] * across[0]) / 2
    n = share.shape[1]
    points = points.reshape(2, -1)
    weight = np.repeat(area / n, n)
    if field.section.axisymmetric:
        weight = weight * 2 * np.pi * points[0]
    return points, np.repeat(elements, n), weight


def edge_points(field: MagnetField, divisions: int) -> tuple[Array, Indices]:
    """Points (2, n) along the edges of each iron, `divisions` an element's edge, and their elements."""
    mesh = field.model.mesh
    points = []
    elements = []
    for name in field.irons:
        inside = mesh.elements(name)
        edges, owner = _outline(mesh, inside)
        start = mesh.points[:, edges[0]]
        end = mesh.points[:, edges[1]]
        share = np.arange(divisions) / divisions
        points.append((start[:, :, None] + (end - start)[:, :, None] * share).reshape(2, -1))
        elements.append(np.repeat(owner, divisions))
    return np.concatenate(points, axis=1), np.concatenate(elements)


def _outline(mesh: TriangleMesh, inside: Indices) -> tuple[Indices, Indices]:
    """Edges (2, n) that belong to one of the triangles only, and that triangle."""
    corners = mesh.triangles[:, inside]
    edges = np.concatenate([corners[[0, 1]], corners[[1, 2]], corners[[2, 0]]], axis=1)
    single = single_edges(edges)
    return edges[:, single], np.tile(inside, 3)[single]


def circle_points(field: MagnetField, radius: float, number: int) -> tuple[Array, Indices]:
    """Points (2, n) of the iron on circles around its corners, in `number` directions, and their elements.

    The directions include those of the iron's edges, at which the largest values stand, from just inside of them.
    """
    mesh = field.model.mesh
    angle = 2 * np.pi * np.arange(number) / number
    angle = np.r_[angle - ASIDE, angle + ASIDE]
    ring = ON_CIRCLE * radius * np.stack([np.cos(angle), np.sin(angle)])
    points = np.concatenate([np.array([[x], [y]]) + ring for x, y, _ in field.section.corners], axis=1)
    points = points[:, points[0] > 0]
    elements = np.asarray(field.model.skfem_mesh.element_finder()(*points))
    iron = np.isin(elements, mesh.elements(*field.irons))
    return points[:, iron], elements[iron]


def outside_corners(field: MagnetField, points: Array, radius: float) -> NDArray[np.bool_]:
    """Which points lie at least a radius from every corner of the iron."""
    corners = np.array([(x, y) for x, y, _ in field.section.corners]).T
    distance = np.hypot(*(points[:, :, None] - corners[:, None, :])).min(axis=1)
    return np.asarray(distance >= radius)


def parts_of(field: MagnetField, at: IronPoints) -> NDArray[np.str_]:
    """The part of the magnet that each point lies in, or next to: a name of the section's cuts."""
    parts = field.section.parts
    distance = np.array([np.where(at.region == p.region, _distance(at.points, p.vertices), np.inf) for p in parts])
    names = np.array([part.name for part in parts])
    return np.asarray(names[np.argmin(distance, axis=0)])


def _distance(points: Array, vertices: tuple[tuple[float, float], ...]) -> Array:
    """(n,) m from points (2, n) to a polygon, 0 inside (even-odd rule)."""
    if not vertices:
        return np.zeros(points.shape[1])
    ring = np.array(vertices)
    x, y = points
    inside = np.zeros(x.size, dtype=bool)
    nearest = np.full(x.size, np.inf)
    for (x0, y0), (x1, y1) in zip(ring, np.roll(ring, -1, axis=0), strict=True):
        along = np.array([x1 - x0, y1 - y0])
        length = float(along @ along)
        if length == 0.0:
            continue
        t = np.clip(((x - x0) * along[0] + (y - y0) * along[1]) / length, 0.0, 1.0)
        nearest = np.minimum(nearest, np.hypot(x - x0 - t * along[0], y - y0 - t * along[1]))
        if y0 != y1:
            inside ^= ((y0 > y) != (y1 > y)) & (x < x0 + (y - y0) * (x1 - x0) / (y1 - y0))
    return np.where(inside, 0.0, nearest)


class LevelReading(NamedTuple):
    """The criterion's flux density in T, its derivatives with respect to current (T/A) and gap (T/m), and the part."""

    value: float
    current_slope: float
    gap_slope: float
    place: str


class Potentials(NamedTuple):
    """A potential and its derivatives with respect to current and gap, (n_dof,) each."""

    potential: Array
    by_current: Array
    by_gap: Array


class Reader(Protocol):
    """Reads a criterion on a field; `model` may have other irons than the one that the reader was made for."""

    def __call__(self, model: FieldModel, field: Potentials) -> LevelReading: ...


def reader_of(field: MagnetField, criterion: Criterion, *, finer: int = 1) -> Reader:
    """The reader of a criterion on a field's discretisation, its points `finer` times as dense.

    Raises
    ------
    InputError : a radius that leaves nothing of the thinnest iron
    """
    if criterion.kind == PERCENTILE:
        return _AreaPercentile(field, criterion.percent, AREA_DIVISIONS * finer)
    if criterion.kind == MAX:
        check_radius(field, criterion.radius)
        return _LargestOutsideCorners(field, criterion.radius, finer)
    return _SectionMeans(field)


def check_radius(field: MagnetField, radius: float) -> None:
    """InputError where discs of the radius around the corners would cover the thinnest iron."""
    thin = field.section.thinnest_iron
    if radius >= thin / 2:
        raise InputError(
            f"criterion max={format_quantity(radius, 'm')}: the radius must be below half the thinnest iron, "
            f"{format_quantity(thin / 2, 'm')}; give a smaller one"
        )


class _SectionMeans:
    """The largest of the sections' means of |B| in the iron."""

    def __init__(self, field: MagnetField) -> None:
        self._cuts = field.probes.cuts

    def __call__(self, model: FieldModel, field: Potentials) -> LevelReading:
        found = []
        for name, cut in self._cuts.items():
            gradient, by_current, by_gap = ((cut.along_x @ a, cut.along_y @ a) for a in field)
            sheets, slopes = sheet_flux_density(model.irons[cut.region].iron, gradient, [by_current, by_gap])
            value, current_slope, gap_slope = (cut.mean(values) for values in (sheets, *slopes))
            found.append(LevelReading(value, current_slope, gap_slope, name))
        return max(found, key=lambda reading: reading.value)


class _AreaPercentile:
    """The flux density that a share of the iron's area (volume, of a body of revolution) does not exceed."""

    def __init__(self, field: MagnetField, percent: float, divisions: int) -> None:
        points, elements, area = area_points(field, divisions)
        self._points = IronPoints(field.model, points, elements)
        self._share = area / area.sum()
        self._percent = percent / 100
        self._parts = parts_of(field, self._points)

    def __call__(self, model: FieldModel, field: Potentials) -> LevelReading:
        sheets, slopes = self._points.flux_density(model, *field)
        order = np.argsort(sheets)
        share = self._share[order]
        middle = np.cumsum(share) - share / 2
        value = float(np.interp(self._percent, middle, sheets[order]))
        near = np.abs(middle - self._percent) <= WINDOW
        near[np.argmin(np.abs(middle - self._percent))] = True
        by_current, by_gap = (float(np.average(s[order][near], weights=share[near])) for s in slopes)
        names, place = np.unique(self._parts, return_inverse=True)
        above = np.bincount(place, np.where(sheets >= value, self._share, 0.0))
        return LevelReading(value, by_current, by_gap, str(names[np.argmax(above)]))


class _LargestOutsideCorners:
    """The largest flux density in the iron outside circles around its corners: over the area, on edges and circles."""

    def __init__(self, field: MagnetField, radius: float, finer: int) -> None:
        sets = [
            area_points(field, AREA_DIVISIONS * finer)[:2],
            edge_points(field, EDGE_DIVISIONS * finer),
            circle_points(field, radius, CIRCLE_POINTS * finer),
        ]
        points, elements = (np.concatenate(part, axis=-1) for part in zip(*sets, strict=True))
        outside = outside_corners(field, points, radius)
        self._points = IronPoints(field.model, points[:, outside], elements[outside])
        self._parts = parts_of(field, self._points)

    def __call__(self, model: FieldModel, field: Potentials) -> LevelReading:
        sheets, slopes = self._points.flux_density(model, *field)
        k = int(np.argmax(sheets))
        return LevelReading(float(sheets[k]), float(slopes[0][k]), float(slopes[1][k]), str(self._parts[k]))
