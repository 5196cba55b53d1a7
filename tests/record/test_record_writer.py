"""Records are written whole, with the files that their actuator names, read back the same, and destroy nothing."""

import dataclasses
import shutil
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import ROOT
from small_record import RATE, columns

import msl_fem.record.writer
from msl_fem.actuator import Actuator, MeshMagnet, TableMagnet
from msl_fem.computing.laws import parse_expression
from msl_fem.errors import InputError, RecordError
from msl_fem.materials.material import LIBRARY
from msl_fem.record.columns import Column
from msl_fem.record.reader import load_record
from msl_fem.record.record import Noise, Record, Run, Sampling, StaticMap, Tolerance
from msl_fem.record.writer import write_record

STATIC = StaticMap(
    gap=np.array([1e-3, 1e-3, 2e-3]),
    current=np.array([0.0, 1.0 / 3.0, 2.0]),
    force=np.array([0.0, 1.5, 2.5]),
    flux_linkage=None,
    role=np.array(["fit", "held-out", "fit"]),
    direction=np.array(["up", "down", "up"]),
)


@pytest.fixture
def record(servo: Actuator) -> Record:
    return Record(
        origin="simulated",
        actuator=servo.model_copy(update={"motion": servo.motion.model_copy(update={"moving_mass": 0.87})}),
        sampling=Sampling(rate=RATE),
        noise=Noise(position=50e-9, current=2e-3),
        tolerance=Tolerance(stiffness=0.03),
        controller={"law": 'pid "fast"', "kp": "1 A/m", "gains": [[1.0, 2.0], [0.5, 0.25]], "form": {"ideal": True}},
        runs=(
            Run("noise", "sine:frequency=2 Hz", "fit", columns(), {"humidity": np.full(1000, 0.4)}),
            Run("sweep", "swept sine", "held-out", columns(seed=2), file_format="nc"),
        ),
        static=STATIC,
    )


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_a_record_reads_back(record: Record, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_record(record, tmp_path / "deep" / "r")
    monkeypatch.chdir(tmp_path)  # far from geometries/: the folder stands on its own
    again = load_record(tmp_path / "deep" / "r")
    for field in ("origin", "sampling", "tolerance", "controller"):
        assert getattr(again, field) == getattr(record, field), field
    assert (again.noise.position, again.noise.current) == pytest.approx((50e-9, 2e-3), rel=1e-15)
    assert again.actuator.digest == record.actuator.digest
    assert again.actuator.sources == record.actuator.sources
    for before, after in zip(record.runs, again.runs, strict=True):
        assert (after.name, after.excitation, after.role, after.file) == (
            before.name, before.excitation, before.role, before.file,
        )  # fmt: skip
        tolerance = 5e-9 if after.file.endswith(".csv") else 0.0
        for name, values in before.columns.items():
            assert np.abs(after[name] - values).max() <= tolerance * np.abs(values).max(), name
    assert again.runs[0].extra["humidity"].tolist() == [0.4] * 1000
    assert again.static is not None
    assert again.static.role.tolist() == STATIC.role.tolist()
    assert again.static.current == pytest.approx(STATIC.current, rel=5e-9)
    assert again.static.direction is not None
    assert again.static.direction.tolist() == ["up", "down", "up"]


def test_writing_what_was_read_changes_nothing(record: Record, tmp_path: Path) -> None:
    write_record(record, tmp_path / "a")
    write_record(load_record(tmp_path / "a"), tmp_path / "b")
    assert names(tmp_path / "a") == names(tmp_path / "b")
    for name in names(tmp_path / "a"):
        if not name.endswith(".nc"):
            assert (tmp_path / "a" / name).read_text() == (tmp_path / "b" / name).read_text(), name


def test_rig_toml_is_for_people(record: Record, tmp_path: Path) -> None:
    write_record(record, tmp_path / "r")
    rig = tomllib.loads((tmp_path / "r" / "rig.toml").read_text())
    assert rig["sampling"] == {"rate": "10 kHz", "hold": "zero-order"}
    assert rig["noise"] == {"position": "50 nm", "current": "2 mA"}
    assert rig["run"][0] == {"file": "noise.csv", "excitation": "sine:frequency=2 Hz", "role": "fit"}


def test_files_that_the_actuator_names_come_along(record: Record, tmp_path: Path) -> None:
    source = tmp_path / "lab"
    (source / "curves").mkdir(parents=True)
    curve = "H_A_per_m,B_T\n0,0\n100,1\n300,1.3\n1000,1.5\n5000,1.7\n"
    (source / "curves" / "mine.csv").write_text(curve)
    core = record.actuator.magnet
    magnet = core.model_copy(update={"iron": core.iron.model_copy(update={"core": "curves/mine.csv"})})
    moved = record.actuator.model_copy(update={"magnet": magnet, "file": source / "a.toml"})
    write_record(dataclasses.replace(record, actuator=moved), tmp_path / "r")
    again = load_record(tmp_path / "r").actuator
    assert (again.magnet.iron.core, again.magnet.iron.armature) == ("mine.csv", "m19")
    assert (again.folder / "mine.csv").read_text() == curve


def test_an_old_record_is_replaced_and_no_trace_is_left(record: Record, tmp_path: Path) -> None:
    write_record(record, tmp_path / "r")
    write_record(dataclasses.replace(record, runs=record.runs[:1], static=None), tmp_path / "r")
    assert names(tmp_path / "r") == ["actuator.toml", "noise.csv", "rig.toml"]
    assert names(tmp_path) == ["r"]


def test_an_empty_folder_is_filled(record: Record, tmp_path: Path) -> None:
    (tmp_path / "r").mkdir()
    write_record(record, tmp_path / "r")
    load_record(tmp_path / "r")


def test_a_folder_of_other_files_is_left_alone(record: Record, tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("years of work")
    with pytest.raises(RecordError, match="holds files and is no record"):
        write_record(record, tmp_path)
    assert names(tmp_path) == ["thesis.tex"]


def test_what_lies_beside_an_old_record_is_left_alone(record: Record, tmp_path: Path) -> None:
    write_record(record, tmp_path / "r")
    (tmp_path / "r" / "photos").mkdir()
    (tmp_path / "r" / "photos" / "bench.jpg").write_text("")
    with pytest.raises(RecordError, match=r"holds photos/bench\.jpg beside the record"):
        write_record(record, tmp_path / "r")


def test_measured_data_are_never_replaced_by_simulated(record: Record, tmp_path: Path) -> None:
    measured = dataclasses.replace(record, origin="measured")
    write_record(measured, tmp_path / "r")
    with pytest.raises(RecordError, match="holds measured data"):
        write_record(record, tmp_path / "r")
    write_record(measured, tmp_path / "r")
    assert load_record(tmp_path / "r").origin == "measured"


@pytest.mark.parametrize("target", [None, "nowhere", "empty"])
def test_a_file_or_a_link_is_no_place_for_a_record(record: Record, tmp_path: Path, target: str | None) -> None:
    (tmp_path / "empty").mkdir()
    if target is None:
        (tmp_path / "r").write_text("x")
    else:
        (tmp_path / "r").symlink_to(tmp_path / target)
    with pytest.raises(RecordError, match="is there and is no folder"):
        write_record(record, tmp_path / "r")


@pytest.mark.parametrize("exists", [False, True])
def test_a_write_that_fails_leaves_what_was_there(
    record: Record, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, exists: bool
) -> None:
    """Ctrl-C in the middle of the second run: the old record stands, and no half of the new one."""
    folder = tmp_path / "r"
    if exists:
        write_record(record, folder)
    before = {path.name: path.read_bytes() for path in folder.iterdir()} if exists else {}
    write = msl_fem.record.writer.write_columns

    def interrupted(path: Path, table: dict[str, Column]) -> None:
        if path.name == "sweep.nc":
            raise KeyboardInterrupt
        write(path, table)

    monkeypatch.setattr(msl_fem.record.writer, "write_columns", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_record(dataclasses.replace(record, origin="measured"), folder)
    assert names(tmp_path) == (["r"] if exists else [])
    if exists:
        assert {path.name: path.read_bytes() for path in folder.iterdir()} == before


@pytest.mark.parametrize("exists", [False, True])
def test_a_last_step_that_fails_puts_the_old_record_back(
    record: Record, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, exists: bool
) -> None:
    if exists:
        write_record(record, tmp_path / "r")
    rename = Path.rename

    def failing(self: Path, target: Path) -> Path:
        if self.name == "new":
            raise PermissionError(13, "no")
        return rename(self, target)

    monkeypatch.setattr(Path, "rename", failing)
    with pytest.raises(RecordError, match=r"cannot be written \(no\)"):
        write_record(record, tmp_path / "r")
    assert names(tmp_path) == (["r"] if exists else [])
    if exists:
        load_record(tmp_path / "r")


def spoilt(record: Record, **changed: np.ndarray) -> Record:
    run = Run("noise", "", "fit", {**columns(), **changed})
    return dataclasses.replace(record, runs=(run,))


def test_what_could_not_be_read_is_not_written(record: Record, tmp_path: Path) -> None:
    nan = columns()["position_m"] * np.where(np.arange(1000) == 3, np.nan, 1)
    bad_static = dataclasses.replace(STATIC, gap=-STATIC.gap)
    for bad, said in (
        (spoilt(record, position_m=nan), r"noise\.csv: row 5 \(sample 3\), column position_m"),
        (spoilt(record, time_s=columns()["time_s"] * 2), "rig.toml states"),
        (dataclasses.replace(record, static=bad_static), r"static\.csv: row 3 \(sample 1\), column gap_m|row 2"),
        (dataclasses.replace(record, runs=record.runs[1:], static=None), 'role "fit"'),
        (dataclasses.replace(record, controller={"gain": np.eye(2)}), "controller: ndarray has no TOML form"),
        (dataclasses.replace(record, runs=(dataclasses.replace(record.runs[0], name="../x"),)), "leaves the record"),
        (dataclasses.replace(record, runs=(dataclasses.replace(record.runs[0], name="static"),)), "have this name"),
    ):
        with pytest.raises(RecordError, match=said):
            write_record(bad, tmp_path / "r")
        assert names(tmp_path) == []


TABLE = ROOT / "lookup_tables" / "fast_tool_servo.nc"
MESH = ROOT / "geometries" / "u_core.msh"
CURVE = (LIBRARY / "m19.csv").read_text()
SECRET = b"-----BEGIN PRIVATE KEY-----\n"
REFUSED = {
    "table": "is no file|no such file|not a magnetic table",
    "mesh": "is no file in the actuator's folder or below",
    "curve": "cannot be read; give a CSV file|the first line must name the columns",
}


def record_of(servo: Actuator, kind: str, name: str, folder: Path) -> Record:
    """A record whose actuator, a file in this folder, names a file."""
    core = servo.magnet
    magnets: dict[str, Any] = {
        "table": TableMagnet(kind="table", table=name),
        "mesh": MeshMagnet(kind="mesh", mesh=name, stack_depth=0.02, gap=5e-4, turns=300, iron=core.iron),
        "curve": core.model_copy(update={"iron": core.iron.model_copy(update={"core": name})}),
    }
    folder.mkdir(parents=True, exist_ok=True)
    update = {"magnet": magnets[kind], "file": folder / "a.toml", "sources": {}}
    run = Run("noise", "", "fit", columns())
    return Record("simulated", servo.model_copy(update=update), sampling=Sampling(rate=RATE), runs=(run,))


def written(root: Path) -> list[str]:
    return sorted(str(path.relative_to(root)) for path in root.rglob("*") if path.is_file())


@pytest.mark.parametrize(("kind", "file"), [("table", TABLE), ("mesh", MESH), ("curve", None)])
@pytest.mark.parametrize("name", ["{}", "parts/{}"])
def test_what_lies_with_the_actuator_comes_along(
    kind: str, file: Path | None, name: str, servo: Actuator, tmp_path: Path
) -> None:
    named = tmp_path / "lab" / name.format("mine.csv" if file is None else file.name)
    named.parent.mkdir(parents=True)
    named.write_bytes(CURVE.encode() if file is None else file.read_bytes())
    write_record(record_of(servo, kind, name.format(named.name), tmp_path / "lab"), tmp_path / "out")
    assert (tmp_path / "out" / named.name).read_bytes() == named.read_bytes()
    assert load_record(tmp_path / "out").actuator.folder == tmp_path / "out"


@pytest.mark.parametrize("absolute", [False, True])
@pytest.mark.parametrize("kind", ["table", "curve"])
def test_a_curve_or_a_table_from_elsewhere_comes_along_as_what_it_is(
    kind: str, absolute: bool, servo: Actuator, tmp_path: Path
) -> None:
    """An extended model names the files of the actuator that it was made of: ../geometries/mine.csv."""
    (tmp_path / "lab").mkdir()
    if kind == "table":
        shutil.copyfile(TABLE, tmp_path / "lab" / "mine")
    else:
        (tmp_path / "lab" / "mine.csv").write_text(CURVE)
    name = "mine" if kind == "table" else "mine.csv"
    path = str(tmp_path / "lab" / name) if absolute else f"../lab/{name}"
    write_record(record_of(servo, kind, path, tmp_path / "found"), tmp_path / "out")
    assert written(tmp_path / "out") == ["actuator.toml", name, "noise.csv", "rig.toml"]
    assert f'"{name}"' in (tmp_path / "out" / "actuator.toml").read_text()


@pytest.mark.parametrize("kind", ["table", "mesh", "curve"])
@pytest.mark.parametrize("how", ["../{}", "{root}/{}", "x/../../{}", "link"])
def test_a_file_of_another_kind_is_never_copied_into_a_record(
    kind: str, how: str, servo: Actuator, tmp_path: Path
) -> None:
    """A private key that a foreign actuator calls its table would else go to whoever gets the record."""
    name = "key.csv" if kind == "curve" else "key"
    (tmp_path / name).write_bytes(SECRET)
    (tmp_path / "lab" / "x").mkdir(parents=True)
    if how == "link":
        (tmp_path / "lab" / f"link_{name}").symlink_to(tmp_path / name)
        how = "link_{}"
    record = record_of(servo, kind, how.format(name, root=tmp_path), tmp_path / "lab")
    before = written(tmp_path)
    with pytest.raises(InputError, match=REFUSED[kind]) as refused:
        write_record(record, tmp_path / "out")
    assert "PRIVATE" not in str(refused.value)
    assert written(tmp_path) == before
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("kind", ["table", "mesh"])
@pytest.mark.parametrize("name", ["/dev/zero", "/proc/self/mem", "..", ".", "", "a\0b", "../../../../dev/zero"])
def test_devices_and_folders_are_refused_before_anything_is_copied(
    kind: str, name: str, servo: Actuator, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A copy of /dev/zero ends when the disk is full."""

    def copied(source: Path, target: Path) -> None:
        pytest.fail(f"{source} would be copied to {target}")

    monkeypatch.setattr(shutil, "copyfile", copied)
    with pytest.raises(InputError, match=REFUSED[kind]):
        write_record(record_of(servo, kind, name, tmp_path / "lab"), tmp_path / "out")
    assert written(tmp_path) == []


@pytest.mark.parametrize("name", ["/dev/zero.csv", "a\0.csv", "..csv", "/../.csv"])
def test_a_curve_that_is_none_is_refused(name: str, servo: Actuator, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=REFUSED["curve"]):
        write_record(record_of(servo, "curve", name, tmp_path / "lab"), tmp_path / "out")
    assert written(tmp_path) == []


@pytest.mark.parametrize("name", ["./noise", ".//noise", "./mine", "./static"])
def test_a_run_never_takes_the_place_of_another_file(name: str, servo: Actuator, tmp_path: Path) -> None:
    record = record_of(servo, "curve", "mine.csv", tmp_path / "lab")
    (tmp_path / "lab" / "mine.csv").write_text(CURVE)
    twice = dataclasses.replace(record, runs=(*record.runs, dataclasses.replace(record.runs[0], name=name)))
    with pytest.raises(InputError, match="have this name"):
        write_record(twice, tmp_path / "out")
    assert written(tmp_path) == ["lab/mine.csv"]


def test_causes_of_the_user_go_with_the_record(record: Record, tmp_path: Path) -> None:
    drag = parse_expression("drag: force = -a*v*abs(v); a: 0..1 N s2/m2")
    write_record(dataclasses.replace(record, causes=(drag,)), tmp_path / "mine")
    assert load_record(tmp_path / "mine").causes == (drag,)
    rig = tmp_path / "mine" / "rig.toml"
    text = rig.read_text()
    rig.write_text(text.replace("-a*v*abs(v)", "-a*v*open(v)"))
    with pytest.raises(RecordError, match=r"rig.toml: effects.expression.0: drag: 'open' is not allowed in a law"):
        load_record(tmp_path / "mine")
    rig.write_text(text.replace("[[effects.expression]]", "[[effects.expressions]]"))
    with pytest.raises(RecordError, match=r"effects.expressions"):
        load_record(tmp_path / "mine")
