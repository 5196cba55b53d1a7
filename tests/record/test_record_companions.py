"""Files that an actuator names come along with its record; what a foreign actuator names from elsewhere does not."""

import dataclasses
import shutil
from pathlib import Path
from typing import Any

import pytest
from conftest import ROOT
from record_cases import RATE, columns

from msl_fem.actuator import Actuator, MeshMagnet, TableMagnet
from msl_fem.errors import InputError
from msl_fem.materials.material import LIBRARY
from msl_fem.record.reader import load_record
from msl_fem.record.record import Record, Run, Sampling
from msl_fem.record.writer import write_record

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
    core = servo.e_core()
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
