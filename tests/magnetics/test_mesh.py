"""Meshes: whole, graded at every corner that was asked for, for any plausible core; moving the gap."""

from collections.abc import Iterator
from types import ModuleType

import netgen.meshing
import numpy as np
import pytest
from conftest import ROOT
from random_cores import random_core

import msl_fem.magnetics.solver.mesh
from msl_fem.actuator import ECore, load_actuator
from msl_fem.errors import ComputationError
from msl_fem.magnetics.field.accuracy import LEVELS
from msl_fem.magnetics.field.magnet_field import magnet_mesh
from msl_fem.magnetics.section import Section
from msl_fem.magnetics.solver.mesh import GROWTH_CHANGES, MeshSize, triangulate
from msl_fem.magnetics.triangles import TriangleMesh


@pytest.fixture(scope="module")
def e1() -> ECore:
    return load_actuator(ROOT / "geometries" / "e1.toml").magnet


def areas(mesh: TriangleMesh) -> np.ndarray:
    """Signed areas of the triangles."""
    (x0, x1, x2), (y0, y1, y2) = mesh.points[:, mesh.triangles]
    return ((x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)) / 2


def painted_areas(magnet: ECore, gap: float) -> dict[str, float]:
    """The regions' areas from the dimensions."""
    bare = magnet.model_copy(update={"pole_chamfer": 0.0})
    core = bare.half_width * bare.height - bare.window_width * bare.window_height
    air = magnet.air_box
    width = magnet.half_width + air.side
    height = air.bottom + magnet.armature_thickness + gap + magnet.height + air.top
    out = {
        "core": core - 3 * magnet.pole_chamfer**2 / 2,
        "armature": magnet.armature_half_width * magnet.armature_thickness,
        "coil": magnet.winding_space.area,
        "window": magnet.window_width * magnet.window_height - magnet.winding_space.area,
        "strip": width * gap,
    }
    return out | {"air": width * height - sum(out.values())}


def corner_elements(mesh: TriangleMesh, section: Section) -> np.ndarray:
    """Longest reach of an element from each graded corner, in m."""
    x, y = mesh.points[:, mesh.triangles]
    out = []
    for corner_x, corner_y, _ in section.corners:
        distance = np.hypot(x - corner_x, y - corner_y)
        touching = distance.min(axis=0) < 1e-9
        assert touching.any(), "the corner must be a node"
        out.append(distance[:, touching].max())
    return np.array(out)


def check_whole(mesh: TriangleMesh, magnet: ECore, gap: float) -> None:
    area = areas(mesh)
    assert area.min() > 0
    for name, wanted in painted_areas(magnet, gap).items():
        assert area[mesh.elements(name)].sum() == pytest.approx(wanted, rel=1e-7), name


@pytest.mark.parametrize("seed", range(12))
def test_any_plausible_core_is_meshed_whole(seed):
    """Legs of 2 to 30 mm, gaps of 0.02 to 3 mm, chamfers, overhangs, coils that touch their window."""
    rng = np.random.default_rng(seed)
    magnet, gap = random_core(rng), float(np.exp(rng.uniform(np.log(2e-5), np.log(3e-3))))
    level = list(LEVELS)[seed % 3] if magnet.half_width / gap < 300 else "fast"
    check_whole(magnet_mesh(magnet, gap, level), magnet, gap)


@pytest.mark.parametrize("level", LEVELS)
def test_every_gap_corner_is_graded_at_every_gap(e1, level):
    """The mesher samples edges for their sizes; left to itself it steps over a corner's at some gaps."""
    size = LEVELS[level].size
    for gap in np.geomspace(5e-5, 1.2e-3, 9):
        section = e1.section(gap)
        facing = np.array([strength >= 0.7 for _, _, strength in section.corners])
        asked = size.corner * gap / np.array([strength for _, _, strength in section.corners]) ** 1.5
        ratio = (corner_elements(triangulate(section, size), section) / asked)[facing]
        assert (ratio < (12.0 if size.growth > 0.6 else 4.5)).all(), f"gap {gap:g}: {ratio}"


def test_faces_opposite_corners_are_as_fine_as_asked(e1):
    """`across` limits what lies opposite a corner; smaller gaps stretch that out, and `growth` alone makes it large."""
    section = e1.section(3e-4)
    reach = {}
    for across in (None, 0.2):
        mesh = triangulate(section, MeshSize(corner=0.004, gap=3.0, iron=0.6, growth=0.75, across=across))
        x, y = mesh.points[:, mesh.triangles[:, mesh.elements("strip")]]
        on_face = ((y == 0).sum(axis=0) == 2) & (np.abs(x.mean(axis=0) - 15e-3) < 1.5e-4)
        reach[across] = np.ptp(x[:, on_face], axis=0).max() / 3e-4
    assert reach[0.2] < 0.5 < reach[None]


