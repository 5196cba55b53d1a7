"""What is particular to a kind of record, free runs, loops, static maps or carriages, and how its models are judged."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from msl_fem.computing.arrays import Array
from msl_fem.diagnosis.decision import WORSE, Rule
from msl_fem.diagnosis.estimates import extended_belief
from msl_fem.diagnosis.left_out import LeftOut
from msl_fem.diagnosis.likelihood import Fit, Likelihood
from msl_fem.diagnosis.outside import Dependence
from msl_fem.diagnosis.search import SearchStage
from msl_fem.diagnosis.unknowns import Unknowns
from msl_fem.diagnosis.variants import Variant, every_variant, record_features
from msl_fem.plant.effects import CATALOGUE
from msl_fem.prediction import ModelHypothesis, RunData

BLOCKS = 20  # of a held-out run
SHORTEST_BLOCK = 50  # samples
STANDARD_ERRORS = 2.0
LOST = 0.02  # of the samples that count, in which a model may leave its table or range and be one that follows


@dataclass(frozen=True)
class PredictionError:
    """The error of a model on one channel of a run.

    Attributes
    ----------
    rms : of measured less predicted, SI unit; inf where the model left its table or range
    nrmse : over the standard deviation of measured
    floor : the noise's sigma, SI unit
    samples : independent numbers
    """

    run: str
    role: str
    channel: str
    rms: float
    nrmse: float
    floor: float
    samples: int
    deviation: float


@dataclass(frozen=True, eq=False)
class ErrorSignal:
    """What a model misses on a channel of a run.

    Attributes
    ----------
    values : (n_sample,) measured less predicted, SI unit; nan where the model left its table or range
    deviation : of the measured
    floor : the noise's sigma
    rate : samples a second; nan of the rows of a map
    samples : independent numbers; None: all
    outside : (n_sample,) samples that do not count; None: all count
    """

    run: str
    role: str
    channel: str
    values: Array
    deviation: float
    floor: float
    rate: float
    samples: int | None = None
    outside: NDArray[np.bool_] | None = None

    @classmethod
    def of_run(
        cls, data: RunData, channel: str, values: Array, outside: NDArray[np.bool_] | None = None
    ) -> "ErrorSignal":
        """On a channel of a run as it was measured."""
        deviation = float(data.measured[channel].std())
        signal = cls(data.name, data.role, channel, values, deviation, data.noise[channel].sigma, data.rate)
        return signal if outside is None else signal.without(outside)

    def without(self, outside: NDArray[np.bool_]) -> "ErrorSignal":
        """With samples that do not count."""
        return replace(self, values=np.where(outside, np.nan, self.values), outside=outside)

    @property
    def counted(self) -> Array:
        """The values of the samples that count."""
        return self.values if self.outside is None else self.values[~self.outside]

    @property
    def summary(self) -> PredictionError:
        values = self.counted
        rms = float(np.sqrt(np.mean(values**2))) if np.isfinite(values).all() else float("inf")
        samples = values.size if self.samples is None else self.samples
        nrmse = rms / self.deviation if self.deviation else float("inf")
        return PredictionError(self.run, self.role, self.channel, rms, nrmse, self.floor, samples, self.deviation)


def on_common_ground(models: Sequence[Sequence[ErrorSignal]]) -> list[list[ErrorSignal]]:
    """The signals of several models on the samples that all of them follow, where none leaves its table or range in
    more than `LOST` of those that count; a model that leaves more has not followed."""
    made = [list(signals) for signals in models]
    for n in range(len(made[0])):
        of_models = [signals[n] for signals in made]
        left = [np.isnan(one.values) for one in of_models]
        more = [float(np.isnan(one.counted).mean()) for one in of_models]
        follow = [k for k in range(len(made)) if more[k] <= LOST]
        outside = np.any([left[k] for k in follow], axis=0) if any(more[k] for k in follow) else None
        for k in follow:
            made[k][n] = of_models[k] if outside is None else of_models[k].without(outside)
    return made


def held_out_gains(models: Sequence[Sequence[PredictionError]]) -> list[float]:
    """Nats that each model brings on held-out data over the one before it; of each model the errors on all data."""
    unseen = [[error for error in errors if error.role == "held-out"] for errors in models]
    return [log_likelihood_gain(before, after) for before, after in zip(unseen, unseen[1:], strict=False)]


def log_likelihood_gain(before: Sequence[PredictionError], after: Sequence[PredictionError]) -> float:
    """Nats by which runs are more probable under the second model, the noise's variance estimated for each, at least
    the instrument's."""
    total = 0.0
    for first, second in zip(before, after, strict=True):
        if not np.isfinite(second.rms):
            return -np.inf
        if not np.isfinite(first.rms):
            return np.inf
        ratio = max(first.rms, first.floor) / max(second.rms, second.floor)
        total += first.samples * float(np.log(ratio))
    return total


