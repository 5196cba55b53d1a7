"""A section that leaves for FEMM comes back with its force; another reader reads it; its stored solution agrees."""

import gzip
import re
from pathlib import Path

import femm_pair
import femmreader
import numpy as np
import pytest
from conftest import ROOT

import msl_fem
from msl_fem.actuator import Actuator, load_actuator
from msl_fem.errors import InputError
from msl_fem.export.femm_file import read_femm
from msl_fem.export.femm_magnet import magnet_from_femm
from msl_fem.export.femm_section import femm_text
from msl_fem.materials.material import load_iron

STORED = ROOT / "tests" / "reference" / "femm" / "fast_tool_servo_9A.ans.gz"


def example(name: str) -> Actuator:
    return load_actuator(ROOT / "geometries" / f"{name}.toml")


@pytest.fixture(scope="module")
def servo_text() -> str:
    return femm_text(example("fast_tool_servo"), current=9.0)


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> Path:
    target = tmp_path_factory.mktemp("femm") / "servo.ans"
    target.write_bytes(gzip.decompress(STORED.read_bytes()))
    return target


@pytest.fixture(scope="module")
def imported(servo_text: str, tmp_path_factory: pytest.TempPathFactory) -> Actuator:
    folder = tmp_path_factory.mktemp("imported")
    (folder / "servo.fem").write_text(servo_text)
    return load_actuator(magnet_from_femm(folder / "servo.fem", folder / "servo.toml", armature=2, pull="+y"))


@pytest.mark.parametrize("name", ["fast_tool_servo", "u_core_ui60", "pot_core_holding", "roters_plunger"])
def test_another_reader_finds_the_section(name: str, tmp_path: Path) -> None:
    """Every block by its label, its turns and its iron's curve; lengths in mm."""
    actuator = example(name)
    gap = None if actuator.motion is not None else 5e-3
    (tmp_path / "section.fem").write_text(femm_text(actuator, gap))
    read = femmreader.read(str(tmp_path / "section.fem"))
    magnet = actuator.magnet_kind()
    section = magnet.section(gap or actuator.motion.nominal_gap)
    assert read["ProblemType"] == ("axisymmetric" if section.axisymmetric else "planar")
    turns = [label["num_turns"] for label in read["NumBlockLabels"] if label["circuit"] == 1]
    assert sum(t for t in turns if t > 0) == magnet.turns
    assert sum(turns) == (magnet.turns if section.axisymmetric else 0)
    assert {label["group"] for label in read["NumBlockLabels"]} == {0, 1, 2, 3}
    core = next(block for block in read["BlockProps"] if block["BlockName"] == "core")
    iron_name, fill = section.iron["core"]
    assert core["LamFill"] == fill
    iron = load_iron(iron_name, folder=actuator.folder)
    n = iron.flux_density.size
    np.testing.assert_allclose(core["BHPoints"]["B"][:n], iron.flux_density, rtol=1e-15)
    np.testing.assert_allclose(core["BHPoints"]["H"][:n], iron.field_strength, rtol=1e-15)
    ends = {k for edge in read["NumSegments"] for k in (edge["p1"], edge["p2"])}
    assert ends == set(range(len(read["NumPoints"])))


def test_the_section_comes_back_with_its_force(imported: Actuator) -> None:
    """Saturated, and at another gap than the drawn one."""
    original = example("fast_tool_servo")
    assert imported.magnet.gap == pytest.approx(0.6e-3, rel=1e-9)
    assert imported.magnet.turns == original.magnet.turns
    for current, gap in ((9.0, 0.6e-3), (2.0, 0.4e-3)):
        theirs = msl_fem.solve(original, current, gap, accuracy="fast", end_effects=False).quantities
        ours = msl_fem.solve(imported, current, gap, accuracy="fast").quantities
        assert ours.force == pytest.approx(theirs.force, rel=1e-2), (current, gap)
        assert ours.flux_linkage == pytest.approx(theirs.flux_linkage, rel=1e-2)


def test_femms_stored_solution_has_our_force(stored: Path, imported: Actuator) -> None:
    """The section in FEMM's own solver, 9 A: force by weighted stress of its stored potential, flux linkage."""
    field = femm_pair.read_solution(stored)
    assert field.problem.circuits[0].current == 9.0
    along, across = femm_pair.force(field, 2)[::-1]
    ours = msl_fem.solve(imported, 9.0, 0.6e-3, accuracy="fast").quantities
    assert ours.force == pytest.approx(along, rel=1e-2)
    assert abs(across) < 1e-2 * along
    assert ours.flux_linkage == pytest.approx(femm_pair.flux_linkages(field)["coil"], rel=1e-2)


