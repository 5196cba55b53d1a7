"""The mechanical and sensing effects, those outside the catalogue, all of them by name, and requests to hide some."""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from msl_fem.bench.electromagnetic_effects import AMPLIFIER_CROSSOVER, ELECTRICAL, MAGNETIC
from msl_fem.bench.equations import film_numbers
from msl_fem.bench.plant import MOST_BRANCHES, Array, Attached, Film, FlexureLaw, Friction, Support
from msl_fem.bench.rig import Rig
from msl_fem.bench.setting import BenchEffect, BenchSetting, RigWithEffect, lag_to_start_with
from msl_fem.bench.stray_effects import STRAY
from msl_fem.bench.thermal_effects import THERMAL
from msl_fem.bench.user_laws import effect_of_law
from msl_fem.computing.laws import LawExpression
from msl_fem.errors import InputError

STRETCH_LENGTH = 5e-3  # m: far above the range, so that the force goes with the cube of the displacement
HUMS = (50.0, 60.0)  # Hz
CUSHION_TIME = 0.02  # s
USUAL_SIZE = 0.03
MOST_HIDDEN = 3
_PERCENT = re.compile(r"\s*(\d+\.?\d*|\.\d+)\s*%\s*")


def spring(setting: BenchSetting) -> float:
    """N/m: the spring, or what moves the mass as the runs do where there is none."""
    motion, scales = setting.rig.plant.motion, setting.scales
    return motion.stiffness or motion.mass * (scales.velocity / max(scales.position, 1e-12)) ** 2


def spring_force(setting: BenchSetting) -> float:
    """N, at the RMS displacement."""
    return spring(setting) * setting.scales.position


def damping_force(setting: BenchSetting) -> float:
    """N, at the RMS velocity; of a damping ratio of 0.5 % where less is believed."""
    motion = setting.rig.plant.motion
    return max(motion.damping, 0.01 * math.sqrt(spring(setting) * motion.mass)) * setting.scales.velocity


def resonant_force(setting: BenchSetting) -> float:
    """N, between both: what moves a lightly damped mover about as far as the runs do."""
    return math.sqrt(spring_force(setting) * damping_force(setting))


def _stiffness_nonlinearity(setting: BenchSetting, rig: Rig, share: float) -> RigWithEffect:
    """The share of the spring's force at the RMS displacement that goes with its cube; three in ten springs soften."""
    sign = -1.0 if setting.generator("stiffness_nonlinearity").random() < 0.3 else 1.0
    cubic = sign * share * spring(setting) / setting.scales.position**2
    flexure = rig.plant.flexure._replace(stretch_stiffness=2 * cubic * STRETCH_LENGTH**2, stretch_length=STRETCH_LENGTH)
    return rig.with_parts(flexure=flexure), {"cubic": cubic, "share": sign * share}


def _coulomb_friction(setting: BenchSetting, rig: Rig, force: float) -> RigWithEffect:
    stick = float(setting.generator("coulomb_friction").uniform(1.1, 1.4))
    bristle = force / (0.05 * setting.scales.position)
    friction = Friction(
        coulomb=force,
        breakaway=stick * force,
        stribeck_velocity=0.1 * setting.scales.velocity,
        bristle_stiffness=bristle,
        bristle_damping=0.3 * math.sqrt(bristle * rig.plant.motion.mass),
    )
    return rig.with_parts(friction=friction), friction._asdict()


def _squeeze_film(setting: BenchSetting, rig: Rig, damping: float) -> RigWithEffect:
    gap = rig.plant.magnets.nominal_gap
    frequency = setting.scales.velocity / max(setting.scales.position, 1e-12)
    velocity = 4 * setting.scales.velocity
    numbers = film_numbers(setting.actuator, damping, gap=gap, velocity=velocity, frequency=3 * frequency)
    return rig.with_parts(film=Film(damping, gap)), {"damping_of_a_side": damping, "gap": gap, **numbers}


def _structural_mode(setting: BenchSetting, rig: Rig, share: float) -> RigWithEffect:
    generator = setting.generator("structural_mode")
    frequency = float(generator.uniform(2.0, 5.0)) * math.sqrt(spring(setting) / rig.plant.motion.mass)
    attached = Attached(share, frequency, float(generator.uniform(0.008, 0.02)))
    parameters = {"mass_share": share, "frequency_rad_per_s": frequency, "damping_ratio": attached.damping_ratio}
    return rig.with_parts(attached=attached), parameters


