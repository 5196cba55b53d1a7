"""Logs of other programs: .mat of both kinds, CSV with any separator, units, scales, a record that grows."""

import h5py
import numpy as np
import pandas as pd
import pytest
from scipy.io import savemat

from msl_fem.actuator import parse_actuator
from msl_fem.errors import RecordError
from msl_fem.record import load_record
from msl_fem.record.log_columns import column_sources
from msl_fem.record.log_import import LONG, LogTiming, RunLabel, import_into, import_log, imported_run
from msl_fem.record.log_signals import read_log

N = 1500
T = np.arange(N) * 1e-3
POSITION = 3e-3 * np.sin(40 * T)
FORCE = 2 + np.cos(90 * T)
COLUMNS = "time_s=t:unit=ms,force_N=motor:scale=2.5 N,position_m=q:unit=mm:scale=-1:offset=14 mm"


@pytest.fixture
def actuator():
    return parse_actuator({"schema": 1, "name": "rig", "motion": {"moving_mass": "1 kg"}, "drive": {"kind": "force"}})


@pytest.fixture
def signals():
    """As the log has them: ms, volts of 2.5 N, mm counted the other way."""
    return {"t": T * 1e3, "motor": FORCE / 2.5, "q": 14 - POSITION * 1e3}


def write_text(path, signals, *, delimiter=",", comment=""):
    rows = [delimiter.join(map(repr, map(float, row))) for row in zip(*signals.values(), strict=True)]
    path.write_text("\n".join([*([comment] if comment else []), delimiter.join(signals), *rows, ""]))


def assert_understood(run):
    """To the nine digits that a CSV file of a record has."""
    assert run.columns["time_s"] == pytest.approx(T, abs=1e-12)
    assert run.columns["position_m"] == pytest.approx(POSITION, rel=1e-8, abs=1e-15)
    assert run.columns["force_N"] == pytest.approx(FORCE, rel=1e-8)


@pytest.mark.parametrize(("delimiter", "comment"), [(",", ""), (";", "# made by a logger"), ("\t", "% units: ms V mm")])
def test_a_text_log(tmp_path, actuator, signals, delimiter, comment) -> None:
    log = tmp_path / "log.csv"
    write_text(log, signals, delimiter=delimiter, comment=comment)
    assert_understood(imported_run(log, column_sources(COLUMNS), actuator, label=RunLabel("log")).run)


@pytest.mark.parametrize("as_structure", [False, True])
def test_a_mat_log(tmp_path, actuator, signals, as_structure) -> None:
    log, prefix = tmp_path / "log.mat", "run." if as_structure else ""
    savemat(log, {"run": signals} if as_structure else signals)
    text = COLUMNS.replace("=t:", f"={prefix}t:").replace("=motor", f"={prefix}motor").replace("=q:", f"={prefix}q:")
    assert_understood(imported_run(log, column_sources(text), actuator, label=RunLabel("log")).run)


@pytest.mark.parametrize("samples_along", [0, 1])
def test_a_matrix_by_rows(tmp_path, actuator, signals, samples_along) -> None:
    log, matrix = tmp_path / "log.mat", np.array(list(signals.values()))
    savemat(log, {"logouts": matrix.T if samples_along == 0 else matrix})
    text = COLUMNS.replace("=t:", "=logouts[0]:").replace("=motor", "=logouts[1]").replace("=q:", "=logouts[2]:")
    assert_understood(imported_run(log, column_sources(text), actuator, label=RunLabel("log")).run)


def test_a_mat_file_of_version_7_3(tmp_path, actuator, signals) -> None:
    log = tmp_path / "log.mat"
    with h5py.File(log, "w") as stream:
        for name, values in signals.items():
            stream[f"run/{name}"] = values[:, None]
    text = COLUMNS.replace("=t:", "=run.t:").replace("=motor", "=run.motor").replace("=q:", "=run.q:")
    assert_understood(imported_run(log, column_sources(text), actuator, label=RunLabel("log")).run)


def test_columns_from_a_file(tmp_path) -> None:
    file = tmp_path / "columns.toml"
    file.write_text(
        '[time_s]\nsource = "t"\nunit = "ms"\n[force_N]\nsource = "motor"\nscale = "2.5 N"\n'
        '[position_m]\nsource = "q"\nunit = "mm"\nscale = -1\noffset = "14 mm"\n'
    )
    assert column_sources(str(file)) == column_sources(COLUMNS)


def test_time_from_a_rate_and_a_part_of_the_log(tmp_path, actuator, signals) -> None:
    log = tmp_path / "log.csv"
    write_text(log, signals)
    sources = column_sources(COLUMNS.partition(",")[2])
    run = imported_run(log, sources, actuator, label=RunLabel("log", start=0.1, end=1.2), timing=LogTiming(1000.0)).run
    assert run.time[[0, -1]] == pytest.approx([0.1, 1.2])
    assert run.columns["force_N"] == pytest.approx(FORCE[100:1201])
    with pytest.raises(RecordError, match="no source for time_s; name one, or give --rate"):
        imported_run(log, sources, actuator, label=RunLabel("log"))
    with pytest.raises(RecordError, match="nothing lies between --from and --to"):
        imported_run(log, sources, actuator, label=RunLabel("log", start=7.0), timing=LogTiming(1000.0))


