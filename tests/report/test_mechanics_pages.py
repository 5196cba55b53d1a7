"""Pages and figures of flexure, gap trade and tolerances hold the numbers of their reports."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from msl_fem.actuator import load_actuator
from msl_fem.design.tolerances import TableBand, ToleranceSettings, ToleranceStudy, tolerance_study
from msl_fem.mechanics import assess_flexure
from msl_fem.mechanics.gap_trade import gap_trade
from msl_fem.report.design_pages import (
    flexure_force_figure,
    flexure_page,
    gap_trade_figure,
    gap_trade_page,
    map_band,
    mode_chart,
    table_bands,
    tolerance_effects,
    tolerance_page,
)
from msl_fem.report.page import write_page
from msl_fem.table.magnetic_table import read_table

ROOT = Path(__file__).parent.parent.parent
FLEXURE = load_actuator(ROOT / "geometries" / "fast_tool_servo_flexure.toml")


@pytest.fixture(scope="module")
def study() -> ToleranceStudy:
    settings = ToleranceSettings(gaps=(0.3e-3, 0.6e-3), levels=(1.2,), samples=200, checks=0)
    return tolerance_study(FLEXURE, settings=settings)


def test_the_flexures_page(tmp_path: Path) -> None:
    report = assess_flexure(FLEXURE, bandwidth=50.0)
    force = flexure_force_figure(report)
    lines = {trace.name: np.asarray(trace.y) for trace in force.data}
    assert lines["12 E I / L³"][-1] == pytest.approx(report.stiffness * 0.5e-3)
    assert lines["finite elements"][-1] == pytest.approx(lines["stretched beam, closed form"][-1], rel=1e-5)
    chart = mode_chart(report)
    assert [len(trace.x) for trace in chart.data] == [6, 6, 6, 6]
    assert set(chart.data[2].x) == {report.leaf_mode}
    assert set(chart.data[3].x) == {50.0}
    text = write_page(flexure_page(FLEXURE, report), tmp_path / "flexure.html").read_text(encoding="utf-8")
    assert "62.0 Hz" in text
    assert "1102 Hz and 1505 Hz above the first with the leaves in two sets" in text


def test_the_trades_page(tmp_path: Path) -> None:
    trade = gap_trade(FLEXURE, read_table(ROOT / "lookup_tables" / "fast_tool_servo.nc"))
    made = gap_trade_figure(trade)
    assert len(made.data) == 5
    assert np.asarray(made.data[0].y) == pytest.approx(trade.range * 1e3)
    text = write_page(gap_trade_page(FLEXURE, trade), tmp_path / "trade.html").read_text(encoding="utf-8")
    assert "the bandwidth at full range falls from" in text


def test_the_tolerances_page(study: ToleranceStudy, tmp_path: Path) -> None:
    band = map_band(study)
    assert np.asarray(band.data[1].y) == pytest.approx(study.current[0])
    assert max(band.data[0].y) == pytest.approx(study.band.high.max())
    effects = tolerance_effects(study)
    force = dict(zip(effects.data[0].y, effects.data[0].x, strict=True))
    assert force["stack depth"] == pytest.approx(100 * 0.36 / 20, rel=0.01), (
        "but for the ends, which do not grow with it"
    )
    text = write_page(tolerance_page(FLEXURE, study), tmp_path / "tolerances.html").read_text(encoding="utf-8")
    assert "ISO 2768-1" in text
    assert "The force depends most on the gap" in text
    assert ">± 0.01</td>" in text, "a pure number has no prefix: 10 m would be metres"
    assert "200 samples of the linearised map, none of them solved directly" in text
    assert "The table as made" not in text


def test_the_page_shows_the_band_of_the_whole_table_where_it_was_asked_for(study, tmp_path: Path) -> None:
    """At 2 A and both gaps: a tenth to either side of 2 N and a quarter of 1 N."""
    force = np.array([[[0.0, 1.8], [0.0, 0.75]], [[0.0, 2.2], [0.0, 1.25]]])
    table = TableBand(np.array([0.0, 2.0]), force, force, certified=180, error_estimate=2e-4)
    made = table_bands(study, table)
    assert [trace.name for trace in made.data] == ["0.3 mm", "0.6 mm"]
    assert np.asarray(made.data[1].y).tolist() == [0.0, 0.75, 1.25, 0.0]
    asked = replace(study, band=replace(study.band, table=table))
    text = write_page(tolerance_page(FLEXURE, asked), tmp_path / "tolerances.html").read_text(encoding="utf-8")
    assert "at 2 A and 0.6 mm it is the widest, ± 25 %." in text
    assert "180 of 200, errors up to 2.0e-04 of full scale" in text
