"""Text from files in HTML pages: shown, never run."""

from html.parser import HTMLParser
from pathlib import Path

import plotly.graph_objects as go
import pytest
from hostile_values import TEXTS

from msl_fem.export.fmu import fmu_files
from msl_fem.export.formats import ModelSource
from msl_fem.report.page import Grid, Page, Stage, write_page


class Elements(HTMLParser):
    """Counts the elements of a page and collects attributes that run or fetch something."""

    def __init__(self, text: str) -> None:
        super().__init__(convert_charrefs=True)
        self.names: list[str] = []
        self.suspicious: list[str] = []
        self.shown = ""
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.names.append(tag)
        for name, value in attrs:
            if name.startswith("on") or "javascript:" in str(value) or str(value).startswith(("http", "file:")):
                self.suspicious.append(f"{tag} {name}={value}")

    def handle_data(self, data: str) -> None:
        self.shown += data


def page_of(text: str) -> Page:
    """A page with a text wherever a text can be."""
    figure = go.Figure(go.Scatter(x=[1, 2], y=[3, 4], name=text, text=[text, text]), layout={"title": {"text": text}})
    stage = Stage(text, text, ((text, text),), plot=figure, table=Grid((text, text), ((text, text),)))
    return Page(text, text, ((text, text),), (stage,), ((text, text),), (text,))


MARKUP = [text for text in TEXTS if set(text) & set("<>&\"'")] + ["</script><script>alert(1)</script>", "-->", "]]>"]


@pytest.mark.parametrize("text", MARKUP)
def test_markup_in_a_text_is_shown_and_not_run(text: str, tmp_path: Path) -> None:
    """The page has the elements of a page with harmless texts of the same lengths, and no more."""
    harmless = Elements(write_page(page_of("p" * len(text)), tmp_path / "h.html").read_text(encoding="utf-8"))
    found = Elements(write_page(page_of(text), tmp_path / "p.html").read_text(encoding="utf-8"))
    assert [name for name in found.names if name != "wbr"] == harmless.names  # lines break after an underscore
    assert found.suspicious == harmless.suspicious
    assert text in found.shown


def test_the_page_within_an_fmu_is_escaped_too(servo, table) -> None:
    """An actuator's name allows no markup; the page does not rely on it."""
    named = servo.model_copy(update={"name": "<script>alert(1)</script>\"'&"})
    files = fmu_files(ModelSource(named, table))
    plain = Elements(fmu_files(ModelSource(servo, table))["documentation/index.html"].decode())
    assert Elements(files["documentation/index.html"].decode()).names == plain.names
    assert b"<script>" not in files["modelDescription.xml"]
    for path, content in files.items():
        if path.startswith("sources/"):
            assert b"\"'&" not in content
