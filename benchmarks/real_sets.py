"""All real sets converted, diagnosed and judged: the table of docs/real_records.md.

    python benchmarks/real_sets.py [--docs] [--again] [--sets a,b]        or: make real-records

Each set's row is kept in real_sets.json beside the working directory as soon as it is there, so that an interrupted run
goes on; --again begins anew. What is known of a set stands in its README or paper, and was not used by the diagnosis.
"""

import argparse
import json
import sys
import time
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path

import numpy as np
from judged import DATA, Judged, Value, estimated, words
from marked_text import rewrite
from real_damper import damper
from real_solenoid import families, impedance, solenoids

from msl_fem.actuator import parse_actuator
from msl_fem.diagnosis import DiagnosisSettings, diagnose
from msl_fem.diagnosis.static_maps import why_no_map
from msl_fem.errors import InputError
from msl_fem.files.whole_file import whole_file
from msl_fem.record import Noise, Record, Run, Sampling, StaticMap, load_record
from msl_fem.record.columns import read_columns
from msl_fem.record.file_doubts import doubts_of_file
from msl_fem.record.log_columns import column_sources
from msl_fem.record.log_import import RunLabel, imported_run
from msl_fem.record.loop_law import HysteresisLoopLaw, loop_area
from msl_fem.record.loop_table import law_of_loops, table_of_loops
from msl_fem.record.reader import check_run
from msl_fem.table.current_map import fit_current_map
from msl_fem.table.magnetic_table import read_table

ROOT = Path(__file__).parent.parent
DOCUMENT = ROOT / "docs" / "real_records.md"
KEPT = Path("real_sets.json")
RING = {"count": 1, "magnets_per_side": 1}


def emps() -> list[Judged]:
    found = diagnose(load_record(DATA / "emps"))
    forces = {c.effect: c.parameters["force"] for c in found.causes}
    values = (
        estimated("friction", "N", 20.39, forces.get("coulomb_friction")),
        estimated("offset", "N", 3.165, forces.get("force_offset")),
        estimated("mass", "kg", 95.11, found.parameters["moving_mass"]),
        estimated("damping", "N s/m", 203.5, found.parameters["damping"]),
    )
    known = "friction and offset, by the authors' inverse dynamics"
    return [
        Judged(
            "EMPS drive",
            known,
            words(found),
            "all four within their intervals"
            if all(v.inside.startswith("interval") for v in values)
            else "see the values",
            values,
        )
    ]


def levitation_rig() -> list[Judged]:
    table = read_table(DATA / "levitation_rig" / "table.nc")
    found = diagnose(load_record(DATA / "levitation_rig"), DiagnosisSettings(table=table))
    known = "flux linkage does not predict the force that holds the ball, by the authors; why is open"
    return [
        Judged(
            "levitated ball, Milan",
            known,
            words(found),
            "no name is given for an open question; the record says what would decide",
        )
    ]


def slow_levitation() -> list[Judged]:
    rows = []
    actuator = parse_actuator(
        {"schema": 1, "name": "ball", "motion": {"moving_mass": "20 g"}, "drive": {"kind": "force"}}
    )
    sources = column_sources("time_s=t_s,position_m=position_signal_V:unit=mm,force_N=control_signal_V")
    for name in ("classic_pid", "proposed_pid"):
        file = DATA / "maglev_slow" / f"{name}.csv"
        try:
            run = imported_run(file, sources, actuator, label=RunLabel(name)).run
            verdict = refused_by_reader(run, actuator)
        except InputError as err:
            verdict = f"refused: {str(err).rpartition(str(file))[2].lstrip(': ')}"
        doubts = doubts_of_file(file, ["t_s"], ordered=True)
        known = (
            "too slow, quantised" + (", control a copy of the position" if name == "classic_pid" else "") + ": README"
        )
        rows.append(Judged(f"slow levitation, {name}", known, verdict, "; ".join(doubts)))
    return rows


def refused_by_reader(run: Run, actuator) -> str:
    """What the reader of records refuses a run for; that it does not, where it takes it."""
    try:
        check_run(run, actuator, Sampling(rate=50.0), file=run.file)
    except InputError as err:
        return f"refused: {err}"
    return "taken"


