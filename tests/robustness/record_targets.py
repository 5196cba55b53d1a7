"""Parts of a record that few have, logs that libraries read, sections of other magnets, causes that users state."""

import shutil
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
from hostile_files import spoilt_netcdf
from later_targets import _bytes, _made_once
from scipy.io import savemat
from targets import (
    LOG,
    RIG,
    ROOT,
    RUN,
    SERVO,
    STATIC,
    Target,
    _csv,
    _logged_arrays,
    _mat,
    _mesh,
    _one_file,
    _record,
    _text,
    _toml,
    _typed,
    _use_record,
)

from msl_fem.actuator import load_actuator
from msl_fem.computing.laws import causes_of
from msl_fem.diagnosis.impedances import diagnose_impedance
from msl_fem.export.femm_magnet import magnet_from_femm
from msl_fem.export.femm_section import femm_text
from msl_fem.record import load_record, write_record
from msl_fem.record.columns import write_columns
from msl_fem.record.impedance import read_impedance
from msl_fem.record.log_signals import read_log

GEOMETRIES = ROOT / "geometries"
WHOLE_RIG = """schema = 1
origin = "measured"
actuator = "actuator.toml"
belief = "plain"
position_sensor_curve = "probe.csv"

[sampling]
rate = "10 kHz"
hold = "linear"

[noise]
position = "50 nm"
force = "0.2 N"

[tolerance]
moving_mass = 0.01
position_zero = "2 um"
command_zero = "10 mA"

[motion]
moving_mass = "1 kg"

[supply]
voltage = "24 V"

[controller]
law = "a PID"
rate = "10 kHz"
delay_samples = 1
[[controller.linear]]
kind = "pid"
runs = ["run"]
kp = "-1 V/m"
ki = "-2 V/m/s"
outputs = ["voltage_1_V", "voltage_2_V"]
signs = [1.0, -1.0]
[[controller.linear]]
kind = "state-space"
outputs = ["voltage_1_V"]
a = [[0.5, 0.1], [0.0, 0.9]]
b = [[1.0], [0.1]]
c = [[10.0, 20.0]]
d = [[0.0]]

[[scheduling]]
column = "coil_voltage_V"
changes = ["damping", "coulomb_friction.force"]
at = [0, 1, 2]
tolerance = 1.0

[[run]]
file = "run.csv"
excitation = "noise"
role = "fit"
levels = { coil_voltage_V = 1.98 }

[static]
role = "fit"
gap = "mover"
order = "unknown"
before = "cycled:+10 A"
scale = "free"
curves = { force_N = "scales.csv" }

[[effects.expression]]
name = "drag"
equation = "force"
law = "-a*v*abs(v)"
parameters = { a = "0..1 N s2/m2" }
"""
PROBE = "reading,value\n" + "".join(f"{k / 10 - 2:.1f},{1e-4 * (k / 10 - 2) * (1 + 0.01 * k):.6g}\n" for k in range(41))
SCALES = "reading,value\n-9000,-8990\n0,0\n9000,9015\n"
CAUSES = (
    '[[effects.expression]]\nname = "drag"\nequation = "force"\nlaw = "-a*v*abs(v)"\n'
    'parameters = { a = "0.2 in 0..1 N s2/m2" }\n[[effects.expression]]\nname = "pull"\nequation = "force"\n'
    'law = "-k*sin(x/p)"\nparameters = { k = "0..3 N", p = "1 mm" }\n'
)
CAUSE = "drag: force = -a*v*abs(v) - b*tanh(v/w); a: 0..1 N s2/m2; b: 0..1 N; w: 1e-3..1e-2 m/s"
IMPEDANCE = "gap_m,frequency_hz,inductance_H,resistance_ohm\n" + "".join(
    f"{gap},{f},{(1 + 1 / (1 + (f / 300) ** 2)) * 6e-6 / gap:.6g},{2 + f / 500:.6g}\n"
    for gap in (4e-4, 6e-4, 8e-4)
    for f in (20, 100, 300, 1000, 3000)
)


def _whole_record(spoilt: str) -> Callable[[Path], Path]:
    """A record with everything that rig.toml may state."""

    def prepare(folder: Path) -> Path:
        run = _readings_of_a_probe()
        for name, text in (
            ("rig.toml", WHOLE_RIG), ("run.csv", run), ("static.csv", STATIC), ("probe.csv", PROBE),
            ("scales.csv", SCALES),
        ):  # fmt: skip
            (folder / name).write_text(text)
        shutil.copyfile(SERVO, folder / "actuator.toml")
        return folder / spoilt

    return prepare


def _readings_of_a_probe() -> str:
    """The run with duties for voltages, the signal of a position sensor for positions, and rows that do not count."""
    head, *rows = RUN.splitlines()
    names = head.replace("position_m", "position_sensor_V").replace("voltage_1_V", "duty_1").replace(
        "voltage_2_V", "duty_2"
    )  # fmt: skip
    made = []
    for k, row in enumerate(rows):
        time, first, second, *currents, position = row.split(",")
        duties = (f"{float(duty) / 24:.9g}" for duty in (first, second))
        made.append(",".join([time, *duties, *currents, f"{float(position) * 1e4:.9g}", str(int(not 500 <= k < 520))]))
    return "\n".join([f"{names},valid", *made]) + "\n"


