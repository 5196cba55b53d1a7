"""What reads files, each with a good file to begin with: the readers themselves, and commands as they are typed."""

import contextlib
import shutil
import sqlite3
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np
from hostile_files import (
    spoilt_csv,
    spoilt_json,
    spoilt_mat,
    spoilt_mesh,
    spoilt_netcdf,
    spoilt_sqlite,
    spoilt_text,
    spoilt_toml,
)
from scipy.io import savemat

from msl_fem.actuator import load_actuator
from msl_fem.cli.app import app
from msl_fem.design.sizing import DesignEvaluator, SearchSettings, parse_requirement, search_designs
from msl_fem.design.sizing.requirement import load_requirement
from msl_fem.errors import InputError
from msl_fem.files.quantity import parse_quantities
from msl_fem.magnetics.kinds.mesh_file import read_mesh
from msl_fem.maps import operating_map, write_map
from msl_fem.materials.core_loss_data import read_loss_points
from msl_fem.materials.material import load_iron
from msl_fem.plant import plant_parameters
from msl_fem.plant.excitation import load_excitations, parse_excitation, samples
from msl_fem.plant.extended_model import load_extended_model, write_extended_model
from msl_fem.record import load_record, write_record
from msl_fem.record.log_signals import read_log
from msl_fem.record.measured_table import table_from_measurements
from msl_fem.table.magnetic_table import read_table

ROOT = Path(__file__).parent.parent.parent
SERVO = ROOT / "geometries" / "fast_tool_servo.toml"
TABLE = ROOT / "lookup_tables" / "fast_tool_servo.nc"
Spoil = Callable[[np.random.Generator, bytes, Path], bytes]


@dataclass(frozen=True)
class Target:
    """One reader.

    Attributes
    ----------
    name : what is fuzzed
    prepare : writes good files into a folder, and names the one to spoil
    spoil : makes bad content of good
    use : reads the files of a folder and writes, if it writes, into the second one
    """

    name: str
    prepare: Callable[[Path], Path]
    spoil: Spoil
    use: Callable[[Path, Path], object]


def _toml(rng: np.random.Generator, good: bytes, scratch: Path) -> bytes:
    return spoilt_toml(rng, good)


def _json(rng: np.random.Generator, good: bytes, scratch: Path) -> bytes:
    return spoilt_json(rng, good)


def _csv(rng: np.random.Generator, good: bytes, scratch: Path) -> bytes:
    return spoilt_csv(rng, good)


def _one_file(name: str, content: bytes | str) -> Callable[[Path], Path]:
    def prepare(folder: Path) -> Path:
        path = folder / name
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        return path

    return prepare


EXTENDED = SERVO.read_text() + (
    '\n[effects.eddy_currents]\ntime_constant = "0.12 ms"\n[effects.coulomb_friction]\nforce = "1 N"\n'
)
EXCITATIONS = (
    '[[excitation]]\nname = "sine"\nchannel = "1"\nfrequency = "5 Hz"\nbias = "0.3 A"\namplitude = "0.1 A"\n'
    'duration = "0.1 s"\n'
)
RIG = (
    'schema = 1\norigin = "measured"\nactuator = "actuator.toml"\n[sampling]\nrate = "10 kHz"\n[noise]\n'
    'position = "50 nm"\nforce = "0.2 N"\n[[run]]\nfile = "run.csv"\nexcitation = "noise"\nrole = "fit"\n'
    '[static]\nrole = "fit"\n'
)
COLUMNS = (
    '[time_s]\nsource = "t"\n[position_m]\nsource = "q"\nunit = "um"\n[current_1_A]\nsource = "i"\nunit = "mA"\n'
    '[current_2_A]\nsource = "j"\nscale = "1 mA"\noffset = "1 mA"\n'
    '[voltage_1_V]\nsource = "u"\n[voltage_2_V]\nsource = "w"\n'
)


