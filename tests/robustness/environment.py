"""Poor surroundings: no home, no cache, little disk, few files, little memory, several at once, a lost scheduler.

    python tests/robustness/environment.py

runs each check and prints a table of what came out; `test_environment.py` runs the cheap ones. A command has to do its
work, or end with one line that names the way out.
"""

import argparse
import json
import os
import resource
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from targets import LOG, SERVO, TABLE, TYPED_COLUMNS

LONG = 900.0
GRID = ("--gaps", "0.3, 0.5, 0.7 mm", "--currents", "0, 2, 4, 6 A", "--accuracy", "fast")
LOOKUP = ("lookup", str(TABLE), "--current", "2 A", "--gap", "0.4 mm", "--json")
SOLVE = ("solve", str(SERVO), "--current", "2 A", "--gap", "0.4 mm", "--accuracy", "fast", "--json")
MAP = ("map", str(TABLE), "-o", "m.json", "--json")
IMPORT = ("import", "log.csv", "--columns", TYPED_COLUMNS, "--actuator", str(SERVO), "-o", "rec", "--json")
MODEL_C = ("export", str(TABLE), "--to", "c", "-o", "t.h", "--json")
SIMULATE = (
    "simulate", str(SERVO), "--table", str(TABLE), "--rate", "2 kHz", "-o", "sim", "--json", "--excitation",
    "sine:channel=1,frequency=20 Hz,bias=0.3 A,amplitude=0.1 A,duration=0.6 s",
)  # fmt: skip


def table(*more: str, output: str = "t.nc") -> tuple[str, ...]:
    """The words of a small table."""
    return ("table", str(SERVO), "-o", output, *GRID, "--json", *more)


def run(
    words: tuple[str, ...],
    folder: Path,
    *,
    limits: dict[int, int] | None = None,
    environment: dict[str, str | None] | None = None,
) -> subprocess.CompletedProcess[str]:
    """A command in a folder, within limits of the system; a variable of None is taken out of the environment."""
    changed = os.environ | {k: v for k, v in (environment or {}).items() if v is not None}
    for name in (k for k, v in (environment or {}).items() if v is None):
        changed.pop(name, None)

    def limit() -> None:
        for what, most in (limits or {}).items():
            resource.setrlimit(what, (most, most))

    return subprocess.run(
        [sys.executable, "-B", "-m", "msl_fem.cli", *words], cwd=folder, env=changed, preexec_fn=limit,
        capture_output=True, text=True, check=False, timeout=LONG,
    )  # fmt: skip


def outcome(done: subprocess.CompletedProcess[str], *, may_fail: bool = False) -> str:
    """How a command ended; AssertionError where it neither did its work nor said in one line why it could not."""
    assert "Traceback" not in done.stderr, done.stderr[-2000:]
    lines = [line for line in done.stderr.splitlines() if line.startswith(("error:", "failed:"))]
    if done.returncode == 0:
        json.loads(done.stdout)
        return "done"
    assert may_fail, (done.returncode, done.stderr[-2000:])
    assert done.returncode in (1, 2), done.returncode
    assert len(lines) == 1, done.stderr[-2000:]
    return f"{done.returncode}: {lines[0][:110]}"


BARE: dict[str, str | None] = {
    "HOME": None, "XDG_CACHE_HOME": None, "XDG_CONFIG_HOME": None, "MPLCONFIGDIR": None,
    "NUMBA_CACHE_DIR": "/proc/none",
}  # fmt: skip


def no_home(folder: Path, commands: tuple[tuple[str, ...], ...] = (LOOKUP, SOLVE, MAP, SIMULATE)) -> str:
    """Neither a home nor a cache for compiled functions."""
    return ", ".join(f"{words[0]} {outcome(run(words, folder, environment=BARE))}" for words in commands)


def few_files(folder: Path, most: int = 256) -> str:
    """So many file descriptors, with two processes."""
    return outcome(run(table("--workers", "2"), folder, limits={resource.RLIMIT_NOFILE: most}))


