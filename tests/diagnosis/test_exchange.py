"""Sets of effects put right, on records that are linear: what made up for others goes, what explains better comes."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from linear_record import BOW, CUBIC, OFFSET, LinearRecord, with_effect

from msl_fem.diagnosis.exchange import Exchange
from msl_fem.diagnosis.fit import fit
from msl_fem.diagnosis.fit_memory import FitMemory
from msl_fem.diagnosis.likelihood import Fit
from msl_fem.diagnosis.problem import Points
from msl_fem.diagnosis.refits import Refit
from msl_fem.diagnosis.scores import Score
from msl_fem.diagnosis.search import SearchStage
from msl_fem.diagnosis.unknowns import EffectUnknown, Unknowns
from msl_fem.diagnosis.variants import Variant

UNKNOWNS = Unknowns((("moving_mass", 0.01),), 0, (0,))
COUNT = 2000


def linear(*, truth: tuple[float, float], mixed: tuple[float, float]) -> LinearRecord:
    """An offset and a cubic of these amounts; a bow is a mixture of the columns of both and of one of its own."""
    chance = np.random.default_rng(3)
    nuisance, offset, cubic, own = chance.standard_normal((4, COUNT))
    bow = mixed[0] * offset + mixed[1] * cubic + 0.3 * own
    data = truth[0] * offset + truth[1] * cubic + chance.standard_normal(COUNT)
    columns = {"force_offset": offset, "stiffness_nonlinearity": cubic, "position_sensor_nonlinearity": bow}
    return LinearRecord(data, nuisance[:, None], columns)


def searched(record: LinearRecord, *chosen: EffectUnknown, rivals: tuple[EffectUnknown, ...] = ()):
    """Fits and stages of a search that took these effects in this order, and tried rivals at its first stage."""
    fits = [fit(record, UNKNOWNS, np.zeros(1))]
    stages = []
    for n in range(len(chosen)):
        base = fits[-1]

        def refit(one: EffectUnknown, before: tuple[EffectUnknown, ...] = chosen[:n], base=base) -> Refit:
            unknowns = with_effect(UNKNOWNS, *before, one)
            found = fit(record, unknowns, np.zeros(unknowns.size))
            return Refit(Variant(one.effect, (one,)), found, found.log_evidence - base.log_evidence)

        refits = [refit(chosen[n]), *(refit(one) for one in rivals if n == 0)]
        fits.append(refits[0].fit)
        stages.append(SearchStage(base, (), tuple(refits)))
    return fits, stages


def put_right(fits, stages):
    """None where the set stays."""
    chain, made = Exchange(12.0, 1.0, lambda text: None, FitMemory()).chain(fits, stages)
    return None if chain[-1] is fits[-1] else (chain, made)


def test_what_made_up_for_two_others_goes_once_both_are_there() -> None:
    fits, stages = searched(linear(truth=(0.4, 0.6), mixed=(0.5, 0.5)), BOW, CUBIC, OFFSET)
    assert stages[0].best.gain > 100.0
    better = put_right(fits, stages)
    assert better is not None
    chain, made = better
    assert [stage.best.variant.effect for stage in made] == ["stiffness_nonlinearity", "force_offset"], "most first"
    assert [len(one.unknowns.effects) for one in chain] == [0, 1, 2]
    assert chain[-1].log_evidence > fits[-1].log_evidence
    for stage, before, after in zip(made, chain, chain[1:], strict=False):
        assert stage.base is before
        assert stage.best.fit is after
        assert stage.best.gain == pytest.approx(after.log_evidence - before.log_evidence)
    assert chain[-1].z[-2:] == pytest.approx([CUBIC.z_of(CUBIC.value(0.6)), 0.4], abs=0.06)


def test_what_explains_better_beside_the_others_takes_the_place_of_one() -> None:
    """The bow holds more than half of the offset, but not all; the cubic is apart."""
    record = linear(truth=(0.5, 0.5), mixed=(1.0, 0.0))
    fits, stages = searched(record, BOW, CUBIC, rivals=(OFFSET,))
    better = put_right(fits, stages)
    assert better is not None
    chain, made = better
    assert {stage.best.variant.effect for stage in made} == {"stiffness_nonlinearity", "force_offset"}
    assert chain[-1].log_evidence > fits[-1].log_evidence + 5.0


def test_a_set_that_is_right_stays_as_the_search_left_it() -> None:
    fits, stages = searched(linear(truth=(0.4, 0.6), mixed=(0.5, 0.5)), CUBIC, OFFSET, rivals=(BOW,))
    assert put_right(fits, stages) is None


@pytest.mark.parametrize("alone", [True, False])
def test_a_set_begun_with_less_than_another_of_it_brings_alone_is_told_the_most_needed_first(alone: bool) -> None:
    """Where more than noise is left a search is begun once more with what came second."""
    record = linear(truth=(0.2, 0.6), mixed=(0.5, 0.5))
    fits, stages = searched(record, OFFSET, CUBIC, rivals=(CUBIC,) if alone else ())
    better = put_right(fits, stages)
    assert (better is not None) == alone
    if better is not None:
        chain, made = better
        assert [stage.best.variant.effect for stage in made] == ["stiffness_nonlinearity", "force_offset"]
        assert made[0].best.gain > stages[0].best.gain
        assert chain[-1].log_evidence == pytest.approx(fits[-1].log_evidence, abs=0.1), "the same set"


def test_what_is_nearly_as_probable_beside_the_others_is_told_with_an_effect() -> None:
    """An offset, and a bow that is it but for a cubic: alone they are far apart, beside the cubic they are not."""
    chance = np.random.default_rng(8)
    nuisance, offset, own, cubic = chance.standard_normal((4, COUNT))
    data = 0.5 * offset + 1.2 * cubic + chance.standard_normal(COUNT)
    bow = offset + 0.08 * own + 0.3 * cubic
    columns = {"force_offset": offset, "stiffness_nonlinearity": cubic, "position_sensor_nonlinearity": bow}
    record = LinearRecord(data, nuisance[:, None], columns)
    for first, other in ((OFFSET, BOW), (BOW, OFFSET)):
        fits, stages = searched(record, first, CUBIC, rivals=(other,))
        assert abs(stages[0].refits[0].gain - stages[0].refits[1].gain) > 100.0
        chain, made = Exchange(12.0, 1.0, lambda text: None, FitMemory()).chain(fits, stages)
        (stage,) = (one for one in made if one.best.variant.effect == OFFSET.effect)
        (rival,) = stage.rivals(5.0)
        assert rival.variant.effect == BOW.effect
        ahead = chain[-1].log_evidence - rival.fit.log_evidence
        assert 1.0 < ahead < 5.0
        assert stage.best.gain - rival.gain == pytest.approx(ahead)


def test_an_effect_in_its_fuller_form_takes_the_place_of_two() -> None:
    """Curvature and cubic part of a reading are one cause; an offset that makes up for most of the one is none."""
    chance = np.random.default_rng(5)
    nuisance, quadratic, cubic, own = chance.standard_normal((4, COUNT))
    data = 0.6 * quadratic + 0.4 * cubic + chance.standard_normal(COUNT)
    columns = {"force_offset": cubic + 0.5 * own}
    record = ReadingInTwo(data, nuisance[:, None], columns, {"quadratic": quadratic, "cubic": cubic})
    fits, stages = searched(record, BOW, OFFSET)
    whole = Variant(BOW.effect, (BOW, EffectUnknown(BOW.effect, "cubic")))
    score = Score(whole, 1.0, np.zeros(2), np.zeros(1), np.eye(2))
    assert put_right(fits, stages) is None
    better = put_right(fits, [replace(stages[0], scores=(score,)), stages[1]])
    assert better is not None
    chain, made = better
    assert [stage.best.variant for stage in made] == [whole]
    assert chain[-1].log_evidence > fits[-1].log_evidence
    amounts = [whole.amounts[n].z_of(value) for n, value in enumerate((BOW.value(0.6), whole.amounts[1].value(0.4)))]
    assert chain[-1].z[-2:] == pytest.approx(amounts, abs=0.06)


def test_an_effect_takes_the_form_that_is_left_to_it_beside_the_others() -> None:
    """Alone a reading needs its cubic part for what an offset does; beside the offset its curvature is enough."""
    chance = np.random.default_rng(2)
    nuisance, quadratic, cubic, own = chance.standard_normal((4, COUNT))
    offset = cubic + own
    data = 0.6 * quadratic + 0.4 * offset + chance.standard_normal(COUNT)
    parts = {"quadratic": quadratic, "cubic": cubic}
    record = ReadingInTwo(data, nuisance[:, None], {"force_offset": offset}, parts)
    whole = Variant(BOW.effect, (BOW, EffectUnknown(BOW.effect, "cubic")))
    base = fit(record, UNKNOWNS, np.zeros(1))

    def refit(before: Fit, *variants: Variant) -> Refit:
        unknowns = with_effect(UNKNOWNS, *(one for variant in variants for one in variant.unknowns))
        found = fit(record, unknowns, np.zeros(unknowns.size))
        return Refit(variants[-1], found, found.log_evidence - before.log_evidence)

    first = [refit(base, whole), refit(base, Variant(BOW.effect, (BOW,)))]
    last = refit(first[0].fit, whole, Variant(OFFSET.effect, (OFFSET,)))
    assert first[0].gain > first[1].gain + 50.0
    stages = [SearchStage(base, (), tuple(first)), SearchStage(first[0].fit, (), (last,))]
    better = put_right([base, first[0].fit, last.fit], stages)
    assert better is not None
    assert {stage.best.variant.name for stage in better[1]} == {"force_offset (force)", first[1].variant.name}
    assert better[0][-1].log_evidence > last.fit.log_evidence + 1.0


def test_another_effect_takes_the_place_of_one_in_its_fuller_form() -> None:
    """Curvature and cubic part of a reading, of which an offset makes up for more than the curvature alone does."""
    chance = np.random.default_rng(6)
    nuisance, quadratic, cubic, own, spring = chance.standard_normal((5, COUNT))
    data = 0.5 * quadratic + 0.5 * cubic + 0.5 * spring + chance.standard_normal(COUNT)
    columns = {"force_offset": quadratic + cubic + own, "stiffness_nonlinearity": spring}
    record = ReadingInTwo(data, nuisance[:, None], columns, {"quadratic": quadratic, "cubic": cubic})
    fits, stages = searched(record, OFFSET, CUBIC, rivals=(BOW,))
    assert stages[0].best.gain > stages[0].refits[1].gain + 50.0
    whole = Variant(BOW.effect, (BOW, EffectUnknown(BOW.effect, "cubic")))
    score = Score(whole, 1.0, np.zeros(2), np.zeros(1), np.eye(2))
    assert put_right(fits, stages) is None
    better = put_right(fits, [replace(stages[0], scores=(score,)), stages[1]])
    assert better is not None
    chain, made = better
    assert {stage.best.variant.name for stage in made} == {whole.name, "stiffness_nonlinearity (cubic)"}
    assert chain[-1].log_evidence > fits[-1].log_evidence + 50.0


@dataclass(frozen=True, eq=False)
class ReadingInTwo(LinearRecord):
    """The reading's curvature and its cubic part have columns of their own."""

    of_reading: dict[str, np.ndarray]

    def spectra(self, points: Points) -> np.ndarray:
        rows = super().spectra(points)
        if points.effects is not None:
            for name, column in self.of_reading.items():
                one = EffectUnknown(BOW.effect, name)
                rows = rows - np.outer([one.z_of(float(v)) for v in points.effects[:, one.place]], column)
        return rows


