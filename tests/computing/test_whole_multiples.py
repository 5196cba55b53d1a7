"""Rates that are whole multiples of others."""

import pytest

from msl_fem.computing.whole_multiples import whole_multiple


@pytest.mark.parametrize(
    ("rate", "of", "times"),
    [
        (1e4, 2.5e3, 4),
        (5e3, 5e3, 1),
        (20e3 * (1 + 1e-12), 5e3, 4),
        (1e4, 3e3, None),
        (1e4, 2e4, None),
        (1e4, 2.5001e3, None),
    ],
)
def test_a_rate_is_a_whole_multiple_of_another_or_not(rate: float, of: float, times: int | None) -> None:
    assert whole_multiple(rate, of) == times
