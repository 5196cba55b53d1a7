"""The magnetic and the electrical effects of the catalogue."""

from dataclasses import replace

import numpy as np

from msl_fem.actuator import Actuator, ECore, MagnetKind
from msl_fem.bench.equations import COPPER_COEFFICIENT
from msl_fem.bench.iron import fastest_ladder_rate
from msl_fem.bench.plant import IRON_NODES, Amplifier, Hysteresis, Ladder, SeriesIron, Thermal
from msl_fem.bench.rig import Factor, Rig, averaged, multiplied
from msl_fem.bench.setting import BenchEffect, BenchSetting, RigWithEffect, lag_to_start_with
from msl_fem.errors import InputError
from msl_fem.magnetics.kinds.kind import PlaneMagnet
from msl_fem.materials.constants import MU_0
from msl_fem.materials.material import AnalyticIron, Iron, laminated, load_iron

SHEET_CONDUCTIVITY = 2.2e6  # S/m: iron with 2 to 3 % silicon (Bozorth, Ferromagnetism, 1951, ch. 4)
MOST_STAGES = 40
_STRIPS = np.polynomial.legendre.leggauss(9)  # of a face: places from -1 to 1, weights
_COIL_SHARE, _COIL_TIME, _CORE_TIME = 0.8, 0.25, 2.0  # of the whole thermal resistance; of the run's duration
_MEAN_RISE = 0.55  # a lower bound of the coil's mean rise in a run over the final one, with these times


def _gap_offset(setting: BenchSetting, rig: Rig, offset: float) -> RigWithEffect:
    """The gaps of both sides are off, away from the believed one as the true one already is."""
    magnets = rig.plant.magnets
    believed = setting.actuator.motion.nominal_gap if setting.actuator.motion else None
    sign = 1.0 if magnets.nominal_gap >= (believed or 0.0) else -1.0
    changed = rig.with_parts(magnets=magnets._replace(nominal_gap=magnets.nominal_gap + sign * offset))
    return changed, {"offset": sign * offset}


def _least_gap_offset(setting: BenchSetting) -> float:
    assert setting.actuator.motion is not None
    return 6 * setting.tolerance.nominal_gap * float(setting.actuator.motion.nominal_gap or 0.0)


def iron_path(actuator: Actuator) -> tuple[tuple[float, float, Iron | AnalyticIron], ...]:
    """(length m, section m2, iron) of the parts of a magnet's flux path, the sections counted for the whole flux.

    Raises
    ------
    InputError : the magnet's dimensions are not known
    """
    m = actuator.magnet
    if not isinstance(m, MagnetKind) or m.circuit is None:
        raise InputError(
            f"{actuator.name}: this effect is made from the lengths and areas of the flux path in the iron, which this "
            "magnet does not state; hide another one, or describe the magnet by its dimensions"
        )
    core = laminated(load_iron(m.iron.core, folder=actuator.folder), m.iron.core_stacking)
    armature = laminated(load_iron(m.iron.armature, folder=actuator.folder), m.iron.armature_stacking)
    if not isinstance(m, ECore):
        irons = {"core": core, "armature": armature}
        return tuple((part.length, part.area, irons[part.region]) for part in m.circuit.parts)
    leg = m.window_height + m.yoke_thickness / 2
    across = m.window_width + (m.centre_leg_width + m.outer_leg_width) / 2
    return (
        (leg, m.centre_leg_width * m.stack_depth, core),
        (across, 2 * m.yoke_thickness * m.stack_depth, core),
        (leg, 2 * m.outer_leg_width * m.stack_depth, core),
        (across, 2 * m.armature_thickness * m.stack_depth, armature),
    )


def _states_its_path(actuator: Actuator) -> bool:
    return isinstance(actuator.magnet, MagnetKind) and actuator.magnet.circuit is not None


