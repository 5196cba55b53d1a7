"""The guard of a pair: fresh commands against the field, the stated pair, and the time of its C.

    python benchmarks/pair_guard.py [--fresh 500] [--seed 1]

Each fresh command lies just inside a random limit; it is solved on a mesh of its own, and no section's mean flux
density may exceed the level of the region that the guard gave. The C is timed over random commands and along a smooth
motion, reading them included; without gcc that is left out.
"""

import argparse
import shutil
import statistics
import subprocess
import tempfile
from pathlib import Path

import numpy as np

from msl_fem.actuator import load_actuator
from msl_fem.export.c_pair_guard import write
from msl_fem.magnetics.field.pair_field import PairField, pair_magnet, pair_mesh
from msl_fem.maps.guard import REGIONS
from msl_fem.maps.pair_guard import PairGuard
from msl_fem.maps.pair_limits import AIDING, OPPOSING, RELATIONS, PairMap, pair_map
from msl_fem.table.pair_table import read_pair_table

ROOT = Path(__file__).parents[1]
GAP_SUM, N, RUNS = 1.2e-3, 1_000_000, 7
PROGRAM = r"""
#define _POSIX_C_SOURCE 199309L
#include <stdio.h>
#include <stdlib.h>
#include <time.h>
#include "guard.h"

static double now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return 1e9 * (double)t.tv_sec + (double)t.tv_nsec;
}

int main(int argc, char **argv)
{
    long n = atol(argv[1]), runs = atol(argv[2]), k, r;
    double *rows = malloc(3 * (size_t)n * sizeof *rows);
    if (argc != 3 || !rows || m_pair_guard_self_check()) return 1;
    if (fread(rows, sizeof *rows, 3 * (size_t)n, stdin) != 3 * (size_t)n) return 1;
    for (r = 0; r < runs; ++r) {
        long sum = 0;
        double start = now();
        for (k = 0; k < n; ++k) sum += m_pair_guard_region(rows[3 * k], rows[3 * k + 1], rows[3 * k + 2]);
        printf("%.6g\n", (now() - start) / (double)n);
        if (sum == -1) puts("never");
    }
    return 0;
}
"""


def fresh_commands(guard: PairGuard, n: int, seed: int) -> list[tuple[float, float, float, int]]:
    """(current 1, current 2, position, region) just inside a random limit, none of them unacceptable."""
    rng, found = np.random.default_rng(seed), []
    while len(found) < n:
        x, j = rng.uniform(-0.5e-3, 0.5e-3), rng.uniform(0, 6) * rng.choice([1.0, 0.2])
        relation, level = int(rng.integers(2)), int(rng.integers(2))
        limit = guard._limits(relation, x, j)[level]
        i, other = 0.995 * min(limit, 6.0), j if relation == AIDING else -j
        region = int(guard.regions(i, other, x))
        if limit > 0 and REGIONS[region] != "unacceptable":
            found.append((i, other, x, region))
    return found


def violations(guard: PairGuard, commands: list[tuple[float, float, float, int]]) -> tuple[int, float]:
    """How many exceed the level of their region, and the largest flux density over that level."""
    servo = load_actuator(ROOT / "geometries/fast_tool_servo.toml")
    field = PairField(servo, pair_mesh(pair_magnet(servo), 3e-4, "fast"), gap_sum=GAP_SUM, order=3)
    shares = []
    for i, j, x, region in commands:
        b = max(section.mean for section in field.flux_densities(field.solve(x, i, j)).values())
        shares.append(b / guard.pair_map.levels[region])
    return int(np.sum(np.array(shares) > 1)), float(max(shares))


def time_of_c(record: PairMap) -> dict[str, float]:
    """Median ns of a judgement by the order of the commands; empty without gcc."""
    if shutil.which("gcc") is None:
        return {}
    rng, phase = np.random.default_rng(1), np.linspace(0, 2e-3 * N, N)
    orders = {
        "at random": rng.uniform([-6, -6, -0.5e-3], [6, 6, 0.5e-3], (N, 3)),
        "along a motion": np.column_stack(
            [3 + 2 * np.sin(phase), -3 + 2 * np.sin(1.3 * phase), 4e-4 * np.sin(0.37 * phase)]
        ),
    }
    with tempfile.TemporaryDirectory() as folder:
        here = Path(folder)
        write(record, here / "guard.h", name="m")
        (here / "time.c").write_text(PROGRAM)
        subprocess.run(["gcc", "-std=c99", "-O2", "-o", here / "time", here / "time.c", "-lm"], check=True)
        command = [here / "time", str(N), str(RUNS)]
        said = {
            name: subprocess.run(command, input=rows.tobytes(), check=True, capture_output=True).stdout.split()
            for name, rows in orders.items()
        }
    return {name: statistics.median(map(float, values)) for name, values in said.items()}


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--fresh", type=int, default=500)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    record = pair_map(read_pair_table(ROOT / "lookup_tables/fast_tool_servo_pair.nc"))
    guard = PairGuard(record)
    for relation, sign in ((OPPOSING, -1.0), (AIDING, 1.0)):
        said = guard.judge(0.886, sign * 5.97, 0.5e-3)
        print(f"0.886 A at 0.1 mm with 5.97 A at 1.1 mm, {RELATIONS[relation]}: {said.region}", flush=True)
    for name, value in time_of_c(record).items():
        print(f"C, {name}: {value:.3g} ns a judgement (median of {RUNS} passes over {N} commands)", flush=True)
    beyond, largest = violations(guard, fresh_commands(guard, asked.fresh, asked.seed))
    print(f"{asked.fresh} fresh commands: {beyond} beyond their region's level, largest {largest:.4f} of it")


if __name__ == "__main__":
    main()
