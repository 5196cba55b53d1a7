"""A table that carries three dimensions beside solutions at points that it was not made from: docs/three_dimensions.md.

msl-fem table geometries/fast_tool_servo.toml -o servo.nc --end-effects 3d
python benchmarks/three_d_lifted.py --points 6     # solves the points that three_d_lifted.csv lacks
python benchmarks/three_d_lifted.py servo.nc       # writes the page's table
"""

import argparse
from pathlib import Path

from marked_text import rewrite
from three_d_ends import DOCUMENT, HERE, kept, solve_missing

from msl_fem.table.magnetic_table import read_table

POINTS = [(0.3e-3, 1.5), (0.3e-3, 7.0), (0.6e-3, 3.0), (0.6e-3, 9.0), (0.9e-3, 5.0), (0.9e-3, 11.0)]


def comparison(file: Path) -> list[str]:
    """Each point in three dimensions with its stated errors, and what the table differs by in %."""
    table = read_table(file)
    lines = [["g (mm)", "i (A)", "force (N)", "flux linkage (mWb)", "stated errors (%)", "table (%)"], ["---:"] * 6]
    for row in sorted(kept(HERE / "three_d_lifted.csv"), key=lambda row: (row["gap"], row["current"])):
        found = table.evaluate(row["current"], row["gap"])
        off = [f"{100 * (float(found[name]) / row[name] - 1):+.2f}" for name in ("force", "flux_linkage")]
        stated = f"{100 * row['force_error']:.2f}, {100 * row['flux_error']:.2f}"
        cells = [
            f"{1e3 * row['gap']:g}",
            f"{row['current']:g}",
            f"{row['force']:.5g}",
            f"{1e3 * row['flux_linkage']:.4g}",
        ]
        lines.append([*cells, stated, ", ".join(off)])
    return [f"| {' | '.join(line)} |" for line in lines]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("table", type=Path, nargs="?")
    parser.add_argument("--points", type=int, default=0)
    given = parser.parse_args()
    if given.points:
        solve_missing("lifted", POINTS, given.points)
    if given.table is not None:
        rewrite(DOCUMENT, {"lifted": "\n".join(comparison(given.table))})
