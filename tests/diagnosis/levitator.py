"""A ball under one coil, held by a controller, simulated with none of the package's equations or tables.

Inductance L(g) = L0 + K/(g + a) in closed form; the implicit midpoint rule in flux linkage and momentum, in steps of a
tenth of a sample. Voltages are the controller's, held between samples; readings have white noise.
"""

import math
from dataclasses import dataclass

import numpy as np

from msl_fem.actuator import Actuator
from msl_fem.record import Noise, Record, Run, Sampling
from msl_fem.table.magnetic_table import MagneticTable

L0, K, A = 0.05, 9.5e-4, 4e-3  # H, H m, m
MASS, RESISTANCE, WEIGHT, GAP = 0.0616, 4.17, 0.604, 14e-3
RATE, STEPS = 2e3, 10
POSITION_NOISE, CURRENT_NOISE = 5e-6, 1e-3
HELD = 4e-3  # m of position_m about which the reference moves


@dataclass(frozen=True)
class Truth:
    """Factors of what is believed, and what is hidden."""

    mass: float = 1.0
    resistance: float = 1.0
    inductance: float = 1.0
    friction: float = 0.0  # N
    drag: float = 0.0  # N s/m, of |v| v over 0.1 m/s


def table() -> MagneticTable:
    """The coil as it is believed."""
    gap, current = np.linspace(0.2e-3, 20e-3, 60), np.linspace(0.0, 2.5, 26)
    i, g = np.meshgrid(current, gap)
    inductance, first, second = L0 + K / (g + A), -K / (g + A) ** 2, 2 * K / (g + A) ** 3
    nodes = {
        "coenergy": inductance * i**2 / 2,
        "flux_linkage": inductance * i,
        "force": -first * i**2 / 2,
        "incremental_inductance": inductance,
        "force_current_slope": -first * i,
        "force_gap_slope": -second * i**2 / 2,
    }
    return MagneticTable(gap, current, nodes)


def actuator(base: Actuator) -> Actuator:
    """The rig in the actuator file's words, made of another one-sided rig in voltage drive."""
    motion = base.motion.model_copy(
        update={"moving_mass": MASS, "nominal_gap": GAP, "constant_force": -WEIGHT, "stiffness": 0.0, "damping": 0.0}
    )
    drive = base.drive.model_copy(update={"coil_resistance": RESISTANCE})
    return base.model_copy(update={"motion": motion, "drive": drive, "controller": None})


def record(base: Actuator, truth: Truth, *, seconds: float = 4.0, seed: int = 1) -> Record:
    """A fit run and a held-out run in closed loop."""
    runs = []
    for n, role in enumerate(("fit", "held-out")):
        columns = run(truth, round(seconds * RATE) // (n + 1), np.random.default_rng([seed, n]))
        runs.append(Run(f"loop_{n + 1}", "steps in closed loop", role, columns))
    noise = Noise(position=POSITION_NOISE, current=CURRENT_NOISE)
    return Record("simulated", actuator(base), sampling=Sampling(rate=RATE), noise=noise, runs=tuple(runs))


def run(truth: Truth, count: int, chance: np.random.Generator) -> dict[str, np.ndarray]:
    """Columns of a run."""
    steps = np.repeat(chance.uniform(-1e-3, 1e-3, count // 150 + 1), 150)[:count]
    reference = HELD + np.convolve(steps, np.ones(60) / 60, "same")
    noise = (chance.standard_normal((count, 2)) * [POSITION_NOISE, CURRENT_NOISE]).tolist()
    gap = GAP - HELD
    current = math.sqrt(2 * WEIGHT * (gap + A) ** 2 / K)
    flux = truth.inductance * (L0 + K / (gap + A)) * current
    x, v, total, slow, before = HELD, 0.0, 0.0, 0.0, HELD
    rows = np.empty((count, 4))
    for k, (aim_at, (position_noise, current_noise)) in enumerate(zip(reference.tolist(), noise, strict=True)):
        inductance = truth.inductance * (L0 + K / (GAP - x + A))
        read, read_current = x + position_noise, flux / inductance + current_noise
        slow += 0.3 * ((read - before) * RATE - slow)
        before = read
        error = aim_at - read
        total += error / RATE
        aim = current + 100 * error - 1.8 * slow + 300 * total
        voltage = RESISTANCE * aim + 40.0 * (aim - read_current)
        rows[k] = read, read_current, voltage, aim_at
        x, v, flux = _sample(truth, x, v, flux, voltage)
    names = ("position_m", "current_1_A", "voltage_1_V", "reference_m")
    return {"time_s": np.arange(count) / RATE, **dict(zip(names, rows.T, strict=True))}


def _sample(truth: Truth, x: float, v: float, flux: float, voltage: float) -> tuple[float, float, float]:
    h = 1 / (RATE * STEPS)
    mass, resistance = truth.mass * MASS, truth.resistance * RESISTANCE
    for _ in range(STEPS):
        xm, vm, fm = x, v, flux
        for _ in range(4):
            far = GAP - xm + A
            inductance = truth.inductance * (L0 + K / far)
            current = fm / inductance
            pull = truth.inductance * K / far**2 * current**2 / 2
            rub = truth.friction * vm / math.hypot(vm, 1e-3) + truth.drag * abs(vm) * vm / 0.1
            force, drop = pull - WEIGHT - rub, resistance * current
            xm, vm, fm = x + h / 2 * vm, v + h / 2 * force / mass, flux + h / 2 * (voltage - drop)
        x, v, flux = 2 * xm - x, 2 * vm - v, 2 * fm - flux
    return x, v, flux
