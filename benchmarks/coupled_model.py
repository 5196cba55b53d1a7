"""Speed of the coupled model on one core: plain, with every effect, in lanes, beside SciPy's solve_ivp.

    python benchmarks/coupled_model.py

prints a Markdown table and what the compilation took. The reference actuator, its stored table, band-limited noise of
0.6 A +- 0.1 A RMS on both sides, 10 kHz; a step is one Runge-Kutta step of 10 us. solve_ivp (RK45) runs the same
equations as a user writes them down, with SciPy's interpolation of the table's force, flux slopes and inductance, at
the tolerance that gives it the kernel's accuracy or less; its time is put over the steps of the kernel for the same
piece of time.
"""

import time
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp
from scipy.interpolate import RegularGridInterpolator

from msl_fem.actuator import load_actuator
from msl_fem.plant import PlantParameters, Surface, kernel, layout, plant_parameters, surface_of
from msl_fem.plant.effects import CATALOGUE, EffectValues
from msl_fem.plant.excitation import Inputs, excitation_inputs, parse_excitation
from msl_fem.plant.lane_block import LaneSettings
from msl_fem.plant.lane_run import run_lanes
from msl_fem.plant.layout import initial_state
from msl_fem.plant.preparation import effect_coefficients, start_effects
from msl_fem.table.magnetic_table import MagneticTable, read_table

ROOT = Path(__file__).parent.parent
RATE, SUBSTEPS = 1e4, 10
SPEC = "band-limited-noise:channel=independent,band=500 Hz,bias=0.6 A,amplitude=0.1 A,duration={} s,seed=1"
ALL_EFFECTS = EffectValues(
    {
        effect.name: {
            p.name: p.neutral if p.shape else min(p.scale, 1e-4 if p.unit == "s" else p.scale)
            for p in effect.parameters
        }
        for effect in CATALOGUE.values()
    }
)


def best_of(work, *, times: int = 5) -> tuple[float, float]:
    """(seconds of the first call, which compiles, least seconds of the others)."""
    taken = []
    for _ in range(times + 1):
        start = time.perf_counter()
        work()
        taken.append(time.perf_counter() - start)
    return taken[0], min(taken[1:])


def single(surface: Surface, plant: PlantParameters, inputs: Inputs, effects: EffectValues | None):
    """A function that does one run."""
    step = 1 / (RATE * SUBSTEPS)
    e = None if effects is None else effect_coefficients(plant, surface, effects, step=step, n_step=SUBSTEPS)
    commands, push = inputs.for_sides(2), np.zeros(inputs.time.size)
    out = np.empty((commands.shape[0], layout.N_OUT))

    def work() -> np.ndarray:
        state = initial_state(plant, 0.0, 0.0, 0.0, 0.0)
        if e is not None:
            start_effects(surface, plant, e, state)
        status, done = kernel.run(surface, plant, e, state, commands, push, step, SUBSTEPS, out, False)
        assert (status, done) == (0, commands.shape[0])
        return out

    return work


def lanes(surface: Surface, plant: PlantParameters, inputs: Inputs, effects: EffectValues | None, n_lane: int):
    """A function that does n_lane runs together, each with another mass."""
    plants = [plant._replace(mass=plant.mass * (1 + 2e-5 * k)) for k in range(n_lane)]
    vectors = None if effects is None else np.tile(effects.vector(), (n_lane, 1))

    def work() -> None:
        run = run_lanes(surface, plants, inputs, substeps=SUBSTEPS, settings=LaneSettings(effects=vectors))
        assert (run.done == inputs.time.size).all()

    return work


def by_scipy(plant: PlantParameters, table: MagneticTable, inputs: Inputs):
    """A function that does one run by solve_ivp, sample by sample."""
    names = ("force", "incremental_inductance", "force_current_slope")
    maps = RegularGridInterpolator(
        (table.gap, table.current), np.stack([table.nodes[n] for n in names], axis=-1), method="linear"
    )
    n = plant.magnets

    def rate(_t: float, y: np.ndarray, command: np.ndarray) -> list[float]:
        i, x, v = y[:2], y[2], y[3]
        found = n * maps(np.column_stack([[plant.nominal_gap - x, plant.nominal_gap + x], np.abs(i)]))
        slope = plant.bandwidth * (command - i)
        back = found[:, 2] * np.array([v, -v])
        voltage = plant.resistance * i + back + found[:, 1] * slope
        limited = np.clip(voltage, -plant.voltage_limit, plant.voltage_limit)
        slope = np.where(voltage == limited, slope, (limited - plant.resistance * i - back) / found[:, 1])
        force = found[0, 0] - found[1, 0]
        return [*slope, v, (force - plant.damping * v - plant.stiffness * x) / plant.mass]

    def work() -> np.ndarray:
        y, rows = np.zeros(4), []
        for k, command in enumerate(inputs.commands):
            rows.append(y)
            span = (k / RATE, (k + 1) / RATE)
            y = solve_ivp(rate, span, y, args=(command,), rtol=1e-6, atol=[1e-7, 1e-7, 1e-11, 1e-8]).y[:, -1]
        return np.array(rows)

    return work


def main() -> None:
    """The table of the README."""
    actuator = load_actuator(ROOT / "geometries" / "fast_tool_servo.toml")
    table = read_table(ROOT / "lookup_tables" / "fast_tool_servo.nc")
    plant, surface = plant_parameters(actuator), surface_of(table)
    inputs = excitation_inputs(actuator, parse_excitation(SPEC.format(1)), rate=RATE)
    short = excitation_inputs(actuator, parse_excitation(SPEC.format(0.1)), rate=RATE)
    steps = inputs.time.size * SUBSTEPS
    cases = {
        "plain model": (single(surface, plant, inputs, None), steps),
        "all 22 effects": (single(surface, plant, inputs, ALL_EFFECTS), steps),
        "64 lanes, plain": (lanes(surface, plant, inputs, None, 64), 64 * steps),
        "64 lanes, all effects": (lanes(surface, plant, inputs, ALL_EFFECTS, 64), 64 * steps),
    }
    slow = by_scipy(plant, table, short)
    start = time.perf_counter()
    slow()
    scipy_rate = short.time.size * SUBSTEPS / (time.perf_counter() - start)
    print("| coupled model, one core | steps a second | over solve_ivp | first call, compiled or from the cache |")
    print("|---|---|---|---|")
    for name, (work, count) in cases.items():
        first, best = best_of(work)
        print(f"| {name} | {count / best:.2g} | {count / best / scipy_rate:.3g} | {first - best:.1f} s |")
    print(f"| solve_ivp, RegularGridInterpolator | {scipy_rate:.2g} | 1 | - |")


if __name__ == "__main__":
    main()
