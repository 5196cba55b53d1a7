"""Whose magnet a table is of: silence where it fits, a sentence where it cannot."""

from dataclasses import replace

import pytest
from conftest import ROOT

from msl_fem.actuator import Actuator
from msl_fem.table import read_table
from msl_fem.table.magnetic_table import MagneticTable, write_table
from msl_fem.table.origin import doubt_about_table

FILE = ROOT / "lookup_tables" / "fast_tool_servo.nc"


@pytest.fixture(scope="module")
def shipped() -> MagneticTable:
    return read_table(FILE)


def with_magnet(actuator: Actuator, **change: object) -> Actuator:
    assert actuator.magnet is not None
    content = actuator.magnet.model_dump() | change
    return actuator.model_copy(update={"magnet": type(actuator.magnet).model_validate(content)})


def without_digests(table: MagneticTable) -> MagneticTable:
    return replace(table, provenance={"actuator": "fast_tool_servo"})


def test_its_own_magnet_raises_no_doubt(servo: Actuator, shipped: MagneticTable) -> None:
    assert doubt_about_table(servo, shipped) is None
    assert doubt_about_table(servo, without_digests(shipped)) is None
    heavier = servo.model_copy(update={"name": "other", "motion": None})
    assert doubt_about_table(heavier, shipped) is None, "what moves is no part of the magnet"


@pytest.mark.parametrize("change", [{"window_width": 0.03}, {"stack_depth": 0.021}])
def test_another_magnet_is_told_by_its_digest(servo: Actuator, shipped: MagneticTable, change: dict) -> None:
    other = with_magnet(servo, **change)
    assert "computed for a magnet of other dimensions" in str(doubt_about_table(other, shipped))


def test_other_turns_are_told_by_the_inductance_alone(servo: Actuator, shipped: MagneticTable) -> None:
    coil = servo.magnet_kind().coil.model_dump()
    for turns in (20, 2000):
        other = with_magnet(servo, coil=coil | {"turns": turns})
        assert "it is of another magnet" in str(doubt_about_table(other, without_digests(shipped)))


def test_simulate_says_it(servo: Actuator, tmp_path, msl_fem) -> None:
    text = (ROOT / "geometries" / "fast_tool_servo.toml").read_text()
    assert "turns = 200" in text
    actuator = tmp_path / "a.toml"
    actuator.write_text(text.replace("turns = 200", "turns = 2000"))
    words = ("gap-trade", str(actuator), "--table", str(FILE), "--json")
    done = msl_fem(*words)
    assert done.stderr.count("it is of another magnet") == 1, done.stderr
    own = msl_fem("gap-trade", str(ROOT / "geometries" / "fast_tool_servo.toml"), "--table", str(FILE), "--json")
    assert "magnet" not in own.stderr


def test_the_file_carries_the_digest(servo: Actuator, shipped: MagneticTable, tmp_path) -> None:
    again = read_table(write_table(shipped, tmp_path / "t.nc"))
    assert again.provenance["magnet_sha256"] == servo.magnet_kind().digest
