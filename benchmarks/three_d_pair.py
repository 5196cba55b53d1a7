"""Two magnets with their end turns on either side of one armature: docs/three_dimensions.md.

python benchmarks/three_d_pair.py --points 4    # solves four points that three_d_pair.csv lacks
python benchmarks/three_d_pair.py               # writes the tables of the page from that file
"""

import argparse
import csv
import time

from marked_text import rewrite
from three_d_ends import DOCUMENT, HERE, actuator

from msl_fem.magnetics.field.pair_field import PairField, PairQuantities, pair_magnet, pair_mesh
from msl_fem.magnetics.three_d.pair_point import solve_solid_pair

FILE = HERE / "three_d_pair.csv"
LINEAR = [
    ("e1", 0.6e-3, 0.6e-3, 1.0, -1.0),
    ("e1", 0.3e-3, 0.3e-3, 1.0, -1.0),
    ("e1", 1.0e-3, 1.0e-3, 1.0, -1.0),
    ("fast_tool_servo", 0.6e-3, 0.6e-3, 1.2, -1.2),
    ("deep", 0.6e-3, 0.6e-3, 1.0, -1.0),
    ("u_core_ui60", 1.0e-3, 1.0e-3, 1.0, -1.0),
]
FORCE = [
    ("e1", 0.4e-3, 0.8e-3, 3.0, -3.0),
    ("e1", 0.4e-3, 0.8e-3, 3.0, 3.0),
    ("e1", 0.4e-3, 0.8e-3, 6.0, -4.0),
    ("e1", 0.4e-3, 0.8e-3, 6.0, 4.0),
    ("e1", 0.4e-3, 0.8e-3, 1.0, -6.0),
]
NORMAL = ("e1",)
Row = dict[str, float]
Point = tuple[str, float, float, float, float]


def kept() -> dict[Point, Row]:
    """The points that the file has."""
    if not FILE.exists():
        return {}
    rows = list(csv.DictReader(FILE.open()))
    values = [{k: float(v) for k, v in row.items() if k != "magnet"} for row in rows]
    return {
        (row["magnet"], v["gap_1"], v["gap_2"], v["current_1"], v["current_2"]): v
        for row, v in zip(rows, values, strict=True)
    }


def solve(point: Point) -> None:
    """Appends a point to the file."""
    name, gap_1, gap_2, current_1, current_2 = point
    started = time.process_time()
    level = "normal" if name in NORMAL else "fast"
    found, _, _ = solve_solid_pair(actuator(name), (current_1, current_2), (gap_1, gap_2), accuracy=level)
    row = {
        "gap_1": gap_1, "gap_2": gap_2, "current_1": current_1, "current_2": current_2,
        "net_force": found.net_force, "flux_1": found.flux_linkage[0], "flux_2": found.flux_linkage[1],
        "inductance_1": found.incremental_inductance[0], "mutual": found.mutual_inductance,
        "net_force_error": found.net_force_error, "flux_error": found.flux_error, "mutual_error": found.mutual_error,
        "unknowns": found.unknowns, "cpu_seconds": time.process_time() - started,
    }  # fmt: skip
    new = not FILE.exists()
    with FILE.open("a", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        if new:
            writer.writerow(["magnet", *row])
        writer.writerow([name, *(f"{value:.9g}" for value in row.values())])
    told = f"{name}, {current_1:g} A and {current_2:g} A: {found.net_force:.5g} N, {row['cpu_seconds']:.0f} s"
    print(told, flush=True)


def plane(point: Point) -> PairQuantities:
    """The plane pair at a point."""
    name, gap_1, gap_2, *currents = point
    it, both = actuator(name), gap_1 + gap_2
    field = PairField(it, pair_mesh(pair_magnet(it), both / 2, "normal"), gap_sum=both, order=3)
    solution = field.solve((gap_2 - gap_1) / 2, *currents)
    return field.quantities(solution, (currents[0], currents[1]), field.by_currents(solution))


def mutual_table(known: dict[Point, Row]) -> list[str]:
    """Mutual inductance in three dimensions and in the plane."""
    head = ["magnet", "gap (mm)", "L (mH)", "M (mH)", "stated error (%)", "plane M (mH)", "over the plane's", "M/L (%)"]
    lines = [head, ["---", *["---:"] * 7]]
    for point in (p for p in LINEAR if p in known):
        row, flat = known[point], plane(point)
        mutual = 1e3 * row["mutual"]
        cells = [f"`{point[0]}`" if point[0] != "deep" else "E1 of 40 mm", f"{1e3 * point[1]:g}"]
        cells += [f"{1e3 * row['inductance_1']:.4g}", f"{mutual:.4g}", f"{100 * row['mutual_error']:.1f}"]
        cells += [f"{1e3 * flat.mutual_inductance:.4g}", f"{row['mutual'] / flat.mutual_inductance:.3f}"]
        lines.append([*cells, f"{100 * row['mutual'] / row['inductance_1']:.2f}"])
    return [f"| {' | '.join(line)} |" for line in lines]


def force_table(known: dict[Point, Row]) -> list[str]:
    """Net force and flux linkages, and what the plane pair differs by."""
    head = ["gaps (mm)", "currents (A)", "net force (N)", "flux linkages (mWb)", "stated errors (N, mWb)"]
    head += ["plane pair: force, flux linkages (%)"]
    lines = [head, ["---:"] * 6]
    for point in (p for p in FORCE if p in known):
        row, flat = known[point], plane(point)
        cells = [f"{1e3 * point[1]:g}, {1e3 * point[2]:g}", f"{point[3]:g}, {point[4]:g}", f"{row['net_force']:.5g}"]
        cells += [f"{1e3 * row['flux_1']:.4g}, {1e3 * row['flux_2']:.4g}"]
        cells += [f"{row['net_force_error']:.2g}, {1e3 * row['flux_error']:.2g}"]
        solid = (row[name] for name in ("net_force", "flux_1", "flux_2"))
        off = zip((flat.force, flat.flux_linkage_1, flat.flux_linkage_2), solid, strict=True)
        lines.append([*cells, ", ".join(f"{100 * (a / b - 1):+.1f}" for a, b in off)])
    return [f"| {' | '.join(line)} |" for line in lines]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--points", type=int, default=0)
    left = parser.parse_args().points
    if left:
        for point in [p for p in [*LINEAR, *FORCE] if p not in kept()][:left]:
            solve(point)
    else:
        known = kept()
        rewrite(DOCUMENT, {"pair": "\n".join(force_table(known)), "mutual": "\n".join(mutual_table(known))})
