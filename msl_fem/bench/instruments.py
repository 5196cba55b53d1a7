"""A run of the rig, what the instruments write down of it with errors and noise, and the static map of a magnet."""

import math
from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from msl_fem.actuator import Actuator
from msl_fem.bench.equations import leakage_flux, remanent_current
from msl_fem.bench.iron import pinned_current, series_current, settle_memory, side_magnet, virgin_memory
from msl_fem.bench.plant import CURRENT_DRIVE, FORCE_DRIVE, Array, Bench, BenchPlant, Stray, as_record
from msl_fem.bench.rig import InstrumentErrors, Rig, magnet_surface
from msl_fem.computing.compiled import compiled
from msl_fem.errors import InputError
from msl_fem.record import Noise, StaticMap
from msl_fem.table.magnetic_table import MagneticTable

VOLTAGE_NOISE = 5e-3
"""V: a voltage that is read, in current drive; what a voltage drive is asked for is known."""
DRIFT_CORNER = 0.1
"""Hz: the zero wanders less than once in a run of some seconds."""
COLOURED_SHARE, COLOURED_CORNER = 0.1, 20.0
"""Share of the noise's variance below a corner in Hz; the rest is white."""
FORCE_NOISE, FLUX_NOISE = 0.2, 2e-5
"""N and Wb, one sigma of the map's instruments."""
_GAPS, _CURRENTS, _SETTLING = 7, 13, 8


@dataclass(frozen=True, eq=False)
class Response:
    """A run of the rig without noise, (n_sample, ...) each; samples are taken before their command acts.

    Attributes
    ----------
    command : (n_sample, n_column) as asked
    voltage : (n_sample, n_side) mean until the next sample
    reading : the position after the sensor's electronics, before instruments' errors
    measured : in closed loop the position as its controller read it, with errors and noise; else None
    """

    rate: float
    command: Array
    current: Array
    voltage: Array
    flux_linkage: Array
    position: Array
    velocity: Array
    reading: Array
    end_state: Array
    measured: Array | None = None


def readings(rig: Rig, response: Response, *, run: int = 0) -> dict[str, Array]:
    """The columns that instruments read, (n_sample,) each by RECORDS' names, without noise.

    Position, currents, and in current drive the mean voltages; `run` numbers the run for its drift.
    """
    errors = rig.instruments
    position = np.array(response.reading)
    if any(errors.coil_reading):
        position += coil_field(errors, response.current, rate=response.rate)
    if errors.play > 0:
        position = _played(position, errors.play)
    position += drift_path(rig, position.size, rate=response.rate, run=run)
    sides = range(response.current.shape[1])
    read: dict[str, Array] = {}
    if rig.plant.circuit.drive == CURRENT_DRIVE:
        read |= {f"voltage_{j + 1}_V": response.voltage[:, j] for j in sides}
    for j in sides:
        read[f"current_{j + 1}_A"] = errors.current_gain * response.current[:, j] + errors.current_offset
    return read | {"position_m": position}


def coil_field(errors: InstrumentErrors, current: Array, *, rate: float) -> Array:
    """What the sensor reads of the coils' field, (n_sample,) m, for currents (n_sample, n_side) that run straight
    between samples: two lags in a row, each solved exactly over a sample."""
    field = current @ np.array(errors.coil_reading)[: current.shape[1]]
    for part in (0.8, 0.2):
        lag = part * errors.coil_reading_lag * rate  # in samples
        kept = math.exp(-1 / lag)
        late = lag * (1 - kept)
        start = np.array([late * field[0]])
        field = np.asarray(lfilter([1 - late, late - kept], [1.0, -kept], field, zi=start)[0])
    return field


def drift_path(rig: Rig, count: int, *, rate: float, run: int) -> Array:
    """The wander of the position's zero, (count,) m."""
    errors = rig.instruments
    if errors.drift == 0:
        return np.zeros(count)
    return errors.drift * smooth_noise(count, corner=DRIFT_CORNER, rate=rate, seed=(errors.drift_seed, run))


