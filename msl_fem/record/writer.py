"""A record to a folder that stands on its own, whole or not at all.

The files that its actuator names come along. An actuator file may come from elsewhere and may name any file of this
machine; what is copied into a record, which others get to see, was therefore read as a B-H curve or a table before,
from wherever; a mesh has to lie with its actuator.
"""

import contextlib
import os
import shutil
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from msl_fem.actuator import Actuator
from msl_fem.errors import RecordError
from msl_fem.files.schema import document, first_complaint
from msl_fem.files.toml_text import toml_text
from msl_fem.files.whole_file import ASIDE, cannot_be_written, make_folder, staging_folder
from msl_fem.materials.material import load_iron
from msl_fem.record.columns import Column, write_columns
from msl_fem.record.reader import check_record, check_run
from msl_fem.record.record import Record, Run, StaticMap
from msl_fem.record.rig_file import RIG_FILE, STATIC_FILE, RigFile, StaticEntry, read_rig
from msl_fem.record.static_file import read_static_map
from msl_fem.table.pair_table import load_table

if sys.platform != "win32":
    import fcntl

ACTUATOR_FILE = "actuator.toml"


def write_record(record: Record, folder: str | Path) -> None:
    """Writes rig.toml, the actuator, static.csv and the runs into a folder; whole or not at all.

    The folder needs nothing outside it: what rig.toml had stated about the actuator goes into its `actuator.toml`. A
    record that stands there is replaced, measured data by measured data only, and nothing that is not part of it is
    destroyed. CSV cells carry nine significant digits (see `write_columns`); rig.toml, actuator.toml, NetCDF: all.

    Raises
    ------
    RecordError : `load_record` would refuse the record; the folder holds something else or cannot be written
    ComputationError : the disk is full
    InputError : a file that the actuator names is not what it should be, see `check_companions`
    """
    folder = Path(folder).absolute()
    check_record(record, rig_file=folder / RIG_FILE)
    for run in record.runs:
        assert record.sampling is not None  # check_record saw to it
        check_run(run, record.actuator, record.sampling, file=folder / run.file)
    if record.static is not None:
        read_static_map(_static_columns(record.static), role=None, file=folder / STATIC_FILE)
    check_companions(record.actuator)
    rig_text = _rig_text(record, folder)
    try:
        make_folder(folder.parent)
        with _sole_writer(folder.parent):
            _check_target(record, folder)
        with staging_folder(folder) as partial:
            new = partial / "new"
            new.mkdir()
            _write_files(record, new)
            (new / RIG_FILE).write_text(rig_text, encoding="utf-8")
            with _sole_writer(folder.parent):
                _check_target(record, folder)  # what stands there may have changed meanwhile
                _put_in_place(new, folder, aside=partial / ASIDE)
    except OSError as err:
        raise cannot_be_written(folder, err, "choose another folder", error=RecordError) from err


def check_record_folder(folder: str | Path) -> None:
    """RecordError, before the work begins, where `write_record` could not put a record, whatever it holds."""
    folder = Path(folder).absolute()
    try:
        _check_free(folder)
        nearest = next(parent for parent in folder.parents if parent.exists())
        with tempfile.TemporaryDirectory(prefix=f".{folder.name}.", dir=nearest):
            return
    except OSError as err:
        raise cannot_be_written(folder, err, "choose another folder", error=RecordError) from err


@contextlib.contextmanager
def _sole_writer(parent: Path) -> Iterator[None]:
    """Waits until no other process replaces a record in this folder; without the system's locks there is no waiting."""
    if sys.platform == "win32":
        yield
        return
    handle = os.open(parent, os.O_RDONLY)
    try:
        with contextlib.suppress(OSError):  # a file system without locks
            fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)


def _put_in_place(new: Path, folder: Path, *, aside: Path) -> None:
    if folder.exists():
        folder.rename(aside)
    try:
        new.rename(folder)
    except BaseException:
        if aside.exists():
            aside.rename(folder)
        raise


def _check_target(record: Record, folder: Path) -> None:
    """RecordError where writing would destroy something else than an old record."""
    _check_free(folder)
    files = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if not path.is_dir()}
    if not files:
        return
    rig = read_rig(folder)
    if rig.origin == "measured" and record.origin != "measured":
        raise RecordError(f"{folder}: holds measured data, which simulated data never replace; choose another folder")
    named = companions(record.actuator).values()  # of an equal actuator, where the record is written anew
    own = {RIG_FILE, STATIC_FILE, ACTUATOR_FILE, rig.actuator, *named, *(entry.file for entry in rig.run)}
    foreign = ", ".join(sorted(files - own))
    if foreign:
        raise RecordError(f"{folder}: holds {foreign} beside the record; move it away or choose another folder")


def _check_free(folder: Path) -> None:
    """RecordError where something stands that is neither a record nor an empty folder."""
    if not folder.exists() and not folder.is_symlink():
        return
    if folder.is_symlink() or not folder.is_dir():
        raise RecordError(f"{folder}: is there and is no folder; choose another one")
    if not (folder / RIG_FILE).is_file() and any(not path.is_dir() for path in folder.rglob("*")):
        raise RecordError(f"{folder}: holds files and is no record; choose another folder")


