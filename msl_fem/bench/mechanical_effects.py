"""The mechanical effects of the catalogue."""

import math

import numpy as np

from msl_fem.bench.plant import MOST_BRANCHES, Array, Attached, Film, Flexure, Friction, Support
from msl_fem.bench.rig import Rig
from msl_fem.bench.setting import Effect, Setting
from msl_fem.bench.squeeze_film import film_numbers

Hidden = tuple[Rig, dict[str, float]]
STRETCH_LENGTH = 5e-3  # m: far above the range, so that the force goes with the cube of the displacement


def spring(setting: Setting) -> float:
    """N/m: the spring, or what moves the mass as the runs do where there is none."""
    motion, scales = setting.rig.plant.motion, setting.scales
    return motion.stiffness or motion.mass * (scales.velocity / max(scales.position, 1e-12)) ** 2


def spring_force(setting: Setting) -> float:
    """N, at the RMS displacement."""
    return spring(setting) * setting.scales.position


def damping_force(setting: Setting) -> float:
    """N, at the RMS velocity; of a damping ratio of 0.5 % where less is believed."""
    motion = setting.rig.plant.motion
    return max(motion.damping, 0.01 * math.sqrt(spring(setting) * motion.mass)) * setting.scales.velocity


def resonant_force(setting: Setting) -> float:
    """N, between both: what moves a lightly damped mover about as far as the runs do."""
    return math.sqrt(spring_force(setting) * damping_force(setting))


def _stiffness_nonlinearity(setting: Setting, rig: Rig, share: float) -> Hidden:
    """The share of the spring's force at the RMS displacement that goes with its cube; three in ten springs soften."""
    sign = -1.0 if setting.chance("stiffness_nonlinearity").random() < 0.3 else 1.0
    cubic = sign * share * spring(setting) / setting.scales.position**2
    flexure = rig.plant.flexure._replace(stretch_stiffness=2 * cubic * STRETCH_LENGTH**2, stretch_length=STRETCH_LENGTH)
    return rig.with_parts(flexure=flexure), {"cubic": cubic, "share": sign * share}


def _coulomb_friction(setting: Setting, rig: Rig, force: float) -> Hidden:
    stick = float(setting.chance("coulomb_friction").uniform(1.1, 1.4))
    bristle = force / (0.05 * setting.scales.position)
    made = Friction(
        force, stick * force, 0.1 * setting.scales.velocity, bristle, 0.3 * math.sqrt(bristle * rig.plant.motion.mass)
    )
    return rig.with_parts(friction=made), made._asdict()


def _squeeze_film(setting: Setting, rig: Rig, damping: float) -> Hidden:
    gap = rig.plant.magnets.nominal_gap
    frequency = setting.scales.velocity / max(setting.scales.position, 1e-12)
    numbers = film_numbers(
        setting.actuator, damping, gap=gap, velocity=4 * setting.scales.velocity, frequency=3 * frequency
    )
    return rig.with_parts(film=Film(damping, gap)), {"damping_of_a_side": damping, "gap": gap, **numbers}


def _structural_mode(setting: Setting, rig: Rig, share: float) -> Hidden:
    chance = setting.chance("structural_mode")
    frequency = float(chance.uniform(2.0, 5.0)) * math.sqrt(spring(setting) / rig.plant.motion.mass)
    made = Attached(share, frequency, float(chance.uniform(0.008, 0.02)))
    return rig.with_parts(attached=made), {"mass_share": share, "frequency_rad_per_s": frequency} | {
        "damping_ratio": made.damping_ratio
    }


def branches(plant_flexure: Flexure, stiffness: Array, times: Array) -> Flexure:
    """The flexure with Maxwell branches of these stiffnesses (N/m) and relaxation times (s), beside those it has."""
    n = plant_flexure.branches
    total = n + len(times)
    assert total <= MOST_BRANCHES
    strong, fast = plant_flexure.branch_stiffness.copy(), plant_flexure.branch_rate.copy()
    strong[n:total], fast[n:total] = stiffness, 1 / np.asarray(times)
    return plant_flexure._replace(branches=total, branch_stiffness=strong, branch_rate=fast)


def _flexure_relaxation(setting: Setting, rig: Rig, share: float) -> Hidden:
    """Two relaxation times, the main one between 20 and 200 ms: what creeps is never of one kind alone."""
    time = float(0.02 * 10 ** setting.chance("flexure_relaxation").random())
    strong, times = share * spring(setting) * np.array([0.85, 0.15]), time * np.array([1.0, 8.0])
    made = rig.with_parts(flexure=branches(rig.plant.flexure, strong, times))
    return made, {"stiffness_share": share, "time": time, "second_time": 8 * time, "second_share": 0.15}


def _force_offset(setting: Setting, rig: Rig, force: float) -> Hidden:
    value = force * float(setting.chance("force_offset").choice([-1, 1]))
    motion = rig.plant.motion
    return rig.with_parts(motion=motion._replace(constant_force=motion.constant_force + value)), {"force": value}


def _support_compliance(setting: Setting, rig: Rig, share: float) -> Hidden:
    """A support as stiff as the spring over `share`, its resonance about ten times the mover's."""
    frequency = float(setting.chance("support_compliance").uniform(9.0, 14.0)) * math.sqrt(
        spring(setting) / rig.plant.motion.mass
    )
    stiffness = spring(setting) / share
    made = Support(stiffness / frequency**2, stiffness, 0.2 * stiffness / frequency)
    return rig.with_parts(support=made), {"compliance": 1 / stiffness, "frequency_rad_per_s": frequency}


MECHANICAL = (
    Effect("stiffness_nonlinearity", "share", "1", _stiffness_nonlinearity, lambda s: 0.01, lambda s: 2.0),
    Effect("coulomb_friction", "force", "N", _coulomb_friction, lambda s: 0.02 * damping_force(s),
           lambda s: spring_force(s)),
    Effect("squeeze_film", "damping_of_a_side", "N s/m", _squeeze_film,
           lambda s: 0.02 * max(s.rig.plant.motion.damping, 0.01 * math.sqrt(spring(s) * s.rig.plant.motion.mass)),
           lambda s: 2 * math.sqrt(spring(s) * s.rig.plant.motion.mass), needs_magnets=True),
    Effect("structural_mode", "mass_share", "1", _structural_mode, lambda s: 0.05, lambda s: 0.7),
    Effect("flexure_relaxation", "stiffness_share", "1", _flexure_relaxation, lambda s: 0.01, lambda s: 1.0),
    Effect("force_offset", "force", "N", _force_offset, lambda s: 0.01 * spring_force(s),
           lambda s: 2 * spring_force(s)),
    Effect("support_compliance", "share", "1", _support_compliance, lambda s: 0.02, lambda s: 1.0,
           needs_magnets=True),
)  # fmt: skip
