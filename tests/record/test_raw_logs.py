"""Logs of laboratories: one run in some twenty forms is read alike; damaged ones are refused in one line."""

import h5py
import numpy as np
import pytest
from raw_logs import FORCE, FORMS, MM, POSITION, RATE, N, RawLog, T, force, position

from msl_fem.actuator import parse_actuator
from msl_fem.errors import RecordError
from msl_fem.record.clock import equal_steps, evened, resample, timed_by
from msl_fem.record.log_columns import column_sources
from msl_fem.record.log_import import LogTiming, RunLabel, import_into, imported_run
from msl_fem.record.log_noise import estimated_noise
from msl_fem.record.log_proposal import proposal_text, proposed_columns
from msl_fem.record.log_signals import read_log
from msl_fem.record.reader import known_columns, load_record

ACTUATOR = parse_actuator(
    {"schema": 1, "name": "rig", "motion": {"moving_mass": "1 kg", "nominal_gap": "4 mm"}, "drive": {"kind": "force"}}
)


def import_of(form: RawLog, path):
    timing = LogTiming(form.rate, form.resampled)
    return imported_run(path, column_sources(form.columns), ACTUATOR, label=RunLabel("log"), timing=timing)


@pytest.mark.parametrize("form", FORMS, ids=[form.name for form in FORMS])
def test_a_raw_log_is_read(form: RawLog, tmp_path) -> None:
    if form.package:
        pytest.importorskip(form.package)
    path = tmp_path / f"log{form.ending}"
    form.write(path)
    run = import_of(form, path).run
    assert 1 / run.sampling_period == pytest.approx(RATE, rel=1e-9)
    assert run.time.size >= N - 2
    expected = {"force_N": force(run.time), "position_m": position(run.time)}
    for name, values in expected.items():
        error = np.abs(run.columns[name] - values).max() / np.ptp(values)
        assert error < (1e-3 if form.resampled else 1e-8), name


def test_at_least_twenty_forms_are_read() -> None:
    assert len(FORMS) >= 20


@pytest.mark.parametrize("ending", [".xlsx", ".tdms", ".mf4"])
def test_what_is_not_installed_is_said_in_one_line(ending, tmp_path, monkeypatch) -> None:
    package = {".xlsx": "openpyxl", ".tdms": "npTDMS", ".mf4": "asammdf"}[ending]
    monkeypatch.setitem(__import__("sys").modules, package.lower(), None)
    path = tmp_path / f"log{ending}"
    path.write_bytes(b"x")
    with pytest.raises(RecordError, match=rf"needs {package}; pip install {package}$"):
        read_log(path)


def test_a_timetable_says_how_to_save_it(tmp_path) -> None:
    path = tmp_path / "log.mat"
    with h5py.File(path, "w") as file:
        file["run"] = np.arange(6, dtype="u4")[:, None]
        file["run"].attrs["MATLAB_object_decode"] = 3
        file["gain"] = np.ones(5)
    assert list(read_log(path, only={"gain"})) == ["gain"]
    with pytest.raises(RecordError, match=r"'run' is a MATLAB table.*timetable2table\(run\)"):
        read_log(path, only={"run.x"})


DAMAGES = (
    "cut row",
    "word",
    "infinity",
    "twice",
    "backwards",
    "hole",
    "gap",
    "unit",
    "no column",
    "bytes",
    "swapped",
    "huge",
)


def brought_in(folder, log, sources):
    return import_into(folder, imported_run(log, sources, ACTUATOR, label=RunLabel("log")), actuator=ACTUATOR)