def test_strip_lies_exactly_on_its_lines(e1):
    mesh = magnet_mesh(e1, 5e-4, "fast")
    strip = mesh.points[1, mesh.triangles[:, mesh.elements("strip")]]
    assert strip.min() == 0
    assert strip.max() == mesh.gap
    rest = mesh.points[1, mesh.triangles[:, np.setdiff1d(np.arange(mesh.region.size), mesh.elements("strip"))]]
    assert not ((rest > 0) & (rest < mesh.gap)).any(), "no other region reaches into the strip"


def test_another_gap_stretches_the_strip_and_shifts_what_lies_above(e1):
    mesh = magnet_mesh(e1, 5e-4, "fast")
    moved = TriangleMesh(mesh.at_gap(2e-4), mesh.triangles, mesh.region, mesh.names, 2e-4)
    check_whole(moved, e1, 2e-4)
    assert (moved.points[0] == mesh.points[0]).all()


def test_finer_sizes_make_more_triangles(e1):
    section = e1.section(5e-4)
    coarse, fine = (triangulate(section, MeshSize(corner=c)).triangles.shape[1] for c in (0.1, 0.01))
    assert fine > 1.2 * coarse


def test_far_field_layers_widen_the_box_without_a_seam(servo):
    """The default box is several times what is meshed freely; the rest are layers, conforming and as straight."""
    magnet = servo.magnet.model_copy(update={"air": None})
    section = magnet.section(5e-4)
    assert section.far > 4
    mesh = triangulate(section, LEVELS["fast"].size)
    check_whole(mesh, magnet, 5e-4)
    edges = np.sort(np.concatenate([mesh.triangles[[0, 1]], mesh.triangles[[1, 2]], mesh.triangles[[2, 0]]], axis=1), 0)
    unique, count = np.unique(edges, axis=1, return_counts=True)
    assert count.max() == 2, "no edge belongs to three triangles"
    (x, y), air = mesh.points[:, unique[:, count == 1]], magnet.air_box
    right, low = magnet.half_width + air.side, -magnet.armature_thickness - air.bottom
    high = 5e-4 + magnet.height + air.top
    on_box = [np.isclose(x, 0, atol=1e-9), np.isclose(x, right), np.isclose(y, low), np.isclose(y, high)]
    assert np.any([side.all(axis=0) for side in on_box], axis=0).all(), "every edge with one triangle lies on the box"


@pytest.fixture
def mesher() -> Iterator[ModuleType]:
    """The module without the meshes that it keeps, before and after."""
    made = msl_fem.magnetics.solver.mesh
    made._meshed.cache_clear()
    yield made
    made._meshed.cache_clear()


def failing(times: int):
    """A stand-in for one meshing attempt that fails that many times; the growths asked for are in `.growths`."""
    attempt = msl_fem.magnetics.solver.mesh._triangulate

    def stand_in(section: Section, size: MeshSize) -> TriangleMesh:
        stand_in.growths.append(size.growth)
        if len(stand_in.growths) <= times:
            raise netgen.meshing.NgException("meshing failed")
        return attempt(section, size)

    stand_in.growths = []
    return stand_in


def test_stuck_mesher_is_tried_again_with_another_growth(e1, monkeypatch, mesher):
    stand_in = failing(3)
    monkeypatch.setattr(mesher, "_triangulate", stand_in)
    check_whole(magnet_mesh(e1, 5e-4, "fast"), e1, 5e-4)
    assert len(set(stand_in.growths)) == 4
    assert stand_in.growths[0] == LEVELS["fast"].size.growth


def test_a_mesh_is_made_once_for_equal_sections_and_sizes(e1, monkeypatch, mesher):
    stand_in = failing(0)
    monkeypatch.setattr(mesher, "_triangulate", stand_in)
    first = magnet_mesh(e1, 5e-4, "fast")
    assert magnet_mesh(e1.model_copy(), 5e-4, "fast") is first
    assert len(stand_in.growths) == 1
    wider = e1.model_copy(update={"stack_depth": 2 * e1.stack_depth})
    for other in (magnet_mesh(e1, 5.1e-4, "fast"), magnet_mesh(e1, 5e-4, "normal"), magnet_mesh(wider, 5e-4, "fast")):
        assert other is not first
    assert len(stand_in.growths) == 4


def test_mesher_that_never_succeeds_is_a_computation_error(e1, monkeypatch, mesher):
    monkeypatch.setattr(mesher, "_triangulate", failing(10**6))
    with pytest.raises(ComputationError, match=rf"{len(GROWTH_CHANGES)} times.*0\.5 mm.*meshing failed"):
        magnet_mesh(e1, 5e-4, "fast")
