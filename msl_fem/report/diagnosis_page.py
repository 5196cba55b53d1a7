"""The report of a diagnosis: what, how sure, how much better and what to do next; below, what it rests on.

Its files appear in a folder all together, or not at all.
"""

import datetime
import json
import os
import platform
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path

import numpy as np

from msl_fem.actuator import Actuator, TableMagnet
from msl_fem.computing.arrays import Array
from msl_fem.diagnosis.kind import Size
from msl_fem.diagnosis.outside import Dependence
from msl_fem.diagnosis.result import ChannelResiduals, Diagnosis, Evidence, TriedVariant
from msl_fem.errors import InputError
from msl_fem.files.numbers import json_value
from msl_fem.files.quantity import format_quantity
from msl_fem.files.whole_file import cannot_be_written, staging_folder
from msl_fem.plant.effects import CATALOGUE, EffectValues, find_parameter
from msl_fem.plant.extended_model import ExtendedModel, write_extended_model
from msl_fem.prediction import ModelHypothesis
from msl_fem.prediction.hypothesis import unit_of_believed
from msl_fem.prediction.run_data import POSITION_COLUMN
from msl_fem.record import Record
from msl_fem.record.columns import name_and_unit
from msl_fem.report.belief_stage import belief_stage
from msl_fem.report.diagnosis_figures import (
    dependence_figure,
    gain_figure,
    over_frequency,
    over_time,
    over_variables,
    parameters_figure,
)
from msl_fem.report.diagnosis_words import (
    FAR,
    called,
    channel_name,
    estimate_text,
    far_out,
    floors,
    gain_sentence,
    headline_word,
    judged_runs,
    nats_text,
    next_steps,
    one_of,
    sure_rows,
    telling,
    verdict_sentence,
    what_is_left,
)
from msl_fem.report.page import Grid, Page, Stage, write_page
from msl_fem.report.played_motion import motion_of, motion_stage
from msl_fem.table.magnetic_table import MagneticTable
from msl_fem.table.pair_table import save_table

MOST_DEPENDENCES = 8
DIAGNOSIS, REPORT, MODEL, TABLE = "diagnosis.json", "report.html", "extended_model.toml", "corrected_table.nc"
FILES = (TABLE, MODEL, REPORT, DIAGNOSIS)
"""What may stand in the folder, in the order in which the files appear: what names a file comes after it."""


def write_diagnosis(record: Record, found: Diagnosis, folder: Path, *, table: MagneticTable | None) -> dict[str, Path]:
    """The files written, by name; those of an earlier diagnosis that this one does not have are removed.

    Parameters
    ----------
    table : the believed one, from which a corrected one is told

    Raises
    ------
    InputError : the folder cannot be written
    """
    target = folder.resolve()
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with staging_folder(target) as staging:
            _write_all(record, found, staging, table=table)
            return _moved(staging, target)
    except OSError as err:
        raise cannot_be_written(folder, err, "choose another folder") from err


def _write_all(record: Record, found: Diagnosis, folder: Path, *, table: MagneticTable | None) -> None:
    extended = found.extended if found.formula is None else found.formula.extended()
    if extended is not None:
        model = extended_model_of(extended, folder, believed=table)
        if extended.table is not None and extended.table is not table:
            save_table(extended.table, folder / TABLE)
        write_extended_model(model, folder / MODEL)
    write_page(diagnosis_page(record, found), folder / REPORT)
    text = json.dumps(json_value(found.to_json()), indent=1, allow_nan=False)
    (folder / DIAGNOSIS).write_text(f"{text}\n", encoding="utf-8")


def _moved(staging: Path, target: Path) -> dict[str, Path]:
    target.mkdir(exist_ok=True)
    for name in FILES:
        if (target / name).is_dir():
            raise InputError(f"{target / name}: is a folder; choose another one for the diagnosis")
    made = {}
    for name in FILES:
        if (staging / name).is_file():
            os.replace(staging / name, target / name)
            made[name] = target / name
        else:
            (target / name).unlink(missing_ok=True)
    return made


