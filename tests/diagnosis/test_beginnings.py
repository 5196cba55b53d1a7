"""A search begun once more with what came near, where the first one leaves more than noise."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from msl_fem.diagnosis import effect_search
from msl_fem.diagnosis.effect_search import BEGINNINGS, NEARLY, Chain, _beginnings, _begun_with, _Doubt, search_effects
from msl_fem.diagnosis.refinement import Refinement
from msl_fem.diagnosis.refits import Refit
from msl_fem.diagnosis.search import SearchStage
from msl_fem.diagnosis.settings import DiagnosisSettings
from msl_fem.diagnosis.variants import Variant


def fit_of(*effects: str, nats: float = 0.0, loud: float = 3.0) -> Any:
    unknowns = SimpleNamespace(effects=tuple(SimpleNamespace(effect=name) for name in effects))
    return SimpleNamespace(unknowns=unknowns, log_evidence=nats, excess={"x": loud}, sane=None)


def stage(base: Any, **gains: float) -> SearchStage:
    refits = [Refit(Variant(name, ()), fit_of(name, nats=gain), gain) for name, gain in gains.items()]
    return SearchStage(base, (), tuple(refits))


def searched() -> Chain:
    """A delay stands for two lags; a film beside it is most probable, an offset takes most of what is left."""
    first = stage(fit_of(), time_delay=8000.0, position_sensor_lag=4600.0, amplifier_bandwidth=3900.0, fringing=10.0)
    last = fit_of("time_delay", "squeeze_film", nats=8200.0)
    second = stage(first.refits[0].fit, squeeze_film=200.0, force_offset=150.0)
    return Chain((first.base, first.refits[0].fit, last), (first, second))


def test_what_brought_nearly_as_much_is_a_beginning_unless_it_came_behind() -> None:
    assert 4600.0 / 8000.0 > NEARLY > 3900.0 / 8000.0
    assert [(n, one.variant.effect) for n, one in _beginnings(searched())] == [(0, "position_sensor_lag")]
    chain = searched()
    behind = replace(chain, fits=(*chain.fits[:2], fit_of("time_delay", "position_sensor_lag")))
    assert _beginnings(behind) == []
    assert _beginnings(replace(chain, fits=chain.fits[:1], stages=chain.stages[:1])) == [], "nothing was found"
    lost = fit_of()
    lost.sane = lost
    assert _beginnings(replace(chain, fits=(lost, *chain.fits[1:]))) == [], "beside it no gain means anything"


def test_what_takes_most_where_another_is_most_probable_is_the_first_beginning() -> None:
    chain = replace(searched(), doubt=_Doubt(1, "force_offset"))
    assert [(n, one.variant.effect) for n, one in _beginnings(chain)] == [
        (1, "force_offset"),
        (0, "position_sensor_lag"),
    ]
    assert BEGINNINGS == 2


def test_a_beginning_is_led_to_its_end_and_stands_first(monkeypatch: pytest.MonkeyPatch) -> None:
    chain = searched()
    led = Refit(Variant("force_offset", ()), fit_of("time_delay", "force_offset", nats=8190.0), 190.0)
    over_all: list[Refit] = []
    monkeypatch.setattr(Refinement, "__init__", lambda self, *one: None)
    monkeypatch.setattr(Refinement, "over_all", lambda self, one: over_all.append(one) or one)
    monkeypatch.setattr(Refinement, "converged", lambda self, one, *, leads: led if leads and over_all else one)
    begun = _begun_with(chain.stages[1].refits[1], chain, 1, DiagnosisSettings())
    assert begun.fits == (*chain.fits[:2], led.fit)
    assert begun.stages[0] is chain.stages[0]
    assert [one.variant.effect for one in begun.stages[1].refits] == ["force_offset", "squeeze_film"]


@pytest.mark.parametrize(
    ("first_left", "again", "named"),
    [(3.0, 8400.0, "position_sensor_lag"), (3.0, 8200.5, "time_delay"), (1.05, 8400.0, "time_delay")],
    ids=["more probable", "as probable", "the first leaves noise alone"],
)
def test_the_most_probable_set_counts(
    monkeypatch: pytest.MonkeyPatch, first_left: float, again: float, named: str
) -> None:
    chain = searched()
    chain.fits[-1].excess["x"] = first_left
    other = stage(fit_of(), position_sensor_lag=4600.0)
    second = Chain((chain.fits[0], fit_of("position_sensor_lag", nats=again)), (other,))
    forward = iter([chain, second])
    monkeypatch.setattr(effect_search, "_forward", lambda kind, how, begun: next(forward))
    monkeypatch.setattr(effect_search, "_put_right", lambda kind, how, begun: begun)
    monkeypatch.setattr(effect_search, "_begun_with", lambda *one: second)
    monkeypatch.setattr(Chain, "told", lambda self, rule: self.stages[0].best.variant.effect)
    kind: Any = SimpleNamespace(rule=lambda rule: rule)
    assert search_effects(kind, DiagnosisSettings(), chain) == named


def test_a_search_goes_on_behind_its_first_effect_and_not_behind_none(monkeypatch: pytest.MonkeyPatch) -> None:
    """A first stage that brought nothing that counts is the end."""
    chain = searched()
    none = Chain(chain.fits[:1], chain.stages[:1])
    monkeypatch.setattr(effect_search, "search_stage", lambda *one, **more: pytest.fail("nothing is looked for"))
    kind: Any = SimpleNamespace(rule=lambda rule: rule)
    assert effect_search._forward(kind, DiagnosisSettings(), none) is none
    assert none.ended
    assert not Chain(chain.fits[:2], chain.stages[:1]).ended


@pytest.mark.parametrize(("left", "goes_on"), [(2.95, False), (1.05, True)], ids=["hardly less", "noise alone"])
def test_a_search_ends_before_a_weak_effect_that_takes_too_little(
    monkeypatch: pytest.MonkeyPatch, left: float, goes_on: bool
) -> None:
    """Behind 8000 nats 200 bring nothing down to noise: no set is made of them, that would have to be put right."""
    chain = searched()
    begun = Chain(chain.fits[:2], chain.stages[:1])
    weak = Refit(Variant("squeeze_film", ()), fit_of("time_delay", "squeeze_film", nats=8200.0, loud=left), 200.0)
    weak.fit.to_come, weak.fit.stuck, begun.fits[0].excess["x"] = lambda steps: 0.0, False, 10.0
    begun.fits[1].likelihood = SimpleNamespace(problem=None)
    found = SearchStage(begun.fits[1], (), (weak,))
    monkeypatch.setattr(effect_search, "search_stage", lambda *one, **more: found)
    monkeypatch.setattr(effect_search, "beyond_tolerances", lambda problem, found: found)
    monkeypatch.setattr(effect_search, "in_sight", lambda problem, found: found)
    monkeypatch.setattr(effect_search, "about_belief", lambda kind, fit: [])
    likelihood = SimpleNamespace(problem=None)
    kind: Any = SimpleNamespace(rule=lambda rule: replace(rule, most=2), likelihood=likelihood)
    after = effect_search._forward(kind, DiagnosisSettings(), begun)
    assert len(after.fits) == (3 if goes_on else 2)
    assert after.stages[1].best is not None
    assert after.stages[1].best.gain == 200.0, "it is told what that would bring"
    assert after.told(replace(DiagnosisSettings().rule, most=2)).taken == (2 if goes_on else 1)


@pytest.mark.parametrize(
    ("left", "second", "steps_back"), [(1.05, 20.0, False), (1.05, 400.0, True), (3.0, 20.0, True)]
)
def test_no_step_back_is_taken_from_what_the_first_effect_does_alone(
    monkeypatch: pytest.MonkeyPatch, left: float, second: float, steps_back: bool
) -> None:
    first = stage(fit_of(), coulomb_friction=9850.0)
    behind = stage(first.refits[0].fit, periodic_disturbance=second)
    fits = (first.base, fit_of("coulomb_friction", loud=left), fit_of("coulomb_friction", "periodic_disturbance"))
    gone: list[Any] = []
    exchange = SimpleNamespace(chain=lambda *one: gone.append(one) or (fits, [first, behind]))
    monkeypatch.setattr(effect_search, "Exchange", lambda *_: exchange)
    kind: Any = SimpleNamespace(rule=lambda rule: rule)
    chain = Chain(fits, (first, behind))
    found = effect_search._put_right(kind, DiagnosisSettings(), chain)
    assert found.fits == fits
    assert bool(gone) is steps_back
