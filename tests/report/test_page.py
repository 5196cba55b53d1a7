"""The page escapes texts, embeds pictures, and is written whole."""

from pathlib import Path

from msl_fem.report.page import Page, Stage, write_page
from msl_fem.report.style import figure, line


def test_texts_are_escaped_and_the_page_asks_nothing_of_the_network(tmp_path: Path) -> None:
    plot = figure(x="<b>x", y="y")
    plot.add_trace(line([0, 1], [0, 1], name="</script><script>alert(1)</script>", colour="#000"))
    stage = Stage("<i>title", 'a < b & "c"', (("<n>", "1 > 0"),), plot=plot)
    file = write_page(Page("<t>", "s", (("1", "<l>"),), (stage,), (("p", "<q>"),), ("<note>",)), tmp_path / "r.html")
    text = file.read_text(encoding="utf-8")
    body = text[text.index("<body>") :]
    for raw in ("<i>title", "<n>", "<l>", "<q>", "<note>", "<script>alert"):
        assert raw not in body, raw
    assert "&lt;note&gt;" in body
    assert 'src="http' not in body
    assert [p.name for p in tmp_path.iterdir()] == ["r.html"]
