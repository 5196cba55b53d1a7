"""The diagnoses of the two real records: the tables of docs/real_records.md.

    python benchmarks/real_records.py [--docs]

EMPS as it stands. The levitation rig as it stands, and with the ramps of lift_off.csv as further rows of known force,
every second one held out.
"""

import argparse
import sys
from pathlib import Path

import numpy as np
from marked_text import rewrite

from msl_fem.diagnosis import DiagnosisSettings, diagnose
from msl_fem.diagnosis.driver import diagnosis_of
from msl_fem.diagnosis.equilibria import StaticEquilibria, map_with_equilibria, static_equilibria
from msl_fem.prediction import ModelHypothesis
from msl_fem.record import load_record
from msl_fem.table.magnetic_table import read_table

ROOT = Path(__file__).parent.parent
DOCUMENT = ROOT / "docs" / "real_records.md"
EMPS, RIG = ROOT / "measurements" / "emps", ROOT / "measurements" / "levitation_rig"
PUBLISHED = {"moving_mass": 95.1089, "damping": 203.5034, "coulomb_friction": 20.3935, "force_offset": 3.1648}
UNITS = {"moving_mass": "kg", "damping": "N s/m", "coulomb_friction": "N", "force_offset": "N"}


def rows_of(head, rows):
    return "\n".join(f"| {' | '.join(cells)} |" for cells in (head, ["---"] * len(head), *rows))


def followed(found):
    """The accuracy's rows: RMS error of the three models over the spread of what was measured, in per cent."""
    head = ["run", "role", "channel", "prediction", "as believed (%)", "re-fitted (%)", "with the effects (%)"]
    rows = []
    for one in found.accuracy:
        figures = [f"{100 * m.nrmse:.3g}" for m in (one.nominal, one.refitted, one.extended)]
        rows.append([one.nominal.run, one.nominal.role, one.nominal.channel, one.prediction, *figures])
    return rows_of(head, rows)


def emps():
    """(verdict, parameters, accuracy) of the EMPS."""
    found = diagnose(load_record(EMPS))
    estimates = {name: found.parameters[name] for name in ("moving_mass", "damping")}
    estimates |= {cause.effect: cause.parameters["force"] for cause in found.causes}
    rows = [
        [name, UNITS[name], f"{PUBLISHED[name]:.4g}", f"{e.value:.4g}", f"{e.low:.4g} ... {e.high:.4g}",
         f"{100 * (e.value / PUBLISHED[name] - 1):+.1f}"]
        for name, e in estimates.items()
    ]  # fmt: skip
    evidence = ", ".join(f"{c.effect} {c.statistic:.0f} ({c.gain:.0f} on the test record)" for c in found.causes)
    text = (
        f"Verdict: **{found.verdict}**. Nats of evidence: {evidence}. Left of the excess power: "
        f"{100 * found.unexplained.share:.1f} %."
    )
    if found.formula is not None:
        told = found.formula.to_json()
        text += (
            f" The last column of errors holds {told['equation']} = {told['law']} beside the effects, which is "
            f"{told['share']:.0%} of the rest ({told['held_out_share']:.0%} on the test record)."
        )
    head = ["parameter", "unit", "published", "fitted", "95 % interval", "off by (%)"]
    return text + "\n\n" + rows_of(head, rows) + "\n\n" + followed(found)


def with_lift_off(found, table):
    """The rests and the ramps, every second ramp held out."""
    rows = np.loadtxt(RIG / "lift_off.csv", delimiter=",", skiprows=1)
    gap, current, force = rows[(rows[:, 0] > table.gap[0]) & (rows[:, 0] < table.gap[-1])].T
    role = np.where(np.arange(gap.size) % 2 == 0, "fit", "held-out")
    pairs = ((found.gap, gap), (found.current, current), (found.force, force), (found.role, role))
    return StaticEquilibria(*(np.concatenate(pair) for pair in pairs))


def levitation():
    """What the rests say, and the rests with the ramps."""
    record, table = load_record(RIG), read_table(RIG / "table.nc")
    alone = diagnose(record, DiagnosisSettings(table=table))
    belief = ModelHypothesis(record.actuator, table)
    kind = map_with_equilibria(record, belief, with_lift_off(static_equilibria(record), table))
    both = diagnosis_of(kind, DiagnosisSettings(table=table))
    parts = []
    for title, found in (("The record's rests", alone), ("The rests and the ramps", both)):
        best = "; ".join(f"{name} {gain:.0f}" for name, gain in found.statistics[0])
        notes = "".join(f" {note[0].upper()}{note[1:]}." for note in found.notes)
        said = f"{title}: **{found.verdict}**. {found.reason[0].upper()}{found.reason[1:]}.{notes}"
        parts += [said, f"Nats of the best effects: {best}.", force_rows(found)]
    return "\n\n".join(parts)


def force_rows(found):
    """RMS error of the force at rest, mN."""
    head = ["role", "rows", "as believed (mN)", "re-fitted (mN)", "with the effects (mN)"]
    rows = []
    for one in found.accuracy:
        if one.nominal.channel == "force_N":
            figures = [f"{1e3 * m.rms:.3g}" for m in (one.nominal, one.refitted, one.extended)]
            rows.append([one.nominal.role, str(one.nominal.samples), *figures])
    return rows_of(head, rows)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--docs", action="store_true", help="write the tables into docs/real_records.md")
    given = parser.parse_args()
    tables = {"emps": emps(), "levitation": levitation()}
    sys.stdout.write("\n\n".join(tables.values()) + "\n")
    if given.docs:
        rewrite(DOCUMENT, tables)


if __name__ == "__main__":
    main()
