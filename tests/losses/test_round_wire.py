"""Sizes of wire: the gauges' definition, the preferred diameters, the insulation's build."""

import math

import numpy as np
import pytest

from msl_fem.errors import InputError
from msl_fem.losses import gauge_diameter, gauge_wire, metric_wire, wires


def test_gauges_by_their_definition() -> None:
    """Two of them are the definition (ASTM B258): AWG 36 is 0.005 inch, 39 gauges up is 0.46 inch."""
    assert gauge_diameter(36) == pytest.approx(0.005 * 25.4e-3, rel=1e-15)
    assert gauge_diameter(-3) == pytest.approx(0.46 * 25.4e-3, rel=1e-15)
    assert gauge_diameter(20) == pytest.approx(0.0320 * 25.4e-3, rel=2e-3)  # the table's rounded value


def test_preferred_diameters_are_the_series_r20() -> None:
    """Each is 10^(1/20) times the one before, as rounded by the standard (ISO 3: at most 1.26 %): finds misprints."""
    diameters = np.array([wire.diameter for wire in wires("metric")]) * 1e3
    exact = 10 ** (np.arange(diameters.size) / 20 + 0.7 - 2)
    assert np.abs(diameters / exact - 1).max() < 0.0127


@pytest.mark.parametrize("series", ["metric", "awg"])
def test_insulation_grows_with_grade_and_diameter(series: str) -> None:
    thin, thick = (wires(series, grade=grade) for grade in (1, 2))  # type: ignore[arg-type]
    build = [np.array([w.outer_diameter - w.diameter for w in row]) for row in (thin, thick)]
    assert (build[0] > 0).all()
    assert (build[1] > build[0]).all()
    assert (np.diff(build[0]) > -1e-9).all()
    assert (np.diff([w.diameter for w in thin]) > 0).all()


def test_known_overall_diameters() -> None:
    """IEC 60317-0-1, table 1: 1 mm has at most 1.062 mm (grade 1) and 1.094 mm (grade 2)."""
    assert metric_wire(1e-3).outer_diameter == pytest.approx(1.062e-3)
    assert metric_wire(1e-3, grade=2).outer_diameter == pytest.approx(1.094e-3)
    assert gauge_wire(20).outer_diameter - gauge_wire(20).diameter == pytest.approx(0.059e-3)  # that of 0.9 mm


def test_resistance_of_a_length() -> None:
    """1 mm of copper: 21.95 milliohm a metre at 20 degC, 1.3144 times as much at 100 degC."""
    wire = metric_wire(1e-3)
    assert wire.resistance_per_length() == pytest.approx(4 * 1.724e-8 / (math.pi * 1e-6), rel=1e-12)
    assert wire.resistance_per_length(373.15) == pytest.approx(1.3144 * wire.resistance_per_length(), rel=1e-6)


def test_sizes_that_do_not_exist() -> None:
    with pytest.raises(InputError, match=r"0.7 mm is no preferred size; near it are 0.63, 0.71, 0.8 mm"):
        metric_wire(0.7e-3)
    with pytest.raises(InputError, match="AWG 60 is not allowed"):
        gauge_wire(60)
    with pytest.raises(InputError, match="grade 3 is not known"):
        wires(grade=3)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="series 'swg' is unknown"):
        wires("swg")  # type: ignore[arg-type]