SIGNAL = "time_s,current_1_A\n" + "".join(f"{0.01 * k:.2f},{0.1 + 0.001 * k:.3f}\n" for k in range(30))
LOSSES = "frequency_Hz,B_T,loss_W_per_kg\n" + "".join(
    f"{f},{b},{1e-3 * f * b**1.8 + 1e-5 * f**2 * b**2:.6g}\n" for f in (50, 200, 400, 1000) for b in (0.4, 0.8, 1.2)
)


def _run_text(n: int = 1010) -> str:
    t = np.arange(n) / 10e3
    wave = np.sin(2 * np.pi * 30 * t)
    columns = {
        "time_s": t, "voltage_1_V": 2 * wave, "voltage_2_V": -2 * wave, "current_1_A": 0.6 + 0.3 * wave,
        "current_2_A": 0.6 - 0.3 * wave, "position_m": 1e-4 * wave,
    }  # fmt: skip
    rows = [",".join(f"{v:.9g}" for v in row) for row in zip(*columns.values(), strict=True)]
    return "\n".join([",".join(columns), *rows]) + "\n"


def _static_text() -> str:
    gaps, currents = np.linspace(2e-4, 9e-4, 8), np.linspace(0.5, 4, 8)
    rows = [f"{g},{i},{1e-5 * i**2 / (2 * (g + 3e-5) ** 2):.9g}" for g in gaps for i in currents]
    return "\n".join(["gap_m,current_A,force_N", *rows]) + "\n"


TYPED_COLUMNS = "time_s=t,position_m=q:unit=um,current_1_A=i:unit=mA,current_2_A=j:unit=mA,voltage_1_V=u,voltage_2_V=w"
RUN, STATIC = _run_text(), _static_text()
_LOGGED = [
    f"{k / 1e4},{100 * np.sin(k / 20):.6g},{600 + 9 * np.cos(k / 9):.6g},{600 + k % 7},{k % 5},{k % 3}"
    for k in range(1010)
]
LOG = "\n".join(["t,q,i,j,u,w", *_LOGGED]) + "\n"


def _record(spoilt: str) -> Callable[[Path], Path]:
    def prepare(folder: Path) -> Path:
        for name, text in (("rig.toml", RIG), ("run.csv", RUN), ("static.csv", STATIC)):
            (folder / name).write_text(text)
        shutil.copyfile(SERVO, folder / "actuator.toml")
        return folder / spoilt

    return prepare


def _use_record(folder: Path, out: Path) -> None:
    record = load_record(folder)
    write_record(record, out / "copy")


def _use_static(folder: Path, out: Path) -> None:
    record = load_record(folder)
    if record.static is not None:
        table_from_measurements(record.static, record.noise)


def _use_actuator(folder: Path, out: Path) -> None:
    actuator = load_actuator(folder / "a.toml")
    if actuator.motion is not None and actuator.drive is not None:
        plant_parameters(actuator)


def _use_extended(folder: Path, out: Path) -> None:
    write_extended_model(load_extended_model(folder / "a.toml"), out / "again.toml")


def _use_excitations(folder: Path, out: Path) -> None:
    for one in load_excitations(str(folder / "a.toml")):
        if one.duration > 10.0:
            raise InputError("long enough")
        samples(one, rate=1000.0, sides=2, generator=np.random.default_rng(1))


def _use_signal(folder: Path, out: Path) -> None:
    (one,) = load_excitations(str(folder / "a.csv"))
    if one.duration > 10.0:
        raise InputError("long enough")
    samples(one, rate=1000.0, sides=2)


def _use_table(folder: Path, out: Path) -> None:
    write_map(operating_map(read_table(folder / "a.nc")), out / "map.json")


def _typed(*words: str) -> Callable[[Path, Path], object]:
    """A command line; IN and OUT stand for the two folders."""

    def use(folder: Path, out: Path) -> object:
        return app([word.replace("IN", str(folder)).replace("OUT", str(out)) for word in words])

    return use


def _map_file(folder: Path) -> Path:
    return write_map(operating_map(read_table(TABLE)), folder / "a.json")


def _log_and_columns(folder: Path) -> Path:
    _one_file("log.csv", LOG)(folder)
    return _one_file("a.toml", COLUMNS)(folder)


