"""Figures show the arrays they were given."""

import numpy as np
import pytest

from msl_fem.maps import operating_map
from msl_fem.report.figures import (
    MOST_POINTS,
    Tracking,
    force_over_current,
    frequency_response_figure,
    operating_regions,
    predicted_position,
    tracking,
)
from msl_fem.table.magnetic_table import MagneticTable


def test_force_lines_are_the_table(table: MagneticTable) -> None:
    made = force_over_current(table, gaps=[2e-4, 5e-4])
    assert [trace.name for trace in made.data] == ["0.2 mm", "0.5 mm"]
    assert made.data[1].y[-1] == pytest.approx(float(table.force(table.current[-1], 5e-4)))


def test_regions_are_bounded_by_the_curves(table: MagneticTable) -> None:
    made = operating_regions(operating_map(table, levels=(0.5, 1.0)))
    assert [t.name for t in made.data] == ["preferred", "discouraged", "unacceptable", "0.5 T", "1 T"]
    low, high = made.data[3].y, made.data[4].y
    assert (np.asarray(low) < np.asarray(high)).all()
    np.testing.assert_allclose(made.data[0].y[len(low) :], low[::-1])


def test_long_runs_are_thinned_and_rows_do_not_overlap() -> None:
    time = np.arange(50_000) * 1e-4
    made = predicted_position(time, np.sin(time), np.sin(time) + 1e-3, origin="measured")
    assert all(len(trace.x) <= MOST_POINTS for trace in (made.data[0], made.data[1], made.data[2]))
    assert made.layout.yaxis.domain[0] > made.layout.yaxis2.domain[1] > made.layout.yaxis3.domain[1]
    run = Tracking(time[:100], np.ones(100), np.zeros(100), np.zeros((100, 2)))
    three = tracking(run)
    assert three.layout.yaxis2.domain[0] > three.layout.yaxis3.domain[1]
    assert three.data[2].y[0] == pytest.approx(1e6)


def test_many_periods_are_an_envelope_that_holds_every_sample_and_a_few_magnified() -> None:
    time = np.arange(40_000) * 1e-4
    position = 1e-6 * (1 + time) * np.sin(2 * np.pi * 100 * time)
    made = predicted_position(time, position, 0.9 * position, origin="simulated")
    named = {trace.name: trace for trace in made.data}
    assert {"simulated, envelope", "simulated - free run, envelope", "ARMAX, free run"} <= named.keys()
    high = np.interp(time, named["simulated, envelope"].x, named["simulated, envelope"].y)
    assert (high > 1e6 * position - 0.05).all(), "no peak is left out"
    np.testing.assert_allclose(high, 1 + time, rtol=0.1)
    magnified = named["ARMAX, free run"]
    assert 0.06 < np.ptp(magnified.x) < 0.12, "eight periods of 10 ms"
    assert np.abs(magnified.y).max() == pytest.approx(0.9 * 1e6 * np.abs(position).max(), rel=0.05)


def test_gain_is_in_decibel() -> None:
    f = np.array([1.0, 10.0])
    made = frequency_response_figure(f, {"loop": (np.array([1.0, 0.1]), np.array([0.0, -np.pi / 2]))})
    np.testing.assert_allclose(made.data[0].y, [0, -20])
    np.testing.assert_allclose(made.data[1].y, [0, -90])
    assert [(shape.y0, shape.y1) for shape in made.layout.shapes] == [(-1, 1)], "the band of 0 dB"


def test_a_rig_with_one_side_has_one_current() -> None:
    """The second side of a loop's run is there as zeros; a side without current is not drawn, the first always is."""
    t = np.linspace(0.0, 1.0, 5)
    current = np.column_stack([np.sin(t), np.zeros(5)])
    names = [trace.name for trace in tracking(Tracking(t, t, t, current)).data]
    assert names == ["reference", "position", "error", "current 1"]
    assert [t.name for t in tracking(Tracking(t, t, t, 0 * current)).data][3:] == ["current 1"]
    assert [t.name for t in tracking(Tracking(t, t, t, current + 1)).data][3:] == ["current 1", "current 2"]