@dataclass(frozen=True, eq=False)
class LostWithout(LinearRecord):
    """A simulation fails where one of these is nothing."""

    needed: tuple[EffectUnknown, ...] = (CUBIC,)

    def spectra(self, points: Points) -> np.ndarray:
        there = np.zeros(len(points.rows), bool)
        if points.effects is not None:
            there = np.all([points.effects[:, one.place] != 0 for one in self.needed], axis=0)
        return np.where(there[:, None], super().spectra(points), np.nan)


def test_an_effect_without_which_nothing_can_be_followed_stays() -> None:
    """And the others are put right beside it."""
    record = linear(truth=(0.4, 0.6), mixed=(0.5, 0.5))
    fits, stages = searched(record, BOW, CUBIC, OFFSET)
    lost = LostWithout(record.data, record.nuisances, record.of_effect)
    better = put_right([*fits[:-1], replace(fits[-1], likelihood=lost)], stages)
    assert better is not None
    assert {stage.best.variant.effect for stage in better[1]} == {"stiffness_nonlinearity", "force_offset"}


@dataclass(frozen=True, eq=False)
class LostAlone(LinearRecord):
    """A simulation fails where one of two is large without the other."""

    def spectra(self, points: Points) -> np.ndarray:
        assert points.effects is not None
        offset, cubic = (
            np.abs([one.z_of(float(value)) for value in points.effects[:, one.place]]) for one in (OFFSET, CUBIC)
        )
        alone = (np.maximum(offset, cubic) > 0.25) & (np.minimum(offset, cubic) < 0.05)
        return np.where(alone[:, None], np.nan, super().spectra(points))


