"""The linear model around a fit: the noise's densities are estimated anew with the amounts."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from linear_record import CUBIC, OFFSET, LinearRecord, record, with_effect

from msl_fem.computing.arrays import Array
from msl_fem.diagnosis import linear_model
from msl_fem.diagnosis.fit import fit
from msl_fem.diagnosis.likelihood import Fit
from msl_fem.diagnosis.linear_model import Background
from msl_fem.diagnosis.noise import weights_of
from msl_fem.diagnosis.scores import scored, signatures
from msl_fem.diagnosis.unknowns import Unknowns
from msl_fem.diagnosis.variants import Variant

SLOW = 200
"""Numbers of the slow band."""


@dataclass(frozen=True, eq=False)
class _Coloured(LinearRecord):
    """A record of two bands, the first of which is slow."""

    top: float = np.inf

    @property
    def labels(self):
        return (np.arange(self.data.size) >= SLOW).astype(np.intp)

    @property
    def ceilings(self):
        return np.array([self.top, np.inf])


def slow(size: float, *, top: float = np.inf) -> tuple[Fit, Fit]:
    """Fits without and with an effect that acts in the slow band alone."""
    it, unknowns = record(seed=3)
    column = np.where(np.arange(it.data.size) < SLOW, np.random.default_rng(4).standard_normal(it.data.size), 0.0)
    coloured = _Coloured(it.data + size * column, it.nuisances, {OFFSET.effect: column}, top=top)
    base = fit(coloured, unknowns, np.zeros(3))  # type: ignore[arg-type]
    return base, fit(coloured, with_effect(unknowns, OFFSET), np.zeros(4))  # type: ignore[arg-type]


def gain_of(base: Fit) -> float:
    return scored(base, [Variant(OFFSET.effect, (OFFSET,))]).scores[0].gain


@pytest.mark.parametrize("top", [np.inf, 100.0])
def test_a_score_is_what_the_refit_brings_where_the_cause_passed_for_noise(top: float) -> None:
    """Of 200 numbers that are its doing a linear model of fixed weights promises 100 nats at most."""
    base, full = slow(30.0, top=top)
    brings = full.log_evidence - base.log_evidence
    assert brings > (600 if np.isinf(top) else 900)
    assert gain_of(base) == pytest.approx(brings, rel=2e-3)


def test_with_the_densities_of_the_fit_it_promises_no_more_than_half_a_nat_a_number(monkeypatch) -> None:
    monkeypatch.setattr("msl_fem.diagnosis.noise.NoiseWeights.again", lambda noise, q: (q.sum() / 2, np.ones(q.size)))
    base, _ = slow(30.0)
    assert 50 < gain_of(base) < SLOW / 2


def weak_beside(found: Fit, tells: float) -> Fit:
    """A fit of the same record whose data tell so little of one more nuisance, in the slow band alone."""
    it: Any = found.likelihood
    more = np.where(np.arange(it.data.size) < SLOW, np.random.default_rng(6).standard_normal(it.data.size), 0.0)
    more += tells / 2 * it.of_effect["force_offset"]
    unknowns = replace(found.unknowns, believed=(*found.unknowns.believed, ("resistance", 0.01)))
    wider = replace(it, nuisances=np.column_stack([it.nuisances, tells * more]))
    return fit(wider, unknowns, np.zeros(4))


@pytest.mark.parametrize("tells", [0.02, 1.0])
def test_what_the_data_hardly_tell_is_held_by_its_prior_and_pays_for_what_it_is_told_anew(tells: float) -> None:
    """With other densities the data tell more of it, which costs evidence, as in the refit."""
    base = weak_beside(slow(30.0)[0], tells)
    full = fit(base.likelihood, with_effect(base.unknowns, OFFSET), np.zeros(5))
    assert gain_of(base) == pytest.approx(full.log_evidence - base.log_evidence, abs=0.3)


def test_columns_of_the_same_fit_score_alike_where_the_prior_holds_what_is_unknown() -> None:
    base = weak_beside(slow(3.0)[0], 0.02)
    tried = [Variant(OFFSET.effect, (OFFSET,))]
    exact = scored(base, tried)
    again = scored(base, tried, near=exact.columns)
    assert again.scores[0].gain == pytest.approx(exact.scores[0].gain, rel=1e-6)
    assert again.scores[0].shift == pytest.approx(exact.scores[0].shift, rel=1e-4, abs=1e-9)
    assert again.scores[0].own == pytest.approx(exact.scores[0].own, rel=1e-6)


def test_where_a_zero_wanders_densities_stay_those_of_the_fit() -> None:
    base, _ = slow(30.0)
    wandering = replace(base, weights=replace(base.weights, wander=np.zeros(base.residual.size)))
    assert gain_of(wandering) < SLOW / 2


def test_densities_are_estimated_again_as_they_are_with_a_fit() -> None:
    chance = np.random.default_rng(2)
    labels = np.repeat([0, 1, 2], [5, 50, 500])
    one, other = chance.standard_normal((2, labels.size)) * np.array([20.0, 2.0, 1.0])[labels]
    limits, spent = np.array([100.0, np.inf, np.inf]), np.array([1.0, 0.0, 3.0])
    before, after = (weights_of(residual, labels, limits, spent) for residual in (one, other))
    squares = np.bincount(labels, weights=(other * before.root) ** 2)
    nats, density = before.again(squares)
    assert nats == pytest.approx(after.nats, rel=1e-12)
    assert density * before.density == pytest.approx(after.density, rel=1e-12)


def test_what_is_unknown_moves_with_the_amounts_as_in_the_refit() -> None:
    it, unknowns = record(seed=6, size=0.3)
    base = fit(it, unknowns, np.zeros(3))  # type: ignore[arg-type]
    full = fit(it, with_effect(unknowns, OFFSET), np.zeros(4))  # type: ignore[arg-type]
    [score] = scored(base, [Variant("force_offset", (OFFSET,))]).scores
    assert [*(base.z + score.shift), *score.guess] == pytest.approx(full.z, abs=2e-3)


@dataclass(frozen=True, eq=False)
class _Turning(LinearRecord):
    """A record in which one effect turns what a nuisance does, and another is that nuisance but for a tenth."""

    way: Array

    def spectra(self, points):
        found = super().spectra(points)
        for n, z in enumerate(points.rows if points.effects is not None else []):
            cubic, offset = (one.z_of(float(points.effects[n, one.place])) for one in (CUBIC, OFFSET))
            turned = self.nuisances[:, 0] + 5.0 * cubic * self.way
            found[n] += self.nuisances[:, 0] * z[0] - turned * (z[0] + 100.0 * offset)
        return found


def test_columns_less_what_is_unknown_do_where_that_makes_up_for_almost_all() -> None:
    """As simulated they would not: a tenth of them is their own, and the rest turns."""
    it, unknowns = record(seed=7)
    own, way = np.random.default_rng(8).standard_normal((2, it.data.size))
    columns = {"force_offset": 10 * own, "stiffness_nonlinearity": it.of_effect["stiffness_nonlinearity"]}
    data = it.data + 0.3 * own + columns["stiffness_nonlinearity"]
    turning = _Turning(data, it.nuisances, columns, way=way)
    offset = Variant("force_offset", (OFFSET,))
    without = fit(turning, unknowns, np.zeros(3))  # type: ignore[arg-type]
    beside = fit(turning, with_effect(unknowns, CUBIC), np.zeros(4))  # type: ignore[arg-type]
    near = scored(without, [offset]).columns
    exact, rough = scored(beside, [offset]).scores[0], scored(beside, [offset], near=near).scores[0]
    assert exact.gain > 50
    assert rough.gain == pytest.approx(exact.gain, rel=0.02)
    assert rough.guess == pytest.approx(exact.guess, rel=0.02)
    as_simulated = signatures(without, [(OFFSET, ())])
    astray = Background(beside, as_simulated).best((0,), np.zeros(1, dtype=bool))
    assert astray.gain != pytest.approx(exact.gain, rel=0.5)


def test_ends_where_another_time_brings_next_to_nothing(monkeypatch) -> None:
    base, _ = slow(3.0)
    whole = gain_of(base)
    monkeypatch.setattr(linear_model, "REWEIGHTED", 100)
    monkeypatch.setattr(linear_model, "ENOUGH", 1e-9)
    assert gain_of(base) == pytest.approx(whole, abs=0.1)


def test_no_unknowns_are_no_trouble() -> None:
    it, _ = record(size=0.3)
    bare = LinearRecord(it.data, np.zeros((it.data.size, 0)), it.of_effect)
    base = fit(bare, Unknowns((), 0, (0,)), np.zeros(0))  # type: ignore[arg-type]
    assert gain_of(base) > 10
