"""Steps a second of the coupled model on the table of a pair, over those on the table of one magnet, alternated.

The reference actuator with a stiffer spring, so that every drive stays inside the table. Run: python
benchmarks/pair_model.py.
"""

import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from msl_fem.actuator import load_actuator
from msl_fem.plant import kernel, layout
from msl_fem.plant.effects import kernel_coefficients, neutral_vector
from msl_fem.plant.energy import energy_audit
from msl_fem.plant.plant import VOLTAGE_DRIVE, PlantParameters, Surface, plant_parameters, surface_of
from msl_fem.plant.preparation import small_signal_inductance
from msl_fem.table.pair_table import load_table

ROOT = Path(__file__).parents[1]
RATE, N_STEP, FINE, SAMPLES, ROUNDS = 1e4, 8, 24, 2000, 21


def once(
    surface: Surface, plant: PlantParameters, effects: np.ndarray | None, n_step: int = N_STEP
) -> tuple[float, float]:
    """(CPU seconds, imbalance of the energies) of a run with so many steps a sample."""
    t = np.arange(SAMPLES) / RATE
    commands = np.column_stack([1.0 + 0.5 * np.sin(2 * np.pi * 60 * t), 1.0 + 0.5 * np.cos(2 * np.pi * 47 * t)])
    if plant.drive == VOLTAGE_DRIVE:
        commands = plant.resistance * commands
    state = layout.initial_state(plant, 1.0, 1.0, 0.0, 0.0)
    start, out = state.copy(), np.empty((SAMPLES, layout.N_OUT))
    began = time.process_time()
    status, done = kernel.run(
        surface, plant, effects, state, commands, np.zeros(SAMPLES), 1 / (RATE * n_step), n_step, out, False
    )
    spent = time.process_time() - began
    assert (status, done) == (layout.OK, SAMPLES)
    return spent, energy_audit(surface, plant, effects, start=start, end=state).imbalance


def main() -> None:
    pair = load_table(ROOT / "lookup_tables/fast_tool_servo_pair.nc")
    both, alone = surface_of(pair), surface_of(replace(pair, shared=None))
    plant = plant_parameters(load_actuator(ROOT / "geometries/fast_tool_servo.toml"))
    plant = plant._replace(stiffness=2e6, damping=150.0)
    neutral = neutral_vector()
    inductance = small_signal_inductance(plant, alone)
    effects = kernel_coefficients(plant, neutral, inductance=inductance, step=1 / (RATE * N_STEP), n_step=N_STEP)
    cases = {
        "current drive": (plant, None),
        "voltage drive": (plant._replace(drive=VOLTAGE_DRIVE, bandwidth=np.inf), None),
        "current drive, all effects": (plant, effects),
    }
    for name, (built, coefficients) in cases.items():
        spent: list[list[float]] = [[], []]
        for _ in range(ROUNDS):
            for k, surface in enumerate((alone, both)):
                spent[k].append(once(surface, built, coefficients)[0])
        steps = [SAMPLES * N_STEP / np.median(values) for values in spent]
        imbalance, finer = (once(both, built, coefficients, n)[1] for n in (N_STEP, FINE))
        print(
            f"{name}: {steps[0]:.2e} steps/s on one magnet's, {steps[1]:.2e} on the pair's table, ratio "
            f"{steps[1] / steps[0]:.2f}; energies {imbalance:.1e} at {N_STEP} steps a sample, {finer:.1e} at {FINE}"
        )


if __name__ == "__main__":
    main()
