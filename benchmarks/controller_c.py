"""What a step of the exported C controller costs: worst case and usual case, in ns.

    python benchmarks/controller_c.py [--repeats 200] [--docs]

The steps are those of a closed-loop run (a 2 Hz sine of 0.4 mm on the reference actuator, 2500 steps), and of readings
that have nothing to do with the reference, within the guard's map and beyond it (4000 steps). Every step is timed in
its place in the run, `repeats` times over the whole run; a step's time is the least of them, which leaves out what
interrupted it, and the worst case is the largest over the steps. The largest single time of all is printed beside it:
it holds the interruptions of a machine that is no real-time system. The last rows are those of a period of the
current loop around voltages, of readings near the wanted currents and far from them. With --docs the table takes its
place in docs/controller_c.md.
"""

import argparse
import platform
import shutil
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from marked_text import rewrite

from msl_fem.actuator import Actuator, load_actuator
from msl_fem.control import ControllerDesign, design_controller
from msl_fem.control.design_model import design_model_of
from msl_fem.control.lqr_design import LqrOptions, lqr_design
from msl_fem.control.scheduled_design import RIGID, ScheduleOptions, scheduled_design
from msl_fem.control.stepper import Stepper, reference_rows
from msl_fem.export.c_controller import ControllerSource, controller_header
from msl_fem.maps import operating_map
from msl_fem.maps.pair_limits import pair_map
from msl_fem.plant.excitation import parse_excitation, reference
from msl_fem.plant.sampled_plant import simulate_closed
from msl_fem.table.magnetic_table import MagneticTable, read_table
from msl_fem.table.pair_table import load_table, read_pair_table

ROOT = Path(__file__).parent.parent
WISHED = 2000.0  # ns; the period is 400 000
OVERLAP = 8.0  # N: both sides are inverted in every step
PROGRAM = r"""
#define _POSIX_C_SOURCE 199309L
#include <stdio.h>
#include <stdlib.h>
#include <time.h>
#include "exported.h"

static double now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return 1e9 * (double)t.tv_sec + (double)t.tv_nsec;
}

/* for each step of the run: least ns, then of all the largest; the time of asking the clock taken off */
int main(int argc, char **argv)
{
    long n = atol(argv[1]), repeats = atol(argv[2]), k, r;
    double *in = malloc(7 * (size_t)n * sizeof *in), *least = malloc((size_t)n * sizeof *least);
    double largest = 0.0, clock = 1e9, sum = 0.0;
    FILE *file = fopen(argv[3], "rb");
    m_controller c;
    if (argc != 4 || !in || !least || !file || m_controller_self_check()) return 1;
    if (fread(in, sizeof *in, 7 * (size_t)n, file) != 7 * (size_t)n) return 1;
    for (k = 0; k < 100000; ++k) {
        const double start = now(), spent = now() - start;
        clock = spent < clock ? spent : clock;
    }
    for (k = 0; k < n; ++k) least[k] = 1e9;
    for (r = 0; r < repeats; ++r) {
        m_controller_start(&c);
        for (k = 0; k < n; ++k) {
            double out[2], spent, start = now();
            m_controller_step_ahead(&c, in + 7 * k, in[7 * k + 6], out);
            spent = now() - start - clock;
            sum += out[0];
            least[k] = spent < least[k] ? spent : least[k];
            largest = spent > largest ? spent : largest;
        }
    }
    for (k = 0; k < n; ++k) printf("%.6g\n", least[k]);
    printf("%.6g\n", largest);
    if (sum == 1.2345) puts("never");
    return 0;
}
"""


CURRENT_LOOP = (
    PROGRAM.replace("m_controller_self_check()", "m_current_loop_self_check()")
    .replace("m_controller c;", "m_current_loop c;")
    .replace("m_controller_start", "m_current_loop_start")
    .replace(
        "m_controller_step_ahead(&c, in + 7 * k, in[7 * k + 6], out)",
        "m_current_loop_step(&c, in + 7 * k, in + 7 * k + 2, in[7 * k + 4], out)",
    )
)


def periods(*, wild: bool) -> np.ndarray:
    """(n, 7) wanted and read currents, position, and two numbers that nothing reads."""
    rng, n = np.random.default_rng(6), 4000
    k = np.arange(n)
    wanted = np.column_stack([np.maximum(0, np.sin(0.01 * k)), np.maximum(0, -np.sin(0.01 * k))]) * (
        9.0 if wild else 1.0
    )
    read = wanted + (2.0 if wild else 0.01) * rng.standard_normal((n, 2))
    position = (9e-4 if wild else 4e-4) * (rng.uniform(-1, 1, n) if wild else np.sin(0.01 * k))
    return np.column_stack([wanted, read, position, np.zeros((n, 2))])


def tracking(design: ControllerDesign, table) -> np.ndarray:
    """(n, 7) references, now and a lead later, and readings of a loop that tracks."""
    spec = "sine:frequency=2 Hz,amplitude=0.4 mm,duration=1 s,loop=closed"
    wanted = reference(parse_excitation(spec), rate=2500.0)
    run = simulate_closed(design.actuator, table, wanted, Stepper(design), generator=np.random.default_rng(1))
    samples = np.column_stack([wanted.position, wanted.velocity, wanted.acceleration])
    return np.column_stack([reference_rows(design, samples, period=1 / 2500.0), run.measured_position])


