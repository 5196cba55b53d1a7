"""What the diagnosis of a record of 12 s at 10 kHz takes: time on the clock, CPU time, memory; all effects tried.

    python benchmarks/diagnosis_speed.py [--threads N] [--every] [--docs]

Eight seconds of noise to fit, four of a swept sine held out, on the reference actuator and on a levitator under its
controller, one effect of 3 % or none hidden; with --every each effect of the catalogue in turn on the rigs that --rigs
names (the levitator's records alone take a minute each to be made). Each record is diagnosed in a process of its own.
With --docs the table takes its place in docs/diagnosis.md.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import time
from collections.abc import Sequence
from statistics import median
from typing import Any

from marked_text import rewrite
from study_rigs import ROOT, excitations_of, loop_of, study_rig

from msl_fem.bench import BenchOptions, parse_requests, sealed_record, usual_excitations
from msl_fem.diagnosis import DiagnosisSettings, diagnose
from msl_fem.errors import InputError
from msl_fem.plant.effects import CATALOGUE
from msl_fem.plant.excitation import Excitation, parse_excitation

Row = dict[str, Any]
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


def measured(name: str, drive: str, hidden: str, threads: int) -> None:
    """Diagnoses one record and prints what it took as JSON."""
    rig = study_rig(name)
    actuator, table, loop = rig.in_drive(drive), rig.table, loop_of(rig, drive)
    usual = usual_excitations(actuator, table, rate=RATE) if loop is None else excitations_of(rig, drive, seconds=8)
    options = BenchOptions(seed=4, rate=RATE, excitations=tuple(longer(one) for one in usual), loop=loop)
    try:
        record = sealed_record(actuator, table, parse_requests((hidden,)), options).record
    except InputError as err:  # not every effect can be as large in every drive
        print(json.dumps({"bench": str(err)}))
        return
    seconds = sum(run.time.size for run in record.runs) / RATE
    wall, cpu = time.monotonic(), time.process_time()
    found = diagnose(record, DiagnosisSettings(table=table, threads=threads))
    took = {"wall": time.monotonic() - wall, "cpu": time.process_time() - cpu, "seconds": seconds}
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(json.dumps(took | {"memory": memory, "verdict": found.verdict, "names": found.names}))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--threads", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--one", nargs=3, metavar=("RIG", "DRIVE", "HIDDEN"), help="one record, as JSON")
    parser.add_argument("--every", action="store_true", help="every effect of the catalogue")
    parser.add_argument("--rigs", default="servo", help="of --every, with commas between them: servo, levitator")
    parser.add_argument("--docs", action="store_true")
    options = parser.parse_args()
    if options.one:
        measured(*options.one, options.threads)
        return
    rows = []
    for rig, drive, hidden in [one for one in EVERY if one[0] in options.rigs.split(",")] if options.every else CASES:
        command = [sys.executable, __file__, "--threads", str(options.threads), "--one", rig, drive, hidden]
        made = subprocess.run(command, check=True, capture_output=True, text=True)
        row = {"drive": drive, "hidden": hidden, "rig": rig} | json.loads(made.stdout.splitlines()[-1])
        if "bench" in row:
            print(f"{rig}, {drive}, {hidden}: {row['bench']}", file=sys.stderr)
            continue
        rows.append(row)
        print(line_of(row), flush=True)
    text = "\n".join(totals(rows, options.threads) if options.every else listed(rows, options.threads))
    if options.every:
        print(text)
    if options.docs:
        rewrite(ROOT / "docs" / "diagnosis.md", {"speed of every effect" if options.every else "speed": text})


def listed(rows: Sequence[Row], threads: int) -> list[str]:
    """A table with a line for each record."""
    titles = f"| rig, drive, hidden ({threads} threads) | on the clock | CPU | memory | named |"
    return [titles, "| --- | ---: | ---: | ---: | --- |", *map(line_of, rows)]


def line_of(row: Row) -> str:
    said = ", ".join(row["names"]) or row["verdict"]
    took = f"{row['wall']:.0f} s | {row['cpu']:.0f} s | {row['memory']:.0f} MB"
    return f"| {row['rig']}, {row['drive']}, {row['hidden']} | {took} | {said} |"


def totals(rows: Sequence[Row], threads: int) -> list[str]:
    """A table of the median and of the slowest by rig and drive, and how often the hidden effect came first."""
    lines = [
        f"| every effect ({threads} threads) | median | slowest | within 40 s | most memory | named first |",
        "| --- | ---: | --- | ---: | --- | ---: |",
    ]
    for rig, drive in dict.fromkeys((row["rig"], row["drive"]) for row in rows):
        own = [row for row in rows if (row["rig"], row["drive"]) == (rig, drive)]
        slow, fat = (max(own, key=lambda row, what=what: float(row[what])) for what in ("wall", "memory"))
        first = sum(row["names"][:1] == [effect_of(row)] for row in own)
        within, middle = sum(row["wall"] <= 40 for row in own), median(row["wall"] for row in own)
        lines.append(
            f"| {rig}, {drive} drive | {middle:.0f} s | {slow['wall']:.0f} s ({effect_of(slow)}) | "
            f"{within} of {len(own)} | {fat['memory']:.0f} MB ({effect_of(fat)}) | {first} of {len(own)} |"
        )
    return lines


def effect_of(row: Row) -> str:
    return str(row["hidden"]).partition("=")[0]


if __name__ == "__main__":
    main()