def smooth_noise(count: int, *, corner: float, rate: float, seed: tuple[int, ...]) -> Array:
    """Gaussian noise (count,) of unit variance, low-passed twice at `corner` (Hz), settled before it begins."""
    pole = math.exp(-2 * math.pi * corner / rate)
    lead = int(8 / (1 - pole))
    value = np.random.default_rng(seed).standard_normal(count + lead)
    for _ in range(2):
        value = np.asarray(lfilter([1.0], [1.0, -pole], value))
    return value[lead:] / math.sqrt((1 + pole**2) / (1 - pole**2) ** 3)


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


def run_columns(rig: Rig, response: Response, *, run: int = 0) -> dict[str, Array]:
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
class ReadingNoise:
    """How readings are spoilt: one sigma by the first word of the column's name, the position's resolution."""

    sigma: dict[str, float]
    resolution: float
    coloured: bool = True


def noise_of_instruments(actuator: Actuator, *, coloured: bool = True) -> ReadingNoise:
    """The noise of an actuator's instruments."""
    stated = believed_noise(actuator)
    sigma = {"position": stated.position or 0.0, "current": stated.current or 0.0, "voltage": stated.voltage or 0.0}
    if actuator.drive is not None and actuator.drive.kind == "voltage":
        sigma["voltage"] = 0.0
    return ReadingNoise(sigma, actuator.position_sensor.resolution, coloured)


def with_noise(
    table: dict[str, Array], how: ReadingNoise, *, rate: float, generator: np.random.Generator
) -> dict[str, Array]:
    """The columns with the noise of what is read, and the position rounded to the sensor's steps."""
    out = dict(table)
    for name, values in table.items():
        sigma = how.sigma.get(name.partition("_")[0], 0.0)
        if sigma > 0:
            out[name] = values + sigma * instrument_noise(values.size, how, rate=rate, generator=generator)
    if how.resolution > 0:
        out["position_m"] = np.round(out["position_m"] / how.resolution) * how.resolution
    return out


def instrument_noise(count: int, how: ReadingNoise, *, rate: float, generator: np.random.Generator) -> Array:
    """Noise (count,) of unit variance: white, and where coloured a tenth of the variance first order below 20 Hz."""
    white = generator.standard_normal(count)
    slow = generator.standard_normal(count)  # drawn in either case, so that the white part is the same
    if not how.coloured:
        return white
    pole = np.exp(-2 * np.pi * COLOURED_CORNER / rate)
    slow[1:] *= np.sqrt(1 - pole**2)
    coloured = np.asarray(lfilter([1.0], [1.0, -pole], slow))
    return np.sqrt(1 - COLOURED_SHARE) * white + np.sqrt(COLOURED_SHARE) * coloured


def bench_static_map(
    actuator: Actuator,
    table: MagneticTable | None,
    rig: Rig,
    *,
    generator: np.random.Generator,
    noisy: bool = True,
) -> StaticMap:
    """The map over gaps as read and currents as read, up and down, with the magnet demagnetised before every gap.

    Actuator and table are those believed. The gaps span four fifths of the range as far as that table reaches, the
    currents half of the largest: what is asked for tells nothing of what is true.

    Raises
    ------
    InputError : the rig has no magnets
    """
    if rig.table is None or table is None or actuator.motion is None:
        raise InputError(f"{rig.name}: a static map needs magnets; leave out --static")
    plant = _one_magnet(rig)
    nominal = float(actuator.motion.nominal_gap or 0.0)
    off = rig.plant.magnets.nominal_gap - nominal  # true less read
    reach = 0.8 * rig.plant.motion.travel
    low = max(nominal - reach, 1.3 * table.gap[0])
    high = min(nominal + reach, 0.9 * table.gap[-1])
    top = 0.5 * min(float(table.current[-1]), rig.plant.circuit.current_limit * rig.plant.magnets.share)
    up = np.linspace(0.0, top, _CURRENTS)
    ramp = np.r_[up, up[-2::-1]]
    direction = np.r_[np.full(_CURRENTS, "up"), np.full(_CURRENTS - 1, "down")]
    bench = Bench(as_record(plant), magnet_surface(rig.table), np.zeros((2, 1)), np.zeros((2, 1)), np.zeros((2, 2)))
    rows = []
    for number, gap in enumerate(np.linspace(low, high, _GAPS)):
        force_and_flux = np.zeros((ramp.size, 2))
        true_current = (ramp - rig.instruments.current_offset) / rig.instruments.current_gain
        if not _ramp(bench, virgin_memory(), true_current, gap + off, force_and_flux):
            raise InputError(f"{rig.name}: the static map leaves the table at {gap * 1e3:.3g} mm; leave out --static")
        rows.append(np.column_stack([np.full(ramp.size, gap), ramp, force_and_flux, np.full(ramp.size, number)]))
    gap, current, force, flux, sequence = np.concatenate(rows).T
    noise = generator.standard_normal((2, force.size)) if noisy else np.zeros((2, force.size))
    return StaticMap(
        gap=gap,
        current=current,
        force=force + FORCE_NOISE * noise[0],
        flux_linkage=flux + FLUX_NOISE * noise[1],
        role=np.where(sequence % 3 == 1, "held-out", "fit"),
        direction=np.tile(direction, _GAPS),
        sequence=sequence,
        gap_zero="mover",
    )


