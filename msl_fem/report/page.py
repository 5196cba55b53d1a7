"""One self-contained HTML page: works offline, asks the network for nothing."""

import base64
import io
from dataclasses import dataclass, field
from pathlib import Path

import plotly.graph_objects as go
import plotly.io
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from matplotlib.figure import Figure
from plotly.offline import get_plotlyjs

from msl_fem.whole_file import whole_file

_ENVIRONMENT = Environment(
    loader=FileSystemLoader(Path(__file__).parent), autoescape=True, undefined=StrictUndefined, trim_blocks=True
)


@dataclass(frozen=True)
class Stage:
    """A section of the page: one sentence that says what is seen, a figure or a picture, numbers beside it."""

    title: str
    sentence: str
    numbers: tuple[tuple[str, str], ...]
    plot: go.Figure | None = None
    image: Figure | None = None

    @property
    def figure(self) -> str:
        if self.plot is None:
            return ""
        config = {"displaylogo": False, "responsive": True}
        return plotly.io.to_html(self.plot, full_html=False, include_plotlyjs=False, config=config)

    @property
    def picture(self) -> str:
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


def write_page(page: Page, path: Path) -> Path:
    """The HTML file, whole or not at all; texts are escaped. Raises InputError where it cannot be written."""
    html = _ENVIRONMENT.get_template("page.html.j2").render(
        title=page.title,
        subtitle=page.subtitle,
        headline=page.headline,
        notes=page.notes,
        stages=page.stages,
        provenance=page.provenance,
        plotly_js=get_plotlyjs(),
    )
    with whole_file(path) as partial:
        partial.write_text(html, encoding="utf-8")
    return path
