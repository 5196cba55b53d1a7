"""The pot core in three dimensions beside its axisymmetric section: docs/three_dimensions.md.

python benchmarks/three_d_pot_core.py
"""

import time

from marked_text import rewrite
from three_d_ends import DOCUMENT, actuator

from msl_fem.magnetics.field.magnet_field import solve
from msl_fem.magnetics.three_d.magnet_point import solve_solid

POINTS = [(0.6e-3, 0.5), (0.6e-3, 1.5), (0.3e-3, 2.0)]


def table() -> list[str]:
    """What three dimensions differ by from the section at accuracy `fine`, with what they state."""
    head = [
        "g (mm)",
        "i (A)",
        "accuracy",
        "force",
        "flux linkage",
        "coenergy",
        "inductance",
        "stated: force, flux linkage",
    ]
    lines = [[*head, "unknowns", "CPU s"], ["---:"] * (len(head) + 2)]
    pot = actuator("pot_core_holding")
    for gap, current in POINTS:
        flat = solve(pot, current, gap, accuracy="fine").quantities
        for level in ("fast", "normal"):
            started = time.process_time()
            point, _, _ = solve_solid(pot, current, gap, accuracy=level)
            took = time.process_time() - started
            names = "force", "flux_linkage", "coenergy", "incremental_inductance"
            off = [100 * (getattr(point, name) / getattr(flat, name) - 1) for name in names]
            stated = f"{100 * point.force_error:.2f}, {100 * point.flux_error:.2f}"
            cells = [f"{1e3 * gap:g}", f"{current:g}", level, *(f"{value:+.2f}" for value in off), stated]
            lines.append([*cells, str(point.unknowns), f"{took:.0f}"])
    return [f"| {' | '.join(line)} |" for line in lines]


if __name__ == "__main__":
    rewrite(DOCUMENT, {"pot": "\n".join(table())})
