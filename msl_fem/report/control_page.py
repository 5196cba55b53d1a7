"""The report of a controller: the paper's Figs. 6, 8, 9, 10 and 11 with ours, and the loop's margins over the range."""

import datetime
import platform
from importlib.metadata import version

import numpy as np
from plotly.subplots import make_subplots

from msl_fem.control import ClosedLoopRun, Examination, Replay
from msl_fem.control.spec_sheet import SpecSheet
from msl_fem.files.quantity import format_quantity
from msl_fem.report.figures import (
    BLUE,
    GREY,
    ORANGE,
    SERIES,
    Tracking,
    dress,
    figure,
    frequency_response_figure,
    line,
    logarithmic,
    tracking,
)
from msl_fem.report.page import Grid, Page, Stage
from msl_fem.report.unseen_stage import improvement_stage, unseen_stage

_TITLES = {"sine": "Sine of 2 Hz (Fig. 6)", "step": "Step of 3 Hz (Fig. 8)", "ramp": "Ramp of 5 Hz (Fig. 9)"}
_ENDING = {"refused": "refused before the run", "lost": "the plant is lost"}


def control_page(found: Examination, sheet: SpecSheet) -> Page:
    """The report of an examination, with the loop's sheet of figures."""
    design, middle = found.design, found.design.peak_sensitivity
    sine = found.runs["sine"]
    zone = design.zone_reach["A"]
    headline = (
        *(((_length(sine.tracking_rms), "RMS tracking error, 2 Hz sine"),) if isinstance(sine, ClosedLoopRun) else ()),
        (f"{middle:.2f}", "peak sensitivity in the middle"),
        (f"± {zone * 1e3:.3g} mm", "zone A of ISO 14839-3"),
        (f"{found.response.flat_band:.0f} Hz", "0 dB ± 1 dB"),
        (
            f"{sum(run.guard_violations for run in found.runs.values() if isinstance(run, ClosedLoopRun))}",
            "guard violations",
        ),
    )
    stages = (
        *(_reference(name, run, found) for name, run in found.runs.items()),
        _degradation(found),
        *_replays(found),
        _response(found),
        _sensitivity(found),
        _margins(found),
        _promises(sheet),
        *([] if sheet.unseen is None else [unseen_stage(sheet.unseen)]),
        *([] if sheet.over_belief is None else [improvement_stage(sheet.over_belief)]),
        _innovations(found),
    )
    return Page(
        f"{design.actuator.name}: the {design.kind} design in closed loop",
        f"{design.summary}; figures are counterparts of those of Gutierrez and Ro, IEEE Trans. Magnetics 34(5), 1998.",
        headline,
        stages,
        _provenance(found),
    )


def _reference(name: str, run: ClosedLoopRun | str, found: Examination) -> Stage:
    spec, alone = found.specs[name], found.integral_alone
    if isinstance(run, str):
        return Stage(_TITLES[name], f"No run: {run}.", (("reference", spec),))
    span = float(np.ptp(run.reference)) / 2
    sentence = (
        f"The position follows within {_length(run.tracking_rms)} RMS, {_percent(run.tracking_rms / span)} of the "
        f"amplitude of {_length(span)}; "
        + (
            "the guard forbids no command."
            if not run.guard_violations
            else f"the guard cuts {run.guard_violations} commands."
        )
    )
    numbers = (
        ("reference", spec),
        ("tracking error, RMS", _length(run.tracking_rms)),
        *((("the same law by its integral alone", _length(alone)),) if name == "sine" and alone is not None else ()),
        ("largest error", _length(float(np.abs(run.reference - run.position).max()))),
        ("peak current", f"{run.peak_current:.2f} A"),
        ("copper loss", f"{run.copper_loss:.2f} W"),
        *((f"commands {region}", f"{count}") for region, count in run.region_counts.items()),
        ("commands cut for drive or table", f"{run.force_limited}"),
        ("commands cut for the windings' heat", f"{run.heat_limited}"),
        ("windings warmer than ambient by", f"{run.winding_rise:.3g} K"),
    )
    shown = Tracking(run.time, run.reference, run.position, run.current)
    return Stage(_TITLES[name], sentence, numbers, plot=tracking(shown))


def _degradation(found: Examination) -> Stage:
    it = found.degradation
    made = figure(x="frequency in Hz", y="RMS error over amplitude")
    for a, errors, colour in zip(it.amplitude, it.error, SERIES, strict=False):
        made.add_trace(line(it.frequency, errors, name=_length(float(a)), colour=colour, mode="lines+markers"))
    logarithmic(made, [it.frequency], along="x")
    logarithmic(made, [it.error], along="y")
    rows = [
        [_length(float(a)), *(_cell(error, ending) for error, ending in zip(errors, endings, strict=True))]
        for a, errors, endings in zip(it.amplitude, it.error, it.ending, strict=True)
    ]
    lost = sum(ending in _ENDING for row in it.ending for ending in row)
    sentence = (
        "Tracking over amplitude and frequency, up to the end of the reach: the error grows with the frequency, by the "
        f"delay of the feedback; {lost} of {it.error.size} sines ask for forces or positions that guard and drive do "
        "not allow and are refused, or lose the plant."
    )
    table = Grid(["amplitude", *(f"{f:g} Hz" for f in it.frequency)], rows)
    return Stage("Degradation beyond range and frequency (Fig. 10)", sentence, (), plot=made, table=table)


