"""The pictures that records show in a notebook: what `record.plot()` hands over to."""

from collections.abc import Sequence
from functools import singledispatch
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from msl_fem.actuator import Actuator
from msl_fem.computing.arrays import Array
from msl_fem.control.closed_loop import ClosedLoopRun
from msl_fem.diagnosis.result import ChannelResiduals, Diagnosis
from msl_fem.errors import InputError
from msl_fem.files.quantity import format_quantity
from msl_fem.magnetics.field.accuracy import Accuracy, PointResult
from msl_fem.magnetics.field.magnet_field import solve_with_field
from msl_fem.maps import OperatingMap
from msl_fem.plant.simulate import Simulation
from msl_fem.record import Record, Run, StaticMap
from msl_fem.record.columns import name_and_unit
from msl_fem.report.diagnosis_words import called, channel_name, either
from msl_fem.report.field_picture import draw_field
from msl_fem.report.figures import BLUE, GREEN, GREY, ORANGE, RED, SERIES, SKY, sides_with_current
from msl_fem.report.page_words import round_values
from msl_fem.report.paper_figure import PaperFigure
from msl_fem.report.pictures import draw_run
from msl_fem.report.section_drawing import draw_section
from msl_fem.table.magnetic_table import MagneticTable

N_POINTS = 241
MOST_POINTS = 20_000
ROOM_FOR_LEGEND = 0.17
"""Of the height of a plot, above what it shows."""
MOST_EFFECTS = 8
BINS = 600
REGIONS = (("preferred", GREEN), ("discouraged", ORANGE), ("unacceptable", RED))


@singledispatch
def picture_of(record: object, **choices: Any) -> PaperFigure:
    """The picture of a record; `choices` are those of its function below."""
    raise TypeError(f"there is no picture of a {type(record).__name__}")


@picture_of.register
def actuator_picture(record: Actuator, *, gap: float | None = None) -> PaperFigure:
    """The dimensioned section at a gap in m, by default the nominal one."""
    return draw_section(record, gap)


@picture_of.register
def point_picture(record: PointResult) -> PaperFigure:
    """Flux density of the sections, mean and largest; `field_picture` draws the field itself."""
    figure = PaperFigure(figsize=(7.2, 3.6), layout="constrained")
    axes = figure.add_subplot()
    names = [called(name) for name in record.quantities.flux_density]
    for shift, (label, colour) in zip((-0.2, 0.2), (("mean", BLUE), ("largest", ORANGE)), strict=True):
        sections = record.quantities.flux_density.values()
        values = [density.mean if label == "mean" else density.max for density in sections]
        axes.bar(np.arange(len(names)) + shift, values, width=0.38, label=label, color=colour)
    axes.set_xticks(np.arange(len(names)), names)
    axes.set_ylabel("flux density in T")
    axes.set_title(f"{record.facts()['force']} at {record.facts()['at']}", loc="left", fontsize=11)
    axes.margins(y=0.25)
    axes.legend(frameon=False, ncols=2, loc="upper right")
    return figure


def field_picture(actuator: Actuator, current: float, gap: float, *, accuracy: Accuracy = "normal") -> PaperFigure:
    """|B| and flux lines of the section at a current (A) and a gap (m); raises as `solve`."""
    point, field, solution = solve_with_field(actuator, current, gap, accuracy=accuracy)
    title = f"{actuator.name}: {point.facts()['force']} at {point.facts()['at']}"
    return draw_field(field, solution, title=title)


@picture_of.register
def table_picture(record: MagneticTable, *, gaps: Sequence[float] | None = None) -> PaperFigure:
    """Force and flux linkage over the current, a line a gap (m); without, round gaps over the table's range."""
    shown = round_values(float(record.gap[0]), float(record.gap[-1])) if gaps is None else list(gaps)
    figure = PaperFigure(figsize=(9.6, 4.0), layout="constrained")
    current = record.current[-1] * np.linspace(0.0, 1.0, N_POINTS) ** 1.5  # dense where thin gaps saturate
    for axes, name, unit, scale in zip(
        figure.subplots(1, 2), ("force", "flux_linkage"), ("N", "mWb"), (1.0, 1e3), strict=True
    ):
        for k, gap in enumerate(shown):
            values = record.evaluate(current, gap)[name] * scale
            axes.plot(current, values, color=SERIES[k % len(SERIES)], label=f"{gap * 1e3:.4g} mm")
        _label(axes, "coil current in A", f"{called(name)} of one magnet in {unit}")
    figure.axes[1].legend(title="gap", frameon=False, loc="lower right")
    return figure


