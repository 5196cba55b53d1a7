"""Columns of amounts at one fit do for the scores of another that leaves noise alone."""

from dataclasses import replace

import numpy as np
import pytest
from linear_record import CUBIC, OFFSET, LinearRecord, record, with_effect

from msl_fem.diagnosis.fit import fit
from msl_fem.diagnosis.likelihood import Fit
from msl_fem.diagnosis.refits import BENT, STRAINED, started
from msl_fem.diagnosis.scores import AmountColumns, Score, scored
from msl_fem.diagnosis.search import scored_where_likely, search_stage
from msl_fem.diagnosis.unknowns import EffectUnknown, Unknowns
from msl_fem.diagnosis.variants import Variant

VARIANTS = [Variant(one.effect, (one,)) for one in (OFFSET, CUBIC)]


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """How many points were simulated, each time."""
    found: list[int] = []
    plain = LinearRecord.spectra

    def counted(likelihood: LinearRecord, points):
        found.append(len(points.rows))
        return plain(likelihood, points)

    monkeypatch.setattr(LinearRecord, "spectra", counted)
    return found


def with_offset(size: float, cubic: float = 0.0) -> tuple[Fit, Fit]:
    """Fits of a record without its force offset and with it."""
    it, unknowns = record(seed=7, size=size)
    it = replace(it, data=it.data + cubic * it.of_effect["stiffness_nonlinearity"])
    without = fit(it, unknowns, np.zeros(3))  # type: ignore[arg-type]
    return without, fit(it, with_effect(unknowns, OFFSET), np.zeros(4))  # type: ignore[arg-type]


def columns_of(found: Fit, variants: list[Variant] = VARIANTS) -> AmountColumns:
    columns = scored(found, variants).columns
    assert columns is not None
    return columns


def test_columns_of_a_fit_score_another_without_a_simulation(asked) -> None:
    without, beside = with_offset(0.3, cubic=0.1)
    near = columns_of(without)
    exact = scored(beside, VARIANTS[1:])
    asked.clear()
    rough = scored(beside, VARIANTS[1:], near=near)
    assert not asked
    assert rough.scores[0].gain == pytest.approx(exact.scores[0].gain, rel=1e-4)
    assert rough.scores[0].guess == pytest.approx(exact.scores[0].guess, rel=1e-4)
    assert rough.scores[0].gain > 10


def test_amounts_of_which_there_are_no_columns_are_simulated(asked) -> None:
    without, _ = with_offset(0.1, cubic=0.1)
    near = columns_of(without, VARIANTS[:1])
    asked.clear()
    rough = scored(without, VARIANTS, near=near)
    assert asked == [1], "the cubic spring"
    exact = {score.variant: score.gain for score in scored(without, VARIANTS).scores}
    assert {score.variant: score.gain for score in rough.scores} == pytest.approx(exact, rel=1e-4)


def test_columns_over_other_stretches_do_not_do(asked) -> None:
    without, beside = with_offset(0.3)
    near = replace(columns_of(without), begins=(b"other",))
    asked.clear()
    scored(beside, VARIANTS[1:], near=near)
    assert asked == [1]


@pytest.mark.parametrize(("cubic", "refitted"), [(0.0, 0), (0.07, 0), (0.2, 1)])
def test_behind_a_first_effect_that_leaves_noise_nothing_is_refitted_that_cannot_count(
    asked, cubic: float, refitted: int
) -> None:
    without, beside = with_offset(0.3, cubic)
    near = columns_of(without)
    assert (scored(beside, VARIANTS[1:]).scores[0].gain > 2.0) == bool(cubic)
    assert max(beside.excess.values()) < 1.05
    asked.clear()
    stage = search_stage(beside, VARIANTS[1:], tell=str, needed=lambda variant: 24.0, near=near)
    assert len(stage.refits) == refitted
    assert bool(asked) == bool(refitted)
    assert [score.variant for score in stage.scores] == VARIANTS[1:]


def test_where_some_can_count_these_alone_are_scored_once_more(asked) -> None:
    """Beside what gap, scale and gains make up for, which a score may miss; the next stage takes the columns of all."""
    without, beside = with_offset(0.3, 0.2)
    friction, gap = EffectUnknown("coulomb_friction", "force"), EffectUnknown("gap_offset", "offset")
    tried = [*VARIANTS[1:], *(Variant(one.effect, (one,)) for one in (friction, gap))]
    near = replace(columns_of(without), places={(CUBIC, ()): 1, (friction, ()): 0, (gap, ()): 0})
    asked.clear()
    stage = search_stage(
        beside, tried, tell=str, needed=lambda variant: 24.0 if variant == tried[0] else 1e9, near=near
    )
    assert asked[0] == 2, "cubic spring and gap"
    assert stage.refits[0].variant == tried[0]
    assert stage.columns is near
    assert near.suit(beside)


