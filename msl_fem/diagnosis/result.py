"""What a diagnosis returns, and its JSON."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

from msl_fem.diagnosis.evidence import Evidence
from msl_fem.diagnosis.extension import Estimate, unit_of
from msl_fem.diagnosis.held_out import Followed
from msl_fem.prediction import ModelHypothesis

Verdict = Literal["nothing-found", "named", "unexplained", "named-and-unexplained", "undecidable"]


@dataclass(frozen=True, eq=False)
class Cause:
    """An effect that is named.

    Attributes
    ----------
    statistic : log evidence in nats over the model without it
    p_value : how often a clean record of this kind reaches the statistic; None where that was not calibrated
    gain : nats of log likelihood on held-out runs
    rivals : names that the record cannot tell from it
    next_experiment : what would separate them, in words and as an excitation; empty where there are no rivals
    """

    effect: str
    parameters: Mapping[str, Estimate]
    statistic: float
    p_value: float | None
    gain: float
    rivals: tuple[str, ...] = ()
    next_experiment: str = ""

    def fields(self) -> dict[str, Any]:
        return {
            "effect": self.effect,
            "parameters": {
                name: {"value": e.value, "unit": unit_of(self.effect, name), "ci95": [e.low, e.high]}
                for name, e in self.parameters.items()
            },
            "evidence": {
                "statistic": self.statistic, "p_value": self.p_value, "held_out_log_likelihood_gain": self.gain,
            },
            "indistinguishable_from": list(self.rivals),
            "next_experiment": self.next_experiment,
        }  # fmt: skip


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

    nominal: Followed
    refitted: Followed
    extended: Followed
    prediction: str = "free-run"

    def fields(self) -> dict[str, Any]:
        n = self.nominal
        return {
            "run": n.run, "role": n.role, "channel": n.channel, "prediction": self.prediction,
            "nominal_nrmse": _number(n.nrmse), "refitted_nrmse": _number(self.refitted.nrmse),
            "extended_nrmse": _number(self.extended.nrmse), "noise_floor_nrmse": n.floor / n.deviation,
        }  # fmt: skip


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """The outcome for a record.

    Attributes
    ----------
    reason : where undecidable; else what the verdict rests on, in a sentence
    refitted, extended : the model within its tolerances, and with the effects; None where nothing was fitted
    threshold : nats that a first effect had to bring
    false_alarms : (named, clean records) of the calibration; None where the record lies outside what was calibrated
    statistics : of each stage of the search the best effects with their nats, named or not
    notes : what else the reader must know
    evidence : what it rests on, for a report; None where nothing was fitted
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
    false_alarms: tuple[int, int] | None = None
    statistics: tuple[tuple[tuple[str, float], ...], ...] = ()
    notes: tuple[str, ...] = ()
    evidence: Evidence | None = None

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(cause.effect for cause in self.causes)

    def fields(self) -> dict[str, Any]:
        """The content of diagnosis.json."""
        return {
            "schema": 1,
            "verdict": self.verdict,
            "reason": self.reason,
            "causes": [cause.fields() for cause in self.causes],
            "unexplained": {
                "share_of_residual_power": self.unexplained.share,
                "depends_on": list(self.unexplained.depends_on),
                "equation": self.unexplained.equation,
                "next_experiment": self.unexplained.next_experiment,
            },
            "accuracy": [one.fields() for one in self.accuracy],
            "parameters": {
                name: {"believed": e.believed, "fitted": e.value, "ci95": [e.low, e.high], "tolerances": e.tolerances}
                for name, e in self.parameters.items()
            },
            "threshold": _number(self.threshold),
            "false_alarms": None if self.false_alarms is None else list(self.false_alarms),
            "notes": list(self.notes),
        }


def accuracy(
    nominal: Sequence[Followed], refitted: Sequence[Followed], extended: Sequence[Followed]
) -> tuple[Accuracy, ...]:
    return tuple(Accuracy(*three) for three in zip(nominal, refitted, extended, strict=True))


def _number(value: float) -> float | None:
    """For JSON, which has no nan or infinity."""
    return value if abs(value) < float("inf") else None
