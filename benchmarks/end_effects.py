"""The size of the end effects over the reference actuator's map: the tables of docs/end_effects.md.

python benchmarks/end_effects.py
"""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
from marked_text import rewrite

from msl_fem.actuator import ECore, load_actuator
from msl_fem.magnetics.field.end_effects import (
    EndFactors,
    EndSection,
    EndTurns,
    FlushEdges,
    corner_excess,
    gap_edges,
    window_factor,
)
from msl_fem.magnetics.field.magnet_field import MagnetField, magnet_mesh
from msl_fem.magnetics.solver.strip import AirDepth
from msl_fem.magnetics.sweep.table_sweep import SweepSettings, sweep
from msl_fem.table.magnetic_table import MagneticTable

ROOT = Path(__file__).parent.parent
DOCUMENT = ROOT / "docs" / "end_effects.md"
DERIVED = (False, EndFactors())  # without, and as the formulas have it
GAPS = np.array([0.05, 0.1, 0.2, 0.4, 0.6, 0.8, 1.0, 1.2]) * 1e-3
CURRENTS = np.array([0.5, 1.0, 2.0, 4.0, 6.0, 8.0, 10.0, 12.0])
WHAT_IF = ((1.0, 0.6e-3), (6.0, 0.6e-3), (12.0, 0.6e-3), (12.0, 1.2e-3))
SECTION_GAPS = np.array([0.1, 0.3, 0.6, 1.2]) * 1e-3


def changes(plain: MagneticTable, corrected: MagneticTable, name: str) -> list[str]:
    """Rows of a table: change of a quantity in per cent, gap by current."""
    share = 100 * (corrected.nodes[name][:, 1:] / plain.nodes[name][:, 1:] - 1)
    return table(
        ["g (mm)", *(f"{i:g} A" for i in plain.current[1:])],
        [[f"{g * 1e3:.2f}", *(f"{value:+.1f}" for value in row)] for g, row in zip(plain.gap, share, strict=True)],
    )


def table(head: list[str], rows: list[list[str]]) -> list[str]:
    return [f"| {' | '.join(cells)} |" for cells in (head, ["---:"] * len(head), *rows)]


def end_turns(magnet: ECore, gap: float) -> EndTurns:
    """The coil in front of the centre leg's end, with its turns in units of the gap's magnetomotive force."""
    coil, ampere_turns = magnet.coil, 1 + magnet.centre_leg_width / 2 / magnet.outer_leg_width
    low, near = gap + coil.face_clearance, coil.leg_clearance
    return EndTurns((near, near + coil.width), (low, low + coil.height), -ampere_turns)


def sections(magnet: ECore) -> list[str]:
    """delta/g of the gap: closed form, and solved sections through the centre leg with its end turns and without."""
    reach = gap_edges(magnet.stack_ends).reach
    rows = []
    for gap in SECTION_GAPS:
        turns = end_turns(magnet, gap)
        blocks = [EndSection(gap, magnet.height, magnet.armature_thickness, t).excess() for t in (turns, None)]
        closed = corner_excess(2 * reach / gap)[0] / 2
        roters = 0.26 + math.log1p(2 * reach / gap) / math.pi
        k, slope, _ = gap_edges(magnet.stack_ends).factor(gap)
        rows.append(
            [
                f"{gap * 1e3:.1f}",
                *(f"{value:.2f}" for value in (closed, roters, *blocks)),
                f"{100 * (k - 1):.1f}",
                f"{100 * (k - gap * slope - 1):.1f}",
            ]
        )
    head = [
        "g (mm)",
        "closed form",
        "Roters",
        "centre leg, end turns",
        "outer leg, bare",
        "k - 1 (%)",
        "k - g k' - 1 (%)",
    ]
    return table(head, rows)


def what_if(magnet: ECore, folder: Path) -> list[str]:
    """Change of force / flux linkage in per cent against the plane section, by parts and with other fringes."""
    mesh = magnet_mesh(magnet, float(WHAT_IF[0][1]))
    plain, corrected = (MagnetField(magnet, mesh, folder=folder, order=2, end_effects=on) for on in DERIVED)
    at_gap = SECTION_GAPS[2]
    low_high = [
        EndSection(at_gap, magnet.height, magnet.armature_thickness, t).excess()
        for t in (end_turns(magnet, at_gap), None)
    ]
    strips = [FlushEdges(magnet.stack_depth, reach_of(delta, at_gap)) for delta in low_high]
    before = [numbers(plain, i, g) for i, g in WHAT_IF]
    as_it_is, full = [numbers(corrected, i, g) for i, g in WHAT_IF], corrected.model.air_depth
    rows = [("as corrected", as_it_is)]
    plain.model.air_depth = AirDepth(full.strip)  # the window's air stays as assembled
    rows.append(("gap alone", [numbers(plain, i, g) for i, g in WHAT_IF]))
    for name, edges in zip(("fringe of the centre leg's section", "of the bare outer leg's"), strips, strict=True):
        corrected.model.air_depth = replace(full, strip=edges.factor)
        rows.append((name, [numbers(corrected, i, g) for i, g in WHAT_IF]))
    return table(
        ["force / flux linkage (%) at", *(f"{i:g} A, {g * 1e3:g} mm" for i, g in WHAT_IF)],
        [
            [name, *(" / ".join(f"{100 * (x / y - 1):+.1f}" for x, y in zip(a, b, strict=True)) for a, b in pairs)]
            for name, pairs in ((name, zip(values, before, strict=True)) for name, values in rows)
        ],
    )


def numbers(field: MagnetField, current: float, gap: float) -> tuple[float, float]:
    found = field.quantities(field.solve(current, gap))
    return found.force, found.flux_linkage


def reach_of(delta: float, gap: float) -> float:
    """The height with which the closed form gives delta/gap."""
    q = math.sqrt(math.expm1(2 * math.pi * delta - 2 + math.log(4)))
    return gap / math.pi * (q - math.atan(q))


def main() -> None:
    actuator = load_actuator(ROOT / "geometries" / "fast_tool_servo.toml")
    magnet = actuator.magnet
    plain, corrected = (sweep(actuator, GAPS, CURRENTS, settings=SweepSettings(end_effects=on))[0] for on in DERIVED)
    parts = {
        "sections": sections(magnet),
        "force": changes(plain, corrected, "force"),
        "flux linkage": changes(plain, corrected, "flux_linkage"),
        "what if": what_if(magnet, actuator.folder),
    }
    for name, lines in parts.items():
        print(name, *lines, sep="\n")
    rewrite(DOCUMENT, {name: "\n".join(lines) for name, lines in parts.items()})
    ends = magnet.stack_ends
    print(f"window factor {window_factor(ends):.3f}, height that counts {gap_edges(ends).reach * 1e3:.2f} mm")


if __name__ == "__main__":
    main()
