"""Figures of a diagnosis: the gain, residuals over time, frequency and variables, believed parameters."""

from collections.abc import Mapping, Sequence

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray
from plotly.subplots import make_subplots
from scipy.signal import welch

from msl_fem.comparison.accuracy import over_variable
from msl_fem.diagnosis.estimates import Estimate
from msl_fem.diagnosis.outside import Dependence
from msl_fem.diagnosis.result import Accuracy, ChannelResiduals
from msl_fem.record.columns import name_and_unit
from msl_fem.report.diagnosis_words import FAR, called, channel_name, floors
from msl_fem.report.figures import BLUE, GREEN, GREY, ORANGE, SKY, dress, figure, line, logarithmic

Array = NDArray[np.float64]
BINS = 700  # of time, each drawn as the least and the largest residual in it
SEGMENT = 4096  # samples of a spectrum's segment
A_DECADE = 16  # bands of a drawn spectrum
LINES_IN_FULL = 6  # the lowest lines of a spectrum are drawn one by one
MODELS = (("as believed", SKY), ("re-fitted within tolerances", ORANGE), ("with what was found", BLUE))
VARIABLES = {
    "position_m": ("position in mm", 1e3),
    "velocity_m_per_s": ("velocity in mm/s", 1e3),
    "current_1_A": ("current 1 in A", 1.0),
    "current_2_A": ("current 2 in A", 1.0),
    "time_s": ("time in s", 1.0),
}
_OF_VARIABLE = (
    ("product", "A²"),
    ("flux linkage's rate", "V"),
    ("flux", "Wb"),
    ("current", "A"),
    ("velocity", "m/s"),
    ("acceleration", "m/s²"),
    ("position", "m"),
    ("time", "s"),
)
_OF_EQUATION = {"force": "N", "voltage": "V", "position reading": "m", "current reading": "A"}
_UNITS = {
    "m": ("µm", 1e6),
    "A": ("mA", 1e3),
    "V": ("mV", 1e3),
    "N": ("N", 1.0),
    "Wb": ("µWb", 1e6),
    "m/s": ("mm/s", 1e3),
}


def shown_unit(channel: str) -> tuple[str, float]:
    """The unit in which residuals of a channel are drawn, and how many of it are one SI unit."""
    return _UNITS[name_and_unit(channel)[1]]


def gain_figure(judged: Sequence[Accuracy], *, named: bool) -> go.Figure:
    """The errors of the models on each run and channel, times the noise, as dots: a logarithmic axis has no zero."""
    made = figure(x="error over noise, 1 is the noise itself", y="", height=120 + 66 * len(judged))
    labels = [f"{channel_name(a.nominal.channel)}, {a.nominal.run}" for a in judged]
    values = np.array([floors(a) for a in judged])
    for k, (name, colour) in enumerate(MODELS if named else MODELS[:2]):
        shown = np.where(np.isfinite(values[:, k]), values[:, k], np.nan)
        dot = go.Scatter(
            x=shown,
            y=labels,
            name=name,
            mode="markers+text",
            marker={"color": colour, "size": 12},
            text=[f"{v:.3g}" for v in values[:, k]],
            textposition=("top center", "bottom center", "top center")[k],
            cliponaxis=False,
        )
        made.add_trace(dot)
    finite = values[np.isfinite(values)]
    logarithmic(made, [finite], along="x")
    top = float(np.log10(max(finite.max(initial=1.0), 2.0)))
    made.update_xaxes(range=[min(0.0, float(np.log10(finite.min(initial=1.0)))) - 0.1, top + 0.25])
    made.update_yaxes(autorange="reversed", automargin=True)
    made.add_vline(x=1.0, line={"color": GREY, "dash": "dash", "width": 1})
    return made


def over_time(left: ChannelResiduals, *, named: bool) -> go.Figure:
    """The residual before and after, as the band between its extremes in short pieces of time."""
    unit, scale = shown_unit(left.channel)
    made = figure(x="time in s", y=f"residual in {unit}")
    for name, colour, values in _drawn(left, named):
        t, extremes = envelope(left.time, values * scale)
        made.add_trace(line(t, extremes, name=name, colour=colour, line={"width": 1}))
    for sign in (-2.0, 2.0):
        made.add_hline(y=sign * left.sigma * scale, line={"color": GREY, "dash": "dash", "width": 1})
    return made


