"""Actuator files: the two of geometries/ say what the interface says, and a faulty one is refused by its key path."""

import copy
import tomllib
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msl_fem.actuator import Actuator, ECore, load_actuator, parse_actuator
from msl_fem.errors import ActuatorError, InputError
from msl_fem.files.schema import document
from msl_fem.files.toml_text import toml_text

GEOMETRIES = Path(__file__).parents[2] / "geometries"
MAGNET = {
    "centre_leg_width": 10e-3,
    "outer_leg_width": 5e-3,
    "window_width": 10e-3,
    "window_height": 20e-3,
    "yoke_thickness": 6e-3,
    "armature_thickness": 6e-3,
    "armature_overhang": 0.0,
    "stack_depth": 20e-3,
    "pole_chamfer": 0.0,
    "coil.turns": 200,
    "coil.width": 8e-3,
    "coil.height": 16e-3,
    "coil.leg_clearance": 1e-3,
    "coil.face_clearance": 2e-3,
    "coil.fill_factor": 0.5,
    "air.side": 40e-3,
    "air.bottom": 44e-3,
    "air.top": 44e-3,
}
SERVO = {
    "name": "fast_tool_servo",
    "magnet.iron.core": "m19",
    "magnet.iron.armature": "m19",
    "magnet.iron.stacking_factor": 0.96,
    "sides.count": 2,
    "sides.magnets_per_side": 2,
    "sides.connection": "series",
    "sides.polarity": "opposing",
    "motion.moving_mass": 0.90,
    "motion.stiffness": 1.4e5,
    "motion.damping": 12.0,
    "motion.nominal_gap": 0.6e-3,
    "motion.range": 0.5e-3,
    "motion.constant_force": 0.0,
    "drive.kind": "current",
    "drive.bandwidth": 1000.0,
    "drive.voltage_limit": 80.0,
    "drive.current_limit": 12.0,
    "drive.coil_resistance": 1.0,
    "position_sensor.noise": 50e-9,
    "position_sensor.bandwidth": 20e3,
    "position_sensor.resolution": 0.0,
    "current_sensor.noise": 2e-3,
    "controller.rate": 2500.0,
    "controller.delay_samples": 1,
}
E1 = {
    "name": "e1",
    "magnet.iron.core": "analytic:e1",
    "magnet.iron.armature": "analytic:e1",
    "magnet.iron.stacking_factor": 1.0,
    "sides": None,
    "motion": None,
    "drive": None,
    "controller": None,
}


def at(record: Any, path: str) -> Any:
    for key in path.split("."):
        record = getattr(record, key)
    return record


@pytest.mark.parametrize(
    ("name", "path", "value"),
    [(name, f"magnet.{path}", value) for name in ("e1", "fast_tool_servo") for path, value in MAGNET.items()]
    + [("fast_tool_servo", path, value) for path, value in SERVO.items()]
    + [("e1", path, value) for path, value in E1.items()],
)
def test_the_files_of_geometries_say_what_the_interface_says(name: str, path: str, value: Any) -> None:
    said = at(load_actuator(GEOMETRIES / f"{name}.toml"), path)
    assert said == (pytest.approx(value, rel=1e-14, abs=0) if isinstance(value, float) else value)


@pytest.mark.parametrize("name", ["e1", "fast_tool_servo"])
def test_every_section_has_a_source(name: str) -> None:
    actuator = load_actuator(GEOMETRIES / f"{name}.toml")
    content = tomllib.loads((GEOMETRIES / f"{name}.toml").read_text(encoding="utf-8"))
    assert {key for key, value in content.items() if isinstance(value, dict)} - {"sources"} <= set(actuator.sources)


@pytest.fixture
def content() -> dict[str, Any]:
    return tomllib.loads((GEOMETRIES / "fast_tool_servo.toml").read_text(encoding="utf-8"))


def put(content: dict[str, Any], path: str, value: Any) -> dict[str, Any]:
    """The content with another value at the path; None removes the key."""
    changed = copy.deepcopy(content)
    section = changed
    *way, key = path.split(".")
    for step in way:
        section = section[step]
    if value is None:
        del section[key]
    else:
        section[key] = value
    return changed