def test_a_record_is_made_and_grows(tmp_path, actuator, signals) -> None:
    log, folder = tmp_path / "log.csv", tmp_path / "record"
    write_text(log, signals)
    sources = column_sources(COLUMNS)
    with pytest.raises(RecordError, match="name its actuator with --actuator"):
        import_into(folder, imported_run(log, sources, actuator, label=RunLabel("first")))
    import_into(folder, imported_run(log, sources, actuator, label=RunLabel("first")), actuator=actuator)
    rig = folder / "rig.toml"
    rig.write_text(rig.read_text() + "# a remark of the experimenter\n")
    second = imported_run(log, sources, actuator, label=RunLabel("second", "again", "held-out"))
    import_into(folder, second)
    record = load_record(folder)
    assert [(r.name, r.role) for r in record.runs] == [("first", "fit"), ("second", "held-out")]
    assert record.origin == "measured"
    assert record.sampling.rate == pytest.approx(1000)
    assert_understood(record.runs[1])
    assert "# a remark of the experimenter" in rig.read_text()
    before = rig.read_bytes()
    with pytest.raises(RecordError, match="is there already; choose another --name"):
        import_into(folder, second)
    assert rig.read_bytes() == before


def test_a_long_run_becomes_netcdf_and_joins_a_record(tmp_path, actuator) -> None:
    t = np.arange(LONG) * 1e-4
    signals = {"t": t, "motor": np.cos(t), "q": 1e-3 * np.sin(t)}
    log, folder = tmp_path / "log.mat", tmp_path / "record"
    savemat(log, signals)
    sources = column_sources("time_s=t,force_N=motor,position_m=q")
    import_into(folder, imported_run(log, sources, actuator, label=RunLabel("a")), actuator=actuator)
    assert import_into(folder, imported_run(log, sources, actuator, label=RunLabel("b"))).suffix == ".nc"
    assert load_record(folder).runs[1].columns["position_m"] == pytest.approx(signals["q"])


def test_a_new_record_states_the_noise_that_the_actuator_does(tmp_path, servo) -> None:
    """Of the sensors that the run has; who opens rig.toml need not copy it from the other file."""
    t = np.arange(2000) / 1e4
    frame = pd.DataFrame({"time_s": t, "position_m": 1e-5 * np.sin(60 * t)})
    for side in (1, 2):
        frame[f"current_{side}_A"] = 0.3 + 0.01 * np.sin(60 * t)
    columns = ",".join(f"{name}={name}" for name in frame)
    import_into(tmp_path / "r", import_log(frame, columns, servo), actuator=servo)
    noise = load_record(tmp_path / "r").noise
    assert noise.position == servo.position_sensor.noise > 0
    assert noise.current == servo.current_sensor.noise > 0


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "--columns is empty"),
        ("speed=t", "speed is no column of a run; there are time_s"),
        ("time_s", "names no source"),
        ("time_s=t,time_s=t", "time_s is there twice"),
        ("time_s=t:unit=mm", "unit 'mm' has the wrong dimension"),
        ("time_s=t:gain=2", "gain is unknown; the keys are source, unit, scale, offset, time"),
        ("time_s=t:scale", "write options like"),
        ("time_s=t:scale=0", "scale is 0 and would erase the signal"),
        ("position_m=q:scale=2 mm:unit=mm", "give one of them"),
        ("position_m=q:offset=3", "has no unit"),
        ("nowhere.toml", "cannot be read"),
    ],
)
def test_columns_that_are_refused(text, said) -> None:
    with pytest.raises(RecordError, match=said):
        column_sources(text)


def test_logs_that_are_refused(tmp_path, actuator, signals) -> None:
    def attempt(name, columns=COLUMNS):
        return imported_run(tmp_path / name, column_sources(columns), actuator, label=RunLabel("log"))

    with pytest.raises(RecordError, match="no such file"):
        attempt("none.mat")
    (tmp_path / "log.xls").write_text("x")
    with pytest.raises(RecordError, match=r"ending '\.xls' is unknown"):
        attempt("log.xls")
    (tmp_path / "broken.mat").write_bytes(b"MATLAB 5.0 MAT-file" + bytes(300))
    with pytest.raises(RecordError, match=r"broken\.mat: "):
        attempt("broken.mat")
    (tmp_path / "empty.csv").write_text("\n# nothing\n")
    with pytest.raises(RecordError, match="is empty"):
        attempt("empty.csv")
    write_text(tmp_path / "ragged.csv", signals)
    (tmp_path / "ragged.csv").write_text((tmp_path / "ragged.csv").read_text() + "1,2\n")
    with pytest.raises(RecordError, match=f"row {N + 2}: 2 cells under 3 names"):
        attempt("ragged.csv")
    write_text(tmp_path / "log.csv", signals)
    with pytest.raises(RecordError, match="there is no signal 'z'; it has t, motor, q"):
        attempt("log.csv", "time_s=t,force_N=motor,position_m=z")
    with pytest.raises(RecordError, match="current_1_A does not belong to rig"):
        attempt("log.csv", COLUMNS + ",current_1_A=t")
    text = (tmp_path / "log.csv").read_text().replace(repr(float(signals["q"][7])), "stuck", 1)
    (tmp_path / "hole.csv").write_text(text)
    with pytest.raises(RecordError, match="column q"):
        attempt("hole.csv")
    assert set(read_log(tmp_path / "log.csv")) == {"t", "motor", "q"}
