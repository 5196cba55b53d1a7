"""Gains and zeros of the instruments, leakage and mutual flux: believed within tolerances, as mass and resistance are.

A reading is gain times what is there, plus zero; of a static map 1 + a of it where it is positive, 1 - a where it is
negative, a the instrument's asymmetry. What drives the plant is known by a reading or a command:

    voltage drive             v = voltage / voltage_gain + command_zero
    current drive             target = command_gain command + command_zero
    driven by its currents    i = (current - current_zero) / current_gain
    force drive               F = (force - force_zero) / force_gain

Leakage and mutual inductance are stated over the inductance of a side at the nominal gap without current.
"""

from collections.abc import Collection, Mapping
from typing import NamedTuple

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.plant.plant import CURRENT_DRIVE, FORCE_DRIVE, VOLTAGE_DRIVE, PlantParameters
from msl_fem.record import Tolerance
from msl_fem.record.columns import CHANNELS, Channel


class Nuisance(NamedTuple):
    """A parameter of an instrument: the tolerance that bounds it, its neutral value (0: it is added), its unit."""

    tolerance: str
    neutral: float
    unit: str = ""


NUISANCES: dict[str, Nuisance] = {
    "position_zero": Nuisance("position_zero", 0.0, "m"),
    "velocity_gain": Nuisance("velocity_gain", 1.0),
    "velocity_zero": Nuisance("velocity_zero", 0.0, "m/s"),
    "force_gain": Nuisance("force_gain", 1.0),
    "force_zero": Nuisance("force_zero", 0.0, "N"),
    "force_asymmetry": Nuisance("force_asymmetry", 0.0),
    "flux_linkage_gain": Nuisance("flux_linkage_gain", 1.0),
    "flux_linkage_zero": Nuisance("flux_linkage_zero", 0.0, "Wb"),
    "flux_linkage_asymmetry": Nuisance("flux_linkage_asymmetry", 0.0),
    "flux_density_zero": Nuisance("flux_density_zero", 0.0, "T"),
    "flux_density_asymmetry": Nuisance("flux_density_asymmetry", 0.0),
    "static_gap_zero": Nuisance("static_gap_zero", 0.0, "m"),
    "mutual_inductance": Nuisance("mutual_inductance", 0.0),
}
"""By name; those of a side end in its number."""
for _j in (1, 2):
    NUISANCES[f"current_gain_{_j}"] = Nuisance("current_gain", 1.0)
    NUISANCES[f"current_zero_{_j}"] = Nuisance("current_zero", 0.0, "A")
    NUISANCES[f"voltage_gain_{_j}"] = Nuisance("voltage_gain", 1.0)
    NUISANCES[f"command_gain_{_j}"] = Nuisance("command_gain", 1.0)
    NUISANCES[f"command_zero_{_j}"] = Nuisance("command_zero", 0.0)
    NUISANCES[f"leakage_inductance_{_j}"] = Nuisance("leakage_inductance", 0.0)
ADDITIVE = frozenset(name for name, nuisance in NUISANCES.items() if nuisance.neutral == 0.0)


def together(one: Mapping[str, float], further: Mapping[str, float]) -> dict[str, float]:
    """Factors of both: products, sums of what is added."""
    both = dict(one)
    for name, value in further.items():
        if name in ADDITIVE:
            both[name] = both.get(name, 0.0) + value
        else:
            both[name] = both.get(name, 1.0) * value
    return both


def nuisances_of(
    p: PlantParameters, tolerance: Tolerance, *, channels: tuple[str, ...], ideal_current: bool = False
) -> dict[str, float]:
    """One sigma of the nuisances that runs with these channels (measured columns) show; none of tolerance 0.

    Gains of what drives a rig and is not read beside it stand for those of the force: of a rig that a force drives.
    """
    names = ["position_zero"]
    if "velocity_m_per_s" in channels:
        names += ["velocity_gain", "velocity_zero"]
    if p.drive == FORCE_DRIVE:
        names += ["force_gain", "force_zero"]
    for j in range(1, p.sides + 1):
        if p.drive == VOLTAGE_DRIVE:
            names += [f"voltage_gain_{j}", f"command_zero_{j}"]
        elif ideal_current:
            names += [f"current_gain_{j}", f"current_zero_{j}"]
        else:
            names += [f"command_gain_{j}", f"command_zero_{j}"]
        if f"current_{j}_A" in channels:
            names += [f"current_gain_{j}", f"current_zero_{j}"]
        if f"voltage_{j}_V" in channels:
            names += [f"voltage_gain_{j}"]
        names += [f"leakage_inductance_{j}"]
    if p.sides == 2:
        names += ["mutual_inductance"]
    sigmas = {name: float(getattr(tolerance, NUISANCES[name].tolerance)) for name in names}
    return {name: sigma for name, sigma in sigmas.items() if sigma > 0}


