"""One look for all figures: colours that the colour-blind can tell apart, plain axes, labels with units."""

from typing import Any

import plotly.graph_objects as go

# Okabe and Ito (2008), a palette for all kinds of colour vision
BLUE, ORANGE, GREEN, RED, SKY, GREY = "#0072B2", "#E69F00", "#009E73", "#D55E00", "#56B4E9", "#6b7280"
SERIES = (BLUE, ORANGE, GREEN, RED, SKY, "#CC79A7", "#000000")
REGION_FILL = {
    "preferred": "rgba(0,158,115,0.16)",
    "discouraged": "rgba(230,159,0,0.20)",
    "unacceptable": "rgba(213,94,0,0.18)",
}
HEIGHT = 420


def figure(*, x: str, y: str, height: int = HEIGHT) -> go.Figure:
    """An empty figure with labelled axes."""
    made = go.Figure()
    dress(made, height=height)
    made.update_xaxes(title={"text": x})
    made.update_yaxes(title={"text": y})
    return made


def dress(made: go.Figure, *, height: int = HEIGHT) -> None:
    """Give a figure the look that all share."""
    made.update_layout(
        height=height,
        margin={"l": 64, "r": 40, "t": 16, "b": 52},
        paper_bgcolor="rgba(0,0,0,0)",
        plot_bgcolor="rgba(0,0,0,0)",
        font={"family": "system-ui, sans-serif", "size": 13},
        legend={"orientation": "h", "y": 1.02, "yanchor": "bottom", "x": 0},
        modebar={"orientation": "v", "bgcolor": "rgba(0,0,0,0)", "color": GREY},
        hovermode="closest",
    )
    axis: dict[str, Any] = {"showline": True, "linecolor": GREY, "ticks": "outside", "zeroline": False}
    axis["gridcolor"] = "rgba(107,114,128,0.2)"
    made.update_xaxes(axis)
    made.update_yaxes(axis)


def line(x: Any, y: Any, *, name: str, colour: str, **more: Any) -> go.Scatter:
    """A line with hover values of five digits."""
    style = {"color": colour, "width": 1.8, **more.pop("line", {})}
    return go.Scatter(x=x, y=y, name=name, mode=more.pop("mode", "lines"), line=style, **more)
