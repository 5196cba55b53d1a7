"""Effects that no catalogue has: a diagnosis that names one of its own for them is wrong."""

import math
from dataclasses import replace

import numpy as np

from msl_fem.bench.electrical_effects import AMPLIFIER_CROSSOVER
from msl_fem.bench.mechanical_effects import branches, damping_force, resonant_force, spring, spring_force
from msl_fem.bench.plant import MOST_BRANCHES
from msl_fem.bench.rig import Rig
from msl_fem.bench.setting import Effect, Setting

Hidden = tuple[Rig, dict[str, float]]
MEMORY_EXPONENT = 0.3


def _cogging(setting: Setting, rig: Rig, force: float) -> Hidden:
    chance = setting.chance("cogging")
    period, phase = float(chance.uniform(0.8, 1.6)) * setting.scales.position, float(chance.uniform(0, 2 * math.pi))
    made = rig.plant.disturbance._replace(cogging=force, cogging_period=period, cogging_phase=phase)
    return rig.with_parts(disturbance=made), {"force": force, "period": period, "phase": phase}


def _quadratic_drag(setting: Setting, rig: Rig, force: float) -> Hidden:
    drag = force / setting.scales.velocity**2
    return rig.with_parts(disturbance=rig.plant.disturbance._replace(drag=drag)), {"drag": drag}


def _power_law_memory(setting: Setting, rig: Rig, share: float) -> Hidden:
    """A spring whose relaxation goes with t^-0.3 over four decades, as eight branches (Prony's series)."""
    times = np.geomspace(1e-3, 10.0, MOST_BRANCHES)
    weight = times**-MEMORY_EXPONENT
    strong = share * spring(setting) * weight / weight.sum()
    made = rig.with_parts(flexure=branches(rig.plant.flexure, strong, times))
    return made, {"stiffness_share": share, "exponent": MEMORY_EXPONENT}


def _current_product_force(setting: Setting, rig: Rig, force: float) -> Hidden:
    value = force / setting.scales.current**2 * float(setting.chance("current_product_force").choice([-1, 1]))
    return rig.with_parts(disturbance=rig.plant.disturbance._replace(product=value)), {"force_per_square_ampere": value}


def _random_force(setting: Setting, rig: Rig, force: float) -> Hidden:
    seed = int(setting.chance("random_force").integers(2**31))
    return replace(rig, random_force=force, random_force_seed=seed), {"rms": force}


def _position_play(setting: Setting, rig: Rig, width: float) -> Hidden:
    return replace(rig, instruments=replace(rig.instruments, play=width)), {"half_width": width}


OUTSIDE = (
    Effect("cogging", "force", "N", _cogging, lambda s: 0.02 * resonant_force(s), lambda s: 5 * spring_force(s)),
    Effect("quadratic_drag", "force", "N", _quadratic_drag, lambda s: 0.01 * damping_force(s),
           lambda s: 2 * spring_force(s)),
    Effect("power_law_memory", "stiffness_share", "1", _power_law_memory, lambda s: 0.01, lambda s: 1.0),
    AMPLIFIER_CROSSOVER,
    Effect("current_product_force", "force", "N", _current_product_force, lambda s: 0.02 * resonant_force(s),
           lambda s: 5 * spring_force(s), needs_magnets=True),
    Effect("random_force", "rms", "N", _random_force, lambda s: 0.02 * resonant_force(s),
           lambda s: 10 * spring_force(s)),
    Effect("position_play", "half_width", "m", _position_play, lambda s: 0.01 * s.scales.position,
           lambda s: s.scales.position),
)  # fmt: skip
