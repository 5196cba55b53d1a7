"""The report of a measured loop: its sensitivity over frequency, the zones, margins with their intervals."""

from collections.abc import Sequence

import numpy as np
import plotly.graph_objects as go

from msl_fem.control.design import ZONE_ENDS
from msl_fem.control.measured_loop import MeasuredLoop, text_of
from msl_fem.record import Record
from msl_fem.report.figures import GREY, SERIES, figure, line, logarithmic
from msl_fem.report.page import Grid, Page, Stage

_TWO_SIDED_95 = 1.959964


def loop_page(loops: Sequence[MeasuredLoop], record: Record, folder: str) -> Page:
    """The page of a record's loops, the one with the largest peak sensitivity first."""
    worst = loops[0]
    low, high = worst.peak.interval
    headline = (
        (f"{worst.peak.value:.2f}", f"largest sensitivity, {low:.2f} to {high:.2f} with 95 % confidence"),
        (worst.zone, "zone of ISO 14839-3"),
        (text_of(worst.phase, "deg").partition(" (")[0], "phase margin"),
    )
    stages = (_sensitivity(loops), *(_margins(loop) for loop in loops))
    sources = (("record", folder), ("origin", record.origin), ("actuator", record.actuator.name))
    return Page(
        f"{record.actuator.name}: the loop as measured",
        "From a test signal that was added to the position reading; no model of plant or controller.",
        headline,
        stages,
        sources,
    )


def _sensitivity(loops: Sequence[MeasuredLoop]) -> Stage:
    made = figure(x="frequency in Hz", y="|S|")
    for loop, colour in zip(loops, SERIES, strict=False):
        size = np.abs(loop.sensitivity)
        name = f"{loop.run}, {loop.position * 1e3:.3g} mm"
        for sign in (-1, 1):
            made.add_trace(
                _end(loop, np.maximum(size + sign * _TWO_SIDED_95 * loop.deviation, 0.0), colour, filled=sign > 0)
            )
        made.add_trace(line(loop.frequency, size, name=name, colour=colour))
    ends = np.array([min(loop.frequency[0] for loop in loops), max(loop.frequency[-1] for loop in loops)])
    for level, zone, dash in zip(ZONE_ENDS, "ABC", ("dot", "dash", "longdash"), strict=True):
        name = f"zone {zone} ends, {level:g}"
        made.add_trace(line(ends, np.full(2, level), name=name, colour=GREY, line={"dash": dash, "width": 1}))
    logarithmic(made, [loop.frequency for loop in loops], along="x")
    worst = loops[0]
    beyond = "" if worst.inside else " The peak is at the end of the excited band: it may be larger beyond."
    sentence = (
        f"The sensitivity is largest at {worst.peak_at:.0f} Hz, {text_of(worst.peak, '')}; the band is the 95 % "
        f"interval at each frequency.{beyond}"
    )
    return Stage("Sensitivity", sentence, (), plot=made)


def _end(loop: MeasuredLoop, values: np.ndarray, colour: str, *, filled: bool) -> go.Scatter:
    """An end of the interval; the upper one is filled down to the lower."""
    thin = {"width": 0.5}
    fill = "tonexty" if filled else None
    return line(loop.frequency, values, name="95 %", colour=colour, line=thin, fill=fill, showlegend=False)


def _margins(loop: MeasuredLoop) -> Stage:
    rows = [
        ["largest sensitivity", f"{text_of(loop.peak, '')} at {loop.peak_at:.0f} Hz"],
        ["zones within the interval", ", ".join(loop.zones_possible)],
        ["gain margin up", text_of(loop.gain_up, "")],
        ["gain margin down", text_of(loop.gain_down, "")],
        ["phase margin", text_of(loop.phase, "deg")],
        ["delay margin", text_of(loop.delay, "s")],
    ]
    sentence = (
        f"At {loop.position * 1e3:.3f} mm, excited from {loop.frequency[0]:.3g} to {loop.frequency[-1]:.4g} Hz. "
        "Intervals are 95 %."
    )
    return Stage(f"Margins of {loop.run}", sentence, (), table=Grid(["figure", "value (interval)"], rows))
