"""How far the two sides of an actuator are decoupled, as a picture."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from msl_fem.magnetics.field_map import DecouplingMap
from msl_fem.report.style import GREY, SERIES

Array = NDArray[np.float64]
SMALLEST = 1e-5  # of a share or an error, that can be drawn on a logarithmic axis


def draw_decoupling(found: DecouplingMap) -> Figure:
    """Three panels over the gap or the position: linked share; force error of independent sides, aiding and opposing.

    A line for each level that both sides are at, dashed where it lies outside the preferred region; grey: one side on.
    """
    figure = Figure(figsize=(10.5, 3.6), layout="constrained")
    FigureCanvasAgg(figure)
    share, aiding, opposing = figure.subplots(1, 3)
    _draw_share(share, found)
    for axes, error, name in zip((aiding, opposing), found.force_error, ("aiding", "opposing"), strict=True):
        _draw_error(axes, found, error, title=f"force error, both on, {name}")
    aiding.sharey(opposing)
    return figure


def _levels(found: DecouplingMap) -> list[tuple[int, dict[str, Any]]]:
    """Index of each level that has current, and how its line looks."""
    return [
        (n, {"color": SERIES[(n - 1) % len(SERIES)], "linestyle": "-" if level <= found.preferred else "--"})
        for n, level in enumerate(found.level)
        if level > 0
    ]


def _draw_share(axes: Axes, found: DecouplingMap) -> None:
    gap = found.gap.T.ravel()
    order = np.argsort(gap)
    for n, look in _levels(found):
        share = np.abs(found.linked_share[:, :, n]).T.ravel()
        axes.plot(gap[order] * 1e3, 100 * share[order], marker=".", label=f"{found.level[n]:g} T", **look)
    axes.set(xlabel="gap of the side that is on in mm", ylabel="share in %", ylim=(0, None))
    axes.set_title("flux linkage that links the other side", loc="left", fontsize=10)
    axes.legend(frameon=False, fontsize=8)


def _draw_error(axes: Axes, found: DecouplingMap, error: Array, *, title: str) -> None:
    position = found.position * 1e3
    one_on = np.where(found.one_side_on() & found.both_preferred(), np.abs(error), 0.0).max(axis=(1, 2))
    axes.plot(position, 100 * np.maximum(one_on, SMALLEST), color=GREY, marker=".", label="one side on, preferred")
    for n, look in _levels(found):
        both = np.maximum(np.abs(error[:, n, n]), SMALLEST)
        axes.plot(position, 100 * both, marker=".", label=f"both at {found.level[n]:g} T", **look)
    axes.axhline(100 * found.tolerance, color=GREY, linewidth=0.8, linestyle=":")
    axes.set_yscale("log")
    axes.set(xlabel="position in mm", ylabel="of the larger force, in %")
    axes.set_title(title, loc="left", fontsize=10)
    axes.legend(frameon=False, fontsize=8)