def held_out_worse(
    before: Sequence[ErrorSignal], after: Sequence[ErrorSignal], *, standard_errors: float = STANDARD_ERRORS
) -> bool:
    """Whether held-out data are followed worse by the second model, in blocks that are longer than the errors'
    correlation: the mean change of their power, over the noise's and the first model's, is above so many of its
    standard errors."""
    changes: list[float] = []
    for first, second in zip(before, after, strict=True):
        if first.role == "held-out":
            if not np.isfinite(second.counted).all():
                return bool(np.isfinite(first.counted).all())
            if np.isfinite(first.counted).all():
                changes += _block_changes(first, second)
    if len(changes) < 2:
        return False
    error = float(np.std(changes, ddof=1)) / np.sqrt(len(changes))
    return float(np.mean(changes)) > standard_errors * error


def held_out_against(models: Sequence[Sequence[ErrorSignal]]) -> list[bool]:
    """Of each effect, between the model before it and the one with it, whether held-out data speak against its name:
    against the first where they are worse beyond chance, against a further one where they do not confirm it."""
    pairs = zip(models, models[1:], strict=False)
    return [held_out_worse(*pair, standard_errors=0.0 if n else STANDARD_ERRORS) for n, pair in enumerate(pairs)]


def worse_than_belief(believed: Sequence[ErrorSignal], extended: Sequence[ErrorSignal]) -> bool:
    """Whether held-out data speak for the believed model and against another one: its errors are larger block by block,
    and the data less probable under it by more than `WORSE` nats."""
    held = [[one.summary for one in signals if one.role == "held-out"] for signals in (believed, extended)]
    return held_out_worse(believed, extended) and log_likelihood_gain(*held) < -WORSE