def test_beside_noise_all_are_scored_exactly_where_parameters_are_bent(monkeypatch) -> None:
    """Columns of a stage before may be from far away: here they are those of another effect."""
    monkeypatch.setattr("msl_fem.diagnosis.search.LIKELY", 0)
    monkeypatch.setattr("msl_fem.diagnosis.search.strained", lambda found, tolerances=STRAINED: tolerances == BENT)
    without, beside = with_offset(0.3, 0.2)
    near = replace(columns_of(without), places={(CUBIC, ()): 0})
    assert scored(beside, VARIANTS[1:], near=near).scores[0].gain < 5.0
    stage = search_stage(beside, VARIANTS[1:], tell=str, needed=lambda variant: 24.0, near=near)
    assert [one.variant for one in stage.refits] == VARIANTS[1:]
    assert not near.weighted.size, "nobody asks for them any more, and whoever has these has no memory by it"
    assert not near.suit(beside)
    assert stage.columns is not None
    assert stage.columns.suit(beside)


def test_where_more_than_noise_is_left_what_is_not_among_the_best_keeps_its_rough_score(asked, monkeypatch) -> None:
    """And what gap, scale and gains nearly make up for is scored exactly whatever its place: here it shows nothing."""
    monkeypatch.setattr("msl_fem.diagnosis.search.LIKELY", 1)
    without, beside = with_offset(0.3, cubic=0.1)
    friction, gap = EffectUnknown("coulomb_friction", "force"), EffectUnknown("gap_offset", "offset")
    tried = [*VARIANTS[1:], *(Variant(one.effect, (one,)) for one in (friction, gap))]
    near = replace(columns_of(without), places={(CUBIC, ()): 1, (friction, ()): 0, (gap, ()): 0})
    rough = {score.variant: score.gain for score in scored(beside, tried, near=near).scores}
    [exact] = scored(beside, tried).scores
    asked.clear()
    found = scored_where_likely(beside, tried, near)
    assert asked == [2], "cubic spring and gap"
    assert found.columns is near
    cubic, of_friction = found.scores
    assert (cubic.variant, cubic.gain) == (exact.variant, exact.gain)
    assert (of_friction.variant, of_friction.gain) == (tried[1], rough[tried[1]])
    assert cubic.gain != rough[tried[0]]
    asked.clear()
    assert len(scored_where_likely(beside, tried, replace(near, begins=(b"other",))).scores) == 1
    assert asked == [len(tried)]


def test_what_is_simulated_for_a_rough_score_is_not_simulated_once_more(asked) -> None:
    without, beside = with_offset(0.3, cubic=0.1)
    near = columns_of(without, VARIANTS[:1])
    asked.clear()
    found = scored_where_likely(beside, VARIANTS, near)
    assert asked == [1, 1], "the cubic spring, then the offset"
    exact = {score.variant: score.gain for score in scored(beside, VARIANTS).scores}
    assert {score.variant: score.gain for score in found.scores} == pytest.approx(exact, rel=1e-4)


class _Steep(LinearRecord):
    """A record in which more than a little of an amount cannot be simulated."""

    def spectra(self, points):
        found = super().spectra(points)
        amounts = np.array([CUBIC.z_of(float(effects[CUBIC.place])) for effects in points.effects])
        found[np.abs(amounts) > 0.15] = np.nan
        return found


class _Bent(LinearRecord):
    """A record in which more than a little of an amount does harm."""

    def spectra(self, points):
        found = super().spectra(points)
        amounts = np.array([CUBIC.z_of(float(effects[CUBIC.place])) for effects in points.effects])
        return found + 5.0 * (np.abs(amounts) > 0.15)[:, None]


class _Dear(LinearRecord):
    """A record in which any amount costs more than half of what the best one brings."""

    def spectra(self, points):
        found = super().spectra(points)
        amounts = np.array([CUBIC.z_of(float(effects[CUBIC.place])) for effects in points.effects])
        return found + DEAR * (amounts != 0.0)[:, None] * (-1.0) ** np.arange(found.shape[1])


DEAR = 0.2


@pytest.mark.parametrize(("kind", "times"), [(LinearRecord, [1]), (_Steep, [1, 7]), (_Bent, [1, 7]), (_Dear, [1, 7])])
def test_a_refit_begins_at_the_linear_model_s_best_where_that_holds_and_looks_around_where_not(
    asked, kind: type[LinearRecord], times: list[int]
) -> None:
    it, unknowns = record(seed=7, size=0.2, of="stiffness_nonlinearity")
    base = fit(it, unknowns, np.zeros(3))  # type: ignore[arg-type]
    [score] = scored(base, VARIANTS[1:]).scores
    steep = kind(it.data, it.nuisances, it.of_effect)
    asked.clear()
    begin = started(base, score, steep)  # type: ignore[arg-type]
    assert asked == times
    if kind in (LinearRecord, _Dear):
        assert begin.tolist() == [*(base.z + score.shift), *score.guess]
    else:
        assert 0.02 < begin[-1] / score.guess[0] < 0.76


def test_the_whole_way_is_asked_at_the_bounds_of_the_amounts() -> None:
    """A guess beyond them begins at them."""
    unknowns = Unknowns((("moving_mass", 0.01),), 0, ())
    friction = EffectUnknown("coulomb_friction", "force")
    it = LinearRecord(np.random.default_rng(1).standard_normal(400), np.zeros((400, 1)), {})
    base = fit(it, unknowns, np.zeros(1))  # type: ignore[arg-type]
    score = Score(Variant("coulomb_friction", (friction,)), 0.0, np.array([-3.0]), np.zeros(1), np.eye(1))
    assert started(base, score, it)[-1] >= friction.bounds[0]  # type: ignore[arg-type]