def test_arcs_become_chords_as_femm_meshes_them(servo_text: str, tmp_path: Path) -> None:
    corners = ((10, 0), (0, 10), (-10, 0), (0, -10))
    arcs = "[NumPoints] = 4\n" + "".join(f"{x}\t{y}\t0\t0\n" for x, y in corners)
    arcs += "[NumSegments] = 0\n[NumArcSegments] = 4\n"
    arcs += "".join(f"{k}\t{(k + 1) % 4}\t90\t5\t1\t0\t0\n" for k in range(4))
    arcs += "[NumHoles] = 0\n[NumBlockLabels] = 0\n"
    (tmp_path / "arc.fem").write_text(servo_text[: servo_text.index("[NumPoints]")] + arcs)
    read = read_femm(tmp_path / "arc.fem")
    assert len(read.edges) == 72
    np.testing.assert_allclose(np.hypot(*read.points.T), 0.01, rtol=1e-12)
    assert read.points[4:21].min() > 0, "from the start to the left"


@pytest.mark.parametrize(
    ("pattern", "new", "told"),
    [
        (r"planar", "axisymmetric", "a mesh is a plane section"),
        (r"(Frequency\]\s+=\s+)0", r"\g<1>50", "the frequency is 50 Hz"),
        (r"<H_c> = 0", "<H_c> = 900000", "air is a permanent magnet"),
        (r"(<CircuitType> = )1", r"\g<1>0", "the circuit coil is in parallel"),
        (r"(<BdryType> = )0", r"\g<1>5", "draw the whole section"),
        (r"(\t3\t)-200\t0", r"\g<1>-100\t0", "200 turns go out of the plane and 100 into it"),
        (r"\n9\.2\t[^\t]*\t2", "\n0\t-3.6\t2", "has no block label"),
        (r"\[NumHoles[^$]*", "[NumBlockLabels] = 1\n", "it ends early"),
        (r"\[LengthUnits\] =  millimeters", "[LengthUnits] =  cubits", "is no magnetics problem of FEMM 4"),
        (r" *<BdryType> = 0\n", "", "a boundary has no <BdryType>"),
        (r"(\n0\t1\t-1\t)1", r"\g<1>7", "there is no boundary 7, but 1"),
        (r"(\n0\t)1(\t-1)", r"\g<1>99\2", "there is no point 100, but 28"),
        (r"(\n0\t-3.6\t)4", r"\g<1>40", "there is no material 40, but 4"),
        (r"(\n9.2\t[^\t]*\t2\t-1\t)1", r"\g<1>3", "there is no circuit 3, but 1"),
        (r"(Frequency\]\s+=\s+)0", r"\g<1>fast", "is no magnetics problem of FEMM 4"),
        (r"(Depth\]\s+=\s+)20.0", r"\g<1>-20.0", "the depth -0.02 m is not above 0"),
        (r"(Depth\]\s+=\s+)20.0", r"\g<1>inf", "a number is not finite"),
        (r"\n5\t20.6", "\n1099511627776\t20.6", "a point lies 1.09951e.09 m away"),
        (r"(\n5\t20.6\t0\t)1", "\n5\tnan\t0\t1", "a number is not finite"),
        (
            r"NumArcSegments\] = 0",
            "NumArcSegments] = 1\n0\t1\t90\t1e-9\t1\t0\t0",
            "an arc of 90 degrees has chords of 1e-09",
        ),
        (r"NumArcSegments\] = 0", "NumArcSegments] = 1\n0\t1\t1e999\t1\t1\t0\t0", "an arc of inf degrees"),
    ],
)
def test_what_no_mesh_describes_is_refused(servo_text: str, tmp_path: Path, pattern: str, new: str, told: str) -> None:
    assert re.search(pattern, servo_text)
    (tmp_path / "bad.fem").write_text(re.sub(pattern, new, servo_text, count=1))
    with pytest.raises(InputError, match=told):
        magnet_from_femm(tmp_path / "bad.fem", tmp_path / "out.toml", armature=2, pull="+y")
    assert not list(tmp_path.glob("out*"))


def test_a_wrong_group_and_a_wrong_pull_are_told(servo_text: str, tmp_path: Path) -> None:
    (tmp_path / "servo.fem").write_text(servo_text)
    with pytest.raises(InputError, match="there is no armature; the armature is group 7, of the groups 0, 1, 2, 3"):
        magnet_from_femm(tmp_path / "servo.fem", tmp_path / "out.toml", armature=7, pull="+y")
    with pytest.raises(InputError, match="towards -y the armature meets no core"):
        magnet_from_femm(tmp_path / "servo.fem", tmp_path / "out.toml", armature=2, pull="-y")


def test_the_commands_write_it(msl_fem, tmp_path: Path) -> None:
    servo = str(ROOT / "geometries" / "fast_tool_servo.toml")
    msl_fem("export", servo, "--to", "femm", "-o", str(tmp_path / "a.fem"))
    msl_fem("draw", servo, "-o", str(tmp_path / "b.fem"), "--gap", "1 mm")
    gaps = [np.diff(np.unique(read_femm(tmp_path / f).points[:, 1].round(9))).min() for f in ("a.fem", "b.fem")]
    np.testing.assert_allclose(gaps, [0.6e-3, 1e-3])