@pytest.mark.parametrize(
    ("path", "value", "said"),
    [
        ("magnet.window_width", "10 kg", "wrong dimension"),
        ("magnet.window_width", "10", "no unit"),
        ("magnet.window_width", 0.01, "no unit"),
        ("magnet.window_width", "-1 mm", "greater than 0"),
        ("magnet.window_width", "1e999 m", "not finite"),
        ("magnet.window_with", "10 mm", "unknown key"),
        ("magnet.coil.windings", 3, "unknown key"),
        ("magnet.coil.fil_factor", 0.5, r"fil_factor: unknown key; is fill_factor meant"),
        ("magnet.window_width", 10**400, "no unit"),
        ("motor", {"power": "3 W"}, "unknown key"),
        ("file", "x.toml", "unknown key"),
        ("magnet.stack_depth", None, "is missing"),
        ("magnet.coil.turns", None, "is missing"),
        ("motion.nominal_gap", None, "is missing"),
        ("schema", None, "is missing"),
        ("schema", 2, "should be 1"),
        ("magnet.coil.turns", 20.5, "integer"),
        ("magnet.coil.turns", 0, "greater than 0"),
        ("magnet.coil.turns", True, "true is not"),
        ("magnet.coil.fill_factor", 1.0, "less than 1"),
        ("magnet.iron.stacking_factor", 1.01, "less than or equal to 1"),
        (
            "magnet.kind",
            "c-core",
            "kind 'c-core' is unknown; choose one of 'e-core', 'u-core', 'pot-core', 'plunger', 'table', 'mesh'",
        ),
        ("magnet.kind", None, "magnet: kind is missing"),
        ("drive.kind", "pneumatic", "'current', 'voltage' or 'force'"),
        ("sides.count", 3, "1 or 2"),
        ("motion.range", "0.6 mm", "below nominal_gap"),
        ("name", "../e1", "match pattern"),
        ("magnet", {"kind": "table"}, "is missing"),
    ],
)
def test_a_fault_is_one_line_with_file_and_key_path(
    content: dict[str, Any], tmp_path: Path, path: str, value: Any, said: str
) -> None:
    file = tmp_path / "mine.toml"
    with pytest.raises(ActuatorError, match=said) as caught:
        parse_actuator(put(content, path, value), file=file)
    message = str(caught.value)
    assert message.startswith(f"{file}: ")
    assert path.split(".")[-1] in message
    assert path.split(".")[0] in message
    assert "\n" not in message
    assert isinstance(caught.value, InputError)


def test_a_misspelt_key_is_answered_with_the_one_that_is_missing(content: dict[str, Any]) -> None:
    """Whatever stands under it, a bare number included; other faults are still counted."""
    magnet = content["magnet"]
    magnet["coil"]["fil_factor"] = magnet["coil"].pop("fill_factor")
    with pytest.raises(ActuatorError, match=r"magnet\.coil\.fil_factor: unknown key; is fill_factor meant\?$"):
        parse_actuator(content)
    magnet["window_width"] = "1 kg"
    with pytest.raises(ActuatorError, match=r"is fill_factor meant\? \(and 1 more\)$"):
        parse_actuator(content)


def test_a_byte_order_mark_is_no_fault_and_another_encoding_is_named(tmp_path: Path) -> None:
    text = "# 5 µm\n" + (GEOMETRIES / "e1.toml").read_text(encoding="utf-8")
    file = tmp_path / "mine.toml"
    file.write_text(text, encoding="utf-8-sig")
    assert load_actuator(file).digest == load_actuator(GEOMETRIES / "e1.toml").digest
    file.write_text("# 5 µm", encoding="latin-1")
    with pytest.raises(ActuatorError, match=r"byte 4 is no UTF-8.*saved as UTF-8"):
        load_actuator(file)


def test_the_key_path_is_the_files(content: dict[str, Any]) -> None:
    """pydantic puts the kind of the magnet into the path; the file does not, unless the key has that name itself."""
    for faulty, start in (
        (put(content, "magnet.coil.width", "3 kg"), "mine.toml: magnet.coil.width: unit"),
        (put(content, "magnet", {"kind": "table"}), "mine.toml: magnet.table: is missing"),
        (put(content, "magnet", {"kind": "mesh", "mesh": "a.msh"}), "mine.toml: magnet.stack_depth: is missing"),
    ):
        with pytest.raises(ActuatorError) as caught:
            parse_actuator(faulty, file=Path("mine.toml"))
        assert str(caught.value).startswith(start)


@pytest.mark.parametrize(("key", "window"), [("width", "10 mm"), ("height", "20 mm")])
def test_a_coil_that_does_not_fit_its_window_is_refused(content: dict[str, Any], key: str, window: str) -> None:
    """Clearance and coil may fill the window exactly, and no more."""
    clearance = {"width": 1, "height": 2}[key]
    full = float(window.split()[0]) - clearance
    parse_actuator(put(content, f"magnet.coil.{key}", f"{full} mm"))
    with pytest.raises(ActuatorError, match=rf"coil\.{key} .* window's {window}"):
        parse_actuator(put(content, f"magnet.coil.{key}", f"{full + 0.01} mm"))


