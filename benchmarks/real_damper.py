"""The magnetorheological damper on its shaking table: each coil voltage by itself, and all of them in one record."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from damper_law import DahlLaw, error_of, fitted_law, sliding_line
from judged import DATA, Judged, Value, estimated, words
from scipy.stats import t

from msl_fem.actuator import parse_actuator
from msl_fem.diagnosis import diagnose
from msl_fem.record import Noise, Record, Sampling, Tolerance
from msl_fem.record.columns import read_columns
from msl_fem.record.log_columns import column_sources
from msl_fem.record.log_import import RunLabel, imported_run
from msl_fem.record.rig_file import Scheduling

COIL = "coil_voltage_V"
DAMPER = {0.0: (0.80e3, 50.2), 0.8712: (1.31e3, 209.7), 1.98: (2.58e3, 380.6), 3.212: (5.36e3, 566.0)}
"""Coil voltage to k_x (N s/m) and k_w (N) of the authors' Dahl law."""
TRAVEL = {0.0: 1 / 42.7e3, 0.8712: 1 / 20.4e3, 1.98: 1 / 13.5e3, 3.212: 1 / 8.0e3}
"""Its 1/rho (m)."""


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


def bound(law: DahlLaw, own: Sequence[DahlLaw], name: str) -> str:
    """Why least squares over the whole loop give another number than the authors' line of the sliding branch."""
    each = [getattr(one, name) for one in own]
    return (
        "of the whole loop, not of the sliding branch: the authors' law fitted to the whole loops has "
        f"{getattr(law, name):.0f}, run by run {min(each):.0f} to {max(each):.0f}"
    )


def stated_ranges(voltage: float) -> dict[str, tuple[float, float]]:
    """The range of viscous and friction over the authors' ten runs."""
    rows = read_columns(DATA / "mr_damper" / "stated_law.csv")
    own = rows["coil_voltage_V"] == voltage
    names = {"viscous": "viscous_N_s_per_m", "friction": "friction_N"}
    return {key: (float(rows[name][own].min()), float(rows[name][own].max())) for key, name in names.items()}


def sliding_values(voltage: float) -> tuple[Value, Value]:
    """The line of the sliding branch, the mean over those of the authors' runs that are there, with its interval by
    their scatter."""
    index = read_columns(DATA / "mr_damper" / "index.csv")
    series = zip(index["file"], index["coil_voltage_V"], strict=True)
    lines = []
    for file in [str(f) for f, v in series if v == voltage and "vali" not in str(f)]:
        run = read_columns(DATA / "mr_damper" / file)
        lines.append(sliding_line(run["x_m"], run["force_N"], 0.01))
    mean, count = np.mean(lines, axis=0), len(lines)
    off = t.ppf(0.975, count - 1) * np.std(lines, axis=0, ddof=1) / np.sqrt(count)
    values = []
    for k, (name, unit) in enumerate((("viscous", "N s/m"), ("friction", "N"))):
        ends = (float(mean[k] - off[k]), float(mean[k] + off[k]))
        stated = stated_ranges(voltage)[name]
        known = DAMPER[voltage][k]
        values.append(Value(f"{name} of the sliding branch", unit, known, float(mean[k]), ends, stated=stated))
    return values[1], values[0]


def damper_at(voltage: float) -> Judged:
    viscous, friction = DAMPER[voltage]
    record = damper_record([voltage])
    found = diagnose(record)
    law, own = laws_of(record)
    forces = {c.effect: c.parameters["force"] for c in found.causes}
    told = {"friction": forces.get("coulomb_friction"), "viscous": found.parameters["damping"]}
    values = list(sliding_values(voltage))
    for name, unit, known in (("friction", "N", friction), ("viscous", "N s/m", viscous)):
        range_ = stated_ranges(voltage)[name]
        values.append(
            estimated(f"{name}, diagnosis", unit, known, told[name], why=bound(law, own, name), stated=range_)
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
    return Judged(f"MR damper, {voltage:g} V", known, words(found), means, tuple(values))


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
            why, range_ = bound(law, own, field), stated_ranges(voltage)[field]
            values.append(estimated(f"{of} at {voltage:g} V, diagnosis", unit, known, estimate, why=why, stated=range_))
    unseen = [run.name for run in record.runs if run.extra[COIL][0] == 2.178]
    means = (
        f"one record, the coil voltage a second input; held-out force errs by {held_out(found)}, at 2.178 V, which no "
        f"fitted run has, by {held_out(found, unseen)}"
    )
    known = "as above; at 2.178 V the authors' validation"
    return Judged("MR damper, all voltages", known, words(found), means, tuple(values))
