"""The actuators that an installed package brings along are those of geometries/, found by name from any folder."""

from pathlib import Path

import pytest
from conftest import ROOT

from msl_fem.actuator import example_actuators, load_actuator
from msl_fem.actuator.actuator import EXAMPLES
from msl_fem.errors import ActuatorError


@pytest.mark.parametrize("name", example_actuators())
def test_an_example_is_the_file_of_geometries(name: str) -> None:
    assert (EXAMPLES / f"{name}.toml").read_bytes() == (ROOT / "geometries" / f"{name}.toml").read_bytes()


def test_an_example_is_found_from_any_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert load_actuator("fast_tool_servo").digest == load_actuator(ROOT / "geometries" / "fast_tool_servo.toml").digest
    (tmp_path / "fast_tool_servo").write_text("schema = 2", encoding="utf-8")
    with pytest.raises(ActuatorError, match="schema"):
        load_actuator("fast_tool_servo")
    with pytest.raises(ActuatorError, match="cannot be read"):
        load_actuator("slow_tool_servo")
