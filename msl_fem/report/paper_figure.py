"""A figure of matplotlib that a notebook shows by itself, whether or not pyplot was imported; no window is opened."""

import io
from typing import Any

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

DPI = 110


class PaperFigure(Figure):
    """A figure with the canvas that writes PNG, SVG and PDF."""

    def __init__(self, *size: Any, **options: Any) -> None:
        super().__init__(*size, **options)
        FigureCanvasAgg(self)

    def _repr_png_(self) -> bytes:
        """What a notebook shows."""
        content = io.BytesIO()
        self.savefig(content, format="png", dpi=DPI)
        return content.getvalue()