def loops() -> list[Judged]:
    """B over H as flux linkage over the current of one turn on a ring of 1 m and 1 m^2; the second loop is held out."""
    known = {
        "loops_m130_27s": "hysteresis: coercivity 7.0, 10.1, 13.0 A/m over three amplitudes",
        "loops_mnzn_a": "hysteresis: 0.8, 2.4, 4.3, 5.0 A/m",
        "loops_mnzn_b": "hysteresis: 2.5, 6.8, 11.7 A/m",
        "loops_mnzn_hp": "hysteresis: 0.35, 0.83, 2.9, 5.6 A/m",
        "loop_amorphous": "hardly any: 1 A/m of 800",
    }
    rows = []
    ring = {"schema": 1, "name": "ring", "magnet": {"kind": "table", "table": "none.nc"}, "sides": RING}
    for name, said in known.items():
        columns = read_columns(DATA / "bh_loops" / f"{name}.csv")
        field, flux, loop = (columns[key] for key in ("H_A_per_m", "B_T", "loop"))
        scale = float(np.abs(field).max())  # the current in units of the largest field
        held = loop == 2 if loop.max() > 1 else np.arange(loop.size) % 2 == 1
        role = np.where(held, "held-out", "fit")
        static = StaticMap(np.full(loop.size, 1e-3), field / scale, None, flux, role, sequence=loop)
        noise = Noise(flux_linkage=2e-3 * float(np.abs(flux).max()))
        record = Record("measured", parse_actuator(ring), noise=noise, static=static)
        law = law_of_loops(static)
        found = diagnose(record, DiagnosisSettings(table=table_of_loops(static, law)))
        main = found.main_cause
        means = (
            f"main cause {main.effect}: {main.explained_power:.1%} of the excess"
            if main
            else "no cause takes most of it"
        )
        parts = [means, held_law(law, static), *found.notes[-1:]]
        rows.append(Judged(name.replace("_", " "), said, words(found), "; ".join(parts)))
    return rows


def held_law(law: HysteresisLoopLaw, static: StaticMap) -> str:
    """How the law of the fitted loops holds on those and on the one held out."""
    held = static.rows("held-out")
    field, flux = static.current[held], static.flux_linkage[held]
    missed = law.current(flux) - field
    sequence, energy = (
        ", ".join(f"{100 * e:.2g}" for e in errors) for errors in (law.sequence_error, law.energy_error)
    )
    own = loop_area(law.current(flux), flux) / loop_area(field, flux) - 1.0
    return (
        f"a law of {law.n_parameter} numbers misses the field by {sequence} % of its RMS and the loop's energy by "
        f"{energy} %; held out {100 * np.linalg.norm(missed) / np.linalg.norm(field):.2g} % and {100 * own:.2g} %"
    )


def two_currents() -> list[Judged]:
    rows = read_columns(DATA / "pmsyrm_flux_map" / "flux_map_400rpm.csv")
    d, q = np.unique(rows["i_d_A"]), np.unique(rows["i_q_A"])
    fluxes = [rows[name].reshape(d.size, q.size) for name in ("psi_d_Vs", "psi_q_Vs")]
    fitted = fit_current_map(d, q, *fluxes)
    left = [1e3 * float(np.sqrt(np.mean(v**2))) for v in (fitted.residual_1, fitted.residual_2)]
    known = "reciprocity defect 5.0 to 5.1 % (2.6 % on the coarser cells): README"
    verdict = f"one coenergy, defect {fitted.defect:.1%} ({fitted.defect_coarse:.1%} coarse)"
    means = (
        f"fit leaves {left[0]:.2f} and {left[1]:.2f} mWb of 0.9 and 1.3 Wb; {fitted.notes[0] if fitted.notes else ''}"
    )
    values = (
        Value("reciprocity defect, 2 A cells", "%", 5.05, 100 * fitted.defect),
        Value("reciprocity defect, 4 A cells", "%", 2.6, 100 * fitted.defect_coarse),
    )
    return [Judged("two-current map", known, verdict, means, values)]


