"""One driver for all kinds of records: what holds for one kind holds for every other."""

from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import pytest

from msl_fem.diagnosis import driver
from msl_fem.diagnosis.conclusion import NO_EXTENDED_MODEL
from msl_fem.diagnosis.driver import DiagnosisSettings, diagnosis_of
from msl_fem.diagnosis.gathered import GatheredRuns
from msl_fem.diagnosis.kind import ErrorSignal, Kind
from msl_fem.diagnosis.likelihood import Fit
from msl_fem.diagnosis.noise import NoiseWeights, weights_of
from msl_fem.diagnosis.null import SURROGATES
from msl_fem.diagnosis.outside import Dependence
from msl_fem.diagnosis.problem import Points
from msl_fem.diagnosis.result import Accuracy
from msl_fem.diagnosis.unknowns import EffectUnknown, Unknowns
from msl_fem.diagnosis.variants import Variant

N = 2000


class LinearRecord:
    """White noise, and an effect of known size in its readings; two further columns are unknown."""

    is_cut, begins, threads, threads_here = False, (), 1, 1
    strict = False

    def __init__(self, unknown: EffectUnknown) -> None:
        chance = np.random.default_rng(3)
        self.unknown, self.nuisances = unknown, chance.standard_normal((N, 2))
        self.column = chance.standard_normal(N)
        self.data = self.column + chance.standard_normal(N)
        self.labels, self.ceilings = np.zeros(N, dtype=np.intp), np.array([np.inf])
        self.problem = SimpleNamespace(plant=SimpleNamespace(parameters=None), schedules=())

    def steps(self, times: int) -> int:
        return 1

    def spectra(self, points: Points) -> np.ndarray:
        rows = []
        for n, z in enumerate(points.rows):
            size = 0.0
            if points.effects is not None:
                size = self.unknown.z_of(float(points.effects[n, self.unknown.place]))
            rows.append(self.data - self.nuisances @ z[:2] - self.column * size)
        return np.array(rows)

    def noise_spectra(self, weights: NoiseWeights) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        return {"position_m": (np.array([0.0, 1.0]), weights.density)}

    def weights(self, residual: np.ndarray, unknowns: Unknowns) -> NoiseWeights:
        return weights_of(residual, self.labels, self.ceilings)

    def gathering(self, runs: GatheredRuns | None) -> "LinearRecord":
        return self

    def standard_errors(self, found: Fit) -> np.ndarray:
        return np.sqrt(np.diag(np.linalg.inv(found.precision)))

    def nats_of_noise(self, unknowns: Unknowns, z: np.ndarray) -> float:
        return 0.0

    def excess(self, fit: Fit) -> dict[str, float]:
        return {"position_m": float(np.sqrt(np.mean(fit.residual**2)))}


@dataclass(frozen=True, eq=False)
class ToyKind(Kind):
    """A kind of its own, whose effect makes held-out data worse."""

    prediction: ClassVar[str] = "one-step"

    def candidates(self, fit: Fit) -> list[Variant]:
        unknown = self.likelihood.unknown  # type: ignore[attr-defined]
        return [] if fit.unknowns.effects else [Variant(unknown.effect, (unknown,))]

    def extend(self, fit: Fit) -> Any:
        return self.belief

    def errors(self, belief: Any, fit: Fit | None) -> list[ErrorSignal]:
        worse = 2.0 if fit is not None and fit.unknowns.effects else 1.0
        return [
            ErrorSignal(role, role, "position_m", size * np.ones(N), deviation=1.0, floor=1.0, rate=1e3)
            for role, size in (("fit", 1.0), ("held-out", worse))
        ]


def diagnosed(kind: type[ToyKind], unknown: EffectUnknown) -> Any:
    likelihood: Any = LinearRecord(unknown)
    made = kind(SimpleNamespace(), likelihood, Unknowns((), 2, (0,)))  # type: ignore[arg-type]
    return diagnosis_of(made, DiagnosisSettings(threads=2))


def test_held_out_data_speak_against_no_effect_of_each_run_s_own_whatever_the_kind() -> None:
    found = diagnosed(ToyKind, EffectUnknown("sensor_drift", "rate"))
    assert found.names == ("sensor_drift",)
    assert found.causes[0].gain < -1000
    assert any("each run's own" in note for note in found.notes)


def test_held_out_data_speak_against_every_other_effect_whatever_the_kind() -> None:
    found = diagnosed(ToyKind, EffectUnknown("force_offset", "force"))
    assert found.names == ()
    assert any("makes held-out runs worse" in note for note in found.notes)


