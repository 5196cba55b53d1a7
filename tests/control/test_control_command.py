"""The command `control`: designs, what the controller knows, and one line for what cannot be."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT

from msl_fem.actuator import load_actuator
from msl_fem.cli.controllers import identified_plant
from msl_fem.comparison.as_designed import as_designed
from msl_fem.comparison.models import own_loop
from msl_fem.identification import identify
from msl_fem.plant import NamedRun, bearable_run, simulation_record
from msl_fem.plant.excitation import parse_excitation
from msl_fem.record import load_record
from msl_fem.table.magnetic_table import read_table

SERVO, TABLE = str(ROOT / "geometries" / "fast_tool_servo.toml"), str(ROOT / "lookup_tables" / "fast_tool_servo.nc")
ALONE = ("--unseen", "0", "--belief", "plain")
SINE = "sine:frequency=5 Hz,amplitude=0.25 mm,duration=0.6 s"
EFFECTS = """
[effects.gap_offset]
offset = "15 um"
[effects.stiffness_nonlinearity]
cubic = "8e10 N/m^3"
[effects.sensor_drift]
rate = "0.1 um/s"
"""


@pytest.fixture
def extended(tmp_path: Path) -> str:
    file = tmp_path / "extended_model.toml"
    file.write_text(Path(SERVO).read_text() + EFFECTS)
    return str(file)


@pytest.mark.parametrize(
    ("options", "kind", "loss"),
    [
        ((), "lqr", (1.0, 1.8)),
        (("--no-feedforward",), "lqr", (1.0, 1.8)),
        (("--overlap", "2 N"), "lqr", (1.2, 2.2)),
        (("--design", "biased"), "biased", (5.0, 7.0)),
        (("--design", "biased", "--bias", "0.9 A"), "biased", (2.8, 4.0)),
        (("--design", "pid"), "pid", (1.0, 1.8)),
    ],
)
def test_every_design_runs(msl_fem, options, kind, loss):
    found = msl_fem("control", SERVO, "--table", TABLE, "--reference", SINE, *options, *ALONE, "--json").json
    assert found["design"] == kind
    assert loss[0] < found["copper_loss_W"] < loss[1]
    assert found["guard_violations"] == 0
    assert found["inverse_domain"]["source"] == "table"


def test_the_sides_overlap_as_far_as_the_reference_asks_for(msl_fem, tmp_path):
    """200 Hz at 0.1 mm takes more voltage than there is where one side pulls at a time; so both pull, and |T| is 1."""
    folder = tmp_path / "rec"
    fast = ("--reference", "sine:frequency=200 Hz,amplitude=0.1 mm,duration=0.4 s")
    found = msl_fem("control", SERVO, "--table", TABLE, *fast, *ALONE, "-o", str(folder), "--json").json
    asked = found["asked_voltage"]
    assert asked["overlap_N"] == asked["needed_overlap_N"] > 0.0
    assert asked["largest_V"] < 0.9 * asked["limit_V"]
    record = load_record(folder)
    assert record.controller["overlap"] == f"{asked['overlap_N']!r} N"
    time, position = (record.runs[0].columns[name] for name in ("time_s", "position_m"))
    late = time >= 0.2
    gain = 2 * abs(np.mean(position[late] * np.exp(-2j * np.pi * 200.0 * time[late]))) / 1e-4
    assert abs(20 * np.log10(gain)) < 0.5
    hard = msl_fem("control", SERVO, "--table", TABLE, *fast, "--overlap", "0 N", *ALONE)
    assert f'--overlap "{asked["needed_overlap_N"]:g} N"' in hard.stdout


def test_a_reference_that_repeats_is_learned_and_goes_to_the_board(msl_fem, tmp_path):
    """The correction takes off what a hidden gap offset leaves; the header has a row a sample of the period."""
    plant, header = tmp_path / "offset.toml", tmp_path / "controller.h"
    plant.write_text(Path(SERVO).read_text() + '[effects.gap_offset]\noffset = "25 um"\n')
    fast = ("--table", TABLE, "--reference", "sine:frequency=50 Hz,amplitude=0.2 mm,duration=0.4 s", "--unseen", "0")
    found = msl_fem("control", str(plant), *fast, "--learn", "4", "--c", str(header), "--json").json["learning"]
    assert found["period_s"] == pytest.approx(0.02)
    assert found["scenario_plants"] == 40
    assert found["error_rms_m"][4] < 0.5 * found["error_rms_m"][0]
    assert "static const double row[n_row][6]" in header.read_text()
    assert "enum { n_row = 50 }" in header.read_text()
    jump = ("control", SERVO, "--table", TABLE, "--learn", "2")
    assert "does not repeat" in msl_fem(*jump, "--reference", "step:amplitude=0.1 mm,duration=0.2 s").complaint
    noise = "band-limited-noise:band=400 Hz,amplitude=0.1 um,duration=1 s"
    assert "leave it out beside --inject" in msl_fem(*jump, "--inject", noise).complaint


def test_controller_and_plant_are_as_designed_unless_told_otherwise(msl_fem, extended, tmp_path):
    """What the drawing tells is in the plant and in the inverse, and the record says so: its loop is made again."""
    folder = tmp_path / "rec"
    common = ("--table", TABLE, "--reference", SINE, "--unseen", "0", "--json")
    found = msl_fem("control", SERVO, *common, "-o", str(folder)).json
    assert found["belief"]["name"] == "as-designed"
    assert {"mutual_inductance", "leakage_inductance", "fringing", "coil_heating"} <= set(found["effects"])
    assert found["inverse_domain"]["source"] == "as designed"
    assert "mutual_inductance.share" in found["inverse_domain"]["known_but_left_to_feedback"]
    record = load_record(folder)
    assert record.belief == "as-designed"
    believed = as_designed(record.actuator, read_table(TABLE))
    loop = own_loop(record, read_table(TABLE), believed.effects)
    assert loop.design.domain["source"] == "as designed"
    said = msl_fem("control", SERVO, "--model", extended, "--belief", "as-designed", *common).complaint
    assert "the plant is the extended model" in said


def test_the_effects_that_the_controller_knows_do_not_hurt(msl_fem, extended):
    common = ("--table", TABLE, "--reference", SINE, *ALONE, "--json")
    hidden = msl_fem("control", extended, *common).json
    known = msl_fem("control", SERVO, "--model", extended, *common).json
    plain = msl_fem("control", SERVO, *common).json
    assert hidden["effects"] == known["effects"] == ["gap_offset", "stiffness_nonlinearity", "sensor_drift"]
    assert plain["effects"] == []
    assert known["tracking_rms_m"] < 1.3 * plain["tracking_rms_m"] < hidden["tracking_rms_m"]
    assert known["inverse_domain"]["known_but_left_to_feedback"] == ["sensor_drift.rate"]
    assert hidden["inverse_domain"]["source"] == "table"


@pytest.fixture(scope="module")
def identified(tmp_path_factory) -> Path:
    servo, table = load_actuator(SERVO), read_table(TABLE)
    spec = "band-limited-noise:channel=independent,band=400 Hz,seed=1,bias=0.6 A,amplitude=0.08 A,duration=1.5 s"
    done, excitation = bearable_run(
        servo, table, parse_excitation(spec), rate=10e3, generator=np.random.default_rng(1)
    )  # fmt: skip
    model = identify(simulation_record(servo, [NamedRun("noise", excitation.spec, "fit", done)])).model
    file = tmp_path_factory.mktemp("model") / "armax.json"
    file.write_text(json.dumps(model.to_json()))
    found = identified_plant(model, servo)
    assert found.stiffness == pytest.approx(1.4e5, rel=0.05)
    assert sum(t.coefficient for t in found.terms) == pytest.approx(0.0, abs=0.05 * abs(found.terms[0].coefficient))
    return file


def test_the_inverse_of_identified_terms_controls_the_plant(msl_fem, identified):
    found = msl_fem(
        "control", SERVO, "--table", TABLE, "--model", str(identified), "--reference", SINE, *ALONE, "--json"
    ).json  # fmt: skip
    assert found["inverse_domain"]["source"] == "rational terms"
    assert found["tracking_rms_m"] < 0.01 * 0.25e-3


def test_a_report_and_a_record_are_written(msl_fem, tmp_path):
    page, folder = tmp_path / "page.html", tmp_path / "rec"
    found = msl_fem(
        "control", SERVO, "--table", TABLE, "--reference", SINE, "--report", str(page), "-o", str(folder), "--json",
        "--unseen", "3",
    ).json  # fmt: skip
    assert found["report"] == str(page)
    for words in ("Fig. 11", "What the loop promises", "Plants that the design has not seen"):
        assert words in page.read_text()
    loop = found["loop"]
    assert loop["held_share"] == loop["unseen"]["held"] / 3
    assert loop["copper_loss_W"] == found["copper_loss_W"]
    assert loop["reference_peak_dB"] < 1
    record = load_record(folder)
    assert record.controller["design"] == "lqr"
    assert record.controller["delay_samples"] == 1
    run = record.runs[0].columns
    behind = np.maximum(run["current_1_A"], run["current_2_A"])[1:]
    acting = np.maximum(run["command_1_A"], run["command_2_A"])[:-1]
    assert np.corrcoef(behind, acting)[0, 1] > 0.95


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (
            ("--design", "fuzzy"),
            "'fuzzy' is no design; choose one of lqr, robust, scheduled, scheduled-rigid, biased, pid",
        ),
        (
            ("--design", "pid", "--reference", "sine:frequency=2 Hz,amplitude=0.45 mm,duration=1 s"),
            "the pid design is stable from",
        ),
        (("--reference", "sine:frequency=2 Hz,amplitude=0.6 mm,duration=1 s"), "lower"),
        (("--design", "biased", "--bias", "50 A"), "a bias of 50 A is not possible"),
        (("--overlap", "1 kN"), "an overlap of 1000 N is not possible"),
        (("--model", "missing.json"), "missing.json: cannot be read"),
        (("--model", "model.txt"), "give 'table', an identified model (.json) or an extended model (.toml)"),
        (("--bandwidth", "200 Hz", "--peak-sensitivity", "1.2"), "no weights give a bandwidth of 200 Hz"),
        (("--report", str(ROOT)), str(ROOT)),
    ],
)
def test_what_cannot_be_is_one_line_before_the_run(msl_fem, options, said):
    asked = ("--belief", "plain", "--reference", SINE, *options)
    assert said in msl_fem("control", SERVO, "--table", TABLE, *asked).complaint


def test_a_json_that_is_no_model_is_refused(msl_fem, tmp_path):
    for n, content in enumerate(("[1, 2]", "{", '{"kind": "map"}')):
        file = tmp_path / f"{n}.json"
        file.write_text(content)
        assert msl_fem("control", SERVO, "--table", TABLE, "--model", str(file), "--reference", SINE).complaint


def test_a_guard_that_forbids_the_middle_is_said_before_the_run(msl_fem, tmp_path):
    heavy = tmp_path / "heavy.toml"
    heavy.write_text(Path(SERVO).read_text().replace('constant_force = "0 N"', 'constant_force = "-900 N"'))
    said = msl_fem("control", str(heavy), "--table", TABLE, "--reference", SINE).complaint
    assert "cannot hold the middle of the travel" in said


@pytest.fixture
def diagnosis(tmp_path: Path, extended: str) -> Path:
    folder = tmp_path / "found"
    folder.mkdir()
    (folder / "extended_model.toml").write_text(Path(extended).read_text())
    told = {
        "parameters": {"moving_mass": {"believed": 0.9, "fitted": 0.9, "ci95": [0.897, 0.903]}},
        "causes": [{"effect": "gap_offset", "parameters": {"offset": {"value": 15e-6, "ci95": [14e-6, 16e-6]}}}],
    }
    (folder / "diagnosis.json").write_text(json.dumps(told))
    return folder


def test_a_design_on_what_a_diagnosis_found(msl_fem, diagnosis, extended):
    """The same as with the extended model, judged on what the diagnosis leaves possible; ACTUATOR may be the truth."""
    common = ("--table", TABLE, "--reference", SINE, "--unseen", "2", "--json")
    found = msl_fem("control", "--from", str(diagnosis), *common).json
    known = msl_fem("control", SERVO, "--model", extended, *common).json
    assert found["tracking_rms_m"] == known["tracking_rms_m"]
    assert found["loop"]["unseen"]["suspects"] == []
    assert known["loop"]["unseen"]["suspects"] == ["structural_mode", "gap_offset", "stiffness_nonlinearity"]
    assert found["loop"]["held_share"] == 1
    of_folder = ("--from", str(diagnosis / "diagnosis.json"), "--belief", "plain")
    on_plain = msl_fem("control", SERVO, *of_folder, *common).json
    assert on_plain["effects"] == []
    assert on_plain["inverse_domain"]["source"] == "extended model"


def test_one_command_from_a_record_to_c(msl_fem, diagnosis, tmp_path, monkeypatch):
    """The record is diagnosed once (here what it says is given), and the loop stands beside that of the belief."""
    from msl_fem.cli import diagnose

    record, header = tmp_path / "rec", tmp_path / "controller.h"
    run = "sine:frequency=20 Hz,amplitude=10 mA,bias=0.3 A,duration=120 ms"
    msl_fem("simulate", SERVO, "--table", TABLE, "--belief", "plain", "--excitation", run, "-o", str(record))
    diagnosed = []

    def given(folder, record, table, belief, *, resume):
        diagnosed.append((record.actuator.name, belief.name, resume))
        shutil.copytree(diagnosis, folder)

    monkeypatch.setattr(diagnose, "diagnosis_into", given)
    asked = ("control", "--from", str(record), "--table", TABLE, "--reference", SINE, "--unseen", "3", "--json")
    found = msl_fem(*asked, "--c", str(header)).json
    over = found["loop"]["over_belief"]
    assert over["factor"] > 1.5
    assert over["factor_interval"][0] <= over["factor"] <= over["factor_interval"][1]
    exported = tmp_path / "exported.h"
    to_c = ("--to", "c", "--what", "controller", "-o", str(exported))
    msl_fem("export", SERVO, "--from", str(record), "--table", TABLE, *to_c)
    assert header.read_text() == exported.read_text()
    assert diagnosed == [("fast_tool_servo", "plain", True)], "once for both commands"


def test_what_is_no_diagnosis_is_said(msl_fem, diagnosis, tmp_path):
    common = ("--table", TABLE, "--reference", SINE)
    assert "has no diagnosis.json and is no record" in msl_fem("control", "--from", str(tmp_path), *common).complaint
    both = msl_fem("control", SERVO, "--from", str(diagnosis), "--model", "m.json", *common).complaint
    assert "both tell the controller" in both
    content = json.loads((diagnosis / "diagnosis.json").read_text())
    first = next(iter(content["parameters"]))
    for odd in (None, "x", []):
        content["parameters"][first]["believed"] = odd
        (diagnosis / "diagnosis.json").write_text(json.dumps(content))
        assert "no believed values" in msl_fem("control", "--from", str(diagnosis), *common).complaint
    (diagnosis / "extended_model.toml").unlink()
    assert "nothing was fitted" in msl_fem("control", "--from", str(diagnosis), *common).complaint
    assert "ACTUATOR is missing" in msl_fem("control", *common).complaint


def test_one_file_of_a_voltage_drive_serves_controllers_too(msl_fem, tmp_path: Path) -> None:
    voltage = tmp_path / "voltage.toml"
    text = Path(SERVO).read_text()
    voltage.write_text(text.replace('kind = "current"', 'kind = "voltage"').replace('bandwidth = "1 kHz"\n', ""))
    run = ("--table", TABLE, "--reference", SINE, *ALONE, "--json")
    found = msl_fem("control", str(voltage), "--current-loop", "400 Hz", *run).json
    assert found["current_loop"]["bandwidth_Hz"] == 400.0
    assert found["current_loop"]["limited_by"] == "wish"
    assert found["voltage_limited"] >= 0
    assert found["thermal_guard"]["continuous_current_A"] == pytest.approx(1.5666, rel=1e-4)
    assert "state drive.bandwidth" in msl_fem("control", SERVO, "--current-loop", "400 Hz", *run).complaint
    assert "is not to be had at 20 kHz" in msl_fem("control", str(voltage), "--current-loop", "3 kHz", *run).complaint
    assert "a rise of 900 K" in msl_fem("control", SERVO, "--temperature-rise", "900 K", *run).complaint
