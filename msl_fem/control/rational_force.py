"""The input transformation of identified rational terms, F_j = sum a_pq i_j^p / (g_j + delta)^q.

(Gutierrez and Ro, IEEE Trans. Magnetics 34(5), 1998, eq. 2.) The terms become a surface like a table's, so inverse,
guard and loop are the same; its coenergy is W' = sum a_pq i^p h_q(g), h_q = (g + delta)^(1 - q)/(q - 1),
-ln(g + delta) for q = 1, -(g + delta) for q = 0.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from msl_fem.actuator import Actuator
from msl_fem.computing.arrays import Array
from msl_fem.control.design_model import DesignModel, guard_of_pair
from msl_fem.control.inverse import SideModel, inverse_of
from msl_fem.control.linear_plant import linear_plant
from msl_fem.errors import InputError
from msl_fem.files.quantity import format_quantity
from msl_fem.maps.guard import Guard
from msl_fem.maps.level_currents import OperatingMap
from msl_fem.maps.pair_limits import PairMap
from msl_fem.plant.plant import PlantParameters, Surface, as_surface, plant_parameters
from msl_fem.table.coenergy_surface import fit_coenergy_surface

_N_GAP, _N_CURRENT, _N_CHECK = 41, 25, 400


@dataclass(frozen=True)
class ForceTerm:
    """coefficient i_side^current_power / (gap of that side + delta)^gap_power: N towards +x of a side's current."""

    side: int
    current_power: int
    gap_power: int
    coefficient: float


@dataclass(frozen=True)
class IdentifiedPlant:
    """What an identified model tells of the plant; the mass is the scale that it was given.

    Attributes
    ----------
    stiffness, damping : N/m, N s/m
    delta : m, added to the believed gaps in the terms
    """

    stiffness: float
    damping: float
    terms: tuple[ForceTerm, ...]
    delta: float


def design_model_of_terms(
    actuator: Actuator, identified: IdentifiedPlant, operating_map: OperatingMap, pair: PairMap | None = None
) -> DesignModel:
    """The belief in an actuator whose motion and forces are those that were identified.

    The inverse reaches as far as every side's force grows with its current, over all gaps of the map; that is the
    belief's domain.

    Raises
    ------
    ActuatorError : a section that a design needs is missing
    InputError : a side without terms, a force that pushes or that falls with the current from the beginning; a gap that
        closes with delta
    """
    coupled = plant_parameters(actuator)
    plant = replace(linear_plant(actuator), stiffness=identified.stiffness, damping=identified.damping)
    gaps = np.asarray(Guard(operating_map).arrays.gap)
    ends = min(coupled.current_limit * coupled.current_share, operating_map.current_max)
    domain = min(_growing_up_to(identified, coupled, side, (gaps, ends)) for side in range(1, coupled.sides + 1))
    sides = [
        SideModel(_surface(identified, coupled, side, (gaps, domain)), coupled.nominal_gap)
        for side in range(1, coupled.sides + 1)
    ]
    inverse = inverse_of(coupled, Guard(operating_map), *sides, pair=guard_of_pair(actuator, pair))
    return DesignModel(actuator, plant, coupled, inverse, source="rational terms")


def term_force(terms: Sequence[ForceTerm], delta: float, side: int, current: Array, gap: Array) -> Array:
    """Pull of a side in N, positive when attractive, at its current and gap; broadcast together."""
    toward = 1.0 if side == 1 else -1.0
    total = np.zeros(np.broadcast(current, gap).shape)
    for term in terms:
        if term.side == side:
            total = total + toward * term.coefficient * current**term.current_power / (gap + delta) ** term.gap_power
    return total


def _growing_up_to(
    identified: IdentifiedPlant, coupled: PlantParameters, side: int, range_: tuple[Array, float]
) -> float:
    """The magnet current in A up to which a side's force grows at all gaps."""
    gaps, end = range_
    if not any(term.side == side for term in identified.terms):
        raise InputError(f"the identified model has no term of side {side}; identify with terms of every side")
    if gaps[0] + identified.delta <= 0:
        raise InputError(
            f"the identified gap offset of {format_quantity(identified.delta, 'm')} closes the map's smallest gap of "
            f"{format_quantity(float(gaps[0]), 'm')}; make the map with larger gaps, or identify anew"
        )
    magnet = np.linspace(0.0, end, _N_CHECK)
    dense = np.linspace(gaps[0], gaps[-1], _N_CHECK)
    force = term_force(
        identified.terms, identified.delta, side, (magnet / coupled.current_share)[None, :], dense[:, None]
    )
    grows = (np.diff(force, axis=1) > 0).all(axis=0)
    if grows.all():
        return end
    last = int(np.argmin(grows)) - 1  # the force is largest within two steps of the first that does not grow
    if last < 1:
        raise InputError(
            f"the identified force of side {side} does not grow with its current from 0 on at all gaps of the map; no "
            "current gives a wanted force: identify with other terms, or control with --model table"
        )
    return float(magnet[last])


def _surface(identified: IdentifiedPlant, coupled: PlantParameters, side: int, range_: tuple[Array, float]) -> Surface:
    """The surface of one magnet of a side; its current nodes crowd at 0, its gap nodes at the smallest gap."""
    gaps, end = range_
    g = np.geomspace(gaps[0] + identified.delta, gaps[-1] + identified.delta, _N_GAP)[:, None]
    i = end * np.linspace(0.0, 1.0, _N_CURRENT)[None, :] ** 1.5
    names = ("coenergy", "flux_linkage", "force", "incremental_inductance", "force_current_slope", "force_gap_slope")
    nodes = {name: np.zeros((g.size, i.size)) for name in names}
    for term in identified.terms:
        if term.side == side:
            p, q = term.current_power, term.gap_power
            toward = 1.0 if side == 1 else -1.0
            a = toward * term.coefficient / (coupled.magnets * coupled.current_share**p)
            h = -np.log(g) if q == 1 else -g if q == 0 else g ** (1 - q) / (q - 1)
            nodes["coenergy"] += a * i**p * h
            nodes["flux_linkage"] += a * p * i ** (p - 1) * h
            nodes["incremental_inductance"] += a * p * (p - 1) * i ** max(p - 2, 0) * h
            nodes["force"] += a * i**p / g**q
            nodes["force_current_slope"] += a * p * i ** (p - 1) / g**q
            nodes["force_gap_slope"] += -a * q * i**p / g ** (q + 1)
    gap = g[:, 0] - identified.delta
    gap[0], gap[-1] = gaps[0], gaps[-1]
    return as_surface(fit_coenergy_surface(gap, i[0], nodes))
