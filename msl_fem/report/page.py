"""One self-contained HTML page: works offline, asks the network for nothing, light or dark, on screen and on paper."""

import base64
import io
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import plotly.graph_objects as go
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from matplotlib.figure import Figure
from plotly.offline import get_plotlyjs

from msl_fem.files.whole_file import whole_file
from msl_fem.report.figures import HEIGHT

_FOLDER = Path(__file__).parent
_ENVIRONMENT = Environment(
    loader=FileSystemLoader(_FOLDER), autoescape=True, undefined=StrictUndefined, trim_blocks=True
)


@dataclass(frozen=True)
class Grid:
    """A table of texts: names of the columns, rows of cells."""

    columns: Sequence[str]
    rows: Sequence[Sequence[str]]


@dataclass(frozen=True)
class Widget:
    """A piece of a page that computes in the browser: its HTML, all texts in it escaped, and its script."""

    html: str
    script: str


@dataclass(frozen=True)
class Stage:
    """A section of the page: one sentence that says what is seen, a figure or a picture, numbers beside it.

    Attributes
    ----------
    title, sentence : texts, escaped when they are written
    numbers : pairs (name, value with its unit)
    plot : an interactive figure
    image : a picture
    table : a table as wide as the page, above the figure
    widget : something to work with, above the figure
    drawing : SVG in the page's colours, its texts escaped
    listing : a title and a text that unfolds below it, as it is
    """

    title: str
    sentence: str
    numbers: tuple[tuple[str, str], ...]
    plot: go.Figure | None = None
    image: Figure | None = None
    table: Grid | None = None
    widget: Widget | None = None
    drawing: str = ""
    listing: tuple[str, str] | None = None

    def figure(self, number: int) -> str:
        """The figure's place in the page and its data, named by the section's number; '' without a figure."""
        if self.plot is None:
            return ""
        name, height = f"figure-{number}", self.plot.layout.height or HEIGHT
        place = f'<div class="plotly-graph-div" id="{name}" style="height:{height}px"></div>'
        return (
            f'{place}<script type="application/json" data-figure="{name}">{script_text(self.plot.to_json())}</script>'
        )

    @property
    def picture(self) -> str:
        """The picture as PNG in base64; '' without one."""
        if self.image is None:
            return ""
        buffer = io.BytesIO()
        self.image.savefig(buffer, format="png", dpi=130)
        return base64.b64encode(buffer.getvalue()).decode()


@dataclass(frozen=True)
class Page:
    """A report: title, headline numbers (value, label), notes, stages, how it was made."""

    title: str
    subtitle: str
    headline: tuple[tuple[str, str], ...]
    stages: tuple[Stage, ...]
    provenance: tuple[tuple[str, str], ...]
    notes: tuple[str, ...] = field(default_factory=tuple)


def script_text(json: str) -> str:
    """JSON that can stand inside a script element: nothing in it can end the element."""
    return json.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")


def html_from(template: str, **content: Any) -> str:
    """The HTML of a template that lies beside this module; texts are escaped."""
    return _ENVIRONMENT.get_template(template).render(**content)


def page_part(name: str) -> str:
    """The text of a script or style sheet that lies beside this module."""
    return (_FOLDER / name).read_text(encoding="utf-8")


def write_page(page: Page, path: Path) -> Path:
    """The HTML file, whole or not at all; texts are escaped. Raises InputError where it cannot be written."""
    html = html_from(
        "page.html.j2",
        title=page.title,
        subtitle=page.subtitle,
        headline=page.headline,
        notes=page.notes,
        stages=page.stages,
        provenance=page.provenance,
        css=page_part("page.css"),
        page_js=page_part("page.js"),
        scripts=[stage.widget.script for stage in page.stages if stage.widget],
        plotly_js=get_plotlyjs(),
    )
    with whole_file(path) as partial:
        partial.write_text(html, encoding="utf-8")
    return path
