"""What a diagnosis returns, its JSON, and what it rests on."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Literal

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.diagnosis.correlation import Correlation
from msl_fem.diagnosis.estimates import Estimate, unit_of
from msl_fem.diagnosis.formula import Formula
from msl_fem.diagnosis.kind import ErrorSignal, PredictionError, Size
from msl_fem.diagnosis.left_out import LeftOut
from msl_fem.diagnosis.null import NullDistribution
from msl_fem.diagnosis.outside import Dependence
from msl_fem.diagnosis.scheduled import ScheduledEstimate
from msl_fem.diagnosis.scores import Score
from msl_fem.diagnosis.search import SearchStage
from msl_fem.diagnosis.unknowns import WIDE
from msl_fem.diagnosis.usual_run import UsualRun
from msl_fem.files.numbers import json_value
from msl_fem.files.quantity import format_quantity
from msl_fem.files.shown import Shown
from msl_fem.plant.believed import PLAIN_BELIEF, Belief
from msl_fem.plant.effects import CATALOGUE, find_parameter
from msl_fem.prediction import ModelHypothesis

NONCENTRALITY = 17.8
RIDGE = 1e-9
Verdict = Literal["nothing-found", "named", "unexplained", "named-and-unexplained", "undecidable"]


@dataclass(frozen=True, eq=False)
class Cause:
    """An effect that is named.

    Attributes
    ----------
    statistic : log evidence in nats over the model without it
    p_value : how often a surrogate of this record without effects reaches the statistic; None where there is none
    gain : nats of log likelihood on held-out runs
    rivals : names that the record cannot tell from it: effects, and believed parameters that would have to leave their
        tolerances
    next_experiment : what would separate them, in words and as an excitation; empty where there are no rivals
    explained_power : share of the excess power without effects that it takes; None where there was no excess
    """

    effect: str
    parameters: Mapping[str, Estimate]
    statistic: float
    p_value: float | None
    gain: float
    rivals: tuple[str, ...] = ()
    next_experiment: str = ""
    explained_power: float | None = None

    def to_json(self) -> dict[str, Any]:
        """The cause in diagnosis.json."""
        parameters = {}
        for name, estimate in self.parameters.items():
            interval = [estimate.low, estimate.high]
            parameters[name] = {"value": estimate.value, "unit": unit_of(self.effect, name), "ci95": interval}
        return {
            "effect": self.effect,
            "parameters": parameters,
            "evidence": {
                "statistic": self.statistic,
                "p_value": self.p_value,
                "held_out_log_likelihood_gain": self.gain,
            },
            "indistinguishable_from": list(self.rivals),
            "next_experiment": self.next_experiment,
            "explained_power": self.explained_power,
        }


@dataclass(frozen=True)
class MainCause:
    """The effect that accounts for most of the excess power; `rest` is the share that is left with all effects."""

    effect: str
    explained_power: float
    rest: float


@dataclass(frozen=True)
class Hidden:
    """The largest amount of an effect that this record would not have shown."""

    value: float
    unit: str


@dataclass(frozen=True)
class Unexplained:
    """What no effect accounts for.

    Attributes
    ----------
    share : of the residual power of the model that was fitted within its tolerances
    depends_on : variables that what is left depends on; empty where none was found
    next_experiment : what would show more of it, in words and as an excitation
    equation : where it stands: "force", "voltage", "position reading", "current reading"; empty where not known
    """

    share: float
    depends_on: tuple[str, ...] = ()
    equation: str = ""
    next_experiment: str = ""


@dataclass(frozen=True)
class Accuracy:
    """The three models on one channel of one run."""

    nominal: PredictionError
    refitted: PredictionError
    extended: PredictionError
    prediction: str = "free-run"

    def to_json(self) -> dict[str, Any]:
        """The entry in diagnosis.json."""
        return {
            "run": self.nominal.run,
            "role": self.nominal.role,
            "channel": self.nominal.channel,
            "prediction": self.prediction,
            "nominal_nrmse": json_value(self.nominal.nrmse),
            "refitted_nrmse": json_value(self.refitted.nrmse),
            "extended_nrmse": json_value(self.extended.nrmse),
            "noise_floor_nrmse": self.nominal.floor / self.nominal.deviation if self.nominal.deviation else None,
        }


@dataclass(frozen=True)
class TriedVariant:
    """A way in which an effect was tried.

    Attributes
    ----------
    stage : 1 for the first effect, 2 for a second beside it, and so on
    linear : nats of log evidence in the linear model around the fit without it
    refitted : nats of log evidence with everything fitted anew; None where the linear figure was too low for that
    taken : it is named
    """

    stage: int
    effect: str
    variant: str
    linear: float
    refitted: float | None
    taken: bool


@dataclass(frozen=True, eq=False)
class ChannelResiduals:
    """Measured less modelled of a channel of a run, SI units, (n_sample,) each; nan where a model ended early.

    Attributes
    ----------
    sigma : of the noise
    """

    run: str
    role: str
    channel: str
    rate: float
    sigma: float
    nominal: Array
    refitted: Array
    extended: Array

    @property
    def time(self) -> Array:
        return np.arange(self.nominal.size) / self.rate


@dataclass(frozen=True, eq=False)
class Evidence:
    """What a diagnosis rests on, for those who want to look.

    Attributes
    ----------
    tried : all effects of all stages, the best of each stage first
    residuals : every run and channel; none of a static map
    variables : run to name (with unit) to (n_sample,): what a residual may depend on
    sizes : of the named effects
    dependences : of what is left on each variable in each equation, the most probable first
    noise : of channels the spectrum that the last fit takes for noise and for the wander of a zero: edges of bands in
        Hz (n_band + 1,), and the power density in each over that of white noise of the stated sigma (n_band,)
    """

    tried: tuple[TriedVariant, ...]
    residuals: tuple[ChannelResiduals, ...]
    variables: Mapping[str, Mapping[str, Array]]
    sizes: tuple[Size, ...]
    dependences: tuple[Dependence, ...] = ()
    noise: Mapping[str, tuple[Array, Array]] = field(default_factory=dict)


@dataclass(frozen=True, eq=False, repr=False)
class Diagnosis(Shown):
    """The outcome for a record.

    Attributes
    ----------
    reason : where undecidable; else what the verdict rests on, in a sentence
    refitted, extended : the model within its tolerances, and with the effects; None where nothing was fitted, or where
        held-out data are followed worse than by the believed model
    threshold : nats that a first effect had to bring
    null : what any effect brings by chance on this record
    main_cause : None where no effect accounts for most of the excess
    hidden : by effect, for those with one leading amount
    statistics : of each stage of the search the best effects with their nats, named or not
    notes : what else the reader must know
    left_out : samples of the record that do not count
    scheduling : parameters that go with a second input, at its levels
    evidence : what it rests on, for a report; None where nothing was fitted
    belief : what the plain model was believed to have beside
    correlation : of the fitted numbers' errors; None where nothing was fitted
    formula : the law that accounts for what no effect does; None where nothing is left or none was found
    usual_run : how the record was excited, for the experiments after it; None where no drive moved the mover
    """

    verdict: Verdict
    reason: str
    causes: tuple[Cause, ...] = ()
    unexplained: Unexplained = field(default_factory=lambda: Unexplained(0.0))
    accuracy: tuple[Accuracy, ...] = ()
    parameters: Mapping[str, Estimate] = field(default_factory=dict)
    refitted: ModelHypothesis | None = None
    extended: ModelHypothesis | None = None
    threshold: float = float("nan")
    null: NullDistribution = field(default_factory=NullDistribution)
    main_cause: MainCause | None = None
    hidden: Mapping[str, Hidden] = field(default_factory=dict)
    statistics: tuple[tuple[tuple[str, float], ...], ...] = ()
    notes: tuple[str, ...] = ()
    left_out: tuple[LeftOut, ...] = ()
    scheduling: tuple[ScheduledEstimate, ...] = ()
    evidence: Evidence | None = None
    belief: Belief = PLAIN_BELIEF
    correlation: Correlation | None = None
    formula: Formula | None = None
    usual_run: UsualRun | None = None

    def facts(self) -> dict[str, str]:
        """The verdict, each cause with its leading amount, rivals and interval, and what stays unexplained."""
        facts = {"verdict": self.verdict.replace("-", " ")}
        for cause in self.causes:
            name, leading = next(iter(cause.parameters.items()))
            unit = unit_of(cause.effect, name)
            low, high = (format_quantity(value, unit) for value in (leading.low, leading.high))
            amount = f"{format_quantity(leading.value, unit)} ({low} ... {high}), {cause.statistic:.3g} nats"
            rivals = f", or {' or '.join(cause.rivals)}" if cause.rivals else ""
            facts[cause.effect.replace("_", " ")] = amount + rivals.replace("_", " ")
        if self.unexplained.share:
            facts["unexplained"] = f"{100 * self.unexplained.share:.2g} % of the residual power"
        return facts | {"reason": self.reason}

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(cause.effect for cause in self.causes)

    def to_json(self) -> dict[str, Any]:
        """The content of diagnosis.json."""
        parameters = {}
        for name, estimate in self.parameters.items():
            parameters[name] = {
                "believed": estimate.believed,
                "fitted": estimate.value,
                "ci95": [estimate.low, estimate.high],
                "tolerances": estimate.tolerances,
            }
        return {
            "schema": 1,
            "verdict": self.verdict,
            "reason": self.reason,
            "belief": self.belief.to_json(),
            "causes": [cause.to_json() for cause in self.causes],
            "unexplained": {
                "share_of_residual_power": self.unexplained.share,
                "depends_on": list(self.unexplained.depends_on),
                "equation": self.unexplained.equation,
                "next_experiment": self.unexplained.next_experiment,
            },
            "accuracy": [entry.to_json() for entry in self.accuracy],
            "parameters": parameters,
            "scheduling": [one.to_json() for one in self.scheduling],
            "correlation": None if self.correlation is None else self.correlation.to_json(),
            "threshold": json_value(self.threshold),
            "null": self._null(),
            "main_cause": None if self.main_cause is None else asdict(self.main_cause),
            "hidden_at_most": {name: asdict(hidden) for name, hidden in self.hidden.items()},
            "formula": None if self.formula is None else self.formula.to_json(),
            "notes": list(self.notes),
            "left_out": [one.to_json() for one in self.left_out],
            **({} if self.usual_run is None else {"usual_run": self.usual_run.to_json()}),
        }

    def _null(self) -> dict[str, Any] | None:
        """What effects bring by chance, and how often as much as the best one of this record; None of no search."""
        if not self.null.gains.size:
            return None
        best = [gain for stage in self.statistics[:1] for _, gain in stage[:1]]
        return {
            "quantiles": dict(self.null.quantiles),
            "surrogates": int(self.null.gains.size),
            "p_value": self.null.p_value(best[0]) if best else None,
        }


def with_formula(found: Diagnosis, formula: Formula | None) -> Diagnosis:
    """The diagnosis with a formula for what is left: the accuracy of the extended model is that with it."""
    if formula is None:
        return found
    accuracy = tuple(
        replace(entry, extended=one.summary) for entry, one in zip(found.accuracy, formula.errors, strict=True)
    )
    found = replace(found, formula=formula, accuracy=accuracy)
    if not formula.alone:
        return found
    note = f"{formula.equation} = {formula.law} is more probable than {', '.join(found.names)}, which is not named"
    notes = (*found.notes, note)
    bare = replace(found, verdict="unexplained", causes=(), main_cause=None, correlation=None)
    return replace(bare, extended=found.refitted, notes=notes)


def hidden_at_most(scores: Sequence[Score]) -> dict[str, Hidden]:
    """Of each effect the amount that would have been found in 95 of 100 records by a test that is wrong in one of 100
    (noncentrality 17.8; Kay, Statistical Signal Processing II, 1998, ch. 6), by the variant that shows it best, all
    tolerances free; what lies below could be there. Beyond an amount's bounds there is no figure."""
    least: dict[str, Hidden] = {}
    for score in scores:
        one = score.variant.amounts[0]
        told = 1 / float(np.linalg.inv(score.own + RIDGE * np.eye(len(score.own)))[0, 0])
        parameter = find_parameter(one.effect, one.name)
        if not told > 0:  # by rounding: all else makes up for it
            continue
        value = WIDE * one.size * parameter.scale * float(np.sqrt(NONCENTRALITY / told))
        first = CATALOGUE[one.effect].amounts[:1]
        known = least.get(one.effect)
        inside = parameter.neutral + value <= one.size * parameter.bounds[1]
        if one.name in first and inside and (known is None or value < known.value):
            least[one.effect] = Hidden(value, parameter.unit)
    return least


