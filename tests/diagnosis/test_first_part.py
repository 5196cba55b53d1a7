"""Candidates looked at over the first part of a long record, and what of it the whole record takes over."""

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import levitator
import numpy as np
import pytest
from conftest import ROOT
from numpy.typing import NDArray

from msl_fem.actuator import load_actuator
from msl_fem.computing.laws import expression
from msl_fem.diagnosis import first_part, formula_search, refinement, search
from msl_fem.diagnosis.effect_search import without_effects
from msl_fem.diagnosis.fit import FitPlan, fit, fit_there
from msl_fem.diagnosis.fit_memory import FitMemory
from msl_fem.diagnosis.kind import about_belief
from msl_fem.diagnosis.likelihood import Fit, Likelihood
from msl_fem.diagnosis.problem import Points
from msl_fem.diagnosis.refinement import NEAR, Refinement
from msl_fem.diagnosis.refits import LAST_STEPS, Refit
from msl_fem.diagnosis.runs import Runs, dynamic_runs
from msl_fem.diagnosis.settings import DiagnosisSettings
from msl_fem.diagnosis.variants import Variant
from msl_fem.plant import lane_run
from msl_fem.plant.effects import declared
from msl_fem.plant.lane_block import Lanes
from msl_fem.plant.segments import Segment, segments_for
from msl_fem.prediction import ModelHypothesis, run_data

PART = 1000  # samples


@pytest.fixture(scope="module")
def kind() -> Runs:
    """A ball that rubs, over 2 s in closed loop."""
    base = load_actuator(ROOT / "measurements" / "levitation_rig" / "actuator.toml")
    record = levitator.record(base, levitator.Truth(friction=0.01 * levitator.WEIGHT), seconds=2.0)
    runs = [run_data(record, run) for run in record.runs]
    made = dynamic_runs(record, ModelHypothesis(record.actuator, levitator.table()), runs)
    return made.settled(str)


@pytest.fixture(scope="module")
def base(kind) -> Fit:
    return without_effects(kind, DiagnosisSettings())


@pytest.fixture
def long(monkeypatch) -> None:
    """The record counts as one."""
    monkeypatch.setattr("msl_fem.diagnosis.likelihood.SAMPLES", PART)
    monkeypatch.setattr(first_part, "PLENTY", 10.0)


def test_the_numbers_of_the_first_stretches_are_those_of_the_whole(kind, long) -> None:
    """Whatever comes behind; bit by bit, of moved starts as well."""
    whole, unknowns = kind.likelihood, kind.unknowns
    part, numbers = whole.first_part()
    [run], [cut] = part.problem.runs, part.problem.stretches
    assert 0.7 * PART <= len(run.commands) <= 1.3 * PART
    assert cut is not None
    assert len(run.commands) in kind.likelihood.problem.stretches[0].begins
    rows = np.zeros((2, unknowns.size))
    rows[1, 0] = 1.0
    starts = tuple(own + 1e-5 for own in whole.problem.starts(1))
    own = tuple(one[:, : cut.begins.size] for one in starts)
    for of_all, of_part in ((None, None), (starts, own)):
        every = whole.spectra(Points.of(unknowns, rows, of_all))
        assert np.array_equal(part.spectra(Points.of(unknowns, rows, of_part)), every[:, numbers])
    assert numbers.sum() == part.labels.size < 0.5 * numbers.size
    assert np.array_equal(part.labels, whole.labels[numbers])


