"""The Pareto front of a sizing run as a picture: each pair of objectives, all judged designs behind it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import StrMethodFormatter

from msl_fem.report.style import BLUE, GREY, ORANGE, RED

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


def draw_front(points: FrontPoints, objectives: Sequence[str], *, title: str) -> Figure:
    """A figure with one frame for each pair of objectives; a single objective stands over the designs' rank."""
    pairs = list(combinations(objectives, 2)) or [(objectives[0], objectives[0])]
    figure = Figure(figsize=(6.4 * min(len(pairs), 3), 4.6 * -(-len(pairs) // 3)), layout="constrained")
    FigureCanvasAgg(figure)
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
