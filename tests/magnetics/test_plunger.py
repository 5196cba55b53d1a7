"""Plunger magnets: force by two routes and by energies, the section's checks."""

from dataclasses import replace

import numpy as np
import pytest

from msl_fem.errors import InputError
from msl_fem.magnetics.field.plunger import PlungerField, PlungerMagnet, plunger_field, plunger_section, solve_plunger
from msl_fem.magnetics.section import Region
from msl_fem.magnetics.solver.magnetostatics import FieldModel
from msl_fem.magnetics.triangles import TriangleMesh
from msl_fem.materials.material import load_iron

STEP = 2e-5


def pot_magnet() -> PlungerMagnet:
    """A small saturating pot with a cylindrical plunger that enters from above; the air gap is 1 mm + displacement."""
    mm = 1e-3
    yoke = ((0, 0), (10, 0), (10, 16), (4.5, 16), (4.5, 13), (8, 13), (8, 3), (4, 3), (4, 5), (0, 5))
    coil = ((4.5, 3.5), (7.5, 3.5), (7.5, 12.5), (4.5, 12.5))
    plunger = ((0, 6), (4, 6), (4, 18), (0, 18))
    iron = load_iron("analytic:e1")

    def scaled(ring: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
        return tuple((r * mm, z * mm) for r, z in ring)

    return PlungerMagnet(
        fixed=(Region("yoke", scaled(yoke)), Region("coil", scaled(coil))),
        plunger=scaled(plunger),
        irons={"yoke": iron, "plunger": iron},
        turns_density={"coil": 500 / (3 * mm * 9 * mm)},
        box=(25 * mm, -15 * mm, 35 * mm),
        gap=0.5 * mm,
    )


@pytest.fixture(scope="module")
def pot() -> PlungerField:
    return plunger_field(pot_magnet(), 0.0)


@pytest.mark.parametrize("current", [0.5, 2.0, 8.0])
def test_both_routes_agree_before_and_after_saturation(pot, current):
    got = pot.evaluate(pot.solve(current))
    assert got.force < 0
    assert got.force_stress_tensor == pytest.approx(got.force, rel=5e-3)


def test_force_is_the_exact_derivative_of_the_discrete_energy(pot):
    """At fixed potential, nodes moved along z by the virtual displacement."""
    solution = pot.solve(3.0)
    mesh = pot.model.mesh

    def energy(step: float) -> float:
        points = mesh.points + np.stack([np.zeros_like(pot.motion), step * pot.motion])
        moved = TriangleMesh(points, mesh.triangles, mesh.region, mesh.names, mesh.gap)
        model = FieldModel(moved, pot.magnet.irons, turns_density=pot.magnet.turns_density, order=3, axisymmetric=True)
        return model.energy(solution.potential, mesh.gap)

    slope = (energy(1e-7) - energy(-1e-7)) / 2e-7
    assert pot.evaluate(solution).force == pytest.approx(-slope, rel=1e-6)


@pytest.mark.parametrize("current", [1.0, 6.0])
def test_force_is_the_slope_of_the_coenergy_over_meshes_made_anew(pot, current):
    ahead, behind = (solve_plunger(pot.magnet, current, step).coenergy for step in (STEP, -STEP))
    assert pot.evaluate(pot.solve(current)).force == pytest.approx((ahead - behind) / (2 * STEP), rel=5e-3)


def test_flux_linkage_and_inductance_are_slopes_along_the_current(pot):
    here, ahead, behind = (pot.evaluate(pot.solve(current)) for current in (3.0, 3.01, 2.99))
    assert here.flux_linkage == pytest.approx((ahead.coenergy - behind.coenergy) / 0.02, rel=1e-5)
    assert here.incremental_inductance == pytest.approx((ahead.flux_linkage - behind.flux_linkage) / 0.02, rel=1e-4)


def test_flux_linkage_is_at_most_that_of_all_turns_around_the_plunger(pot):
    got = pot.evaluate(pot.solve(1.0))
    assert 0.9 * got.flux_linkage < 500 * got.plunger_flux < 1.2 * got.flux_linkage


def test_a_magnet_upside_down_pulls_the_other_way():
    magnet = pot_magnet()

    def turned(ring: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
        return tuple((r, -z) for r, z in ring[::-1])

    edge, low, high = magnet.box
    mirrored = replace(
        magnet,
        fixed=tuple(Region(r.name, turned(r.vertices)) for r in magnet.fixed),
        plunger=turned(magnet.plunger),
        box=(edge, -high, -low),
    )
    up, down = (solve_plunger(m, 2.0, 0.0) for m in (magnet, mirrored))
    assert down.force == pytest.approx(-up.force, rel=2e-3)
    assert down.force_stress_tensor == pytest.approx(-up.force_stress_tensor, rel=1e-2)
    assert down.flux_linkage == pytest.approx(up.flux_linkage, rel=1e-4)


def test_no_current_no_force(pot):
    got = pot.evaluate(pot.solve(0.0))
    assert (got.force, got.force_stress_tensor, got.flux_linkage, got.coenergy) == (0, 0, 0, 0)


@pytest.mark.parametrize(
    ("displacement", "message"),
    [(-1.2e-3, r"-1\.2 mm the plunger touches the yoke"), (17.5e-3, r"17\.5 mm the plunger leaves the air box")],
)
def test_a_plunger_where_it_cannot_be_is_an_error(displacement, message):
    with pytest.raises(InputError, match=message):
        plunger_section(pot_magnet(), displacement)


def test_corners_are_graded_by_their_distance_to_the_other_part():
    corners = {(round(r * 1e3, 6), round(z * 1e3, 6)): s for r, z, s in plunger_section(pot_magnet(), 0.0).corners}
    assert corners[4.5, 16.0] == corners[4.5, 13.0] == pytest.approx(1.0)
    assert corners[4.0, 6.0] == pytest.approx((0.5 / 1.0) ** (2 / 3))
    assert (8.0, 3.0) not in corners, "a notch in iron is no singularity of the air's field"
    assert all(r > 0 for r, _ in corners)
