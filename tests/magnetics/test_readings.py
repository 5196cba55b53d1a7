"""Criteria read on a field: their derivatives, and the same quantity by another route."""

import numpy as np
import pytest
from level_jobs import E1, SERVO, currents_at, field_at

from msl_fem.magnetics.field_map.gap_levels import prolongation
from msl_fem.magnetics.field_map.readings import (
    Potentials,
    area_points,
    circle_points,
    edge_points,
    outside_corners,
    reader_of,
)
from msl_fem.magnetics.solver.magnetostatics import field_response
from msl_fem.magnetics.solver.postprocess import gradient_maps
from msl_fem.maps import parse_criterion

GAP = 5e-4


def reading_at(field, reader, current, gap):
    solution = field.solve(current, gap)
    response = field_response(field.model, solution)
    return reader(field.model, Potentials(solution.potential, response.by_current, response.by_gap))


@pytest.mark.parametrize(("criterion", "tolerance"), [("mean", 1e-4), ("percentile=90", 0.15), ("max=1mm", 1e-4)])
def test_derivatives_are_those_of_the_value(criterion, tolerance):
    """Against central differences in current and gap, with saturated sheets whose stacking factor counts."""
    field = field_at(SERVO, GAP, "fast", criterion)
    reader = reader_of(field, parse_criterion(criterion))
    found = reading_at(field, reader, 5.0, GAP)
    up, down = (reading_at(field, reader, 5.0 + step, GAP).value for step in (0.01, -0.01))
    assert found.current_slope == pytest.approx((up - down) / 0.02, rel=tolerance)
    up, down = (reading_at(field, reader, 5.0, GAP + step).value for step in (1e-6, -1e-6))
    assert found.gap_slope == pytest.approx((up - down) / 2e-6, rel=tolerance)
    assert found.gap_slope < 0 < found.current_slope


@pytest.mark.parametrize("percent", [50, 95])
def test_the_percentile_against_the_solver_s_own_quadrature(percent):
    """Points and weights of the field solver's integrals, on a mesh of its own."""
    (current,) = currents_at(SERVO, GAP, (1.4,), criterion=f"percentile={percent}")
    field = field_at(SERVO, GAP, "fine")
    potential = field.solve(float(current), GAP).potential
    sheets, weight = [], []
    for part in field.model.irons.values():
        sheets.append(part.iron.iron_flux_density(part.flux_density(potential)[1]).ravel())
        weight.append(part.weight.ravel())
    b, area = np.concatenate(sheets), np.concatenate(weight)
    order = np.argsort(b)
    share = np.cumsum(area[order]) / area.sum()
    assert b[order][np.searchsorted(share, percent / 100)] == pytest.approx(1.4, rel=4e-3)


def test_the_largest_value_outside_the_corners():
    """At the level's current no one of many random points exceeds it, and the largest comes near; corners do exceed."""
    criterion = parse_criterion("max=1.5mm")
    (current,) = currents_at(E1, GAP, (1.2,), "fast", "max=1.5mm")
    field = field_at(E1, GAP, "fast", "max=1.5mm")
    potential = field.solve(float(current), GAP).potential
    mesh, generator = field.model.mesh, np.random.default_rng(2)
    elements = np.repeat(mesh.elements("core", "armature"), 40)
    share = generator.dirichlet((1, 1, 1), elements.size).T
    points = np.einsum("cke,ke->ce", mesh.points[:, mesh.triangles[:, elements]], share)
    along_x, along_y = gradient_maps(field.model, points, elements)
    b = np.hypot(along_x @ potential, along_y @ potential)
    outside = outside_corners(field, points, criterion.radius)
    assert 1.17 < b[outside].max() < 1.2 * 1.004
    assert b[~outside].max() > 1.3
    assert reading_at(field, reader_of(field, criterion), float(current), GAP).place == "yoke"


def test_the_largest_value_does_not_hang_on_how_densely_it_is_looked_for():
    """It stands where a circle meets an edge of the iron, which the points hold themselves."""
    criterion = parse_criterion("max=0.5mm")
    field = field_at(E1, GAP, "fast", "max=0.5mm")
    once, often = (reading_at(field, reader_of(field, criterion, finer=n), 2.5, GAP).value for n in (1, 3))
    assert once == pytest.approx(often, rel=5e-4)


def test_a_smaller_radius_sees_more_and_needs_less_current():
    currents = [currents_at(E1, GAP, (1.2,), criterion=f"max={r}mm")[0] for r in ("0.3", "1", "2")]
    assert currents[0] < 0.95 * currents[1] < 0.95 * currents[2]
    assert currents[2] < currents_at(E1, GAP, (1.2,))[0]


def test_points_cover_the_iron_its_edges_and_circles():
    field = field_at(E1, GAP)
    points, elements, area = area_points(field, 3)
    core = 20e-3 * 26e-3 - 10e-3 * 20e-3
    assert area.sum() == pytest.approx(core + 20e-3 * 6e-3)
    assert (area @ points[0]) / area.sum() > 0
    found = field.model.skfem_mesh.element_finder()(*points)
    np.testing.assert_array_equal(found, elements)
    on_edges, _ = edge_points(field, 2)
    x, y = on_edges
    lines = [np.abs(x - v) for v in (0, 5e-3, 15e-3, 20e-3)]
    lines += [np.abs(y - v) for v in (-6e-3, 0, GAP, GAP + 20e-3, GAP + 26e-3)]
    assert np.min(lines, axis=0).max() < 1e-12
    circles, _ = circle_points(field, 2e-4, 90)
    assert outside_corners(field, circles, 2e-4).all()
    assert not outside_corners(field, circles, 2.01e-4).any()


@pytest.mark.parametrize("accuracy", ["fast", "fine"])
def test_a_prolonged_potential_is_the_same_function(accuracy):
    """Its gradient at any point; and it is so near that Newton starts with a small step."""
    field = field_at(E1, GAP, accuracy)
    finer = field.refined()
    solution = field.solve(4.0, GAP)
    prolonged = prolongation(field.model, finer.model) @ solution.potential
    points, elements, _ = area_points(field, 1)
    for coarse_map, fine_map in zip(
        gradient_maps(field.model, points, elements), gradient_maps(finer.model, points, elements), strict=True
    ):
        np.testing.assert_allclose(fine_map @ prolonged, coarse_map @ solution.potential, atol=1e-9)
    assert finer.solve(4.0, GAP, start=prolonged).trail[0] < 0.05 < finer.solve(4.0, GAP).trail[0]