def _block_changes(first: ErrorSignal, second: ErrorSignal) -> list[float]:
    """Of each block the change of the error's power over that of the first model, at least the noise's."""
    scale = max(float(np.mean(first.counted**2)), first.floor**2)
    change = (second.counted**2 - first.counted**2) / scale
    blocks = np.array_split(change, max(2, min(BLOCKS, change.size // SHORTEST_BLOCK)))
    return [float(np.mean(block)) for block in blocks]


def worst_over_floor(errors: Sequence[PredictionError]) -> float:
    """The largest RMS error over the noise's sigma of all channels."""
    return max((error.rms / error.floor for error in errors), default=float("nan"))


@dataclass(frozen=True)
class Size:
    """How much an effect changes a run at equal input: RMS change over the channel's own RMS, its largest channel."""

    effect: str
    run: str
    channel: str
    share: float
    change: float


@dataclass(frozen=True, eq=False)
class Kind(ABC):
    """A record made ready: its likelihood, what is unknown in it, and all that depends on the kind of a record.

    Attributes
    ----------
    belief : as in the record
    likelihood, unknowns : of the data with the role fit, without any effect
    notes : what the reader must know beside the verdict
    begin : (unknowns.size,) where the fit without effects begins; None: as believed
    left_out : what of the record does not count
    sane : where a fit without effects, begun far from the record, was last at numbers that a plant can have, if it went
        on to those that nothing can have
    prediction : how models are judged, the word of the accuracy's entries
    faithful : how many times their error on the fit data effects may err on held-out data, to be named
    advice : what would show more of what is left unexplained
    takes_laws : whether its prediction knows laws that users state, so that a formula can be looked for
    """

    belief: ModelHypothesis
    likelihood: Likelihood
    unknowns: Unknowns
    notes: tuple[str, ...] = ()
    begin: Array | None = None
    left_out: tuple[LeftOut, ...] = ()
    sane: Fit | None = field(default=None, kw_only=True)

    prediction: ClassVar[str]
    faithful: ClassVar[float] = float("inf")
    advice: ClassVar[str] = ""
    takes_laws: ClassVar[bool] = False

    @abstractmethod
    def errors(self, belief: ModelHypothesis, fit: Fit | None) -> list[ErrorSignal]:
        """What a model misses on every channel of all data, those held out too; `fit` is where it comes from, None of
        the believed model."""

    def settled(self, tell: Callable[[str], None]) -> "Kind":
        """As it is after the model without effects has been looked at."""
        return self

    def restatements(self) -> "Sequence[Kind]":
        """The record with one thing at a time turned round that is stated about it, and a note that says so."""
        return ()

    def rule(self, rule: Rule) -> Rule:
        """The rule by which this kind is decided. What an equation leaves out was measured on free runs alone."""
        return replace(rule, share=0.0)

    def candidates(self, fit: Fit) -> list[Variant]:
        """The variants of effects to be tried beside those of a fit."""
        plant = self.likelihood.problem.plant.parameters
        return without_those_of(fit, every_variant(plant, record_features(self.likelihood, fit)))

    def extend(self, fit: Fit) -> ModelHypothesis:
        """The model that other commands take."""
        return extended_belief(self.belief, self.likelihood.problem, fit)

    def predictive_gain(self, before: Fit, after: Fit) -> float:
        """Nats by which held-out data are more probable after the second fit than after the first, what each leaves
        uncertain as free as it leaves it; minus infinity where it is not asked."""
        return -np.inf

    def dependences(
        self, fit: Fit, belief: ModelHypothesis, *, few: bool = False, threads: int = 1
    ) -> list[Dependence]:
        """Free functions of one variable that account for what is left, the most probable first; empty where the
        prediction takes none."""
        return []

    def separating(self, stage: SearchStage, rivals: Sequence[str]) -> str:
        """What would tell a stage's best effect from its rivals; empty without rivals."""
        if not rivals or stage.best is None:
            return ""
        return CATALOGUE[stage.best.variant.effect].separating

    def above_noise(self, fit: Fit) -> list[str]:
        """Where what a fit leaves is more than noise can be, in words; empty where noise has no octaves."""
        return []

    def look_further(self, variables: Sequence[str]) -> str:
        """What would show more of what is left, which depends on these variables."""
        return self.advice

    def variables(self) -> dict[str, Mapping[str, Array]]:
        """Run to name (with unit) to (n_sample,): what the values of its error signals may depend on."""
        return {}

    def sizes(self, belief: ModelHypothesis, effects: Sequence[str]) -> list[Size]:
        """How much named effects change the runs; empty where that is not simulated."""
        return []


def about_belief(kind: Kind, fit: Fit) -> list[Variant]:
    """The variants to be tried beside those of a fit, their amounts about what is believed of them."""
    believed = dict(kind.unknowns.fixed)
    return [variant.about(believed) for variant in kind.candidates(fit)]


def without_those_of(fit: Fit, tried: Sequence[Variant]) -> list[Variant]:
    """Variants of effects that a fit does not have."""
    present = {unknown.effect for unknown in fit.unknowns.effects}
    return [variant for variant in tried if variant.effect not in present]
