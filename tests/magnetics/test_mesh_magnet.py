"""A magnet given by a foreign mesh: the U-core against reluctances and finer meshes; meshes that are refused."""

import runpy
from dataclasses import replace
from pathlib import Path

import meshio
import numpy as np
import pytest
from conftest import ROOT

from msl_fem.actuator import Actuator, load_actuator
from msl_fem.errors import ActuatorError, InputError
from msl_fem.magnetics.field.foreign_mesh import MeshField, solve_mesh_magnet
from msl_fem.magnetics.kinds.mesh_checks import anticlockwise
from msl_fem.magnetics.kinds.mesh_file import read_mesh
from msl_fem.magnetics.solver.magnetostatics import solve_field
from msl_fem.magnetics.solver.mesh import MeshSize, triangulate
from msl_fem.magnetics.triangles import TriangleMesh
from msl_fem.materials.constants import MU_0

FILE = ROOT / "geometries" / "u_core.msh"
U_CORE = load_actuator(ROOT / "geometries" / "u_core.toml")
MAKER = runpy.run_path(str(ROOT / "geometries" / "make_u_core.py"))


def with_magnet(**change: object) -> Actuator:
    return U_CORE.model_copy(update={"magnet": U_CORE.mesh_magnet().model_copy(update=change)})


@pytest.fixture(scope="module")
def mesh() -> TriangleMesh:
    return read_mesh(FILE, unit=1e-3, gap=5e-4)


def test_force_against_the_reluctances():
    """F = mu_0 (N i)^2 A/(4 g^2) for two gaps in series, a little more by fringing, less by the iron's drop."""
    found = solve_mesh_magnet(U_CORE, 1.0).quantities
    magnet, leg = U_CORE.mesh_magnet(), 10e-3
    area = leg * magnet.stack_depth
    plain = MU_0 * magnet.turns**2 * area / (4 * magnet.gap**2)
    assert found.force == pytest.approx(plain, rel=0.05)
    assert found.force_stress_tensor == pytest.approx(found.force, rel=1e-3)
    # the coil sits on the yoke: its flux linkage is that of the gaps and of the leakage between the legs
    gaps = MU_0 * magnet.turns**2 * area / (2 * magnet.gap)
    assert 1.05 * gaps < found.flux_linkage < 1.45 * gaps
    assert found.coenergy == pytest.approx(found.flux_linkage / 2, rel=0.02)
    assert set(found.flux_density) == {"core", "armature"}
    assert found.flux_density["core"].mean < found.flux_density["core"].max


def test_the_coil_s_sides_carry_opposite_turns():
    """Turns per area integrate to +N over coil+ and to nothing over both."""
    source = MeshField(U_CORE).model.source
    assert source.sum() == pytest.approx(0.0, abs=1e-9 * U_CORE.mesh_magnet().turns)
    assert np.abs(source).sum() > 1.9 * U_CORE.mesh_magnet().turns


@pytest.mark.parametrize("current", [1.0, 6.0])
def test_against_the_same_section_meshed_finer(current):
    """The stated error covers the difference to a fine mesh."""
    point = solve_mesh_magnet(U_CORE, current, 5e-4)
    section = MAKER["u_core_section"]()
    fine = triangulate(section, MeshSize(corner=0.01, gap=1.0, iron=0.4, growth=0.4))
    names = tuple({"gap": "air_gap", "window": "air_window"}.get(n, n) for n in fine.names)
    better = MeshField(U_CORE, mesh=replace(fine, names=names), order=3)
    truth = better.quantities(better.solve(current))
    assert abs(point.quantities.force / truth.force - 1) <= point.force_error_estimate < 5e-3
    assert point.quantities.flux_linkage == pytest.approx(truth.flux_linkage, rel=1e-3)
    assert point.newton_iterations == len(point.residual_trail)


