"""Pictures by matplotlib: a run, a Pareto front, and how far both sides of an actuator are decoupled."""

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import StrMethodFormatter
from numpy.typing import NDArray

from msl_fem.files.whole_file import whole_file
from msl_fem.record import Run
from msl_fem.record.columns import name_and_unit
from msl_fem.report.figures import BLUE, GREY, ORANGE, RED, SERIES
from msl_fem.report.paper_figure import PaperFigure

if TYPE_CHECKING:  # a picture of a run needs no mesher
    from msl_fem.magnetics.field_map import DecouplingMap

PREFIXED = {"m", "A", "V", "N", "Wb", "T"}
SMALL = (("m", 1e3), ("µ", 1e6), ("n", 1e9))
MOST_POINTS = 20_000  # a channel; more are thinned by equal steps, and the title says so


def draw_run(run: Run, *, made_of: Mapping[str, str] | None = None) -> PaperFigure:
    """One panel for each channel; `made_of` says for a column where it came from."""
    names = [name for name in run.columns if name != "time_s"]
    step = max(1, -(-run.time.size // MOST_POINTS))
    figure = PaperFigure(figsize=(9.0, 1.0 + 1.7 * len(names)), layout="constrained")
    panels = figure.subplots(len(names), 1, sharex=True, squeeze=False)[:, 0]
    for panel, name in zip(panels, names, strict=True):
        label, scale = _label(name, float(np.abs(run[name]).max()))
        panel.plot(run.time[::step], run[name][::step] * scale, linewidth=0.8, color="#0072B2")
        panel.set_ylabel(label)
        panel.margins(x=0.01)
        panel.grid(alpha=0.3)
        if made_of and name in made_of:
            panel.set_title(made_of[name], loc="right", fontsize=8)
    panels[-1].set_xlabel("time in s")
    thinned = f", one sample of {step} drawn" if step > 1 else ""
    rate = 1 / run.sampling_period
    figure.suptitle(f"{run.name}: {run.time.size} samples at {rate:.6g} Hz, role {run.role}{thinned}", fontsize=11)
    return figure


def _label(column: str, largest: float) -> tuple[str, float]:
    """What a panel's axis says, and the factor to its unit: with a prefix where the values are small.

    Units that take no prefix here ("m_per_s", "degC") keep their values as they are.
    """
    above, per, below = column.partition("_per_")
    quantity, unit = name_and_unit(above)
    unit += f"/{below}" if per else ""
    prefix, scale = "", 1.0
    if unit in PREFIXED and 0 < largest < 0.1:
        prefix, scale = next(((p, s) for p, s in SMALL if largest * s >= 1), SMALL[-1])
    return f"{quantity.replace('_', ' ')} in {prefix}{unit}", scale


def save_run_picture(run: Run, path: str | Path, *, made_of: Mapping[str, str] | None = None) -> Path:
    """The PNG written; it appears whole or not at all. Raises InputError where it cannot be written."""
    target = Path(path)
    with whole_file(target) as partial:
        partial.write_bytes(run_picture(run, made_of=made_of))
    return target


def run_picture(run: Run, *, made_of: Mapping[str, str] | None = None) -> bytes:
    """The PNG of a run."""
    content = io.BytesIO()
    draw_run(run, made_of=made_of).savefig(content, dpi=120, format="png")
    return content.getvalue()


LABELS = {"mass": "mass in kg", "loss": "copper loss in W", "force": "force in N", "inductance": "inductance in H"}
FAR = 4.0  # times the front's range: infeasible designs beyond are not shown


@dataclass(frozen=True)
class FrontPoints:
    """Designs by their objectives, each {objective: value in SI units}.

    Attributes
    ----------
    front, others, infeasible : designs
    chosen, guess : one of each, where it is there
    """

    front: Sequence[Mapping[str, float]]
    others: Sequence[Mapping[str, float]]
    infeasible: Sequence[Mapping[str, float]]
    chosen: Mapping[str, float] | None = None
    guess: Mapping[str, float] | None = None


def draw_front(points: FrontPoints, objectives: Sequence[str], *, title: str) -> PaperFigure:
    """A figure with one frame for each pair of objectives; a single objective stands over the designs' rank."""
    pairs = list(combinations(objectives, 2)) or [(objectives[0], objectives[0])]
    figure = PaperFigure(figsize=(6.4 * min(len(pairs), 3), 4.6 * -(-len(pairs) // 3)), layout="constrained")
    for k, (x, y) in enumerate(pairs):
        axes = figure.add_subplot(-(-len(pairs) // 3), min(len(pairs), 3), k + 1)
        _draw_pair(axes, points, x, y)
    figure.axes[0].set_title(title, loc="left", fontsize=11)
    figure.axes[0].legend(frameon=False)
    return figure


def _draw_pair(axes: Axes, points: FrontPoints, x: str, y: str) -> None:
    limits = [FAR * max(p[name] for p in (*points.front, *points.others)) for name in (x, y)]
    shown = [p for p in points.infeasible if p[x] <= limits[0] and p[y] <= limits[1]]
    for designs, name, marker, colour in (
        (shown, "breaks a constraint", "x", GREY), (points.others, "feasible", "o", BLUE),
    ):  # fmt: skip
        if designs:
            abscissae, ordinates = [p[x] for p in designs], [p[y] for p in designs]
            axes.plot(abscissae, ordinates, marker, color=colour, markersize=4, alpha=0.4, label=name)
    front = sorted((p[x], p[y]) for p in points.front)
    axes.plot(*zip(*front, strict=True), "o-", color=BLUE, markersize=5, linewidth=1.4, label="Pareto front")
    for one, name, marker, colour in (
        (points.guess, "closed-form guess", "D", ORANGE), (points.chosen, "chosen", "*", RED),
    ):  # fmt: skip
        if one is not None:
            axes.plot(one[x], one[y], marker, color=colour, markersize=12 if marker == "*" else 8, label=name)
    axes.set_xscale("log")
    axes.set_yscale("log")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axis.set_minor_formatter(StrMethodFormatter("{x:g}"))
    axes.set_xlabel(LABELS[x])
    axes.set_ylabel(LABELS[y])
    axes.grid(visible=True, which="both", alpha=0.25)


Array = NDArray[np.float64]
SMALLEST = 1e-5  # of a share or an error, that can be drawn on a logarithmic axis


def draw_decoupling(found: "DecouplingMap") -> PaperFigure:
    """Three panels over the gap or the position: linked share; force error of independent sides, aiding and opposing.

    A line for each level that both sides are at, dashed where it lies outside the preferred region; grey: one side on.
    """
    figure = PaperFigure(figsize=(10.5, 3.6), layout="constrained")
    share, aiding, opposing = figure.subplots(1, 3)
    _draw_share(share, found)
    for axes, error, name in zip((aiding, opposing), found.force_error, ("aiding", "opposing"), strict=True):
        _draw_error(axes, found, error, title=f"force error, both on, {name}")
    aiding.sharey(opposing)
    return figure


def _levels(found: "DecouplingMap") -> list[tuple[int, dict[str, Any]]]:
    """Index of each level that has current, and how its line looks."""
    return [
        (n, {"color": SERIES[(n - 1) % len(SERIES)], "linestyle": "-" if level <= found.preferred else "--"})
        for n, level in enumerate(found.level)
        if level > 0
    ]


def _draw_share(axes: Axes, found: "DecouplingMap") -> None:
    gap = found.gap.T.ravel()
    order = np.argsort(gap)
    for n, look in _levels(found):
        share = np.abs(found.linked_share[:, :, n]).T.ravel()
        axes.plot(gap[order] * 1e3, 100 * share[order], marker=".", label=f"{found.level[n]:g} T", **look)
    axes.set(xlabel="gap of the side that is on in mm", ylabel="share in %", ylim=(0, None))
    axes.set_title("flux linkage that links the other side", loc="left", fontsize=10)
    axes.legend(frameon=False, fontsize=8)


def _draw_error(axes: Axes, found: "DecouplingMap", error: Array, *, title: str) -> None:
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
