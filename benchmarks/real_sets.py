"""All real sets converted, diagnosed and judged: the table of docs/real_records.md.

    python benchmarks/real_sets.py [--docs] [--again] [--sets a,b]        or: make real-records

Each set's row is kept in real_sets.json beside the working directory as soon as it is there, so that an interrupted run
goes on; --again begins anew. What is known of a set stands in its README or paper, and was not used by the diagnosis.
"""

import argparse
import json
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from damper_law import DahlLaw, error_of, fitted_law
from marked_text import rewrite
from scipy.linalg import expm

from msl_fem.actuator import parse_actuator
from msl_fem.diagnosis import DiagnosisSettings, diagnose
from msl_fem.diagnosis.impedances import diagnose_impedance
from msl_fem.diagnosis.static_maps import why_no_map
from msl_fem.errors import InputError
from msl_fem.files.whole_file import whole_file
from msl_fem.record import Noise, Record, Run, Sampling, StaticMap, Tolerance, load_record
from msl_fem.record.columns import read_columns
from msl_fem.record.file_doubts import doubts_of_file
from msl_fem.record.impedance import ImpedanceMap
from msl_fem.record.log_columns import column_sources
from msl_fem.record.log_import import RunLabel, imported_run
from msl_fem.record.loop_table import table_of_loops
from msl_fem.record.reader import check_run
from msl_fem.record.rig_file import Scheduling
from msl_fem.table.current_map import fit_current_map
from msl_fem.table.magnetic_table import read_table

ROOT = Path(__file__).parent.parent
DATA = ROOT / "measurements"
DOCUMENT = ROOT / "docs" / "real_records.md"
KEPT = Path("real_sets.json")
COIL_RESISTANCE = {240508: 65.8, 240509: 51.9}
"""Sheet to ohm, as the authors state."""
RING = {"count": 1, "magnets_per_side": 1}
COIL = "coil_voltage_V"
DAMPER = {0.0: (0.80e3, 50.2), 0.8712: (1.31e3, 209.7), 1.98: (2.58e3, 380.6), 3.212: (5.36e3, 566.0)}
"""Coil voltage to k_x (N s/m) and k_w (N) of the authors' Dahl law."""
TRAVEL = {0.0: 1 / 42.7e3, 0.8712: 1 / 20.4e3, 1.98: 1 / 13.5e3, 3.212: 1 / 8.0e3}
"""Its 1/rho (m)."""


@dataclass(frozen=True)
class Value:
    """A number that is known of a set, and found: "" as `interval` where none is stated, `why` where it lies outside of
    it and more than 10 % off."""

    of: str
    unit: str
    known: float
    found: float
    interval: tuple[float, float] | None = None
    why: str = ""
    allowed: float = 0.10

    @property
    def cells(self) -> list[str]:
        """Of the table of values."""
        if np.isnan(self.found):
            return [f"{self.of} ({self.unit})", f"{self.known:.4g}", "not named", "", "", f"no: {self.why}"]
        low, high = self.interval or (np.nan, np.nan)
        off = self.found / self.known - 1
        inside = "interval" if low <= self.known <= high else ("" if abs(off) > self.allowed else f"{self.allowed:.0%}")
        between = f"{low:.4g} to {high:.4g}" if self.interval else "none stated"
        return [
            f"{self.of} ({self.unit})", f"{self.known:.4g}", f"{self.found:.4g}", between, f"{100 * off:+.1f}",
            f"yes, {inside}" if inside else f"no: {self.why}",
        ]  # fmt: skip


@dataclass(frozen=True)
class Judged:
    """A row: what is known and how, the verdict, what it means beside what is known, and numbers beside known ones."""

    name: str
    known: str
    verdict: str
    meaning: str
    values: tuple[Value, ...] = ()


def estimated(of: str, unit: str, known: float, estimate, *, why: str = "") -> Value:
    """A known value beside an estimate with its interval, sizes of both; nothing found is not a number."""
    if estimate is None:
        return Value(of, unit, known, np.nan, None, why)
    ends = sorted((abs(estimate.low), abs(estimate.high)))
    return Value(of, unit, known, abs(estimate.value), (ends[0], ends[1]), why)


def words(found) -> str:
    """The verdict and the named effects."""
    return found.verdict + (f": {', '.join(cause.effect for cause in found.causes)}" if found.causes else "")


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
            if all(v.cells[-1] == "yes, interval" for v in values)
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


