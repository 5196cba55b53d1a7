"""`msl-fem diagnose`: the files and what takes them, one JSON object, one clear line for what is wrong."""

import json
from collections.abc import Callable
from contextlib import redirect_stdout
from dataclasses import replace
from io import StringIO
from pathlib import Path

import numpy as np
import pytest
from conftest import Outcome
from short_menu import cut_menu

import msl_fem as package
from msl_fem.actuator import Actuator, load_actuator
from msl_fem.cli.app import app
from msl_fem.cli.diagnose import STATE, memory_in, tried_line
from msl_fem.cli.output import run_guarded
from msl_fem.comparison import CompareSettings
from msl_fem.diagnosis import DiagnosisSettings
from msl_fem.diagnosis.unknowns import Unknowns
from msl_fem.errors import InputError
from msl_fem.plant import NamedRun, bearable_run, simulation_record
from msl_fem.plant.effects import EffectValues
from msl_fem.plant.excitation import parse_excitation
from msl_fem.plant.extended_model import load_extended_model
from msl_fem.record import Record, load_record, write_record
from msl_fem.table.magnetic_table import MagneticTable, read_table, write_table

Run = Callable[..., Outcome]
NOISE = "band-limited-noise:bias=0.5 A,amplitude=0.12 A,band=300 Hz,duration=0.6 s,seed=4"
SWEEP = "swept-sine:bias=0.5 A,amplitude=0.05 A,start=10 Hz,stop=200 Hz,duration=0.5 s"
RATE, DELAY = 5e3, 1.6e-4
FIELDS = {"schema", "verdict", "reason", "causes", "unexplained", "accuracy", "parameters"}
FILES = ["corrected_table.nc", "diagnosis.json", "extended_model.toml", "report.html"]


def simulated(actuator: Actuator, table: MagneticTable, effects: EffectValues | None) -> Record:
    generator, runs = np.random.default_rng(8), []
    for name, spec in (("noise", NOISE), ("sweep", SWEEP)):
        one = parse_excitation(spec)
        run, _ = bearable_run(actuator, table, one, rate=RATE, effects=effects, generator=generator)
        runs.append(NamedRun(name, spec, "fit" if name == "noise" else "held-out", run))
    return simulation_record(actuator, runs)


