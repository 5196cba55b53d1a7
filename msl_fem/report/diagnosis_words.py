"""What a diagnosis says, in an engineer's words: what it is, how sure, how much better, what to do next."""

from collections.abc import Sequence

from msl_fem.diagnosis.estimates import Estimate, unit_of
from msl_fem.diagnosis.formula import Formula
from msl_fem.diagnosis.likelihood import NO_NOISE
from msl_fem.diagnosis.result import Accuracy, Cause, Diagnosis
from msl_fem.files.quantity import format_quantity
from msl_fem.plant.effects import CATALOGUE, find_parameter
from msl_fem.record.columns import name_and_unit

FAR = 4.0  # tolerances by which a believed parameter has to be off before it is called far out
LITTLE = 1.05  # times the error with the effects: re-fitting alone does as well


def amount_text(effect: str, name: str, value: float, *, digits: int = 3) -> str:
    """A parameter of an effect with its unit: with a prefix where it can bear one, pure numbers that are sizes in %."""
    unit, shape = unit_of(effect, name), find_parameter(effect, name).shape
    if not unit:
        return f"{value:.{digits}g}" if shape else f"{100 * value:.{digits}g} %"
    return format_quantity(value, unit, digits=digits)


def estimate_text(effect: str, name: str, found: Estimate) -> str:
    """A parameter with its 95 % interval."""
    low, high = sorted((found.low, found.high))
    return (
        f"{amount_text(effect, name, found.value)} ({amount_text(effect, name, low)} ... "
        f"{amount_text(effect, name, high)})"
    )


def nats_text(value: float, *, sign: bool = False) -> str:
    """Nats for people: three digits, large ones with their thousands apart."""
    mark = "+" if sign else ""
    if abs(value) >= 1000:
        return f"{value:{mark},.0f} nats".replace(",", "\u202f")
    return f"{value:{mark}.3g} nats"


def called(effect: str) -> str:
    return effect.replace("_", " ")


def headline_word(found: Diagnosis) -> str:
    """The verdict in a few words."""
    names = " and ".join(either(cause) for cause in found.causes)
    return {
        "nothing-found": "nothing found",
        "named": names,
        "named-and-unexplained": f"{names}, and more",
        "unexplained": "unexplained",
        "undecidable": "cannot be decided",
    }[found.verdict]


def verdict_sentence(found: Diagnosis) -> str:
    """What the record says of the model."""
    names = " and ".join(explained_name(c) for c in found.causes)
    share = f"{100 * found.unexplained.share:.3g} %"
    if found.verdict == "nothing-found":
        return (
            "No effect of the catalogue is needed: with its parameters inside their tolerances the model follows the "
            "record down to the noise."
        )
    if found.verdict == "named":
        return f"What the model misses is {names}. {_rests_on(found)}"
    if found.verdict == "named-and-unexplained":
        return (
            f"What the model misses is {names}, and something that no effect of the catalogue explains: {share} of the "
            "residual power is left."
        )
    if found.verdict == "unexplained":
        return (
            "The model misses something that no effect of the catalogue explains, so none is named. "
            f"Of the residual power of the re-fitted model {share} is without a name.{_main_cause(found)}"
        )
    return f"This record cannot decide: {found.reason}."


def either(cause: Cause) -> str:
    """The name, or all names that the record leaves: "time delay or amplifier bandwidth"."""
    return " or ".join(called(name) for name in (cause.effect, *cause.rivals))


def explained_name(cause: Cause) -> str:
    """The name with what it is; where the record leaves several, that it does."""
    if not cause.rivals:
        return f"{called(cause.effect)} ({CATALOGUE[cause.effect].sentence})"
    return f"{either(cause)}, which this record does not tell apart"


def _rests_on(found: Diagnosis) -> str:
    """What is left with the causes in the model, and what it is judged against."""
    several = any(cause.rivals for cause in found.causes)
    start = "With one of them in the model" if several else "With it in the model"
    if loud := [note.split(":")[0] for note in found.notes if note.endswith(NO_NOISE)]:
        where = " and ".join(dict.fromkeys(loud))
        return (
            f"{start} most of the error is gone; at some frequencies of {where} more is left than an instrument's "
            "noise can be, as the notes say."
        )
    return (
        f"{start} nothing is left that differs from the noise; how loud that is over frequency was estimated with the "
        "fit and is drawn below."
    )


def _main_cause(found: Diagnosis) -> str:
    """The effect that takes most of it, where there is one."""
    main = found.main_cause
    if main is None:
        return ""
    part = f"{100 * main.explained_power:.3g} % of the excess power"
    return f" Nearest to a main cause: {called(main.effect)}, {part}, and held-out runs do not speak against it."


def what_is_left(found: Diagnosis) -> str:
    """Where the unexplained rest stands and what it depends on; '' where nothing is left."""
    if "unexplained" not in found.verdict:
        return ""
    if found.formula is not None:
        return formula_sentence(found.formula)
    left = found.unexplained
    where = f"It stands in the {left.equation}" if left.equation else "The equation it stands in was not found"
    if left.depends_on:
        return f"{where} and depends on {' and '.join(left.depends_on)}."
    return f"{where}; no variable was found that it depends on."


def formula_sentence(formula: Formula) -> str:
    """The law that accounts for what is left, with its values, and how much of it."""
    values = []
    for name, one in formula.parameters.items():
        values.append(f"{name} = {one.value:.4g} ({one.low:.4g} to {one.high:.4g}) {formula.units[name]}".strip())
    equation = formula.equation.replace("_", " ")
    text = (
        f"A law accounts for {100 * formula.share:.3g} % of it, {100 * formula.held_out_share:.3g} % on held-out runs: "
        f"{equation} = {formula.law}, {', '.join(values)}."
    )
    if not formula.rivals:
        return text
    best = formula.rivals[0]
    return f"{text} The next one, {best.law}, is {formula.ahead:.3g} nats less probable."