def channel_residuals(
    nominal: Sequence[ErrorSignal], refitted: Sequence[ErrorSignal], extended: Sequence[ErrorSignal]
) -> tuple[ChannelResiduals, ...]:
    """The signals of three models side by side; rows of a map, which have no rate, are left out."""
    residuals = []
    for first, second, third in zip(nominal, refitted, extended, strict=True):
        if np.isfinite(first.rate):
            values = (first.values, second.values, third.values)
            residuals.append(ChannelResiduals(first.run, first.role, first.channel, first.rate, first.floor, *values))
    return tuple(residuals)


def tried_variants(stages: Sequence[SearchStage], taken: int) -> tuple[TriedVariant, ...]:
    """All variants of all stages; those that were refitted come first, by their gain, then by the linear figure."""
    tried: list[TriedVariant] = []
    for n, stage in enumerate(stages):
        refits = {refit.variant.name: refit.gain for refit in stage.refits}
        best = stage.best.variant.name if stage.best is not None and n < taken else ""
        of_stage = []
        for score in stage.scores:
            name = score.variant.name
            refitted = refits.get(name)
            of_stage.append(TriedVariant(n + 1, score.variant.effect, name, score.gain, refitted, name == best))
        tried += sorted(of_stage, key=_order)
    return tuple(tried)


def _order(tried: TriedVariant) -> tuple[bool, float]:
    return tried.refitted is None, -(tried.linear if tried.refitted is None else tried.refitted)
