"""What the diagnosis of a record of 12 s at 10 kHz takes: time on the clock, CPU time, memory; all effects tried.

    python benchmarks/diagnosis_speed.py [--threads N] [--every [--rigs R,S]] [--records D] [--results F [--times N]]
                                          [--slower X] [--docs]

Eight seconds of noise to fit, four of a swept sine held out, on the reference actuator and on a levitator under its
controller, one effect of 3 % or none hidden; with --every each effect of the catalogue in turn on the rigs that --rigs
names. Each record is diagnosed in a process of its own, numba loaded before. The levitator's take a minute each to be
made: with --records they are kept in a folder. With --results rows are appended to a file as they are measured, and
what it has is not measured again, unless it is to be so more `--times`: of several the quickest counts, since what else
a machine does takes time and never gives any. `--slower` is how many times as long as another machine this one takes
for the same: times of every effect are told for that one as well. With --docs the table takes its place in
docs/diagnosis.md.
"""

import argparse
import json
import os
import pickle
import resource
import subprocess
import sys
import time
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from statistics import median
from typing import Any

from json_lines import append, rows_in
from marked_text import rewrite
from study_rigs import ROOT, excitations_of, loop_of, study_rig

from msl_fem.bench import BenchOptions, parse_requests, sealed_record, usual_excitations
from msl_fem.diagnosis import DiagnosisSettings, diagnose
from msl_fem.errors import InputError
from msl_fem.files.whole_file import whole_file
from msl_fem.plant.effects import CATALOGUE
from msl_fem.plant.excitation import Excitation, parse_excitation
from msl_fem.record import Record

Row = dict[str, Any]
Case = tuple[str, str, str]
CASES = (
    ("servo", "voltage", "none"),
    ("servo", "voltage", "time_delay=3%"),
    ("servo", "voltage", "eddy_currents=3%"),
    ("servo", "voltage", "amplifier_bandwidth=3%"),
    ("servo", "current", "none"),
    ("servo", "current", "stiffness_nonlinearity=3%"),
    ("servo", "current", "magnetic_hysteresis=3%"),
    ("levitator", "current", "none"),
    ("levitator", "current", "force_offset=3%"),
    ("levitator", "voltage", "none"),
    ("levitator", "voltage", "force_offset=3%"),
    ("levitator", "current", "eddy_currents=3%"),
    ("levitator", "voltage", "eddy_currents=3%"),
    ("levitator", "current", "magnetic_hysteresis=3%"),
    ("levitator", "current", "fringing=3%"),
    ("levitator", "current", "coil_heating=3%"),
    ("levitator", "current", "amplifier_bandwidth=3%"),
    ("levitator", "current", "coulomb_friction=3%"),
    ("levitator", "voltage", "magnetic_hysteresis=3%"),
    ("levitator", "voltage", "coulomb_friction=3%"),
)
EVERY = tuple(
    (rig, drive, f"{name}=3%")
    for rig in ("servo", "levitator")
    for drive in ("voltage", "current")
    for name in CATALOGUE
)
RATE = 1e4


def longer(one: Excitation) -> Excitation:
    """The usual excitation for twice as long where it is fitted."""
    seconds = 8 if one.role == "fit" else 4
    text = ",".join(
        part if not part.startswith("duration") else f"duration={seconds} s" for part in one.spec.split(",")
    )
    return parse_excitation(text, unit=one.unit)


def made(name: str, drive: str, hidden: str) -> Record:
    """The record of a rig.

    Raises
    ------
    InputError : the effect cannot be as large in this drive
    """
    rig = study_rig(name)
    actuator, table, loop = rig.in_drive(drive), rig.table, loop_of(rig, drive)
    usual = usual_excitations(actuator, table, rate=RATE) if loop is None else excitations_of(rig, drive, seconds=8)
    options = BenchOptions(seed=4, rate=RATE, excitations=tuple(longer(one) for one in usual), loop=loop)
    return sealed_record(actuator, table, parse_requests((hidden,)), options).record


def made_once(name: str, drive: str, hidden: str, records: Path) -> Record:
    """The same, kept in a folder for the next time."""
    path = records / f"{name} {drive} {hidden}.pickle"
    if not path.exists():
        records.mkdir(parents=True, exist_ok=True)
        record = made(name, drive, hidden)
        with whole_file(path) as part:
            part.write_bytes(pickle.dumps(record))
    found: Record = pickle.loads(path.read_bytes())
    return found


