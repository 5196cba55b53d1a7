"""A criterion read on a field: the flux density in the iron, its derivatives, and where it occurs."""

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from msl_fem.errors import InputError
from msl_fem.files.quantity import format_quantity
from msl_fem.magnetics.field_map.iron_points import (
    IronPoints,
    area_points,
    circle_points,
    edge_points,
    outside_corners,
    parts_of,
    sheet_flux_density,
)
from msl_fem.magnetics.kinds.e_core import MagnetField
from msl_fem.magnetics.solver.magnetostatics import FieldModel
from msl_fem.maps.level_currents import MAX, PERCENTILE, Criterion

Array = NDArray[np.float64]
AREA_DIVISIONS, EDGE_DIVISIONS, CIRCLE_POINTS = 4, 4, 180
WINDOW = 0.005  # of the iron's area on either side of a percentile: the slope is the mean there


class Reading(NamedTuple):
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

    def __call__(self, model: FieldModel, field: Potentials) -> Reading: ...


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
    magnet = field.magnet
    thin = min(magnet.centre_leg_width, magnet.outer_leg_width, magnet.yoke_thickness, magnet.armature_thickness)
    if radius >= thin / 2:
        raise InputError(
            f"criterion max={format_quantity(radius, 'm')}: the radius must be below half the thinnest iron, "
            f"{format_quantity(thin / 2, 'm')}; give a smaller one"
        )


class _SectionMeans:
    """The largest of the sections' means of |B| in the iron."""

    def __init__(self, field: MagnetField) -> None:
        self._cuts = field.probes.cuts

    def __call__(self, model: FieldModel, field: Potentials) -> Reading:
        found = []
        for name, (region, along_x, along_y) in self._cuts.items():
            gradient, by_current, by_gap = ((along_x @ a, along_y @ a) for a in field)
            sheets, slopes = sheet_flux_density(model.irons[region].iron, gradient, [by_current, by_gap])
            # the first and the last point stand at the section's ends, for the largest value alone
            value, current_slope, gap_slope = (float(values[1:-1].mean()) for values in (sheets, *slopes))
            found.append(Reading(value, current_slope, gap_slope, name))
        return max(found, key=lambda reading: reading.value)


class _AreaPercentile:
    """The flux density in the iron that a share of the iron's area does not exceed."""

    def __init__(self, field: MagnetField, percent: float, divisions: int) -> None:
        points, elements, area = area_points(field, divisions)
        self._points = IronPoints(field.model, points, elements)
        self._share, self._percent = area / area.sum(), percent / 100
        self._parts = parts_of(field, self._points)

    def __call__(self, model: FieldModel, field: Potentials) -> Reading:
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
        return Reading(value, by_current, by_gap, str(names[np.argmax(above)]))


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

    def __call__(self, model: FieldModel, field: Potentials) -> Reading:
        sheets, slopes = self._points.flux_density(model, *field)
        k = int(np.argmax(sheets))
        return Reading(float(sheets[k]), float(slopes[0][k]), float(slopes[1][k]), str(self._parts[k]))
