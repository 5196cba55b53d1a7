"""The model-accuracy report: which model is how far from a record, where, and against which floor."""

import datetime
import platform
from collections.abc import Sequence
from importlib.metadata import version

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray
from plotly.subplots import make_subplots

from msl_fem.comparison import Comparison, ModelAccuracy, StaticError
from msl_fem.comparison.accuracy import LocatedResidual
from msl_fem.files.quantity import format_quantity
from msl_fem.prediction.hypothesis import unit_of_believed
from msl_fem.prediction.run_data import POSITION_COLUMN
from msl_fem.report.figures import GREY, SERIES, dress, figure, line, logarithmic
from msl_fem.report.page import Grid, Page, Stage

Array = NDArray[np.float64]
MOST_POINTS = 3000
NAMES = {
    "one_step": "one sample ahead", "ten_step": "ten samples ahead", "closed_loop": "closed loop",
    "free_run": "free run",
}  # fmt: skip
AXES = {
    "current_1_A": ("current of side 1 in A", 1.0), "current_2_A": ("current of side 2 in A", 1.0),
    "gap_1_m": ("gap of side 1 in mm", 1e3), "position_m": ("position in mm", 1e3),
    "velocity_m_per_s": ("velocity in mm/s", 1e3), "amplitude_m": ("distance from the mean position in µm", 1e6),
    "time_s": ("time in s", 1.0),
}  # fmt: skip


def comparison_page(found: Comparison) -> Page:
    """The report of a comparison: table of figures first, then measured against predicted, then where errors live."""
    stages = [_summary(found)] if found.accuracies else []
    for run in found.data:
        judged = [j for j in found.accuracies if j.run == run.name and j.channel == POSITION_COLUMN]
        if judged:
            stages.append(_measured_and_predicted(judged, found))
    chosen = _telling(found)
    if chosen:
        stages.append(_by_band(chosen))
        stages += [_over(chosen, name) for name in chosen[0].over]
    stages += [_static(error) for error in found.static]
    return Page(
        f"{found.record.actuator.name}: accuracy of the models",
        found.verdict,
        _headline(found),
        tuple(stages),
        _provenance(found),
        (*found.record.warnings, *found.models.notes),
    )


def _headline(found: Comparison) -> tuple[tuple[str, str], ...]:
    held = [j for j in found.accuracies if j.role == "held-out" and j.channel == POSITION_COLUMN] or [
        j for j in found.accuracies if j.channel == POSITION_COLUMN
    ]
    shown = []
    for judged in held[:6]:
        kind = judged.hardest_kind
        if kind is not None:
            value = judged.nrmse[kind]
            assert value is not None
            shown.append((f"{value:.3g}", f"{judged.model}: position NRMSE, {NAMES[kind]}, {judged.run}"))
    return tuple(shown)


def _summary(found: Comparison) -> Stage:
    floors = {(f["run"], f["channel"]): f for f in found.noise_floor()}
    kinds = [kind for kind in NAMES if any(j.nrmse[kind] is not None for j in found.accuracies)]
    columns = ("model", "run", "role", "channel", *(NAMES[kind] for kind in kinds), "noise floor")
    rows = tuple(
        (
            j.model,
            j.run,
            j.role,
            _channel(j.channel),
            *(_figure(j.nrmse[kind]) for kind in kinds),
            _figure(floors[j.run, j.channel]["nrmse"]),
        )
        for j in found.accuracies
    )
    sources = {f["source"] for f in floors.values()}
    sentence = (
        "NRMSE is the RMS of measured less modelled over the standard deviation of measured. Everything was fitted on "
        "runs with the role fit; a dash means that there is no such prediction, with the reason beside it. The noise "
        f"floor is {' or '.join(sorted(sources))}."
    )
    reasons = dict.fromkeys((f"{j.model}, {j.run}", j.reason) for j in found.accuracies if j.reason)
    refit = found.models.refit
    parameters = [] if refit is None else [
        (
            f"{name.replace('_', ' ')}, re-fitted",
            f"{p.value:.5g} ({p.low:.5g} ... {p.high:.5g}), "
            f"believed {p.believed:.5g} {unit_of_believed(name)}".rstrip(),
        )
        for name, p in refit.parameters.items()
    ]  # fmt: skip
    return Stage("Summary", sentence, (*parameters, *reasons), table=Grid(columns, rows))