def _rig_text(record: Record, folder: Path) -> str:
    """rig.toml; what is at its default is stated too, for the person who reads."""
    content: dict[str, Any] = {"schema": 1, "origin": record.origin, "actuator": ACTUATOR_FILE}
    if record.sampling is not None:
        content["sampling"] = document(record.sampling)
    content["noise"] = document(record.noise)
    content["tolerance"] = document(record.tolerance)
    if record.belief is not None:
        content["belief"] = record.belief
    if record.controller is not None:
        content["controller"] = dict(record.controller)
    if record.scheduling:
        content["scheduling"] = [document(one) for one in record.scheduling]
    if record.runs:
        content["run"] = [run_entry(run) for run in record.runs]
    if record.static is not None:
        content["static"] = _static_entry(record.static)
    if record.causes:
        content["effects"] = {"expression": [one.to_toml() for one in record.causes]}
    try:
        RigFile.model_validate(content)
        return toml_text(content)
    except ValidationError as err:
        raise RecordError(f"{folder / RIG_FILE}: {first_complaint(err)}") from err
    except TypeError as err:
        raise RecordError(f"{folder / RIG_FILE}: controller: {err}; give texts, numbers and lists of them") from err


def _static_entry(static: StaticMap) -> dict[str, str]:
    """The [static] of rig.toml: the zero of its gaps, and what else is not as usual."""
    usual = StaticEntry()
    stated = {"order": static.order, "before": static.before, "scale": static.scale}
    return {"gap": static.gap_zero} | {key: value for key, value in stated.items() if value != getattr(usual, key)}


def run_entry(run: Run) -> dict[str, str]:
    """A run's `[[run]]` of rig.toml."""
    entry = {"file": run.file, "excitation": run.excitation, "role": run.role}
    return entry if run.mover == "free" else entry | {"mover": run.mover}


def _write_files(record: Record, folder: Path) -> None:
    """The actuator, static.csv and the runs."""
    copied = companions(record.actuator)
    runs = [Path(run.file).as_posix() for run in record.runs]
    taken = {RIG_FILE, STATIC_FILE, ACTUATOR_FILE}
    for name in (*copied.values(), *runs):
        if name in taken:
            raise RecordError(f"{name}: two files of the record have this name; rename one of them")
        taken.add(name)
    for source, name in copied.items():
        shutil.copyfile(source, folder / name)
    (folder / ACTUATOR_FILE).write_text(_actuator_text(record.actuator), encoding="utf-8")
    for run in record.runs:
        (folder / run.file).parent.mkdir(parents=True, exist_ok=True)
        write_columns(folder / run.file, run.frame_columns())
    if record.static is not None:
        write_columns(folder / STATIC_FILE, _static_columns(record.static))


def _actuator_text(actuator: Actuator) -> str:
    """The actuator as TOML that looks for its files beside itself."""
    content = document(actuator)
    for section, key in file_keys(content):
        section[key] = Path(section[key]).name
    return toml_text(content)


def _static_columns(static: StaticMap) -> dict[str, Column]:
    """The columns of static.csv, those that the map has."""
    columns = {
        "gap_m": static.gap,
        "current_A": static.current,
        **static.readings,
        **{f"sigma_{name}": values for name, values in static.sigma.items()},
        "direction": static.direction,
        "role": static.role,
        "sequence": static.sequence,
        "unit": static.unit,
        **static.extra,
    }
    return {name: values for name, values in columns.items() if values is not None}


def file_keys(content: dict[str, Any]) -> list[tuple[dict[str, Any], str]]:
    """The sections and keys of an actuator's document that name files."""
    magnet = content.get("magnet", {})
    iron = magnet.get("iron", {})
    curves = [(iron, key) for key in ("core", "armature") if iron.get(key, "").endswith(".csv")]
    return [(magnet, key) for key in ("table", "mesh") if key in magnet] + curves


def companions(actuator: Actuator) -> dict[Path, str]:
    """Files that the actuator names, and what they are called beside actuator.toml."""
    named = [section[key] for section, key in file_keys(document(actuator))]
    return {actuator.folder / name: Path(name).name for name in named}


def check_companions(actuator: Actuator) -> None:
    """RecordError for a mesh outside the actuator's folder; TableError, MaterialError for no table, no B-H curve."""
    for section, key in file_keys(document(actuator)):
        if key == "table":
            load_table(actuator.folder / section[key])
        elif key == "mesh":
            _check_mesh(section[key], actuator)
        else:
            load_iron(section[key], folder=actuator.folder)


def _check_mesh(name: str, actuator: Actuator) -> None:
    folder = actuator.folder.resolve()
    inside = "\0" not in name and (folder / name).resolve().is_relative_to(folder)
    if not inside or not (folder / name).is_file():
        raise RecordError(
            f"{actuator.file or actuator.name}: magnet.mesh: '{name}' is no file in the actuator's folder or below, "
            "and no other comes along with a record; copy it there"
        )
