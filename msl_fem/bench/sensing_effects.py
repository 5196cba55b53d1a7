"""The catalogue's effects of sensing and timing."""

import math
from dataclasses import replace

import numpy as np

from msl_fem.bench.mechanical_effects import resonant_force, spring_force
from msl_fem.bench.rig import Rig
from msl_fem.bench.setting import Effect, Setting, lag_to_start_with

Hidden = tuple[Rig, dict[str, float]]
HUMS = (50.0, 60.0)  # Hz


def _position_sensor_nonlinearity(setting: Setting, rig: Rig, share: float) -> Hidden:
    """x/(1 - b x): an optical lever's curvature; `share` is b x at the RMS displacement."""
    curvature = share / setting.scales.position * float(setting.chance("position_sensor_nonlinearity").choice([-1, 1]))
    return rig.with_parts(reading=rig.plant.reading._replace(curvature=curvature)), {"curvature": curvature}


def _position_sensor_lag(setting: Setting, rig: Rig, lag: float) -> Hidden:
    """Two first-order lags in a row, of 0.7 and 0.3 of the whole."""
    lags = lag * np.array([0.7, 0.3])
    made = rig.with_parts(reading=rig.plant.reading._replace(lags=lags))
    return made, {"lag": lag, "first": float(lags[0]), "second": float(lags[1])}


def _time_delay(setting: Setting, rig: Rig, delay: float) -> Hidden:
    return replace(rig, delay=delay), {"delay": delay}


def _periodic_disturbance(setting: Setting, rig: Rig, force: float) -> Hidden:
    """A force at 50 or 60 Hz, or anywhere between 15 and 200 Hz, with a tenth of it at three times that."""
    chance = setting.chance("periodic_disturbance")
    any_other = float(15 * (200 / 15) ** chance.random())
    frequency = float(chance.choice([*HUMS, any_other]))
    phase = float(chance.uniform(0, 2 * math.pi))
    made = rig.plant.disturbance._replace(
        hum=force, hum_frequency=2 * math.pi * frequency, hum_phase=phase, hum_third=0.1
    )
    return rig.with_parts(disturbance=made), {"force": force, "frequency": frequency, "phase": phase}


def _sensor_drift(setting: Setting, rig: Rig, drift: float) -> Hidden:
    seed = int(setting.chance("sensor_drift").integers(2**31))
    it = replace(rig.instruments, drift=drift, drift_seed=seed)
    return replace(rig, instruments=it), {"rms": drift}


SENSING = (
    Effect("position_sensor_nonlinearity", "share", "1", _position_sensor_nonlinearity, lambda s: 0.01, lambda s: 0.2),
    Effect("position_sensor_lag", "lag", "s", _position_sensor_lag, lambda s: 0.3 / s.rate, lambda s: 200 / s.rate),
    Effect("time_delay", "delay", "s", _time_delay, lag_to_start_with,
           lambda s: 100 / s.rate),
    Effect("periodic_disturbance", "force", "N", _periodic_disturbance, lambda s: 0.02 * resonant_force(s),
           lambda s: 10 * spring_force(s)),
    Effect("sensor_drift", "rms", "m", _sensor_drift, lambda s: 0.01 * s.scales.position,
           lambda s: s.scales.position),
)  # fmt: skip
