"""The controllers' figures on the reference actuator: writes the marked parts of docs/control.md.

python benchmarks/controller.py [part ...]      parts: see PARTS; all without arguments, some minutes
"""

import sys
import time
from collections.abc import Callable, Iterable, Sequence

import controller_budget
import numpy as np
from controller_cases import (
    DOCUMENT,
    SERVO,
    TABLE,
    belief,
    design,
    late_rms,
    run,
    servo,
    sine,
    spec,
    step,
    step_figures,
)
from controller_effects import sized_effects
from marked_text import rewrite

from msl_fem.control import (
    BiasOptions,
    ClosedLoopRun,
    ControllerChoice,
    ControllerDesign,
    LqrOptions,
    PlantUnderTest,
    Wish,
    biased_design,
    closed_loop_response,
    designed,
    examine_design,
    held_points,
    innovation_consistency,
    lqr_design,
    run_closed_loop,
    with_measured_gap,
)
from msl_fem.control.baselines import bias_point, default_bias
from msl_fem.errors import InputError
from msl_fem.plant.effects import EffectValues

KINDS = ("lqr", "robust", "biased", "pid")


def table(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [f"| {' | '.join(columns)} |", f"| {' | '.join('---' for _ in columns)} |"]
    return "\n".join(lines + [f"| {' | '.join(row)} |" for row in rows])


def percent(value: float, digits: int = 2) -> str:
    return f"{100 * value:.{digits}g} %"


def designs() -> str:
    """The designs beside one another on the believed plant."""
    rows = []
    cases = [(kind, design(kind)) for kind in (*KINDS, "scheduled")] + [
        ("lqr, integral alone", design("lqr", feedforward=False))
    ]
    for name, made in cases:
        followed = []
        for amplitude in (0.2e-3, 0.4e-3):
            found = run(made, sine(amplitude, 2.0, 1.5))
            followed.append("lost" if found is None else percent(found.tracking_rms / amplitude))
        jumped = run(made, step(0.2e-3))
        overshoot, settling = step_figures(jumped, 0.2e-3) if jumped else (np.nan, np.nan)
        response = closed_loop_response(made, plant=PlantUnderTest(SERVO, TABLE))
        rows.append([
            name, *followed, percent(overshoot), f"{settling * 1e3:.1f} ms", f"{response.flat_band:.0f} Hz",
            f"{made.feedback_bandwidth:.0f} Hz", f"{made.peak_sensitivity:.2f}",
            f"{made.zone_reach['A'] * 1e3:.2f} mm", f"{made.stable_reach[1] * 1e3:.2f} mm",
        ])  # fmt: skip
    return table(
        ["design", "sine 0.2 mm", "sine 0.4 mm", "overshoot", "settling", "0 dB ± 1 dB to", "feedback -3 dB",
         "peak S, middle", "zone A to", "stable to"], rows,
    )  # fmt: skip


def plain_bound() -> str:
    """The least error at 2 Hz of LQR with the integral alone for a peak sensitivity of 2."""
    best: tuple[float, float, float] | None = None
    for bandwidth in np.arange(40.0, 125.0, 5.0):
        try:
            made = lqr_design(belief(), Wish(float(bandwidth), 2.0), options=LqrOptions(feedforward=False))
        except InputError:
            continue
        error = float(np.abs(1 - made.law.reference_response([2.0])[0]))
        if best is None or error < best[0]:
            best = error, made.feedback_bandwidth, made.peak_sensitivity
    assert best is not None
    found = run(design("lqr", feedforward=False), sine(0.4e-3, 2.0, 1.5))
    assert found is not None
    peak = late_rms(found) * np.sqrt(2) / 0.4e-3
    usual = abs(1 - design("lqr", feedforward=False).law.reference_response([2.0])[0])
    return (
        f"With the default wish the error's amplitude at 2 Hz is {percent(peak, 3)} of the sine's in the simulated "
        f"loop, {percent(float(usual), 3)} by the linear prediction. Over wishes from 40 to 120 Hz with a peak "
        f"sensitivity of at most 2 the least is {percent(best[0], 3)} (feedback -3 dB at {best[1]:.0f} Hz, peak "
        f"sensitivity {best[2]:.2f})."
    )


def positions() -> str:
    """Peak sensitivity over frozen positions and loop rates, beside the bound."""
    rows = []
    places = (0.0, 0.2e-3, 0.3e-3, 0.4e-3, 0.45e-3, 0.5e-3)
    for rate, delay, drive in (
        (2500.0, 1, 1000.0), (2500.0, 0, 1000.0), (5000.0, 1, 1000.0), (10e3, 1, 1000.0), (20e3, 1, 1000.0),
        (10e3, 1, 3000.0), (20e3, 1, 5000.0),
    ):  # fmt: skip
        actuator = servo(controller={"rate": rate, "delay_samples": delay}, drive={"bandwidth": drive})
        made = lqr_design(belief(actuator), Wish(60.0, 2.0), options=LqrOptions(working_share=1.0))
        frozen = {round(p.position * 1e6): p for p in made.frozen}
        cells = []
        for x in places:
            p = frozen[round(x * 1e6)]
            cells.append(f"{p.peak_sensitivity:.2f} ({p.bound:.2f})" if np.isfinite(p.peak_sensitivity) else "unstable")
        response = closed_loop_response(made, plant=PlantUnderTest(actuator, TABLE))
        good = max((abs(p.position) for p in made.frozen if p.peak_sensitivity <= 2.0), default=0.0)
        rows.append([f"{rate:g} Hz", f"{delay}", f"{drive:g} Hz", *cells, f"{good * 1e3:.2f} mm",
                     f"{response.flat_band:.0f} Hz"])  # fmt: skip
    return table(
        ["rate", "delay", "amplifier", *(f"{x * 1e3:g} mm" for x in places), "2 or less to", "0 dB ± 1 dB to"], rows
    )


def _within(made: ControllerDesign, amplitudes: Sequence[float]) -> dict[float, ClosedLoopRun]:
    """The runs of sines of 2 Hz, from the smallest amplitude on as long as they are tracked within 2 %."""
    kept = {}
    for amplitude in amplitudes:
        found = run(made, sine(amplitude, 2.0, 1.5))
        if found is None or found.tracking_rms > 0.02 * amplitude:
            break
        kept[amplitude] = found
    return kept


def biased() -> str:
    """The biased baseline over its bias: what it costs and how far it goes."""
    amplitudes = [float(a) for a in np.arange(0.05e-3, 0.5e-3, 0.025e-3)]
    ours, usual, rows = _within(design("lqr"), amplitudes), default_bias(belief()), []
    for bias in (0.3, 0.6, 0.9, usual, 1.5, 2.0, 3.0):
        point = bias_point(belief(), bias, 0.0)
        assert point is not None
        made = biased_design(belief(), Wish(60.0, 2.0 if bias <= usual else None), options=BiasOptions(bias))
        kept = _within(made, amplitudes)
        share = f"{point.magnet_stiffness / 1.4e5:.2f}"
        if not kept:
            rows.append([f"{bias:.2f} A", share, "none", *["-"] * 5])
            continue
        largest = max(kept)
        found, late = kept[largest], kept[largest].time > 0.1
        control = float(np.abs(found.command - bias)[late].max())
        rows.append([
            f"{bias:.2f} A", share, f"{largest * 1e3:.3f} mm", percent(found.tracking_rms / largest),
            f"{control:.3f} A", f"{bias / control:.1f}", f"{found.copper_loss:.2f} W",
            f"{ours[largest].copper_loss:.2f} W",
        ])  # fmt: skip
    wanted = [1e-4, 2e-4, 3e-4, 4e-4]
    points = [p for p in held_points(belief(), usual) if np.isclose(p.position, wanted, atol=1e-9).any()]
    held = "; ".join(f"{p.position * 1e3:.1f} mm: {abs(usual / p.control):.0f}" for p in points)
    columns = [
        "bias", "stiffness taken", "largest sine within 2 %", "its error", "control current", "bias over it",
        "copper loss", "ours at that sine",
    ]  # fmt: skip
    return (
        f"{table(columns, rows)}\n\nFeedback linearization tracks sines up to {max(ours) * 1e3:.3f} mm within 2 %. "
        f"Bias over the control current that holds a position still, at {usual:.2f} A: {held}."
    )


def hand_over() -> str:
    """What an overlap of the sides costs and brings."""
    rows = []
    for overlap in (0.0, 0.1, 0.3, 1.0, 3.0, 10.0):
        made = lqr_design(belief(), options=LqrOptions(overlap=overlap))
        slow, fast, still = (run(made, track) for track in (
            sine(0.05e-3, 2.0, 1.5), sine(0.05e-3, 60.0, 1.0), sine(1e-9, 1.0, 1.0)))  # fmt: skip
        limited = SERVO.drive.voltage_limit if SERVO.drive else np.inf
        if slow is None or fast is None or still is None:
            rows.append([f"{overlap:g} N"] + ["lost"] * 7)
            continue
        late = still.time > 0.5
        rows.append([
            f"{overlap:g} N", percent(late_rms(slow) / 0.05e-3), percent(late_rms(fast) / 0.05e-3),
            f"{late_rms(still) * 1e9:.0f} nm", f"{np.abs(np.diff(still.command[late], axis=0)).max():.2f} A",
            f"{np.abs(still.voltage[late]).max():.0f} V", f"{np.abs(fast.voltage).max() / limited:.0%}",
            f"{slow.copper_loss:.2f} W", f"{still.copper_loss:.3f} W", f"{made.frozen[10].magnet_stiffness:.3g} N/m",
        ])  # fmt: skip
    columns = [
        "overlap", "0.05 mm, 2 Hz", "0.05 mm, 60 Hz", "at rest, RMS", "largest jump of a command at rest",
        "voltage at rest", "of the voltage limit, 60 Hz", "loss, 2 Hz", "loss at rest", "magnets' stiffness, middle",
    ]  # fmt: skip
    return table(columns, rows)


def effects() -> str:
    """Tracking of 0.4 mm (biased, pid: 0.25 mm) at 2 Hz, as the sensor reads it, with each effect at 3 % size."""
    rows = []
    for one in sized_effects():
        cells, signs = [], (1, -1) if one.effect in ("gap_offset", "fringing") else (1,)
        for kind in KINDS:
            amplitude = 0.4e-3 if kind in ("lqr", "robust") else 0.25e-3
            found = [
                run(design(kind), sine(amplitude, 2.0, 1.5), effects={one.effect: {one.parameter: sign * one.value}})
                for sign in signs
            ]
            errors = [np.inf if it is None else late_rms(it, read=True) / amplitude for it in found]
            cells.append("lost" if max(errors) > 0.1 else percent(max(errors)))
        rows.append([f"`{one.effect}`, {one.parameter}", f"{one.value:.3g}", percent(one.size), *cells])
    return table(["effect", "value (SI)", "size", *KINDS], rows)


def consistency() -> str:
    """Normalised innovations in closed loop, with and without effects."""
    made, rows = design("lqr"), []
    cases: list[tuple[str, dict[str, dict[str, float]] | None]] = [("as believed", None)]
    cases += [(f"`{one.effect}`, {one.parameter}", one.values) for one in sized_effects()]
    for name, values in cases:
        cells = []
        for track in (sine(1e-9, 1.0, 3.0), sine(0.2e-3, 2.0, 3.0)):
            found = run(made, track, effects=values)
            if found is None:
                cells += ["lost", "lost"]
                continue
            it = innovation_consistency(made, found)
            cells.append(f"{it.ratio:.3g}")
            cells.append(f"{it.over_sensor:.3g}{' *' if it.more_than_noise else ''}")
        rows.append([name, *cells])
    columns = [
        "plant", "at rest: over the filter's", "over the sensor's", "0.2 mm, 2 Hz: over the filter's",
        "over the sensor's",
    ]  # fmt: skip
    return table(columns, rows)


def amplifier() -> str:
    """What the design loses where it does not know the amplifier's lag."""
    rows = []
    for bandwidth in (200.0, 400.0, 600.0, 1000.0, 2000.0, 5000.0):
        actuator, ideal = servo(drive={"bandwidth": bandwidth}), servo(drive={"bandwidth": 1e6})
        cells = []
        for believed in (actuator, ideal):
            try:
                made = designed(belief(believed), ControllerChoice("lqr"))
            except InputError:
                cells += ["no design", "-"]
                continue
            found = run(made, sine(0.4e-3, 2.0, 1.5), actuator=actuator)
            jumped = run(made, step(0.2e-3), actuator=actuator)
            cells += [
                "lost" if found is None else percent(late_rms(found) / 0.4e-3),
                "lost" if jumped is None else percent(step_figures(jumped, 0.2e-3)[0]),
            ]
        rows.append([f"{bandwidth:g} Hz", *cells])
    columns = ["amplifier", "known: 0.4 mm sine", "step's overshoot", "not known: 0.4 mm sine", "step's overshoot"]
    return table(columns, rows)


def beyond() -> str:
    """Degradation with amplitude and frequency (the paper's Fig. 10, in numbers)."""
    found = examine_design(design("lqr"), plant=PlantUnderTest(SERVO, TABLE))
    it, rows = found.degradation, []
    for a, errors, endings in zip(it.amplitude, it.error, it.ending, strict=True):
        cells = [percent(e) if np.isfinite(e) else ending for e, ending in zip(errors, endings, strict=True)]
        rows.append([f"{a * 1e3:.2f} mm", *cells])
    sine_replay, beyond_replay = found.replays
    assert sine_replay is not None
    assert beyond_replay is not None
    assert found.beyond is not None
    return (
        f"{table(['amplitude', *(f'{f:g} Hz' for f in it.frequency)], rows)}\n\nThe recorded currents through the "
        f"model: NRMSE {percent(sine_replay.nrmse)} for the sine of 0.4 mm at 2 Hz, {percent(beyond_replay.nrmse)} for "
        f"{found.beyond[1] * 1e3:.2f} mm at {found.beyond[2]:g} Hz, the largest error that was kept."
    )


def speed() -> str:
    """Seconds simulated a second."""
    made, track = design("lqr"), sine(0.3e-3, 5.0, 4.0)
    cells = []
    for values in (None, EffectValues({"force_offset": {"force": 0.1}})):
        plant = PlantUnderTest(SERVO, TABLE, values)
        run_closed_loop(made, track, plant=plant)
        best = np.inf
        for _ in range(5):
            begin = time.process_time()
            run_closed_loop(made, track, plant=plant)
            best = min(best, time.process_time() - begin)
        cells.append(4.0 / best)
    return f"The plain plant runs {cells[0]:.0f} times faster than real time, one with effects {cells[1]:.0f} times."


def gap_lead() -> str:
    """The paper's inverse at the measured gap beside the one at the gap to come."""
    rows = []
    for name, made in (("gap to come", design("lqr")), ("measured gap", with_measured_gap(design("lqr")))):
        rows.append([name, *("unstable" if not np.isfinite(p.peak_sensitivity) else f"{p.peak_sensitivity:.2f}"
                             for p in made.frozen[10::2])])  # fmt: skip
    return table(["inverse at the", *(f"{p.position * 1e3:.1f} mm" for p in design("lqr").frozen[10::2])], rows)


def references() -> str:
    """The paper's references, Figs. 6, 8 and 9."""
    rows = []
    for name, text in (
        ("sine (Fig. 6)", "sine:frequency=2 Hz,amplitude=0.4 mm,duration=1.5 s"),
        ("step (Fig. 8)", "step:frequency=3 Hz,amplitude=0.1 mm,duration=1 s"),
        ("ramp (Fig. 9)", "ramp:frequency=5 Hz,amplitude=0.2 mm,duration=1 s"),
    ):
        track = spec(text)
        cells = []
        for made in (design("lqr"), design("robust"), design("biased"), design("lqr", feedforward=False)):
            found = run(made, track)
            cells.append("lost" if found is None else f"{found.tracking_rms * 1e6:.2f} um, {found.copper_loss:.2f} W")
        rows.append([name, *cells])
    return table(["reference", "lqr", "robust", "biased", "lqr, integral alone"], rows)


PARTS: dict[str, Callable[[], str]] = {
    "designs": designs,
    "references": references,
    "integral alone": plain_bound,
    "gap lead": gap_lead,
    "positions": positions,
    "biased": biased,
    "hand-over": hand_over,
    "effects": effects,
    "budget": controller_budget.budget,
    "inverse": controller_budget.inverses,
    "consistency": consistency,
    "amplifier": amplifier,
    "beyond": beyond,
    "speed": speed,
}


def main() -> None:
    for name in sys.argv[1:] or PARTS:
        begin = time.process_time()
        content = PARTS[name]()
        print(f"## {name} ({time.process_time() - begin:.1f} s)\n{content}\n", flush=True)
        rewrite(DOCUMENT, {name: content})


if __name__ == "__main__":
    main()