def wild(design: ControllerDesign) -> np.ndarray:
    """(n, 7) references, now and a lead later, and readings that do not belong together, up to 1.3 times the reach."""
    rng, n, span = np.random.default_rng(5), 4000, 0.5 * (design.reach[1] - design.reach[0])
    wanted = [span * rng.uniform(-1, 1, n), 0.1 * rng.standard_normal(n), 30 * rng.standard_normal(n)]
    return np.column_stack([*wanted, *wanted, 1.3 * span * rng.uniform(-1, 1, n)])


def design_on_pair(actuator: Actuator) -> tuple[MagneticTable, ControllerDesign]:
    """The pair's table and the dearest step: gains that follow, both sides inverted, both currents judged together."""
    file = ROOT / "lookup_tables" / "fast_tool_servo_pair.nc"
    table = load_table(file)
    one_side = operating_map(table)
    assert actuator.sides is not None
    limits = pair_map(read_pair_table(file), levels=one_side.levels.tolist(), polarity=actuator.sides.polarity)
    model = design_model_of(actuator, table, one_side, limits)
    return table, scheduled_design(model, options=ScheduleOptions(overlap=OVERLAP, family=RIGID))


def measured(
    design: ControllerDesign, regions, steps: np.ndarray, *, flags: list[str], repeats: int, program: str = PROGRAM
) -> np.ndarray:
    """Least ns of each step, and behind them the largest single time."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "exported.h").write_text(controller_header(ControllerSource(design, regions), name="m"))
        (folder / "program.c").write_text(program)
        steps.tofile(folder / "steps")
        command = ["gcc", "-std=c99", *flags, "-o", "program", "program.c", "-lm"]
        subprocess.run(command, cwd=folder, check=True)
        done = subprocess.run(
            ["./program", str(len(steps)), str(repeats), "steps"],
            cwd=folder,
            check=True,
            capture_output=True,
            text=True,
        )
    return np.array(done.stdout.split(), dtype=float)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeats", type=int, default=200)
    parser.add_argument("--docs", action="store_true")
    asked = parser.parse_args()
    if shutil.which("gcc") is None:
        sys.exit("gcc is not installed; this benchmark compiles C")
    actuator = load_actuator(ROOT / "geometries" / "fast_tool_servo.toml")
    table = read_table(ROOT / "lookup_tables" / "fast_tool_servo.nc")
    regions = operating_map(table)
    hard = design_controller(actuator, table, regions)
    both = lqr_design(design_model_of(actuator, table, regions), options=LqrOptions(overlap=OVERLAP))
    pair, of_pair = design_on_pair(actuator)
    follows = scheduled_design(design_model_of(actuator, table, regions), options=ScheduleOptions(overlap=OVERLAP))
    designs = (
        ("lqr, one side at a time", hard, table, regions),
        (f"lqr, {OVERLAP:g} N of overlap", both, table, regions),
        (f"scheduled, {OVERLAP:g} N of overlap", follows, table, regions),
        (f"scheduled-rigid, {OVERLAP:g} N of overlap, guard of the pair", of_pair, pair, operating_map(pair)),
    )
    rows = ["| design | steps | compiled | median (ns) | worst step (ns) | largest single time (ns) |"]
    rows.append("| --- | --- | --- | ---: | ---: | ---: |")
    worst = 0.0
    for name, design, under, limits in designs:
        for kind, steps in (("a run that tracks", tracking(design, under)), ("wild", wild(design))):
            for flags in (["-O2"], ["-O0"]):
                found = measured(design, limits, steps, flags=flags, repeats=asked.repeats)
                least, single = found[:-1], found[-1]
                figures = " | ".join(f"{value:.0f}" for value in (np.median(least), least.max(), single))
                rows.append(f"| {name} | {kind} | gcc {' '.join(flags)} | {figures} |")
                worst = max(worst, float(least.max())) if flags == ["-O2"] else worst
    drive = {"kind": "voltage", "bandwidth": None}
    rig = actuator.model_copy(update={"drive": actuator.drive.model_copy(update=drive)})
    around = replace(hard, current_loop=design_model_of(rig, table, regions).current_loop)
    for kind, wild_ones in (("near the wanted currents", False), ("wild", True)):
        for flags in (["-O2"], ["-O0"]):
            steps = periods(wild=wild_ones)
            found = measured(around, regions, steps, flags=flags, repeats=asked.repeats, program=CURRENT_LOOP)
            figures = " | ".join(f"{value:.0f}" for value in (np.median(found[:-1]), found[:-1].max(), found[-1]))
            rows.append(f"| current loop | {kind} | gcc {' '.join(flags)} | {figures} |")
            worst = max(worst, float(found[:-1].max())) if flags == ["-O2"] else worst
    said = f"Worst step at -O2: {worst:.0f} ns; wished for: at most {WISHED:.0f} ns of a period of 400 000."
    text = "\n".join([*rows, "", said, f"{platform.machine()}, Python {platform.python_version()}."])
    print(text)
    if asked.docs:
        rewrite(ROOT / "docs" / "controller_c.md", {"controller in C": text})


if __name__ == "__main__":
    main()