def damper_record(voltages: Sequence[float], unseen: Sequence[float] = ()) -> Record:
    """The runs at some coil voltages: the shaking table's motion and the damper's force; every second run is held out,
    and all of those at voltages that are `unseen`."""
    index = read_columns(DATA / "mr_damper" / "index.csv")
    motion = {"moving_mass": "10 kg", "damping": f"{DAMPER[voltages[-1]][0]} N s/m"}
    rig = {"schema": 1, "name": "mr_damper", "motion": motion, "drive": {"kind": "force"}}
    actuator = parse_actuator(rig)
    sources = column_sources("time_s=t_s,position_m=x_m,force_N=force_N")
    runs = []
    for voltage in (*voltages, *unseen):
        files = [str(f) for f, v in zip(index["file"], index["coil_voltage_V"], strict=True) if v == voltage]
        for k, file in enumerate(files):
            role = "held-out" if k % 2 or voltage in unseen else "fit"
            label = RunLabel(file.removesuffix(".csv"), "shaking table", role, mover="imposed")
            run = imported_run(DATA / "mr_damper" / file, sources, actuator, label=label).run
            runs.append(replace(run, extra={COIL: np.full(run.time.size, voltage)}))
    wide = Tolerance(moving_mass=0.9, damping=0.9)
    noise = Noise(position=5e-6 / np.sqrt(12))
    scheduling = (Scheduling(column=COIL, changes=("damping", "coulomb_friction.force")),) if voltages[1:] else ()
    return Record(
        "measured", actuator, sampling=Sampling(rate=100.0), noise=noise, tolerance=wide, runs=tuple(runs),
        scheduling=scheduling,
    )  # fmt: skip


def beside(found) -> str:
    """The formula that the errors of a diagnosis' extended model hold beside its effects."""
    if found.formula is None:
        return ""
    told = found.formula.to_json()
    return f" with {told['equation']} = {told['law']} beside, which is {told['held_out_share']:.0%} of the rest"


def held_out(found, runs: Sequence[str] = ()) -> str:
    """The range of the held-out errors, of all runs or some."""
    held = [e.extended.nrmse for e in found.accuracy if e.nominal.role == "held-out"]
    held = [e.extended.nrmse for e in found.accuracy if e.nominal.run in runs] if runs else held
    return f"{min(held):.0%} to {max(held):.0%}"


def damper() -> list[Judged]:
    """Each coil voltage by itself, and all of them in one record."""
    return [damper_at(voltage) for voltage in DAMPER] + [damper_over_voltages()]


def bound(run: DahlLaw, own: Sequence[DahlLaw], name: str) -> str:
    """What the authors' own law has where it is fitted to the same runs, and run by run."""
    each = [getattr(one, name) for one in own]
    return f"the law itself has {getattr(run, name):.0f}, run by run {min(each):.0f} to {max(each):.0f}"


def damper_at(voltage: float) -> Judged:
    viscous, friction = DAMPER[voltage]
    record = damper_record([voltage])
    found = diagnose(record)
    law, own = laws_of(record)
    forces = {c.effect: c.parameters["force"] for c in found.causes}
    values = (
        estimated("friction", "N", friction, forces.get("coulomb_friction"), why=bound(law, own, "friction")),
        estimated("viscous", "N s/m", viscous, found.parameters["damping"], why=bound(law, own, "viscous")),
    )
    nearest = next((note.split(";")[0] for note in found.notes if "nearest" in note), "")
    sizes = "; ".join(f"{name} {abs(force.value):.0f} N" for name, force in forces.items())
    every = [(run["position_m"], run["force_N"]) for run in record.runs]
    stated = error_of(every, 0.01, viscous=viscous, friction=friction, travel=TRAVEL[voltage])
    means = (
        f"{sizes or nearest}; held-out force errs by {held_out(found)}{beside(found)}; the authors' law errs by "
        f"{stated:.0%} with their values, by {fitted_law(every, 0.01).error:.0%} fitted to the same runs"
    )
    known = f"the authors' Dahl law: friction {friction:.0f} N, viscous {viscous:.0f} N s/m; offset 103 to 137 N"
    return Judged(f"MR damper, {voltage:g} V", known, words(found), means, values)


def laws_of(record: Record) -> tuple[DahlLaw, list[DahlLaw]]:
    """The authors' law fitted to the runs that are fitted, and to every run by itself."""
    pairs = {run.name: (run["position_m"], run["force_N"]) for run in record.runs}
    together = fitted_law([pairs[run.name] for run in record.runs_of("fit")], 0.01)
    return together, [fitted_law([pair], 0.01) for pair in pairs.values()]


def damper_over_voltages() -> Judged:
    """One record of four voltages, which change damping and friction; a fifth is held out."""
    record = damper_record(list(DAMPER), [2.178])
    found = diagnose(record)
    told = {one.parameter: one for one in found.scheduling}
    values = []
    for k, (voltage, (viscous, friction)) in enumerate(DAMPER.items()):
        law, own = laws_of(damper_record([voltage]))
        for of, unit, known, name, field in (
            ("friction", "N", friction, "coulomb_friction.force", "friction"),
            ("viscous", "N s/m", viscous, "damping", "viscous"),
        ):
            estimate = told[name].values[k] if name in told else None
            values.append(estimated(f"{of} at {voltage:g} V", unit, known, estimate, why=bound(law, own, field)))
    unseen = [run.name for run in record.runs if run.extra[COIL][0] == 2.178]
    means = (
        f"one record, the coil voltage a second input; held-out force errs by {held_out(found)}, at 2.178 V, which no "
        f"fitted run has, by {held_out(found, unseen)}"
    )
    known = "as above; at 2.178 V the authors' validation"
    return Judged("MR damper, all voltages", known, words(found), means, tuple(values))


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