@picture_of.register
def map_picture(record: OperatingMap) -> PaperFigure:
    """The current that brings each flux density over the gap, and the regions between."""
    figure = PaperFigure(figsize=(7.2, 4.4), layout="constrained")
    axes = figure.add_subplot()
    gap, top = record.gap * 1e3, record.current_max
    reached = np.where(np.isnan(record.current), top, record.current)
    bounds = (np.zeros_like(gap), reached[0], reached[-1], np.full_like(gap, top))
    for (name, colour), low, high in zip(REGIONS, bounds[:-1], bounds[1:], strict=True):
        axes.fill_between(gap, low, high, color=colour, alpha=0.14, linewidth=0, label=name)
    for k, (level, current) in enumerate(zip(record.levels, record.current, strict=True)):
        axes.plot(gap, current, ".-", color=SERIES[k % len(SERIES)], label=f"{level:g} T")
    axes.set(xlim=(gap[0], gap[-1]), ylim=(0, top))
    axes.legend(frameon=False)
    _label(axes, "air gap in mm", "coil current in A")
    return figure


@picture_of.register
def run_picture_of(record: Run) -> PaperFigure:
    """A panel a channel."""
    return draw_run(record)


@picture_of.register
def static_picture(record: StaticMap) -> PaperFigure:
    """Measured force or flux linkage over the current, coloured by the gap."""
    name = "force_N" if record.force is not None else "flux_linkage_Wb"
    figure = PaperFigure(figsize=(7.2, 4.4), layout="constrained")
    axes = figure.add_subplot()
    dots = axes.scatter(record.current, record.frame_columns()[name], c=record.gap * 1e3, s=9)
    figure.colorbar(dots, ax=axes, label="air gap in mm")
    quantity, unit = name_and_unit(name)
    _label(axes, "coil current in A", f"{called(quantity)} in {unit}")
    return figure


@picture_of.register
def record_picture(record: Record, *, run: str | None = None) -> PaperFigure:
    """A run by its name, by default the first; of a record without runs its static map."""
    if run is None and not record.runs and record.static is not None:
        return static_picture(record.static)
    return draw_run(record.runs[0] if run is None else record.run(run))


@picture_of.register
def simulation_picture(record: Simulation) -> PaperFigure:
    """Position, currents and voltages of the sides over the time; the force where no magnet drives."""
    sides = record.current.shape[1]
    panels: list[tuple[str, list[tuple[str, Array]]]] = [("position_m", [("position", record.position)])]
    for quantity, values in (("current_A", record.current), ("voltage_V", record.voltage)):
        if sides:
            panels.append((quantity, [(f"side {side + 1}", values[:, side]) for side in range(sides)]))
    if not sides:
        panels.append(("force_N", [("force", record.force)]))
    figure = _over_time(record.time, panels)
    if not record.complete:
        figure.suptitle(record.status, fontsize=11)
    return figure


@picture_of.register
def closed_loop_picture(record: ClosedLoopRun) -> PaperFigure:
    """Reference and position, the tracking error, and the currents of the sides over the time."""
    currents = [(f"side {side + 1}", record.current[:, side]) for side in sides_with_current(record.current)]
    error = record.reference - record.position
    followed = [("position", record.position), ("reference", record.reference)]
    panels = [("position_m", followed), ("error_m", [("error", error)]), ("current_A", currents)]
    figure = _over_time(record.time, panels)
    figure.suptitle(f"tracking error {record.facts()['tracking error']}", fontsize=11)
    return figure