def extended_model_of(belief: ModelHypothesis, folder: Path, *, believed: MagneticTable | None) -> ExtendedModel:
    """The extended model as its file says it: magnets whose table was corrected are known by that table alone."""
    actuator = belief.actuator
    if belief.table is not None and belief.table is not believed:
        actuator = known_by_table(actuator, folder)
    return ExtendedModel(actuator, belief.effects or EffectValues())


def known_by_table(actuator: Actuator, folder: Path) -> Actuator:
    """The actuator with the table in a folder in place of its magnet's geometry; the winding's resistance is kept."""
    drive = actuator.drive
    if drive is not None:
        drive = drive.model_copy(update={"coil_resistance": actuator.coil_resistance()})
    sources = {key: text for key, text in actuator.sources.items() if not key.startswith("magnet")}
    sources["magnet"] = f"the table of {actuator.name}, corrected within its tolerance by the diagnosis of a record"
    magnet = TableMagnet(kind="table", table=TABLE)
    return actuator.model_copy(update={"magnet": magnet, "drive": drive, "sources": sources, "file": folder / MODEL})


def diagnosis_page(record: Record, found: Diagnosis) -> Page:
    """The report of a record's diagnosis."""
    stages = [_what(found), _how_sure(found)]
    if found.accuracy:
        stages.append(_how_much_better(found))
    stages.append(_what_next(found))
    if found.accuracy:
        stages.append(_accuracy(found))
    if found.evidence is not None:
        stages += _evidence(found, found.evidence)
    if found.parameters:
        stages.append(_parameters(found))
    values = {(c.effect, name): e.value for c in found.causes for name, e in c.parameters.items()}
    stages.append(belief_stage(found.belief, values))
    return Page(
        f"{record.actuator.name}: what the model gets wrong",
        verdict_sentence(found),
        _headline(found),
        tuple(stages),
        _provenance(record, found),
        (*record.warnings, *(note[:1].upper() + note[1:] for note in found.notes)),
    )


def _headline(found: Diagnosis) -> tuple[tuple[str, str], ...]:
    apart = any(cause.rivals for cause in found.causes)
    shown = [(headline_word(found), "not told apart by this record" if apart else "what was found")]
    if found.causes:
        shown.append((nats_text(found.causes[0].statistic), f"evidence; {found.threshold:.3g} are asked for"))
    if found.null.gains.size:
        shown.append((nats_text(found.null.quantile(0.99)), "what chance brings in 99 of 100 surrogates"))
    one = telling(found)
    if one is not None:
        nominal, refitted, extended = floors(one)
        steps = [nominal, refitted, extended] if found.causes else [nominal, refitted]
        label = "as believed → re-fitted → with what was found" if found.causes else "as believed → re-fitted"
        text = " → ".join(f"{value:.3g}" for value in steps)
        shown.append((text, f"times the noise: {label}, {channel_name(one.nominal.channel)} of {one.nominal.run}"))
    return tuple(shown)


def _what(found: Diagnosis) -> Stage:
    sizes = {} if found.evidence is None else {s.effect: s for s in found.evidence.sizes}
    rows = []
    for cause in found.causes:
        for n, (name, estimate) in enumerate(cause.parameters.items()):
            meaning = f"{name.replace('_', ' ')}: {find_parameter(cause.effect, name).meaning}"
            rows.append(
                (
                    one_of(cause) if n == 0 else "",
                    meaning,
                    estimate_text(cause.effect, name, estimate),
                    _size_text(sizes.get(cause.effect)) if n == 0 else "",
                )
            )
    table = Grid(("cause", "parameter", "value (95 % interval)", "size"), tuple(rows)) if rows else None
    means = tuple(
        (called(c.effect), f"{CATALOGUE[c.effect].sentence}: {CATALOGUE[c.effect].equation}") for c in found.causes
    )
    reason = found.reason[:1].upper() + found.reason[1:]
    sentence = f"{reason}." if found.verdict != "undecidable" else verdict_sentence(found)
    return Stage("What", f"{sentence} {what_is_left(found)}".strip(), means, table=table)


def _size_text(size: Size | None) -> str:
    if size is None:
        return "-"
    unit = name_and_unit(size.channel)[1]
    change = format_quantity(size.change, unit, digits=3)
    return f"{100 * size.share:.3g} % of {channel_name(size.channel)} ({change} RMS, {size.run})"


