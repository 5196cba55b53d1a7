"""One look for all figures: colours that the colour-blind can tell apart, plain axes, labels with units."""

from typing import Any

import numpy as np
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
    axis["hoverformat"] = ".5~g"
    axis["gridcolor"] = "rgba(107,114,128,0.2)"
    made.update_xaxes(axis)
    made.update_yaxes(axis)


def logarithmic(made: go.Figure, values: Any, *, along: str, row: int | None = None) -> None:
    """Make an axis ('x' or 'y') of a figure logarithmic, with ticks at 1, 2, 5 that say their whole number.

    Of more than three decades of `values` the powers of ten alone are ticks.
    """
    known = np.concatenate([np.ravel(np.asarray(v, dtype=float)) for v in values])
    known = known[np.isfinite(known) & (known > 0)]
    place = {} if row is None else {"row": row, "col": 1}
    update = made.update_xaxes if along == "x" else made.update_yaxes
    update(type="log", **place)
    if not known.size:
        return
    low, high = (int(n) for n in (np.floor(np.log10(known.min())), np.ceil(np.log10(known.max()))))
    steps = (1, 2, 5) if np.log10(known.max() / known.min()) <= 3 else (1,)
    ticks = [step * 10.0**power for power in range(low, high + 1) for step in steps]
    update(tickvals=ticks, ticktext=[f"{tick:g}" for tick in ticks], **place)


def line(x: Any, y: Any, *, name: str, colour: str, **more: Any) -> go.Scatter:
    """A line; arrays are stored with seven digits, hover values say five."""
    x, y = _short(x), _short(y)
    style = {"color": colour, "width": 1.8, **more.pop("line", {})}
    return go.Scatter(x=x, y=y, name=name, mode=more.pop("mode", "lines"), line=style, **more)


def _short(values: Any) -> Any:
    return values.astype(np.float32) if isinstance(values, np.ndarray) and values.dtype == np.float64 else values
