"""`msl-fem calibrate`: records like the given one, how many are given a name, and how an interrupted run goes on."""

import contextlib
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import Outcome

from msl_fem.actuator import Actuator
from msl_fem.bench import BenchOptions, sealed_record
from msl_fem.bench.likeness import alike
from msl_fem.cli import calibrate
from msl_fem.cli.app import app
from msl_fem.errors import InputError
from msl_fem.plant.excitation import parse_excitation
from msl_fem.record import Record, write_record
from msl_fem.table.magnetic_table import MagneticTable, write_table

RUNS = (
    "band-limited-noise:bias=0.5 A,amplitude=50 mA,band=200 Hz,duration=0.7 s,seed=4,role=fit",
    "swept-sine:bias=0.5 A,amplitude=30 mA,start=10 Hz,stop=150 Hz,duration=0.5 s,role=held-out",
)


@pytest.fixture(scope="module")
def record(servo: Actuator, table: MagneticTable) -> Record:
    excitations = tuple(parse_excitation(text, unit="A") for text in RUNS)
    return sealed_record(servo, table, (), BenchOptions(seed=3, rate=5e3, excitations=excitations)).record


@pytest.fixture(scope="module")
def desk(record: Record, table: MagneticTable, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("desk")
    write_record(record, folder / "record")
    write_table(table, folder / "table.nc")
    return folder


def test_a_likeness_has_the_inputs_and_roles_of_its_record_and_another_rig(
    record: Record, table: MagneticTable
) -> None:
    one, other = (alike(record, table, seed=seed) for seed in (1, 2))
    for made in (one, other):
        assert [(run.name, run.role, sorted(run.columns)) for run in made.runs] == [
            (run.name, run.role, sorted(run.columns)) for run in record.runs
        ]
        for run, own in zip(made.runs, record.runs, strict=True):
            gain, zero = np.polyfit(own["command_1_A"], run["command_1_A"], 1)  # its drive's gain and zero are others
            assert abs(gain - 1) < 0.05
            assert run["command_1_A"] == pytest.approx(gain * own["command_1_A"] + zero, abs=1e-9)
            assert np.corrcoef(run["current_1_A"], own["current_1_A"])[0, 1] > 0.99
            assert 0.5 < np.std(run["position_m"]) / np.std(own["position_m"]) < 2.0
    apart = np.sqrt(np.mean((one.runs[0]["position_m"] - other.runs[0]["position_m"]) ** 2))
    assert record.noise.position is not None
    assert apart > 10 * record.noise.position
    assert np.array_equal(alike(record, table, seed=1).runs[0]["position_m"], one.runs[0]["position_m"])


def test_a_record_whose_inputs_are_not_there_is_refused(record: Record, table: MagneticTable) -> None:
    runs = [replace(run, columns={n: v for n, v in run.columns.items() if "command" not in n}) for run in record.runs]
    with pytest.raises(InputError, match="command_1_A"):
        alike(replace(record, runs=tuple(runs)), table, seed=1)


def test_an_interrupted_calibration_goes_on_and_tells_the_rate(desk: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every third diagnosis names something here; of twelve the interval is that of a binomial distribution."""
    made: list[int] = []

    class EndedError(Exception):
        pass

    def diagnosed(record: Record, table: object, seed: int, controller: object) -> dict[str, object]:
        if len(made) == 5:
            made.append(-1)
            raise EndedError
        made.append(seed)
        names = ["coulomb_friction"] if seed % 3 == 0 else []
        return {"seed": seed, "verdict": "named" if names else "nothing-found", "names": names, "nats": 1.0}

    monkeypatch.setattr(calibrate, "diagnosed", diagnosed)
    arguments = [str(desk / "record"), "--table", str(desk / "table.nc"), "-o", str(desk / "out"), "--records", "12"]
    with pytest.raises(EndedError):
        _called(arguments)
    rows = desk / "out" / "calibration.jsonl"
    assert len(rows.read_text().splitlines()) == 5
    assert not (desk / "out" / "calibration.json").exists()
    with rows.open("a") as out:
        out.write('{"seed": 5, "verd')  # cut off
    _called([*arguments, "--resume"])
    assert sorted(made) == [-1, *range(12)]
    fields = json.loads((desk / "out" / "calibration.json").read_text())
    assert (fields["records"], fields["named"], fields["rate"]) == (12, 4, pytest.approx(1 / 3))
    low, high = fields["interval"]
    assert low == pytest.approx(0.0992, abs=1e-3)
    assert high == pytest.approx(0.6511, abs=1e-3)
    kept = [row["seed"] for row in calibrate.finished(rows)]
    assert sorted(kept) == list(range(12)), "the row after the cut one has a line of its own"


LINE = {"record": "a", "seed": 1, "verdict": "named", "names": ["time_delay"], "nats": 12.5, "reason": ""}


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"seed": "1"}, "line 2: seed"),
        ({"seed": -1}, "line 2: seed"),
        ({"seed": None}, "line 2: seed"),
        ({"record": ["a"]}, "line 2: record"),
        ({"verdict": []}, "line 2: verdict"),
        ({"verdict": "perhaps"}, "line 2: verdict"),
        ({"names": "time_delay"}, "line 2: names"),
        ({"nats": "12"}, "line 2: nats"),
        ({"nats": float("inf")}, "line 2: nats"),
    ],
)
def test_a_line_of_another_form_is_refused(tmp_path: Path, change: dict[str, object], told: str) -> None:
    lines = tmp_path / calibrate.ROWS
    lines.write_text("".join(json.dumps(row) + "\n" for row in (LINE, LINE | change)))
    with pytest.raises(InputError, match=told):
        calibrate.known_rows(lines, "a")


def test_lines_that_are_no_text_are_refused_and_cut_ones_left_out(tmp_path: Path) -> None:
    lines = tmp_path / calibrate.ROWS
    lines.write_text(json.dumps(LINE) + "\n" + "9" * 20_000 + '\n{"seed": 2\n')
    assert calibrate.known_rows(lines, "a") == {1: LINE}
    assert calibrate.known_rows(lines, "b") == {}
    lines.write_bytes(b"\xc3\x28")
    with pytest.raises(InputError, match="leave --resume out"):
        calibrate.known_rows(lines, "a")


def _called(arguments: list[str]) -> None:
    """The command as a function: exceptions come through."""
    with contextlib.suppress(SystemExit):
        app(["calibrate", *arguments])


def test_a_full_diagnosis_of_a_likeness_names_nothing(record: Record, table: MagneticTable) -> None:
    row = calibrate.diagnosed(record, table, 1, None)
    assert row["verdict"] == "nothing-found"
    assert row["names"] == []
    assert row["nats"] < 10


@pytest.mark.parametrize(("extra", "told"), [(["--records", "0"], "1 ... 10000"), (["--resume"], "-o DIR")])
def test_wrong_options_are_refused(msl_fem: Callable[..., Outcome], desk: Path, extra: list[str], told: str) -> None:
    outcome = msl_fem("calibrate", str(desk / "record"), *extra)
    assert outcome.status == 2
    assert told in outcome.stderr