def _use_whole(folder: Path, out: Path) -> None:
    record = load_record(folder)
    for run in record.runs:
        record.law_of(run.name)
    write_record(record, out / "copy")


def _netcdf_run(folder: Path) -> Path:
    _record("run.csv")(folder).unlink()
    (folder / "rig.toml").write_text(RIG.replace("run.csv", "run.nc"))
    return _made_once("run.nc", _write_run)(folder)


def _write_run(path: Path) -> None:
    head, _, body = RUN.partition("\n")
    rows = np.array([line.split(",") for line in body.splitlines()], dtype=float)
    write_columns(path, dict(zip(head.split(","), rows.T, strict=True)))


def _log(ending: str, write: str) -> Callable[[Path], Path]:
    """A log as another program writes it."""

    def make(path: Path) -> None:
        sys.path.append(str(ROOT / "tests" / "record"))
        import raw_logs

        getattr(raw_logs, write)(path)

    return _made_once(f"a{ending}", make)


def _plain_mat_file(path: Path) -> None:
    savemat(path, _logged_arrays() | {"run": {"x": np.arange(50.0), "name": "one"}})


def _femm_file(path: Path) -> None:
    path.write_text(femm_text(load_actuator(GEOMETRIES / "u_core_ui60.toml"), 1e-3, current=1.0))


def _use_impedance(folder: Path, out: Path) -> None:
    found = diagnose_impedance(read_impedance(folder / "impedance.csv")).to_json()
    assert found["verdict"] in ("named", "nothing-found", "unexplained")


def _use_cause(folder: Path, out: Path) -> None:
    for one in causes_of((folder / "a.txt").read_text(errors="surrogateescape")):
        assert one.parameters


def _meshed(folder: Path) -> Path:
    shutil.copyfile(GEOMETRIES / "u_core.msh", folder / "u_core.msh")
    return _one_file("a.toml", (GEOMETRIES / "u_core.toml").read_bytes())(folder)


def _use_mesh(folder: Path, out: Path) -> None:
    magnet = load_actuator(folder / "a.toml").magnet_kind()
    section = magnet.section(magnet.gaps[0])
    assert section.axisymmetric is False
    assert magnet.copper_area > 0


def _drawn(name: str) -> Target:
    """The section of another kind of magnet; none of them is at its nominal gap without being told."""
    return Target(
        f"draw {name}", _one_file("a.toml", (GEOMETRIES / f"{name}.toml").read_bytes()), _toml,
        _typed("draw", "IN/a.toml", "--gap", "1 mm", "-o", "OUT/s.dxf", "--json"),
    )  # fmt: skip


RECORD_TARGETS = (
    Target("whole record: rig", _whole_record("rig.toml"), _toml, _use_whole),
    Target("whole record: run", _whole_record("run.csv"), _csv, _use_whole),
    Target("whole record: position's curve", _whole_record("probe.csv"), _csv, _use_whole),
    Target("whole record: static's curve", _whole_record("scales.csv"), _csv, _use_whole),
    Target("record: run, NetCDF", _netcdf_run, spoilt_netcdf, _use_record),
    Target("check RECORD", _record("run.csv"), _csv, _typed("check", "IN", "--json")),
    Target("identify RECORD", _record("run.csv"), _csv, _typed("identify", "IN", "-o", "OUT/m.json", "--json")),
    Target("check LOG", _one_file("a.csv", LOG), _csv, _typed("check", "IN/a.csv", "--json")),
    Target("import LOG, proposed", _one_file("a.csv", LOG), _csv,
           _typed("import", "IN/a.csv", "--actuator", str(SERVO), "-o", "OUT/rec", "--propose", "OUT/c.toml")),
    Target("impedance", _one_file("impedance.csv", IMPEDANCE), _csv, _use_impedance),
    Target("causes", _one_file("a.toml", CAUSES), _toml, lambda folder, out: causes_of(str(folder / "a.toml"))),
    Target("cause in words", _one_file("a.txt", CAUSE), _text, _use_cause),
    Target("log, MATLAB 5, not packed", _made_once("a.mat", _plain_mat_file), _mat,
           lambda folder, out: read_log(folder / "a.mat")),
    Target("log, workbook", _log(".xlsx", "workbook"), _bytes, lambda folder, out: read_log(folder / "a.xlsx")),
    Target("log, TDMS", _log(".tdms", "tdms"), _bytes, lambda folder, out: read_log(folder / "a.tdms")),
    Target("log, MDF 4", _log(".mf4", "mdf"), _bytes, lambda folder, out: read_log(folder / "a.mf4")),
    Target("FEMM problem", _made_once("a.fem", _femm_file), _mesh,
           lambda folder, out: magnet_from_femm(folder / "a.fem", out / "a.toml", armature=2, pull="+y")),
    Target("actuator of a mesh", _meshed, _toml, _use_mesh),
    *map(_drawn, ("roters_plunger", "pot_core_holding", "u_core_ui60")),
)  # fmt: skip