@pytest.fixture(scope="module")
def desk(servo: Actuator, table: MagneticTable, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a record of a rig whose position is read late, its table, and its diagnosis in `out`."""
    folder = tmp_path_factory.mktemp("desk")
    late = EffectValues({"time_delay": {"position": DELAY}})
    write_record(simulated(servo, table, late), folder / "record")
    write_table(table, folder / "table.nc")
    return folder


@pytest.fixture(scope="module")
def said(desk: Path) -> str:
    """What the command printed when it made `out`."""
    printed = StringIO()
    arguments = ["diagnose", str(desk / "record"), "--table", str(desk / "table.nc"), "-o", str(desk / "out"), "--json"]
    with redirect_stdout(printed), pytest.MonkeyPatch.context() as patch:
        cut_menu(patch)
        assert run_guarded(lambda: app(arguments)) == 0
    return printed.getvalue()


def test_the_state_of_an_interrupted_diagnosis_is_kept_for_its_own_record(tmp_path: Path) -> None:
    unknowns = Unknowns((("moving_mass", 0.01), ("stiffness", 0.01)), 0, ())
    memory_in(tmp_path, "mark", resume=False).ended("none: ", np.array([0.25, -1.5]))
    end = memory_in(tmp_path, "mark", resume=True).end_of("none: ", unknowns)
    assert end is not None
    assert end.tolist() == [0.25, -1.5]
    assert memory_in(tmp_path, "mark", resume=True).part("turned round").end_of("none: ", unknowns) is None
    memory_in(tmp_path, "mark", resume=True).part("turned round").ended("none: ", np.array([4.0, 5.0]))
    kept = memory_in(tmp_path, "mark", resume=True)
    ends = [memory.end_of("none: ", unknowns) for memory in (kept, kept.part("turned round"))]
    assert [None if one is None else one.tolist() for one in ends] == [[0.25, -1.5], [4.0, 5.0]]
    assert memory_in(tmp_path, "mark", resume=False).end_of("none: ", unknowns) is None
    assert memory_in(tmp_path, "another", resume=True).end_of("none: ", unknowns) is None
    for text in ('{"record": "ma', '{"record": "mark", "fits": {"none: ": [1' + 400 * "0" + "]}}"):
        (tmp_path / STATE).write_text(text)
        with pytest.raises(InputError, match="leave --resume out"):
            memory_in(tmp_path, "mark", resume=True)


def test_resume_without_a_folder_is_refused(desk: Path, msl_fem: Run) -> None:
    outcome = msl_fem("diagnose", str(desk / "record"), "--resume")
    assert outcome.status == 2
    assert "-o DIR" in outcome.stderr


def test_the_cause_is_named_and_all_files_are_there(desk: Path, said: str) -> None:
    fields = json.loads(said)
    assert set(fields) >= FIELDS
    assert fields["verdict"] == "named"
    (cause,) = fields["causes"]
    assert cause["effect"] == "time_delay"
    found = cause["parameters"]["position"]
    assert found["unit"] == "s"
    assert found["ci95"][0] < DELAY < found["ci95"][1]
    assert found["value"] == pytest.approx(DELAY, rel=0.05)
    assert sorted(path.name for path in (desk / "out").iterdir()) == FILES
    stored = json.loads((desk / "out" / "diagnosis.json").read_text())
    assert {name: fields[name] for name in stored} == stored
    assert sorted(fields["files"]) == [str(desk / "out" / name) for name in FILES]
    assert not list(desk.glob(".*"))


def test_the_extended_model_names_its_table_and_has_the_effect(desk: Path, said: str) -> None:
    model = load_extended_model(desk / "out" / "extended_model.toml")
    assert model.effects.get("time_delay", "position") == pytest.approx(DELAY, rel=0.05)
    assert model.actuator.magnet is not None
    assert model.actuator.magnet.kind == "table"
    corrected = read_table(model.actuator.folder / model.actuator.magnet.table)
    believed = read_table(desk / "table.nc")
    change = np.abs(corrected.nodes["force"] / np.maximum(believed.nodes["force"], 1e-9) - 1)[:, 1:]
    assert 0 < change.max() < 0.02
    assert corrected.sections == believed.sections
    assert model.actuator.drive is not None
    record = load_actuator(desk / "record" / "actuator.toml")
    assert model.actuator.drive.coil_resistance == pytest.approx(record.coil_resistance(), rel=0.05)


def test_simulate_takes_it_and_makes_the_measured_run(msl_fem: Run, desk: Path, said: str) -> None:
    """The held-out run comes out of `simulate` as it was measured, up to the noise of both and the instruments' gains
    and zeros, which are believed within tolerances and no part of an actuator file."""
    extended, made = str(desk / "out" / "extended_model.toml"), desk / "again"
    found = msl_fem("simulate", extended, "--excitation", SWEEP, "--rate", "5 kHz", "-o", str(made), "--json").json
    assert "time_delay" in found["effects"]
    measured = load_record(desk / "record").run("sweep")["position_m"]
    again = load_record(made).runs[0]["position_m"]
    error = np.std(measured - again)
    assert error < 5 * 50e-9
    assert measured.std() > 20 * error


def test_compare_takes_it(msl_fem: Run, desk: Path, said: str, tmp_path: Path) -> None:
    """On the first 0.2 s of the runs: the late reading is seen in every one of them."""
    record = load_record(desk / "record")
    begins = (replace(run, columns={name: v[:1000] for name, v in run.columns.items()}) for run in record.runs)
    write_record(replace(record, runs=tuple(begins)), tmp_path / "record")
    extended = str(desk / "out" / "extended_model.toml")
    arguments = ["compare", str(tmp_path / "record"), "--table", str(desk / "table.nc"), "--extended", extended]
    rows = msl_fem(*arguments, "--json").json["models"]
    free = {r["name"]: r["nrmse_free_run"] for r in rows if (r["run"], r["channel"]) == ("sweep", "position_m")}
    name = next(name for name in free if "extended" in name)
    other = min(value for model, value in free.items() if model.startswith("coupled") and value is not None)
    assert free[name] < 0.5 * other


def test_the_table_given_to_compare_is_the_records_not_the_extended_models(
    msl_fem: Run, desk: Path, said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen = []

    def looked_at(record: Record, settings: CompareSettings) -> None:
        seen.append(settings)
        raise InputError("seen")

    monkeypatch.setattr("msl_fem.cli.compare.compare", looked_at)
    extended, given = str(desk / "out" / "extended_model.toml"), str(desk / "table.nc")
    msl_fem("compare", str(desk / "record"), "--table", given, "--extended", extended)
    (settings,) = seen
    own, believed = read_table(desk / "out" / "corrected_table.nc"), read_table(given)
    assert np.array_equal(settings.extended.table.nodes["force"], own.nodes["force"])
    assert np.array_equal(settings.table.nodes["force"], believed.nodes["force"])
    assert not np.array_equal(own.nodes["force"], believed.nodes["force"])


def test_control_takes_it_with_its_own_table(msl_fem: Run, desk: Path, said: str) -> None:
    """As the model of a controller for the rig as it was believed; the table given is not that model's."""
    actuator, file = str(desk / "record" / "actuator.toml"), str(desk / "out" / "extended_model.toml")
    reference = "sine:frequency=2 Hz,amplitude=0.05 mm,duration=0.3 s"
    arguments = ["--model", file, "--table", str(desk / "table.nc"), "--reference", reference]
    found = msl_fem("control", actuator, *arguments, "--json").json
    assert "time_delay" in found["effects"]
    assert 0 < found["tracking_rms_m"] < 5e-6


def test_a_record_that_cannot_decide_leaves_no_model_of_an_earlier_one(
    msl_fem: Run, desk: Path, tmp_path: Path, said: str
) -> None:
    record = load_record(desk / "record")
    only_fit = replace(record, runs=tuple(r for r in record.runs if r.role == "fit"))
    write_record(only_fit, tmp_path / "record")
    out = tmp_path / "out"
    out.mkdir()
    (out / "extended_model.toml").write_text("of an earlier diagnosis")
    (out / "mine.txt").write_text("not the command's")
    arguments = ["diagnose", str(tmp_path / "record"), "--table", str(desk / "table.nc")]
    printed = msl_fem(*arguments, "-o", str(out))
    assert printed.status == 0
    assert "cannot decide" in printed.stdout
    assert json.loads((out / "diagnosis.json").read_text())["verdict"] == "undecidable"
    assert sorted(path.name for path in out.iterdir()) == ["diagnosis.json", "mine.txt", "report.html"]
    before = sorted(tmp_path.rglob("*"))
    assert msl_fem(*arguments, "--json").json["verdict"] == "undecidable"
    assert sorted(tmp_path.rglob("*")) == before


def test_what_is_tried_is_said_on_stderr(capfd: pytest.CaptureFixture[str]) -> None:
    with tried_line() as tell:
        tell("coulomb_friction (force)")
    printed = capfd.readouterr()
    assert printed.out == ""
    assert "coulomb_friction (force)" in printed.err


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["{desk}/nowhere"], "nowhere"),
        (["{desk}/record", "--table", "{desk}/nowhere.nc"], "nowhere.nc"),
        (["{desk}/record", "--table", "{desk}/table.nc", "-o", "{desk}/table.nc"], "table.nc"),
        (["{desk}/record", "--table", "{desk}/table.nc", "-o", "/proc/nowhere"], "cannot be written"),
    ],
)
def test_what_is_wrong_is_one_clear_line(msl_fem: Run, desk: Path, arguments: list[str], complaint: str) -> None:
    before = sorted(desk.iterdir())
    assert complaint in msl_fem("diagnose", *(a.format(desk=desk) for a in arguments)).complaint
    assert sorted(desk.iterdir()) == before


def test_it_is_a_verb_of_the_package(desk: Path) -> None:
    record = load_record(desk / "record")
    alone = replace(record, runs=record.runs[:1])
    found = package.diagnose(alone, DiagnosisSettings(table=read_table(desk / "table.nc")))
    assert found.verdict == "undecidable"
    assert found.to_json()["schema"] == 1
