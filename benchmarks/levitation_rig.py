"""Levitation of the real rig: the current that holds the ball, from the measured flux linkage and as logged.

    python benchmarks/levitation_rig.py

Makes the tables of docs/levitation_rig.md anew. A rest is half a second in which the reference stands and the ball
moves by less than 60 um (one sigma).
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from marked_text import rewrite
from scipy.optimize import brentq

from msl_fem.record import Record, load_record
from msl_fem.table.magnetic_table import MagneticTable, read_table

ROOT = Path(__file__).parent.parent
RIG = ROOT / "measurements" / "levitation_rig"
DOCUMENT = ROOT / "docs" / "levitation_rig.md"
WINDOW, STILL = 1000, 60e-6  # samples, m


class Rest(NamedTuple):
    """Where the ball floats (m from the coil), and the current that holds it (A)."""

    gap: float
    current: float


def rests(record: Record, name: str) -> list[Rest]:
    """The rests of a run, in order of time."""
    run = next(r for r in record.runs if r.name == name)
    x, current, reference = run["position_m"], run["current_1_A"], run["reference_m"]
    motion = record.actuator.motion
    assert motion is not None
    assert motion.nominal_gap is not None
    found = []
    for start in range(0, x.size - WINDOW + 1, WINDOW):
        window, late = slice(start, start + WINDOW), slice(start + WINDOW // 2, start + WINDOW)
        if np.ptp(reference[window]) == 0 and x[late].std() < STILL:
            found.append(Rest(motion.nominal_gap - float(x[late].mean()), float(current[late].mean())))
    return found


def holding_current(table: MagneticTable, gap: float, weight: float, remanence: float = 0.0) -> float:
    """The current at which the table's force, plus `remanence` (N/A) times the current, bears the weight."""
    return float(
        brentq(lambda i: float(table.force(i, gap)) + remanence * i - weight, 0.02, table.current[-1], xtol=1e-9)
    )


def missing(table: MagneticTable, rest: Rest, weight: float) -> float:
    """Force that the table lacks at a rest, per ampere (N/A): the slope of a flux linkage without current."""
    return (weight - float(table.force(rest.current, rest.gap))) / rest.current


def remanence_law(table: MagneticTable, fitted: list[Rest], weight: float) -> tuple[float, float]:
    """(value at the gap 0 in N/A, length in m) of an exponential through the force that the table lacks."""
    slope, intercept = np.polyfit([r.gap for r in fitted], np.log([missing(table, r, weight) for r in fitted]), 1)
    return float(np.exp(intercept)), float(-1 / slope)


def table_of(head: list[str], rows: list[list[str]]) -> str:
    return "\n".join(f"| {' | '.join(cells)} |" for cells in (head, ["---:"] * len(head), *rows))


def levitation(record: Record, table: MagneticTable, weight: float) -> tuple[str, str]:
    """The table of all runs, and the sentence on the law of the missing force."""
    size, length = remanence_law(table, rests(record, "steps"), weight)
    rows, errors = [], []
    for run in record.runs:
        for rest in rests(record, run.name)[::2]:
            plain = holding_current(table, rest.gap, weight)
            more = holding_current(table, rest.gap, weight, size * float(np.exp(-rest.gap / length)))
            share = float(table.force(rest.current, rest.gap)) / weight
            off = [100 * (i / rest.current - 1) for i in (plain, more)]
            if run.role == "held-out":
                errors.append(off)
            figures = (f"{rest.gap * 1e3:.2f}", f"{rest.current:.3f}", f"{plain:.3f}", f"{off[0]:+.1f}")
            rows.append([run.name, run.role, *figures, f"{100 * share:.0f}", f"{more:.3f}", f"{off[1]:+.1f}"])
    head = ["run", "role", "z (mm)", "logged (A)", "flux table (A)", "error (%)", "force borne (%)"]
    head += ["with the law (A)", "error (%)"]
    rms = np.sqrt(np.mean(np.square(errors), axis=0))
    sentence = (
        f"The law fitted on `steps` is {size:.3f} N/A exp(-z/{length * 1e3:.1f} mm). On the held-out runs it takes the "
        f"error of the current from {rms[0]:.1f} % to {rms[1]:.1f} % (RMS)."
    )
    return table_of(head, rows), sentence


def lift_off(table: MagneticTable, weight: float) -> str:
    """The table of the ramps in which the ball left its platform."""
    rows = []
    for gap, current, _ in np.loadtxt(RIG / "lift_off.csv", delimiter=",", skiprows=1):
        if not table.gap[0] <= gap <= table.gap[-1]:
            continue
        plain = holding_current(table, gap, weight)
        lack = missing(table, Rest(gap, current), weight)
        rows.append(
            [f"{gap * 1e3:.2f}", f"{current:.3f}", f"{plain:.3f}", f"{100 * (plain / current - 1):+.0f}", f"{lack:.2f}"]
        )
    return table_of(["z (mm)", "lifted off at (A)", "flux table (A)", "error (%)", "missing (N/A)"], rows)


def main() -> None:
    record, table = load_record(RIG), read_table(RIG / "table.nc")
    motion = record.actuator.motion
    assert motion is not None
    weight = -motion.constant_force
    runs, sentence = levitation(record, table, weight)
    rewrite(DOCUMENT, {"runs": runs, "law": sentence, "lift-off": lift_off(table, weight)})
    print(runs, sentence, sep="\n\n")


if __name__ == "__main__":
    main()
