"""What instruments of the bench do beside what is hidden: zeros, gains, stray flux, each some tolerances large.

Gains and zeros are put into the columns that the instruments write, after the run: a record of a voltage drive says
gain (v - zero) of a voltage v that acts, of a current drive (target - zero)/gain of a target. Stray flux is in the
equations, the zero of the map's gap in the map.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from msl_fem.actuator import Actuator
from msl_fem.bench.plant import Array, Stray
from msl_fem.bench.rig import Rig
from msl_fem.errors import InputError
from msl_fem.files.quantity import format_quantity
from msl_fem.record import StaticMap, Tolerance
from msl_fem.table.magnetic_table import MagneticTable

ZEROS = {"position_zero": "m", "current_zero": "A", "force_zero": "N", "command_zero": "", "static_gap_zero": "m"}
GAINS = ("voltage_gain", "command_gain", "current_gain", "force_gain")
SHARES = ("leakage_inductance", "mutual_inductance")
NAMES = (*ZEROS, *GAINS, *SHARES)
OF_A_SIDE = ("current_zero", "command_zero", "voltage_gain", "command_gain", "current_gain", "leakage_inductance")
MOST_TOLERANCES = 10.0


@dataclass(frozen=True)
class Nuisances:
    """Values by name, of a side with its number: zeros in SI units, gains about 1, shares of the nominal inductance."""

    values: dict[str, float]

    def gain(self, name: str) -> float:
        return self.values.get(name, 1.0)

    def zero(self, name: str) -> float:
        return self.values.get(name, 0.0)


def parse_nuisances(texts: Sequence[str]) -> tuple[tuple[str, float], ...]:
    """(name, size in tolerances) of texts NAME=SIZE; "all" stands for every name.

    Raises
    ------
    InputError : no NAME=SIZE, an unknown or a double name, a size outside 0 ... 10
    """
    sizes: dict[str, float] = {}
    stated: set[str] = set()
    for text in texts:
        name, equals, number = (part.strip() for part in text.partition("="))
        try:
            size = float(number) if equals else float("nan")
        except ValueError:
            size = float("nan")
        if not 0 <= size <= MOST_TOLERANCES:
            raise InputError(
                f"--nuisance '{text}': write NAME=SIZE, the size in tolerances, 0 ... {MOST_TOLERANCES:g}, like all=1"
            )
        if name != "all" and name not in NAMES:
            raise InputError(f"--nuisance '{text}': '{name}' is unknown; there are all, {', '.join(NAMES)}")
        if name in stated:
            raise InputError(f"--nuisance '{text}': {name} is there twice; state it once")
        stated.add(name)
        sizes |= dict.fromkeys(NAMES, size) if name == "all" else {name: size}
    return tuple(sizes.items())


def draw_nuisances(sizes: Sequence[tuple[str, float]], tolerance: Tolerance, *, seed: int) -> Nuisances:
    """Each as large as its size says, with a sign of chance; the same for a seed, whatever the sizes."""
    generator, values = np.random.default_rng([seed, 6]), {}
    wanted = dict(sizes)
    for name in NAMES:
        for at in (f"{name}_1", f"{name}_2") if name in OF_A_SIDE else (name,):
            sign = 1.0 if generator.random() < 0.5 else -1.0
            if wanted.get(name):
                values[at] = (name in GAINS) + sign * wanted[name] * float(getattr(tolerance, name))
    return Nuisances(values)


def with_stray_flux(rig: Rig, actuator: Actuator, table: MagneticTable | None, nuisances: Nuisances) -> Rig:
    """The rig with leakage and mutual flux, shares of the believed inductance at the nominal gap without current."""
    magnets = rig.plant.magnets
    if table is None or magnets.sides == 0 or actuator.motion is None:
        return rig
    magnet = table.evaluate(0.0, float(actuator.motion.nominal_gap or magnets.nominal_gap))
    inductance = magnets.per_side * magnets.share**2 * float(magnet["incremental_inductance"])
    shares = [nuisances.zero(f"leakage_inductance_{j}") for j in (1, 2)]
    mutual = nuisances.zero("mutual_inductance") if magnets.sides == 2 else 0.0
    return rig.with_parts(stray=Stray(inductance * shares[0], inductance * shares[1], inductance * mutual))


def spoilt_columns(columns: dict[str, Array], nuisances: Nuisances) -> dict[str, Array]:
    """The columns of a run as the instruments write them, before noise."""
    n = nuisances
    driven_by_voltage = "voltage_1_V" in columns and "command_1_A" not in columns
    spoilt = dict(columns)
    for name, values in columns.items():
        quantity, _, rest = name.partition("_")
        j = rest[:1]
        if quantity == "position":
            spoilt[name] = values + n.zero("position_zero")
        elif quantity == "force":
            spoilt[name] = n.gain("force_gain") * values + n.zero("force_zero")
        elif quantity == "current":
            spoilt[name] = n.gain(f"current_gain_{j}") * values + n.zero(f"current_zero_{j}")
        elif quantity == "command":
            spoilt[name] = (values - n.zero(f"command_zero_{j}")) / n.gain(f"command_gain_{j}")
        elif quantity == "voltage":
            zero = n.zero(f"command_zero_{j}") if driven_by_voltage else 0.0
            spoilt[name] = n.gain(f"voltage_gain_{j}") * (values - zero)
    return spoilt


def spoilt_map(static: StaticMap, nuisances: Nuisances, *, gauge_shift: float) -> StaticMap:
    """A map as the instruments write it. With a zero of its own its gaps are those of gauges: `gauge_shift` in m is by
    how much the true gaps of the given map are wider than they read."""
    n, force = nuisances, static.force
    own = "static_gap_zero" in n.values
    return replace(
        static,
        gap=static.gap + gauge_shift + n.zero("static_gap_zero") if own else static.gap,
        current=n.gain("current_gain_1") * static.current + n.zero("current_zero_1"),
        force=None if force is None else n.gain("force_gain") * force + n.zero("force_zero"),
        gap_zero="gauge" if own else static.gap_zero,
    )


def nuisances_report(nuisances: Nuisances) -> dict[str, str]:
    """What the answer file says of them, as texts with units."""
    told = {}
    for name, value in nuisances.values.items():
        base = name[:-2] if name[:-2] in OF_A_SIDE else name
        told[name] = format_quantity(value, ZEROS.get(base, ""), digits=5)
    return told
