"""E1 with its end turns in three dimensions, and both plane sections beside it: docs/three_dimensions.md.

    python benchmarks/three_d_ends.py --points 4    # solves four points that benchmarks/three_d_ends.csv lacks
    python benchmarks/three_d_ends.py               # writes the tables of the page from that file

Each point is kept as soon as it is there, so that an interrupted run goes on where it was.
"""

import argparse
import csv
import time
from pathlib import Path

from msl_fem.actuator import load_actuator
from msl_fem.magnetics.three_d.magnet_point import solve_solid

HERE = Path(__file__).parent
KEPT = HERE / "three_d_ends.csv"
COLUMNS = (
    "gap", "current", "force", "force_stress", "flux_linkage", "coenergy", "incremental_inductance",
    "force_current_slope", "force_error", "flux_error", "unknowns", "newton_iterations",
)  # fmt: skip
GRID = [(gap, current) for current in (8.0, 4.0, 2.0, 1.0) for gap in (0.6e-3, 0.3e-3, 1.0e-3)]
BETWEEN = [(gap, current) for current in (6.0, 3.0, 1.5) for gap in (0.45e-3, 0.8e-3)]


def kept() -> dict[tuple[float, float], dict[str, float]]:
    """(gap, current) to the numbers of the points that are there."""
    if not KEPT.exists():
        return {}
    rows = [{k: float(v) for k, v in row.items()} for row in csv.DictReader(KEPT.open())]
    return {(row["gap"], row["current"]): row for row in rows}


def solve_missing(most: int) -> None:
    """Solves as many points as are missing, at most `most`, and appends each to the file."""
    e1 = load_actuator(HERE.parent / "geometries" / "e1.toml")
    missing = [point for point in [*GRID, *BETWEEN] if point not in kept()]
    for gap, current in missing[:most]:
        started = time.process_time()
        point, _, _ = solve_solid(e1, current, gap)
        row = {name: getattr(point, name) for name in COLUMNS} | {"cpu_seconds": time.process_time() - started}
        new = not KEPT.exists()
        with KEPT.open("a", newline="") as file:
            writer = csv.DictWriter(file, row, lineterminator="\n")
            if new:
                writer.writeheader()
            writer.writerow({k: f"{v:.9g}" for k, v in row.items()})
        print(f"{current:g} A, {gap * 1e3:g} mm: {point.force:.5g} N, {row['cpu_seconds']:.0f} s", flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--points", type=int, default=0)
    solve_missing(parser.parse_args().points)
