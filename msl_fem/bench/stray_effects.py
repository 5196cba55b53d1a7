"""Effects of stray flux: leakage, mutual inductance, remanence; the coils' field in the sensor, an amplifier's rail."""

from dataclasses import replace

import numpy as np

from msl_fem.bench.rig import Rig
from msl_fem.bench.running import Following
from msl_fem.bench.setting import BenchEffect, BenchSetting, RigWithEffect
from msl_fem.errors import InputError

LEAKAGE_BENDS_AT = 10.0  # times the RMS current
REMANENCE_BENDS_AT = 8.0  # times the RMS flux linkage
MUTUAL_CURVE = 0.03  # of M between the middle and the end of the gap, at most: docs/decoupling.md


def _inductance(setting: BenchSetting) -> float:
    """H of a side at the nominal gap without current, as believed."""
    magnets, motion = setting.rig.plant.magnets, setting.actuator.motion
    assert setting.table is not None
    assert motion is not None
    magnet = setting.table.evaluate(0.0, float(motion.nominal_gap or magnets.nominal_gap))
    return magnets.per_side * magnets.share**2 * float(magnet["incremental_inductance"])


def _leakage(setting: BenchSetting, rig: Rig, share: float) -> RigWithEffect:
    """Both sides leak, unequally; the flux passes iron that bends at ten times the runs' current."""
    inductance = _inductance(setting)
    other = float(setting.generator("leakage_inductance").uniform(0.8, 1.2))
    stray = rig.plant.stray
    changed = stray._replace(
        leakage_1=stray.leakage_1 + share * inductance,
        leakage_2=stray.leakage_2 + other * share * inductance,
        leakage_bend=LEAKAGE_BENDS_AT * setting.scales.current,
    )
    return rig.with_parts(stray=changed), {"share_1": share, "share_2": other * share}


def _least_leakage(setting: BenchSetting) -> float:
    return 6 * setting.tolerance.leakage_inductance


def _mutual(setting: BenchSetting, rig: Rig, share: float) -> RigWithEffect:
    """One sign or the other, as the sides oppose or aid; it changes a little over the gap and so pulls a little."""
    generator = setting.generator("mutual_inductance")
    aiding = setting.actuator.sides is not None and setting.actuator.sides.polarity == "aiding"
    value = (1.0 if aiding else -1.0) * share
    curve = float(generator.uniform(-1, 1)) * MUTUAL_CURVE / rig.plant.magnets.nominal_gap**2
    stray = rig.plant.stray
    changed = stray._replace(mutual=stray.mutual + value * _inductance(setting), mutual_curve=curve)
    return rig.with_parts(stray=changed), {"share": value, "curve_per_m2": curve}


def _least_mutual(setting: BenchSetting) -> float:
    return 6 * setting.tolerance.mutual_inductance


def _remanent_flux(setting: BenchSetting, rig: Rig, current: float) -> RigWithEffect:
    """Both sides keep flux, of one sign or the other; large flux wipes some of it out."""
    generator = setting.generator("remanent_flux")
    first, second = current * generator.choice([-1, 1]), current * generator.choice([-1, 1]) * generator.uniform(0.5, 1)
    bends = REMANENCE_BENDS_AT * setting.scales.flux_linkage
    changed = rig.plant.stray._replace(remanent_1=float(first), remanent_2=float(second), remanent_flux=bends)
    return rig.with_parts(stray=changed), {"current_1": float(first), "current_2": float(second)}


def _least_remanence(setting: BenchSetting) -> float:
    return 6 * float(setting.tolerance.command_zero)


def _position_sensor_crosstalk(setting: BenchSetting, rig: Rig, per_current: float) -> RigWithEffect:
    """The field of both coils behind housing and target: two lags in a row, 0.8 and 0.2 of the whole."""
    if any(isinstance(asked, Following) for asked in setting.commands):
        raise InputError("position_sensor_crosstalk: the bench reads it in open loop alone; leave loop=closed out")
    generator = setting.generator("position_sensor_crosstalk")
    lag = float(2e-4 * 5 ** generator.uniform(-1, 1))
    second = -per_current * float(generator.uniform(0.3, 1.0))
    errors = replace(rig.instruments, coil_reading=(per_current, second), coil_reading_lag=lag)
    return replace(rig, instruments=errors), {"per_current_1": per_current, "per_current_2": second, "lag": lag}


def _drive_limit(setting: BenchSetting, rig: Rig, beyond: float) -> RigWithEffect:
    """A rail that lies `beyond` below the largest command, into which the amplifier runs softly."""
    largest = _largest_command(setting)
    rail = largest * (1 - beyond)
    return rig.with_parts(amplifier=rig.plant.amplifier._replace(rail=rail)), {"rail": rail, "largest": largest}


def _largest_command(setting: BenchSetting) -> float:
    return max(float(np.abs(response.command).max()) for response in setting.responses)


STRAY = (
    BenchEffect(
        "leakage_inductance",
        "share",
        "1",
        _leakage,
        lambda s: 0.05,
        lambda s: 1.0,
        least=_least_leakage,
        needs_magnets=True,
    ),
    BenchEffect(
        "mutual_inductance",
        "share",
        "1",
        _mutual,
        lambda s: 0.02,
        lambda s: 0.3,
        least=_least_mutual,
        needs_magnets=True,
    ),
    BenchEffect(
        "remanent_flux",
        "current",
        "A",
        _remanent_flux,
        lambda s: 0.02 * s.scales.current,
        lambda s: s.scales.current,
        least=_least_remanence,
        needs_magnets=True,
    ),
    BenchEffect(
        "position_sensor_crosstalk",
        "per_current",
        "m/A",
        _position_sensor_crosstalk,
        lambda s: 0.03 * s.scales.position / s.scales.current,
        lambda s: s.scales.position / s.scales.current,
        needs_magnets=True,
    ),
    BenchEffect("drive_limit", "beyond", "1", _drive_limit, lambda s: 0.3, lambda s: 0.9),
)
