"""Maps that no machine has are refused; falls that a file does not tell of and maps of another magnet are said."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT

from msl_fem.actuator import Actuator, load_actuator
from msl_fem.errors import InputError
from msl_fem.maps import OperatingMap, map_from_json, map_to_json, operating_map, write_map
from msl_fem.maps.doubts import doubt_about_map, falls_unsaid
from msl_fem.maps.pair_limits import PairMap
from msl_fem.table import read_table

SERVO = ROOT / "geometries" / "fast_tool_servo.toml"
TABLE = ROOT / "lookup_tables" / "fast_tool_servo.nc"


@pytest.fixture(scope="module")
def servo_map() -> OperatingMap:
    return operating_map(read_table(TABLE))


def content_with(servo_map: OperatingMap, **change: object) -> dict:
    return map_to_json(servo_map) | change


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"levels_T": [1.2, 1e6]}, "1.2 to 1e.06 T are not allowed"),
        ({"levels_T": [1e-9, 1.6]}, "1e-09 to 1.6 T are not allowed"),
        ({"current_max_A": 1e25}, r"largest current is 1e\+25 A"),
        ({"current_max_A": -1.0}, "largest current is -1 A"),
    ],
)
def test_numbers_that_no_machine_has_are_refused(servo_map: OperatingMap, change: dict, said: str) -> None:
    with pytest.raises(InputError, match=said):
        map_from_json(content_with(servo_map, **change))


def test_gaps_that_no_machine_has_are_refused(servo_map: OperatingMap) -> None:
    with pytest.raises(InputError, match="look at the units"):
        replace(servo_map, gap=servo_map.gap * 1e6)


@pytest.mark.parametrize(
    ("change", "said"),
    [({"levels": 1e6}, "are not allowed"), ({"other": 1e25}, "look at the units"), ({"position": 1e9}, "look at")],
)
def test_a_pair_s_map_that_no_machine_has_is_refused(change: dict, said: str) -> None:
    axes = {"levels": np.array([1.2]), "position": np.array([-1e-3, 1e-3]), "other": np.array([0.0, 1.0])}
    values = np.ones((2, 1, 2, 2))
    PairMap(**axes, current=values, allowance=0 * values)
    scaled = {name: nodes * change.get(name, 1) for name, nodes in axes.items()}
    with pytest.raises(InputError, match=said):
        PairMap(**scaled, current=values, allowance=0 * values)


def test_a_limit_that_falls_unsaid_is_said_by_whoever_reads_it(
    servo_map: OperatingMap, tmp_path: Path, msl_fem
) -> None:
    assert falls_unsaid(servo_map) == ()
    current = servo_map.current.copy()
    current[:, 5] = current[:, 4] * 0.7
    fallen = replace(servo_map, current=current)
    first = falls_unsaid(fallen)[0]
    assert "curve falls between gaps" in first
    assert first.endswith("was it changed by hand?")
    said = replace(fallen, warnings=(first.replace("was it changed by hand?", "known"),))
    assert first not in falls_unsaid(said)
    file = write_map(fallen, tmp_path / "m.json")
    done = msl_fem("guard", str(file), "--current", "1 A", "--gap", "0.3 mm", "--json")
    assert f"note: {file}: {first}" in done.stderr


def with_turns(actuator: Actuator, turns: int) -> Actuator:
    magnet = actuator.magnet_kind()
    changed = type(magnet).model_validate(magnet.model_dump() | {"coil": magnet.coil.model_dump() | {"turns": turns}})
    return actuator.model_copy(update={"magnet": changed})


def test_the_map_of_another_magnet_is_told(servo_map: OperatingMap) -> None:
    servo = load_actuator(SERVO)
    assert doubt_about_map(servo, servo_map) is None
    assert doubt_about_map(servo.model_copy(update={"motion": None}), servo_map) is None, "no part of the magnet"
    assert "is taken here for that of 'fast_tool_servo'" in str(doubt_about_map(with_turns(servo, 2000), servo_map))
    nameless = replace(servo_map, digest="another", provenance=None)
    assert doubt_about_map(servo, nameless) is None, "it has the actuator's name"
    assert doubt_about_map(servo, replace(nameless, actuator="other")) is not None


def test_simulate_says_it(servo_map: OperatingMap, tmp_path: Path, msl_fem) -> None:
    file = tmp_path / "m.json"
    content = map_to_json(servo_map)
    content["provenance"]["table"]["magnet_sha256"] = "another"
    file.write_text(json.dumps(content | {"digest": "another"}))
    excitation = "sine:channel=1,frequency=20 Hz,bias=0.3 A,amplitude=0.1 A,duration=0.6 s"
    words = ("simulate", str(SERVO), "--table", str(TABLE), "--excitation", excitation, "--rate", "2 kHz", "--json")
    done = msl_fem(*words, "--map", str(file), "-o", str(tmp_path / "rec"))
    assert "note: " in done.stderr
    assert "it was made for the magnet of 'fast_tool_servo', and is taken here" in done.stderr
