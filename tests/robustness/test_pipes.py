"""Named pipes without a writer, and devices: refused by every reader at once, whoever names them."""

import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest
from targets import LOG, SERVO, TABLE, TYPED_COLUMNS, _record

POINT = ("--current", "1 A", "--gap", "0.4 mm")
SIMULATE = ("simulate", str(SERVO), "--table", str(TABLE), "-o", "OUT")
COMMANDS = {
    "actuator": ("flexure", "PIPE.toml"),
    "requirement": ("size", "PIPE.toml", "-o", "OUT"),
    "excitation": (*SIMULATE, "--excitation", "PIPE.toml"),
    "signal": (*SIMULATE, "--excitation", "PIPE.csv"),
    "map": ("guard", "PIPE.json", *POINT),
    "map to export": ("export", "PIPE.json", "--to", "c", "-o", "OUT"),
    "table": ("lookup", "PIPE.nc", *POINT),
    "log": ("import", "PIPE.csv", "--columns", TYPED_COLUMNS, "--actuator", str(SERVO), "-o", "OUT"),
    "columns": ("import", "LOG", "--columns", "PIPE.toml", "--actuator", str(SERVO), "-o", "OUT"),
    "armax": ("control", str(SERVO), "--table", str(TABLE), "--model", "PIPE.json", "-o", "OUT"),
}


@pytest.mark.parametrize("kind", [*COMMANDS, "rig.toml", "iron", "mesh"])
def test_a_pipe_without_a_writer_is_refused_at_once(kind: str, tmp_path: Path, msl_fem) -> None:
    log = tmp_path / "log.csv"
    log.write_text(LOG)
    words = COMMANDS.get(kind, ())
    pipe = tmp_path / f"pipe{Path(next((w for w in words if w.startswith('PIPE')), '')).suffix}"
    if kind == "rig.toml":
        pipe = _record("rig.toml")(tmp_path)
        pipe.unlink()
        words = ("identify", str(tmp_path))
    elif kind == "iron":
        pipe = tmp_path / "iron.csv"
        actuator = tmp_path / "a.toml"
        actuator.write_text(SERVO.read_text().replace('core = "', 'core = "iron.csv" # "', 1))
        assert "iron.csv" in actuator.read_text()
        words = ("solve", str(actuator), *POINT)
    elif kind == "mesh":
        pipe = tmp_path / "u_core.msh"
        shutil.copyfile(SERVO.parent / "u_core.toml", tmp_path / "u_core.toml")
        words = ("solve", str(tmp_path / "u_core.toml"), "--current", "1 A")
    os.mkfifo(pipe)
    places = {"PIPE": str(pipe.with_suffix("")), "OUT": str(tmp_path / "out"), "LOG": str(log)}
    for name, place in places.items():
        words = tuple(word.replace(name, place) for word in words)
    start = time.monotonic()
    assert str(pipe) in msl_fem(*words).complaint
    assert time.monotonic() - start < 20


def test_an_excitation_file_of_a_device_is_refused(tmp_path: Path, msl_fem) -> None:
    link = tmp_path / "z.toml"
    link.symlink_to("/dev/zero")
    words = [word.replace("OUT", str(tmp_path / "out")) for word in SIMULATE]
    assert "a device, no file" in msl_fem(*words, "--excitation", str(link)).complaint


def test_the_pipe_of_a_shell_is_read(tmp_path: Path) -> None:
    """`msl-fem ... --excitation <(...)` has a writer and no name."""
    code = "import sys; from msl_fem.files.schema import small_text; print(small_text(sys.argv[1]), end='')"
    command = f"{sys.executable} -c \"{code}\" <(printf 'x = 1')"
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, check=False, timeout=30)
    assert done.stdout == "x = 1", done.stderr