def by_chance_text(found: Diagnosis) -> str:
    """What any effect brings by chance on this record."""
    if not found.null.gains.size:
        return "no surrogates were made"
    half, most = found.null.quantile(0.5), found.null.quantile(0.99)
    n = found.null.gains.size
    return f"{nats_text(half)} in half, {nats_text(most)} in 99 of 100 of {n} surrogates of this record without effects"


def sure_rows(found: Diagnosis) -> list[tuple[str, str]]:
    """How sure the verdict is, as (what, figure)."""
    rows = []
    for cause in found.causes:
        name = called(cause.effect)
        rows.append((name, f"{nats_text(cause.statistic)} more probable than without it"))
        gain = nats_text(cause.gain, sign=True)
        rows.append((f"{name}, on held-out runs", f"{gain} of log likelihood"))
        if cause.p_value is not None:
            share = f"{100 * cause.p_value:.2g} % of them, this record counted among them"
            rows.append((f"{name}, surrogates with as much", share))
        if cause.rivals:
            rows.append((f"{name}, not told apart from", ", ".join(called(other) for other in cause.rivals)))
    if found.threshold == found.threshold:
        rows.append(("threshold of the first effect", nats_text(found.threshold)))
    rows.append(("what chance alone brings", by_chance_text(found)))
    return rows


def judged_runs(found: Diagnosis) -> list[Accuracy]:
    """The held-out runs; the fitted ones, where none is held out."""
    return [a for a in found.accuracy if a.nominal.role == "held-out"] or list(found.accuracy)


def floors(one: Accuracy) -> tuple[float, float, float]:
    """RMS errors of the believed, the re-fitted and the extended model over the noise's sigma."""
    nominal, refitted, extended = (
        f.rms / f.floor if f.floor > 0 else float("inf") for f in (one.nominal, one.refitted, one.extended)
    )
    return nominal, refitted, extended


def telling(found: Diagnosis) -> Accuracy | None:
    """The channel of the held-out runs that the re-fitted model misses most, over its noise."""
    return max(judged_runs(found), key=lambda a: floors(a)[1], default=None)


def gain_sentence(found: Diagnosis) -> str:
    """How much better the model becomes, and by what."""
    one = telling(found)
    if one is None:
        return "Nothing was fitted."
    nominal, refitted, extended = floors(one)
    where = f"On the {channel_name(one.nominal.channel)} of {one.nominal.run}, {one.nominal.role}, "
    start = f"{where}the model as believed errs by {nominal:.3g} times the noise, re-fitted within its tolerances by "
    if not found.causes:
        return f"{start}{refitted:.3g} times; no effect is added."
    told = f"{start}{refitted:.3g} times, with what was found by {extended:.3g} times."
    if refitted <= LITTLE * extended:
        return f"{told} Re-fitting alone does as well on these runs: they show no gain by what was found."
    return f"{told} The first step is re-fitting alone and no merit of what was found; the second is."


def channel_name(column: str) -> str:
    """A column's name without its unit: "current_1_A" is "current 1"."""
    return name_and_unit(column)[0].replace("_", " ")


def next_steps(found: Diagnosis) -> list[tuple[str, str]]:
    """What to do, as (why, what)."""
    steps = [(f"to mend {called(c.effect)}", CATALOGUE[c.effect].advice) for c in found.causes if c.effect in CATALOGUE]
    steps += [
        (f"to tell {called(c.effect)} from {', '.join(called(r) for r in c.rivals)}", _separating(c))
        for c in found.causes
        if c.rivals
    ]
    if "unexplained" in found.verdict:
        steps.append(("to find what is left", f"{what_is_left(found)} {_looking(found)}"))
    if found.verdict == "undecidable":
        steps.append(("to get a verdict", "make the record again with what the sentence above asks for"))
    for name, e in far_out(found):
        steps.append(
            (f"{called(name)} is {e.tolerances:+.2g} of its tolerances off", "measure it, or state a wider tolerance")
        )
    if found.extended is not None:
        told = "give extended_model.toml to simulate, compare or control as an actuator"
        gain = found.parameters.get("position_gain")
        if gain is not None:
            told += "; the fitted gain of the position reading stands in it as position_sensor_nonlinearity.gain_error"
        steps.append((f"to use the {'better' if found.causes else 're-fitted'} model", told))
    return steps


def far_out(found: Diagnosis) -> list[tuple[str, Estimate]]:
    """Believed parameters far outside their tolerance."""
    return [(n, e) for n, e in found.parameters.items() if e.tolerances is not None and abs(e.tolerances) > FAR]


def _separating(cause: Cause) -> str:
    return cause.next_experiment or "no experiment of the menu was judged"


def _looking(found: Diagnosis) -> str:
    looking = "Look at the residuals below: over frequency for lines and resonances, over time for events and drift."
    asked = found.unexplained.next_experiment
    if not asked:
        return looking
    return f"Next run: {asked}." if found.unexplained.depends_on else f"{looking} Next run: {asked}."


def one_of(cause: Cause) -> str:
    """The name, or the set of names that the record leaves."""
    names: Sequence[str] = (cause.effect, *cause.rivals)
    return called(names[0]) if len(names) == 1 else f"one of {', '.join(called(n) for n in names)}"