def test_a_chamfer_may_not_eat_the_pole(content: dict[str, Any]) -> None:
    parse_actuator(put(content, "magnet.pole_chamfer", "2.5 mm"))
    with pytest.raises(ActuatorError, match=r"pole_chamfer 2\.6 mm is above 2\.5 mm"):
        parse_actuator(put(content, "magnet.pole_chamfer", "2.6 mm"))


def test_without_a_magnet_only_a_force_can_drive(content: dict[str, Any]) -> None:
    with pytest.raises(ActuatorError, match=r"drive\.kind is 'current'"):
        parse_actuator(put(content, "magnet", None))
    rig = {"schema": 1, "name": "cart", "motion": {"moving_mass": "95.1 kg"}, "drive": {"kind": "force"}}
    actuator = parse_actuator(rig)
    assert actuator.motion is not None
    assert (actuator.motion.moving_mass, actuator.motion.nominal_gap) == (95.1, None)
    with pytest.raises(ActuatorError, match="needs \\[magnet\\] of a kind with dimensions"):
        actuator.magnet_kind()


@pytest.mark.parametrize(
    ("text", "said"),
    [(None, "cannot be read"), ("schema = ", "not valid TOML"), ("\udcff", "cannot be read")],
)
def test_a_file_that_is_none_is_named(tmp_path: Path, text: str | None, said: str) -> None:
    file = tmp_path / "mine.toml"
    if text is not None:
        file.write_bytes(text.encode("utf-8", "surrogateescape"))
    with pytest.raises(ActuatorError, match=said) as caught:
        load_actuator(file)
    assert str(file) in str(caught.value)


def test_records_are_frozen(servo: Actuator) -> None:
    with pytest.raises(ValueError, match="frozen"):
        servo.magnet.stack_depth = 1.0  # type: ignore[misc]


def test_lengths_that_follow_from_the_dimensions(servo: Actuator) -> None:
    core = servo.magnet
    assert core.half_width == pytest.approx(20e-3)
    assert core.height == pytest.approx(26e-3)
    # two straight sides of 20 mm and two of 10 mm, corners about a middle turn 5 mm off the leg
    assert core.mean_turn_length == pytest.approx(60e-3 + 2 * 3.14159265 * 5e-3, rel=1e-8)
    # 200 turns of half the section of 8 mm by 16 mm: 0.32 mm2 of copper each
    assert core.winding_resistance == pytest.approx(1.724e-8 * 200 * core.mean_turn_length / 0.32e-6, rel=1e-12)


def test_a_stated_resistance_goes_before_the_winding(content: dict[str, Any]) -> None:
    assert parse_actuator(content).coil_resistance() == 1.0
    unstated = parse_actuator(put(content, "drive.coil_resistance", None))
    assert unstated.coil_resistance() == unstated.magnet.winding_resistance


def test_stacking_factors_of_core_and_armature_go_before_the_common_one(content: dict[str, Any]) -> None:
    iron = parse_actuator(put(content, "magnet.iron.core_stacking_factor", 0.9)).magnet.iron
    assert (iron.core_stacking, iron.armature_stacking) == (0.9, 0.96)


def test_the_digest_knows_content_and_not_comments(content: dict[str, Any], servo: Actuator) -> None:
    assert parse_actuator(put(content, "sources.motion", "another")).digest == servo.digest
    assert parse_actuator(put(content, "motion.damping", "12.1 N s/m")).digest != servo.digest
    assert parse_actuator(put(content, "magnet.window_width", "1 cm")).digest == servo.digest


@given(
    st.floats(min_value=1e-4, max_value=1.0),
    st.sampled_from([("mm", 1e-3), ("um", 1e-6), ("m", 1.0), ("inch", 0.0254)]),
)
def test_any_unit_of_length_gives_the_same_magnet(width: float, unit: tuple[str, float]) -> None:
    name, size = unit
    core = tomllib.loads((GEOMETRIES / "e1.toml").read_text(encoding="utf-8"))
    core["magnet"]["yoke_thickness"] = f"{width / size:.17g} {name}"
    magnet = parse_actuator(core).magnet
    assert isinstance(magnet, ECore)
    assert magnet.yoke_thickness == pytest.approx(width, rel=1e-14)


@pytest.mark.parametrize("file", sorted(GEOMETRIES.glob("*.toml")), ids=lambda file: file.stem)
def test_a_shipped_file_written_is_the_file_read(file: Path) -> None:
    """Outlines are lists of points with units; records carry such a copy of their actuator."""
    actuator = load_actuator(file)
    again = parse_actuator(tomllib.loads(toml_text(document(actuator))), file=file)
    assert document(again) == document(actuator)
