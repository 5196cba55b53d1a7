"""Effects that no catalogue has: a diagnosis that names one of its own for them is wrong."""

import math
from dataclasses import replace

import numpy as np

from msl_fem.bench.electrical_effects import AMPLIFIER_CROSSOVER
from msl_fem.bench.mechanical_effects import branches, damping_force, resonant_force, spring_force
from msl_fem.bench.rig import Rig
from msl_fem.bench.setting import Effect, Setting

Hidden = tuple[Rig, dict[str, float]]
CUSHION_TIME = 0.02  # s


def _cogging(setting: Setting, rig: Rig, force: float) -> Hidden:
    chance = setting.chance("cogging")
    period, phase = float(chance.uniform(0.8, 1.6)) * setting.scales.position, float(chance.uniform(0, 2 * math.pi))
    made = rig.plant.disturbance._replace(cogging=force, cogging_period=period, cogging_phase=phase)
    return rig.with_parts(disturbance=made), {"force": force, "period": period, "phase": phase}


def _quadratic_drag(setting: Setting, rig: Rig, force: float) -> Hidden:
    drag = force / setting.scales.velocity**2
    return rig.with_parts(disturbance=rig.plant.disturbance._replace(drag=drag)), {"drag": drag}


def _relaxing_cushion(setting: Setting, rig: Rig, force: float) -> Hidden:
    """A cushion that resists by the square of its compression and relaxes within 20 ms: neither spring nor creep."""
    flexure = branches(rig.plant.flexure, np.zeros(1), np.array([CUSHION_TIME]))
    made = rig.with_parts(flexure=flexure._replace(cushion=force / setting.scales.position**2))
    return made, {"force": force, "relaxation_time": CUSHION_TIME}


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
    Effect("relaxing_cushion", "force", "N", _relaxing_cushion, lambda s: 0.02 * resonant_force(s),
           lambda s: 20 * spring_force(s)),
    AMPLIFIER_CROSSOVER,
    Effect("current_product_force", "force", "N", _current_product_force, lambda s: 0.02 * resonant_force(s),
           lambda s: 5 * spring_force(s), needs_magnets=True),
    Effect("random_force", "rms", "N", _random_force, lambda s: 0.02 * resonant_force(s),
           lambda s: 10 * spring_force(s)),
    Effect("position_play", "half_width", "m", _position_play, lambda s: 0.01 * s.scales.position,
           lambda s: s.scales.position),
)  # fmt: skip