def test_chance_is_told_by_surrogates_of_any_kind_of_record_and_what_was_tried_is_kept() -> None:
    found = diagnosed(ToyKind, EffectUnknown("sensor_drift", "rate"))
    assert found.causes[0].p_value == 1 / (1 + SURROGATES)
    assert found.to_json()["null"]["surrogates"] == SURROGATES
    assert found.causes[0].explained_power == pytest.approx(1.0, abs=0.1), (
        "a column of the noise's size in the readings"
    )
    assert found.main_cause is None, "held-out data are followed worse with it"
    assert [(tried.effect, tried.taken) for tried in found.evidence.tried] == [("sensor_drift", True)]
    assert [residuals.run for residuals in found.evidence.residuals] == ["fit", "held-out"]


def test_an_unexplained_rest_is_looked_into_by_the_kind() -> None:
    class Explaining(ToyKind):
        def dependences(self, fit: Fit, belief: Any, *, few: bool = False, threads: int = 1) -> list[Dependence]:
            assert threads == 2
            curve = np.zeros(3)
            return [Dependence("force", "velocity", 500.0, 0.9, curve, curve, curve)]

    found = diagnosed(Explaining, EffectUnknown("force_offset", "force"))
    assert found.verdict == "unexplained"
    assert (found.unexplained.equation, found.unexplained.depends_on) == ("force", ("velocity",))


class Quiet(LinearRecord):
    """With next to nothing of the effect in its readings."""

    def __init__(self, unknown: EffectUnknown) -> None:
        super().__init__(unknown)
        self.data -= self.column


class Shaken(LinearRecord):
    """With a large effect beside what is left in the position, and in a current."""

    def __init__(self, unknown: EffectUnknown, missing: float, elsewhere: float, before: float) -> None:
        super().__init__(unknown)
        self.data += 2 * self.column + missing * np.random.default_rng(8).standard_normal(N)
        self.elsewhere, self.before = elsewhere, before

    def excess(self, fit: Fit) -> dict[str, float]:
        elsewhere = self.elsewhere if fit.unknowns.effects else max(self.before, self.elsewhere)
        return super().excess(fit) | {"current_1_A": elsewhere}


@pytest.mark.parametrize("effect", ["sensor_drift", "force_offset"])
@pytest.mark.parametrize(
    ("missing", "elsewhere", "before"), [(0.0, 1.0, 1.0), (0.5, 1.0, 1.0), (0.0, 1.2, 1.0), (0.0, 1.2, 2.0)]
)
def test_a_zero_that_wanders_is_no_name_where_more_than_noise_is_left_in_other_readings(
    effect: str, missing: float, elsewhere: float, before: float
) -> None:
    """Of another effect what is left there says nothing, of a wander what is left in its own reading does not, nor what
    is little of what a fit without it has left."""

    class Confirmed(ToyKind):
        def errors(self, belief: Any, fit: Fit | None) -> list[ErrorSignal]:
            return super().errors(belief, None)

        def predictive_gain(self, before: Fit, after: Fit) -> float:
            return 1.0

    unknown = EffectUnknown(effect, "rate" if effect == "sensor_drift" else "force")
    likelihood: Any = Shaken(unknown, missing, elsewhere, before)
    made = Confirmed(SimpleNamespace(), likelihood, Unknowns((), 2, (0,)))  # type: ignore[arg-type]
    found = diagnosis_of(made, DiagnosisSettings(threads=2))
    named = effect == "force_offset" or elsewhere == 1.0 or before == 2.0
    assert found.names == ((effect,) if named else ())
    assert (found.main_cause is not None) == named
    assert ("unexplained" in found.verdict) == (missing > 0 or elsewhere > 1.0)
    assert any("a cause is missing" in note for note in found.notes) == (not named)


@pytest.mark.parametrize(("gain", "verdict"), [(21.0, "unexplained"), (19.0, "nothing-found")])
def test_what_is_no_larger_than_noise_is_unexplained_where_a_function_of_one_variable_is_worth_it(
    gain: float, verdict: str
) -> None:
    asked: list[bool] = []

    class Faint(ToyKind):
        def dependences(self, fit: Fit, belief: Any, *, few: bool = False, threads: int = 1) -> list[Dependence]:
            asked.append(few)
            curve = np.zeros(3)
            return [Dependence("force", "current product", gain, 0.06, curve, curve, curve)]

    likelihood: Any = Quiet(EffectUnknown("force_offset", "force"))
    made = Faint(SimpleNamespace(), likelihood, Unknowns((), 2, (0,)))  # type: ignore[arg-type]
    found = diagnosis_of(made, DiagnosisSettings(threads=2))
    assert (found.verdict, found.names) == (verdict, ())
    assert asked == ([True, False] if verdict == "unexplained" else [True]), "first of a few variables, then of all"
    told = [note for note in found.notes if "a force that is a function of the current product brings 21 nats" in note]
    assert len(told) == (verdict == "unexplained")
    depends = ("current product",) if told else ()
    assert found.unexplained.depends_on == depends


