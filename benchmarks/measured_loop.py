"""Whether the intervals of `msl-fem loop` hold: known loops, measured from simulated records.

    python benchmarks/measured_loop.py [--records 40] [--first 0] [--docs]

The nonlinear loop of the reference actuator (table, amplifier with its voltage limit, sensor noise) holds a position
while a multisine is added to its reading; each record has its own seeds. Truth is the largest sensitivity of the linear
loop on the belief at that position, up to the end of the excited band; the sensor has no lag, which the belief leaves
out (the 8 us of the actuator's file make the peak 1 % larger, and the measurement sees that). With --docs the table
takes its place in docs/loop.md.
"""

import argparse

import numpy as np
from controller_cases import ROOT, TABLE, belief, design, servo
from marked_text import rewrite

from msl_fem.control import PlantUnderTest, run_closed_loop
from msl_fem.control.injection import held_under_test
from msl_fem.control.loop_record import closed_loop_record
from msl_fem.control.measured_loop import MeasuredLoop, measured_loops
from msl_fem.plant.excitation import parse_excitation

RATE = 2500.0
SERVO = servo(position_sensor={"bandwidth": None})
STOP = 600.0
CASES = ((0.2e-3, 0.1), (0.2e-3, 0.3), (0.3e-3, 0.3), (0.4e-3, 0.3), (0.45e-3, 0.2), (0.0, 0.3))
SPEC = "multisine:start=5 Hz,stop={} Hz,amplitude={} um,bias={} mm,duration=8 s,periods=1,seed={}"
HEAD = (
    "| position | injected, RMS | true peak | measured, mean | half interval, mean | truth inside | by chance |\n"
    "| --- | --- | --- | --- | --- | --- | --- |"
)


def measured(position: float, micrometres: float, seed: int) -> MeasuredLoop:
    spec = SPEC.format(STOP, micrometres, position * 1e3, seed)
    held = held_under_test(parse_excitation(spec, unit="m"), rate=RATE)
    run = run_closed_loop(
        design(),
        held.reference,
        plant=PlantUnderTest(SERVO, TABLE),
        generator=np.random.default_rng([seed, 1]),
        injection=held.signal,
    )
    return measured_loops(closed_loop_record(SERVO, run, excitation=spec, injection=held.signal))[0]


def row(position: float, micrometres: float, records: int, first: int = 0) -> str:
    at = belief().place(position)
    true = design().law.peak_sensitivity(at, frequency=np.geomspace(5.0, STOP, 5000))
    found = [measured(position, micrometres, seed) for seed in range(first, first + records)]
    inside = sum(loop.peak.interval[0] <= true <= loop.peak.interval[1] for loop in found)
    spread = 1.96 * np.sqrt(0.95 * 0.05 * records)
    mean = np.mean([loop.peak.value for loop in found])
    half = np.mean([loop.peak.interval[1] - loop.peak.value for loop in found])
    chance = f"{max(0.95 * records - spread, 0):.0f} ... {min(0.95 * records + spread, records):.0f}"
    return (
        f"| {position * 1e3:g} mm | {micrometres:g} um | {true:.3f} | {mean:.3f} | {half:.3f} | {inside} of {records} "
        f"| {chance} |"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--records", type=int, default=40)
    parser.add_argument("--first", type=int, default=0, help="seed of the first record")
    parser.add_argument("--docs", action="store_true")
    asked = parser.parse_args()
    rows = []
    for position, micrometres in CASES:
        rows.append(row(position, micrometres, asked.records, asked.first))
        print(rows[-1], flush=True)
    if asked.docs:
        rewrite(ROOT / "docs" / "loop.md", {"coverage": "\n".join([HEAD, *rows])})


if __name__ == "__main__":
    main()