def _how_sure(found: Diagnosis) -> Stage:
    sentence = (
        "Evidence: the log of how much more probable the record is with the effect than without, tolerances counted "
        "(5 nats are 150 to 1). It is worth that only if the catalogue holds the cause; that what is left is noise, on "
        "runs too that no fit has seen, speaks for it."
    )
    return Stage("How sure", sentence, (), table=Grid(("", ""), sure_rows(found)))


def _how_much_better(found: Diagnosis) -> Stage:
    judged = judged_runs(found)
    sentence = f"{gain_sentence(found)} Drawn are RMS errors ({judged[0].prediction}) over the noise's sigma."
    return Stage("How much better", sentence, (), plot=gain_figure(judged, named=bool(found.causes)))


def _accuracy(found: Diagnosis) -> Stage:
    named = bool(found.causes)
    columns = ("run", "role", "channel", "noise", "as believed", "re-fitted", *(("with what was found",) * named))
    rows = []
    for one in found.accuracy:
        unit = name_and_unit(one.nominal.channel)[1]
        errors = [f"{value:.4g}" for value in floors(one)]
        rows.append(
            (
                one.nominal.run,
                one.nominal.role,
                channel_name(one.nominal.channel),
                format_quantity(one.nominal.floor, unit, digits=3),
                *(errors if named else errors[:2]),
            )
        )
    sentence = "RMS error of each model over the noise's sigma, all runs; inf: the model left its table or range."
    return Stage("Evidence: accuracy", sentence, (), table=Grid(columns, rows))


def _what_next(found: Diagnosis) -> Stage:
    steps = next_steps(found)
    sentence = "In the order in which it is worth doing." if steps else "Nothing."
    return Stage("What to do next", sentence, (), table=Grid(("", ""), steps) if steps else None)


def _evidence(found: Diagnosis, evidence: Evidence) -> list[Stage]:
    named = bool(found.causes)
    left = _shown(found, evidence)
    stages = []
    if left is not None:
        where = f"{channel_name(left.channel)} of run {left.run} ({left.role})"
        stages.append(
            Stage(
                "Evidence: over time",
                f"Residual of the {where}, drawn between its extremes; dashed: two sigma of the noise.",
                (),
                plot=over_time(left, named=named),
            )
        )
        positions = [r for r in evidence.residuals if (r.run, r.channel) == (left.run, POSITION_COLUMN)]
        stages += _motion(positions[0], evidence.variables[left.run]) if positions and named else []
        stages += [
            _over_frequency(one, evidence.noise.get(one.channel), named=named)
            for one in evidence.residuals
            if one.run == left.run
        ]
        stages.append(
            Stage(
                "Evidence: over position, velocity and current",
                f"RMS residual of the {where} in equally filled bins; what is noise lies level on the dashed line. "
                "The variables are measured and move together, so a slope here is a hint and no proof.",
                (),
                plot=over_variables(left, evidence.variables[left.run], named=named),
            )
        )
    if evidence.dependences:
        stages.insert(0, _dependences(evidence.dependences))
    return [*stages, _tried(evidence.tried)]


def _motion(left: ChannelResiduals, measured: Mapping[str, Array]) -> list[Stage]:
    """The motion of the believed model, or re-fitted where that leaves its range, and of the one with what was found;
    nothing where they cannot be drawn."""
    before = (("as believed", left.nominal), ("re-fitted within tolerances", left.refitted))
    follow = [one for one in before if np.isfinite(one[1]).all()]
    motion = motion_of(left, measured[POSITION_COLUMN], (*follow[:1], ("with what was found", left.extended)))
    return [] if motion is None else [motion_stage(left, motion)]


def _dependences(ranked: Sequence[Dependence]) -> Stage:
    best = ranked[0]
    rows = [(d.equation, d.variable, nats_text(d.gain), f"{100 * d.share:.3g} %") for d in ranked[:MOST_DEPENDENCES]]
    sentence = (
        "A free function of one variable, in one equation at a time, simulated through the model: how probable it "
        "makes the record, and how much of the excess power it explains. Drawn is the best one; whether it stands out "
        "is said above."
    )
    columns = ("in the equation of", "function of", "evidence", "explains")
    return Stage(
        "Evidence: what the rest depends on", sentence, (), plot=dependence_figure(best), table=Grid(columns, rows)
    )