def _measured_and_predicted(judged: Sequence[ModelAccuracy], found: Comparison) -> Stage:
    first = judged[0]
    time = found.record.run(first.run).time
    keep = np.arange(0, time.size, max(1, -(-time.size // MOST_POINTS)))
    made = make_subplots(rows=2, cols=1, shared_xaxes=True, row_heights=[0.6, 0.4], vertical_spacing=0.06)
    dress(made, height=560)
    made.add_trace(line(time[keep], first.measured[keep] * 1e6, name="measured", colour=GREY), row=1, col=1)
    numbers = []
    for j, colour in zip(judged, SERIES, strict=False):
        kind = j.hardest_kind
        if kind is None:
            continue
        modelled, name = j.modelled[kind], f"{j.model}, {NAMES[kind]}"
        style = {"line": {"dash": "dot"}, "legendgroup": name}
        made.add_trace(line(time[keep], modelled[keep] * 1e6, name=name, colour=colour, **style), row=1, col=1)
        error = (j.measured - modelled)[keep] * 1e6
        made.add_trace(
            line(time[keep], error, name=name, colour=colour, legendgroup=name, showlegend=False), row=2, col=1
        )
        numbers.append((name, _figure(j.nrmse[kind])))
    made.update_yaxes(title={"text": "position in µm"}, row=1, col=1)
    made.update_yaxes(title={"text": "difference in µm"}, row=2, col=1)
    made.update_xaxes(title={"text": "time in s"}, row=2, col=1)
    sentence = (
        f"Run {first.run} ({first.role}; {found.record.run(first.run).excitation}): the measured position, what each "
        "model makes of the inputs, and the difference (counterpart of Fig. 5 of the paper)."
    )
    return Stage(f"Measured against predicted: {first.run}", sentence, tuple(numbers), plot=made)


def _telling(found: Comparison) -> list[LocatedResidual]:
    """The position's residuals on one run: the first that is held out, else the first."""
    all_of = [r for r in found.residuals if r.accuracy.channel == POSITION_COLUMN]
    held = [r for r in all_of if r.accuracy.role == "held-out"] or all_of
    return [r for r in held if r.accuracy.run == held[0].accuracy.run] if held else []


def _by_band(chosen: Sequence[LocatedResidual]) -> Stage:
    made = figure(x="frequency in Hz", y="RMS in the band in µm")
    middle = np.sqrt(chosen[0].bands.edges[:-1] * chosen[0].bands.edges[1:])
    made.add_trace(line(middle, chosen[0].bands.measured * 1e6, name="measured", colour=GREY, mode="lines+markers"))
    for r, colour in zip(chosen, SERIES, strict=False):
        name = f"{r.accuracy.model}, {NAMES[r.kind]}"
        made.add_trace(line(middle, r.bands.residual * 1e6, name=name, colour=colour, mode="lines+markers"))
    logarithmic(made, [middle], along="x")
    shown = [chosen[0].bands.measured, *(r.bands.residual for r in chosen)]
    logarithmic(made, [values * 1e6 for values in shown], along="y")
    worst = [(r.accuracy.model, r.bands.nrmse) for r in chosen]
    numbers = tuple(
        (f"{name}, worst band", f"NRMSE {np.nanmax(n):.3g} from {chosen[0].bands.edges[int(np.nanargmax(n))]:.3g} Hz")
        for name, n in worst
        if np.isfinite(n).any()
    )
    sentence = f"Residuals of the position of run {chosen[0].accuracy.run} by octave, beside the position itself."
    return Stage("Where residuals live: frequency", sentence, numbers, plot=made)


def _over(chosen: Sequence[LocatedResidual], variable: str) -> Stage:
    label, unit = AXES[variable]
    made = figure(x=label, y="RMS residual in µm")
    for r, colour in zip(chosen, SERIES, strict=False):
        spread = r.over[variable]
        middle = (spread.edges[:-1] + spread.edges[1:]) / 2 * unit
        name = f"{r.accuracy.model}, {NAMES[r.kind]}"
        made.add_trace(line(middle, spread.rms * 1e6, name=name, colour=colour, mode="lines+markers"))
    numbers = tuple(
        (
            f"{r.accuracy.model}, largest over smallest",
            f"{np.nanmax(r.over[variable].rms) / np.nanmin(r.over[variable].rms):.3g}",
        )
        for r in chosen
        if np.isfinite(r.over[variable].rms).any()
    )
    sentence = (
        f"RMS residual of the position of run {chosen[0].accuracy.run} in equally filled bins; a residual that is "
        "noise is the same everywhere."
    )
    return Stage(f"Where residuals live: {label.split(' in ')[0]}", sentence, numbers, plot=made)


def _static(error: StaticError) -> Stage:
    what, unit = ("force", "N") if error.quantity == "force_N" else ("flux linkage", "Wb")
    full = float(np.abs(error.measured).max())
    made = figure(x="coil current in A", y="gap in mm")
    share = 100 * error.error / full
    limit = float(np.abs(share).max())
    made.add_trace(
        go.Scatter(
            x=error.current, y=error.gap * 1e3, mode="markers",
            marker={
                "color": share, "colorscale": "RdBu", "cmin": -limit, "cmax": limit, "size": 11,
                "colorbar": {"title": {"text": "% of full scale"}}, "line": {"color": GREY, "width": 0.5},
            },
            hovertemplate="%{x:.3g} A, %{y:.3g} mm: %{marker.color:.3g} %<extra></extra>",
        )
    )  # fmt: skip
    sentence = (
        f"Measured less computed {what} of the table of '{error.model}' over current and gap, rows with the role "
        f"{error.role}."
    )
    rms = float(np.sqrt(np.mean(error.error**2)))
    numbers = (
        ("rows", str(error.measured.size)),
        ("rows outside the table", str(error.outside)),
        ("RMS error", format_quantity(rms, unit, digits=3)),
        ("of full scale", f"{100 * error.of_full_scale:.3g} %"),
        ("measured over computed", f"{error.scale:.4f} ± {error.scale_error:.1g}"),
    )
    return Stage(f"Static map, {what}: {error.model}, {error.role}", sentence, numbers, plot=made)


def _provenance(found: Comparison) -> tuple[tuple[str, str], ...]:
    actuator = found.record.actuator
    noise = "; ".join(
        f"{m.name}: {m.noise.velocity:.2g} m/s, {m.noise.current:.2g} A a sample" for m in found.models.coupled
    )
    return (
        ("actuator", f"{actuator.name}, SHA-256 {actuator.digest[:16]}"),
        ("record", f"{found.record.origin}; " + ", ".join(f"{r.name} ({r.role})" for r in found.record.runs)),
        ("process noise of the predictors", noise or "-"),
        ("versions", f"msl_fem {version('msl-fem')}, Python {platform.python_version()}"),
        ("date", datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d %H:%M UTC")),
    )


def _channel(name: str) -> str:
    """A column's name as a reader takes it: without its unit, which a ratio does not have."""
    return name.rpartition("_")[0].replace("_", " ")


def _figure(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}"
