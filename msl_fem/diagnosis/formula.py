"""A formula for what no effect of the catalogue accounts for, a law as users state it, with what held-out runs say."""

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from msl_fem.computing.laws import LawExpression, expression
from msl_fem.diagnosis.decision import WORSE, excess_power
from msl_fem.diagnosis.estimates import Estimate, effect_estimates
from msl_fem.diagnosis.formula_search import EXPLAINED, LEAST, ChosenTerms, chosen_terms
from msl_fem.diagnosis.kind import ErrorSignal, Kind, held_out_gains, held_out_worse
from msl_fem.diagnosis.likelihood import Fit, white
from msl_fem.diagnosis.refits import Refit
from msl_fem.plant.effects import EffectValues, declare, declared
from msl_fem.plant.effects.expressions import DECLARED
from msl_fem.prediction import ModelHypothesis

RIVALS = 3  # other formulas that are told beside the best
NAME = "formula"
_AMOUNTS, _SHAPES = "abc", "wpq"


@dataclass(frozen=True)
class RivalFormula:
    """Another law of one term: its text, nats of evidence over none, and the share of the excess power it takes."""

    equation: str
    law: str
    gain: float
    share: float


@dataclass(frozen=True, eq=False)
class Formula:
    """What accounts for what is left, as a law.

    Attributes
    ----------
    equation, law : as users state them
    parameters : of the law, with 95 % intervals; `units` of them
    gain, p_value : nats of log evidence over the fit without it, and how often surrogates bring as much with any term
    share, held_out_share : of the excess power over the noise that it takes, of fitted and of held-out runs
    rivals : other laws of one term fitted anew, the most probable first
    ahead : nats by which the first term is more probable than the best of them; 0 without any
    alone : it takes the place of all named effects
    expression : the law with its values
    beside : the model fitted with it, without it
    errors : what the model with it misses on all runs
    """

    equation: str
    law: str
    parameters: Mapping[str, Estimate]
    units: Mapping[str, str]
    gain: float
    p_value: float
    share: float
    held_out_share: float
    rivals: tuple[RivalFormula, ...]
    ahead: float
    alone: bool
    expression: LawExpression
    beside: ModelHypothesis
    errors: tuple[ErrorSignal, ...]

    def to_json(self) -> dict[str, Any]:
        """`formula` of diagnosis.json."""
        parameters = {}
        for name, one in self.parameters.items():
            parameters[name] = {"value": one.value, "unit": self.units[name], "ci95": [one.low, one.high]}
        return {
            "equation": self.equation,
            "law": self.law,
            "parameters": parameters,
            "share": self.share,
            "held_out_share": self.held_out_share,
            "evidence": {"statistic": self.gain, "p_value": self.p_value},
            "rivals": [vars(rival) for rival in self.rivals],
        }

    def extended(self) -> ModelHypothesis:
        """The model with the formula, which is declared in this process as a user's cause from now on.

        Raises
        ------
        InputError : there is no room for its parameters beside those of other causes
        """
        law = replace(self.expression, name=_free_name(self.expression))
        declare(law)
        stated = {} if self.beside.effects is None else dict(self.beside.effects.stated)
        return replace(self.beside, effects=EffectValues({**stated, law.effect: law.stated}))


def formula_of(kind: Kind, starts: Sequence[Fit], *, tell: Callable[[str], None]) -> Formula | None:
    """The formula that accounts for what fits leave; None where none is worth it.

    Parameters
    ----------
    starts : the fit without effects, and where effects were taken, that with them. A formula takes their place where
        one term alone leaves noise, and is more probable than they are with one beside them, or by `LEAST` than they
        are where none stands beside them
    """
    beside = chosen_terms(starts[-1], tell=tell)
    told = starts[-1].log_evidence + LEAST if beside is None else beside.fit.log_evidence
    alone = None
    if len(starts) > 1:
        alone = chosen_terms(starts[0], tell=tell, most=1, least=told - starts[0].log_evidence)
    if alone is not None and white(alone.fit.excess) and alone.fit.log_evidence > told:
        return _told(kind, alone, alone=True)
    return None if beside is None else _told(kind, beside, alone=False)


