"""A magnet as made: its mesh moved, its iron scaled."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from small_magnets import nominal, nominal_of, wide_open

from msl_fem.design.tolerances.manufactured import (
    NAMES,
    manufactured_field,
    manufactured_magnet,
    moved_mesh,
    scaled_iron,
)
from msl_fem.errors import ComputationError
from msl_fem.magnetics.field.magnet_field import MagnetField, magnet_mesh
from msl_fem.magnetics.sweep.rows import FieldJob
from msl_fem.materials.constants import MU_0
from msl_fem.materials.material import AnalyticIron, Iron, e1_iron, linear_iron, load_iron

GAP = 4e-4
OFF = {"centre_leg_width": 2e-4, "outer_leg_width": 1e-4, "yoke_thickness": 1e-4, "armature_thickness": -1e-4}


def area(mesh, name: str) -> float:  # type: ignore[no-untyped-def]
    a, b, c = mesh.points[:, mesh.triangles[:, mesh.elements(name)]].transpose(1, 0, 2)
    cross = (b - a)[0] * (c - a)[1] - (b - a)[1] * (c - a)[0]
    assert (cross > 0).all() or (cross < 0).all(), "no triangle turned over"
    return float(np.abs(cross).sum() / 2)


@pytest.mark.parametrize("name", ["e1", "fast_tool_servo"])
@pytest.mark.parametrize("chamfer", [0.0, 1e-3])
def test_the_moved_mesh_fills_the_made_section(name: str, chamfer: float) -> None:
    nominal_magnet = nominal_of(name, GAP).magnet.model_copy(update={"pole_chamfer": chamfer, "air": None})
    mesh = magnet_mesh(nominal_magnet, GAP, "fast")
    made = manufactured_magnet(nominal_magnet, OFF)
    moved = moved_mesh(mesh, nominal_magnet.section(GAP), made.section(GAP))
    half = made.centre_leg_width / 2 + made.window_width + made.outer_leg_width
    windows = made.window_width * made.window_height
    core = half * (made.window_height + made.yoke_thickness) - windows - 3 * chamfer**2 / 2
    assert area(moved, "core") == pytest.approx(core, rel=1e-9)
    assert area(moved, "armature") == pytest.approx(made.armature_thickness * half, rel=1e-9)
    assert area(moved, "coil") == pytest.approx(made.winding_space.area, rel=1e-9)
    box = made.air_box
    assert moved.points[0].max() == pytest.approx(half + box.side, rel=1e-9)
    assert moved.points[1].max() == pytest.approx(GAP + made.height + box.top, rel=1e-9)


def test_a_moved_mesh_gives_what_a_new_one_does() -> None:
    """Two routes to the made magnet's force: within the discretisation's error of `fast`, a few thousandths."""
    nominal_job = nominal_of("fast_tool_servo", GAP)
    moved = manufactured_field(nominal_job, OFF)
    made = manufactured_magnet(nominal_job.magnet, OFF)
    again = MagnetField(made, magnet_mesh(made, GAP, "fast"), folder=nominal_job.folder, order=nominal_job.order)
    forces = [field.quantities(field.solve(4.0, GAP)).force for field in (moved, again)]
    assert forces[0] == pytest.approx(forces[1], rel=3e-3)
    plain = manufactured_field(nominal_job, {})
    assert abs(forces[0] / plain.quantities(plain.solve(4.0, GAP)).force - 1) > 5e-3, "the deviation shows"


def test_lines_that_part_or_cross_are_refused() -> None:
    nominal_job = nominal_of("fast_tool_servo", GAP)
    section = nominal_job.magnet.section(GAP)
    shrunk = replace(section, regions=section.regions[:-1])
    with pytest.raises(ComputationError, match="other vertices"):
        moved_mesh(nominal_job.mesh, section, shrunk)
    overhang = nominal_job.magnet.model_copy(update={"armature_overhang": 1e-3}).section(GAP)
    with pytest.raises(ComputationError, match="parts lines"):
        moved_mesh(nominal_job.mesh, section, overhang)


@pytest.mark.parametrize("iron", [load_iron("m19"), e1_iron()], ids=["points", "formula"])
def test_a_scaled_iron_is_the_scaled_polarisation(iron: Iron | AnalyticIron) -> None:
    """J'(H) = p J(H/s), at points of the curve; slope and energy belong to it."""
    p, s = 1.03, 1.2
    scaled = scaled_iron(iron, p, s)
    points = getattr(iron, "flux_density", np.linspace(0.0, 2.0, 21))[:-1]
    h = iron.magnetise(points)[0]
    b = p * (points - MU_0 * h) + MU_0 * s * h
    assert scaled.magnetise(b)[0] == pytest.approx(s * h, rel=1e-9, abs=1e-9)
    middle = np.linspace(0.1, 1.9, 40)
    step = 1e-6
    slope = (scaled.magnetise(middle + step)[0] - scaled.magnetise(middle - step)[0]) / (2 * step)
    assert scaled.magnetise(middle)[1] == pytest.approx(slope, rel=2e-5)
    energy = (scaled.energy_density(middle + step) - scaled.energy_density(middle - step)) / (2 * step)
    assert scaled.magnetise(middle)[0] == pytest.approx(energy, rel=2e-5)
    assert (scaled.magnetise(middle)[1] < 1 / MU_0).all()


def test_a_linear_iron_with_more_field_strength_has_less_permeability() -> None:
    b = np.linspace(0.1, 2.0, 5)
    # mu_r - 1 = chi goes to p chi / s
    other = linear_iron(1 + 999 * 1.02 / 1.1)
    assert scaled_iron(linear_iron(1000), 1.02, 1.1).magnetise(b)[0] == pytest.approx(other.magnetise(b)[0], rel=1e-12)


def test_bh_deviations_reach_the_field() -> None:
    """The made field of a linear iron is that of the magnet with the other permeability."""
    nominal_job = nominal(wide_open("linear:200"), GAP)
    made = manufactured_field(nominal_job, {"bh_field_strength": 0.25, "bh_polarisation": 0.0})
    other = FieldJob(wide_open(f"linear:{1 + 199 / 1.25!r}").magnet, nominal_job.mesh, Path(), nominal_job.order)
    plain = manufactured_field(other, {})
    found, wanted = (field.quantities(field.solve(2.0, GAP)) for field in (made, plain))
    assert found.force == pytest.approx(wanted.force, rel=1e-6)
    assert found.flux_density["yoke"].mean == pytest.approx(wanted.flux_density["yoke"].mean, rel=1e-6)


def test_only_what_deviates_changes() -> None:
    nominal_magnet = nominal_of("fast_tool_servo", GAP).magnet
    assert manufactured_magnet(nominal_magnet, dict.fromkeys(NAMES, 0.0)) == nominal_magnet
    made = manufactured_magnet(nominal_magnet, {"stack_depth": 1e-4, "stacking_factor": -0.01})
    assert made.stack_depth == pytest.approx(nominal_magnet.stack_depth + 1e-4)
    assert (made.iron.core_stacking, made.iron.armature_stacking) == pytest.approx((0.95, 0.95))
    assert made.coil == nominal_magnet.coil
