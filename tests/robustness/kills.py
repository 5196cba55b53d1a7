"""Commands killed at random moments, by kill -9 and by SIGTERM: what is left, and whether the next run goes on.

    python tests/robustness/kills.py --kills 20 --seed 1 --kept kills.jsonl

Each command is run once undisturbed, which tells how long it takes; then it is killed as often as asked at moments
drawn over that time, every other kill with all its processes at once, alternately by each signal, and run again in the
same folder. A command that ends before its kill says that it takes less, and is tried again at another moment.
Afterwards files and printed result must be those of an undisturbed run, nothing hidden may be left, and
what was finished before the kill (rows, trials, records, fits) must still be there or be used. With --kept a next call
goes on where one stopped.
"""

import argparse
import json
import os
import shutil
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import closing
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from targets import LOG, SERVO, TABLE, TYPED_COLUMNS

from msl_fem.table import read_table

LONG = 600.0
INTERRUPTED = 130
"""Exit status; Python itself makes of it an end by SIGINT, 130 to a shell, where the signal met it in an `exec`."""
REQUIREMENT = (
    'schema = 1\nname = "servo"\n[force]\nminimum = "150 N"\ngap = "0.5 mm"\n[heat]\ncurrent_density = "6 A/mm^2"\n'
)
GRID = ("--gaps", "0.3, 0.5, 0.7 mm", "--currents", "0, 2, 4, 6 A", "--accuracy", "fast")
STATIC_RIG = (
    'schema = 1\norigin = "measured"\nactuator = "actuator.toml"\n[noise]\nforce = "0.2 N"\n[static]\nrole = "fit"\n'
)
SHORT_RUNS = (
    "band-limited-noise:bias=0.5 A,amplitude=50 mA,band=200 Hz,duration=0.65 s,seed=4,role=fit",
    "swept-sine:bias=0.5 A,amplitude=30 mA,start=10 Hz,stop=150 Hz,duration=0.3 s,role=held-out",
)
COMMANDS: dict[str, tuple[str, ...]] = {
    "export": ("export", str(TABLE), "--to", "mat", "-o", "t.mat", "--json"),
    "import": ("import", "log.csv", "--columns", TYPED_COLUMNS, "--actuator", str(SERVO), "-o", "rec", "--json"),
    "map": ("map", str(TABLE), "-o", "m.json", "--json"),
    "table": ("table", str(SERVO), "-o", "t.nc", *GRID, "--workers", "1", "--resume", "--json"),
    "table, 2 processes": ("table", str(SERVO), "-o", "t.nc", *GRID, "--workers", "2", "--resume", "--json"),
    "size": ("size", "r.toml", "-o", "a.toml", "--trials", "6", "--workers", "1", "--json"),
    "diagnose": ("diagnose", "static", "-o", "out", "--table", str(TABLE), "--resume", "--json"),
    "calibrate": (
        "calibrate", "bench", "-o", "out", "--table", str(TABLE), "--records", "3", "--resume", "--json"
    ),
    "study": ("study", str(SERVO), "-o", "s", "--accuracy", "fast", "--workers", "1", "--resume", "--json"),
}  # fmt: skip
KEPT = {"log.csv", "r.toml", "bench", "bench.answer.json", "static"}
VARIES = ("seconds", "reused", "cpu", "date", "iterations")
"""Of a result: what may be another number after a kill."""
SAME = 1e-2
"""Relative: a fit that goes on from where one ended stops elsewhere within its tolerance, 0.25 % have been seen."""


@dataclass
class Tally:
    """What came of the kills of a command."""

    kills: int = 0
    too_late: int = 0
    went_on: int = 0
    finished: int = 0
    lost: int = 0
    left_at_once: int = 0
    left_after_next: int = 0
    wrong: list[str] = field(default_factory=list)

    def add(self, other: "Tally") -> None:
        """Takes another tally into this one."""
        for name, value in asdict(other).items():
            setattr(self, name, getattr(self, name) + value)


def prepared(folder: Path, name: str) -> Path:
    """A folder with what a command reads."""
    folder.mkdir()
    (folder / "log.csv").write_text(LOG)
    (folder / "r.toml").write_text(REQUIREMENT)
    if name == "diagnose":
        _write_static(folder / "static")
    if name == "calibrate":
        runs = [word for text in SHORT_RUNS for word in ("--excitation", text)]
        run(
            ("bench", str(SERVO), "--table", str(TABLE), "-o", "bench", "--seed", "3", "--rate", "5 kHz", *runs), folder
        )
    return folder


