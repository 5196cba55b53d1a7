"""The EMPS drive: identified on its estimation record, judged on its test record; the table of docs/identification.md,
and its free runs beside published ones, in docs/real_records.md.

    python benchmarks/emps.py [--docs]

Force of the inverse dynamics: all channels low-passed at 20 Hz without phase. Closed loop: reference, kp and kv as
stated with the record; the test record's pulses (0 or 5 V, half a second each) are read off its force and the law.
"""

import argparse
import sys
from pathlib import Path

import numpy as np
from friction_drive import (
    CascadeLoop,
    FrictionDrive,
    closed_loop,
    filtered_equation,
    free_run,
    freely_refined,
    inverse_dynamics,
    refined,
)
from marked_text import rewrite
from scipy.ndimage import median_filter

from msl_fem.identification import ArmaxOrders, fit_armax, sampled_run
from msl_fem.record import load_record

ROOT = Path(__file__).parent.parent
PUBLISHED = FrictionDrive(95.1089, 203.5034, 20.3935, -3.1648)  # Janot, Gautier, Brunot 2019
LOOP = CascadeLoop(160.18, 243.45, 35.15065)
PULSE, WINDOW = 5.0, 101  # V, samples of the median that tells the pulses from noise


def pulses(run, period):
    """The added voltage: what the force holds beyond the law, 0 or 5 V."""
    position = run["position_m"]
    velocity = np.diff(position, prepend=position[0]) / period
    law = LOOP.kv * (LOOP.kp * (run["reference_m"] - position) - velocity)
    left = run["force_N"] / LOOP.force_constant - law
    return np.where(median_filter(left, WINDOW) > 0.5 * PULSE, PULSE, 0.0)


def share(measured, modelled):
    """RMS of the difference over the standard deviation of what was measured, in per cent."""
    return 100.0 * np.sqrt(np.mean((measured - modelled) ** 2)) / np.std(measured)


def judged(drive, run, period, added):
    """Inverse-dynamics force, closed-loop force and closed-loop position, each in per cent."""
    columns, force = filtered_equation(run["position_m"], run["force_N"], period)
    position, loop_force = closed_loop(
        drive, LOOP, run["reference_m"], sampling_period=period, start=run["position_m"][0], added=added
    )
    low = filtered_equation(position, loop_force, period)[1]
    return share(force, columns @ drive.vector), share(force, low), share(run["position_m"], position)


def markdown():
    record = load_record(ROOT / "measurements" / "emps")
    fit, test = record.runs
    period = fit.sampling_period
    least_squares, deviations = inverse_dynamics(fit["position_m"], fit["force_N"], period)
    in_loop = refined(least_squares, LOOP, fit["reference_m"], fit["position_m"], sampling_period=period)
    linear = fit_armax([sampled_run(record, fit)], ArmaxOrders(2, 2, 2, 1, offset=True))
    physical = linear.physical_parameters(gains={"force": 1.0})
    offset = -linear.polynomials.offset / linear.polynomials.b[0].sum()
    armax = FrictionDrive(physical["mass"].value, physical["damping"].value, 0.0, offset)
    drives = {
        "published": PUBLISHED,
        "inverse dynamics": least_squares,
        "closed-loop output error": in_loop,
        "ARMAX(2, 2, 2), no Coulomb friction": armax,
    }
    added = {fit.name: np.zeros(fit["force_N"].size), test.name: pulses(test, period)}
    lines = [
        "| parameters | M (kg) | Fv (N s/m) | Fc (N) | offset (N) | run | inverse-dynamics force (%) "
        "| closed-loop force (%) | closed-loop position (%) |",
        "| --- |" + " ---: |" * 4 + " --- |" + " ---: |" * 3,
    ]
    for name, drive in drives.items():
        values = " | ".join(f"{v:.4g}" for v in drive.vector)
        for run, role in ((fit, "estimation"), (test, "test")):
            figures = " | ".join(f"{v:.3g}" for v in judged(drive, run, period, added[run.name]))
            lines.append(f"| {name} | {values} | {role} | {figures} |")
    spread = ", ".join(f"{v:.2g}" for v in deviations)
    lines += [
        "",
        "Each figure is the RMS of the difference over the standard deviation of the measured channel. One standard "
        f"deviation of the inverse-dynamics parameters, in the order of the table: {spread}. "
        f"Pulses found in the test record: {np.mean(added[test.name] > 0):.0%} of the time.",
    ]
    return "\n".join(lines) + "\n"


def free_runs():
    """Free runs under the measured force: those of the physical models, and what was published of others."""
    record = load_record(ROOT / "measurements" / "emps")
    fit, test = record.runs
    period = fit.sampling_period
    least_squares, _ = inverse_dynamics(fit["position_m"], fit["force_N"], period)
    freely = freely_refined(least_squares, fit["force_N"], fit["position_m"], sampling_period=period)
    drives = {
        "published parameters": PUBLISHED,
        "inverse dynamics": least_squares,
        "output error of the free run": freely,
    }
    lines = [
        "| model | numbers fitted | estimation: position (mm) | fit (%) | test: position (mm) | fit (%) "
        "| test: relative force error (%) |",
        "| --- |" + " ---: |" * 6,
    ]
    for name, drive in drives.items():
        both = " | ".join(followed(drive, run, period) for run in (fit, test))
        columns, force = filtered_equation(test["position_m"], test["force_N"], period)
        lines.append(f"| {name} | 4 | {both} | {share(force, columns @ drive.vector):.3g} |")
    lines += [
        "| dynoNet (Forgione, Piga 2021): third-order block, network of 20 inputs, integrator | | | | 2.64 | 96.8 | |",
        "| best linear model (Janot, Gautier, Brunot 2019, as quoted there) | | | | | 25.4 | |",
    ]
    return "\n".join(lines) + "\n"


def followed(drive, run, period):
    """RMS error of a free run's position in mm, and 100 % less it over the position's standard deviation."""
    position = run["position_m"]
    missed = free_run(drive, run["force_N"], sampling_period=period, start=position[0]) - position
    rms = np.sqrt(np.mean(missed**2))
    return f"{1e3 * rms:.2f} | {100 * (1 - rms / np.std(position)):.1f}"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--docs", action="store_true", help="write the tables into docs")
    given = parser.parse_args()
    text, free = markdown(), free_runs()
    sys.stdout.write(text + free)
    if given.docs:
        rewrite(ROOT / "docs" / "identification.md", {"emps": text})
        rewrite(ROOT / "docs" / "real_records.md", {"free runs": free})


if __name__ == "__main__":
    main()
