"""Pull solenoids: doubts about their logs, inductance over frequency, currents after switch-on, families."""

from dataclasses import replace

import numpy as np
from judged import DATA, Judged, Value
from switch_on import AFTER, SHORT, chain_of, pulses, switched_on

from msl_fem.computing.arrays import Array
from msl_fem.diagnosis.impedances import diagnose_impedance
from msl_fem.record.columns import read_columns
from msl_fem.record.file_doubts import doubts_of_file
from msl_fem.record.impedance import ImpedanceMap

COIL_RESISTANCE = {240508: 65.8, 240509: 51.9}
"""Sheet to ohm, as the author states."""


def solenoids() -> list[Judged]:
    rows = []
    labels = ["solenoid", "f_pwm_Hz", "temperature_degC", "position_m", "t_on_s"]
    known = {
        "two_point_2024": "a block copied (CBS0730140, 25 degC, 3.5 and 4 mm): README",
        "two_point_2025": "2 and 3 ms exchanged in 52 blocks, positions reversed at 40 degC: README",
        "swing": "inductance and position looked up and clipped: README",
    }
    for name, said in known.items():
        doubts = doubts_of_file(DATA / "solenoid_stroke" / f"{name}.csv", [] if name == "swing" else labels)
        rows.append(Judged(f"solenoids, {name}", said, f"{len(doubts)} doubts", "; ".join(doubts)))
    return rows


def impedance() -> list[Judged]:
    """LCR meter at four frequencies and six strokes; then the current after switch-on, which no fit has seen."""
    rows = read_columns(DATA / "solenoid_stroke" / "inductance_cbs0730.csv")
    names = ["L_100Hz_H", "L_1kHz_H", "L_10kHz_H", "L_100kHz_H"]
    stroke = np.repeat(rows["withdrawal_m"], 4)
    read = np.array([rows[name] for name in names]).T.ravel()
    found = diagnose_impedance(ImpedanceMap(stroke, np.tile([1e2, 1e3, 1e4, 1e5], 6), read))
    best = found.laws[0]
    worst = int(np.argmax(np.abs(best.error)))
    rows = pulses(best, COIL_RESISTANCE)
    chain = chain_of(best, rows)
    short = [row for row in rows if row.on <= SHORT]
    made = [switched_on(best, row.stroke, chain.ohm, volt=chain.volt) / row.currents for row in short]
    stated = [switched_on(best, row.stroke, row.ohm) / row.currents for row in short]
    out = next(row for row in short if row.label == "out, 51.9 ohm")
    foretold = 1e3 * switched_on(best, out.stroke, chain.ohm, volt=chain.volt)
    currents = [
        Value(f"current after {us} us, out", "mA", 1e3 * float(known), float(current))
        for us, known, current in zip(AFTER, out.currents, foretold, strict=True)
    ]
    worst_current = made[0].ravel()[0]
    for ratio in np.concatenate(made):
        worst_current = ratio if abs(ratio - 1) > abs(worst_current - 1) else worst_current
    currents.append(Value(f"worst of all {3 * len(short)} currents over the measured one", "1", 1.0, worst_current))
    ends = (chain.ohm - chain.ohm_off, chain.ohm + chain.ohm_off)
    currents.append(Value("coil resistance by the longer pulses", "ohm", 51.9, chain.ohm, ends))
    inductance = Value("worst of 24 inductances", "mH", 1e3 * read[worst], 1e3 * read[worst] * (1 + best.error[worst]))
    means = (
        f"eddy_currents, {found.reason}; leakage {1e3 * best.leakage:.2f} mH, time constant "
        f"{1e3 * best.time_constant[0]:.2f} ms in to {1e3 * best.time_constant[-1]:.2f} ms out; currents after "
        f"switch-on for 1 ms, which nothing was fitted to, are {np.min(stated):.2f} to {np.max(stated):.2f} times the "
        f"measured ones with 12 V and the stated resistances, {np.min(made):.2f} to {np.max(made):.2f} times with the "
        f"{chain.volt:.2f} +- {chain.volt_off:.2f} V and {chain.ohm:.1f} +- {chain.ohm_off:.1f} ohm that the "
        f"{chain.rows} rows of longer pulses tell"
    )
    known = "eddy currents: L falls 15-fold from 0.1 to 100 kHz, its slope over stroke turns; no R-L fits"
    values = (replace(inductance, allowed=0.05), *currents)
    return [Judged("solenoid, inductance over frequency", known, found.verdict, means, values)]