def test_no_model_is_handed_on_that_follows_held_out_data_worse_than_the_belief() -> None:
    class Misled(ToyKind):
        """Whose fit is worse than the belief, with or without an effect."""

        def errors(self, belief: Any, fit: Fit | None) -> list[ErrorSignal]:
            size = 1.0 if fit is None else 1.5
            signals = super().errors(belief, None)
            return [signals[0], replace(signals[1], values=size * signals[1].values)]

    for kind, effect, handed_on in (
        (ToyKind, "force_offset", True),
        (ToyKind, "sensor_drift", False),
        (Misled, "force_offset", False),
    ):
        found = diagnosed(kind, EffectUnknown(effect, "force" if effect == "force_offset" else "rate"))
        assert (found.extended is not None) == handed_on
        assert (NO_EXTENDED_MODEL in found.notes) != handed_on


def test_a_channel_that_never_changes_has_errors_and_no_division_by_its_deviation() -> None:
    still = ErrorSignal("run", "held-out", "current_1_A", np.ones(10), deviation=0.0, floor=0.5, rate=1e3).summary
    assert (still.rms, still.nrmse) == (1.0, float("inf"))
    entry = Accuracy(still, still, still).to_json()
    assert (entry["nominal_nrmse"], entry["noise_floor_nrmse"]) == (None, None)


def test_a_wrong_statement_is_turned_round_where_that_explains_more_than_every_effect() -> None:
    """What a wrong statement leaves looks like the effect in part; where the effect is there, the statement stays."""
    effect = EffectUnknown("sensor_drift", "rate")
    stated, turned = LinearRecord(effect), LinearRecord(effect)
    chance = np.random.default_rng(8)

    class Stated(ToyKind):
        def restatements(self) -> list[Kind]:
            return [ToyKind(SimpleNamespace(), turned, Unknowns((), 2, (0,)), ("turned",))]  # type: ignore[arg-type]

    turned.data = chance.standard_normal(N)
    stated.data = turned.data + 2 * chance.standard_normal(N) + turned.column
    stated.column = turned.column
    made = Stated(SimpleNamespace(), stated, Unknowns((), 2, (0,)), ("stated",))  # type: ignore[arg-type]
    found = diagnosis_of(made, DiagnosisSettings())
    assert (found.names, found.notes) == ((), ("turned",))
    stated.data = turned.data + 2 * turned.column
    turned.data = turned.data + chance.standard_normal(N)
    found = diagnosis_of(made, DiagnosisSettings())
    assert (found.names, found.notes[0]) == (("sensor_drift",), "stated")
    turned.data = np.full(N, np.nan)  # what cannot be simulated the other way round stays as it is stated
    assert diagnosis_of(made, DiagnosisSettings()).names == ("sensor_drift",)


@pytest.mark.parametrize("doubted", [True, False], ids=["with one effect", "with all effects"])
def test_a_record_turned_round_is_searched_over_the_stretches_that_are_chosen_with_it(
    doubted: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    effect = EffectUnknown("sensor_drift", "rate")
    stated, turned, settled = LinearRecord(effect), LinearRecord(effect), LinearRecord(effect)
    stated.data = 3 * stated.data
    settled.data = settled.data + 2 * settled.column

    class Turned(ToyKind):
        def settled(self, tell: Any) -> Kind:
            return ToyKind(SimpleNamespace(), settled, Unknowns((), 2, (0,)), ("settled",))  # type: ignore[arg-type]

    other = Turned(SimpleNamespace(), turned, Unknowns((), 2, (0,)), ("turned",))  # type: ignore[arg-type]
    monkeypatch.setattr(driver, "in_doubt", lambda kind, fits: other if doubted else None)
    monkeypatch.setattr(driver, "restated", lambda kind, fits: other)
    made = ToyKind(SimpleNamespace(), stated, Unknowns((), 2, (0,)), ("stated",))  # type: ignore[arg-type]
    found = diagnosis_of(made, DiagnosisSettings())
    assert (found.names, found.notes[0]) == (("sensor_drift",), "settled")