def _linked_turns(setting: BenchSetting) -> tuple[float, float]:
    """(side's flux linkage over a magnet's flux, magneto-motive force of a magnet over the side's current)."""
    magnets = setting.rig.plant.magnets
    assert isinstance(setting.actuator.magnet, MagnetKind)
    turns = float(setting.actuator.magnet.turns)
    return magnets.per_side * magnets.share * turns, turns * magnets.share


def _early_saturation(setting: BenchSetting, rig: Rig, crowding: float) -> RigWithEffect:
    """The flux density in the iron is higher than believed, by `crowding`: fewer or damaged sheets carry it."""
    path = iron_path(setting.actuator)
    per_flux, per_current = _linked_turns(setting)
    narrowest = min(section for _, section, _ in path)
    flux = np.linspace(0.0, 2.0 * narrowest, IRON_NODES)  # of a magnet, up to 2 T in its narrowest part
    force, slope = np.zeros(IRON_NODES), np.zeros(IRON_NODES)
    for length, section, iron in path:
        more = (1 + crowding) * flux / section
        (h, dh) = iron.magnetise(more)
        (h0, dh0) = iron.magnetise(flux / section)
        force += length * (h - h0)
        slope += length / section * ((1 + crowding) * dh - dh0)
    step = per_flux * float(flux[1])
    changed = rig.with_parts(series_iron=SeriesIron(step, force / per_current, slope / per_current / per_flux))
    return changed, {"flux_crowding": crowding, "effective_stacking_factor": 1 / (1 + crowding)}


def _fringing(setting: BenchSetting, rig: Rig, strength: float) -> RigWithEffect:
    """Coenergy times 1 + 2 k e(g)/depth, e = (g/pi)(1 + ln(1 + pi h/(2 g))) at either end of the stack.

    e is the widening of a gap's cross-section by the field beside an edge whose faces go back by h (Balakrishnan,
    Joines and Wilson, IEEE Trans. Power Electron. 12, 1997); k = 1 is an end face like the inner ones.
    """
    assert rig.table is not None
    m = setting.actuator.magnet
    g = rig.table.gap[:, None]
    nominal = rig.plant.magnets.nominal_gap
    depth, height = (m.stack_depth, m.window_height) if isinstance(m, PlaneMagnet) else (30 * nominal, 30 * nominal)
    a, b = 2 * strength / (np.pi * depth), np.pi * height / 2
    log, across = np.log1p(b / g), g + b  # d/dg of ln(1 + b/g) = 1/(g + b) - 1/g
    rise = log + g / across  # d/dg of g (1 + ln(1 + b/g))
    curve = 1 / across - 1 / g + b / across**2
    changed = multiplied(rig.table, Factor(1 + a * g * (1 + log), over_gap=a * rise, over_gap_twice=a * curve))
    more = float(a * nominal * (1 + np.log1p(b / nominal)))
    return replace(rig, table=changed), {"strength": strength, "flux_at_nominal_gap": more}


def _magnetic_hysteresis(setting: BenchSetting, rig: Rig, amplitude: float) -> RigWithEffect:
    spread = float(setting.generator("magnetic_hysteresis").uniform(0.1, 0.2))
    scale = spread * setting.scales.flux_linkage
    changed = rig.with_parts(hysteresis=Hysteresis(amplitude, scale, 4.0))
    return changed, {"pinned_current": amplitude, "flux_scale": scale}


def _iron_inductance(setting: BenchSetting) -> float:
    """Inductance in H that a side's iron alone would have at the runs' flux; for unknown iron 50 times the whole."""
    if not _states_its_path(setting.actuator):
        magnets = setting.rig.plant.magnets
        assert setting.rig.table is not None
        whole = setting.rig.table.evaluate(0.0, magnets.nominal_gap)["incremental_inductance"]
        return 50 * magnets.per_side * magnets.share**2 * float(whole)
    per_flux, per_current = _linked_turns(setting)
    flux = np.array(setting.scales.flux_linkage / per_flux)
    path = iron_path(setting.actuator)
    reluctance = sum(length / section * float(iron.magnetise(flux / section)[1]) for length, section, iron in path)
    return per_flux * per_current / reluctance


