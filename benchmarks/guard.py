"""What a judgement of the guard costs: exported C, compiled Python over arrays, and one call from Python, in ns.

    python benchmarks/guard.py [--pairs 1000000] [--runs 7] [--docs]

Pairs (current, gap) over the reference actuator's map and a little beyond, once at random, where no branch can be
foreseen, and once along a smooth motion, as a controller asks. The result is a Markdown table of medians; with
--docs it also takes its place in docs/guard.md. Without gcc the rows of C say so.
"""

import argparse
import platform
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from marked_text import rewrite

from msl_fem.export.c_guard import guard_header
from msl_fem.maps import Guard, OperatingMap, operating_map
from msl_fem.maps.guard import region_of
from msl_fem.table.magnetic_table import read_table

ROOT = Path(__file__).parent.parent
WISHED = 50.0  # ns
PROGRAM = r"""
#define _POSIX_C_SOURCE 199309L
#include <stdio.h>
#include <stdlib.h>
#include <time.h>
#include "guard.h"

static double now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return 1e9 * (double)t.tv_sec + (double)t.tv_nsec;
}

#define TIMED(what, call) \
    for (r = 0; r < runs; ++r) { \
        double sum = 0.0, start = now(); \
        for (k = 0; k < n; ++k) sum += (double)(call); \
        printf("%s %.6g\n", what, (now() - start) / (double)n); \
        if (sum == 1.2345) puts("never"); \
    }

int main(int argc, char **argv)
{
    long n = atol(argv[1]), runs = atol(argv[2]), k, r;
    double *current = malloc((size_t)n * sizeof *current), *gap = malloc((size_t)n * sizeof *gap);
    FILE *pairs = fopen(argv[3], "rb");
    if (argc != 4 || !current || !gap || !pairs || m_guard_self_check()) return 1;
    if (fread(current, sizeof *current, (size_t)n, pairs) != (size_t)n) return 1;
    if (fread(gap, sizeof *gap, (size_t)n, pairs) != (size_t)n) return 1;
    TIMED("nothing", current[k] + gap[k])
    TIMED("region", m_guard_region(current[k], gap[k]))
    TIMED("limit", m_guard_limit(1, gap[k]))
    TIMED("margin", m_guard_margin(current[k], gap[k]))
    return 0;
}
"""


def pairs(operating_map: OperatingMap, n: int) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Currents and gaps (n,) by the name of their order."""
    low, high, end = operating_map.gap[0], operating_map.gap[-1], operating_map.current_max
    rng, phase = np.random.default_rng(1), np.linspace(0, 2e-3 * n, n)
    return {
        "at random": (rng.uniform(-1.05 * end, 1.05 * end, n), rng.uniform(0.9 * low, 1.05 * high, n)),
        "along a motion": (
            0.5 * end * np.sin(phase),
            0.5 * (low + high) + 0.45 * (high - low) * np.sin(0.37 * phase),
        ),
    }


def timed(call: Callable[[], object], *, calls: int, runs: int) -> float:
    """Median ns of one of the `calls` judgements in a call."""
    call()  # compiled
    spent = []
    for _ in range(runs):
        started = time.perf_counter_ns()
        call()
        spent.append((time.perf_counter_ns() - started) / calls)
    return statistics.median(spent)


def of_c(operating_map: OperatingMap, current: np.ndarray, gap: np.ndarray, runs: int) -> dict[str, float]:
    """Median ns of each function of the exported header; empty without gcc."""
    if shutil.which("gcc") is None:
        return {}
    with tempfile.TemporaryDirectory() as folder:
        here = Path(folder)
        (here / "guard.h").write_text(guard_header(operating_map, name="m"))
        (here / "time.c").write_text(PROGRAM)
        (here / "pairs").write_bytes(current.tobytes() + gap.tobytes())
        subprocess.run(["gcc", "-std=c99", "-O2", "-o", here / "time", here / "time.c"], check=True)
        command = [here / "time", str(current.size), str(runs), here / "pairs"]
        lines = subprocess.run(command, check=True, capture_output=True, text=True).stdout.splitlines()
    found: dict[str, list[float]] = {}
    for name, value in map(str.split, lines):
        found.setdefault(name, []).append(float(value))
    return {name: statistics.median(values) for name, values in found.items()}


def of_python(guard: Guard, current: np.ndarray, gap: np.ndarray, runs: int) -> dict[str, float]:
    """Median ns of each way to ask from Python."""
    n, few = current.size, list(zip(current[:2000].tolist(), gap[:2000].tolist(), strict=True))
    arrays = guard.arrays
    return {
        "compiled array call, `Guard.regions`": timed(lambda: guard.regions(current, gap), calls=n, runs=runs),
        "compiled array call, `Guard.limit` (two levels)": timed(lambda: guard.limit(gap), calls=n, runs=runs),
        "compiled array call, `Guard.margin`": timed(lambda: guard.margin(current, gap), calls=n, runs=runs),
        "one call of `region_of` from Python": timed(
            lambda: [region_of(arrays, i, g) for i, g in few], calls=len(few), runs=runs
        ),
        "one call of `Guard.classify`": timed(
            lambda: [guard.classify(i, g) for i, g in few], calls=len(few), runs=runs
        ),
        "one call of `Guard.judge`": timed(
            lambda: [guard.judge(i, g) for i, g in few[:200]], calls=200, runs=runs
        ),
    }  # fmt: skip


def markdown(operating_map: OperatingMap, *, n: int, runs: int) -> str:
    """The table."""
    guard, rows = Guard(operating_map), {}
    for order, (current, gap) in pairs(operating_map, n).items():
        c = of_c(operating_map, current, gap, runs)
        for name in ("region", "limit", "margin"):
            rows.setdefault(f"C, gcc -O2, `{name}`", {})[order] = c[name] if c else float("nan")
        for name, value in of_python(guard, current, gap, runs).items():
            rows.setdefault(name, {})[order] = value
    orders = list(pairs(operating_map, 2))
    lines = [f"| ns a judgement | {' | '.join(orders)} |", "| --- |" + " ---: |" * len(orders)]
    for name, by_order in rows.items():
        texts = ["no gcc" if np.isnan(by_order[o]) else f"{by_order[o]:.3g}" for o in orders]
        lines.append(f"| {name} | {' | '.join(texts)} |")
    machine = f"{platform.machine()}, Python {platform.python_version()}"
    lines += ["", f"Medians of {runs} passes over {n} pairs, one thread, {machine}; reading the pairs is included."]
    worst = max(v for name, by in rows.items() if "one call" not in name for v in by.values() if v == v)
    lines.append(
        f"The dearest of the C functions and the array calls takes {worst:.3g} ns; {WISHED:g} ns were wished for."
    )
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pairs", type=int, default=1_000_000)
    parser.add_argument("--runs", type=int, default=7)
    parser.add_argument("--docs", action="store_true", help="write the table into docs/guard.md")
    given = parser.parse_args()
    text = markdown(
        operating_map(read_table(ROOT / "lookup_tables" / "fast_tool_servo.nc")), n=given.pairs, runs=given.runs
    )
    sys.stdout.write(text)
    if given.docs:
        rewrite(ROOT / "docs" / "guard.md", {"guard": text})


if __name__ == "__main__":
    main()