def branches(plant_flexure: FlexureLaw, stiffness: Array, times: Array) -> FlexureLaw:
    """The flexure with Maxwell branches of these stiffnesses (N/m) and relaxation times (s), beside those it has."""
    n = plant_flexure.branches
    total = n + len(times)
    assert total <= MOST_BRANCHES
    strength = plant_flexure.branch_stiffness.copy()
    strength[n:total] = stiffness
    rate = plant_flexure.branch_rate.copy()
    rate[n:total] = 1 / np.asarray(times)
    return plant_flexure._replace(branches=total, branch_stiffness=strength, branch_rate=rate)


def _flexure_relaxation(setting: BenchSetting, rig: Rig, share: float) -> RigWithEffect:
    """Two relaxation times, the main one between 20 and 200 ms: what creeps is never of one kind alone."""
    time = float(0.02 * 10 ** setting.generator("flexure_relaxation").random())
    stiffness = share * spring(setting) * np.array([0.85, 0.15])
    times = time * np.array([1.0, 8.0])
    changed = rig.with_parts(flexure=branches(rig.plant.flexure, stiffness, times))
    return changed, {"stiffness_share": share, "time": time, "second_time": 8 * time, "second_share": 0.15}


def _force_offset(setting: BenchSetting, rig: Rig, force: float) -> RigWithEffect:
    value = force * float(setting.generator("force_offset").choice([-1, 1]))
    motion = rig.plant.motion
    return rig.with_parts(motion=motion._replace(constant_force=motion.constant_force + value)), {"force": value}


def _support_compliance(setting: BenchSetting, rig: Rig, share: float) -> RigWithEffect:
    """A support as stiff as the spring over `share`, its resonance about ten times the mover's."""
    ratio = float(setting.generator("support_compliance").uniform(9.0, 14.0))
    frequency = ratio * math.sqrt(spring(setting) / rig.plant.motion.mass)
    stiffness = spring(setting) / share
    support = Support(stiffness / frequency**2, stiffness, 0.2 * stiffness / frequency)
    return rig.with_parts(support=support), {"compliance": 1 / stiffness, "frequency_rad_per_s": frequency}


MECHANICAL = (
    BenchEffect("stiffness_nonlinearity", "share", "1", _stiffness_nonlinearity, lambda s: 0.01, lambda s: 2.0),
    BenchEffect(
        "coulomb_friction",
        "force",
        "N",
        _coulomb_friction,
        lambda s: 0.02 * damping_force(s),
        lambda s: spring_force(s),
    ),
    BenchEffect(
        "squeeze_film",
        "damping_of_a_side",
        "N s/m",
        _squeeze_film,
        lambda s: 0.02 * max(s.rig.plant.motion.damping, 0.01 * math.sqrt(spring(s) * s.rig.plant.motion.mass)),
        lambda s: 2 * math.sqrt(spring(s) * s.rig.plant.motion.mass),
        needs_magnets=True,
    ),
    BenchEffect("structural_mode", "mass_share", "1", _structural_mode, lambda s: 0.05, lambda s: 0.7),
    BenchEffect("flexure_relaxation", "stiffness_share", "1", _flexure_relaxation, lambda s: 0.01, lambda s: 1.0),
    BenchEffect(
        "force_offset", "force", "N", _force_offset, lambda s: 0.01 * spring_force(s), lambda s: 2 * spring_force(s)
    ),
    BenchEffect(
        "support_compliance", "share", "1", _support_compliance, lambda s: 0.02, lambda s: 1.0, needs_magnets=True
    ),
)


def _position_sensor_nonlinearity(setting: BenchSetting, rig: Rig, share: float) -> RigWithEffect:
    """x/(1 - b x): an optical lever's curvature; `share` is b x at the RMS displacement."""
    curvature = (
        share / setting.scales.position * float(setting.generator("position_sensor_nonlinearity").choice([-1, 1]))
    )
    return rig.with_parts(reading=rig.plant.reading._replace(curvature=curvature)), {"curvature": curvature}