def measured(name: str, drive: str, hidden: str, threads: int, records: Path | None) -> None:
    """Diagnoses one record and prints what it took as JSON."""
    table = study_rig(name).table
    try:
        record = made(name, drive, hidden) if records is None else made_once(name, drive, hidden, records)
    except InputError as err:  # not every effect can be as large in every drive
        print(json.dumps({"bench": str(err)}))
        return
    import_module("numba")
    seconds = sum(run.time.size for run in record.runs) / RATE
    wall, cpu = time.monotonic(), time.process_time()
    found = diagnose(record, DiagnosisSettings(table=table, threads=threads))
    took = {"wall": time.monotonic() - wall, "cpu": time.process_time() - cpu, "seconds": seconds}
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e6
    print(json.dumps(took | {"memory": memory, "verdict": found.verdict, "names": found.names}))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--threads", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--one", nargs=3, metavar=("RIG", "DRIVE", "HIDDEN"), help="one record, as JSON")
    parser.add_argument("--every", action="store_true", help="every effect of the catalogue")
    parser.add_argument("--rigs", default="servo", help="of --every, with commas between them: servo, levitator")
    parser.add_argument("--records", type=Path, help="folder with records that were made, and for those that are")
    parser.add_argument("--results", type=Path, help="JSON lines, of which those that are there are kept")
    parser.add_argument(
        "--times", type=int, default=1, help="measurements of each record in that file, with those there"
    )
    parser.add_argument("--slower", type=float, default=1.0, help="times as long as another machine, of --every")
    parser.add_argument("--docs", action="store_true")
    options = parser.parse_args()
    if options.one:
        measured(*options.one, options.threads, options.records)
        return
    rows, known = [], kept(rows_in(options.results) if options.results else [])
    for case in [one for one in EVERY if one[0] in options.rigs.split(",")] if options.every else CASES:
        own = known.get(case, [])
        while len(own) < options.times and not any("bench" in row for row in own):
            own.append(measured_apart(case, options.threads, options.records))
            if options.results:
                append(options.results, own[-1])
        if "bench" in own[0]:
            print(f"{', '.join(case)}: {own[0]['bench']}", file=sys.stderr)
            continue
        rows.append(min(own, key=lambda row: float(row["wall"])))
        print(line_of(rows[-1]), flush=True)
    text = "\n".join(totals(rows, options.threads, options.slower) if options.every else listed(rows, options.threads))
    if options.every:
        print(text)
    if options.docs:
        rewrite(ROOT / "docs" / "diagnosis.md", {"speed of every effect" if options.every else "speed": text})


def measured_apart(case: Case, threads: int, records: Path | None) -> Row:
    """What `measured` prints, in a process of its own."""
    command = [sys.executable, __file__, "--threads", str(threads), "--one", *case]
    command += [] if records is None else ["--records", str(records)]
    printed = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    return dict(zip(("rig", "drive", "hidden"), case, strict=True)) | json.loads(printed.splitlines()[-1])


def kept(rows: Sequence[Row]) -> dict[Case, list[Row]]:
    """Rows by what they are of."""
    found: dict[Case, list[Row]] = {}
    for row in rows:
        found.setdefault((row["rig"], row["drive"], row["hidden"]), []).append(row)
    return found


def listed(rows: Sequence[Row], threads: int) -> list[str]:
    """A table with a line for each record."""
    titles = f"| rig, drive, hidden ({threads} threads) | on the clock | CPU | memory | named |"
    return [titles, "| --- | ---: | ---: | ---: | --- |", *map(line_of, rows)]


def line_of(row: Row) -> str:
    said = ", ".join(row["names"]) or row["verdict"]
    took = f"{row['wall']:.0f} s | {row['cpu']:.0f} s | {row['memory']:.0f} MB"
    return f"| {row['rig']}, {row['drive']}, {row['hidden']} | {took} | {said} |"


def totals(rows: Sequence[Row], threads: int, slower: float) -> list[str]:
    """A table of the median and of the slowest by rig and drive, here and on a machine than which this one is so many
    times slower, and how often the hidden effect came first."""
    lines = [
        f"| every effect ({threads} threads) | median | slowest | {slower:g} times as fast: median | "
        "slowest | within 40 s there | most memory | named first |",
        "| --- | ---: | --- | ---: | ---: | ---: | --- | ---: |",
    ]
    for rig, drive in dict.fromkeys((row["rig"], row["drive"]) for row in rows):
        own = [row for row in rows if (row["rig"], row["drive"]) == (rig, drive)]
        slow, fat = (max(own, key=lambda row, what=what: float(row[what])) for what in ("wall", "memory"))
        first = sum(row["names"][:1] == [effect_of(row)] for row in own)
        there = [float(row["wall"]) / slower for row in own]
        lines.append(
            f"| {rig}, {drive} drive | {median(row['wall'] for row in own):.0f} s | "
            f"{slow['wall']:.0f} s ({effect_of(slow)}) | {median(there):.0f} s | {max(there):.0f} s | "
            f"{sum(wall <= 40 for wall in there)} of {len(own)} | {fat['memory']:.0f} MB ({effect_of(fat)}) | "
            f"{first} of {len(own)} |"
        )
    return lines


def effect_of(row: Row) -> str:
    return str(row["hidden"]).partition("=")[0]


if __name__ == "__main__":
    main()