def _shown(found: Diagnosis, evidence: Evidence) -> ChannelResiduals | None:
    one = telling(found)
    if one is None:
        return None
    chosen = [r for r in evidence.residuals if (r.run, r.channel) == (one.nominal.run, one.nominal.channel)]
    return chosen[0] if chosen else None


def _over_frequency(left: ChannelResiduals, noise: tuple[Array, Array] | None, *, named: bool) -> Stage:
    sentence = (
        f"Spectrum of the residual of the {channel_name(left.channel)} of run {left.run} ({left.role}). Dashed: the "
        "instrument's stated noise, were it white."
        + (
            " Dotted: the noise as fitted, in octaves, from the runs with the role fit, and of a zero that wanders its "
            "wander; a residual on the dotted line is no evidence of an effect, one that is above it is."
            if noise is not None
            else ""
        )
    )
    title = f"Evidence: {channel_name(left.channel)} over frequency"
    return Stage(title, sentence, (), plot=over_frequency(left, noise, named=named))


def _tried(tried: Sequence[TriedVariant]) -> Stage:
    best: dict[tuple[int, str], TriedVariant] = {}
    for one in tried:
        best.setdefault((one.stage, one.effect), one)
    rows = [
        (
            called(one.effect),
            one.variant.partition(" ")[2].strip("()"),
            str(one.stage),
            f"{one.linear:.4g}",
            "-" if one.refitted is None else f"{one.refitted:.4g}",
            "named" if one.taken else "",
        )
        for one in best.values()
    ]
    sentence = (
        "Every effect of the catalogue that this rig can have, in its best variant: log evidence in nats in the linear "
        "model, and with everything fitted anew where the linear figure was worth it. The second stage is beside the "
        "effect that the first one found, and so on. Below 0 an effect costs more than it explains."
    )
    columns = ("effect", "variant", "stage", "linear", "re-fitted", "")
    return Stage("Evidence: all effects", sentence, (), table=Grid(columns, rows))


def _parameters(found: Diagnosis) -> Stage:
    rows = [
        (
            called(name),
            _believed_text(name, e.believed),
            _believed_text(name, e.value),
            f"{_believed_text(name, e.low)} ... {_believed_text(name, e.high)}",
            "-" if e.tolerances is None else f"{e.tolerances:+.2f}",
        )
        for name, e in found.parameters.items()
    ]
    far = far_out(found)
    judged = (
        f"{' and '.join(called(name) for name, _ in far)} moved by more than {FAR:g} tolerances: look whether what is "
        "believed of it is right."
        if far
        else f"None moved by more than {FAR:g} tolerances."
    )
    beside = " together with what was found" if found.causes else ""
    sentence = (
        f"What was believed within a tolerance, and what the record makes of it{beside}. {judged} Mass, stiffness, gap "
        "and the scales of force and position act alike in such a record: their intervals rest on the tolerances "
        "stated."
    )
    columns = ("parameter", "believed", "fitted", "95 % interval", "tolerances")
    return Stage(
        "Believed parameters", sentence, (), plot=parameters_figure(found.parameters), table=Grid(columns, rows)
    )


def _believed_text(name: str, value: float | None) -> str:
    if value is None:
        return "-"
    return format_quantity(value, unit_of_believed(name), digits=5)


def _provenance(record: Record, found: Diagnosis) -> tuple[tuple[str, str], ...]:
    notes = [("threshold", f"{found.threshold:.3g} nats")] if found.threshold == found.threshold else []
    return (
        ("actuator", f"{record.actuator.name}, SHA-256 {record.actuator.digest[:16]}"),
        ("record", f"{record.origin}; " + ", ".join(f"{r.name} ({r.role})" for r in record.runs)),
        *notes,
        ("versions", f"msl_fem {version('msl-fem')}, Python {platform.python_version()}"),
        ("date", datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d %H:%M UTC")),
    )
