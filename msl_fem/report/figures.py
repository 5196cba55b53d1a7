"""Figures by plotly: their style, those that several pages show, and those of losses."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray
from plotly.subplots import make_subplots

from msl_fem.errors import MaterialError
from msl_fem.losses import IronLoss, ThermalCurve, sinusoidal_loss
from msl_fem.losses.copper_loss import CopperLoss
from msl_fem.maps import OperatingMap
from msl_fem.materials.core_loss_data import LossPoints, Sheet
from msl_fem.table.magnetic_table import MagneticTable

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
    many = len(ticks) > 4 and max(ticks) >= 1e4
    update(tickvals=ticks, ticktext=[_power(tick) if many else f"{tick:g}" for tick in ticks], **place)


def _power(tick: float) -> str:
    """A power of ten as 10 with its exponent; others as they are."""
    exponent = round(np.log10(tick))
    return f"10<sup>{exponent}</sup>" if np.isclose(tick, 10.0**exponent) else f"{tick:g}"


def line(x: Any, y: Any, *, name: str, colour: str, **more: Any) -> go.Scatter:
    """A line; arrays are stored with seven digits, hover values say five."""
    x, y = _short(x), _short(y)
    style = {"color": colour, "width": 1.8, **more.pop("line", {})}
    return go.Scatter(x=x, y=y, name=name, mode=more.pop("mode", "lines"), line=style, **more)


def _short(values: Any) -> Any:
    return values.astype(np.float32) if isinstance(values, np.ndarray) and values.dtype == np.float64 else values


Array = NDArray[np.float64]
MOST_POINTS = 4000


@dataclass(frozen=True, eq=False)
class Tracking:
    """A closed-loop run as the figures show it: s, m, m, A (n_sample, n_side)."""

    time: Array
    reference: Array
    position: Array
    current: Array


def force_over_current(table: MagneticTable, *, gaps: Sequence[float]) -> go.Figure:
    """Force of one magnet over current, a line for each gap."""
    made = figure(x="coil current in A", y="force of one magnet in N")
    current = table.current[-1] * np.linspace(0.0, 1.0, 241) ** 1.5  # dense where the thinnest gap saturates
    for gap, colour in zip(gaps, SERIES, strict=False):
        made.add_trace(line(current, table.force(current, gap), name=f"{gap * 1e3:.3g} mm", colour=colour))
    made.update_layout(legend_title_text="gap")
    return made


def operating_regions(operating_map: OperatingMap) -> go.Figure:
    """Current over gap with the three regions (the paper's Fig. 2)."""
    made = figure(x="air gap in mm", y="coil current in A")
    gap = operating_map.gap * 1e3
    top = operating_map.current_max
    curves = [np.where(np.isnan(row), top, row) for row in operating_map.current]
    bounds = [np.zeros_like(gap), curves[0], curves[-1], np.full_like(gap, top)]
    for (name, fill), low, high in zip(REGION_FILL.items(), bounds[:-1], bounds[1:], strict=True):
        x, y = np.r_[gap, gap[::-1]], np.r_[low, high[::-1]]
        made.add_trace(go.Scatter(x=x, y=y, fill="toself", fillcolor=fill, mode="none", name=name, hoverinfo="skip"))
    last = len(operating_map.levels) - 1
    between = (ORANGE, SKY, BLUE)
    colours = [GREEN if k == 0 else RED if k == last else between[k % len(between)] for k in range(last + 1)]
    for level, row, colour in zip(operating_map.levels, operating_map.current, colours, strict=True):
        made.add_trace(line(gap, row, name=f"{level:g} T", colour=colour, mode="lines+markers", marker={"size": 5}))
    made.update_yaxes(range=[0, top])
    made.update_xaxes(range=[0, gap[-1]])
    return made


def predicted_position(time: Array, given: Array, predicted: Array, *, origin: str) -> go.Figure:
    """Position of a run and its free-run prediction, the same magnified where it moves most, and their difference.

    The paper's Fig. 5. `origin` says what the position is, "measured" or "simulated". Where there are more periods
    than a screen can show, the whole run is its envelope: the largest and smallest value in each of its parts.
    """
    made = two_rows("position in µm", "magnified, µm", third="error in µm")
    for row in (2, 3):
        made.update_xaxes(matches=None, showticklabels=True, row=row, col=1)
    made.update_xaxes(matches="x", row=3, col=1)
    error = (given - predicted) * 1e6
    style = {"dash": "dot"}
    if _periods(given) > MOST_PERIODS:
        _add_envelope(made, (time, given * 1e6), (origin, BLUE), row=1)
        _add_envelope(made, (time, error), (f"{origin} - free run", GREY), row=3)
    else:
        t, keep = _thinned(time)
        made.add_trace(line(t, given[keep] * 1e6, name=origin, colour=BLUE), row=1, col=1)
        made.add_trace(
            line(t, predicted[keep] * 1e6, name="ARMAX, free run", colour=ORANGE, line=style, showlegend=False),
            row=1, col=1,
        )  # fmt: skip
        made.add_trace(line(t, error[keep], name=f"{origin} - free run", colour=GREY), row=3, col=1)
    part = _around_largest(given)
    near = {"row": 2, "col": 1}
    made.add_trace(line(time[part], given[part] * 1e6, name=origin, colour=BLUE, showlegend=False), **near)
    made.add_trace(line(time[part], predicted[part] * 1e6, name="ARMAX, free run", colour=ORANGE, line=style), **near)
    made.update_yaxes(domain=[0.66, 1.0], row=1, col=1)
    made.update_yaxes(domain=[0.31, 0.56], row=2, col=1)
    made.update_yaxes(domain=[0.0, 0.21], row=3, col=1)
    made.update_layout(height=660)
    return made


MOST_PERIODS = 60
ENVELOPE_PARTS = 160


def _periods(values: Array) -> int:
    """How often a signal passes its mean upwards, counted above a tenth of its size so that noise does not count."""
    high = values - values.mean() > 0.1 * np.std(values)
    low = values - values.mean() < -0.1 * np.std(values)
    state = np.where(high, 1, np.where(low, -1, 0))
    state = state[state != 0]
    return int(np.count_nonzero(np.diff(state) > 0))


def _add_envelope(made: go.Figure, signal: tuple[Array, Array], dressed: tuple[str, str], *, row: int) -> None:
    """The band between smallest and largest values of a signal (time, values), in equal parts, each with its next."""
    (time, values), (name, colour) = signal, dressed
    starts = np.linspace(0, time.size, min(ENVELOPE_PARTS, time.size) + 1).astype(int)[:-1]
    low, high = np.minimum.reduceat(values, starts), np.maximum.reduceat(values, starts)
    low, high = np.minimum(low, np.r_[low[1:], low[-1]]), np.maximum(high, np.r_[high[1:], high[-1]])
    ends = np.r_[starts[1:], time.size] - 1
    middle = (time[starts] + time[ends]) / 2
    red, green, blue = (int(colour[k : k + 2], 16) for k in (1, 3, 5))
    edge = {"width": 1.2}
    made.add_trace(line(middle, low, name=name, colour=colour, line=edge, showlegend=False), row=row, col=1)
    band = {"fill": "tonexty", "fillcolor": f"rgba({red},{green},{blue},0.22)"}
    made.add_trace(line(middle, high, name=f"{name}, envelope", colour=colour, line=edge, **band), row=row, col=1)


def _around_largest(values: Array) -> slice:
    """About eight periods round the largest deviation of a signal."""
    largest = int(np.argmax(np.abs(values - values.mean())))
    centred = np.sign(values - values.mean())
    passes = np.flatnonzero(np.diff(centred) > 0)
    if passes.size < 10:
        return slice(0, values.size)
    at = int(np.clip(np.searchsorted(passes, largest), 4, passes.size - 5))
    start, stop = int(passes[at - 4]), int(passes[at + 4])
    if stop - start < 60:  # noise about the mean
        half = min(values.size // 2, max(30, values.size // 100))
        start, stop = max(0, largest - half), min(values.size, largest + half)
    return slice(start, stop)


def sides_with_current(current: Array) -> list[int]:
    """The sides of currents (n_sample, n_side) to draw: the first, and others that ever have one."""
    return [side for side in range(current.shape[1]) if side == 0 or current[:, side].any()]


def tracking(run: Tracking) -> go.Figure:
    """Reference and position, tracking error, side currents of a closed-loop run (the paper's Figs. 6, 8, 9)."""
    made = two_rows("position in mm", "error in µm", third="current in A")
    t, keep = _thinned(run.time)
    made.add_trace(
        line(t, run.reference[keep] * 1e3, name="reference", colour=GREY, line={"dash": "dash"}), row=1, col=1
    )
    made.add_trace(line(t, run.position[keep] * 1e3, name="position", colour=BLUE), row=1, col=1)
    error = (run.reference - run.position)[keep] * 1e6
    made.add_trace(line(t, error, name="error", colour=RED), row=2, col=1)
    for side, colour in zip(sides_with_current(run.current), (GREEN, ORANGE), strict=False):
        made.add_trace(line(t, run.current[keep, side], name=f"current {side + 1}", colour=colour), row=3, col=1)
    return made


def frequency_response_figure(frequency: Array, curves: Mapping[str, tuple[Array, Array]]) -> go.Figure:
    """Gain in dB and phase in degrees over frequency (the paper's Fig. 11); curves: name to (gain, phase in rad)."""
    made = two_rows("gain in dB", "phase in °", x="frequency in Hz")
    for (name, (gain, phase)), colour in zip(curves.items(), SERIES, strict=False):
        made.add_trace(
            line(frequency, 20 * np.log10(gain), name=name, colour=colour, mode="lines+markers"), row=1, col=1
        )
        made.add_trace(
            line(frequency, np.degrees(np.unwrap(phase)), name=name, colour=colour, showlegend=False), row=2, col=1
        )
    made.add_hrect(y0=-1, y1=1, fillcolor=REGION_FILL["preferred"], line_width=0, row=1, col=1)
    for row in (1, 2):
        logarithmic(made, [frequency], along="x", row=row)
    return made


def two_rows(first: str, second: str, *, third: str | None = None, x: str = "time in s") -> go.Figure:
    """An empty figure of two or three panels over one axis, labelled; sizes 65:35 or 50:25:25."""
    labels = [first, second] + ([third] if third else [])
    heights = [0.65, 0.35] if third is None else [0.5, 0.25, 0.25]
    made = make_subplots(rows=len(labels), cols=1, shared_xaxes=True, row_heights=heights, vertical_spacing=0.06)
    dress(made, height=520 if third is None else 600)
    for row, label in enumerate(labels, start=1):
        made.update_yaxes(title={"text": label}, row=row, col=1)
    made.update_xaxes(title={"text": x}, row=len(labels), col=1)
    return made


def _thinned(time: Array) -> tuple[Array, NDArray[np.int64]]:
    """Time and indices of at most MOST_POINTS samples, so that a report stays small."""
    keep = np.arange(0, time.size, max(1, -(-time.size // MOST_POINTS)))
    return time[keep], keep


TERMS = (("hysteresis", BLUE), ("eddy", ORANGE), ("excess", GREEN))


def losses_by_section(iron: IronLoss, copper: CopperLoss) -> go.Figure:
    """Stacked bars: each section's hysteresis, eddy-current and excess loss, the coil's copper loss beside them.

    A section whose loss is not known has no bar but the words "not known" in its place.
    """
    made = figure(x="", y="loss of one magnet in W")
    names = [s.section.replace("_", " ") for s in iron.sections]
    for term, colour in TERMS:
        values = [getattr(s.density, term) for s in iron.sections]
        watts = [None if v is None else v * s.volume for v, s in zip(values, iron.sections, strict=True)]
        made.add_trace(go.Bar(x=names, y=watts, name=term, marker_color=colour))
    made.add_trace(go.Bar(x=["coil"], y=[copper.loss], name="copper", marker_color=SKY))
    for name, section in zip(names, iron.sections, strict=True):
        if section.loss is None:
            made.add_annotation(x=name, y=section.eddy_loss or 0.0, text="not known", showarrow=False, yshift=10)
    made.update_layout(barmode="stack")
    return made


def add_thermal_limit(made: go.Figure, curve: ThermalCurve) -> go.Figure:
    """The figure of the operating regions with the winding's limit as further lines (RMS over gap in mm)."""
    gap, limit = curve.gap * 1e3, curve.copper_only.limit
    what = f"continuous, {limit.temperature_rise:g} K"
    made.add_trace(line(gap, curve.continuous, name=what, colour=GREY, line={"dash": "dash"}))
    if limit.cycle.duty < 1:
        name = f"for {limit.cycle.duty:.0%} of the time"
        made.add_trace(line(gap, curve.on_phase, name=name, colour=GREY, line={"dash": "dot"}))
    return made


def measured_and_fitted_losses(points: LossPoints, sheet: Sheet) -> go.Figure:
    """Measured specific losses of a sheet over flux density, a colour a frequency, and the fit as lines.

    Raises
    ------
    MaterialError : the sheet has no coefficients
    """
    c = sheet.coefficients
    if c is None:
        raise MaterialError(sheet.reason)
    made = figure(x="peak flux density in T", y="specific loss in W/kg")
    used = [f for f in np.unique(points.frequency) if f <= c.frequency_max]
    shown = used[:: max(1, -(-len(used) // len(SERIES)))]
    b = np.geomspace(c.flux_density_min, c.flux_density_max, 60)
    for f, colour in zip(shown, SERIES, strict=False):
        row = points.frequency == f
        fitted = sum(sinusoidal_loss(c, sheet, f, b)) / c.density
        made.add_trace(line(b, fitted, name=f"{f:g} Hz", colour=colour))
        made.add_trace(
            line(
                points.flux_density[row], points.loss[row], name=f"{f:g} Hz, measured", colour=colour, mode="markers",
                showlegend=False,
            )
        )  # fmt: skip
    logarithmic(made, [b], along="x")
    logarithmic(made, [points.loss], along="y")
    return made