def envelope(time: Array, values: Array) -> tuple[Array, Array]:
    """The least and the largest value of each of at most `BINS` pieces, in their order."""
    width = max(1, -(-time.size // BINS))
    if width <= 2:
        return time, values
    n = time.size // width
    piece = values[: n * width].reshape(n, width)
    at = np.sort(np.column_stack([_place(piece, np.argmin), _place(piece, np.argmax)]), axis=1)
    rows = np.repeat(np.arange(n), 2)
    return time[: n * width].reshape(n, width)[rows, at.ravel()], piece[rows, at.ravel()]


def _place(piece: Array, chosen: object) -> NDArray[np.intp]:
    filled = np.nan_to_num(piece, nan=0.0)
    return np.asarray(filled.argmin(axis=1) if chosen is np.argmin else filled.argmax(axis=1))


def over_frequency(left: ChannelResiduals, noise: tuple[Array, Array] | None = None, *, named: bool) -> go.Figure:
    """Amplitude spectral density of the residual before and after, of the instrument's noise, and of the fitted noise.

    `noise`: edges of bands in Hz and the power density over the white one in each, as `Evidence.noise`; beyond the
    bands nothing was fitted.
    """
    unit, scale = shown_unit(left.channel)
    made = figure(x="frequency in Hz", y=f"{unit}/√Hz")
    shown = []
    for name, colour, values in _drawn(left, named):
        f, density = amplitude_density(values[np.isfinite(values)] * scale, left.rate)
        made.add_trace(line(f, density, name=name, colour=colour))
        shown.append((f, density))
    white = left.sigma * scale * np.sqrt(2 / left.rate)
    if shown:
        f = shown[0][0]
        made.add_trace(
            line(f, np.full(f.size, white), name="the instrument's noise", colour=GREY, line={"dash": "dash"})
        )
        if noise is not None:
            made.add_trace(_noise_steps(noise, white, lowest=float(f[0])))
        logarithmic(made, [f for f, _ in shown], along="x")
        logarithmic(made, [*(d for _, d in shown), np.array([white])], along="y")
    return made


def _noise_steps(noise: tuple[Array, Array], white: float, *, lowest: float) -> go.Scatter:
    """The fitted noise as a line of steps, one a band."""
    edges, density = noise
    x = np.repeat(np.maximum(edges, lowest), 2)[1:-1]
    y = np.repeat(white * np.sqrt(density), 2)
    return line(x, y, name="noise as fitted", colour=GREEN, line={"dash": "dot", "width": 2.4})


def amplitude_density(values: Array, rate: float) -> tuple[Array, Array]:
    """(frequencies in Hz, unit of the values per root Hz) by Welch's method, higher lines averaged in narrow bands."""
    if values.size < 64:
        return np.empty(0), np.empty(0)
    f, power = welch(values, rate, nperseg=min(SEGMENT, values.size))
    f, power = f[1:], power[1:]
    top = max(f[-1], f[LINES_IN_FULL] * 1.01)
    count = max(2, int(A_DECADE * np.log10(top / f[LINES_IN_FULL])))
    edges = np.unique(np.searchsorted(f, np.geomspace(f[LINES_IN_FULL], top, count)))
    starts = np.concatenate([np.arange(edges[0]), edges[:-1]]).astype(np.intp)
    number = np.diff(np.append(starts, f.size))
    return np.add.reduceat(f, starts) / number, np.sqrt(np.add.reduceat(power, starts) / number)


def over_variables(left: ChannelResiduals, variables: Mapping[str, Array], *, named: bool) -> go.Figure:
    """RMS residual before and after in equally filled bins of what it may depend on."""
    unit, scale = shown_unit(left.channel)
    known = [name for name in VARIABLES if name in variables and name != "time_s"]
    columns = 2
    rows = -(-len(known) // columns)
    made = make_subplots(rows=rows, cols=columns, vertical_spacing=0.3 / max(rows - 1, 1), horizontal_spacing=0.1)
    dress(made, height=60 + 270 * rows)
    for n, name in enumerate(known):
        label, factor = VARIABLES[name]
        place = {"row": n // columns + 1, "col": n % columns + 1}
        for model, colour, values in _drawn(left, named):
            good = np.isfinite(values)
            spread = over_variable(values[good], variables[name][good])
            middle = (spread.edges[:-1] + spread.edges[1:]) / 2 * factor
            drawn = line(
                middle,
                spread.rms * scale,
                name=model,
                colour=colour,
                mode="lines+markers",
                legendgroup=model,
                showlegend=n == 0,
            )
            made.add_trace(drawn, **place)
        made.add_hline(y=left.sigma * scale, line={"color": GREY, "dash": "dash", "width": 1}, **place)
        made.update_xaxes(title={"text": label}, **place)
        words = f"RMS in {unit}" if n % columns == 0 else ""  # one unit: said where no other figure stands before it
        made.update_yaxes(title={"text": words}, rangemode="tozero", **place)
    return made


def dependence_figure(found: Dependence) -> go.Figure:
    """The function of a variable that would account for what is left, with two standard errors on either side."""
    x_unit = next((u for name, u in _OF_VARIABLE if name in found.variable), "")
    y_unit = _OF_EQUATION[found.equation]
    made = figure(x=f"{found.variable}{f' in {x_unit}' if x_unit else ''}", y=f"{found.equation} in {y_unit}")
    low, high = found.value - 2 * found.band, found.value + 2 * found.band
    both, edge = np.r_[found.at, found.at[::-1]], np.r_[low, high[::-1]]
    fill = go.Scatter(
        x=both,
        y=edge,
        fill="toself",
        fillcolor="rgba(86,180,233,0.3)",
        mode="none",
        name="two standard errors",
        hoverinfo="skip",
    )
    made.add_trace(fill)
    made.add_trace(line(found.at, found.value, name="what the model lacks", colour=BLUE))
    for axis in (made.update_xaxes, made.update_yaxes):
        axis(exponentformat="SI")
    return made


def parameters_figure(parameters: Mapping[str, Estimate]) -> go.Figure:
    """How far believed parameters moved, in their own tolerances, with 95 % intervals."""
    known = {name: e for name, e in parameters.items() if e.tolerances is not None}
    made = figure(x="fitted less believed, in tolerances", y="", height=110 + 34 * len(known))
    names, moved = [called(n) for n in known], np.array([float(e.tolerances or 0.0) for e in known.values()])
    half = np.array([_half_width(e) for e in known.values()])
    made.add_vrect(x0=-1, x1=1, fillcolor="rgba(107,114,128,0.14)", line_width=0)
    made.add_trace(
        go.Scatter(
            x=moved,
            y=names,
            mode="markers",
            marker={"color": BLUE, "size": 9},
            showlegend=False,
            error_x={"type": "data", "array": half, "color": BLUE, "thickness": 1.5},
        )
    )
    reach = max(FAR, float(np.max(np.abs(moved) + half, initial=0.0))) + 0.3
    made.update_xaxes(range=[-reach, reach], zeroline=True, zerolinecolor=GREY)
    made.update_yaxes(autorange="reversed", automargin=True)
    return made


def _half_width(e: Estimate) -> float:
    """Half of the 95 % interval in tolerances; the scale follows from where the value lies."""
    if not e.tolerances or e.believed is None or e.value == e.believed or min(e.low, e.high, e.believed) <= 0:
        return 0.0
    tolerance = np.log(e.value / e.believed) / e.tolerances
    return float(np.log(e.high / e.low) / 2 / tolerance)


def _drawn(left: ChannelResiduals, named: bool) -> list[tuple[str, str, Array]]:
    """What is drawn of the residuals: before, and after where something was named."""
    before = (*MODELS[1], left.refitted)
    after = (*MODELS[2], left.extended)
    return [one for one in ((before, after) if named else (before,)) if np.isfinite(one[2]).any()]
