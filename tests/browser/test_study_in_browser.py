"""The study's report in a real browser: it opens without a complaint, and what it shows is what the table says."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from devtools import Browser

from msl_fem.maps import Guard, read_map
from msl_fem.table.magnetic_table import MagneticTable, read_table

UNITS = {
    "coenergy": ("mJ", 1e3), "flux_linkage": ("mWb", 1e3), "force": ("N", 1.0), "incremental_inductance": ("mH", 1e3),
    "force_current_slope": ("N/A", 1.0), "force_gap_slope": ("N/mm", 1e-3),
}  # fmt: skip


@pytest.fixture
def report(browser: Browser, study_folder: Path) -> Browser:
    browser.size(1200)
    browser.colours("light")
    browser.open(study_folder / "report.html")
    return browser


@pytest.fixture
def explorer(browser: Browser, study_folder: Path) -> Browser:
    """The report as the test before left it, back at its first current and gap: opening it draws 13 figures."""
    browser.show(study_folder / "report.html")
    browser.size(1200)
    browser.colours("light")
    browser.complaints.clear()
    start = browser.run("JSON.parse(document.getElementById('explorer-data').textContent).start")
    type_in(browser, "current", repr(start["current"]))
    type_in(browser, "gap", repr(start["gap"] * 1e3))
    return browser


@pytest.fixture(scope="module")
def study_table(study_folder: Path) -> MagneticTable:
    return read_table(study_folder / "table.nc")


@pytest.fixture(scope="module")
def guard(study_folder: Path) -> Guard:
    return Guard(read_map(study_folder / "map.json"))


def type_in(browser: Browser, name: str, text: str) -> None:
    """The text as a user's input of the current in A or of the gap in mm."""
    field = f"document.getElementById('explorer-{name}-number')"
    browser.run(f"{field}.value = '{text}'; {field}.dispatchEvent(new Event('input'))")


def shown(browser: Browser, name: str) -> tuple[float, str]:
    """Number and unit of a value of the explorer."""
    text = browser.text(f'#explorer [data-out="{name}"]').replace("\u2212", "-")
    found = re.fullmatch(r"(-?[0-9.]+(?:e-?[0-9]+)?) (\S+)", text)
    assert found, text
    return float(found[1]), found[2]


def state(browser: Browser) -> tuple[float, float]:
    """Current in A and gap in m that the explorer is at."""
    found: dict[str, float] = browser.run("({...explorer.state})")
    return found["current"], found["gap"]


def assert_readout_is_true(browser: Browser, table: MagneticTable, guard: Guard) -> None:
    """Every number of the explorer against the table and the guard at the sliders' values."""
    current, gap = state(browser)
    values = table.evaluate(current, gap)
    for name, (unit, scale) in UNITS.items():
        wanted = pytest.approx(float(values[name]) * scale, rel=6e-5, abs=1e-9 * scale)
        assert shown(browser, name) == (wanted, unit), name
    assert shown(browser, "side_force")[0] == pytest.approx(2 * float(values["force"]), rel=6e-5, abs=1e-9)
    assert shown(browser, "gap") == (pytest.approx(gap * 1e3, rel=6e-4), "mm")
    assert browser.text('#explorer [data-out="region"]') == guard.classify(current, gap)
    for k, limit in enumerate(guard.limit(gap)):
        assert shown(browser, f"limit_{k}")[0] == pytest.approx(float(limit), rel=6e-4)
        assert shown(browser, f"margin_{k}")[0] == pytest.approx(float(limit) - current, rel=6e-3, abs=1e-12)


def test_the_page_opens_without_a_complaint_and_asks_for_nothing(report: Browser) -> None:
    assert report.complaints == []
    beyond = [address for address in report.requests if not address.startswith(("data:", "blob:"))]
    assert [Path(address).name for address in beyond] == ["report.html"]
    drawn = report.run(
        "[...document.querySelectorAll('.plotly-graph-div')].map(d => d.querySelectorAll('.main-svg').length)"
    )
    assert len(drawn) == 13
    assert min(drawn) > 0
    assert report.run("document.documentElement.scrollWidth") == 1200, "nothing is wider than the window"


def test_a_page_that_errs_or_asks_for_something_is_noticed(browser: Browser, tmp_path: Path) -> None:
    """The checks above can fail."""
    bad = tmp_path / "bad.html"
    bad.write_text("<script>fetch('http://127.0.0.1:9/x').catch(() => 0); console.error('oh'); missing();</script>")
    browser.open(bad)
    assert any("oh" in text for text in browser.complaints)
    assert any("missing is not defined" in text for text in browser.complaints)
    assert any(address.startswith("http://127.0.0.1:9") for address in browser.requests)


