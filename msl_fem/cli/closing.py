"""The three lines below a result: what it means, how sure that is, what to do next."""

import numpy as np

from msl_fem.control import ClosedLoopRun
from msl_fem.control.asked_voltage import AskedVoltage
from msl_fem.control.design import ControllerDesign
from msl_fem.control.measured_loop import MeasuredLoop
from msl_fem.diagnosis.result import Diagnosis
from msl_fem.files.quantity import format_quantity
from msl_fem.identification import Identification
from msl_fem.report.diagnosis_words import gain_sentence, nats_text, next_steps, verdict_sentence

ZONE_A = 3.0
"""ISO 14839-3 (2006): up to this largest sensitivity a new machine is in zone A."""
GOOD_FIT = 90.0  # % in free run: what is left is a third of a tenth of the power


def diagnosis_closing(found: Diagnosis) -> tuple[str, str, str]:
    """The verdict, the gain and the evidence behind it, the first step."""
    if found.causes:
        first = found.causes[0]
        sure = f"{nats_text(first.statistic)} of evidence where {found.threshold:.3g} are asked for. "
    else:
        sure = ""
    steps = next_steps(found)
    next_step = f"{steps[0][0]}: {steps[0][1]}" if steps else "nothing; the model may be used as it is"
    return (
        f"What it means: {verdict_sentence(found)}",
        f"How sure: {sure}{gain_sentence(found)}",
        f"What to do: {next_step}.",
    )


def control_closing(
    run: ClosedLoopRun, design: ControllerDesign, *, asked: AskedVoltage, held_share: float | None = None
) -> tuple[str, str, str]:
    """How well it follows, how robust the loop is, and the way on.

    asked : what the reference asks of the coils
    held_share : of plants that the design has not seen; None where none were tried
    """
    span = float(np.ptp(run.reference)) / 2
    share = f", {100 * run.tracking_rms / span:.2g} % of the amplitude" if span > 0 else ""
    follows = f"{format_quantity(run.tracking_rms, 'm', digits=3)} RMS{share}"
    peak = f"{run.peak_current:.3g} A"
    sensitivity = design.peak_sensitivity
    good = sensitivity <= ZONE_A
    robust = "zone A of ISO 14839-3, as new machines should be" if good else "beyond zone A of ISO 14839-3 (3)"
    unseen = "" if held_share is None else f"; of the plants that it has not seen it holds {100 * held_share:.0f} %"
    cut = run.guard_violations + run.force_limited
    if run.heat_limited:
        way = (
            f"{run.heat_limited} commands were cut, the windings would get too warm: ask for less force, or for a "
            "shorter time, or cool better (--thermal-resistance)"
        )
    elif cut:
        way = f"{cut} commands were cut: take a smaller or slower reference, or more current"
    elif asked.largest > asked.limit:
        way = _within_voltage(asked)
    elif not good:
        way = 'lower the wish, like --bandwidth "40 Hz", until the peak sensitivity is below 3'
    elif held_share is not None and held_share < 1.0:
        way = "try --design robust or a lower --bandwidth, or measure what is in doubt (msl-fem suspects)"
    else:
        way = "look at its trials (--report loop.html), then take it along as C: msl-fem export ... --what controller"
    return (
        f"What it means: the position follows the reference within {follows}; the largest current is {peak}.",
        f"How sure: largest sensitivity in mid-travel {sensitivity:.3g}, {robust}{unseen}. All of it is simulated.",
        f"What to do: {way}.",
    )


def _within_voltage(asked: AskedVoltage) -> str:
    """What helps where the reference asks for more than the voltage limit."""
    helped = asked.needed > asked.overlap
    return f"the reference asks for {asked.largest:.3g} V of the drive's {asked.limit:.3g} V: " + (
        f'let both sides pull where they hand over (--overlap "{asked.needed:g} N")'
        if helped
        else "take a smaller or slower one, or more voltage"
    )


def loop_closing(worst: MeasuredLoop) -> tuple[str, str, str]:
    """The zone, what the interval leaves open, and the way on."""
    low, high = worst.peak.interval
    words = {
        "A": "as new machines should be",
        "B": "fit for unrestricted operation",
        "C": "fit for a limited time until it is improved",
        "D": "bad enough to damage the machine",
    }
    if not worst.inside:
        way = "excite a wider band: the largest sensitivity is at the end of this one and may be larger beyond"
    elif len(worst.zones_possible) > 1:
        way = f"the interval reaches zones {' and '.join(worst.zones_possible)}: inject longer or more"
    elif worst.zone == "A":
        way = "measure it again at the ends of the travel, where loops are worst"
    else:
        way = 'lower the feedback, like msl-fem control --bandwidth "40 Hz", or take --design scheduled'
    meaning = f"zone {worst.zone} of ISO 14839-3: {words[worst.zone]}"
    if worst.zones_possible == "ABCD":
        meaning = "which noise could make alone: this run does not tell the zone of ISO 14839-3"
    return (
        f"What it means: largest sensitivity {worst.peak.value:.3g} at {worst.peak_at:.0f} Hz, {meaning}.",
        f"How sure: with 95 % confidence it is {low:.3g} to {high:.3g} within the excited band.",
        f"What to do: {way}.",
    )


def identify_closing(found: Identification) -> tuple[str, str, str]:
    """How well unseen runs are followed, what the residuals still hold, and the way on."""
    judged = [(fit, role) for fit, role in zip(found.fits, found.roles, strict=True) if role == "held-out"]
    fit, role = (judged or list(zip(found.fits, found.roles, strict=True)))[0]
    diverged = fit.free_run is None
    reached = "leaves all bounds" if diverged else f"is followed to {fit.free_run:.2f} %"
    outside = [test for test in found.residual_tests if not test.inside_band]
    if outside:
        names = " and ".join("themselves" if test.name == "residuals" else test.name for test in outside)
        left = (
            f"the residuals of the fitted run still depend on {names} (p = {min(t.p_value for t in outside):.1g}): "
            "a small part of the plant is not in the model; the error in free run says how much it matters"
        )
    else:
        left = "the residuals of the fitted run are white and depend on no input: nothing linear is left to find"
    good = fit.free_run is not None and fit.free_run >= GOOD_FIT
    if good and outside:
        way = (
            "use it; msl-fem diagnose says which effect the rest could be, --orders auto --terms auto try richer models"
        )
    elif good:
        way = "use it: msl-fem control --model takes what -o wrote"
    else:
        way = "try --orders auto and --terms auto; if that does not help, msl-fem diagnose says what the model lacks"
    return (
        f"What it means: in free run {fit.run} ({role}) {reached}, one step ahead to {fit.one_step:.2f} %.",
        f"How sure: {left}.",
        f"What to do: {way}.",
    )
