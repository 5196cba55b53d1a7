"""Pull-in of the Modelica Standard Library's solenoid: our axisymmetric table under our coupled model.

    python benchmarks/solenoid_pull_in.py

Makes the tables of docs/verification.md, section "Pull-in", anew. The reference (tests/reference/solenoid) is a dynamic
simulation on a table of finite-element solutions. The last rows of the first table ask how much more work would do:
the coenergy's change over the stroke is enlarged until the static work is that of the reference. The second table asks
for the steel: its curve is a formula, flat in permeability below the knee; that is enlarged there and the saturation
left as it is, on a coarser grid of gaps and currents.
"""

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from marked_text import rewrite
from numpy.typing import NDArray
from published_magnets import REFERENCE, solenoid

from msl_fem.actuator import parse_actuator
from msl_fem.magnetics.field.plunger import PlungerMagnet, plunger_table, solve_plunger
from msl_fem.materials.constants import MU_0
from msl_fem.materials.material import iron_from_points
from msl_fem.plant import Inputs, Options, simulate
from msl_fem.table.magnetic_table import MagneticTable

Array = NDArray[np.float64]
DOCUMENT = Path(__file__).parent.parent / "docs" / "verification.md"
GAPS = np.r_[
    0.2, 0.225, 0.25, 0.275, 0.3, 0.35, 0.4, 0.5, 0.6, 0.75, 1, 1.25, 1.5, 1.75, 2, 2.5, 3, 3.5, 4, 4.5, 5, 5.1
]
CURRENTS = np.r_[0.02, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.1, 1.25]
PASSED, FULL_CURRENT, START = 0.3e-3, 1.2, 5e-3  # m, A, m
SHARES = (0.0, 0.02, 0.032)
COARSE_GAPS = np.r_[0.2, 0.25, 0.3, 0.4, 0.6, 1, 1.5, 2, 3, 4, 5, 5.1]
COARSE_CURRENTS = np.r_[0.05, 0.2, 0.35, 0.5, 0.7, 0.9, 1.1, 1.25]
PERMEABLE = (1.0, 1.25, 1.4)
PLACES = (4.9e-3, 3.5e-3, 2.0e-3, 0.9e-3, 0.27e-3)  # m, of the reference's run
STATIC_PLACES = (5e-3, 3e-3, 1e-3, 0.25e-3)  # m, of its static table at 1.2 A
FLAT = 400.0  # relative permeability of the steel's formula below the knee
RIG = {
    "schema": 1,
    "name": "solenoid",
    "magnet": {"kind": "table", "table": "solenoid.nc"},
    "sides": {"count": 1, "magnets_per_side": 1},
    "motion": {"moving_mass": "26.0 g", "nominal_gap": "5 mm", "range": "4.78 mm"},
    "drive": {"kind": "voltage", "voltage_limit": "13 V", "coil_resistance": "10 ohm"},
}


class PullIn(NamedTuple):
    """Time (s), coil current (A) and air gap (m), until the armature is down."""

    time: Array
    current: Array
    gap: Array

    @property
    def passed(self) -> float:
        """When the gap first is 0.30 mm."""
        down = int(np.argmax(self.gap <= PASSED))
        return float(np.interp(-PASSED, -self.gap[: down + 1], self.time[: down + 1]))


def reference() -> PullIn:
    t, i, _, x = np.loadtxt(REFERENCE / "solenoid" / "fea_pullin_12V_10g.csv", delimiter=",").T
    kept = np.r_[True, np.diff(t) > 0]
    return PullIn(t[kept], i[kept], x[kept])


def pull_in(table: MagneticTable, *, rate: float = 1e5) -> PullIn:
    """12 V on the coil at rest, until the armature leaves its range."""
    inputs = Inputs(np.full((int(0.016 * rate), 1), 12.0), rate)
    run = simulate(parse_actuator(RIG), table, inputs, options=Options(partial=True, substeps=4))
    return PullIn(run.time, run.current[:, 0], START - run.position)


def with_more_work(table: MagneticTable, share: float) -> MagneticTable:
    """The table with the coenergy's change from 5 mm enlarged, and with it all its derivatives."""
    nodes = {}
    for name, values in table.nodes.items():
        far = values[-2] if name in ("coenergy", "flux_linkage", "incremental_inductance") else 0.0
        nodes[name] = values + share * (values - far)
    return MagneticTable(table.gap, table.current, nodes)


def more_permeable(magnet: PlungerMagnet, factor: float) -> PlungerMagnet:
    """The magnet with a steel that is `factor` times as permeable below the knee and saturates as before.

    H(B) loses a constant reluctivity, which is nothing beside that of a saturated steel.
    """
    iron = magnet.irons["plunger"]
    b, h = np.asarray(iron.flux_density), np.asarray(iron.field_strength)
    less = np.maximum.accumulate(h - (1 - 1 / factor) * b / (MU_0 * FLAT))
    steel = iron if factor == 1.0 else iron_from_points(b, less, name=iron.name, source=iron.source)
    return replace(magnet, irons=dict.fromkeys(magnet.irons, steel))


