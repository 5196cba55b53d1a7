"""Plants, inputs and sets of effects for the tests of the extended model."""

import numpy as np

from msl_fem.actuator import Actuator, parse_actuator
from msl_fem.plant.effects import EffectValues
from msl_fem.plant.excitation import Inputs

ALL_EFFECTS = EffectValues({
    "gap_offset": {"offset": 3e-6, "centring": 1e-6},
    "early_saturation": {"knee_shift": 0.02, "low_field_current": 0.01, "knee_excess": 0.01, "knee_current": 12.0},
    "fringing": {"growth": 20.0, "depth_error": 0.002, "turns_error": 0.001},
    "magnetic_hysteresis": {"coercive_current": 0.02, "spacing": 1.5, "fall": 0.3, "widening": 0.01, "broadening": 0.5},
    "eddy_currents": {"time_constant": 1e-4},
    "cross_coupling": {"share": 0.01},
    "armature_tilt": {"gap_variance": 4e-10},
    "leakage_inductance": {"share_1": 0.01, "share_2": 0.02, "halving_current": 3.0},
    "mutual_inductance": {"share": -0.02},
    "remanent_flux": {"current_1": 0.001, "current_2": -5e-4, "halving_current": 5.0},
    "coil_heating": {"rise_per_joule": 1e-3, "initial_rise": 0.01, "cooling_rate": 0.1},
    "thermal_history": {"rise_1": 0.01, "rise_2": 0.02, "core_rise": 0.005},
    "amplifier_bandwidth": {"lag": 1.3e-5, "delay_share": 0.2, "slew_time": 1e-5, "bandwidth_error": 0.05},
    "drive_limit": {"lost_share": 0.03, "limit": 0.4, "corner": 0.2},
    "current_sensor_error": {"gain_1": 0.01, "gain_2": -0.005, "offset_1": 0.01, "offset_2": 0.002},
    "stiffness_nonlinearity": {"cubic": 5e9, "quadratic": 3e6},
    "coulomb_friction": {"force": 0.1, "presliding": 5e-6},
    "squeeze_film": {"damping": 1.0},
    "structural_mode": {"mass_share": 0.02, "load_reading": 0.1},
    "flexure_relaxation": {"strength": 0.02, "slow_strength": 0.01, "time_constant": 0.05},
    "force_offset": {"force": 0.3},
    "support_compliance": {"compliance": 1e-8},
    "position_sensor_nonlinearity": {"gain_error": 0.01, "quadratic": 5.0, "cubic": 1e4},
    "position_sensor_lag": {"lag": 1e-5, "delay_share": 0.3},
    "position_sensor_crosstalk": {"per_current_1": 1e-7, "per_current_2": -2e-7, "lag": 1e-4},
    "time_delay": {"command": 1.37e-4, "position": 2.3e-5, "current": 1.1e-5},
    "periodic_disturbance": {
        "force_cosine": 0.1, "force_sine": 0.05, "third_cosine": 0.01, "third_sine": -0.02, "position_cosine": 1e-7,
        "current_sine": 5e-3,
    },
    "sensor_drift": {"offset": 1e-7, "rate": 1e-6, "acceleration": 1e-7, "jerk": 1e-7},
})  # fmt: skip


def effects(name: str, **parameters: float) -> EffectValues:
    """The values of one effect."""
    return EffectValues({name: parameters})


def rough(n: int, *, seed: int = 3, size: float = 0.05, sides: int = 2, level: float = 0.5) -> Inputs:
    """Currents that jump about `level` after a slow start, and a disturbance."""
    noise = np.random.default_rng(seed).standard_normal((n, 2))
    smooth = np.cumsum(noise, axis=0) / np.sqrt(np.arange(1, n + 1))[:, None]
    rise = np.minimum(np.arange(n) / 20, 1.0)[:, None]
    return Inputs((rise * (level + size * smooth))[:, :sides], 1e4, 3.0 * noise[:, 0])


def rig(**motion: str) -> Actuator:
    """A mass of 0.5 kg on a spring, moved by a force."""
    stated = {"moving_mass": "0.5 kg", "stiffness": "2000 N/m", "damping": "8 N s/m"} | motion
    return parse_actuator({"schema": 1, "name": "rig", "drive": {"kind": "force"}, "motion": stated})