def test_a_set_whose_parts_cannot_be_followed_at_its_numbers_is_told_from_smaller_ones() -> None:
    record = linear(truth=(0.4, 0.6), mixed=(0.5, 0.5))
    fits, stages = searched(record, BOW, CUBIC, OFFSET)
    lost = LostAlone(record.data, record.nuisances, record.of_effect)
    better = put_right([replace(one, likelihood=lost) for one in fits], stages)
    assert better is not None
    chain, made = better
    assert {stage.best.variant.effect for stage in made} == {"stiffness_nonlinearity", "force_offset"}
    assert chain[-1].z[-2:] == pytest.approx([CUBIC.z_of(CUBIC.value(0.6)), 0.4], abs=0.06)
    assert abs(chain[1].z[-1]) <= 0.25


def test_a_set_of_whose_parts_none_can_be_followed_from_its_stretches_is_told_from_those_of_the_fit_before() -> None:
    record = linear(truth=(0.4, 0.6), mixed=(0.5, 0.5))
    fits, stages = searched(record, OFFSET, CUBIC, rivals=(CUBIC,))
    its_own = LostWithout(record.data, record.nuisances, record.of_effect, (OFFSET, CUBIC))
    better = put_right([*fits[:-1], replace(fits[-1], likelihood=its_own)], stages)
    assert better is not None
    chain, made = better
    assert {stage.best.variant.effect for stage in made} == {"stiffness_nonlinearity", "force_offset"}
    assert [one.likelihood for one in chain] == [record, record, its_own]