def differences(found: PullIn, wanted: PullIn) -> tuple[float, float, float]:
    """Of the time of 0.30 mm (relative), and the largest of current and gap up to then, of full scale."""
    until = found.time < min(found.passed, wanted.passed)
    t = found.time[until]
    current = np.abs(np.interp(t, wanted.time, wanted.current) - found.current[until]).max() / FULL_CURRENT
    gap = np.abs(np.interp(t, wanted.time, wanted.gap) - found.gap[until]).max() / START
    return found.passed / wanted.passed - 1, float(current), float(gap)


def steel_rows(wanted: PullIn) -> str:
    """The pull-in with steels of more permeability below the knee."""
    lines = ["| steel below its knee | 0.30 mm at (ms) | time (%) | current (% of 1.2 A) | gap (% of 5 mm) |"]
    lines.append("| :--- " + "| ---: " * 4 + "|")
    for factor in PERMEABLE:
        magnet = more_permeable(solenoid(), factor)
        found = pull_in(plunger_table(magnet, COARSE_GAPS * 1e-3, COARSE_CURRENTS))
        time, current, gap = differences(found, wanted)
        name = "as the formula has it" if factor == 1.0 else f"{100 * (factor - 1):.0f} % more permeable"
        lines.append(
            f"| {name} | {found.passed * 1e3:.2f} | {100 * time:+.2f} | {100 * current:.1f} | {100 * gap:.1f} |"
        )
    return "\n".join(lines)


def path_rows() -> str:
    """Flux linkage and force at the reference's own currents and gaps, by the formula's steel and another.

    The reference's flux linkage is the integral of 12 V less the resistance's drop.
    """
    t, i, force, x = np.loadtxt(REFERENCE / "solenoid" / "fea_pullin_12V_10g.csv", delimiter=",").T
    kept = np.r_[True, np.diff(t) > 0]
    t, i, force, x = t[kept], i[kept], np.abs(force[kept]), x[kept]
    flux = np.r_[0.0, np.cumsum((12.0 - 10.0 * (i[1:] + i[:-1]) / 2) * np.diff(t))]
    places = [int(np.argmax(x <= place)) for place in PLACES]
    points = [("run", i[k], x[k], flux[k], force[k]) for k in places]
    static = np.genfromtxt(REFERENCE / "solenoid" / "fea_quasistatic_12V.csv", delimiter=",")
    for place in STATIC_PLACES:
        row = static[np.argmin(np.abs(static[:, 0] - place))]
        points.append(("static", FULL_CURRENT, row[0], FULL_CURRENT * row[3], abs(row[1])))
    head = f"flux linkage, force (%) | {100 * (PERMEABLE[-1] - 1):.0f} % more permeable (%)"
    lines = [f"| reference | i (A) | x (mm) | {head} |", "| --- | ---: | ---: | ---: | ---: |"]
    for name, current, gap, linked, pull in points:
        cells = []
        for factor in (1.0, PERMEABLE[-1]):
            got = solve_plunger(more_permeable(solenoid(), factor), float(current), float(gap))
            cells.append(f"{100 * (got.flux_linkage / linked - 1):+.1f}, {100 * (abs(got.force) / pull - 1):+.1f}")
        lines.append(f"| {name} | {current:.3f} | {gap * 1e3:.2f} | {' | '.join(cells)} |")
    return "\n".join(lines)


def main() -> None:
    table, wanted = plunger_table(solenoid(), GAPS * 1e-3, CURRENTS), reference()
    lines = ["| table | 0.30 mm at (ms) | time (%) | current (% of 1.2 A) | gap (% of 5 mm) |"]
    lines.append("| :--- " + "| ---: " * 4 + "|")
    lines.append(f"| reference | {wanted.passed * 1e3:.2f} | | | |")
    for share in SHARES:
        found = pull_in(with_more_work(table, share))
        time, current, gap = differences(found, wanted)
        name = f"ours, {100 * share:.1f} % more work over the stroke" if share else "ours"
        figures = f"{found.passed * 1e3:.2f} | {100 * time:+.2f} | {100 * current:.1f} | {100 * gap:.1f}"
        lines.append(f"| {name} | {figures} |")
    for mark, content in (
        ("pull-in", "\n".join(lines)),
        ("pull-in path", path_rows()),
        ("pull-in steel", steel_rows(wanted)),
    ):
        print(content)
        rewrite(DOCUMENT, {mark: content})


if __name__ == "__main__":
    main()
