"""Commands killed at random moments, by kill -9 and by SIGTERM: what is left, and whether the next run goes on.

    python tests/robustness/kills.py --kills 20 --seed 1

Each command is run once undisturbed, which tells how long it takes; then it is killed as often as asked at moments
drawn over that time, half of them with all its processes at once, and run again in the same folder. Afterwards the
files must be those of an undisturbed run, nothing hidden may be left, and rows that were finished
before the kill must be used.
"""

import argparse
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from targets import LOG, SERVO, TABLE, TYPED_COLUMNS

LONG = 600.0
INTERRUPTED = 130
"""Exit status; Python itself makes of it an end by SIGINT, 130 to a shell, where the signal met it in an `exec`."""
REQUIREMENT = (
    'schema = 1\nname = "servo"\n[force]\nminimum = "150 N"\ngap = "0.5 mm"\n[heat]\ncurrent_density = "6 A/mm^2"\n'
)
GRID = ("--gaps", "0.3, 0.4, 0.5, 0.7 mm", "--currents", "0, 1, 2, 4, 6 A", "--accuracy", "fast")
COMMANDS: dict[str, tuple[str, ...]] = {
    "table": ("table", str(SERVO), "-o", "t.nc", *GRID, "--workers", "1", "--resume", "--json"),
    "table, 2 processes": ("table", str(SERVO), "-o", "t.nc", *GRID, "--workers", "2", "--resume", "--json"),
    "size": ("size", "r.toml", "-o", "a.toml", "--trials", "12", "--workers", "1", "--json"),
    "export": ("export", str(TABLE), "--to", "mat", "-o", "t.mat", "--json"),
    "import": ("import", "log.csv", "--columns", TYPED_COLUMNS, "--actuator", str(SERVO), "-o", "rec", "--json"),
    "map": ("map", str(TABLE), "-o", "m.json", "--json"),
    "diagnose": ("diagnose", "bench", "-o", "out", "--table", str(TABLE), "--json"),
    "study": ("study", str(SERVO), "-o", "s", "--accuracy", "fast", "--workers", "1", "--resume", "--json"),
}
QUICK = ("table", "size", "export", "import")
KEPT = {"log.csv", "r.toml", "bench"}


@dataclass
class Tally:
    """What came of the kills of a command."""

    kills: int = 0
    before_end: int = 0
    went_on: int = 0
    reused: int = 0
    left_at_once: int = 0
    left_after_next: int = 0
    wrong: list[str] = field(default_factory=list)


def prepared(folder: Path, name: str) -> Path:
    """A folder with what a command reads."""
    folder.mkdir()
    (folder / "log.csv").write_text(LOG)
    (folder / "r.toml").write_text(REQUIREMENT)
    if name == "diagnose":
        run(("bench", str(SERVO), "--table", str(TABLE), "-o", "bench", "--seed", "3"), folder)
    return folder


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
    return sorted(name for name in names if name.endswith((".part", ".lock")))


def results(folder: Path) -> set[str]:
    """Names of the files a command made."""
    files = (p.relative_to(folder) for p in folder.rglob("*") if p.is_file())
    return {str(p) for p in files if p.parts[0] not in KEPT and not any(part.startswith(".") for part in p.parts)}


def kill_once(name: str, folder: Path, at: float, number: signal.Signals, *, all_processes: bool, tally: Tally) -> None:
    """One kill of a command after so many seconds, and the next run."""
    words, said = COMMANDS[name], ""
    process = start(words, folder)
    time.sleep(at)
    tally.kills += 1
    if process.poll() is None:
        tally.before_end += 1
        (os.killpg if all_processes else os.kill)(process.pid, number)
    _, said = process.communicate(timeout=LONG)
    if "Traceback" in said:
        tally.wrong.append(f"{name}, {number.name} after {at:.2f} s: a traceback: {said[-300:]!r}")
    if number == signal.SIGTERM and process.returncode not in (0, INTERRUPTED, -signal.SIGINT, -number):
        tally.wrong.append(f"{name}, SIGTERM after {at:.2f} s: status {process.returncode}")
    tally.left_at_once += bool(hidden(folder))
    if number == signal.SIGTERM and process.returncode == INTERRUPTED and hidden(folder):
        tally.wrong.append(f"{name}, SIGTERM after {at:.2f} s left {hidden(folder)}")
    done_before = name == "import" and (folder / "rec" / "log.csv").is_file()
    status, out, err = run(words, folder)
    if done_before and status == 2 and "is there already" in err:  # the run is in the record: nothing to go on with
        tally.went_on += 1
    elif status:
        tally.wrong.append(f"{name}, {number.name} after {at:.2f} s: the next run ended with {status}: {err[-300:]!r}")
    else:
        tally.went_on += 1
        printed = json.loads(out)
        tally.reused += int(printed.get("reused_rows", 0) or 0)
    tally.left_after_next += bool(hidden(folder))


def kill_often(name: str, kills: int, seed: int, root: Path) -> Tally:
    """A command killed so often with each signal."""
    rng, tally = np.random.default_rng(seed), Tally()
    whole = prepared(root / f"{name} whole", name)
    began = time.monotonic()
    status, _, err = run(COMMANDS[name], whole)
    takes = time.monotonic() - began
    if status:
        tally.wrong.append(f"{name}: undisturbed it ended with {status}: {err[-300:]!r}")
        return tally
    for number in (signal.SIGKILL, signal.SIGTERM):
        for k in range(kills):
            folder = prepared(root / f"{name} {number.name} {k}", name)
            at = float(rng.uniform(0.05, 1.0) * takes)
            kill_once(name, folder, at, number, all_processes=bool(k % 2), tally=tally)
            if results(folder) != results(whole):
                tally.wrong.append(f"{name}, {number.name} after {at:.2f} s: {results(folder) ^ results(whole)} differ")
            shutil.rmtree(folder)
    return tally


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=20, help="of each command with each signal")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--command", action="append", choices=list(COMMANDS))
    asked = parser.parse_args()
    print("| command | kills | before its end | next run went on | rows taken over | hidden at once | after next |")
    print("| --- | ---: | ---: | ---: | ---: | ---: | ---: |")
    wrong: list[str] = []
    for name in asked.command or COMMANDS:
        with tempfile.TemporaryDirectory() as root:
            t = kill_often(name, asked.kills, asked.seed, Path(root))
        cells = (t.kills, t.before_end, t.went_on, t.reused, t.left_at_once, t.left_after_next)
        print(f"| {name} | {' | '.join(map(str, cells))} |", flush=True)
        wrong += t.wrong
    for line in wrong:
        print(line)
    print(f"{len(wrong)} wrong")
    return bool(wrong)


if __name__ == "__main__":
    sys.exit(main())
