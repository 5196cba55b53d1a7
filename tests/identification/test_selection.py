"""Orders and terms by a criterion find what made the data and pay for what they add."""

import numpy as np
import pytest
from armax_plants import CASES
from magnet_rig import NOMINAL_GAP, magnet_run

from msl_fem.errors import InputError
from msl_fem.identification import (
    ArmaxOrders,
    DeltaSearch,
    InformationCriterion,
    RationalInputs,
    TermSearch,
    candidate_terms,
    rational_term,
    select_orders,
    select_terms,
)


@pytest.mark.parametrize("case", CASES[:3], ids=lambda case: case.name)
def test_the_true_orders_are_found(case):
    run, _ = case.run(4_000, np.random.default_rng(3))
    found = select_orders([run])
    assert found.orders == ArmaxOrders(2, 2, 2, 1)
    assert min(value for _, value in found.tried) == dict(found.tried)[found.orders]


def test_the_walk_reaches_the_orders_from_elsewhere():
    run, _ = CASES[0].run(4_000, np.random.default_rng(3))
    assert select_orders([run], start=ArmaxOrders(4, 3, 1, 1)).orders == ArmaxOrders(2, 2, 2, 1)


def test_penalties_are_those_of_the_papers():
    assert InformationCriterion("bic").penalty(6, 1_000) == pytest.approx(6 * np.log(1_000))
    assert InformationCriterion("aicc").penalty(6, 1_000) == pytest.approx(2 * 6 + 2 * 6 * 7 / (1_000 - 7))
    with pytest.raises(InputError, match="bic or aicc"):
        InformationCriterion("aic")


def test_the_law_of_the_magnets_is_found_among_others():
    """Of six candidate laws the true one, i^2/g^2 a side, and nothing more."""
    run = magnet_run(8_000, np.random.default_rng(11))
    texts = [f"i{s}{p}/g{s}{q}" for s in (1, 2) for p, q in (("", "^2"), ("^2", "^2"), ("^2", "^3"))]
    search = TermSearch(
        (), ArmaxOrders(2, 2, 2, 1), InformationCriterion(), DeltaSearch(), None, tuple(map(rational_term, texts))
    )
    found = select_terms([run], search, rational=RationalInputs((rational_term("i1"),), NOMINAL_GAP))
    assert set(map(str, found.rational.terms)) == {"i1^2/g1^2", "i2^2/g2^2"}
    assert found.rational.delta == pytest.approx(40e-6, abs=3e-6)
    assert len(found.tried) >= 4
    assert len(candidate_terms((1, 2))) == 24
