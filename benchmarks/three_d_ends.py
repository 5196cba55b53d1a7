"""E1 and the servo with their end turns in three dimensions, and plane sections beside: docs/three_dimensions.md.

    python benchmarks/three_d_ends.py --points 4    # solves four points that the files three_d_*.csv lack
    python benchmarks/three_d_ends.py               # writes the tables of the page from those files

Each point is kept as soon as it is there, so that an interrupted run goes on where it was.
"""

import argparse
import csv
import time
from pathlib import Path

import numpy as np
from marked_text import rewrite

from msl_fem.actuator import Actuator, load_actuator
from msl_fem.magnetics.field.end_effects import EndFactors
from msl_fem.magnetics.sweep.solid_lift import SectionPoints, SolidRow, fit_factors
from msl_fem.magnetics.three_d.magnet_point import solve_solid

HERE = Path(__file__).parent
DOCUMENT = HERE.parent / "docs" / "three_dimensions.md"
NOTHING = EndFactors(gap=0.0, window=0.0)
COLUMNS = (
    "gap", "current", "force", "force_stress", "flux_linkage", "coenergy", "incremental_inductance",
    "force_current_slope", "force_error", "flux_error", "unknowns", "newton_iterations",
)  # fmt: skip
GRID = [(gap, current) for current in (8.0, 4.0, 2.0, 1.0) for gap in (0.6e-3, 0.3e-3, 1.0e-3)]
BETWEEN = [(gap, current) for current in (6.0, 3.0, 1.5) for gap in (0.45e-3, 0.8e-3)]
OTHERS = {
    "fast_tool_servo": [(0.8e-3, 2.0), (0.8e-3, 8.0), (0.4e-3, 5.0)],
    "deep": [(0.8e-3, 2.0), (0.8e-3, 8.0), (0.4e-3, 5.0)],
    "u_core_ui60": [(1.5e-3, 2.0), (1.0e-3, 5.0), (0.5e-3, 2.0)],
}
LIMIT = 0.01  # of the stated error at a point of E1; beyond it the point is solved at accuracy `fine`
DEEP = {"stack_depth": 40e-3, "armature_overhang": 3e-3, "window_width": 14e-3, "window_height": 30e-3}
Rows = list[dict[str, float]]


def kept(file: Path) -> Rows:
    """The points that a file has."""
    if not file.exists():
        return []
    return [{k: float(v) for k, v in row.items()} for row in csv.DictReader(file.open())]


def actuator(name: str) -> Actuator:
    """An actuator of geometries/; "lifted" is the servo, "deep" E1 with another stack, window and armature."""
    if name != "deep":
        file = "fast_tool_servo" if name == "lifted" else name
        return load_actuator(HERE.parent / "geometries" / f"{file}.toml")
    e1 = load_actuator(HERE.parent / "geometries" / "e1.toml")
    stated = e1.magnet_kind().model_dump() | DEEP
    return e1.model_copy(update={"name": "deep", "magnet": type(e1.magnet_kind()).model_validate(stated)})


def solve_missing(name: str, points: list[tuple[float, float]], most: int) -> int:
    """Solves as many points as are missing, at most `most`, appends each to the file and returns how many."""
    file = HERE / f"three_d_{name}.csv"
    known = {(row["gap"], row["current"]) for row in kept(file)}
    missing = [point for point in points if point not in known][:most]
    for gap, current in missing:
        started = time.process_time()
        point, _, _ = solve_solid(actuator(name), current, gap, accuracy="fast" if name in OTHERS else "normal")
        if name not in OTHERS and max(point.force_error, point.flux_error) > LIMIT:
            point, _, _ = solve_solid(actuator(name), current, gap, accuracy="fine")
        row = {column: getattr(point, column) for column in COLUMNS} | {"cpu_seconds": time.process_time() - started}
        new = not file.exists()
        with file.open("a", newline="") as stream:
            writer = csv.DictWriter(stream, row, lineterminator="\n")
            if new:
                writer.writeheader()
            writer.writerow({k: f"{v:.9g}" for k, v in row.items()})
        print(f"{name}, {current:g} A, {gap * 1e3:g} mm: {point.force:.5g} N, {row['cpu_seconds']:.0f} s", flush=True)
    return len(missing)


def fitted(name: str, rows: Rows) -> EndFactors:
    """The factors by the points of the grid."""
    points = SectionPoints(actuator(name), [SolidRow(r["gap"], r["current"]) for r in rows], "fast")
    return fit_factors(points, *(np.array([row[k] for row in rows]) for k in ("force", "flux_linkage")))


def comparison(name: str, rows: Rows, by: list[EndFactors]) -> list[str]:
    """A table: each point in three dimensions with its stated errors, and what plane sections differ by, in %."""
    rows = sorted(rows, key=lambda row: (row["gap"], row["current"]))
    points = SectionPoints(actuator(name), [SolidRow(r["gap"], r["current"]) for r in rows], "normal")
    truth = np.array([(row["force"], row["flux_linkage"]) for row in rows])
    off = [100 * (points(factors) / truth - 1) for factors in by]
    head = [
        "g (mm)",
        "i (A)",
        "force (N)",
        "flux linkage (mWb)",
        "stated errors (%)",
        "plane",
        "as derived",
        "factors of E1",
    ]
    lines = [head[: 5 + len(by)], ["---:"] * (5 + len(by))]
    for k, row in enumerate(rows):
        cells = [f"{row['gap'] * 1e3:g}", f"{row['current']:g}", f"{row['force']:.5g}"]
        cells += [f"{1e3 * row['flux_linkage']:.4g}"]
        cells += [f"{100 * row['force_error']:.2f}, {100 * row['flux_error']:.2f}"]
        lines.append([*cells, *(f"{table[k, 0]:+.1f}, {table[k, 1]:+.1f}" for table in off)])
    return [f"| {' | '.join(line)} |" for line in lines]


def write_page() -> None:
    """The tables of the page."""
    e1 = kept(HERE / "three_d_e1.csv")
    grid = [row for row in e1 if (row["gap"], row["current"]) in GRID]
    between = [row for row in e1 if (row["gap"], row["current"]) in BETWEEN]
    factors = fitted("e1", grid)
    by = [NOTHING, EndFactors(), factors]
    text = (
        f"gap {factors.gap:.3f}, window {factors.window:.3f}, outer air {factors.outer:.3f}, leakage of the end turns "
        f"{1e3 * factors.leakage:.3f} mH"
    )
    tables = {"fitted": comparison("e1", grid, by)}
    if between:
        tables["judged"] = comparison("e1", between, by)
    tables |= {name: comparison(name, kept(HERE / f"three_d_{name}.csv"), by) for name in OTHERS}
    rewrite(DOCUMENT, {"factors": text} | {name: "\n".join(lines) for name, lines in tables.items()})


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--points", type=int, default=0)
    left = parser.parse_args().points
    if left:
        for name in OTHERS:
            left -= solve_missing(name, OTHERS[name], left)
        solve_missing("e1", [*GRID, *BETWEEN], left)
    else:
        write_page()