def solenoids() -> list[Judged]:
    rows = []
    labels = ["solenoid", "f_pwm_Hz", "temperature_degC", "position_m", "t_on_s"]
    known = {
        "two_point_2024": "a block copied (CBS0730140, 25 degC, 3.5 and 4 mm): README",
        "two_point_2025": "2 and 3 ms exchanged in 52 blocks, positions reversed at 40 degC: README",
        "swing": "inductance and position looked up and clipped: README",
    }
    for name, said in known.items():
        doubts = doubts_of_file(DATA / "solenoid_stroke" / f"{name}.csv", [] if name == "swing" else labels)
        rows.append(Judged(f"solenoids, {name}", said, f"{len(doubts)} doubts", "; ".join(doubts)))
    return rows


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
        found = diagnose(record, DiagnosisSettings(table=table_of_loops(static)))
        main = found.main_cause
        means = (
            f"main cause {main.effect}: {main.explained_power:.0%} of the excess"
            if main
            else "no cause takes most of it"
        )
        rows.append(
            Judged(name.replace("_", " "), said, words(found), f"{means}; {found.notes[-1] if found.notes else ''}")
        )
    return rows


def impedance() -> list[Judged]:
    """LCR meter at four frequencies and six strokes; then the current after switch-on, which no fit has seen."""
    rows = read_columns(DATA / "solenoid_stroke" / "inductance_cbs0730.csv")
    names = ["L_100Hz_H", "L_1kHz_H", "L_10kHz_H", "L_100kHz_H"]
    stroke = np.repeat(rows["withdrawal_m"], 4)
    read = np.array([rows[name] for name in names]).T.ravel()
    found = diagnose_impedance(ImpedanceMap(stroke, np.tile([1e2, 1e3, 1e4, 1e5], 6), read))
    best = found.laws[0]
    worst = int(np.argmax(np.abs(best.error)))
    currents = switch_on_currents(best)
    gain = float(np.median([current.found / current.known for current in currents]))
    rest = max(abs(current.found / current.known / gain - 1) for current in currents)
    why = (
        f"one factor of {gain:.2f} stands in all {len(currents)} rows of eight set-ups and leaves {rest:.0%} at most: "
        "supply, amplifier, or a permeability above that at the meter's small current, which the files leave open"
    )
    out = [replace(current, why=why) for current in currents if current.of.endswith("out, 51.9 ohm")]
    inductance = Value("worst of 24 inductances", "mH", 1e3 * read[worst], 1e3 * read[worst] * (1 + best.error[worst]))
    means = (
        f"eddy_currents, {found.reason}; leakage {1e3 * best.leakage:.2f} mH, time constant "
        f"{1e3 * best.time_constant[0]:.2f} ms in to {1e3 * best.time_constant[-1]:.2f} ms out; the currents after "
        "switch-on were not fitted"
    )
    known = "eddy currents: L falls 15-fold from 0.1 to 100 kHz, its slope over stroke turns; no R-L fits"
    values = (replace(inductance, allowed=0.05), *out)
    return [Judged("solenoid, inductance over frequency", known, found.verdict, means, values)]


def switch_on_currents(law) -> list[Value]:
    """mA 50, 100 and 500 us after 12 V are switched on for 1 ms, measured and by a law, of all set-ups; the stroke is
    that of the nearest inductance at 1 kHz."""
    meter = read_columns(DATA / "solenoid_stroke" / "inductance_cbs0730.csv")
    rows = read_columns(DATA / "solenoid_stroke" / "switch_on_cbs0730.csv")
    found = []
    for k in np.flatnonzero(np.isclose(rows["t_on_s"], 1e-3)):
        place = int(np.argmin(np.abs(meter["L_1kHz_H"] - rows["L_1kHz_H"][k])))
        stroke = int(np.argmin(np.abs(law.stroke - meter["withdrawal_m"][place])))
        ohm = COIL_RESISTANCE[int(rows["sheet"][k])]
        where = "out" if str(rows["stroke_label"][k]) == "Neutral" else str(rows["stroke_label"][k])
        names = {50: "i_50us_A", 100: "i_100us_A", 500: "i_500us_A"}
        for (after, name), current in zip(names.items(), switched_on(law, stroke, ohm), strict=True):
            label = f"current after {after} us, {where}, {ohm:g} ohm"
            found.append(Value(label, "mA", 1e3 * float(rows[name][k]), 1e3 * current))
    return found


def switched_on(law, k: int, ohm: float) -> list[float]:
    """A 50, 100, 500 us after 12 V are switched on at stroke k, by the circuit of a shorted winding."""
    leak, main, tau = law.leakage, law.inductance[k], law.time_constant[k]
    loop = main / tau
    matrix = np.array(
        [[-(ohm + loop) / leak, loop / leak, 12.0 / leak], [loop / main, -loop / main, 0.0], [0.0, 0.0, 0.0]]
    )
    return [float((expm(matrix * t) @ [0.0, 0.0, 1.0])[0]) for t in (5e-5, 1e-4, 5e-4)]


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