def little_memory(folder: Path, commands: tuple[tuple[str, ...], ...] = (LOOKUP, SOLVE, MAP, MODEL_C, SIMULATE)) -> str:
    """2 GB of address space."""
    limits = {resource.RLIMIT_AS: 2 * 2**30}
    return ", ".join(f"{words[0]} {outcome(run(words, folder, limits=limits))}" for words in commands)


def small_disk(folder: Path) -> str:
    """A file system of 2 MB, filled in steps: one line each time, nothing half-written, rows kept. Needs root."""
    disk = folder / "disk"
    disk.mkdir()
    if subprocess.run(["mount", "-t", "tmpfs", "-o", "size=2m", "tmpfs", disk], capture_output=True).returncode:
        return "left out: needs root"
    ends = []
    try:
        (disk / "log.csv").write_text(LOG)
        for free in (4, 60, 200, 1500):
            room = shutil.disk_usage(disk).free
            (disk / "fill").write_bytes(b"x" * max(room - free * 1024, 0))
            before = {p.name for p in disk.rglob("*")}
            for words in (MAP, MODEL_C, IMPORT, SIMULATE):
                done = run(words, disk)
                ends.append(outcome(done, may_fail=True).partition(":")[0])
                after = {p.name for p in disk.rglob("*")}
                if done.returncode:
                    assert after == before, (free, words[0], after - before)
                for name in ("m.json", "t.h"):
                    (disk / name).unlink(missing_ok=True)
                for name in ("rec", "sim"):
                    shutil.rmtree(disk / name, ignore_errors=True)
            (disk / "fill").unlink()
    finally:
        subprocess.run(["umount", disk], check=True)
    return f"{ends.count('done')} done, {ends.count('1')} with status 1, {ends.count('2')} with 2, nothing half-written"


def read_only(folder: Path) -> str:
    """A file system that takes nothing. Needs root."""
    disk = folder / "fixed"
    disk.mkdir()
    if subprocess.run(["mount", "-t", "tmpfs", "-o", "ro", "tmpfs", disk], capture_output=True).returncode:
        return "left out: needs root"
    try:
        ends = [outcome(run(words, disk), may_fail=True)[:1] for words in (MAP, MODEL_C, SIMULATE, table())]
    finally:
        subprocess.run(["umount", disk], check=True)
    assert set(ends) == {"2"}
    return f"{len(ends)} commands, each one line with status 2"