def _position_sensor_lag(setting: BenchSetting, rig: Rig, lag: float) -> RigWithEffect:
    """Two first-order lags in a row, of 0.7 and 0.3 of the whole."""
    lags = lag * np.array([0.7, 0.3])
    changed = rig.with_parts(reading=rig.plant.reading._replace(lags=lags))
    return changed, {"lag": lag, "first": float(lags[0]), "second": float(lags[1])}


def _time_delay(setting: BenchSetting, rig: Rig, delay: float) -> RigWithEffect:
    return replace(rig, delay=delay), {"delay": delay}


def _periodic_disturbance(setting: BenchSetting, rig: Rig, force: float) -> RigWithEffect:
    """A force at 50 or 60 Hz, or anywhere between 15 and 200 Hz, with a tenth of it at three times that."""
    generator = setting.generator("periodic_disturbance")
    any_other = float(15 * (200 / 15) ** generator.random())
    frequency = float(generator.choice([*HUMS, any_other]))
    phase = float(generator.uniform(0, 2 * math.pi))
    hum_frequency = 2 * math.pi * frequency
    changed = rig.plant.disturbance._replace(hum=force, hum_frequency=hum_frequency, hum_phase=phase, hum_third=0.1)
    return rig.with_parts(disturbance=changed), {"force": force, "frequency": frequency, "phase": phase}


def _sensor_drift(setting: BenchSetting, rig: Rig, drift: float) -> RigWithEffect:
    seed = int(setting.generator("sensor_drift").integers(2**31))
    errors = replace(rig.instruments, drift=drift, drift_seed=seed)
    return replace(rig, instruments=errors), {"rms": drift}


SENSING = (
    BenchEffect(
        "position_sensor_nonlinearity", "share", "1", _position_sensor_nonlinearity, lambda s: 0.01, lambda s: 0.2
    ),
    BenchEffect(
        "position_sensor_lag", "lag", "s", _position_sensor_lag, lambda s: 0.3 / s.rate, lambda s: 200 / s.rate
    ),
    BenchEffect("time_delay", "delay", "s", _time_delay, lag_to_start_with, lambda s: 100 / s.rate),
    BenchEffect(
        "periodic_disturbance",
        "force",
        "N",
        _periodic_disturbance,
        lambda s: 0.02 * resonant_force(s),
        lambda s: 10 * spring_force(s),
    ),
    BenchEffect(
        "sensor_drift", "rms", "m", _sensor_drift, lambda s: 0.01 * s.scales.position, lambda s: s.scales.position
    ),
)


def _cogging(setting: BenchSetting, rig: Rig, force: float) -> RigWithEffect:
    generator = setting.generator("cogging")
    period = float(generator.uniform(0.8, 1.6)) * setting.scales.position
    phase = float(generator.uniform(0, 2 * math.pi))
    changed = rig.plant.disturbance._replace(cogging=force, cogging_period=period, cogging_phase=phase)
    return rig.with_parts(disturbance=changed), {"force": force, "period": period, "phase": phase}


def _quadratic_drag(setting: BenchSetting, rig: Rig, force: float) -> RigWithEffect:
    drag = force / setting.scales.velocity**2
    return rig.with_parts(disturbance=rig.plant.disturbance._replace(drag=drag)), {"drag": drag}


def _relaxing_cushion(setting: BenchSetting, rig: Rig, force: float) -> RigWithEffect:
    """A cushion that resists by the square of its compression and relaxes within 20 ms: neither spring nor creep."""
    flexure = branches(rig.plant.flexure, np.zeros(1), np.array([CUSHION_TIME]))
    changed = rig.with_parts(flexure=flexure._replace(cushion=force / setting.scales.position**2))
    return changed, {"force": force, "relaxation_time": CUSHION_TIME}


def _current_product_force(setting: BenchSetting, rig: Rig, force: float) -> RigWithEffect:
    value = force / setting.scales.current**2 * float(setting.generator("current_product_force").choice([-1, 1]))
    return rig.with_parts(disturbance=rig.plant.disturbance._replace(product=value)), {"force_per_square_ampere": value}


def _random_force(setting: BenchSetting, rig: Rig, force: float) -> RigWithEffect:
    seed = int(setting.generator("random_force").integers(2**31))
    return replace(rig, random_force=force, random_force_seed=seed), {"rms": force}


