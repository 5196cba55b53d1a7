"""What the diagnosis of a record of 12 s at 10 kHz takes: time on the clock, CPU time, memory; all effects tried.

    python benchmarks/diagnosis_speed.py [--threads N] [--docs]

Eight seconds of noise to fit, four of a swept sine held out, on the reference actuator and on a levitator under its
controller, one effect of 3 % or none hidden. Each record is diagnosed in a process of its own. With --docs the table
takes its place in docs/diagnosis.md.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import time

from marked_text import rewrite
from study_rigs import ROOT, excitations_of, loop_of, study_rig

from msl_fem.bench import BenchOptions, parse_requests, sealed_record, usual_excitations
from msl_fem.diagnosis import DiagnosisSettings, diagnose
from msl_fem.plant.excitation import Excitation, parse_excitation

CASES = (
    ("servo", "voltage", "none"),
    ("servo", "voltage", "time_delay=3%"),
    ("servo", "voltage", "eddy_currents=3%"),
    ("servo", "current", "none"),
    ("servo", "current", "stiffness_nonlinearity=3%"),
    ("servo", "current", "magnetic_hysteresis=3%"),
    ("levitator", "current", "none"),
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
    record = sealed_record(actuator, table, parse_requests((hidden,)), options).record
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
    parser.add_argument("--docs", action="store_true")
    options = parser.parse_args()
    if options.one:
        measured(*options.one, options.threads)
        return
    lines = [
        f"| rig, drive, hidden ({options.threads} threads) | on the clock | CPU | memory | named |",
        "| --- | ---: | ---: | ---: | --- |",
    ]
    for rig, drive, hidden in CASES:
        command = [sys.executable, __file__, "--threads", str(options.threads), "--one", rig, drive, hidden]
        it = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout.splitlines()[-1])
        said = ", ".join(it["names"]) or it["verdict"]
        row = f"| {rig}, {drive}, {hidden} | {it['wall']:.0f} s | {it['cpu']:.0f} s | {it['memory']:.0f} MB | {said} |"
        lines.append(row)
        print(row, flush=True)
    if options.docs:
        rewrite(ROOT / "docs" / "diagnosis.md", {"speed": "\n".join(lines)})


if __name__ == "__main__":
    main()