def _mat(rng: np.random.Generator, good: bytes, scratch: Path) -> bytes:
    return spoilt_mat(rng, good)


def _mesh(rng: np.random.Generator, good: bytes, scratch: Path) -> bytes:
    return spoilt_mesh(rng, good)


def _text(rng: np.random.Generator, good: bytes, scratch: Path) -> bytes:
    return spoilt_text(rng, good)


def _logged_arrays() -> dict[str, np.ndarray]:
    rows = np.array([line.split(",") for line in _LOGGED], dtype=float)
    return dict(zip("tqijuw", rows.T, strict=True))


def _mat_file(folder: Path) -> Path:
    savemat(folder / "a.mat", _logged_arrays() | {"run": {"x": np.arange(50.0)}}, do_compression=True)
    return folder / "a.mat"


def _mat_file_of_7_3(folder: Path) -> Path:
    with h5py.File(folder / "a.mat", "w") as file:
        for name, values in _logged_arrays().items():
            file.create_dataset(name, data=values[:, None], compression="gzip")
    return folder / "a.mat"


def _trials_file(folder: Path) -> Path:
    """A search of two designs, made once."""
    file = folder / "a.sqlite3"
    if not _TRIALS:
        search_designs(_evaluator(), SearchSettings(f"sqlite:///{file}", 2))
        whole = folder / "whole.sqlite3"
        with contextlib.closing(sqlite3.connect(file)) as base, contextlib.closing(sqlite3.connect(whole)) as copy:
            base.backup(copy)
            copy.execute("pragma journal_mode=delete")
        _TRIALS.append(whole.read_bytes())
        for path in folder.glob("*.sqlite3*"):
            path.unlink()
    file.write_bytes(_TRIALS[0])
    return file


def _evaluator() -> DesignEvaluator:
    demands = {"force": {"minimum": "150 N", "gap": "0.5 mm"}, "heat": {"current_density": "6 A/mm^2"}}
    return DesignEvaluator(parse_requirement({"schema": 1, "name": "servo", "objectives": ["mass"], **demands}))


def _use_trials(folder: Path, out: Path) -> None:
    copy = out.parent / "trials.sqlite3"  # a database writes beside the file that it reads
    shutil.copyfile(folder / "a.sqlite3", copy)
    try:
        search_designs(_evaluator(), SearchSettings(f"sqlite:///{copy}", 1))
    finally:
        for path in out.parent.glob("trials.sqlite3*"):
            path.unlink()


def _use_excitation_text(folder: Path, out: Path) -> None:
    text = (folder / "a.txt").read_text(errors="surrogateescape")
    one = parse_excitation(text.strip())
    if one.duration <= 10.0:
        samples(one, rate=1000.0, sides=2, generator=np.random.default_rng(1))


def _use_quantities(folder: Path, out: Path) -> None:
    text = (folder / "a.txt").read_text(errors="surrogateescape")
    assert all(np.isfinite(parse_quantities(text, "m")))


_TRIALS: list[bytes] = []
POINT = ("--current", "2 A", "--gap", "0.4 mm")


def _cached_map(folder: Path) -> Path:
    if not _MAP:
        _MAP.append(_map_file(folder).read_bytes())
    (folder / "a.json").write_bytes(_MAP[0])
    return folder / "a.json"


_MAP: list[bytes] = []
_TABLE_BYTES = TABLE.read_bytes()
_AS_TABLE = _one_file("a.nc", _TABLE_BYTES)