def at_one_current() -> list[Judged]:
    """Maps over the gap at one current: nothing can be diagnosed from them, and that has to be said."""
    rows = []
    for name, file, known in (
        (
            "Roters' plunger",
            "roters/measured_force.csv",
            "our section's force errs by +18 to -9 %: docs/verification.md",
        ),
        (
            "solenoid of the Modelica library",
            "solenoid/fea_quasistatic_12V.csv",
            "force within 5 %, flux 1.1 %: docs/verification.md",
        ),
    ):
        values = np.loadtxt(ROOT / "tests" / "reference" / file, delimiter=",", comments="#")
        rows.append(
            Judged(
                name,
                known,
                refusal_of_one_current(values),
                "a comparison of two computations or with a curve, no record of causes",
            )
        )
    return rows


def refusal_of_one_current(values) -> str:

    role = np.where(np.arange(len(values)) % 4 == 1, "held-out", "fit")
    static = StaticMap(np.abs(values[:, 0]) + 1e-4, np.full(len(values), 1.2), values[:, 1], None, role)
    return f"undecidable: {why_no_map(static)}"


SETS: dict[str, Callable[[], list[Judged]]] = {
    "emps": emps,
    "levitation_rig": levitation_rig,
    "mr_damper": damper,
    "maglev_slow": slow_levitation,
    "solenoid_stroke": solenoids,
    "impedance": impedance,
    "families": families,
    "bh_loops": loops,
    "pmsyrm_flux_map": two_currents,
    "one_current": at_one_current,
}


def judged_sets(kept: Path, names: list[str]) -> dict[str, dict]:
    """Rows and seconds of all sets that are kept, after those named were judged that are not."""
    for n, name in enumerate(names):
        if name in kept_rows(kept):
            continue
        sys.stderr.write(f"{n + 1} of {len(names)}: {name}\n")
        begin = time.process_time()
        rows = [asdict(row) for row in SETS[name]()]
        done = kept_rows(kept) | {name: {"rows": rows, "seconds": time.process_time() - begin}}
        with whole_file(kept) as partial:
            partial.write_text(json.dumps(done, indent=1))
    done = kept_rows(kept)
    return {name: done[name] for name in SETS if name in done}


def kept_rows(kept: Path) -> dict[str, dict]:
    return dict(json.loads(kept.read_text())) if kept.exists() else {}


def markdown(done: dict[str, dict]) -> str:
    lines = ["| set | known, and how | verdict | what it means | CPU s |", "| --- | --- | --- | --- | ---: |"]
    for entry in done.values():
        each = entry["seconds"] / len(entry["rows"])
        for row in entry["rows"]:
            cells = [row[key].replace("|", "/") for key in ("name", "known", "verdict", "meaning")]
            lines.append(f"| {' | '.join(cells)} | {each:.1f} |")
    return "\n".join(lines) + "\n"


def markdown_of_values(done: dict[str, dict]) -> str:
    lines = ["| set | value | known | found | 95 % interval | off by (%) | in the interval, or 10 % (inductance 5 %) |"]
    lines += ["| --- | --- | ---: | ---: | --- | ---: | --- |"]
    for entry in done.values():
        for row in entry["rows"]:
            for value in row.get("values", ()):
                lines.append(f"| {row['name']} | {' | '.join(Value(**value).cells)} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--docs", action="store_true", help="write the table into docs/real_records.md")
    parser.add_argument("--again", action="store_true", help="judge all sets anew")
    parser.add_argument("--sets", default=",".join(SETS), help=f"some of {', '.join(SETS)}")
    given = parser.parse_args()
    if given.again:
        KEPT.unlink(missing_ok=True)
    done = judged_sets(KEPT, given.sets.split(","))
    text, values = markdown(done), markdown_of_values(done)
    sys.stdout.write(f"{text}\n{values}")
    if given.docs:
        rewrite(DOCUMENT, {"sets": text, "values": values})


if __name__ == "__main__":
    main()
