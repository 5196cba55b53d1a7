"""A pair of E-cores with the whole coenergy of its two-sided field, diagnosed with the table of one magnet.

As designed nothing is to be named of a pair that has all that the drawing tells, each drawn within its sigma; with the
plain belief `mutual_inductance` alone, of a pair that has its field and nothing else. True parameters and noise are
drawn by a seed: python benchmarks/belief_of_a_pair.py [SEED]

The simulated pair is as deep as its plane field says, so the believed mutual inductance is that of the plane field too.
"""

import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from msl_fem.actuator import Actuator, ECore, load_actuator
from msl_fem.comparison.as_designed import as_designed
from msl_fem.comparison.as_designed.stray_field import MUTUAL_OF_SOLIDS
from msl_fem.diagnosis import DiagnosisSettings, diagnose
from msl_fem.plant import NamedRun, refused_unless_borne, simulation_record
from msl_fem.plant.believed import PLAIN_BELIEF, Belief
from msl_fem.plant.effects import EffectValues
from msl_fem.plant.excitation import parse_excitation
from msl_fem.record import Record, Tolerance
from msl_fem.table.magnetic_table import MagneticTable
from msl_fem.table.pair_table import load_table

ROOT = Path(__file__).parent.parent
RUNS = (
    "band-limited-noise:amplitude=610 mV,bias=1.2 V,duration=2 s,seed=1,band=500 Hz,role=fit",
    "swept-sine:amplitude=300 mV,bias=1.2 V,duration=1 s,start=5 Hz,stop=300 Hz,role=held-out",
)
RATE = 1e4


def drawn(actuator: Actuator, generator: np.random.Generator) -> Actuator:
    """The actuator with mass, stiffness, damping and resistance within their tolerances."""
    motion, drive, tolerance = actuator.motion, actuator.drive, Tolerance()
    keys = ("moving_mass", "stiffness", "damping")
    update = {
        key: getattr(motion, key) * (1 + getattr(tolerance, key) * generator.standard_normal() / 2) for key in keys
    }
    ohm = actuator.coil_resistance() * (1 + tolerance.coil_resistance * generator.standard_normal() / 2)
    parts = {"motion": motion.model_copy(update=update), "drive": drive.model_copy(update={"coil_resistance": ohm})}
    return actuator.model_copy(update=parts)


def in_plane(belief: Belief) -> Belief:
    """The belief of a pair without what the stack's ends add to its mutual flux."""
    more, _ = MUTUAL_OF_SOLIDS[ECore]
    values = [
        replace(one, value=one.value / more, sigma=one.sigma / more) if one.effect == "mutual_inductance" else one
        for one in belief.values
    ]
    return replace(belief, values=tuple(values))


def record_of(true: Actuator, table: MagneticTable, effects: EffectValues | None, seed: int) -> Record:
    """Two runs of the true pair, as its instruments read them."""
    generator, runs = np.random.default_rng([seed, 18]), []
    for text in RUNS:
        one = parse_excitation(text, unit="V")
        run = refused_unless_borne(true, table, one, rate=RATE, effects=effects, generator=generator)
        runs.append(NamedRun(one.name.replace("-", "_"), one.spec, one.role, run))
    return simulation_record(true, runs)


def main(seed: int) -> None:
    """Prints verdict, causes and times of both beliefs."""
    servo = load_actuator(ROOT / "geometries" / "fast_tool_servo.toml")
    servo = servo.model_copy(update={"drive": servo.drive.model_copy(update={"kind": "voltage", "bandwidth": None})})
    pair = load_table(ROOT / "lookup_tables" / "fast_tool_servo_pair.nc")
    single = replace(pair, shared=None)
    generator = np.random.default_rng([seed, 17])
    true, belief = drawn(servo, generator), in_plane(as_designed(servo, single))
    print(belief.left_out)
    for value in belief.values:
        print(value.name, value.value, value.sigma)
    others: dict[str, dict[str, float]] = {}
    for one in belief.values:
        if one.effect != "mutual_inductance":  # that is the pair's table
            true_value = one.value + 0.5 * one.sigma * float(generator.standard_normal())
            others.setdefault(one.effect, {})[one.parameter] = true_value
    for name, of_model, effects in (("as designed", belief, EffectValues(others)), ("plain", PLAIN_BELIEF, None)):
        record = replace(record_of(true, pair, effects, seed), actuator=servo)
        began = time.process_time()
        found = diagnose(record, DiagnosisSettings(table=single, belief=of_model))
        print(f"{name}: {found.verdict} {found.names} ({time.process_time() - began:.0f} CPU s); {found.reason}")
        for cause in found.causes:
            for parameter, estimate in cause.parameters.items():
                own = next(one for one in belief.values if one.effect == cause.effect and one.parameter == parameter)
                off = 100 * (estimate.value / own.value - 1)
                interval = f"{estimate.low:.5f} ... {estimate.high:.5f}"
                print(f"  {parameter} {estimate.value:.5f} ({interval}); plane field {own.value:.5f}, {off:+.1f} %")
        for parameter, estimate in found.parameters.items():
            print(f"    {parameter} {estimate.value:.5g} {estimate.tolerances:+.2f}")
        print("  notes:", found.notes, flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 1)