def _write_static(record: Path) -> None:
    """A static map whose gaps are 20 um off: forces of the shipped table with noise."""
    record.mkdir()
    table, generator = read_table(TABLE), np.random.default_rng(1)
    rows = ["gap_m,current_A,force_N,role"]
    for gap in np.linspace(2e-4, 9e-4, 10):
        for current in np.linspace(0.5, 4, 8):
            force = -float(table.force(current, gap + 2e-5)) + 0.2 * generator.normal()
            rows.append(f"{gap:.9g},{current:.9g},{force:.9g},{'fit' if len(rows) % 4 else 'held-out'}")
    (record / "static.csv").write_text("\n".join(rows) + "\n")
    (record / "rig.toml").write_text(STATIC_RIG)
    shutil.copyfile(SERVO, record / "actuator.toml")


def start(words: tuple[str, ...], folder: Path) -> subprocess.Popen[str]:
    """The command in a session of its own."""
    return subprocess.Popen(
        [sys.executable, "-m", "msl_fem.cli", *words], cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        text=True, start_new_session=True,
    )  # fmt: skip


def run(words: tuple[str, ...], folder: Path) -> tuple[int, str, str]:
    """Exit status, what was printed, what was said."""
    process = start(words, folder)
    out, err = process.communicate(timeout=LONG)
    return process.returncode, out, err


def hidden(folder: Path) -> list[str]:
    """Leftovers: parts and locks. Rows and trials that a next run takes are no leftovers until it is done."""
    names = [p.name for p in folder.rglob("*")]
    return sorted(name for name in names if name.endswith((".new", ".part", ".lock")))


def results(folder: Path) -> set[str]:
    """Names of the files a command made."""
    files = (p.relative_to(folder) for p in folder.rglob("*") if p.is_file())
    return {str(p) for p in files if p.parts[0] not in KEPT and not any(part.startswith(".") for part in p.parts)}


def finished(folder: Path) -> set[str]:
    """What a command has finished and kept for a next run: rows of fields, judged designs, records, fits."""
    done = {f"row {p.stem}" for p in folder.rglob("*.npz") if ".part" not in p.name}
    for path in folder.glob(".*.sqlite3"):
        with closing(sqlite3.connect(path)) as base:
            try:
                done |= {f"trial {n}" for (n,) in base.execute("select number from trials where state = 'COMPLETE'")}
            except sqlite3.OperationalError:  # killed before the first table was made
                continue
    lines = folder / "out" / "calibration.jsonl"
    if lines.is_file():
        done |= {line for line in lines.read_text().splitlines() if line.endswith("}")}
    state = folder / "out" / "diagnosis_state.json"
    if state.is_file():
        done |= {f"fit {name}" for name in json.loads(state.read_text())["fits"]}
    return done


def lost(name: str, before: set[str], after: set[str], printed: dict[str, Any]) -> int:
    """How many of the finished things a next run did anew. Rows and fits are removed when all is done."""
    if name.startswith("table"):
        return len(before) - int(printed["reused_rows"])
    return len(before - after) if name in ("size", "calibrate") else 0


def same(one: object, other: object) -> bool:
    """Whether two results say the same, up to what varies from run to run."""
    if isinstance(one, dict) and isinstance(other, dict):
        fixed = [key for key in one.keys() | other.keys() if not any(word in key for word in VARIES)]
        return all(key in one and key in other and same(one[key], other[key]) for key in fixed)
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, float) and isinstance(other, float):
        return abs(one - other) <= SAME * max(abs(one), abs(other), 1e-9)
    return one == other


def outcome_of(name: str, printed: dict[str, Any]) -> object:
    """What a next run has to say again: of a diagnosis all but its sentences, which round its figures."""
    if name != "diagnose":
        return printed
    return {key: value for key, value in printed.items() if key not in ("notes", "reason")}


