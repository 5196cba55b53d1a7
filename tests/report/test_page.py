"""The page escapes texts, embeds pictures, forbids itself the network, and is written whole."""

import base64
import re
from pathlib import Path

from matplotlib.figure import Figure

from msl_fem.maps import operating_map
from msl_fem.report.explorer import explorer
from msl_fem.report.figures import figure, line
from msl_fem.report.page import Grid, Page, Stage, script_text, write_page
from msl_fem.table.magnetic_table import MagneticTable


def test_texts_are_escaped_and_the_page_asks_nothing_of_the_network(tmp_path: Path) -> None:
    plot = figure(x="<b>x", y="y")
    plot.add_trace(line([0, 1], [0, 1], name="</script><script>alert(1)</script>", colour="#000"))
    stage = Stage(
        "<i>title", 'a < b & "c"', (("<n>", "1 > 0"),), plot=plot, table=Grid(("<col>",), (("<cell>",), ("</td>x",)))
    )
    file = write_page(Page("<t>", "s", (("1", "<l>"),), (stage,), (("p", "<q>"),), ("<note>",)), tmp_path / "r.html")
    text = file.read_text(encoding="utf-8")
    body = text[text.index("<body>") :]
    for raw in ("<i>title", "<n>", "<l>", "<q>", "<note>", "<script>alert", "<col>", "<cell>", "</td>x"):
        assert raw not in body, raw
    assert "&lt;note&gt;" in body
    assert "&lt;cell&gt;" in body
    assert 'src="http' not in body
    assert "default-src 'none'" in text[: text.index("<title>")]
    assert [p.name for p in tmp_path.iterdir()] == ["r.html"]


def test_a_picture_is_part_of_the_file(tmp_path: Path) -> None:
    stage = Stage("t", "s", (), image=Figure(figsize=(1, 1)))
    text = write_page(Page("t", "s", (), (stage,), ()), tmp_path / "r.html").read_text(encoding="utf-8")
    data = re.search(r'src="data:image/png;base64,([^"]+)"', text)
    assert data
    assert base64.b64decode(data[1]).startswith(b"\x89PNG")


def test_json_in_a_script_cannot_end_it() -> None:
    assert "<" not in script_text('{"a": "</script><!--"}')


def test_two_pages_of_the_same_content_are_the_same_file(tmp_path: Path) -> None:
    def page() -> Page:
        plot = figure(x="x", y="y")
        plot.add_trace(line([0, 1], [0, 1], name="one", colour="#000"))
        return Page("t", "s", (), (Stage("a", "b", (), plot=plot), Stage("c", "d", (), plot=plot)), ())

    first, second = (write_page(page(), tmp_path / name).read_bytes() for name in ("a.html", "b.html"))
    assert first == second
    assert first.count(b'id="figure-1"') == first.count(b'id="figure-2"') == 1


def test_a_report_with_an_explorer_stays_small(tmp_path: Path, table: MagneticTable) -> None:
    widget = explorer(table, operating_map(table, levels=(0.5, 1.0)), start=(2.0, 5e-4), magnets=2)
    stage = Stage("map", "sentence", (), widget=widget)
    size = write_page(Page("t", "s", (), (stage,), ()), tmp_path / "r.html").stat().st_size
    assert 4e6 < size < 6e6
    assert "limit for 0.5 T" in widget.html
    assert "force of a side, 2 magnets" in widget.html


def test_one_magnet_a_side_has_no_second_force(table: MagneticTable) -> None:
    widget = explorer(table, operating_map(table, levels=(0.5, 1.0)), start=(2.0, 5e-4))
    assert "force of a side" not in widget.html