def test_the_page_forbids_itself_the_network(explorer: Browser) -> None:
    blocked = explorer.run("fetch('http://127.0.0.1:9/x').then(() => 'sent', error => String(error))")
    assert "Failed to fetch" in blocked
    assert any("Content Security Policy" in text for text in explorer.complaints)


def test_the_page_computes_what_the_table_says(explorer: Browser, study_table: MagneticTable) -> None:
    generator = np.random.default_rng(5)
    t = study_table
    current = np.r_[generator.uniform(-t.current[-1], t.current[-1], 400), t.current[[0, 1, -1]], -t.current[-1]]
    gap = np.r_[generator.uniform(t.gap[0], t.gap[-1], 400), t.gap[[0, 3, -1]], t.gap[0]]
    points = json.dumps(np.stack([current, gap], axis=1).tolist())
    found = np.array(explorer.run(f"{points}.map(([i, g]) => explorer.evaluate(i, g))")).T
    expected = t.surface(current, gap)
    scale = np.abs(expected).max(axis=1, keepdims=True)
    np.testing.assert_allclose(found / scale, expected / scale, rtol=1e-12, atol=1e-15)
    outside = [(1.0, t.gap[0] * 0.999), (1.0, t.gap[-1] * 1.001), (t.current[-1] * 1.001, t.gap[1])]
    assert explorer.run(f"{json.dumps(outside)}.map(([i, g]) => explorer.evaluate(i, g))") == [None] * 3


def test_the_page_judges_as_the_guard_does(explorer: Browser, guard: Guard) -> None:
    """Random commands, and commands on the limits to the last bit."""
    generator = np.random.default_rng(6)
    gap = generator.uniform(guard.arrays.gap[0] * 0.9, guard.arrays.gap[-1] * 1.05, 600)
    gap[:20] = generator.choice(guard.arrays.gap, 20)
    limits = guard.limit(gap)
    current = np.where(np.isnan(limits[0]), 1.0, limits[generator.integers(0, 2, 600), np.arange(600)])
    current[200:400] = np.nextafter(current[200:400], np.inf)
    current[400:] = generator.uniform(-13, 13, 200)
    points = json.dumps(np.stack([current, gap], axis=1).tolist())
    found: list[dict[str, Any]] = explorer.run(f"{points}.map(([i, g]) => explorer.judge(i, g))")
    assert [f["region"] for f in found] == guard.regions(current, gap).tolist()
    assert [f["reason"] for f in found] == guard.reasons(current, gap).tolist()
    inside = ~np.isnan(limits[0])
    assert [f["limits"] is not None for f in found] == inside.tolist()
    assert np.array([f["limits"] for f in found if f["limits"]]).T.tolist() == limits[:, inside].tolist()


def test_sliders_move_the_numbers(explorer: Browser, study_table: MagneticTable, guard: Guard) -> None:
    start = state(explorer)
    assert_readout_is_true(explorer, study_table, guard)
    seen = set()
    for name, key, times in (("gap", "ArrowLeft", 30), ("current", "ArrowRight", 12), ("current", "ArrowRight", 40)):
        explorer.run(f"document.getElementById('explorer-{name}').focus()")
        explorer.press(key, times=times)
        assert_readout_is_true(explorer, study_table, guard)
        seen.add(explorer.text('#explorer [data-out="region"]'))
    current, gap = state(explorer)
    assert gap < 0.8 * start[1]
    assert current > 1.5 * start[0]
    assert seen >= {"discouraged", "unacceptable"}
    for key, end in (("Home", 0.0), ("End", study_table.current[-1])):
        explorer.press(key)
        assert state(explorer)[0] == end
    assert_readout_is_true(explorer, study_table, guard)
    explorer.press("Home")
    assert [shown(explorer, name) for name in ("force", "flux_linkage", "coenergy")] == [
        (0, "N"),
        (0, "mWb"),
        (0, "mJ"),
    ]
    assert explorer.complaints == []


