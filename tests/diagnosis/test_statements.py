"""The hold of the commands, stated wrongly: what the record says against what rig.toml says."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from diagnosed import TABLE, bench_record
from linear_record import CUBIC, OFFSET, LinearRecord, record, with_effect
from scipy.optimize import brentq

from msl_fem.diagnosis import driver, statements
from msl_fem.diagnosis.decision import TIE
from msl_fem.diagnosis.driver import DiagnosisSettings
from msl_fem.diagnosis.fit import FitPlan, fit
from msl_fem.diagnosis.problem import Points
from msl_fem.diagnosis.runs import Runs, dynamic_runs
from msl_fem.diagnosis.statements import STEPS, in_doubt, restated
from msl_fem.prediction import ModelHypothesis, run_data


def believed(kind: Runs) -> float:
    """Nats of the belief."""
    residual = kind.likelihood.spectra(Points.of(kind.unknowns, np.zeros((1, kind.unknowns.size))))[0]
    return -kind.likelihood.weights(residual, kind.unknowns).nats


def test_the_hold_is_turned_round_in_all_runs_and_the_true_one_is_more_probable() -> None:
    record = bench_record(seed=11, rate=2e3).record
    runs = [run_data(record, run) for run in record.runs]
    kind = dynamic_runs(record, ModelHypothesis(record.actuator, TABLE), runs)
    (turned,) = kind.restatements()
    assert {run.hold for run in (*turned.runs, *turned.likelihood.problem.runs)} == {"linear"}
    assert {run.hold for run in kind.runs} == {"zero-order"}
    assert believed(kind) > believed(turned) + 1000
    (back,) = turned.restatements()
    assert believed(back) == believed(kind)
    assert 'held "linear" and not "zero-order"' in turned.notes[-1]


def test_an_effect_that_makes_up_for_a_statement_gives_way_to_it_and_one_that_is_there_does_not() -> None:
    """Turned round, the record needs one effect less; or it leaves less without effects, and more with them."""

    def turned_of(stated: LinearRecord, turned: LinearRecord) -> bool:
        sets = ((), (OFFSET,), (OFFSET, CUBIC))
        fits = [fit(stated, with_effect(unknowns, *every), np.zeros(3 + len(every))) for every in sets]  # type: ignore[arg-type]
        other: Any = SimpleNamespace(likelihood=turned)
        kind: Any = SimpleNamespace(restatements=lambda: (other,))
        return restated(kind, fits) is other

    true, unknowns = record(size=5.0)
    cubic = true.of_effect["stiffness_nonlinearity"]
    wrong = replace(true, data=true.data + 5 * cubic)
    rest = np.random.default_rng(5).standard_normal(cubic.size)
    assert turned_of(wrong, true)
    assert not turned_of(wrong, replace(true, data=true.data + 2 * cubic + 0.3 * rest))
    against = -0.8 * true.of_effect["force_offset"] + 0.3 * rest
    hidden = replace(true, of_effect=true.of_effect | {"stiffness_nonlinearity": against})
    bent = replace(hidden, data=hidden.data + 5 * against)
    assert np.var(bent.data) < 0.5 * np.var(hidden.data), "without effects the record as stated explains more"
    assert turned_of(bent, hidden)
    assert not turned_of(bent, replace(hidden, data=hidden.data + 2 * rest))


@pytest.mark.parametrize(("off", "steps"), [(0.0, [1, STEPS, 1, STEPS]), (50.0, [1])])
def test_a_statement_that_explains_far_less_turned_round_is_fitted_no_further(
    monkeypatch: pytest.MonkeyPatch, off: float, steps: list[int]
) -> None:
    """What no number of the model explains shows behind one step."""
    true, unknowns = record(size=5.0)
    cubic = true.of_effect["stiffness_nonlinearity"]
    wrong = replace(true, data=true.data + 5 * cubic)
    fits = [fit(wrong, with_effect(unknowns, *every), np.zeros(3 + len(every))) for every in ((), (CUBIC,))]
    taken: list[int] = []

    def noted(*args: Any, plan: FitPlan, **more: Any) -> Any:
        taken.append(plan.most_steps)
        return fit(*args, plan=plan, **more)

    monkeypatch.setattr(statements, "fit", noted)
    astray = off * np.random.default_rng(7).standard_normal(cubic.size)
    other: Any = SimpleNamespace(likelihood=replace(true, data=true.data + astray))
    kind: Any = SimpleNamespace(restatements=lambda: (other,))
    assert (in_doubt(kind, fits) is other) == (off == 0.0)
    assert taken == steps[: len(taken)]
    assert len(taken) == (1 if off else 2)


@pytest.mark.parametrize(("share", "given_way"), [(0.03, True), (0.08, False)])
def test_a_statement_may_stand_in_the_place_of_any_effect_whose_nats_it_nearly_brings(
    share: float, given_way: bool
) -> None:
    """A delay that makes up for a wrong hold, beside a little of what the wrong delay leaves to a third effect."""
    true, unknowns = record(size=5.0)
    cubic = true.of_effect["stiffness_nonlinearity"]
    wrong = replace(true, data=true.data + 5 * cubic)
    sets = ((), (CUBIC,), (CUBIC, OFFSET))
    fits = [fit(wrong, with_effect(unknowns, *every), np.zeros(3 + len(every))) for every in sets]
    gain, last = fits[1].log_evidence - fits[0].log_evidence, fits[-1].log_evidence
    rest = np.random.default_rng(5).standard_normal(cubic.size)

    def turned_round(size: float) -> LinearRecord:
        return replace(true, data=true.data + size * rest)

    def lost(size: float) -> float:
        without = with_effect(unknowns, OFFSET)
        return last - fit(turned_round(size), without, np.zeros(4)).log_evidence

    size = brentq(lambda size: lost(size) - share * gain, 0.0, 5.0)
    other: Any = SimpleNamespace(likelihood=turned_round(size))
    kind: Any = SimpleNamespace(restatements=lambda: (other,))
    assert (restated(kind, fits) is other) == given_way


@pytest.mark.parametrize(
    ("doubted", "with_one", "suspected", "in_the_end", "turned"),
    [
        (True, TIE + 1, False, 0.0, True),
        (True, TIE - 1, False, 0.0, False),
        (True, -50.0, True, TIE + 1, True),
        (False, 0.0, True, TIE + 1, True),
        (False, 0.0, True, TIE - 1, False),
        (False, 0.0, False, 0.0, False),
    ],
)
def test_a_statement_in_doubt_is_judged_with_one_effect_and_one_that_an_effect_hides_with_all(
    monkeypatch: pytest.MonkeyPatch, doubted: bool, with_one: float, suspected: bool, in_the_end: float, turned: bool
) -> None:
    """Nats by which the record turned round is ahead, with what either search found."""
    searched: list[str] = []

    def chain(kind: Any, how: DiagnosisSettings, begun: Any = None) -> Any:
        searched.append(kind)
        nats = {"as stated": 0.0, "turned": in_the_end if begun is None and len(searched) > 1 else with_one}[kind]
        return SimpleNamespace(nats=nats, fits=[SimpleNamespace(log_evidence=nats)])

    def first(kind: Any, how: DiagnosisSettings) -> Any:
        nats = {"as stated": 0.0, "turned": with_one}[kind]
        return SimpleNamespace(nats=nats, fits=[SimpleNamespace(log_evidence=nats)])

    monkeypatch.setattr(driver, "_over_its_stretches", lambda kind, how: None)
    monkeypatch.setattr(driver, "first_effect", first)
    monkeypatch.setattr(driver, "search_effects", chain)
    monkeypatch.setattr(driver, "in_doubt", lambda kind, fits: "turned" if doubted else None)
    monkeypatch.setattr(driver, "restated", lambda kind, fits: "turned" if suspected else None)
    kind, _ = driver._searched("as stated", DiagnosisSettings())  # type: ignore[arg-type]
    assert kind == ("turned" if turned else "as stated")
    judged_at_once = doubted and with_one > TIE
    assert searched == (["turned"] if judged_at_once else ["as stated", *(["turned"] if suspected else [])])


def test_a_statement_is_in_doubt_where_turned_round_it_explains_more_without_effects() -> None:
    true, unknowns = record(size=5.0)
    wrong = replace(true, data=true.data + 5 * true.of_effect["stiffness_nonlinearity"])
    for stated, turned, doubted in ((wrong, true, True), (true, wrong, False), (wrong, wrong, False)):
        other: Any = SimpleNamespace(likelihood=turned)
        kind: Any = SimpleNamespace(restatements=lambda other=other: (other,))
        assert (in_doubt(kind, [fit(stated, unknowns, np.zeros(3))]) is other) == doubted


@pytest.mark.parametrize(("case", "doubted"), [("made up for", True), ("beside an effect", True), ("true", False)])
def test_a_statement_that_is_better_without_effects_alone_is_not_in_doubt(case: str, doubted: bool) -> None:
    """Turned round the record explains a part of what is left. Where the first effect has made up for a wrong
    statement, or stands beside it, turned round it leaves less without that effect or with it; where the statement is
    true, it is the worse one only as long as the effect is not there."""
    true, unknowns = record(size=5.0)
    cubic = true.of_effect["stiffness_nonlinearity"]
    half, rest = np.arange(cubic.size) % 2 * cubic, np.random.default_rng(5).standard_normal(cubic.size)
    stated, turned = {
        "made up for": (5 * half, 0 * cubic),
        "beside an effect": (5 * cubic + 4 * rest, 5 * cubic),
        "true": (5 * cubic, 3 * half),
    }[case]
    fits = [
        fit(replace(true, data=true.data + stated), with_effect(unknowns, *every), np.zeros(3 + len(every)))
        for every in ((), (CUBIC,))
    ]
    other: Any = SimpleNamespace(likelihood=replace(true, data=true.data + turned))
    kind: Any = SimpleNamespace(restatements=lambda: (other,))
    assert in_doubt(kind, fits[:1]) is other, "better without effects"
    assert (in_doubt(kind, fits) is other) == doubted
