"""The study's figures, counterparts of those in Gutierrez and Ro (1998); arrays in, plotly figures out."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray
from plotly.subplots import make_subplots

from msl_fem.maps import OperatingMap
from msl_fem.report.style import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    RED,
    REGION_FILL,
    SERIES,
    SKY,
    dress,
    figure,
    line,
    logarithmic,
)
from msl_fem.table.magnetic_table import MagneticTable

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
    current = np.linspace(0.0, table.current[-1], 241)
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


def predicted_position(time: Array, measured: Array, predicted: Array) -> go.Figure:
    """Measured and free-run position of a run above, their difference below (the paper's Fig. 5)."""
    made = _two_rows("position in µm", "error in µm")
    t, keep = _thinned(time)
    made.add_trace(line(t, measured[keep] * 1e6, name="measured", colour=BLUE), row=1, col=1)
    made.add_trace(
        line(t, predicted[keep] * 1e6, name="ARMAX, free run", colour=ORANGE, line={"dash": "dot"}), row=1, col=1
    )
    made.add_trace(line(t, (measured - predicted)[keep] * 1e6, name="measured - free run", colour=GREY), row=2, col=1)
    return made


def tracking(run: Tracking) -> go.Figure:
    """Reference and position, tracking error, side currents of a closed-loop run (the paper's Figs. 6, 8, 9)."""
    made = _two_rows("position in mm", "error in µm", third="current in A")
    t, keep = _thinned(run.time)
    made.add_trace(
        line(t, run.reference[keep] * 1e3, name="reference", colour=GREY, line={"dash": "dash"}), row=1, col=1
    )
    made.add_trace(line(t, run.position[keep] * 1e3, name="position", colour=BLUE), row=1, col=1)
    error = (run.reference - run.position)[keep] * 1e6
    made.add_trace(line(t, error, name="error", colour=RED), row=2, col=1)
    for side, colour in zip(range(run.current.shape[1]), (GREEN, ORANGE), strict=False):
        made.add_trace(line(t, run.current[keep, side], name=f"current {side + 1}", colour=colour), row=3, col=1)
    return made


def frequency_response(frequency: Array, curves: Mapping[str, tuple[Array, Array]]) -> go.Figure:
    """Gain in dB and phase in degrees over frequency (the paper's Fig. 11); curves: name to (gain, phase in rad)."""
    made = _two_rows("gain in dB", "phase in °", x="frequency in Hz")
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


def _two_rows(first: str, second: str, *, third: str | None = None, x: str = "time in s") -> go.Figure:
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
