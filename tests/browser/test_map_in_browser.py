"""The page of a pair's map in a real browser: its numbers are the table's, its judgements those of the guard."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import ROOT
from devtools import Browser

from msl_fem.maps import REGIONS
from msl_fem.maps.pair_guard import PairGuard
from msl_fem.maps.pair_limits import pair_map
from msl_fem.report.map_page import pair_map_page
from msl_fem.report.page import write_page
from msl_fem.table.pair_table import PAIR_NODES, PairTable, read_pair_table


@pytest.fixture(scope="module")
def pair() -> PairTable:
    return read_pair_table(ROOT / "lookup_tables" / "fast_tool_servo_pair.nc")


@pytest.fixture(scope="module")
def guard(pair: PairTable) -> PairGuard:
    return PairGuard(pair_map(pair))


@pytest.fixture(scope="module")
def page(pair: PairTable, guard: PairGuard, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_page(pair_map_page(pair, guard.pair_map, "pair.nc"), tmp_path_factory.mktemp("page") / "pair.html")


@pytest.fixture
def shown(browser: Browser, page: Path) -> Browser:
    """The page, opened once for all that only read it or move its sliders."""
    browser.size(1200)
    browser.colours("light")
    browser.show(page)
    assert browser.complaints == []
    return browser


def commands(pair: PairTable, n: int, seed: int) -> np.ndarray:
    """(n, 3) positions and both currents inside the table, some at its nodes and its ends."""
    generator = np.random.default_rng(seed)
    points = np.stack([generator.uniform(axis[0], axis[-1], n) for axis in pair.axes], axis=1)
    points[: n // 8] = np.stack([generator.choice(axis, n // 8) for axis in pair.axes], axis=1)
    points[0] = [axis[-1] for axis in pair.axes]
    return points


def test_the_page_computes_what_the_table_says(shown: Browser, pair: PairTable) -> None:
    points = commands(pair, 200, 3)
    found = np.array(shown.run(f"{json.dumps(points.tolist())}.map(([x, i, j]) => pairExplorer.evaluate(x, i, j))"))
    expected = pair.evaluate(*points.T)
    for k, name in enumerate(PAIR_NODES):
        scale = np.abs(pair.nodes[name]).max()
        np.testing.assert_allclose(found[:, k] / scale, expected[name] / scale, rtol=0, atol=1e-11, err_msg=name)
    outside = [[pair.position[-1] * 1.001, 1, 1], [0, 12.1, 1], [0, 1, -12.1]]
    assert shown.run(f"{json.dumps(outside)}.map(([x, i, j]) => pairExplorer.evaluate(x, i, j))") == [None] * 3


def test_the_page_judges_as_the_guard_of_the_pair_does(shown: Browser, pair: PairTable, guard: PairGuard) -> None:
    """Random commands, and commands on a side's limit and the next number above it."""
    points = commands(pair, 400, 4)
    points[300:, 1:] *= 1.1
    for n in range(200, 300):
        x, i, j = points[n] * [1, 1, 0.4]
        bears = guard.judge(i, j, x).limits_1
        assert bears is not None
        limit = max(bears[n % 2], 0.0)
        points[n] = x, np.sign(i) * (limit if n % 4 < 2 else np.nextafter(limit, np.inf)), j
    found: list[dict[str, Any]] = shown.run(
        f"{json.dumps(points.tolist())}.map(([x, i, j]) => pairExplorer.judge(x, i, j))"
    )
    x, i, j = points.T
    assert [one["region"] for one in found] == guard.regions(i, j, x).tolist()
    for one, (x_n, i_n, j_n) in zip(found[:100], points, strict=False):
        judged = guard.judge(i_n, j_n, x_n)
        assert judged.limits_1 is not None
        assert judged.limits_2 is not None
        assert one["limits"] == [list(judged.limits_1), list(judged.limits_2)]


def test_what_is_written_follows_the_sliders(shown: Browser, pair: PairTable, guard: PairGuard) -> None:
    for x, i, j in ((2e-4, 3.0, -5.0), (-1e-4, 2.0, 0.0), (0.0, 1.0, 9.0)):
        shown.run(f"pairExplorer.go({x}, {i}, {j})")
        judged = guard.judge(i, j, x)
        assert shown.text('#pair-explorer [data-out="region"]') == judged.region
        said = shown.text('#pair-explorer [data-out="reason"]').split(":")[0]
        assert said == judged.reason.split(":")[0]
        force = float(shown.text('#pair-explorer [data-out="force"]').removesuffix(" N").replace("\u2212", "-"))
        assert force == pytest.approx(float(pair.evaluate(x, i, j)["force"]), rel=6e-5)
    assert judged.region == REGIONS[2]


@pytest.mark.parametrize(("width", "scheme"), [(1200, "light"), (390, "dark")])
def test_the_page_fits_its_window(browser: Browser, page: Path, width: int, scheme: str) -> None:
    browser.size(width)
    browser.colours(scheme)
    browser.open(page)
    assert browser.complaints == []
    assert [a for a in browser.requests if not a.startswith(("data:", "blob:"))] == [page.resolve().as_uri()]
    assert browser.run("document.documentElement.scrollWidth") <= width
    assert browser.run("document.querySelectorAll('#pair-explorer .main-svg').length") >= 3
    browser.colours("light")