def _told(kind: Kind, found: ChosenTerms, *, alone: bool) -> Formula | None:
    """The formula with what held-out runs say; None where they speak against it."""
    law = _joined(found.laws)
    with declared(*found.laws):
        of_terms = effect_estimates(found.fit)
        units = {f"{one.effect}.{p.name}": p.unit for one in found.laws for p in one.parameters}
        model = kind.extend(found.fit)
        errors = kind.errors(model, found.fit)
    before = kind.errors(kind.extend(found.start), found.start)
    gain = held_out_gains([[one.summary for one in signals] for signals in (before, errors)])[0]
    held_out_share = 1 - _held_out_excess(errors) / max(_held_out_excess(before), 1e-300)
    if held_out_worse(before, errors) or gain < -WORSE or held_out_share < EXPLAINED:
        return None
    names = _names(found.laws)
    rivals = tuple(_rival(found.start, *pair) for pair in found.first[1 : 1 + RIVALS])
    estimates = {names[one.effect, name]: of_terms[one.effect][name] for one in found.laws for name in _own(one)}
    return Formula(
        law.equation,
        law.text,
        estimates,
        {names[one.effect, name]: units[f"{one.effect}.{name}"] for one in found.laws for name in _own(one)},
        found.gain,
        found.p_value,
        1 - excess_power(found.fit.excess) / max(excess_power(found.start.excess), 1e-300),
        held_out_share,
        rivals,
        found.first[0][1].gain - rivals[0].gain if rivals else 0.0,
        alone,
        law.with_values({name: estimate.value for name, estimate in estimates.items()}),
        replace(model, effects=_without(model.effects, found.laws)),
        tuple(errors),
    )


def _own(law: LawExpression) -> list[str]:
    return [p.name for p in law.parameters]


def _names(laws: Sequence[LawExpression]) -> dict[tuple[str, str], str]:
    """(term, parameter) to the parameter's name in the law that joins the terms."""
    found: dict[tuple[str, str], str] = {}
    for law, amount, shape in zip(laws, _AMOUNTS, _SHAPES, strict=False):
        found |= {(law.effect, "a"): amount, (law.effect, "w"): shape}
    return found


def _joined(laws: Sequence[LawExpression]) -> LawExpression:
    """The sum of terms as one law."""
    names, texts, parameters = _names(laws), [], {}
    for law in laws:
        text = law.text
        for p in law.parameters:
            name = names[law.effect, p.name]
            text = re.sub(rf"\b{p.name}\b", name, text)
            parameters[name] = p.text
        texts.append(text)
    return expression(NAME, laws[0].equation, " + ".join(texts), parameters)


def _held_out_excess(errors: Iterable[ErrorSignal]) -> float:
    """Power of the errors on held-out runs over the noise's, what is above 1 of each channel, together."""
    held = [one.summary for one in errors if one.role == "held-out"]
    return sum(max((one.rms / one.floor) ** 2 - 1, 0.0) for one in held)


def _rival(start: Fit, law: LawExpression, refit: Refit) -> RivalFormula:
    share = 1 - excess_power(refit.fit.excess) / max(excess_power(start.excess), 1e-300)
    return RivalFormula(law.equation, law.text, refit.gain, share)


def _without(effects: EffectValues | None, laws: Sequence[LawExpression]) -> EffectValues | None:
    gone = {law.effect for law in laws}
    stated = {} if effects is None else {name: of for name, of in effects.stated.items() if name not in gone}
    return EffectValues(stated) if stated else None


def _free_name(law: LawExpression) -> str:
    """`NAME`, or with a number where another law has it in this process."""
    names = [NAME, *(f"{NAME}_{n}" for n in range(2, 2 + len(DECLARED)))]
    return next(name for name in names if DECLARED.get(name) in (None, replace(law, name=name).bare))