def nuisances_of_map(tolerance: Tolerance, *, gap: str, readings: Collection[str]) -> dict[str, float]:
    """One sigma of the nuisances of a static map with these readings; its gaps are those of gauges, or of the mover."""
    names = ["current_gain_1", "current_zero_1", "force_gain", "force_zero", "leakage_inductance_1"]
    for column in readings:
        quantity = Channel.of(column).quantity if column in CHANNELS else column.rpartition("_")[0]
        own = (f"{quantity}_{word}" for word in ("gain", "zero", "asymmetry"))
        names += [name for name in own if name in NUISANCES and name not in names]
    if gap == "gauge":
        names += ["static_gap_zero"]
    sigmas = {name: float(getattr(tolerance, NUISANCES[name].tolerance)) for name in names}
    return {name: sigma for name, sigma in sigmas.items() if sigma > 0}


def line_of(column: str, factors: Mapping[str, float]) -> tuple[float, float]:
    """(gain, zero) of the reading in a column: of position, velocity, force, or of a side's current or voltage."""
    channel = Channel.of(column)
    at = channel.quantity if channel.side is None else f"{channel.quantity}_{{}}_{channel.side}"
    gain, zero = (at.format(word) if "{}" in at else f"{at}_{word}" for word in ("gain", "zero"))
    return factors.get(gain, 1.0), factors.get(zero, 0.0)


def read_of_map(column: str, values: Array, factors: Mapping[str, float]) -> tuple[Array, float]:
    """What a static map's instrument reads of values (n_row,) over its zero, and that zero: gain x, more where it is
    positive and less where it is negative by its asymmetry."""
    quantity = column.rpartition("_")[0]
    gain, zero, uneven = (
        factors.get(f"{quantity}_{w}", n) for w, n in (("gain", 1.0), ("zero", 0.0), ("asymmetry", 0.0))
    )
    return gain * (1.0 + uneven * np.sign(values)) * values, zero


def with_nuisances(p: PlantParameters, factors: Mapping[str, float], *, ideal_current: bool = False) -> PlantParameters:
    """The plant with leakage, mutual flux, and the gains and zeros of what drives it, beside those that it has."""
    if not NUISANCES.keys() & factors.keys():
        return p
    gains, zeros = zip(*(_input(p, factors, j, ideal_current) for j in (1, 2)), strict=True)
    return p._replace(
        leakage_1=p.leakage_1 + p.inductance * factors.get("leakage_inductance_1", 0.0),
        leakage_2=p.leakage_2 + p.inductance * factors.get("leakage_inductance_2", 0.0),
        mutual=p.mutual + p.inductance * factors.get("mutual_inductance", 0.0),
        input_gain_1=p.input_gain_1 * gains[0],
        input_gain_2=p.input_gain_2 * gains[1],
        input_zero_1=p.input_zero_1 + zeros[0],
        input_zero_2=p.input_zero_2 + zeros[1],
    )


def _input(p: PlantParameters, factors: Mapping[str, float], j: int, ideal_current: bool) -> tuple[float, float]:
    """(gain, zero) of what drives side j over its column."""
    command_zero = factors.get(f"command_zero_{j}", 0.0)
    if p.drive == VOLTAGE_DRIVE:
        return 1.0 / factors.get(f"voltage_gain_{j}", 1.0), command_zero
    if p.drive == CURRENT_DRIVE and not ideal_current:
        return factors.get(f"command_gain_{j}", 1.0), command_zero
    column = f"current_{j}_A" if p.drive == CURRENT_DRIVE else "force_N"
    gain, zero = line_of(column, factors)
    return 1.0 / gain, -zero / gain