@pytest.mark.parametrize(("count", "threads", "segments"), [(1, 1, 8), (3, 2, 5), (9, 2, 8)])
def test_few_rows_are_followed_in_segments_by_all_threads(
    kind: Runs, count: int, threads: int, segments: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Their numbers are those of runs in one piece."""
    likelihood = replace(kind.likelihood, problem=replace(kind.likelihood.problem, threads=threads))
    rows = np.zeros((count, kind.unknowns.size))
    rows[:, 0] = np.linspace(0.0, 1.0, count)
    points, cut = Points.of(kind.unknowns, rows), []

    def counted(lanes: Lanes, which: NDArray[np.intp]) -> list[Segment]:
        found = segments_for(lanes, which)
        cut.append(len(found))
        return found

    monkeypatch.setattr(lane_run, "segments_for", counted)
    found = likelihood.spectra(points)
    assert max(cut) == segments  # the ninth row has a thread of its own
    monkeypatch.setattr(lane_run, "segments_for", lambda *_: [None])
    whole = likelihood.spectra(points)
    assert np.abs(found - whole).max() < 1e-9 * np.abs(whole).max()


def test_a_fit_over_stretches_ends_once_it_has_come_to_what_is_asked(kind: Runs, base: Fit) -> None:
    start = base.z + 1.0
    whole = fit(base.likelihood, base.unknowns, start, plan=FitPlan(enough=1e-3))
    asked = whole.log_evidence - 5.0
    found = fit(base.likelihood, base.unknowns, start, plan=FitPlan(enough=1e-3, until=asked))
    assert found.log_evidence > asked
    assert found.simulations < whole.simulations
    more = fit(base.likelihood, base.unknowns, start, plan=FitPlan(enough=1e-3, until=whole.log_evidence + 10.0))
    assert more.log_evidence == pytest.approx(whole.log_evidence, abs=1.0)


def test_a_fit_that_has_not_gone_anywhere(kind, base) -> None:
    """Is at its numbers, with the columns that it was given, and knows what a step promises."""
    there = fit_there(base.likelihood, base.unknowns, base.z, base.jacobian)
    assert np.array_equal(there.z, base.z)
    assert there.objective == pytest.approx(base.likelihood.objective(base.unknowns, base.z), abs=1.0)
    assert np.array_equal(there.jacobian, base.jacobian)
    on = fit(base.likelihood, base.unknowns, base.z, plan=FitPlan(1, enough=1e9, fresh_end=False), goes_on=there)
    assert on.simulations == 0


@pytest.mark.parametrize("short", ["samples", "nats", "noise", "stretches"])
def test_a_short_record_or_one_that_tells_little_is_looked_at_as_a_whole(base, long, monkeypatch, short: str) -> None:
    assert first_part._over_first_part(base) is not None
    if short == "samples":
        monkeypatch.setattr("msl_fem.diagnosis.likelihood.SAMPLES", 3000)
    if short == "nats":
        monkeypatch.setattr(first_part, "PLENTY", 1e5)
    if short == "noise":
        base = replace(base)
        base.__dict__["excess"] = {"position_m": 1.05}
    if short == "stretches":
        monkeypatch.setattr(Likelihood, "is_cut", False)
    assert first_part._over_first_part(base) is None


def test_the_fit_over_the_first_part_is_at_its_end_there(base, long) -> None:
    """And so is what a lost one was last at that a plant can have: that stays where it was."""
    found = first_part._over_first_part(base)
    assert found is not None
    assert found.predicted < 10.0
    assert found.sane is None
    lost = first_part._over_first_part(replace(base, sane=base))
    assert lost is not None
    assert lost.sane is not None
    assert np.array_equal(lost.sane.z, base.z)
    assert lost.sane.residual.size == lost.residual.size == found.residual.size


def test_what_a_lost_fit_was_last_at_begins_where_its_own_stretches_do(base, long) -> None:
    """From where those of the lost model begin it may pull in at once, and there is no fit there."""
    starts = tuple(own + 1e-9 for own in base.likelihood.problem.starts(1))
    sane = replace(base, likelihood=base.likelihood.starting(starts))
    lost = first_part._over_first_part(replace(base, sane=sane))
    assert lost is not None
    assert lost.sane is not None
    own, numbers = sane.likelihood.first_part()
    assert lost.sane.objective == pytest.approx(own.objective(sane.unknowns, sane.z))
    every = sane.likelihood.spectra(Points.of(sane.unknowns, sane.z[None]))[0]
    assert np.array_equal(lost.sane.residual, every[numbers])
    assert not np.array_equal(lost.sane.residual, base.residual[numbers])


def test_a_cause_is_the_same_by_either_way(kind, base, long, monkeypatch) -> None:
    """Its gain too, but for what a further step would bring."""
    names = ("coulomb_friction", "stiffness_nonlinearity", "fringing")
    tried = [one for one in about_belief(kind, base) if one.effect in names]
    sizes: list[int] = []
    plain = Refinement.screened

    def noted(self: Refinement, score: Any) -> Any:
        sizes.append(self.base.residual.size)
        return plain(self, score)

    monkeypatch.setattr(Refinement, "screened", noted)
    by_part = search.search_stage(base, tried, tell=str)
    small, large = min(sizes), max(sizes)
    assert small < large == base.residual.size
    assert sizes.count(small) > sizes.count(large) > 0, "all over the part, those that lead over all of it"
    sizes.clear()
    monkeypatch.setattr("msl_fem.diagnosis.likelihood.SAMPLES", 10**6)
    as_a_whole = search.search_stage(base, tried, tell=str)
    assert set(sizes) == {large}
    best, other = by_part.best, as_a_whole.best
    assert best is not None
    assert other is not None
    assert best.variant.effect == other.variant.effect == "coulomb_friction"
    assert best.gain == pytest.approx(other.gain, abs=6.0)
    assert best.fit.residual.size == large
    told = {one.variant for one in by_part.refits}
    assert {one.variant for one in as_a_whole.refits if one.gain > 0.5 * other.gain} <= told


FRICTION, MODE, LAG, REMANENCE = (
    Variant(name, ()) for name in ("coulomb_friction", "structural_mode", "time_delay", "remanent_flux")
)


class Asked:
    """A refinement that makes of candidates what it is told, and notes of which it was asked."""

    is_near, lags = Refinement.is_near, Refinement.lags

    def __init__(
        self, gains: dict[Variant, float], *, takes: bool, lost: bool = False, takes_nearly: bool = False
    ) -> None:
        self.gains, self.takes, self.lost, self.asked = gains, takes, lost, list[list[Variant]]()
        self.takes_nearly = takes_nearly
        self.told: dict[str, Any] = {}

    def best_first(self, candidates: list[Any], led: Sequence[Refit] = ()) -> list[Refit]:
        self.asked.append([one.variant for one in candidates])
        fits: Any = [SimpleNamespace(z=np.zeros(1), lets_go=lambda: None) for _ in candidates]
        every = [Refit(one.variant, own, self.gains[one.variant]) for one, own in zip(candidates, fits, strict=True)]
        return sorted([*led, *every], key=lambda one: -one.gain)

    def takes_all(self, refit: Refit) -> bool:
        return self.takes

    def takes_nearly_all(self, refit: Refit) -> bool:
        return self.takes_nearly


@pytest.mark.parametrize(("part_takes", "whole_takes"), [(True, True), (True, False), (False, True)])
@pytest.mark.parametrize("lost", [False, True])
def test_what_leads_over_the_part_is_asked_first_and_the_whole_decides(
    monkeypatch, part_takes: bool, whole_takes: bool, lost: bool
) -> None:
    """Beside a model that is lost wherever it leads to; what is near it there comes less near. What has come to its end
    over the whole record is not asked of it once more: a drive's limit of 425 000 nats left a little more than noise,
    its second beginning could not be simulated, and no name was told."""
    gains = {FRICTION: 1000.0, MODE: 900.0 if lost else 1000.0 - NEAR / 2, LAG: 600.0}
    part = Asked(gains, takes=part_takes, lost=lost)
    part_takes |= lost
    whole = Asked({name: 4 * gain for name, gain in gains.items()}, takes=whole_takes, lost=lost)
    monkeypatch.setattr(first_part, "_over_first_part", lambda base: SimpleNamespace(residual=np.zeros(25)))
    base: Any = SimpleNamespace(residual=np.zeros(100), unknowns=SimpleNamespace(effects=()))

    def beside(found: Any, **told: Any) -> Any:
        own = part if found is not base else whole
        own.told = told
        return own

    candidates: Any = [SimpleNamespace(variant=one) for one in (LAG, MODE, FRICTION)]
    found = first_part.best_first(base, candidates, beside, FitMemory())
    every, near, rest = [LAG, MODE, FRICTION], [MODE, FRICTION], [LAG]
    assert part.asked == [every]
    assert set(whole.told["ends"]) == set(every)
    assert whole.asked == ([near] if part_takes and whole_takes else [near, rest] if part_takes else [every])
    assert [one.variant for one in found] == [FRICTION, MODE, LAG]
    behind = 4000.0 - 4 * 400.0 if part_takes and whole_takes else 2400.0
    assert found[2].gain == pytest.approx(behind), "as if the rest of the record were like its part"


@pytest.mark.parametrize(("nearly", "lost"), [(True, False), (False, False), (True, True)])
def test_what_lags_far_behind_over_the_part_is_not_looked_at_beside_what_leaves_little_of_the_whole(
    monkeypatch, nearly: bool, lost: bool
) -> None:
    """Though that bends what is believed, as a drive's limit does: over the whole record it would be eliminated as over
    the part. Not so what the leader may stand in for, nor beside a model that is lost, whose nats mean little."""
    gains = {FRICTION: 1000.0, MODE: 300.0, LAG: 200.0, REMANENCE: 100.0}
    part = Asked(gains, takes=True, lost=lost)
    whole = Asked({name: 4 * gain for name, gain in gains.items()}, takes=False, lost=lost, takes_nearly=nearly)
    monkeypatch.setattr(first_part, "_over_first_part", lambda base: SimpleNamespace(residual=np.zeros(25)))
    base: Any = SimpleNamespace(residual=np.zeros(100), unknowns=SimpleNamespace(effects=()))
    candidates: Any = [SimpleNamespace(variant=one) for one in gains]
    found = first_part.best_first(base, candidates, lambda own, **told: whole if own is base else part, FitMemory())
    rest = [MODE, REMANENCE] if nearly and not lost else [MODE, LAG, REMANENCE]
    assert whole.asked == [[FRICTION], rest]
    assert sorted((one.variant.effect, one.gain) for one in found) == [
        ("coulomb_friction", 4000.0),
        ("remanent_flux", 400.0),
        ("structural_mode", 1200.0),
        ("time_delay", 4000.0 - 4 * 800.0),
    ]


def test_a_candidate_begins_where_it_came_to_over_the_part_if_that_is_better(base, monkeypatch) -> None:
    """Beside stretches that begin as they do, else where they suit it; from its score where neither is."""
    variant = Variant("gap_offset", ())
    refinement = Refinement(base, str, FitMemory(), ends={variant: base.z})
    costs = iter([base.objective - 1.0])
    moved: list[int] = []

    def followed(self: Likelihood, unknowns: Any, z: np.ndarray) -> Likelihood:
        moved.append(1)
        return self

    monkeypatch.setattr(Likelihood, "objective", lambda self, unknowns, z: next(costs))
    monkeypatch.setattr(Likelihood, "followed", followed)
    near, z = refinement._known_of_part(variant)
    assert near is base
    assert z is base.z
    assert not moved
    costs = iter([np.inf, base.objective - 1.0])
    near, z = refinement._known_of_part(variant)
    assert near is not base
    assert z is base.z
    assert moved
    costs = iter([np.inf, base.objective + 1.0])
    assert refinement._known_of_part(variant) == (base, None)
    assert refinement._known_of_part(Variant("fringing", ())) == (base, None)


def test_what_begins_once_more_as_believed_is_led_over_the_part_before_the_whole(kind, base, long, monkeypatch) -> None:
    """And comes to the same end as over the whole alone, in fewer simulations of all of it."""
    [variant] = [one for one in about_belief(kind, base) if one.name.startswith("coulomb_friction (force; transition")]
    race, plan = Refinement(base, str, FitMemory()), FitPlan(LAST_STEPS, enough=0.5)
    leader = race.screened(search.scored(base, [variant]).scores[0])
    assert leader is not None
    fits: list[Fit] = []
    plain = refinement.fit

    def noted(*numbers: Any, **told: Any) -> Fit:
        fits.append(plain(*numbers, **told))
        return fits[-1]

    monkeypatch.setattr(refinement, "fit", noted)
    by_part = race._as_believed(leader, variant, plan)
    part, whole = fits
    assert part.residual.size < 0.5 * whole.residual.size == 0.5 * base.residual.size
    monkeypatch.setattr("msl_fem.diagnosis.likelihood.SAMPLES", 10**6)
    at_once = race._as_believed(leader, variant, plan)
    assert at_once is not None
    assert by_part is not None
    assert by_part.fit.objective == pytest.approx(at_once.fit.objective, abs=1.0)
    assert whole.simulations < fits[2].simulations


def test_terms_of_a_formula_are_scored_over_the_part_as_if_the_rest_were_like_it(base, long, monkeypatch) -> None:
    rub = expression("rub", "force", "-a*tanh(v/w)", {"a": "0..1 N", "w": "0.1..10 mm/s"})
    part, null = formula_search._scored(base, [rub])
    assert null.gains.size
    with monkeypatch.context() as short:
        short.setattr(formula_search, "in_first_part", lambda found: None)
        whole, _ = formula_search._scored(base, [rub])
    assert part[0].gain == pytest.approx(whole[0].gain, rel=0.5)
    asked: list[int] = []
    monkeypatch.setattr(formula_search, "signatures", lambda found, amounts: asked.append(found.residual.size) or 1 / 0)
    with pytest.raises(ZeroDivisionError):
        formula_search._scored(base, [rub])
    assert asked[0] < 0.7 * base.residual.size


def test_a_term_without_a_prospect_over_the_part_is_not_looked_at_over_all(base, long, monkeypatch) -> None:
    """That of friction is, from where it came to over the part, if it is asked for nine tenths of what is above noise;
    a damper is not. Where nothing is asked of them both are."""
    rub = expression("rub", "force", "-a*tanh(v/w)", {"a": "0..1 N", "w": "0.1..10 mm/s"})
    damping = expression("damping", "force", "-a*v", {"a": "0..10 N s/m"})
    scores, _ = formula_search._scored(base, [rub, damping])
    best = list(formula_search._first_of_each(scores).values())
    looked: list[tuple[str, int, bool]] = []
    plain = Refinement.screened

    def noted(self: Refinement, score: Any) -> Any:
        begins = score.variant in self.ends
        looked.append((score.variant.effect, self.base.residual.size, begins))
        return plain(self, score)

    monkeypatch.setattr(Refinement, "screened", noted)
    with declared(rub, damping):
        [found] = formula_search._refits(base, best, (), str, 0.9 * base.nats_above_noise)
    assert found.variant.effect == rub.effect
    assert found.fit.residual.size == base.residual.size
    assert found.gain > 0.9 * base.nats_above_noise
    over_all = [(effect, begins) for effect, size, begins in looked if size == base.residual.size]
    assert over_all == [(rub.effect, True)]
    assert {effect for effect, *_ in looked} == {rub.effect, damping.effect}
    monkeypatch.setattr(formula_search, "_hopeless", lambda *_: False)
    looked.clear()
    with declared(rub, damping):
        formula_search._refits(base, best, (), str, 0.0)
    over_all = [(effect, begins) for effect, size, begins in looked if size == base.residual.size]
    assert dict(over_all) == {rub.effect: True, damping.effect: True}
