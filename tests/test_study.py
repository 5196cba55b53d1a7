"""The whole chain on the reference actuator with a coarse table: its files, its report, its headline numbers."""

import json
import re
from html.parser import HTMLParser
from pathlib import Path

import pytest

from msl_fem import study as study_module
from msl_fem.actuator import Actuator, load_actuator
from msl_fem.errors import InputError
from msl_fem.maps import read_map
from msl_fem.record import load_record
from msl_fem.study import run_study
from msl_fem.table.magnetic_table import read_table

ROOT = Path(__file__).parent.parent
SERVO = ROOT / "geometries" / "fast_tool_servo.toml"


@pytest.fixture(scope="module")
def folder(study_folder: Path) -> Path:
    return study_folder


def test_every_file_can_be_read_back(folder: Path) -> None:
    assert read_table(folder / "table.nc").gap.size == 8
    assert read_map(folder / "map.json").levels.tolist() == [1.2, 1.6]
    record = load_record(folder / "record")
    assert {run.name: run.role for run in record.runs} == {"noise": "fit", "swept_sine": "held-out"}
    assert {p.name for p in folder.iterdir()} == {
        "table.nc", "map.json", "record", "armax.json", "study.json", "report.html",
    }  # fmt: skip


def test_headline_numbers_are_those_of_a_working_actuator(folder: Path) -> None:
    found = json.loads((folder / "study.json").read_text())
    assert set(found["seconds"]) == {"table", "map", "coupled model", "identification", "closed loop"}
    assert found["armax"]["swept_sine"]["free_run"] > 95
    assert found["closed_loop"]["sine"]["tracking_rms_m"] < 0.005 * 0.4e-3
    assert found["closed_loop"]["peak_sensitivity"] < 2
    assert found["guard_violations"] == 0
    unseen = found["closed_loop"]["unseen_plants"]
    assert unseen["plants"] == 20
    assert 0 < unseen["held_share_at_least"] < unseen["held_share"] < 1  # the second mass is what this design loses
    assert 1.1 < found["coupled_model"]["stability_limit_A"] < 1.3
    assert 3.2 < found["map_at_nominal_gap_A"]["1.2 T"] < 3.6
    costs = found["field"]["force_error_of_sides_apart"]
    assert (
        0.07 > abs(costs["opposing"]) > 0.05 > 0.01 > abs(costs["aiding"])
    )  # with the ends of the stacks: 5.9 and 0.2 %


class _Page(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.titles: list[str] = []
        self.sources: list[str] = []
        self.plots = 0
        self._in_title = False

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        self._in_title = tag == "h2"
        self.sources += [str(given[k]) for k in ("src", "href") if k in given]
        self.plots += "plotly-graph-div" in str(given.get("class"))

    def handle_data(self, data: str) -> None:
        if self._in_title:
            self.titles.append(data)
            self._in_title = False


def test_the_report_is_self_contained_and_complete(folder: Path) -> None:
    text = (folder / "report.html").read_text(encoding="utf-8")
    page = _Page()
    page.feed(text)
    assert all(source.startswith(("data:", "#")) for source in page.sources), "no request leaves the page"
    assert page.plots == 13, "ten of the stages, three of the explorer"
    for figure in ("Fig. 2", "Fig. 5", "Fig. 6", "Fig. 8", "Fig. 9", "Fig. 11"):
        assert any(figure in title for title in page.titles), figure
    found = json.loads((folder / "study.json").read_text())
    fit = found["armax"]["swept_sine"]["free_run"]
    assert f"{fit:.2f} %" in text
    assert re.search(r"<b>0</b><span>guard violations", text)
    assert "where they aid; the actuator states opposing." in text
    assert (folder / "report.html").stat().st_size < 8e6


def test_an_actuator_that_lacks_a_stage_is_refused_before_the_work() -> None:
    magnet_alone = load_actuator(ROOT / "geometries" / "e1.toml")
    with pytest.raises(InputError, match=r"e1 has no \[sides\], \[motion\], \[drive\], \[controller\]"):
        run_study(magnet_alone)


def test_an_amplitude_that_is_refused_is_halved_and_the_report_says_so() -> None:
    """A magnet too weak for the usual references still gets its report."""
    tried = []

    def attempt(amplitude: float) -> str:
        tried.append(amplitude)
        if amplitude > 0.3:
            raise InputError(f"{amplitude:g} is too much")
        return "done"

    assert study_module._bearable(attempt, 1.0, "the step's amplitude in mm") == (
        "done", "the step's amplitude in mm is 0.25 instead of 1: 1 is too much",
    )  # fmt: skip
    assert tried == [1.0, 0.5, 0.25]
    assert study_module._bearable(attempt, 0.2, "") == ("done", "")
    with pytest.raises(InputError, match=r"0\.3125 is too much"):
        study_module._bearable(attempt, 10.0, "")


def test_the_name_of_an_actuator_cannot_carry_markup() -> None:
    content = load_actuator(SERVO).model_dump(by_alias=True, exclude={"file"})
    with pytest.raises(ValueError, match="name"):
        Actuator.model_validate({**content, "name": "<script>"})
