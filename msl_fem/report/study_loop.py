"""The closed-loop sections of the study's report: each reference followed, and the frequency response."""

import numpy as np

from msl_fem.control import ClosedLoopRun, FrequencyResponse
from msl_fem.files.quantity import format_quantity
from msl_fem.plant.plant import plant_parameters
from msl_fem.report.figures import Tracking, frequency_response_figure, tracking
from msl_fem.report.page import Stage
from msl_fem.report.page_words import hertz, millimetres, percent
from msl_fem.study import Study


def loop_stages(study: Study) -> list[Stage]:
    """A section for each reference that the simulated loop followed."""
    titles = {
        "sine": "Sine of 2 Hz (Fig. 6)",
        "step": "Step of 3 Hz (Fig. 8)",
        "ramp": "Ramp of 5 Hz (Fig. 9)",
    }
    stages = []
    for name, run in study.loop.runs.items():
        regions = run.region_counts
        cut = "forbids no command" if not run.guard_violations else f"cut {run.guard_violations} commands"
        used = largest_share_of_limit(run, study)
        sentence = (
            f"{_followed(name, run)}; one side pulls at a time, and the guard {cut}. The currents reach at most "
            f"{percent(used)} of what {study.operating_map.levels[-1]:g} T allows at the gap of the moment."
        )
        numbers = (
            ("tracking error, RMS", format_quantity(run.tracking_rms, "m", digits=3)),
            ("largest error", format_quantity(float(np.abs(run.reference - run.position).max()), "m", digits=3)),
            ("peak current", f"{run.peak_current:.2f} A"),
            ("copper loss", f"{run.copper_loss:.2f} W"),
            ("largest share of the last limit", percent(used)),
            ("commands preferred", f"{regions['preferred']}"),
            ("commands discouraged", f"{regions['discouraged']}"),
            ("commands unacceptable", f"{regions['unacceptable']}"),
        )
        shown = Tracking(run.time, run.reference, run.position, run.current)
        stages.append(Stage(titles[name], sentence, numbers, plot=tracking(shown)))
    return stages


def _followed(name: str, run: ClosedLoopRun) -> str:
    """What is seen of the tracking: for steps overshoot and settling, else the error against the amplitude."""
    if name == "step":
        overshoot, settling = _step_figures(run)
        settled = (
            f"settles to 2 % within {settling * 1e3:.1f} ms" if np.isfinite(settling) else "does not settle to 2 %"
        )
        size = millimetres(float(np.ptp(run.reference)))
        return f"After each step of {size} the position {settled}, with an overshoot of {percent(overshoot)}"
    span = float(np.ptp(run.reference)) / 2
    error = format_quantity(run.tracking_rms, "m", digits=3)
    share = percent(run.tracking_rms / span)
    return f"The position follows within {error} RMS, {share} of the amplitude of {millimetres(span)}"


def _step_figures(run: ClosedLoopRun) -> tuple[float, float]:
    """Largest overshoot, of the step, and longest time in s until the error stays below 2 % of it."""
    jumps = np.flatnonzero(np.diff(run.reference)) + 1
    overshoot, settling = 0.0, 0.0
    for start, end in zip(jumps, [*jumps[1:], run.time.size], strict=True):
        size = run.reference[start] - run.reference[start - 1]
        error = (run.position[start:end] - run.reference[start]) / size
        outside = np.flatnonzero(np.abs(error) > 0.02)
        overshoot = max(overshoot, float(error.max()))
        if outside.size and outside[-1] + 1 == end - start and end < run.time.size:
            settling = np.inf
        elif outside.size and outside[-1] + 1 < end - start:
            settling = max(settling, float(run.time[start + outside[-1] + 1] - run.time[start]))
    return overshoot, settling


def response_stage(study: Study) -> Stage:
    """Gain and phase from reference to position, of the simulated loop and as the linear model predicts them."""
    response, design = study.loop.response, study.loop.design
    sentence = (
        f"From reference to position the gain stays within 1 dB of 0 dB up to {hertz(response.flat_band)}"
        f"{_peak(response)}; it falls by 3 dB at {hertz(response.bandwidth)}. The amplitude is "
        f"{format_quantity(response.amplitude, 'm')}; the linear prediction lies beside it. The peak sensitivity in "
        f"mid-travel is {design.peak_sensitivity:.2f}."
    )
    highest = int(np.argmax(response.gain))
    numbers = (
        ("largest gain", f"{response.gain[highest]:.1f} dB at {response.frequency[highest]:.0f} Hz"),
        ("0 dB ± 1 dB up to", hertz(response.flat_band)),
        ("-3 dB", hertz(response.bandwidth)),
        ("feedback alone, -3 dB", hertz(design.feedback_bandwidth)),
        ("peak sensitivity", f"{design.peak_sensitivity:.2f}"),
        ("reach", f"{design.reach[0] * 1e3:.3g} ... {design.reach[1] * 1e3:.3g} mm"),
        ("loop rate", f"{1 / design.law.plant.period:.0f} Hz"),
    )
    curves = {
        "simulated loop": (np.abs(response.response), np.angle(response.response)),
        "linear prediction": (np.abs(response.predicted), np.angle(response.predicted)),
    }
    plot = frequency_response_figure(response.frequency, curves)
    return Stage("Closed-loop frequency response (Fig. 11)", sentence, numbers, plot=plot)


def _peak(response: FrequencyResponse) -> str:
    """The largest gain between both bands, where it is worth a word: a bandwidth behind a peak is no virtue."""
    highest = int(np.argmax(response.gain))
    if response.gain[highest] <= 1.0:
        return ""
    return (
        f" and rises to a peak of {response.gain[highest]:.1f} dB at {response.frequency[highest]:.0f} Hz, where the "
        f"position moves {10 ** (response.gain[highest] / 20):.1f} times as far as it should"
    )


def largest_share_of_limit(run: ClosedLoopRun, study: Study) -> float:
    """The largest coil current of a run over the map's last level at the gap of that side and moment.

    Where the last level is not reached at a gap, the end of the map's currents takes its place.
    """
    regions, plant = study.operating_map, plant_parameters(study.actuator)
    last = np.where(np.isnan(regions.current[-1]), regions.current_max, regions.current[-1])
    worst = 0.0
    for side in range(plant.sides):
        gap = plant.nominal_gap - (1 - 2 * side) * run.position
        limit = np.interp(gap, regions.gap, last)
        share = np.abs(plant.current_share * run.current[:, side]) / limit
        worst = max(worst, float(share.max()))
    return worst
