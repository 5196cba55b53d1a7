"""The table of a pair against independent fields: random points of the region that the pair's guard prefers.

Each point is solved anew at `fine`, on a mesh of the section at its own place. Run: python benchmarks/pair_table.py
[--points 200] [--seed 1] [--table FILE]. With --beside FILE no field is solved: how far that table is from the other
one, by region, and the limits of their maps.
"""

import argparse
from pathlib import Path

import numpy as np

from msl_fem.actuator import load_actuator
from msl_fem.magnetics.field.two_sided import TwoSidedField
from msl_fem.magnetics.field.two_sided_section import TwoSidedPosition
from msl_fem.maps.guard import REGIONS
from msl_fem.maps.pair_guard import PairGuard
from msl_fem.maps.pair_limits import RELATIONS, pair_map
from msl_fem.table.pair_table import PairTable, read_pair_table

ROOT = Path(__file__).parents[1]


BESIDE = 80_000


def beside(table: PairTable, other: PairTable, seed: int) -> None:
    """What differs between two tables, of the first one's largest force and flux linkage."""
    known = pair_map(table)
    guard, rng = PairGuard(known), np.random.default_rng(seed)
    x, i, j = rng.uniform([-0.5e-3, 0, -6], [0.5e-3, 6, 6], (BESIDE, 3)).T
    region, values, found = guard.regions(i, j, x), table.evaluate(x, i, j), other.evaluate(x, i, j)
    for k, name in enumerate(REGIONS):
        for relation, where in zip(RELATIONS, (j < 0, j > 0), strict=True):
            at = where & (region == k)
            off = [np.abs(values[q] - found[q])[at] / np.abs(table.nodes[q]).max() for q in ("force", "flux_linkage_1")]
            print(
                f"{name}, {relation}: {at.sum()} points, force {off[0].max():.1e} (median {np.median(off[0]):.1e}), "
                f"flux linkage {off[1].max():.1e}"
            )
    moved = pair_map(other).current - known.current
    share = np.abs(moved) / np.maximum(known.allowance, 1e-9)
    print(
        f"limits {moved.min():+.4f} to {moved.max():+.4f} A, rises up to {share[moved > 1e-3].max(initial=0):.2f} of ",
        end="",
    )
    print(f"their allowance; stated: mesh {other.mesh_error:.1e}, interpolation {other.interpolation_error:.1e}")


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--points", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--table", type=Path, default=ROOT / "lookup_tables/fast_tool_servo_pair.nc")
    parser.add_argument("--beside", type=Path)
    asked = parser.parse_args()
    if asked.beside is not None:
        return beside(read_pair_table(asked.table), read_pair_table(asked.beside), asked.seed)
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
