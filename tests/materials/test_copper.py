"""Copper over temperature."""

import pytest

from msl_fem.errors import InputError
from msl_fem.materials.constants import resistance_ratio, resistivity


def test_resistance_at_100_degrees() -> None:
    """IEC 60028: 0.00393 a kelvin from 20 degC; ASTM B193's 1.3144 for 100 degC."""
    assert resistance_ratio(373.15) == pytest.approx(1.3144, abs=1e-4)
    assert resistance_ratio(293.15) == 1.0
    assert resistivity(373.15) == pytest.approx(1.3144 * 1.724e-8, rel=1e-4)


@pytest.mark.parametrize("temperature", [100.0, 700.0, float("nan")])
def test_temperatures_where_the_straight_line_ends(temperature: float) -> None:
    with pytest.raises(InputError, match="degC is not allowed"):
        resistance_ratio(temperature)
