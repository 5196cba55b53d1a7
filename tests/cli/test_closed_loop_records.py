"""Records of closed loops by `simulate` and `bench`, and what `compare` and `export` make of the controller."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT, Outcome

from msl_fem.record import load_record

SERVO = str(ROOT / "geometries" / "fast_tool_servo.toml")
TABLE = ("--table", str(ROOT / "lookup_tables" / "fast_tool_servo.nc"))
SINE = "sine:frequency=10 Hz,amplitude=0.1 mm,duration=0.2 s,loop=closed"
PLAIN = ("--belief", "plain")
MsL = Callable[..., Outcome]


@pytest.fixture(autouse=True)
def _in_the_project(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)


@pytest.mark.parametrize("command", ["simulate", "bench"])
def test_a_record_in_closed_loop_states_its_controller(msl_fem: MsL, tmp_path: Path, command: str) -> None:
    folder = tmp_path / "record"
    more = ("--seed", "3", "--hide", "none") if command == "bench" else ()
    msl_fem(command, SERVO, *TABLE, *more, "--excitation", SINE, "-o", str(folder), "--json").json  # noqa: B018
    record = load_record(folder)
    run = record.runs[0]
    time = np.arange(2000) / 1e4
    assert run["reference_m"] == pytest.approx(1e-4 * np.sin(2 * np.pi * 10 * time), abs=1e-12)
    error = run["position_m"] - run["reference_m"]
    assert error[500:].std() < 0.01e-4 * (1 if command == "simulate" else 20), "it follows"
    assert (np.ptp(run["command_1_A"].reshape(-1, 4), axis=1) == 0).all(), "held at the loop's rate"
    assert (run["command_1_A"][:4] == 0).all(), "acts a period later"
    assert run["command_1_A"].max() > 0.1
    assert record.controller["design"] == "lqr"
    assert (record.controller["rate"], record.controller["delay_samples"]) == ("2500 Hz", 1)
    assert "loop=closed" in run.excitation


@pytest.mark.parametrize("command", ["simulate", "bench"])
def test_around_a_voltage_drive_the_record_has_the_voltages_of_its_current_loop(
    msl_fem: MsL, tmp_path: Path, command: str
) -> None:
    """Sampled as its current loop is; more slowly it is refused."""
    text = Path(SERVO).read_text(encoding="utf-8")
    kind = 'kind = "current"'
    assert text.count(kind) == 1
    actuator, folder = tmp_path / "rig.toml", tmp_path / "record"
    actuator.write_text(text.replace(kind, 'kind = "voltage"'), encoding="utf-8")
    more = ("--seed", "3", "--hide", "none") if command == "bench" else ()
    asked = (str(actuator), *TABLE, *more, "--excitation", SINE, "-o", str(folder))
    assert "whole multiple of the current loop's" in msl_fem(command, *asked).complaint
    msl_fem(command, *asked, "--rate", "20 kHz", "--json").json  # noqa: B018
    run = load_record(folder).runs[0]
    error = run["position_m"] - run["reference_m"]
    assert error[1000:].std() < 0.02e-4 * (1 if command == "simulate" else 20), "it follows"
    assert "command_1_A" not in run
    before = np.abs(run["voltage_1_V"][:9]).max()
    assert before < 0.2, "a period of the controller, then one of the current loop, whose readings are noisy"
    assert np.abs(run["voltage_1_V"]).max() > 1.0


@pytest.mark.parametrize(
    ("command", "spec", "more", "said"),
    [
        ("simulate", SINE.replace("0.1 mm", "0.6 mm"), PLAIN, "beyond the"),
        ("simulate", SINE.replace("10 Hz", "500 Hz"), PLAIN, "N that guard, drive and table allow"),
        ("bench", SINE.replace("10 Hz", "500 Hz"), ("--seed", "1"), "N that guard, drive and table allow"),
        ("simulate", SINE.replace("0.1 mm", "1 A"), (), "amplitude: unit 'A' has the wrong dimension"),
        ("bench", SINE, ("--seed", "1", "--rate", "3 kHz"), "whole multiple of the controller's"),
    ],
)
def test_references_that_cannot_be_followed_are_refused(
    msl_fem: MsL, tmp_path: Path, command: str, spec: str, more: tuple[str, ...], said: str
) -> None:
    folder = tmp_path / command
    outcome = msl_fem(command, SERVO, *TABLE, "--excitation", spec, "-o", str(folder), *more)
    assert said in outcome.complaint
    assert not folder.exists()


def test_a_rig_without_magnets_has_no_such_loop(msl_fem: MsL, tmp_path: Path) -> None:
    rig = str(ROOT / "measurements" / "emps" / "actuator.toml")
    outcome = msl_fem("simulate", rig, "--excitation", SINE, "-o", str(tmp_path / "record"))
    assert "has no [magnet] or no [controller]; loop=closed needs both" in outcome.complaint


def test_the_controller_is_exported_as_c(msl_fem: MsL, tmp_path: Path) -> None:
    header = tmp_path / "controller.h"
    fields = msl_fem(
        "export", SERVO, *TABLE, "--to", "c", "--what", "controller", "-o", str(header), "--name", "servo", "--json"
    ).json
    assert fields["files"] == [str(header)]
    assert "servo_controller_step(servo_controller *c" in header.read_text()
    outcome = msl_fem("export", TABLE[1], "--to", "c", "--what", "controller", "-o", str(tmp_path / "b.h"))
    assert "needs a file with actuator" in outcome.complaint
    plain = msl_fem("export", SERVO, *TABLE, "--to", "c", "-o", str(tmp_path / "t.h"), "--json").json
    assert "_table_evaluate" in Path(plain["files"][0]).read_text(), "without --what a table, as ever"
    assert "_controller_step" not in Path(plain["files"][0]).read_text()