def at_once(folder: Path, count: int) -> str:
    """So many tables at once on one output and one cache of rows: all end well, the file is whole."""
    started = [
        subprocess.Popen([sys.executable, "-m", "msl_fem.cli", *table("--workers", "1", "--resume")], cwd=folder,
                         stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        for _ in range(count)
    ]  # fmt: skip
    ends = [(one.communicate(timeout=LONG), one.returncode) for one in started]
    assert all(status == 0 for _, status in ends), [said[1][-300:] for said, _ in ends]
    lookup = ("lookup", "t.nc", "--current", "2 A", "--gap", "0.4 mm", "--json")
    outcome(run(lookup, folder))
    left = sorted(p.name for p in folder.rglob("*") if p.name.startswith(".") or ".part" in p.name)
    assert not left, left
    return f"{count} done, nothing left beside the table"


SOLVES = """
import sys
from pathlib import Path
from msl_fem.actuator import load_actuator
from msl_fem.magnetics.field.magnet_field import solve

def memory():
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096 / 1e6

actuator, count = load_actuator(sys.argv[1]), int(sys.argv[2])
begin = 0.0
for k in range(count):
    solve(actuator, 0.5 + 3.0 * k / count, 4e-4 + 1e-4 * (k % 7) / 7, accuracy="fast")
    if k == count // 5:
        begin = memory()
print(memory() - begin, memory())
"""


def many_solves(folder: Path, count: int = 500) -> str:
    """So many field solutions in one process: the memory after a fifth of them and at the end."""
    words = [sys.executable, "-c", SOLVES, str(SERVO), str(count)]
    done = subprocess.run(words, capture_output=True, text=True, check=True, timeout=4 * LONG)
    grown, whole = map(float, done.stdout.split())
    assert grown < 20.0, f"{grown:.1f} MB more of {whole:.0f} MB"
    return f"{grown:+.1f} MB from solve {count // 5} to {count}, {whole:.0f} MB in all"


def lost_scheduler(folder: Path) -> str:
    """A cluster's scheduler killed in the middle: one line, rows kept, and --resume here takes them."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    address = f"tcp://127.0.0.1:{port}"
    dask = (
        [sys.executable, "-m", "distributed.cli.dask_scheduler"],
        [sys.executable, "-m", "distributed.cli.dask_worker"],
    )
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "cwd": folder}
    scheduler = subprocess.Popen([*dask[0], "--host", "127.0.0.1", "--port", str(port), "--no-dashboard"], **quiet)
    worker = subprocess.Popen([*dask[1], address, "--nthreads", "1", "--no-nanny", "--death-timeout", "20"], **quiet)
    grid = ("--gaps", "0.2, 0.3, 0.4, 0.5, 0.6, 0.8 mm", "--currents", "0, 1, 2, 3, 4, 6 A")
    words = ("table", str(SERVO), "-o", "t.nc", *grid, "--json")
    try:
        asked = subprocess.Popen([sys.executable, "-m", "msl_fem.cli", *words, "--scheduler", address], cwd=folder,
                                 stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)  # fmt: skip
        until = time.monotonic() + LONG
        while not list(folder.rglob("*.npz")) and time.monotonic() < until and asked.poll() is None:
            time.sleep(0.05)
        scheduler.kill()
        _, said = asked.communicate(timeout=LONG)
    finally:
        for one in (scheduler, worker):
            one.kill()
            one.wait()
    assert asked.returncode == 1, (asked.returncode, said[-1500:])
    assert "Traceback" not in said, said[-1500:]
    assert len([line for line in said.splitlines() if line.startswith("failed:")]) == 1
    kept = len(list(folder.rglob("*.npz")))
    done = run((*words, "--resume"), folder)
    assert json.loads(done.stdout)["reused_rows"] == kept > 0
    return f"one line, {kept} rows kept and taken over"


READ_TWO = """
import resource, sys, time
from msl_fem.errors import RecordError
from msl_fem.record.log_signals import read_log

start = time.time()
try:
    said = f"{read_log(sys.argv[1], only={'t', 'c3'})['t'].size} rows"
except RecordError as err:
    said = str(err)
print(f"{said}; {time.time() - start:.0f} s; {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MB")
"""


def long_log(folder: Path, size: int = 10**9) -> str:
    """A log of so many bytes with columns nobody asks for: read by the columns named, in bounded memory, or refused."""
    path = folder / "week.csv"
    row = ",".join(["{:d}"] + ["0.123456789"] * 40)
    lines = "".join(row.format(k) + "\n" for k in range(1000)).encode()
    with path.open("wb") as stream:
        stream.write((",".join(["t", *(f"c{k}" for k in range(40))]) + "\n").encode())
        for _ in range(size // len(lines)):
            stream.write(lines)
    done = subprocess.run([sys.executable, "-c", READ_TWO, str(path)], capture_output=True, text=True, check=True)
    path.unlink()
    assert float(done.stdout.split()[-2]) < 1500, done.stdout
    return done.stdout.strip()


CHECKS: dict[str, Callable[[Path], str]] = {
    "no home, no cache": no_home,
    "256 file descriptors": few_files,
    "2 GB of address space": little_memory,
    "a disk of 2 MB": small_disk,
    "a folder that takes nothing": read_only,
    "two at once": lambda folder: at_once(folder, 2),
    "four at once": lambda folder: at_once(folder, 4),
    "500 solves": many_solves,
    "a killed scheduler": lost_scheduler,
    "a log of 1 GB": long_log,
}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="append", choices=list(CHECKS))
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    bad = 0
    print("| surroundings | outcome |\n| --- | --- |")
    for name in parser.parse_args().check or CHECKS:
        with tempfile.TemporaryDirectory() as folder:
            try:
                said = CHECKS[name](Path(folder))
            except AssertionError as err:
                said, bad = f"WRONG: {str(err)[:300]}", bad + 1
        print(f"| {name} | {said} |", flush=True)
    return bool(bad)


if __name__ == "__main__":
    sys.exit(main())