TARGETS = (
    Target("actuator", _one_file("a.toml", SERVO.read_bytes()), _toml, _use_actuator),
    Target("extended model", _one_file("a.toml", EXTENDED), _toml, _use_extended),
    Target("requirement", _one_file("a.toml", (ROOT / "requirements" / "400_newton.toml").read_bytes()), _toml,
           lambda folder, out: load_requirement(folder / "a.toml")),
    Target("excitations", _one_file("a.toml", EXCITATIONS), _toml, _use_excitations),
    Target("signal", _one_file("a.csv", SIGNAL), _csv, _use_signal),
    Target("iron", _one_file("a.csv", "H_A_per_m,B_T\n0,0\n50,0.5\n100,1\n500,1.5\n5000,1.8\n50000,2.1\n"), _csv,
           lambda folder, out: load_iron("a.csv", folder=folder)),
    Target("log", _one_file("a.csv", LOG), _csv, lambda folder, out: read_log(folder / "a.csv")),
    Target("record: rig", _record("rig.toml"), _toml, _use_record),
    Target("record: actuator", _record("actuator.toml"), _toml, _use_record),
    Target("record: run", _record("run.csv"), _csv, _use_record),
    Target("record: static", _record("static.csv"), _csv, _use_static),
    Target("table", _AS_TABLE, spoilt_netcdf, _use_table),
    Target("lookup TABLE", _AS_TABLE, spoilt_netcdf, _typed("lookup", "IN/a.nc", *POINT, "--json")),
    Target("export TABLE", _AS_TABLE, spoilt_netcdf,
           _typed("export", "IN/a.nc", "--to", "modelica", "-o", "OUT/t.txt")),
    Target("guard MAP", _cached_map, _json, _typed("guard", "IN/a.json", *POINT, "--json")),
    Target("export MAP", _cached_map, _json, _typed("export", "IN/a.json", "--to", "c", "-o", "OUT/g.h", "--json")),
    Target("export ACTUATOR", _one_file("a.toml", SERVO.read_bytes()), _toml,
           _typed("export", "IN/a.toml", "--table", str(TABLE), "--to", "csv", "-o", "OUT/t.csv", "--json")),
    Target("flexure ACTUATOR",
           _one_file("a.toml", (ROOT / "geometries" / "fast_tool_servo_flexure.toml").read_bytes()), _toml,
           _typed("flexure", "IN/a.toml", "--json")),
    Target("simulate ACTUATOR", _one_file("a.toml", EXTENDED), _toml,
           _typed("simulate", "IN/a.toml", "--table", str(TABLE), "--excitation", "sine:channel=1,frequency=20 Hz,"
                  "bias=0.3 A,amplitude=0.1 A,duration=0.6 s", "--rate", "2 kHz", "-o", "OUT/rec", "--json")),
    Target("losses ACTUATOR", _one_file("a.toml", SERVO.read_bytes()), _toml,
           _typed("losses", "IN/a.toml", "--current", "1 A", "--table", str(TABLE), "--json")),
    Target("import LOG", _one_file("a.csv", LOG), _csv,
           _typed("import", "IN/a.csv", "--columns", TYPED_COLUMNS, "--actuator",
                  str(SERVO), "-o", "OUT/rec", "--json")),
    Target("log, MATLAB 5", _mat_file, _mat, lambda folder, out: read_log(folder / "a.mat")),
    Target("log, MATLAB 7.3", _mat_file_of_7_3, _mat, lambda folder, out: read_log(folder / "a.mat")),
    Target("mesh", _one_file("a.msh", (ROOT / "geometries" / "u_core.msh").read_bytes()), _mesh,
           lambda folder, out: read_mesh(folder / "a.msh", unit=1e-3, gap=5e-4)),
    Target("trials of a search", _trials_file, spoilt_sqlite, _use_trials),
    Target("core losses", _one_file("a.csv", LOSSES), _csv, lambda folder, out: read_loss_points(folder / "a.csv")),
    Target("excitation in words", _one_file("a.txt", "sine:channel=1,frequency=20 Hz,bias=0.3 A,amplitude=0.1 A,"
           "duration=0.6 s"), _text, _use_excitation_text),
    Target("quantities", _one_file("a.txt", "0.5, 1, 1.2e-1 mm"), _text, _use_quantities),
    Target("import COLUMNS", _log_and_columns, _toml,
           _typed("import", "IN/log.csv", "--columns", "IN/a.toml", "--actuator", str(SERVO), "-o", "OUT/rec")),
)  # fmt: skip
