"""How warm the windings are believed to be, and the current that they bear then: the thermal part of the guard.

Each side is the two nodes of one of its magnets (`losses.thermal_network`), winding and core, moved on exactly over a
period in which the winding's loss is held: x[k+1] = Phi x[k] + Gamma P, P = R (1 + growth x_winding) i^2. The current
that is allowed now is the one that, held for `AHEAD` of the shorter time constant with the resistance of the hottest
winding, just brings the winding to its limit:

    i = sqrt((limit - Phi_a x)/(Gamma_a R_hot))

So far from the limit peak currents pass, near it they fold back, and at the limit what is left is the continuous
current. The winding does not pass the limit on the way: to do so before the end of that time and come back, the core
would have to cool while the winding is above its limit, and a core that was never warmer than the limit makes it
does not. Iron loss is left out.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from msl_fem.actuator import Actuator
from msl_fem.computing.arrays import Array
from msl_fem.computing.compiled import compiled
from msl_fem.errors import ActuatorError, InputError
from msl_fem.losses.thermal_limit import ThermalLimit
from msl_fem.losses.thermal_network import ThermalNetwork, phase_transition, thermal_network
from msl_fem.materials.constants import TEMPERATURE_COEFFICIENT, resistance_ratio

AHEAD = 0.1
"""Of the shorter time constant: how far the guard looks."""
N_NODE = 2
_TOLD = (1.0, 10.0, 60.0, 600.0)  # s, for which the sheet tells peak currents


class ThermalArrays(NamedTuple):
    """What the compiled controller takes: of a magnet, winding first."""

    transition: Array  # (2, 2) of the rises (K), over a period
    heating: Array  # (2,) K/W of loss in the winding, over a period
    ahead: Array  # (2,) the winding's rise at the end of the time ahead, over the rises now
    ahead_heating: float  # K/W
    limit: float  # K over ambient; inf: the windings are not guarded
    resistance: float  # ohm, at ambient
    growth: float  # 1/K, of the resistance over that at ambient


UNGUARDED = ThermalArrays(np.zeros((2, 2)), np.zeros(2), np.zeros(2), 1.0, np.inf, 0.0, 0.0)
"""Windings whose heat is not known."""


@dataclass(frozen=True, eq=False)
class ThermalGuard:
    """The thermal part of the guard.

    Attributes
    ----------
    arrays : for the compiled controller
    network : of a magnet
    limit : what the winding is allowed
    """

    arrays: ThermalArrays
    network: ThermalNetwork
    limit: ThermalLimit

    @property
    def continuous(self) -> float:
        """A, of a magnet, that holds the winding at its limit."""
        return float(np.sqrt(self.limit.temperature_rise / (self.network.resistance * self._hot)))

    @property
    def _hot(self) -> float:
        return self.arrays.resistance * (1 + self.arrays.growth * self.limit.temperature_rise)

    def bearable(self, duration: float) -> float:
        """A, of a magnet, that a cold winding bears for so many s with the resistance of the hottest one."""
        return float(np.sqrt(self.limit.temperature_rise / (_transition(self.network, duration)[1][0] * self._hot)))

    def to_json(self) -> dict[str, Any]:
        """The JSON object `thermal_guard`."""
        return {
            "temperature_rise_K": self.limit.temperature_rise,
            "ambient_K": self.limit.ambient,
            "continuous_current_A": self.continuous,
            "peak_currents_A": {f"{t:g} s": self.bearable(t) for t in _TOLD},
            "time_constants_s": self.network.time_constants.tolist(),
            "notes": [*self.network.notes, "currents of one magnet's coil; iron loss is left out"],
        }


def thermal_guard(actuator: Actuator, period: float, limit: ThermalLimit | None = None) -> ThermalGuard | None:
    """The guard for a controller with this period in s; None where cooling, heat capacity or resistance are not known.

    Raises
    ------
    InputError : a `limit` that is stated, and cannot be held as something of this is not known
    """
    chosen = limit or ThermalLimit()
    try:
        network, resistance = thermal_network(actuator, chosen.cooling), actuator.coil_resistance()
        if not np.isfinite(network.capacity).all():
            raise InputError(
                f"{actuator.name}: the winding's heat capacity is not known; describe the magnet by its dimensions"
            )
    except (InputError, ActuatorError) as err:
        if limit is not None:
            raise InputError(f"the windings cannot be guarded: {err}") from err
        return None
    transition, heating = _two_nodes(*_transition(network, period))
    ahead, ahead_heating = _two_nodes(*_transition(network, AHEAD * float(network.time_constants[-1])))
    at_ambient = float(resistance_ratio(chosen.ambient))
    arrays = ThermalArrays(
        transition, heating, ahead[0].copy(), float(ahead_heating[0]), chosen.temperature_rise,
        resistance * at_ambient, TEMPERATURE_COEFFICIENT / at_ambient,
    )  # fmt: skip
    return ThermalGuard(arrays, network, chosen)


def _transition(network: ThermalNetwork, duration: float) -> tuple[Array, Array]:
    """(Phi (n, n), Gamma (n,) K/W): rises after a duration in s, over those before and a loss in the winding."""
    n = network.capacity.size
    moved = phase_transition(network, network.conductance, np.eye(n)[0], duration)
    assert moved is not None  # a held loss lets nothing grow
    return moved[:n, :n], moved[:n, n]


def _two_nodes(transition: Array, heating: Array) -> tuple[Array, Array]:
    """Of one node beside a second one that stays cold."""
    if heating.size == N_NODE:
        return np.ascontiguousarray(transition), np.ascontiguousarray(heating)
    return np.array([[transition[0, 0], 0.0], [0.0, 0.0]]), np.array([heating[0], 0.0])


@compiled
def bearable_now(thermal: ThermalArrays, rises: Array) -> float:
    """A, of a magnet whose winding and core are so much (2,) K over ambient; inf where it is not guarded."""
    if not np.isfinite(thermal.limit):
        return np.inf
    left = thermal.limit - (thermal.ahead[0] * rises[0] + thermal.ahead[1] * rises[1])
    if not left > 0.0:
        return 0.0
    hot = thermal.resistance * (1.0 + thermal.growth * thermal.limit)
    return float(np.sqrt(left / (thermal.ahead_heating * hot)))


@compiled
def warm(thermal: ThermalArrays, rises: Array, current: float) -> None:
    """Moves the rises (2,) K of a magnet over a period in which its coil carries a current in A."""
    loss = thermal.resistance * (1.0 + thermal.growth * rises[0]) * current * current
    winding = thermal.transition[0, 0] * rises[0] + thermal.transition[0, 1] * rises[1] + thermal.heating[0] * loss
    core = thermal.transition[1, 0] * rises[0] + thermal.transition[1, 1] * rises[1] + thermal.heating[1] * loss
    rises[0] = winding
    rises[1] = core
