"""How well the coil tells the gap: the observer on the coupled model, beside the least error that is possible.

The mover is held, the side carries a current, and a sine of voltage (the carrier) rides on it. Where no estimate could
do much better than what is known before, the bound says so; where the bound is small and the error is not, the filter
failed, or the plant has what it does not know.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from msl_fem.actuator import Actuator
from msl_fem.computing.arrays import Array
from msl_fem.control.position_observer import (
    CURRENT,
    GAP,
    GAP_RATE,
    N_OBSERVED,
    RESISTANCE,
    ObserverNoise,
    SensingCoil,
    bound_along,
    coil_of,
    inductance_of,
    observe,
)
from msl_fem.errors import InputError
from msl_fem.files.numbers import json_value
from msl_fem.files.quantity import format_quantity
from msl_fem.files.shown import Tabular
from msl_fem.maps import Guard
from msl_fem.plant.effects import EffectValues
from msl_fem.plant.excitation import Inputs
from msl_fem.plant.instruments import current_reading
from msl_fem.plant.plant import PlantParameters, plant_parameters, surface_of
from msl_fem.plant.simulate import Options, Simulation, simulate
from msl_fem.table.magnetic_table import MagneticTable

WITHIN = 2.0
"""Times the bound: an error up to this counts as reached."""
INFORMED = 0.2
"""Of the spread known before: a bound above it says that the coil tells little."""
_LEAST_SAMPLES = 20
_AMBIGUOUS = 3.0


@dataclass(frozen=True)
class Carrier:
    """What rides on the current, how it is sampled, and what is known before.

    Attributes
    ----------
    amplitude, frequency : of the sine of voltage, V and Hz
    rate : samples a second, Hz
    window : s, after which the estimate is judged
    voltage_noise : V, one sigma of what is not known of a sample's mean voltage
    gap_spread : m, one sigma of the gap before the first reading
    resistance_spread : one sigma of the resistance before, over its value
    """

    amplitude: float = 5.0
    frequency: float = 1e3
    rate: float = 50e3
    window: float = 10e-3
    voltage_noise: float = 0.05
    gap_spread: float = 50e-6
    resistance_spread: float = 0.02

    def __post_init__(self) -> None:
        for name, unit in (("frequency", "Hz"), ("rate", "Hz"), ("window", "s"), ("gap_spread", "m")):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0):
                raise InputError(f"{name} {format_quantity(value, unit)} must be positive and finite")
        for name in ("amplitude", "voltage_noise", "resistance_spread"):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) >= 0):
                raise InputError(f"{name} {getattr(self, name):g} must be 0 or more and finite")
        if self.rate < 4 * self.frequency:
            raise InputError(
                f"a carrier of {format_quantity(self.frequency, 'Hz')} at {format_quantity(self.rate, 'Hz')} has "
                f"{self.rate / self.frequency:.3g} samples a period; at least 4 are needed: raise the rate"
            )
        if self.window * self.rate < _LEAST_SAMPLES:
            raise InputError(
                f"a window of {format_quantity(self.window, 's')} has {self.window * self.rate:.3g} samples; "
                f"at least {_LEAST_SAMPLES} are needed: lengthen it or raise the rate"
            )


@dataclass(frozen=True, eq=False, repr=False)
class SelfSensing(Tabular):
    """What a coil tells of its gap over the preferred region of the map.

    Attributes
    ----------
    gap : (n_gap,) m; current : (n_gap, n_current) A of the side, up to the guard's first limit at each gap
    bound : (n_gap, n_current) m, one sigma, the least that any unbiased estimate has
    error : (n_gap, n_current) m, RMS over the runs; bias : its mean
    runs : number of runs at a point; spread : m, one sigma of the gap known before
    """

    gap: Array
    current: Array
    bound: Array
    error: Array
    bias: Array
    runs: int
    spread: float
    notes: tuple[str, ...] = ()

    @property
    def ratio(self) -> Array:
        """(n_gap, n_current) error over bound."""
        return self.error / self.bound

    @property
    def informed(self) -> Array:
        """(n_gap, n_current) bool: where the bound is at most `INFORMED` of what is known before."""
        return np.asarray(self.bound <= INFORMED * self.spread)

    @property
    def share(self) -> float:
        """Of the region: where the coil tells the gap, and the error is at most `WITHIN` times the bound."""
        return float(np.mean(np.logical_and(self.informed, self.ratio <= WITHIN)))

    def facts(self) -> dict[str, str]:
        """How far the bound is reached, and how small it is."""
        return {
            "points": f"{self.bound.size}, {self.runs} runs each",
            f"within {WITHIN:g} times the bound": f"{100 * self.share:.0f} % of the region",
            "bound": f"{format_quantity(float(np.median(self.bound)), 'm')}, "
            f"at worst {format_quantity(float(self.bound.max()), 'm')}",
            "error": f"{format_quantity(float(np.median(self.error)), 'm')}, "
            f"at worst {format_quantity(float(self.error.max()), 'm')}",
        }

    def frame_columns(self) -> Mapping[str, Array]:
        """gap_m, current_A, bound_m, error_m and bias_m, a row a point."""
        gap = np.repeat(self.gap, self.current.shape[1])
        columns = {"gap_m": gap, "current_A": self.current}
        columns |= {"bound_m": self.bound, "error_m": self.error, "bias_m": self.bias}
        return {name: np.ravel(values) for name, values in columns.items()}

    def to_json(self) -> dict[str, Any]:
        """The JSON object: figures, and the columns over all points."""
        lists = {name: [json_value(float(v)) for v in values] for name, values in self.frame_columns().items()}
        figures = {"share": self.share, "informed_share": float(self.informed.mean()), "runs": self.runs}
        return figures | {"points": lists, "notes": list(self.notes)}


def self_sensing(
    actuator: Actuator,
    table: MagneticTable,
    guard: Guard,
    *,
    carrier: Carrier | None = None,
    shape: tuple[int, int] = (6, 6),
    runs: int = 20,
    effects: EffectValues | None = None,
    known: EffectValues | None = None,
    seed: int = 1,
) -> SelfSensing:
    """The gap of side 1 by its coil, over the preferred region.

    Parameters
    ----------
    shape : gaps over the travel and currents up to the guard's first limit
    runs : at each point, each with its own noise and its own error of what is known before
    effects : those of the plant
    known : those that are believed; the observer takes their leakage inductance and depth, nothing else

    Raises
    ------
    InputError : no [drive], no current noise, or a carrier that the drive's voltage limit does not allow
    """
    carrier = carrier or Carrier()
    bench = _on_voltage(actuator, carrier)
    plant, surface = plant_parameters(bench), surface_of(table)
    noise = ObserverNoise(bench.current_sensor.noise, carrier.voltage_noise, 0.0)
    coil = coil_of(surface, plant, period=1 / carrier.rate, noise=noise, known=known)
    gap, current = _region(plant, table, guard, shape)
    found = np.empty((3, *current.shape))
    for k, g in enumerate(gap):
        for m, i in enumerate(current[k]):
            held = _held_run(bench, table, carrier, plant, float(g), float(i), effects)
            generator = np.random.default_rng([seed, k, m])
            found[:, k, m] = _judged(coil, bench, held, float(g), carrier, runs, generator)
    notes = _ambiguity_notes(coil, gap, current, carrier.gap_spread)
    return SelfSensing(gap, current, found[0], found[1], found[2], runs, carrier.gap_spread, notes)


def _ambiguity_notes(coil: SensingCoil, gap: Array, current: Array, spread: float) -> tuple[str, ...]:
    """At how many points a second gap within what is known before has the same inductance."""
    there = sum(bool(second_gaps(coil, float(g), float(i), spread).size) for g, row in zip(gap, current, strict=True)
                for i in row)  # fmt: skip
    if not there:
        return ()
    return (
        f"at {there} of {current.size} points another gap, within {_AMBIGUOUS:g} spreads of what is known before, "
        "has the same inductance (the knee of saturation); there an estimate may end at the wrong one",
    )


def second_gaps(coil: SensingCoil, gap: float, current: float, spread: float) -> Array:
    """Other gaps, in m, within three spreads whose inductance at this current is the same, by straight lines between
    steps of a 25th of the spread."""
    low, high = max(gap - _AMBIGUOUS * spread, coil.gap[0]), min(gap + _AMBIGUOUS * spread, coil.gap[-1])
    there = np.linspace(low, high, round(25 * (high - low) / spread) + 1)
    inductance = np.array([inductance_of(coil, current, float(g)) for g in there])
    less = inductance - inductance_of(coil, current, gap)
    turns = np.flatnonzero(less[:-1] * less[1:] < 0)
    roots = there[turns] - less[turns] * np.diff(there)[turns] / np.diff(less)[turns]
    return np.asarray(roots[np.abs(roots - gap) > 0.1 * spread])


def _on_voltage(actuator: Actuator, carrier: Carrier) -> Actuator:
    """The actuator whose drive puts voltages on the coils, whatever its own does."""
    if actuator.drive is None:
        raise InputError(f"{actuator.name}: section [drive] is missing; self-sensing needs the coil's resistance")
    if actuator.current_sensor.noise <= 0:
        raise InputError(f"{actuator.name}: current_sensor.noise is 0; the bound of an estimate needs it, like '2 mA'")
    limit = actuator.drive.voltage_limit
    if limit is not None and carrier.amplitude > limit:
        raise InputError(
            f"a carrier of {format_quantity(carrier.amplitude, 'V')} is more than the drive gives "
            f"({format_quantity(limit, 'V')}); lower its amplitude"
        )
    drive = actuator.drive.model_copy(update={"kind": "voltage", "bandwidth": None, "current_limit": None})
    return actuator.model_copy(update={"drive": drive})


def _region(plant: PlantParameters, table: MagneticTable, guard: Guard, shape: tuple[int, int]) -> tuple[Array, Array]:
    """Gaps of the travel that table and guard have, and currents from a tenth of the first limit to the limit."""
    low = max(plant.nominal_gap - plant.travel, table.gap[0], guard.operating_map.gap[0])
    high = min(plant.nominal_gap + plant.travel, table.gap[-1], guard.operating_map.gap[-1])
    if low >= high:
        raise InputError("table and map have no gap of the travel in common; make them for this actuator")
    gap = np.linspace(low, high, shape[0])
    limit = np.minimum(np.asarray(guard.limit(gap))[0], 0.95 * table.current[-1]) / plant.current_share
    return gap, limit[:, None] * np.linspace(0.1, 1.0, shape[1])


def _held_run(
    bench: Actuator, table: MagneticTable, carrier: Carrier, plant: PlantParameters, gap: float, current: float,
    effects: EffectValues | None,
) -> Simulation:  # fmt: skip
    """The coupled model with its mover held, side 1 at a current with the carrier, side 2 without any."""
    time = np.arange(round(carrier.window * carrier.rate)) / carrier.rate
    commands = np.zeros((time.size, plant.sides))
    commands[:, 0] = plant.resistance * current + carrier.amplitude * np.sin(2 * np.pi * carrier.frequency * time)
    options = Options(currents=(current, 0.0), position=plant.nominal_gap - gap, locked=True)
    return simulate(bench, table, Inputs(commands, carrier.rate), effects=effects, options=options)


def _judged(
    coil: SensingCoil, bench: Actuator, held: Simulation, gap: float, carrier: Carrier, runs: int,
    generator: np.random.Generator,
) -> tuple[float, float, float]:  # fmt: skip
    """Bound, RMS error and mean error of the gap at the window's end, m."""
    voltage, current = held.voltage[:, 0], held.current[:, 0]
    resistance = plant_parameters(bench).resistance
    states = np.zeros((current.size, N_OBSERVED))
    states[:, CURRENT], states[:, GAP], states[:, RESISTANCE] = current, gap, resistance
    spread = np.zeros(N_OBSERVED)
    spread[CURRENT], spread[GAP] = 10 * coil.noise.current, carrier.gap_spread
    spread[RESISTANCE] = carrier.resistance_spread * resistance
    bound = bound_along(coil, voltage, states, variances=spread**2)[-1, GAP, GAP]
    errors = np.empty(runs)
    for r in range(runs):
        start = states[0] + spread * generator.standard_normal(N_OBSERVED)
        start[GAP_RATE] = 0.0
        reading = current_reading(bench, current, generator=generator)
        known = voltage + coil.noise.voltage * generator.standard_normal(current.size)
        errors[r] = observe(coil, known, reading, start=start, variances=spread**2)[0][-1, GAP] - gap
    return float(np.sqrt(bound)), float(np.sqrt(np.mean(errors**2))), float(errors.mean())