def test_slopes_are_those_of_solved_fields():
    """dF/di and dlambda/di against central differences, in saturation."""
    field = MeshField(U_CORE)
    high, low = (field.quantities(field.solve(i)) for i in (4.01, 3.99))
    at = field.quantities(field.solve(4.0))
    assert at.force_current_slope == pytest.approx((high.force - low.force) / 0.02, rel=1e-3)
    assert at.incremental_inductance == pytest.approx((high.flux_linkage - low.flux_linkage) / 0.02, rel=1e-3)
    assert at.flux_linkage == pytest.approx((high.coenergy - low.coenergy) / 0.02, rel=1e-4)
    assert np.isnan(at.force_gap_slope)


def test_the_example_is_what_its_script_writes(tmp_path):
    runpy.run_path(str(ROOT / "geometries" / "make_u_core.py"))["write"](tmp_path / "u.msh")
    again = solve_mesh_magnet(with_magnet(mesh=str(tmp_path / "u.msh")), 2.0, accuracy="fast").quantities
    assert again.force == pytest.approx(solve_mesh_magnet(U_CORE, 2.0, accuracy="fast").quantities.force, rel=1e-6)


def test_the_newer_format_of_gmsh_says_the_same(tmp_path, mesh):
    """MSH 4.1 as gmsh writes it: physical names belong to surfaces, triangles to surfaces."""
    n, m = len(mesh.names), mesh.triangles.shape[1]
    lines = ["$MeshFormat", "4.1 0 8", "$EndMeshFormat", "$PhysicalNames", f"{n}"]
    lines += [f'2 {k + 11} "{name}"' for k, name in enumerate(mesh.names)] + ["$EndPhysicalNames", "$Entities"]
    lines += [f"0 0 {n} 0", *(f"{k + 1} -1 -1 0 1 1 0 1 {k + 11} 0" for k in range(n)), "$EndEntities", "$Nodes"]
    count = mesh.points.shape[1]
    lines += [f"1 {count} 1 {count}", f"2 1 0 {count}", *(str(k + 1) for k in range(count))]
    lines += [f"{x * 1e3:.9g} {y * 1e3:.9g} 0" for x, y in mesh.points.T] + ["$EndNodes", "$Elements", f"{n} {m} 1 {m}"]
    number = 0
    for k in range(n):
        own = mesh.triangles[:, mesh.region == k].T + 1
        lines += [f"2 {k + 1} 2 {len(own)}"]
        for corners in own:
            number += 1
            lines.append(f"{number} {corners[0]} {corners[1]} {corners[2]}")
    (tmp_path / "new.msh").write_text("\n".join([*lines, "$EndElements", ""]))
    again = solve_mesh_magnet(with_magnet(mesh=str(tmp_path / "new.msh")), 2.0, accuracy="fast").quantities
    assert again.force == pytest.approx(solve_mesh_magnet(U_CORE, 2.0, accuracy="fast").quantities.force, rel=1e-6)


@pytest.mark.parametrize(
    ("pull", "turn"), [("-x", [[0, -1], [1, 0]]), ("-y", [[-1, 0], [0, -1]]), ("+x", [[0, 1], [-1, 0]])]
)
def test_a_turned_magnet_pulls_the_same(tmp_path, mesh, pull, turn):
    turned = replace(mesh, points=np.array(turn) @ mesh.points)
    meshio.write(tmp_path / "t.msh", renamed(turned), file_format="gmsh22", binary=False)
    got = solve_mesh_magnet(with_magnet(mesh=str(tmp_path / "t.msh"), pull=pull), 2.0, accuracy="fast").quantities
    want = solve_mesh_magnet(U_CORE, 2.0, accuracy="fast").quantities
    assert got.force == pytest.approx(want.force, rel=1e-6)
    assert got.flux_linkage == pytest.approx(want.flux_linkage, rel=1e-6)


def renamed(mesh: TriangleMesh, **names: str) -> meshio.Mesh:
    """A gmsh mesh in mm of a mesh that was read, with some regions renamed."""
    points = np.column_stack([*(mesh.points * 1e3), np.zeros(mesh.points.shape[1])])
    tag = (mesh.region + 1).astype(np.int32)
    labels = [names.get(n.replace("+", "_plus").replace("-", "_minus"), n) for n in mesh.names]
    return meshio.Mesh(
        points,
        [("triangle", mesh.triangles.T.astype(np.int32))],
        cell_data={"gmsh:physical": [tag], "gmsh:geometrical": [tag]},
        field_data={name: np.array([k + 1, 2]) for k, name in enumerate(labels)},
    )


