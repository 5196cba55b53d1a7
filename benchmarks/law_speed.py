"""Speed of the kernel with one law of a user's beside none, in one run and in lanes.

    python benchmarks/law_speed.py

prints a Markdown table: nanoseconds of one Runge-Kutta step, and the speed over that of the kernel with effects and no
law. The reference actuator and its stored table, a bias of 0.4 A and a sine of 0.05 A, 10 kHz, four steps a sample;
the best of five.
"""

import time
from pathlib import Path

import numpy as np

from msl_fem.actuator import load_actuator
from msl_fem.computing.laws import parse_expression
from msl_fem.plant import Inputs, kernel, layout, plant_parameters, surface_of
from msl_fem.plant.effects import EffectValues, declared
from msl_fem.plant.lane_block import LaneSettings
from msl_fem.plant.lane_run import run_lanes
from msl_fem.plant.preparation import effect_coefficients, start_effects
from msl_fem.table.magnetic_table import read_table

ROOT = Path(__file__).parent.parent
RATE, SUBSTEPS, SAMPLES, TRIALS = 1e4, 4, 20_000, 5
LAWS = {
    "-a v abs(v)": "law: force = -a*v*abs(v); a: 0..5000 N s2/m2",
    "a tanh(v/w) + a sin(x/p)": "law: force = a*tanh(v/w) + a*sin(x/p); a: 0..1 N; w: 1..2 mm/s; p: 0.1..0.2 mm",
    "voltage r i": "law: voltage = a*i; a: 0..1 ohm",
}
NONE = EffectValues({"coil_heating": {}})


def main() -> None:
    """Measures and prints."""
    actuator = load_actuator(ROOT / "geometries" / "fast_tool_servo.toml")
    plant, surface = plant_parameters(actuator), surface_of(read_table(ROOT / "lookup_tables" / "fast_tool_servo.nc"))
    sine = 0.4 + 0.05 * np.sin(0.05 * np.arange(SAMPLES))
    commands, push, step = np.column_stack([sine, np.full(SAMPLES, 0.4)]), np.zeros(SAMPLES), 1 / RATE / SUBSTEPS

    def alone(effects: EffectValues) -> float:
        e = effect_coefficients(plant, surface, effects, step=step, n_step=SUBSTEPS)
        state = layout.initial_state(plant, 0.4, 0.4, 0.0, 0.0)
        start_effects(surface, plant, e, state)
        out, begin = np.empty((SAMPLES, layout.N_OUT)), time.process_time()
        kernel.run(surface, plant, e, state, commands, push, step, SUBSTEPS, out, False)
        return (time.process_time() - begin) / SAMPLES / SUBSTEPS

    def lanes(effects: EffectValues) -> float:
        plants = [plant._replace(mass=plant.mass * (1 + 1e-4 * k)) for k in range(8)]
        vectors, starts = np.array([effects.vector()] * 8), np.array([0.4, 0.4, 0.0, 0.0])
        begin = time.process_time()
        settings = LaneSettings(effects=vectors, starts=starts)
        run_lanes(surface, plants, Inputs(commands, RATE), substeps=SUBSTEPS, settings=settings)
        return (time.process_time() - begin) / SAMPLES / SUBSTEPS / 8

    def best(measure: object, effects: EffectValues) -> float:
        assert callable(measure)
        return min(float(measure(effects)) for _ in range(TRIALS))

    print("| law | one run, ns | speed | a lane, ns | speed |\n| --- | --- | --- | --- | --- |")
    single, lane = best(alone, NONE), best(lanes, NONE)
    print(f"| none | {1e9 * single:.0f} | 1 | {1e9 * lane:.0f} | 1 |")
    for name, text in LAWS.items():
        with declared(parse_expression(text)):
            present = EffectValues({"expression:law": {"a": 0.5}})
            with_law, lane_with_law = best(alone, present), best(lanes, present)
        print(f"| {name} | {1e9 * with_law:.0f} | {single / with_law:.2f} | {1e9 * lane_with_law:.0f} "
              f"| {lane / lane_with_law:.2f} |")  # fmt: skip


if __name__ == "__main__":
    main()
