"""Surrogates of a record without effects: their gains are those of clean records."""

import numpy as np
import pytest
from linear_record import OFFSET, LinearRecord, record
from scipy.optimize import nnls

from msl_fem.diagnosis.fit import fit
from msl_fem.diagnosis.linear_model import held
from msl_fem.diagnosis.null import AmountPlaces, NullDistribution, null_distribution
from msl_fem.diagnosis.scores import scored
from msl_fem.diagnosis.unknowns import Unknowns
from msl_fem.diagnosis.variants import Variant

VARIANT = Variant("force_offset", (OFFSET,))


def test_surrogates_have_the_gains_of_clean_records() -> None:
    """The quantiles of one record's surrogates against the gains of 150 records that chance made anew."""
    gains = []
    for seed in range(150):
        data, unknowns = record(seed=seed)
        base = fit(data, unknowns, np.zeros(unknowns.size))  # type: ignore[arg-type]
        at_base = scored(base, [VARIANT], null=seed == 0)
        gains.append(at_base.scores[0].gain)
        if seed == 0:
            by_chance = at_base.null
    assert by_chance.quantile(0.5) == pytest.approx(np.quantile(gains, 0.5), abs=0.15)
    assert by_chance.quantile(0.9) == pytest.approx(np.quantile(gains, 0.9), abs=0.5)
    assert np.mean([by_chance.p_value(gain) < 0.1 for gain in gains]) == pytest.approx(0.1, abs=0.06)


def test_a_hidden_effect_stands_out_of_its_surrogates() -> None:
    data, unknowns = record(size=0.3)
    base = fit(data, unknowns, np.zeros(unknowns.size))  # type: ignore[arg-type]
    at_base = scored(base, [VARIANT])
    assert at_base.null.p_value(at_base.scores[0].gain) == 1 / 201


def test_what_the_unknowns_make_up_for_almost_wholly_keeps_its_digits() -> None:
    """An effect that is a nuisance of a million times the noise, a hundred times more than seen in a record, and noise
    of its own beside it: in single precision, rounding adds 0.1 % to what is its own."""
    chance = np.random.default_rng(5)
    nuisance, own, noise = chance.standard_normal((3, 4000))
    data = LinearRecord(noise, 1e6 * nuisance[:, None], {"force_offset": 1e6 * nuisance + own})
    base = fit(data, Unknowns((("moving_mass", 0.01),), 0, (0,)), np.zeros(1))  # type: ignore[arg-type]
    at_base = scored(base, [VARIANT])
    left = own @ own - (own @ nuisance) ** 2 / (nuisance @ nuisance)
    assert at_base.scores[0].own[0, 0] == pytest.approx(base.weights.root[0] ** 2 * left + 1, rel=2e-3)
    assert -10.0 < at_base.null.quantile(0.99) < 10.0


def test_more_variants_bring_more_by_chance_and_a_one_sided_amount_brings_less() -> None:
    own = 100 * np.eye(20)
    every = [AmountPlaces((n,), (False,)) for n in range(20)]
    one, many = null_distribution(own, every[:1]), null_distribution(own, every)
    assert many.quantile(0.5) > one.quantile(0.95)
    half = null_distribution(own, [AmountPlaces((0,), (True,))])
    assert np.mean(half.gains > half.gains.min() + 1e-9) == pytest.approx(0.5, abs=0.1)
    assert NullDistribution().quantile(0.99) == -np.inf


def test_scales_of_amounts_change_nothing_but_the_price_of_their_prior() -> None:
    """Amounts whose scales differ by eight powers of ten: rounding of the large ones is none of the small ones'."""
    mixed = np.random.default_rng(1).standard_normal((6, 6))
    own = mixed @ mixed.T + np.eye(6)
    scale = np.geomspace(1.0, 1e8, 6)
    pairs = [AmountPlaces((n, n + 1), (False, False)) for n in range(0, 6, 2)]
    found = null_distribution(own * scale[:, None] * scale, pairs)
    assert found.quantile(0.99) < 10.0


def test_a_one_sided_amount_that_would_be_negative_is_nothing_at_all() -> None:
    """Against nonnegative least squares where there is one amount; of several none is left on the wrong side."""
    chance = np.random.default_rng(2)
    for size in (1, 2, 3):
        for _ in range(50):
            mixed, b = chance.standard_normal((size, size)), chance.standard_normal(size)
            g = mixed @ mixed.T + np.eye(size)
            found = held(g, b, np.ones(size, dtype=bool))
            assert (found >= 0).all()
            if size == 1:
                root = np.linalg.cholesky(g).T
                assert found == pytest.approx(nnls(root, np.linalg.solve(root.T, b))[0], abs=1e-9)
            assert held(g, b, np.zeros(size, dtype=bool)) == pytest.approx(np.linalg.solve(g, b), rel=1e-6)
