"""The electrical effects of the catalogue."""

from dataclasses import replace

from msl_fem.bench.plant import Amplifier, Thermal
from msl_fem.bench.rig import Rig
from msl_fem.bench.setting import Effect, Setting, lag_to_start_with
from msl_fem.bench.thermal import COPPER_COEFFICIENT

Hidden = tuple[Rig, dict[str, float]]
_COIL_SHARE, _COIL_TIME, _CORE_TIME = 0.8, 0.25, 2.0  # of the whole thermal resistance; of the run's duration
_MEAN_RISE = 0.55  # a lower bound of the coil's mean rise in a run over the final one, with these times


def _coil_heating(setting: Setting, rig: Rig, rise: float) -> Hidden:
    """Thermal resistances such that the runs' mean loss would warm the coil by `rise` (K) in the end."""
    stretch = float(setting.chance("coil_heating").uniform(0.6, 1.2))
    whole = rise / setting.scales.copper_loss
    coil_time, core_time = stretch * _COIL_TIME * setting.scales.duration, _CORE_TIME * setting.scales.duration
    thermal = Thermal(_COIL_SHARE * whole, (1 - _COIL_SHARE) * whole, coil_time, core_time)
    said = {"final_rise": rise, "coil_to_core": thermal.coil_to_core, "core_to_air": thermal.core_to_air}
    return rig.with_parts(thermal=thermal), said | {"coil_time": coil_time, "core_time": core_time}


def _least_coil_heating(setting: Setting) -> float:
    """The final rise with which the resistance is six tolerances up in the mean of a run."""
    return 6 * setting.tolerance.coil_resistance / COPPER_COEFFICIENT / _MEAN_RISE


def _amplifier_bandwidth(setting: Setting, rig: Rig, lag: float) -> Hidden:
    """Second order with the mean lag asked for (s), and a slew limit that the largest steps of the command feel."""
    chance = setting.chance("amplifier_bandwidth")
    ratio = float(chance.uniform(0.6, 0.9))
    frequency = 2 * ratio / lag
    slew = float(chance.uniform(1.5, 3.0)) * frequency * setting.scales.step
    made = rig.with_parts(amplifier=rig.plant.amplifier._replace(frequency=frequency, damping_ratio=ratio, slew=slew))
    return made, {"lag": lag, "frequency_rad_per_s": frequency, "damping_ratio": ratio, "slew_limit": slew}


def _current_sensor_error(setting: Setting, rig: Rig, gain: float) -> Hidden:
    """A gain error and, of a third of its size, an offset."""
    chance = setting.chance("current_sensor_error")
    error, offset = gain * chance.choice([-1, 1]), 0.3 * gain * setting.scales.current * chance.choice([-1, 1])
    it = replace(rig.instruments, current_gain=1 + float(error), current_offset=float(offset))
    return replace(rig, instruments=it), {"gain_error": float(error), "offset": float(offset)}


def _amplifier_crossover(setting: Setting, rig: Rig, lost: float) -> Hidden:
    width = 0.2 * setting.scales.voltage
    amplifier: Amplifier = rig.plant.amplifier._replace(crossover=lost, crossover_width=width)
    return rig.with_parts(amplifier=amplifier), {"lost_voltage": lost, "width": width}


ELECTRICAL = (
    Effect("coil_heating", "final_rise", "K", _coil_heating, lambda s: 5.0, lambda s: 180.0, least=_least_coil_heating,
           needs_magnets=True),
    Effect("amplifier_bandwidth", "lag", "s", _amplifier_bandwidth, lag_to_start_with,
           lambda s: 100 / s.rate),
    Effect("current_sensor_error", "gain_error", "1", _current_sensor_error, lambda s: 0.01, lambda s: 0.5,
           needs_magnets=True),
)  # fmt: skip
AMPLIFIER_CROSSOVER = Effect(
    "amplifier_crossover", "lost_voltage", "V", _amplifier_crossover, lambda s: 0.02 * s.scales.voltage,
    lambda s: 0.15 * s.scales.voltage, needs_magnets=True,
)  # fmt: skip
