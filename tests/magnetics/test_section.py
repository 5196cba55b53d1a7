"""The painted section of an E-core: areas, turns, corners and cuts where they belong."""

import numpy as np
import pytest
from conftest import ROOT
from random_cores import random_core

from msl_fem.actuator import ECore, load_actuator
from msl_fem.magnetics.section import Section


@pytest.fixture(scope="module")
def e1() -> ECore:
    return load_actuator(ROOT / "geometries" / "e1.toml").magnet


def topmost(section: Section, x: float, y: float) -> str:
    """The region painted last over a point, for rectangles."""
    name = ""
    for region in section.regions:
        corners = np.array(region.vertices)
        (x0, y0), (x1, y1) = corners.min(axis=0), corners.max(axis=0)
        if len(corners) == 4 and x0 < x < x1 and y0 < y < y1:
            name = region.name
    return name


def test_e1_is_painted_where_its_definition_says(e1):
    """Armature y in [-6, 0]; faces at y = g; legs |x| <= 5 and 15 ... 20; yoke above g + 20; coil 6 ... 14 (mm)."""
    g = 0.5
    section = e1.section(g * 1e-3)
    wanted = {
        (19, -3): "armature",
        (21, -3): "air",
        (3, g / 2): "strip",
        (59, g / 2): "strip",
        (4.9, g + 10): "core",
        (5.5, g + 10): "window",
        (10, g + 10): "coil",
        (10, g + 1): "window",
        (10, g + 19): "window",
        (14.5, g + 10): "window",
        (17, g + 1): "core",
        (10, g + 23): "core",
        (21, g + 10): "air",
        (59, g + 69): "air",
        (10, -49): "air",
        (61, 0): "",
        (10, g + 71): "",
        (10, -51): "",
    }
    assert {at: topmost(section, at[0] * 1e-3, at[1] * 1e-3) for at in wanted} == wanted


def test_turns_density_holds_all_turns(e1):
    section = e1.section(5e-4)
    assert section.turns_density == {"coil": pytest.approx(200 / (8e-3 * 16e-3))}


@pytest.mark.parametrize("seed", range(20))
def test_cuts_cross_their_iron_from_side_to_side(seed):
    rng = np.random.default_rng(seed)
    magnet = random_core(rng)
    section = magnet.section(float(rng.uniform(2e-5, 3e-3)))
    widths = {
        "centre_leg": magnet.centre_leg_width / 2,
        "outer_leg": magnet.outer_leg_width,
        "yoke": magnet.yoke_thickness,
        "armature": magnet.armature_thickness,
    }
    assert {cut.name for cut in section.cuts} == set(widths)
    for cut in section.cuts:
        start, end = np.array(cut.start), np.array(cut.end)
        assert np.linalg.norm(end - start) == pytest.approx(widths[cut.name])
        inside = "armature" if cut.name == "armature" else "core"
        along = (end - start) / np.linalg.norm(end - start)
        for point in (start + 1e-6 * along, (start + end) / 2, end - 1e-6 * along):
            assert topmost(section, *point) == inside
        for point in (start - 1e-6 * along, end + 1e-6 * along):
            assert topmost(section, *point) != inside


def test_chamfer_moves_the_graded_corners(e1):
    sharp, cut = (e1.model_copy(update={"pole_chamfer": c}).section(5e-4) for c in (0.0, 1e-3))
    at_face = [{round(x * 1e3, 9) for x, y, _ in s.corners if y == s.gap} for s in (sharp, cut)]
    assert at_face == [{5.0, 15.0, 20.0}, {4.0, 16.0, 19.0}]
    assert len(cut.corners) == len(sharp.corners) + 3


def test_stacking_factors_and_irons_reach_their_regions(servo):
    magnet = servo.magnet
    iron = magnet.iron.model_copy(update={"armature": "steel_1010", "armature_stacking_factor": 1.0})
    section = magnet.model_copy(update={"iron": iron}).section(5e-4)
    assert section.iron == {"core": ("m19", 0.96), "armature": ("steel_1010", 1.0)}


def test_the_air_box_counts_from_the_core_not_from_a_wider_armature(servo):
    """A wide armature leaves the stated box where it is, and may not reach it."""
    magnet = servo.magnet
    wider = magnet.model_copy(update={"armature_overhang": 5e-3})
    for one in (magnet, wider):
        air = next(r for r in one.section(5e-4).regions if r.name == "air")
        assert max(x for x, _ in air.vertices) == pytest.approx(60e-3)
    with pytest.raises(ValueError, match=r"air\.side 40 mm counts from the core"):
        type(magnet).model_validate(magnet.model_dump() | {"armature_overhang": 40e-3})