def test_typed_values_and_the_address_go_there_and_stay_inside(explorer: Browser, study_table: MagneticTable) -> None:
    type_in(explorer, "current", "4.25")
    type_in(explorer, "gap", "0.31")
    assert state(explorer) == (4.25, pytest.approx(0.31e-3))
    type_in(explorer, "gap", "77")
    assert state(explorer)[1] == study_table.gap[-1]
    type_in(explorer, "gap", "")
    assert state(explorer)[1] == study_table.gap[-1]
    explorer.run("location.hash = '#gap=0.4&current=2'")
    explorer.until("explorer.state.current === 2")
    assert state(explorer) == (2.0, pytest.approx(0.4e-3))


AT_REST = """new Promise(done => {
    let y = NaN, same = 0;
    const look = () => {
        same = scrollY === y ? same + 1 : 0;
        y = scrollY;
        if (same > 20) done(); else requestAnimationFrame(look);
    };
    look();
})"""


def test_a_click_into_the_map_goes_there(explorer: Browser) -> None:
    """Once the page is at rest: keys of the tests before may still scroll it."""
    explorer.run("document.getElementById('explorer-map').scrollIntoView({block: 'center', behavior: 'instant'})")
    explorer.run(AT_REST)
    place = explorer.run(
        "(() => { const d = document.getElementById('explorer-map'), f = d._fullLayout, b = d.getBoundingClientRect();"
        "return [b.left + f._size.l + f.xaxis.c2p(0.4), b.top + f._size.t + f.yaxis.c2p(7)]; })()"
    )
    explorer.click(*place)
    assert state(explorer) == (pytest.approx(7, abs=0.05), pytest.approx(0.4e-3, abs=4e-6))


def test_the_pointer_reads_values(explorer: Browser, study_table: MagneticTable) -> None:
    figure = "document.getElementById('figure-4')"
    explorer.run(f"{figure}.scrollIntoView({{block: 'center', behavior: 'instant'}})")
    x, y, pointed_at = explorer.run(
        f"(() => {{ const d = {figure}, f = d._fullLayout, b = d.getBoundingClientRect(), t = d._fullData[0];"
        "return [b.left + f._size.l + f.xaxis.c2p(t.x[120]), b.top + f._size.t + f.yaxis.c2p(t.y[120]), t.x[120]]; })()"
    )
    for _ in range(50):  # the first move may come before the figure listens
        explorer.point_at(x, y)
        if explorer.text("#figure-4 .hoverlayer"):
            break
        explorer.run("new Promise(done => setTimeout(done, 50))")
    said = explorer.text("#figure-4 .hoverlayer").replace("\u2212", "-")
    read = re.search(r"\(([\d.]+), ([\d.]+)\)", said)
    assert read, said
    current, force = float(read[1]), float(read[2])
    assert current == pytest.approx(pointed_at, abs=0.11), "the point or a neighbour"
    assert force == pytest.approx(float(study_table.force(current, study_table.gap[0])), rel=1e-4)


def test_light_and_dark(explorer: Browser) -> None:
    def ground() -> float:
        colour = explorer.run("getComputedStyle(document.body).backgroundColor")
        return float(np.mean([int(n) for n in re.findall(r"\d+", colour)[:3]]))

    def ink() -> str:
        return str(explorer.run("document.querySelector('#figure-4 .xtitle').style.fill"))

    assert ground() > 240
    light_ink = ink()
    explorer.run("document.getElementById('theme').click()")
    assert ground() < 40
    assert ink() != light_ink
    explorer.run("document.getElementById('theme').click()")
    assert ground() > 240
    explorer.colours("dark")
    explorer.until("document.documentElement.dataset.theme === 'dark'")  # without a choice it follows the system
    assert ground() < 40
    explorer.colours("light")


def test_paper_is_light_and_the_screen_comes_back(explorer: Browser, tmp_path: Path) -> None:
    width = explorer.run("document.querySelector('#figure-4 .main-svg').clientWidth")
    made = explorer.paper(tmp_path / "report.pdf").read_bytes()
    assert made.startswith(b"%PDF")
    assert 5 <= len(re.findall(rb"/Type\s*/Page[^s]", made)) <= 17
    assert explorer.run("document.querySelector('#figure-4 .main-svg').clientWidth") == width
    assert explorer.complaints == []


@pytest.mark.parametrize("width", [700, 390])
def test_narrow_windows_show_all(explorer: Browser, width: int) -> None:
    explorer.size(width)
    explorer.until(f"document.querySelector('#figure-4 .main-svg').clientWidth < {width}")
    explorer.until(f"document.documentElement.scrollWidth <= {width}")