def families() -> list[Judged]:
    """What the solenoids of one log have in common and in what they differ: temperature, repeats; and how far the one
    that was set up on two days is equal to itself. No set has several units of one drawing."""
    rows = read_columns(DATA / "solenoid_stroke" / "two_point_2024.csv")
    names = list(dict.fromkeys(str(name) for name in rows["solenoid"]))
    slopes = {name: slopes_over_temperature(rows, name) for name in names}
    told = [
        f"{name} {np.median(of):.2f} ({of.min():.2f} to {of.max():.2f})" if of.size else f"{name} at one temperature"
        for name, of in slopes.items()
    ]
    repeats = {name: scatter_of_repeats(rows, name) for name in names}
    again = set_up_again()
    scattered = "; ".join(f"{name} {counts:.2f}" for name, counts in repeats.items())
    means = (
        f"%/K of the reading at the longest pulse, median (range over strokes): {'; '.join(told)}. One sigma of ten "
        f"repeats: {scattered} counts. One solenoid set up on two days: {again.size} currents at equal strokes and "
        f"pulses differ by {100 * np.mean(again):+.1f} % on average, {100 * np.std(again, ddof=1):.1f} % (one sigma)"
    )
    every = np.concatenate(list(slopes.values()))
    median = float(np.median(list(repeats.values())))
    values = (
        Value("reading over temperature, median", "%/K", -0.56, float(np.median(every)), stated=(-0.70, -0.41)),
        Value("scatter of repeats, median of the solenoids", "counts", 0.62, median, stated=(0.5, 0.75)),
    )
    known = "reading falls by 0.41 to 0.70 %/K, repeats scatter by 0.5 to 0.75 counts: README"
    verdict = f"{len(names)} kinds, none with two units"
    return [Judged("solenoids, families", known, verdict, means, values)]


def slopes_over_temperature(rows, name: str) -> Array:
    """%/K of v1 at the longest pulses of either frequency at each stroke of a solenoid, over its value at 25 degC;
    empty below three temperatures."""
    own = np.array([str(one) == name for one in rows["solenoid"]])
    found: list[float] = []
    if np.unique(rows["temperature_degC"][own]).size < 3:
        return np.array(found)
    for frequency in np.unique(rows["f_pwm_Hz"][own]):
        here = own & (rows["f_pwm_Hz"] == frequency)
        here &= rows["t_on_s"] == rows["t_on_s"][here].max()
        for stroke in np.unique(rows["position_m"][here]):
            at = here & (rows["position_m"] == stroke)
            line = np.polyfit(rows["temperature_degC"][at] - 25.0, rows["v1_mean"][at], 1)
            found.append(100 * line[0] / line[1])
    return np.array(found)


def scatter_of_repeats(rows, name: str) -> float:
    """Median over the rows of a solenoid of the standard deviation of ten repeats, both readings, counts."""
    own = np.array([str(one) == name for one in rows["solenoid"]])
    each = [np.std([rows[f"{v}_{k}"][own] for k in range(1, 11)], axis=0, ddof=1) for v in ("v0", "v1")]
    return float(np.median(each))


def set_up_again() -> Array:
    """Relative differences of the currents of one solenoid on two days, at the strokes and pulses of both."""
    rows = read_columns(DATA / "solenoid_stroke" / "switch_on_cbs0730.csv")
    days = []
    for sheet in COIL_RESISTANCE:
        at = np.flatnonzero(rows["sheet"] == sheet)
        days.append({(str(rows["stroke_label"][k]), float(rows["t_on_s"][k])): k for k in at})
    both = [key for key in days[0] if key in days[1]]
    return np.array([rows[name][days[1][k]] / rows[name][days[0][k]] - 1 for k in both for name in AFTER.values()])
