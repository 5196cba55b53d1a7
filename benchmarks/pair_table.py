"""The table of a pair against independent fields: random points of the region that the pair's guard prefers.

Each point is solved anew at `fine`, on a mesh of the section at its own place. Run: python benchmarks/pair_table.py
[--points 200] [--seed 1] [--table FILE].
"""

import argparse
from pathlib import Path

import numpy as np

from msl_fem.actuator import load_actuator
from msl_fem.magnetics.field.two_sided import TwoSidedField, TwoSidedPosition
from msl_fem.maps.pair_guard import PairGuard
from msl_fem.maps.pair_limits import RELATIONS, pair_map
from msl_fem.table.pair_table import read_pair_table

ROOT = Path(__file__).parents[1]


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--points", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--table", type=Path, default=ROOT / "lookup_tables/fast_tool_servo_pair.nc")
    asked = parser.parse_args()
    actuator = load_actuator(ROOT / "geometries/fast_tool_servo.toml")
    table = read_pair_table(asked.table)
    guard = PairGuard(pair_map(table))
    rng = np.random.default_rng(asked.seed)
    largest = np.abs(table.nodes["force"]).max()
    linkage = np.abs(table.nodes["flux_linkage_1"]).max()
    errors: dict[str, list[tuple[float, float]]] = {name: [] for name in RELATIONS}
    while sum(map(len, errors.values())) < asked.points:
        x, i, j = rng.uniform([-0.5e-3, 0, -6], [0.5e-3, 6, 6])
        if guard.judge(i, j, x).region != "preferred":
            continue
        field = TwoSidedField(actuator, TwoSidedPosition(6e-4 - x, 6e-4 + x), accuracy="fine")
        truth = field.solve(i, j)[0]
        found = table.evaluate(x, i, j)
        force = abs(float(found["force"]) - truth.net_force) / largest
        flux = abs(float(found["flux_linkage_1"]) - truth.flux_linkage_1) / linkage
        errors[RELATIONS[int(j > 0)]].append((force, flux))
    for name, found_errors in errors.items():
        force, flux = np.array(found_errors).T
        print(
            f"{name}: {force.size} points, force within {force.max():.1e} of the largest (median "
            f"{np.median(force):.1e}), flux linkage {flux.max():.1e}"
        )
    print(f"stated: mesh {table.mesh_error:.1e}, interpolation over the whole table {table.interpolation_error:.1e}")


if __name__ == "__main__":
    main()