def test_clockwise_triangles_are_turned_and_points_without_one_left_out(tmp_path, mesh):
    content = renamed(mesh)
    data = content.cells[0].data
    data[::3] = data[::3, ::-1]
    content.points = np.vstack([content.points, [[500.0, 0.0, 0.0]]])
    meshio.write(tmp_path / "c.msh", content, file_format="gmsh22", binary=False)
    again = read_mesh(tmp_path / "c.msh", unit=1e-3, gap=5e-4)
    assert again.points.shape == mesh.points.shape
    (x0, x1, x2), (y0, y1, y2) = again.points[:, again.triangles]
    assert ((x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)).min() > 0
    field, plain = MeshField(U_CORE, mesh=again), MeshField(U_CORE, mesh=mesh)
    a, b = (solve_field(f.model, 1.0, 5e-4) for f in (field, plain))
    assert field.quantities(a).force == pytest.approx(plain.quantities(b).force, rel=1e-9)


def test_named_cell_sets_serve_as_regions(tmp_path, mesh):
    """A format without gmsh's names: Abaqus element sets."""
    sets = {n: [np.flatnonzero(mesh.region == k)] for k, n in enumerate(mesh.names)}
    content = meshio.Mesh(renamed(mesh).points, [("triangle", mesh.triangles.T)], cell_sets=sets)
    meshio.write(tmp_path / "u.inp", content)
    again = read_mesh(tmp_path / "u.inp", unit=1e-3, gap=5e-4)
    assert [again.names[k] for k in again.region] == [mesh.names[k] for k in mesh.region]
    sets["armature"][0] = np.append(sets["armature"][0], sets["core"][0][:1])
    meshio.write(tmp_path / "two.inp", content)
    with pytest.raises(InputError, match="shares triangles with another"):
        read_mesh(tmp_path / "two.inp", gap=5e-4)


@pytest.mark.parametrize(
    ("names", "words"),
    [
        ({"core": "stator"}, "region 'stator' is unknown; names begin with core, armature"),
        ({"armature": "core_2"}, "no region's name begins with 'armature'"),
        ({"coil_plus": "air_coil"}, r"no region's name begins with 'coil\+'"),
        ({"air": "core_air"}, "lies on the mesh's edge .* surround the section with air"),
        ({"air_gap": "core_gap"}, r"armature touches what stands still"),
        ({"air_window": "coil-window"}, "areas of .* must be equal"),
    ],
)
def test_meshes_with_wrong_regions_are_refused(tmp_path, mesh, names, words):
    meshio.write(tmp_path / "w.msh", renamed(mesh, **names), file_format="gmsh22", binary=False)
    with pytest.raises(InputError, match=words):
        solve_mesh_magnet(with_magnet(mesh=str(tmp_path / "w.msh")), 1.0)


def _second_order(content: meshio.Mesh) -> meshio.Mesh:
    content.cells[0] = meshio.CellBlock("triangle6", np.hstack([content.cells[0].data] * 2))
    return content


def _bent(content: meshio.Mesh) -> meshio.Mesh:
    content.points[:, 2] = 0.1 * content.points[:, 0]
    return content


def _flat(content: meshio.Mesh) -> meshio.Mesh:
    content.cells[0].data[5, 2] = content.cells[0].data[5, 1]
    return content


def _nameless(content: meshio.Mesh) -> meshio.Mesh:
    del content.field_data["air"]
    return content


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (_second_order, "cells are triangle6; only straight three-node triangles"),
        (_bent, "not plane"),
        (_flat, "1 triangles have no area, the first at x = "),
        (_nameless, "belong to no named region"),
    ],
)
def test_spoiled_files_are_refused(tmp_path, mesh, spoil, words):
    meshio.write(tmp_path / "s.msh", spoil(renamed(mesh)), file_format="gmsh22", binary=False)
    with pytest.raises(InputError, match=words):
        read_mesh(tmp_path / "s.msh", gap=5e-4)