def _over_time(time: Array, panels: Sequence[tuple[str, list[tuple[str, Array]]]]) -> PaperFigure:
    """A panel for each quantity with its unit, a line for each (name, values)."""
    figure = PaperFigure(figsize=(8.4, 1.0 + 1.8 * len(panels)), layout="constrained")
    step = max(1, -(-time.size // MOST_POINTS))
    frames = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
    for axes, (column, lines) in zip(frames, panels, strict=True):
        quantity, unit = name_and_unit(column)
        largest = max(float(np.abs(values).max(initial=0.0)) for _, values in lines)
        shown, scale = prefixed(unit, largest)
        for (name, values), colour in zip(lines, (BLUE, ORANGE, GREEN), strict=False):
            axes.plot(time[::step], values[::step] * scale, color=colour, linewidth=1.1, label=name)
        _label(axes, "", f"{quantity} in {shown}")
        axes.margins(x=0.01)
        if len(lines) > 1:
            axes.legend(frameon=False, fontsize=9)
    frames[-1].set_xlabel("time in s")
    return figure


def prefixed(unit: str, largest: float) -> tuple[str, float]:
    """The unit with the prefix in which a signal of this size is read, and the factor to it."""
    text = format_quantity(largest, unit, digits=12) if largest > 0 else f"0 {unit}"
    shown = text.split(" ", 1)[1]
    factors = {"n": 1e9, "µ": 1e6, "m": 1e3, "k": 1e-3, "M": 1e-6}
    return shown, 1.0 if shown == unit else factors[shown[0]]


@picture_of.register
def diagnosis_picture(record: Diagnosis) -> PaperFigure:
    """What each effect would bring, and what is left of the channel that gains most, as believed and explained.

    Raises
    ------
    InputError : nothing was fitted, so there is nothing to draw
    """
    evidence = record.evidence
    if evidence is None or not (evidence.tried or evidence.residuals):
        raise InputError(f"the diagnosis fitted nothing, so there is no picture: {record.reason}")
    figure = PaperFigure(figsize=(10.4, 4.4), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1, 1.4))
    _draw_effects(left, record)
    if evidence.residuals:
        _draw_residual(right, max(evidence.residuals, key=_improvement))
    else:
        _draw_errors(right, record)
    figure.suptitle(
        f"{record.verdict.replace('-', ' ')}{': ' if record.names else ''}"
        f"{' and '.join(either(cause) for cause in record.causes)}",
        fontsize=11,
    )
    return figure


def _draw_effects(axes: Axes, record: Diagnosis) -> None:
    """Nats that the best variant of each effect brings in the first stage, filled where it was fitted in full."""
    assert record.evidence is not None
    best: dict[str, tuple[float, bool]] = {}
    for tried in record.evidence.tried:
        gain = tried.linear if tried.refitted is None else tried.refitted
        if tried.stage == 1 and (tried.effect not in best or gain > best[tried.effect][0]):
            best[tried.effect] = (gain, tried.refitted is not None)
    shown = sorted(best.items(), key=lambda item: item[1][0])[-MOST_EFFECTS:]
    for row, (effect, (gain, fitted)) in enumerate(shown):
        colour = BLUE if effect in record.names else GREY
        axes.plot(max(gain, 0.0), row, "o", color=colour, fillstyle="full" if fitted else "none")
    axes.set_yticks(range(len(shown)), [called(effect) for effect, _ in shown])
    axes.set_xscale("symlog", linthresh=10.0)
    axes.set_xlim(-1.0, 3.0 * max([10.0, *(gain for gain, _ in best.values())]))
    axes.margins(y=0.12)
    if np.isfinite(record.threshold):
        axes.axvline(record.threshold, color=RED, linewidth=1.0, linestyle="--", label="needed to be named")
        axes.legend(frameon=False, fontsize=8, loc="center right")
    _label(axes, "log evidence over the model without it, nats", "")


def _draw_errors(axes: Axes, record: Diagnosis) -> None:
    """Errors of the three models over the noise, a row a channel and role: of a map, which has no course in time."""
    models = (("nominal", SKY, "as believed"), ("refitted", ORANGE, "fitted within tolerances"),
              ("extended", BLUE, "with the causes"))  # fmt: skip
    for name, colour, told in models:
        errors = [getattr(entry, name) for entry in record.accuracy]
        axes.plot([e.rms / (e.floor or 1.0) for e in errors], range(len(errors)), "o", color=colour, label=told)
    rows = [f"{channel_name(a.nominal.channel)} ({a.nominal.role})" for a in record.accuracy]
    axes.set_yticks(range(len(rows)), rows)
    axes.axvline(1.0, color=GREY, linewidth=1.0, linestyle="--")
    axes.set_xscale("log")
    axes.margins(y=0.2)
    axes.legend(frameon=False, fontsize=8, loc="lower center", bbox_to_anchor=(0.5, 1), ncols=2)
    _label(axes, "error over the noise, 1 is the noise itself", "")


def _improvement(channel: ChannelResiduals) -> float:
    """How much of a channel's believed residual is gone, in standard deviations of its noise."""
    return float(np.nanstd(channel.nominal) - np.nanstd(channel.extended)) / (channel.sigma or 1.0)


def _draw_residual(axes: Axes, channel: ChannelResiduals) -> None:
    """Least and largest residual in bins of the time, as believed and with what was named; the noise as a band."""
    unit, scale = prefixed(name_and_unit(channel.channel)[1], float(np.nanmax(np.abs(channel.nominal))))
    starts = np.linspace(0, channel.time.size, min(BINS, channel.time.size) + 1).astype(int)[:-1]
    for values, colour, name in (
        (channel.nominal, SKY, "as believed"),
        (channel.refitted, ORANGE, "fitted within tolerances"),
        (channel.extended, BLUE, "with the causes"),
    ):
        low, high = (f.reduceat(values * scale, starts) for f in (np.fmin, np.fmax))
        axes.fill_between(channel.time[starts], low, high, color=colour, alpha=0.8, linewidth=0.4, label=name)
    axes.axhspan(-2 * channel.sigma * scale, 2 * channel.sigma * scale, color=GREY, alpha=0.35, label="noise, 2 sigma")
    bottom, top = axes.get_ylim()
    axes.set_ylim(bottom, top + ROOM_FOR_LEGEND * (top - bottom))
    axes.legend(frameon=False, fontsize=8, loc="upper right", ncols=2)
    axes.margins(x=0.01)
    name = f"{channel_name(channel.channel)} of {channel.run} ({channel.role})"
    _label(axes, "time in s", f"measured less modelled in {unit}")
    axes.set_title(name, loc="left", fontsize=10)


def _label(axes: Axes, x: str, y: str) -> None:
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    axes.grid(alpha=0.3)