def _mean_slope(setting: BenchSetting) -> float:
    """dB/dH of the core in H/m at the runs' flux; 2000 mu_0 for unknown iron."""
    if not _states_its_path(setting.actuator):
        return 2000 * MU_0
    _, section, iron = iron_path(setting.actuator)[0]
    flux = setting.scales.flux_linkage / _linked_turns(setting)[0]
    return 1 / float(iron.magnetise(np.array(flux / section))[1])


def _eddy_currents(setting: BenchSetting, rig: Rig, diffusion_time: float) -> RigWithEffect:
    """Sheets as thick as the diffusion time says: T = mu sigma d^2/4, and G/T = 1/(3 L) with L of the iron alone."""
    conductance = diffusion_time / (3 * _iron_inductance(setting))
    ladder = Ladder(MOST_STAGES, conductance, diffusion_time)
    while ladder.stages > 1 and fastest_ladder_rate(ladder) > 20 * setting.rate:
        ladder = ladder._replace(stages=ladder.stages - 1)
    thickness = 2 * np.sqrt(diffusion_time / (_mean_slope(setting) * SHEET_CONDUCTIVITY))
    parameters = {"diffusion_time": diffusion_time, "conductance": conductance, "sheet_thickness": float(thickness)}
    return rig.with_parts(ladder=ladder), parameters


def _start_of_eddy_currents(setting: BenchSetting) -> float:
    conductance = 0.01 * setting.scales.current / setting.scales.flux_rate
    return float(conductance * 3 * _iron_inductance(setting))


def _cross_coupling(setting: BenchSetting, rig: Rig, share: float) -> RigWithEffect:
    """A share of the current answers to the other side's flux in the armature; it adds where the fluxes do."""
    aiding = setting.actuator.sides is not None and setting.actuator.sides.polarity == "aiding"
    value = (1.0 if aiding else -1.0) * share * setting.scales.current / setting.scales.flux_linkage
    return rig.with_parts(coupling=value), {"share": share, "current_per_flux_linkage": value}


def _armature_tilt(setting: BenchSetting, rig: Rig, edge: float) -> RigWithEffect:
    """Gaps that differ by up to `edge` (m) to either side of the middle, averaged over the faces."""
    assert rig.table is not None
    changed = averaged(rig.table, list(edge * _STRIPS[0]), list(_STRIPS[1] / 2))
    return replace(rig, table=changed), {"gap_at_the_edge": edge}


def _gap(setting: BenchSetting) -> float:
    return setting.rig.plant.magnets.nominal_gap


def _room(setting: BenchSetting) -> float:
    """How much smaller than the table's largest and larger than its smallest gap all gaps of the runs stay, m."""
    assert setting.table is not None
    reach = max(float(np.abs(response.position).max()) for response in setting.responses)
    gap = _gap(setting)
    return max(min(gap - 1.1 * reach - setting.table.gap[0], setting.table.gap[-1] - gap - 1.1 * reach), 0.02 * gap)


MAGNETIC = (
    BenchEffect(
        "gap_offset",
        "offset",
        "m",
        _gap_offset,
        lambda s: 0.01 * _gap(s),
        _room,
        least=_least_gap_offset,
        needs_magnets=True,
    ),
    BenchEffect(
        "early_saturation", "flux_crowding", "1", _early_saturation, lambda s: 0.5, lambda s: 5.0, needs_magnets=True
    ),
    BenchEffect("fringing", "strength", "1", _fringing, lambda s: 0.2, lambda s: 5.0, needs_magnets=True),
    BenchEffect(
        "magnetic_hysteresis",
        "pinned_current",
        "A",
        _magnetic_hysteresis,
        lambda s: 0.02 * s.scales.current,
        lambda s: 0.5 * s.scales.current,
        needs_magnets=True,
    ),
    BenchEffect(
        "eddy_currents",
        "diffusion_time",
        "s",
        _eddy_currents,
        _start_of_eddy_currents,
        lambda s: 50 * _start_of_eddy_currents(s),
        needs_magnets=True,
    ),
    BenchEffect("cross_coupling", "share", "1", _cross_coupling, lambda s: 0.01, lambda s: 0.3, needs_magnets=True),
    BenchEffect(
        "armature_tilt", "gap_at_the_edge", "m", _armature_tilt, lambda s: 0.1 * _gap(s), _room, needs_magnets=True
    ),
)