def _cell(error: float, ending: str) -> str:
    return _ENDING.get(ending, _percent(error) + (", commands cut" if ending == "cut" else ""))


def _replays(found: Examination) -> list[Stage]:
    sine, stages = found.runs["sine"], []
    if isinstance(sine, ClosedLoopRun) and found.replays[0]:
        stages.append(_replay("within the range, 2 Hz", sine, found.replays[0]))
    if found.beyond and found.replays[1]:
        run, amplitude, frequency = found.beyond
        where = f"at the largest error, {_length(amplitude)} at {frequency:g} Hz"
        stages.append(_replay(where, run, found.replays[1]))
    return stages


def _replay(where: str, run: ClosedLoopRun, it: Replay) -> Stage:
    made = make_subplots(rows=2, cols=1, shared_xaxes=True, row_heights=[0.6, 0.4], vertical_spacing=0.06)
    dress(made, height=520)
    keep = np.arange(0, run.time.size, max(1, run.time.size // 2000))
    t = run.time[keep]
    made.add_trace(line(t, run.measured[keep] * 1e3, name="measured", colour=BLUE), row=1, col=1)
    made.add_trace(
        line(t, it.position[keep] * 1e3, name="model, recorded currents", colour=ORANGE, line={"dash": "dot"}),
        row=1,
        col=1,
    )
    made.add_trace(line(t, (it.position - run.measured)[keep] * 1e6, name="difference", colour=GREY), row=2, col=1)
    made.update_yaxes(title={"text": "position in mm"}, row=1, col=1)
    made.update_yaxes(title={"text": "difference in µm"}, row=2, col=1)
    made.update_xaxes(title={"text": "time in s"}, row=2, col=1)
    sentence = (
        "The recorded currents, at the recorded position, through the believed table and suspension give a position "
        f"that differs by {_percent(it.nrmse)} of the measured one's standard deviation."
    )
    numbers = (
        ("NRMSE", _percent(it.nrmse)),
        ("largest force of the model", f"{np.nanmax(np.abs(it.force)):.0f} N"),
        ("tracking error, RMS", _length(run.tracking_rms)),
    )
    return Stage(f"Recorded currents through the model, {where} (Fig. 10)", sentence, numbers, plot=made)


def _response(found: Examination) -> Stage:
    it = found.response
    sentence = (
        f"From reference to position the gain stays within 1 dB of 0 dB up to {it.flat_band:.0f} Hz at "
        f"{_length(it.amplitude)} amplitude; the linear prediction lies beside it."
    )
    numbers = (
        ("0 dB ± 1 dB up to", f"{it.flat_band:.0f} Hz"),
        ("-3 dB", f"{it.bandwidth:.0f} Hz" if np.isfinite(it.bandwidth) else "not below a fifth of the rate"),
        ("feedback alone, -3 dB", f"{found.design.feedback_bandwidth:.0f} Hz"),
        ("largest gain", f"{it.gain.max():.1f} dB at {it.frequency[int(np.argmax(it.gain))]:.0f} Hz"),
    )
    curves = {
        "simulated loop": (np.abs(it.response), np.angle(it.response)),
        "linear prediction": (np.abs(it.predicted), np.angle(it.predicted)),
    }
    plot = frequency_response_figure(it.frequency, curves)
    return Stage("Closed-loop frequency response (Fig. 11)", sentence, numbers, plot=plot)


def _sensitivity(found: Examination) -> Stage:
    made = figure(x="frequency in Hz", y="singular value")
    for (x, s), t, colour in zip(
        found.sensitivity.items(), found.complementary.values(), SERIES, strict=False
    ):  # fmt: skip
        name = f"{x * 1e3:.2g} mm"
        made.add_trace(line(found.frequency, s, name=f"|S| at {name}", colour=colour))
        made.add_trace(line(found.frequency, t, name=f"|T| at {name}", colour=colour, line={"dash": "dot"}))
    logarithmic(made, [found.frequency], along="x")
    logarithmic(made, [*found.sensitivity.values(), *found.complementary.values()], along="y")
    ends = found.frequency[[0, -1]]
    for level, zone, dash in ((3.0, "A", "dot"), (4.0, "B", "dash"), (5.0, "C", "longdash")):
        name = f"zone {zone} ends, {level:g}"
        made.add_trace(line(ends, np.full(2, level), name=name, colour=GREY, line={"dash": dash, "width": 1}))
    sentence = (
        "Sensitivity and complementary sensitivity at the plant's input, frozen at positions that the magnets hold; of "
        "one input and one output they are the singular values. The integral makes |S| fall towards rest, the magnets' "
        "negative stiffness raises its peak towards the ends."
    )
    return Stage("Sensitivity over the range", sentence, (), plot=made)


def _margins(found: Examination) -> Stage:
    rows = []
    for p, m in zip(found.design.frozen, found.frozen_margins, strict=True):
        stable = np.isfinite(p.peak_sensitivity)
        rows.append([
            f"{p.position * 1e3:.2f} mm", f"{p.magnet_stiffness:.3g} N/m",
            f"{p.peak_sensitivity:.2f}" if stable else "unstable", f"{p.bound:.2f}", p.zone if stable else "-",
            _decibel(m.gain_up) if stable else "-", _decibel(m.gain_down) if stable else "-",
            f"{m.phase:.0f}°" if stable and np.isfinite(m.phase) else "-",
        ])  # fmt: skip
    columns = [
        "position",
        "magnets' stiffness",
        "peak sensitivity",
        "no controller below",
        "zone",
        "gain up",
        "gain down",
        "phase",
    ]
    reach = found.design.stable_reach
    sentence = (
        f"Margins at frozen positions on the believed plant, stable from {reach[0] * 1e3:.3g} to "
        f"{reach[1] * 1e3:.3g} mm. Zones of ISO 14839-3: A up to a peak sensitivity of 3, B up to 4, C up to 5. No "
        "linear controller of this rate and delay goes below the bound exp(p T (delay + 1)) of the unstable pole p."
    )
    return Stage("Margins over the range", sentence, (), table=Grid(columns, rows))


def _promises(sheet: SpecSheet) -> Stage:
    """Figures of the linear loop on the belief."""
    fields = sheet.to_json()
    down, up = fields["gain_margin"]
    known = "known ahead" if fields["reference_known_ahead"] else "not known ahead"
    sentence = (
        f"The response to a reference that is {known} peaks by {sheet.reference_peak:.2f} dB; it stays within 1 dB to "
        f"{sheet.flat_band:.0f} Hz and within 3 dB to {sheet.wide_band:.0f} Hz. Margins are the worst over "
        f"{_length(fields['working_positions_m'][0])} to {_length(fields['working_positions_m'][1])}."
    )
    numbers = (
        ("worst peak sensitivity", f"{fields['worst_peak_sensitivity'] or np.inf:.2f}"),
        ("gain margins", f"{_decibel(down or 0.0)}, {_decibel(up or np.inf)}"),
        ("phase margin", f"{fields['phase_margin_deg'] or np.nan:.0f}°"),
        ("delay margin", format_quantity(fields["delay_margin_s"] or 0.0, "s", digits=3)),
        ("least dynamic stiffness", f"{sheet.least_stiffness:.3g} N/m at {sheet.least_stiffness_at:.0f} Hz"),
        ("largest constant disturbance", f"{sheet.largest_disturbance:.3g} N"),
    )
    return Stage("What the loop promises", sentence, numbers)


def _innovations(found: Examination) -> Stage:
    it = found.consistency
    if it is None:
        return Stage("Consistency of the filter", "The design has no Kalman filter, or the sine was not run.", ())
    verdict = (
        "more than the sensor's noise: the plant is not quite the believed one"
        if it.more_than_noise
        else "the sensor's noise"
    )
    sentence = f"The innovations along the sine are {verdict}."
    numbers = (
        ("variance over what the sensor's noise gives", f"{it.over_sensor:.3f}"),
        ("95 % of it where there is nothing else", f"{it.interval[0]:.3f} ... {it.interval[1]:.3f}"),
        ("variance over what the filter expects", f"{it.ratio:.3f}"),
        ("correlation of neighbours", f"{it.correlation:.2f}"),
    )
    return Stage("Consistency of the filter", sentence, numbers)


def _provenance(found: Examination) -> tuple[tuple[str, str], ...]:
    design = found.design
    return (
        ("actuator", f"{design.actuator.name}, SHA-256 {design.actuator.digest[:16]}"),
        ("input transformation", str(design.domain["source"])),
        ("loop rate, delay", f"{1 / design.law.plant.period:g} Hz, {design.law.plant.delay} samples"),
        ("references", "; ".join(found.specs.values())),
        ("versions", f"msl_fem {version('msl-fem')}, Python {platform.python_version()}"),
        ("date", datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d %H:%M UTC")),
    )


def _length(value: float) -> str:
    return format_quantity(value, "m", digits=3)


def _percent(share: float) -> str:
    return f"{100 * share:.3g} %"


def _decibel(factor: float) -> str:
    return f"{20 * np.log10(factor):.1f} dB" if 0 < factor < np.inf else "none"