def test_files_that_are_no_mesh_are_refused(tmp_path, capsys):
    (tmp_path / "a.msh").write_text("no mesh\n")
    (tmp_path / "a.unknown").write_text("no mesh\n")
    for name in ("a.msh", "a.unknown", "absent.msh"):
        with pytest.raises(InputError, match="cannot be read as a mesh"):
            read_mesh(tmp_path / name, gap=5e-4)
    assert capsys.readouterr().out == ""


def test_another_gap_and_impossible_requests_are_refused(servo):
    with pytest.raises(InputError, match=r"gap 600 µm is not that of the mesh, 500 µm; leave the gap out"):
        solve_mesh_magnet(U_CORE, 1.0, 6e-4)
    with pytest.raises(InputError, match="not that of the mesh"):
        solve_mesh_magnet(U_CORE, 1.0, float("nan"))
    with pytest.raises(InputError, match="must be finite"):
        solve_mesh_magnet(U_CORE, float("inf"))
    with pytest.raises(InputError, match="fast, normal, fine"):
        solve_mesh_magnet(U_CORE, 1.0, accuracy="superb")
    with pytest.raises(ActuatorError, match='kind = "mesh"'):
        solve_mesh_magnet(servo, 1.0)


def spoilt(tmp_path, change) -> Path:
    """The example's mesh with its content changed."""
    content = meshio.read(FILE)
    block = next(block for block in content.cells if block.type == "triangle")
    change(content.points, block.data)
    path = tmp_path / "bad.msh"
    meshio.write(path, content, file_format="gmsh22", binary=False)
    return path


def move_far(points, triangles) -> None:
    points[481, 0] = 467.0


def move_a_little(points, triangles) -> None:
    """A node beyond the opposite edge of one of its triangles."""
    triangle = triangles[1000]
    points[triangle[0], :2] = points[triangle[1:], :2].sum(axis=0) - points[triangle[0], :2]


def exchange_a_corner(points, triangles) -> None:
    triangles[2275 % len(triangles), 0] = 1


def lose_a_coordinate(points, triangles) -> None:
    points[480, 1] = np.nan


def send_a_point_to_infinity(points, triangles) -> None:
    points[480, 0] = np.inf


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (move_far, "folded at|overlap at"),
        (move_a_little, "folded at|overlap at"),
        (exchange_a_corner, "folded at|overlap at"),
        (lose_a_coordinate, "node 481 has a coordinate that is no number"),
        (send_a_point_to_infinity, "node 481 has a coordinate that is no number"),
    ],
)
@pytest.mark.filterwarnings("error")
def test_folded_meshes_are_refused(tmp_path, change, said):
    """A triangle turned upside down would become one that lies over its neighbours."""
    with pytest.raises(InputError, match=rf"bad\.msh: .*({said})"):
        read_mesh(spoilt(tmp_path, change), unit=1e-3, gap=5e-4)


def test_every_triangle_with_a_wrong_corner_is_seen():
    """Of 20 random exchanges of a corner by another point and 20 nodes moved over an edge, none goes through."""
    mesh, generator = read_mesh(FILE, unit=1e-3, gap=5e-4), np.random.default_rng(3)
    for k in range(40):
        corners, points = mesh.triangles.copy(), mesh.points.copy()
        triangle = generator.integers(corners.shape[1])
        if k % 2:
            corners[generator.integers(3), triangle] = generator.integers(points.shape[1])
        else:
            a, b, c = corners[:, triangle]
            points[:, a] = points[:, b] + points[:, c] - points[:, a]
        with pytest.raises(InputError, match=r"folded|overlap|no area"):
            anticlockwise(points, corners, FILE)
    assert (anticlockwise(mesh.points, mesh.triangles[::-1], FILE)[0] == mesh.triangles[2]).all()