def _coil_heating(setting: BenchSetting, rig: Rig, rise: float) -> RigWithEffect:
    """Thermal resistances such that the runs' mean loss would warm the coil by `rise` (K) in the end."""
    stretch = float(setting.generator("coil_heating").uniform(0.6, 1.2))
    whole = rise / setting.scales.copper_loss
    coil_time = stretch * _COIL_TIME * setting.scales.duration
    core_time = _CORE_TIME * setting.scales.duration
    thermal = Thermal(_COIL_SHARE * whole, (1 - _COIL_SHARE) * whole, coil_time, core_time)
    parameters = {"final_rise": rise, "coil_to_core": thermal.coil_to_core, "core_to_air": thermal.core_to_air}
    return rig.with_parts(thermal=thermal), parameters | {"coil_time": coil_time, "core_time": core_time}


def _least_coil_heating(setting: BenchSetting) -> float:
    """The final rise with which the resistance is six tolerances up in the mean of a run."""
    return 6 * setting.tolerance.coil_resistance / COPPER_COEFFICIENT / _MEAN_RISE


def _amplifier_bandwidth(setting: BenchSetting, rig: Rig, lag: float) -> RigWithEffect:
    """Second order with the mean lag asked for (s), and a slew limit that the largest steps of the command feel."""
    generator = setting.generator("amplifier_bandwidth")
    ratio = float(generator.uniform(0.6, 0.9))
    frequency = 2 * ratio / lag
    slew = float(generator.uniform(1.5, 3.0)) * frequency * setting.scales.step
    changed = rig.with_parts(
        amplifier=rig.plant.amplifier._replace(frequency=frequency, damping_ratio=ratio, slew=slew)
    )
    return changed, {"lag": lag, "frequency_rad_per_s": frequency, "damping_ratio": ratio, "slew_limit": slew}


def _current_sensor_error(setting: BenchSetting, rig: Rig, gain: float) -> RigWithEffect:
    """A gain error and, of a third of its size, an offset."""
    generator = setting.generator("current_sensor_error")
    error = gain * generator.choice([-1, 1])
    offset = 0.3 * gain * setting.scales.current * generator.choice([-1, 1])
    errors = replace(rig.instruments, current_gain=1 + float(error), current_offset=float(offset))
    return replace(rig, instruments=errors), {"gain_error": float(error), "offset": float(offset)}


def _amplifier_crossover(setting: BenchSetting, rig: Rig, lost: float) -> RigWithEffect:
    width = 0.2 * setting.scales.voltage
    amplifier: Amplifier = rig.plant.amplifier._replace(crossover=lost, crossover_width=width)
    return rig.with_parts(amplifier=amplifier), {"lost_voltage": lost, "width": width}


ELECTRICAL = (
    BenchEffect(
        "coil_heating",
        "final_rise",
        "K",
        _coil_heating,
        lambda s: 5.0,
        lambda s: 180.0,
        least=_least_coil_heating,
        needs_magnets=True,
    ),
    BenchEffect("amplifier_bandwidth", "lag", "s", _amplifier_bandwidth, lag_to_start_with, lambda s: 100 / s.rate),
    BenchEffect(
        "current_sensor_error",
        "gain_error",
        "1",
        _current_sensor_error,
        lambda s: 0.01,
        lambda s: 0.5,
        needs_magnets=True,
    ),
)
AMPLIFIER_CROSSOVER = BenchEffect(
    "amplifier_crossover",
    "lost_voltage",
    "V",
    _amplifier_crossover,
    lambda s: 0.02 * s.scales.voltage,
    lambda s: 0.15 * s.scales.voltage,
    needs_magnets=True,
)