def _one_magnet(rig: Rig) -> BenchPlant:
    """The plant of a rig with one magnet on one side, whose effects are those of side 1's share."""
    plant, m = rig.plant, rig.plant.magnets
    per_flux = m.per_side * m.share  # side's flux over a magnet's
    per_current = m.share  # magnet's current over the side's
    h, iron, stray = plant.hysteresis, plant.series_iron, plant.stray
    slope = iron.slope * per_current * per_flux
    return plant._replace(
        magnets=m._replace(sides=1, per_side=1, share=1.0),
        hysteresis=h._replace(amplitude=h.amplitude * per_current, flux_scale=h.flux_scale / per_flux),
        series_iron=iron._replace(step=iron.step / per_flux, value=iron.value * per_current, slope=slope),
        stray=Stray(
            leakage_1=stray.leakage_1 / (per_flux * per_current),
            leakage_bend=stray.leakage_bend * per_current,
            remanent_1=stray.remanent_1 * per_current,
            remanent_flux=stray.remanent_flux / per_flux,
        ),
    )


@compiled
def _ramp(bench: Bench, memory: Array, currents: Array, gap: float, force_and_flux: Array) -> bool:
    """Force and flux linkage (n, 2) along a ramp of coil currents (n,); False outside the table."""
    magnetising = 0.0
    for n in range(currents.size):
        # bisection for i_m: the coil's current grows with it
        low = min(magnetising, currents[n]) - 0.5 * (abs(currents[n]) + 1.0)
        high = currents[n] + 1.0 + abs(bench.plant.stray.remanent_1)
        for _ in range(60):
            middle = 0.5 * (low + high)
            inside, _, current = _coil_current(bench, memory, middle, gap, force_and_flux[n])
            if not inside:
                return False
            if current < currents[n]:
                low = middle
            else:
                high = middle
        magnetising = 0.5 * (low + high)
        _coil_current(bench, memory, magnetising, gap, force_and_flux[n])
        settle_memory(bench.plant.hysteresis, memory, force_and_flux[n, 1])
    return True


@compiled
def _coil_current(bench: Bench, memory: Array, magnetising: float, gap: float, row: Array) -> tuple[bool, float, float]:
    """(inside the table, flux linkage, coil current); force and flux linkage into the row."""
    inside, flux, force, _, _ = side_magnet(bench.surface, bench.plant.magnets, magnetising, gap)
    if not inside:
        return False, flux, 0.0
    flux += leakage_flux(bench.plant.stray, 0, magnetising)
    row[0], row[1] = force, flux
    current = magnetising - remanent_current(bench.plant.stray, 0, flux)
    if bench.plant.series_iron.step > 0.0:
        current += series_current(bench.plant.series_iron, flux)
    if bench.plant.hysteresis.amplitude > 0.0:
        current += pinned_current(bench.plant.hysteresis, memory, flux)
    return True, flux, current