def damaged(rng: np.random.Generator, damage: str) -> bytes:
    """A CSV log with one unmistakable fault somewhere."""
    rows = [[f"{v:.9g}" for v in row] for row in zip(T, FORCE, MM, strict=True)]
    at, column = int(rng.integers(3, N - 3)), int(rng.integers(3))
    delimiter = rng.choice([",", ";", "\t"])
    names = ["t", "F", "x"]
    if damage == "cut row":
        rows[at] = rows[at][: int(rng.integers(1, 3))]
    elif damage in ("word", "infinity", "hole", "huge"):
        rows[at][column] = {
            "word": rng.choice(["OL", "--", "1.2.3", "n/a"]),
            "infinity": "inf",
            "hole": "",
            "huge": "1e300",
        }[damage]
    elif damage == "twice":
        rows[at][0] = rows[at - 1][0]
    elif damage == "backwards":
        rows[at:] = [[f"{float(r[0]) - 0.7:.9g}", *r[1:]] for r in rows[at:]]
    elif damage == "gap":
        del rows[at : at + int(rng.integers(2, 40))]
    elif damage == "unit":
        rows = [[t, f, f"{float(x) * 1e3:.9g}"] for t, f, x in rows]
    elif damage == "no column":
        names[column] = "other"
    elif damage == "swapped":
        rows[at], rows[at + 2] = rows[at + 2], rows[at]
    text = "\n".join([delimiter.join(names), *(delimiter.join(row) for row in rows)]) + "\n"
    raw = text.encode()
    if damage == "bytes":
        k = int(rng.integers(len(raw) // 2))
        raw = raw[:k] + rng.integers(128, 256, 300).astype("u1").tobytes() + raw[k + 300 :]
    return raw


def test_damaged_logs_are_refused_in_one_line(tmp_path) -> None:
    """Nothing is taken of 204 logs with one fault each, and each is told by its file."""
    rng = np.random.default_rng(20)
    log = tmp_path / "log.csv"
    sources = column_sources("time_s=t,force_N=F,position_m=x:unit=mm")
    refused = 0
    for k in range(204):
        damage = DAMAGES[k % len(DAMAGES)]
        log.write_bytes(damaged(rng, damage))
        folder = tmp_path / f"record_{k}"
        with pytest.raises(RecordError) as refusal:
            brought_in(folder, log, sources)
        said = str(refusal.value)
        assert "\n" not in said
        assert "log.csv" in said
        assert not folder.exists()
        refused += 1
    assert refused == 204


def test_a_damaged_row_below_the_names_is_no_preamble(tmp_path) -> None:
    log = tmp_path / "log.csv"
    rows = [f"{t:.3f},{f:.6g}" for t, f in zip(T, FORCE, strict=True)]
    for first in ("0.000,OL", "0.000", "garbage", "x,1.0"):
        log.write_text("\n".join(["t,F", first, *rows[1:]]) + "\n")
        with pytest.raises(RecordError):
            imported_run(log, column_sources("time_s=t,force_N=F,position_m=F"), ACTUATOR, label=RunLabel("log"))


def test_rounded_times_are_of_equal_steps() -> None:
    """Three digits at 700 Hz; a clock that truly jitters by two of its steps, or loses rows, stays as it is."""
    even = np.arange(3000) / 700
    assert evened(np.round(even, 3))[0] == pytest.approx(even, abs=6e-4)
    assert np.diff(evened(np.round(even, 3))[0]) == pytest.approx(np.full(2999, 1 / 700), rel=1e-6)
    rng = np.random.default_rng(2)
    assert equal_steps(np.round(even * 7 + rng.uniform(-3e-3, 3e-3, 3000), 3)) is None
    assert equal_steps(np.delete(np.round(even, 3), 1500)) is None
    assert evened(even)[1] == ""
    assert equal_steps(0.01 * np.arange(1000) + 1e-4 * (np.arange(1000) > 499)) is not None  # 10.1 ms once


def test_a_rate_goes_before_the_time_and_may_not_contradict_it() -> None:
    time, remark = timed_by(1000.0, np.round(T, 2), N, file="log.csv")
    assert np.diff(time) == pytest.approx(np.full(N - 1, 1e-3))
    assert "goes before" in remark
    with pytest.raises(RecordError, match="rows are missing, or the unit is another"):
        timed_by(1000.0, T * 1.05, N, file="log.csv")


@pytest.mark.parametrize("slower", [1.0, 4.0])
def test_what_resampling_does_to_noise_is_what_it_says(slower) -> None:
    """White noise through it, against what it says of its sigma and of neighbours; and a signal comes through."""
    rng = np.random.default_rng(3)
    time = np.cumsum(rng.uniform(0.8e-3, 1.2e-3, 40_000))
    grid = np.arange(time[0], time[-1], 1e-3 * slower)
    said = resample(rng.normal(size=time.size), time, grid, source="x", file="log.csv")
    noise = said.values[50:-50]
    assert noise.std() == pytest.approx(said.noise_gain, rel=0.03)
    assert np.mean(noise[1:] * noise[:-1]) / np.var(noise) == pytest.approx(said.correlation, abs=0.03)
    through = resample(np.sin(60 * time), time, grid, source="x", file="log.csv").values
    assert np.abs(through - np.sin(60 * grid))[50:-50].max() < 1e-3


def test_no_gap_is_bridged() -> None:
    time = np.delete(T, slice(400, 420))
    with pytest.raises(RecordError, match=r"'x' has no value from 0\.399 s to 0\.42 s"):
        resample(time, time, T, source="x", file="log.csv")


@pytest.mark.parametrize("resolution", [0.0, 2e-5])
def test_noise_is_estimated_beside_a_signal(resolution) -> None:
    rng = np.random.default_rng(4)
    measured = POSITION + rng.normal(0, 1e-6, N)
    if resolution:
        measured = resolution * np.round(measured / resolution)
    assert estimated_noise(measured) == pytest.approx(max(1e-6, resolution / np.sqrt(12)), rel=0.35)
    assert estimated_noise(np.ones(100)) == 0.0


def test_noise_is_written_with_a_remark(tmp_path) -> None:
    rng = np.random.default_rng(5)
    log = tmp_path / "log.csv"
    noisy = MM + rng.normal(0, 2e-3, N)
    log.write_text("\n".join(["t,F,x", *(f"{a:.6g},{b:.9g},{c:.9g}" for a, b, c in zip(T, FORCE, noisy, strict=True))]))
    sources = column_sources("time_s=t,force_N=F,position_m=x:unit=mm")
    import_into(tmp_path / "rec", imported_run(log, sources, ACTUATOR, label=RunLabel("log")), actuator=ACTUATOR)
    assert load_record(tmp_path / "rec").noise.position == pytest.approx(2e-6, rel=0.15)
    assert "estimated from run log" in (tmp_path / "rec" / "rig.toml").read_text()


@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize("odd", ["inf", "1e300", "nan"])
def test_what_no_sensor_shows_tells_no_sign_and_no_unit(tmp_path, servo, odd) -> None:
    log = tmp_path / "log.csv"
    rows = [f"{k / 1e3},{odd if k % 2 else -odd_free(k)},{odd_free(k)},{odd}" for k in range(60)]
    log.write_text("\n".join(["t,u1,i1,x", *rows]) + "\n")
    columns = proposed_columns(log, servo)
    assert columns["current_1_A"].scale == -1.0
    assert columns["position_m"].unit == ""


def odd_free(k: int) -> float:
    return 1.0 + 0.01 * k


def test_columns_are_proposed_with_units_and_signs(tmp_path) -> None:
    """Names, units in brackets, a position without a unit by its travel, and a current that was wired the other way."""
    servo = parse_actuator(
        {"schema": 1, "name": "coil", "motion": {"moving_mass": "1 kg", "nominal_gap": "4 mm"},
         "drive": {"kind": "voltage"},
         "magnet": {"kind": "table", "table": "none.nc"}, "sides": {"count": 1, "magnets_per_side": 1}}
    )  # fmt: skip
    log = tmp_path / "log.csv"
    voltage = 5 * np.sin(30 * T)
    current = -0.8 * np.sin(30 * T - 0.4) * 1e3
    body = [",".join(f"{v:.9g}" for v in row) for row in zip(T * 1e3, voltage, current, MM, strict=True)]
    log.write_text("\n".join(["Time (ms),U1 [V],I1 (mA),probe", *body]) + "\n")
    columns = proposed_columns(log, servo)
    assert {name: (it.source, it.unit, it.scale) for name, it in columns.items()} == {
        "time_s": ("Time (ms)", "ms", 1.0),
        "voltage_1_V": ("U1 [V]", "", 1.0),
        "current_1_A": ("I1 (mA)", "mA", -1.0),
        "position_m": ("probe", "mm", 1.0),
    }
    file = tmp_path / "columns.toml"
    file.write_text(proposal_text(log, columns, known_columns(servo)))
    run = imported_run(log, column_sources(str(file)), servo, label=RunLabel("log")).run
    assert run.columns["current_1_A"] == pytest.approx(-1e-3 * current, rel=1e-7, abs=1e-12)
    assert run.columns["position_m"] == pytest.approx(POSITION, rel=1e-7, abs=1e-12)
    assert "a coil takes power" in file.read_text()


def test_a_cut_first_row_of_a_log_without_names_is_not_skipped(tmp_path) -> None:
    log = tmp_path / "log.csv"
    rows = [f"{t:.3f},{f:.6g},{x:.6g}" for t, f, x in zip(T, FORCE, MM, strict=True)]
    log.write_text("\n".join(["0.000,3", *rows[1:]]) + "\n")
    with pytest.raises(RecordError, match="row 1: 2 cells, 3 in the rows below"):
        read_log(log)


NO_LOG = {"empty": b"", "zeros": bytes(20_000), "prose": b"this is no log\n" * 9}


@pytest.mark.parametrize("form", FORMS, ids=[form.name for form in FORMS])
def test_what_is_no_log_of_its_form_is_refused_in_one_line(form: RawLog, tmp_path) -> None:
    """Nothing, zeros, prose, and a column that is not there, in each of the forms."""
    if form.package:
        pytest.importorskip(form.package)
    good, bad = tmp_path / f"good{form.ending}", tmp_path / f"bad{form.ending}"
    form.write(good)
    missing = form.columns.replace("position_m=", "position_m=none_")
    cases = [(content, form.columns) for content in NO_LOG.values()] + [(good.read_bytes(), missing)]
    for content, columns in cases:
        bad.write_bytes(content)
        timing = LogTiming(form.rate, form.resampled)
        with pytest.raises(RecordError) as refusal:
            imported_run(bad, column_sources(columns), ACTUATOR, label=RunLabel("log"), timing=timing)
        assert "\n" not in str(refusal.value)
        assert "bad" in str(refusal.value)


def spoilt(content: bytes, rng: np.random.Generator, damage: str) -> bytes:
    """A log cut somewhere in its second half, or with 40 bytes in a row of its first half that are others."""
    if damage == "cut":
        return content[: int(rng.integers(len(content) // 2, len(content) * 9 // 10))]
    at = int(rng.integers(len(content) // 8, len(content) // 2))
    return content[:at] + rng.integers(128, 256, 40).astype("u1").tobytes() + content[at + 40 :]


def answer_to(form: RawLog, path) -> tuple[str, tuple[str, ...]]:
    """Why a log is refused, or the remarks with which it is taken."""
    try:
        return "", import_of(form, path).remarks
    except RecordError as refusal:
        return str(refusal), ()


UNTOLD = 6
"""Of 204 at most, of which nothing is told: no length is stated, and bytes of a binary file stay numbers."""


def test_logs_of_all_forms_cut_or_spoilt_in_the_middle(tmp_path) -> None:
    """204 over all forms: refused in one line by file, or told; never a traceback; refused where a length is stated."""
    rng = np.random.default_rng(11)
    forms = [form for form in FORMS if not form.package]
    stating = {"LeCroy", "Tektronix MSO", "Tektronix TDS", "Keysight Infiniium"}
    taken: list[tuple[str, str]] = []
    for k in range(204):
        form, damage = forms[k % len(forms)], ("cut", "bytes")[k // len(forms) % 2]
        path = tmp_path / f"log_{k}{form.ending}"
        form.write(path)
        path.write_bytes(spoilt(path.read_bytes(), rng, damage))
        said, remarks = answer_to(form, path)
        assert "\n" not in said
        assert not said or path.name in said
        if not said and not any("if it was cut" in remark for remark in remarks):
            taken.append((form.name, damage))
        path.unlink()
    assert not [form for form, _ in taken if form in stating]
    assert len(taken) <= UNTOLD, taken


@pytest.mark.parametrize("name", ["LeCroy", "Tektronix MSO", "Tektronix TDS", "Keysight Infiniium"])
def test_a_log_with_fewer_rows_than_it_states_is_refused(name, tmp_path) -> None:
    """Cut at the end of a row, so that nothing else shows it."""
    (form,) = (form for form in FORMS if form.name == name)
    path = tmp_path / f"log{form.ending}"
    form.write(path)
    path.write_bytes(b"\n".join(path.read_bytes().split(b"\n")[:900]) + b"\n")
    with pytest.raises(RecordError, match=rf"holds 8\d\d rows and states {N} .*: it is cut|holds 900 rows and states"):
        import_of(form, path)
