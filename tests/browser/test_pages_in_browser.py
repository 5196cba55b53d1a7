"""The smaller pages in a real browser: no complaint, nothing wider than the window, tables and figures there."""

from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT
from devtools import Browser

from msl_fem.actuator import load_actuator
from msl_fem.diagnosis.result import ChannelResiduals
from msl_fem.maps import Guard, operating_map
from msl_fem.mechanics import assess_flexure
from msl_fem.mechanics.gap_trade import gap_trade
from msl_fem.report.design_pages import flexure_page, gap_trade_page
from msl_fem.report.explorer import explorer
from msl_fem.report.figures import figure, line, logarithmic
from msl_fem.report.page import Grid, Page, Stage, write_page
from msl_fem.report.played_motion import motion_of, motion_stage
from msl_fem.table.magnetic_table import MagneticTable, read_table

FLEXURE = load_actuator(ROOT / "geometries" / "fast_tool_servo_flexure.toml")


def flexure() -> Page:
    return flexure_page(FLEXURE, assess_flexure(FLEXURE, bandwidth=50.0))


def trade() -> Page:
    return gap_trade_page(FLEXURE, gap_trade(FLEXURE, read_table(ROOT / "lookup_tables" / "fast_tool_servo.nc")))


def hostile() -> Page:
    """Long words, markup and a wide table."""
    plot = figure(x="frequency in Hz", y="y")
    plot.add_trace(line([2.0, 300.0], [1.0, 2.0], name="<img src=x onerror=alert(1)>", colour="#000000"))
    logarithmic(plot, [[2.0, 300.0]], along="x")
    rows = [[f"{'long' * 6}{n}{k}" for n in range(12)] for k in range(3)]
    stage = Stage("<script>alert(1)</script>", "word" * 60, (("name", "w" * 90),), plot=plot, table=Grid(rows[0], rows))
    return Page("t" * 70, "<b>", (("1", "</div>"),), (stage,), (("made", "x" * 200),), ("<i>note",))


@pytest.mark.parametrize("made", [flexure, trade, hostile])
def test_a_page_is_whole(browser: Browser, page_file: Path, made: object) -> None:
    assert callable(made)
    file = write_page(made(), page_file)
    for width, scheme in ((1200, "light"), (700, "dark")):
        browser.size(width)
        browser.colours(scheme)
        browser.open(file)
        assert browser.complaints == []
        assert [a for a in browser.requests if not a.startswith(("data:", "blob:"))] == [file.resolve().as_uri()]
        assert browser.run("document.documentElement.scrollWidth") <= width
        assert browser.run("document.querySelectorAll('.main-svg').length") > 0
    browser.colours("light")


def test_the_explorer_says_where_a_level_is_not_reached(
    browser: Browser, page_file: Path, table: MagneticTable
) -> None:
    made = operating_map(table, levels=(0.5, 1.9))
    assert np.isnan(made.current[1]).any()
    assert not np.isnan(made.current[1]).all()
    widget = explorer(table, made, start=(11.0, float(table.gap[-1])))
    file = write_page(Page("t", "s", (), (Stage("map", "s", (), widget=widget),), ()), page_file)
    browser.open(file)
    assert browser.complaints == []
    assert "where the map ends, 1.9 T not reached" in browser.text('#explorer [data-out="reason"]')
    gap = float(table.gap[0])
    browser.run(f"explorer.go({float(np.mean(made.current[:, 0]))}, {gap})")
    assert "that may bring 1.9 T" in browser.text('#explorer [data-out="reason"]')
    browser.run("explorer.go(12, explorer.state.gap)")
    assert browser.text('#explorer [data-out="region"]') == Guard(made).classify(12.0, gap) == "unacceptable"


def test_a_motion_is_played_to_its_end_when_it_is_asked_for(browser: Browser, page_file: Path) -> None:
    time = np.arange(400) / 1e3
    error = 2e-6 * np.sin(30 * time)
    left = ChannelResiduals("sweep", "held-out", "position_m", 1e3, 5e-8, error, error, error / 20)
    motion = motion_of(left, 1e-3 * np.sin(20 * time), (("as believed", error), ("found", error / 20)))
    assert motion is not None
    file = write_page(Page("t", "s", (), (motion_stage(left, motion),), ()), page_file)
    for width, scheme in ((390, "dark"), (1200, "light")):
        browser.size(width)
        browser.colours(scheme)
        browser.open(file)
        assert browser.complaints == []
        assert browser.run("document.documentElement.scrollWidth") <= width
    place = "document.querySelector('[data-track=\"before\"]').getAttribute('transform')"
    before = browser.run(place)
    assert browser.text("#motion button") == "play"
    last = len(motion.time) - 1
    browser.run(f"motion.show({last - 3}); document.querySelector('#motion button').click()")
    browser.until(f"document.querySelector('#motion input').value === '{last}'")
    browser.until("document.querySelector('#motion button').textContent === 'play'")
    assert browser.run(place) == f"translate({motion.places()[1][-1]:.2f} 0)".replace(".00 ", " ")
    assert browser.run(place) != before


def test_ticks_of_a_logarithmic_axis_say_their_number(browser: Browser, page_file: Path) -> None:
    browser.size(1200)
    browser.open(write_page(hostile(), page_file))
    browser.until("document.querySelectorAll('.xtick text').length > 0")
    ticks = browser.run("[...document.querySelectorAll('.xtick text')].map(t => t.textContent)")
    assert ticks == ["2", "5", "10", "20", "50", "100", "200"]


def test_titles_of_axes_are_whole_on_a_telephone(browser: Browser, page_file: Path) -> None:
    plot = figure(x="change at the limit of the tolerance in %", y="")
    plot.add_trace(line([0.0, 1.0], ["a category of many words", "b"], name="n", colour="#000000"))
    plot.update_yaxes(automargin=True)
    stage = Stage("title", "It is said.", (("name", "1 N"),), plot=plot)
    browser.size(390)
    browser.open(write_page(Page("a_name_of_parts" * 4, "s", (), (stage,), ()), page_file))
    browser.until("document.querySelectorAll('.xtitle').length > 0")
    left, right = browser.run(
        "(() => { const b = document.querySelector('.xtitle').getBoundingClientRect(); return [b.left, b.right]; })()"
    )
    assert left >= 0
    assert right <= 390
    order = "[...document.querySelectorAll('.stage > *')].map(e => e.tagName)"
    assert browser.run(order) == ["P", "DIV", "TABLE"]
    browser.size(1200)
    browser.until("document.querySelector('.stage .said').getBoundingClientRect().left > 600")
