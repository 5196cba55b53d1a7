"""What the instruments of the bench write down: errors of the readings, coloured noise, resolution."""

from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from msl_fem.actuator import Actuator
from msl_fem.bench.plant import CURRENT_DRIVE, FORCE_DRIVE, Array
from msl_fem.bench.rig import Rig
from msl_fem.bench.running import Response, smooth_noise
from msl_fem.computing.compiled import compiled
from msl_fem.record import Noise

VOLTAGE_NOISE = 5e-3
"""V: a voltage that is read, in current drive; what a voltage drive is asked for is known."""
DRIFT_CORNER = 0.1
"""Hz: the zero wanders less than once in a run of some seconds."""
COLOURED_SHARE, COLOURED_CORNER = 0.1, 20.0
"""Share of the noise's variance below a corner in Hz; the rest is white."""


def readings(rig: Rig, response: Response, *, run: int = 0) -> dict[str, Array]:
    """The columns that instruments read, (n_sample,) each by RECORDS' names, without noise.

    Position, currents, and in current drive the mean voltages; `run` numbers the run for its drift.
    """
    it = rig.instruments
    position = np.array(response.reading)
    if it.play > 0:
        position = _played(position, it.play)
    position += drift_path(rig, position.size, rate=response.rate, run=run)
    sides = range(response.current.shape[1])
    found: dict[str, Array] = {}
    if rig.plant.circuit.drive == CURRENT_DRIVE:
        found |= {f"voltage_{j + 1}_V": response.voltage[:, j] for j in sides}
    currents = {f"current_{j + 1}_A": it.current_gain * response.current[:, j] + it.current_offset for j in sides}
    return found | currents | {"position_m": position}


def drift_path(rig: Rig, count: int, *, rate: float, run: int) -> Array:
    """The wander of the position's zero, (count,) m."""
    it = rig.instruments
    if it.drift == 0:
        return np.zeros(count)
    return it.drift * smooth_noise(count, corner=DRIFT_CORNER, rate=rate, seed=(it.drift_seed, run))


@compiled
def play_step(held: float, position: float, width: float) -> float:
    """The reading (m) of a sensor with a play of half width `width`; `held` is the last one, nan before the first."""
    if np.isnan(held):
        return position
    return min(max(held, position - width), position + width)


@compiled
def _played(position: Array, width: float) -> Array:
    """The readings of a sensor with a play of half width `width` (m), which starts in its middle."""
    out = np.empty_like(position)
    held = np.nan
    for n in range(position.size):
        held = play_step(held, position[n], width)
        out[n] = held
    return out


def columns(rig: Rig, response: Response, *, run: int = 0) -> dict[str, Array]:
    """All columns of a run file without noise: time, what the drive was asked for, and the readings."""
    time = np.arange(response.command.shape[0]) / response.rate
    kind = rig.plant.circuit.drive
    if kind == FORCE_DRIVE:
        asked = {"force_N": response.command[:, 0]}
    else:
        name = "command_{}_A" if kind == CURRENT_DRIVE else "voltage_{}_V"
        asked = {name.format(j + 1): response.command[:, j] for j in range(response.command.shape[1])}
    return {"time_s": time} | asked | readings(rig, response, run=run)


def believed_noise(actuator: Actuator) -> Noise:
    """One sigma of each instrument, as rig.toml states it."""
    magnetic = actuator.drive is not None and actuator.drive.kind != "force"
    return Noise(
        position=actuator.position_sensor.noise,
        current=actuator.current_sensor.noise if magnetic else None,
        voltage=VOLTAGE_NOISE if actuator.drive is not None and actuator.drive.kind == "current" else None,
    )


@dataclass(frozen=True)
class Disturbed:
    """How readings are spoilt: one sigma by the first word of the column's name, the position's resolution."""

    sigma: dict[str, float]
    resolution: float
    coloured: bool = True


def disturbed(actuator: Actuator, *, coloured: bool = True) -> Disturbed:
    """The noise of an actuator's instruments."""
    stated = believed_noise(actuator)
    sigma = {"position": stated.position or 0.0, "current": stated.current or 0.0, "voltage": stated.voltage or 0.0}
    if actuator.drive is not None and actuator.drive.kind == "voltage":
        sigma["voltage"] = 0.0
    return Disturbed(sigma, actuator.position_sensor.resolution, coloured)


def noisy(table: dict[str, Array], how: Disturbed, *, rate: float, generator: np.random.Generator) -> dict[str, Array]:
    """The columns with the noise of what is read, and the position rounded to the sensor's steps."""
    out = dict(table)
    for name, values in table.items():
        sigma = how.sigma.get(name.partition("_")[0], 0.0)
        if sigma > 0:
            out[name] = values + sigma * instrument_noise(values.size, how, rate=rate, generator=generator)
    if how.resolution > 0:
        out["position_m"] = np.round(out["position_m"] / how.resolution) * how.resolution
    return out


def instrument_noise(count: int, how: Disturbed, *, rate: float, generator: np.random.Generator) -> Array:
    """Noise (count,) of unit variance: white, and where coloured a tenth of the variance first order below 20 Hz."""
    white = generator.standard_normal(count)
    slow = generator.standard_normal(count)  # drawn in either case, so that the white part is the same
    if not how.coloured:
        return white
    pole = np.exp(-2 * np.pi * COLOURED_CORNER / rate)
    slow[1:] *= np.sqrt(1 - pole**2)
    coloured = np.asarray(lfilter([1.0], [1.0, -pole], slow))
    return np.sqrt(1 - COLOURED_SHARE) * white + np.sqrt(COLOURED_SHARE) * coloured