def kill_once(name: str, folder: Path, at: float, number: signal.Signals, *, all_processes: bool) -> tuple[Tally, Any]:
    """One kill of a command after so many seconds, and the next run with what it printed; none if it has ended."""
    words, tally = COMMANDS[name], Tally(kills=1)
    when = f"{name}, {number.name} after {at:.2f} s"
    process = start(words, folder)
    time.sleep(at)
    if process.poll() is not None:
        process.communicate()
        return Tally(too_late=1), None
    (os.killpg if all_processes else os.kill)(process.pid, number)
    _, said = process.communicate(timeout=LONG)
    if "Traceback" in said:
        tally.wrong.append(f"{when}: a traceback: {said[-300:]!r}")
    if number == signal.SIGTERM and process.returncode not in (0, INTERRUPTED, -signal.SIGINT, -number):
        tally.wrong.append(f"{when}: status {process.returncode}")
    tally.left_at_once = int(bool(hidden(folder)))
    if number == signal.SIGTERM and process.returncode == INTERRUPTED and hidden(folder):
        tally.wrong.append(f"{when}: left {hidden(folder)}")
    done_before = name == "import" and (folder / "rec" / "log.csv").is_file()
    before = finished(folder)
    tally.finished = len(before)
    status, out, err = run(words, folder)
    tally.left_after_next = int(bool(hidden(folder)))
    if done_before and status == 2 and "is there already" in err:  # the run is in the record: nothing to go on with
        return replace(tally, went_on=1), None
    if status:
        tally.wrong.append(f"{when}: the next run ended with {status}: {err[-300:]!r}")
        return tally, None
    printed = json.loads(out)
    tally = replace(tally, went_on=1, lost=lost(name, before, finished(folder), printed))
    if tally.lost:
        tally.wrong.append(f"{when}: {tally.lost} of {tally.finished} finished were done anew")
    if hidden(folder):
        tally.wrong.append(f"{when}: the next run left {hidden(folder)}")
    return tally, printed


def kill_often(name: str, kills: int, seed: int, root: Path, *, done: int = 0) -> Iterator[Tally]:
    """A command killed until it was so often, alternately by each signal; what came of each kill."""
    given = prepared(root / f"{name} given", name)
    whole = shutil.copytree(given, root / f"{name} whole")
    began = time.monotonic()
    status, out, err = run(COMMANDS[name], whole)
    takes = time.monotonic() - began
    if status:
        yield Tally(wrong=[f"{name}: undisturbed it ended with {status}: {err[-300:]!r}"])
        return
    k, late = done, 0
    while k < kills:
        rng = np.random.default_rng([seed, k, late])
        number = (signal.SIGKILL, signal.SIGTERM)[k % 2]
        folder = shutil.copytree(given, root / f"{name} {k} {late}")
        at = float(rng.uniform(0.05, 1.0) * takes)
        tally, printed = kill_once(name, folder, at, number, all_processes=bool(k // 2 % 2))
        if results(folder) != results(whole):
            tally.wrong.append(f"{name}, {number.name} after {at:.2f} s: {results(folder) ^ results(whole)} differ")
        if printed is not None:
            now, then = outcome_of(name, printed), outcome_of(name, json.loads(out))
            if not same(now, then):
                tally.wrong.append(f"{name}, {number.name} after {at:.2f} s: another result than undisturbed")
        shutil.rmtree(folder)
        if tally.too_late:
            takes = min(takes, at)
        k, late = (k, late + 1) if tally.too_late else (k + 1, 0)
        yield tally


def earlier(kept: Path | None) -> dict[str, Tally]:
    """What the calls before have counted, by command."""
    tallies: dict[str, Tally] = {}
    for line in kept.read_text().splitlines() if kept is not None and kept.is_file() else []:
        told = json.loads(line)
        tallies.setdefault(told.pop("command"), Tally()).add(Tally(**told))
    return tallies


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=20, help="of each command, half of them with each signal")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--command", action="append", choices=list(COMMANDS))
    parser.add_argument("--kept", type=Path, help="a file with a line for each kill; a next call goes on")
    asked = parser.parse_args()
    tallies = earlier(asked.kept)
    for name in asked.command or COMMANDS:
        total = tallies.setdefault(name, Tally())
        if total.kills >= asked.kills:
            continue
        with tempfile.TemporaryDirectory() as root:
            for one in kill_often(name, asked.kills, asked.seed, Path(root), done=total.kills):
                total.add(one)
                if asked.kept is not None:
                    with asked.kept.open("a") as stream:
                        stream.write(json.dumps({"command": name, **asdict(one)}) + "\n")
    heads = "command, kills, too late for one, next run went on, finished before, lost, parts at once, after next"
    print(f"| {heads.replace(', ', ' | ')} |")
    print(f"| --- {'| ---: ' * heads.count(',')}|")
    for name, t in tallies.items():
        cells = (t.kills, t.too_late, t.went_on, t.finished, t.lost, t.left_at_once, t.left_after_next)
        print(f"| {name} | {' | '.join(map(str, cells))} |")
    wrong = [line for t in tallies.values() for line in t.wrong]
    for line in wrong:
        print(line)
    print(f"{len(wrong)} wrong")
    return bool(wrong)


if __name__ == "__main__":
    sys.exit(main())
