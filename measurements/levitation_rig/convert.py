"""Writes the levitation record from the rig's .mat files: python convert.py FOLDER_OF_THE_REPOSITORY.

Runs: the closed-loop logs from the time on at which the ball floats free, position x = 14 mm - z counted towards the
coil, duty turned into volts by the multimeter's table. Static map: flux linkage from the duty steps with the ball
held, lambda = integral of (V - R i) dt from the switching to the rest. R follows from the rest itself, R = V/i, so a
drift of the resistance does not add up. The switching lies 0.26 samples after the row with the new duty (median of the
steps of duty 0.5 and more, by extrapolating the first three samples back to the start; spread 0.08). Steps off are not
used: the amplifier's voltage while the current decays is not known. Lift-off: the ball rests on a platform under a
rising current until its weight is borne.
"""

import sys
from pathlib import Path

import numpy as np
from scipy.io import loadmat

NOMINAL_GAP = 14e-3
WEIGHT = 61.57e-3 * 9.81
DUTY = np.arange(11) / 10
VOLT = np.array([0.043, 0.613, 1.768, 2.93, 4.10, 5.26, 6.43, 7.59, 8.80, 9.96, 11.06])
SWITCHING = 0.26  # samples after the row with the new duty
STATIC_PERIOD = 5e-3
RUNS = {
    "steps": ("step/LQI - KF.mat", 1.0),
    "up_and_down": ("multisteps_updown/LQR_tracking - KF.mat", 1.0),
    "stairs": ("multisteps_stairs/PID_anti_windup - KF.mat", 1.0),
}
"""File, and the time in s from which on the ball floats: before, it is lifted from its rest."""


def flux_rows(log: np.ndarray) -> list[tuple[float, float, float]]:
    """Gap (m), current (A) and flux linkage (Wb) of each duty step of a log, (7, n_sample) as the rig writes it."""
    _, z, _, current, _, duty, _ = log
    switched = np.flatnonzero(np.diff(duty)) + 1
    rows = []
    for on, off in zip(switched, np.r_[switched[1:], duty.size], strict=True):
        if duty[on] < 0.15 or off - on < 150:  # the smallest step is as large as the amplifier's dead zone
            continue
        offset = current[on - 50 : on].mean()  # the reading at rest
        final = current[off - 80 : off].mean() - offset
        voltage = np.interp(duty[on], DUTY, VOLT) - VOLT[0]
        missing = 1.0 - (current[on : off - 80] - offset) / final
        first = int(np.ceil(SWITCHING))
        until = first - SWITCHING
        area = 0.5 * until * (1.0 + missing[first]) + 0.5 * missing[first] + missing[first + 1 :].sum()
        rows.append((z[on:off].mean(), final, voltage * STATIC_PERIOD * area))
    return rows


def lift_off(log: np.ndarray) -> tuple[float, float]:
    """Gap (m) and current (A) at which the ball leaves its platform."""
    _, z, _, current, _, _, _ = log
    rest = np.median(z[:200])
    gone = int(np.argmax(z < rest - 2e-3))  # surely gone; then back to the last sample at rest
    noise = max(float(z[:200].std()), 15e-6)
    last = gone - int(np.argmax(np.abs(z[gone::-1] - rest) < 3 * noise))
    return float(rest), float(current[last - 3 : last + 1].mean())


def run_columns(log: np.ndarray, start: float) -> dict[str, np.ndarray]:
    """The columns of a run from `start` seconds on, SI units."""
    kept = log[:, log[0] >= start - 1e-9]
    time, reference, z, _, current, _, duty, _ = kept[:8]
    return {
        "time_s": time - time[0],
        "voltage_1_V": np.interp(duty, DUTY, VOLT),
        "current_1_A": current,
        "position_m": NOMINAL_GAP - z,
        "reference_m": NOMINAL_GAP - reference,
    }


def write(path: Path, columns: dict[str, np.ndarray], forms: tuple[str, ...]) -> None:
    """A CSV file of the columns."""
    rows = [",".join(f % v for f, v in zip(forms, row, strict=True)) for row in zip(*columns.values(), strict=True)]
    path.write_text("\n".join([",".join(columns), *rows, ""]), encoding="utf-8")
    print(f"{path.name}: {len(rows)} rows")


def main(source: Path, target: Path) -> None:
    for name, (file, start) in RUNS.items():
        columns = run_columns(loadmat(source / "results" / file)["logouts"], start)
        write(target / f"{name}.csv", columns, ("%.3f", "%.4f", "%.5f", "%.8f", "%.8f"))
    steps = sorted((source / "identification" / "data" / "inductance").glob("*.mat"))
    flux = np.array([row for file in steps for row in flux_rows(loadmat(file)["measurements"])])
    flux = flux[np.lexsort((flux[:, 1], flux[:, 0]))]
    write(
        target / "static.csv",
        dict(zip(("gap_m", "current_A", "flux_linkage_Wb"), flux.T, strict=True)),
        ("%.6f", "%.4f", "%.5f"),
    )
    ramps = sorted((source / "identification" / "data" / "force").glob("*.mat"))
    lifted = np.array([lift_off(loadmat(file)["measurements"]) for file in ramps])
    gap, current = lifted[lifted[:, 0].argsort()].T
    force = np.full(gap.size, WEIGHT)
    write(target / "lift_off.csv", {"gap_m": gap, "current_A": current, "force_N": force}, ("%.6f", "%.4f", "%.4f"))


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("usage: python convert.py FOLDER_OF_THE_REPOSITORY")
    main(Path(sys.argv[1]), Path(__file__).parent)