def _position_play(setting: BenchSetting, rig: Rig, width: float) -> RigWithEffect:
    return replace(rig, instruments=replace(rig.instruments, play=width)), {"half_width": width}


OUTSIDE = (
    BenchEffect("cogging", "force", "N", _cogging, lambda s: 0.02 * resonant_force(s), lambda s: 5 * spring_force(s)),
    BenchEffect(
        "quadratic_drag",
        "force",
        "N",
        _quadratic_drag,
        lambda s: 0.01 * damping_force(s),
        lambda s: 2 * spring_force(s),
    ),
    BenchEffect(
        "relaxing_cushion",
        "force",
        "N",
        _relaxing_cushion,
        lambda s: 0.02 * resonant_force(s),
        lambda s: 20 * spring_force(s),
    ),
    AMPLIFIER_CROSSOVER,
    BenchEffect(
        "current_product_force",
        "force",
        "N",
        _current_product_force,
        lambda s: 0.02 * resonant_force(s),
        lambda s: 5 * spring_force(s),
        needs_magnets=True,
    ),
    BenchEffect(
        "random_force", "rms", "N", _random_force, lambda s: 0.02 * resonant_force(s), lambda s: 10 * spring_force(s)
    ),
    BenchEffect(
        "position_play",
        "half_width",
        "m",
        _position_play,
        lambda s: 0.01 * s.scales.position,
        lambda s: s.scales.position,
    ),
)


INSIDE = {effect.name: effect for effect in (*MAGNETIC, *STRAY, *ELECTRICAL, *THERMAL, *MECHANICAL, *SENSING)}
OUTSIDE_BY_NAME = {effect.name: effect for effect in OUTSIDE}


@dataclass(frozen=True)
class Request:
    """What is to be hidden: an effect (None: any one outside the catalogue) and its size (0.03: three per cent)."""

    effect: BenchEffect | None
    size: float


def parse_requests(texts: Sequence[str], causes: Sequence[LawExpression] = ()) -> tuple[Request, ...]:
    """The requests of texts "NAME=3%", "outside", "outside:NAME=2%" or "none"; without a size three per cent.
    `causes` are those that the user states, "expression:NAME".

    Raises
    ------
    InputError : an unknown effect, a size that is no percentage above 0, the same effect twice, more than three
    """
    asked = [text.strip() for text in texts if text.strip() != "none"]
    if len(asked) < len(texts) and asked:
        raise InputError("--hide none goes alone; leave the others out, or leave out none")
    if len(asked) > MOST_HIDDEN:
        raise InputError(f"--hide is given {len(asked)} times; at most {MOST_HIDDEN} effects are hidden together")
    known = INSIDE | {one.effect: effect_of_law(one) for one in causes}
    requests = tuple(_request(text, known) for text in asked)
    names = [request.effect.name if request.effect else "outside" for request in requests]
    if len(set(names)) < len(names):
        raise InputError(f"--hide {names[0]} is there twice; name each effect once")
    return requests


def _request(text: str, known: Mapping[str, BenchEffect]) -> Request:
    name, equals, size = (part.strip() for part in text.partition("="))
    if name in known:
        return Request(known[name], _percent(size, text) if equals else USUAL_SIZE)
    group, colon, inner = (part.strip() for part in name.partition(":"))
    percent = _percent(size, text) if equals else USUAL_SIZE
    if name == "outside":
        return Request(None, percent)
    if group == "outside" and colon:
        if inner not in OUTSIDE_BY_NAME:
            raise InputError(f"--hide {text}: '{inner}' is no effect outside; there are {', '.join(OUTSIDE_BY_NAME)}")
        return Request(OUTSIDE_BY_NAME[inner], percent)
    raise InputError(
        f"--hide {text}: '{name}' is no effect; there are {', '.join(known)}; none; and outside[:NAME] with "
        f"{', '.join(OUTSIDE_BY_NAME)}"
    )


def _percent(text: str, whole: str) -> float:
    match = _PERCENT.fullmatch(text)
    value = float(match.group(1)) / 100 if match else 0.0
    if not 0 < value <= 1:
        raise InputError(f"--hide {whole}: '{text}' is no size; give a percentage above 0 and up to 100, like 3%")
    return value
