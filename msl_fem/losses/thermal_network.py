"""Where a magnet's heat goes, and how hot it gets: winding and core as two nodes, or one with a stated resistance.

The winding's resistance grows with its temperature; temperatures are steady ones, or those over a duty cycle.
"""

import math
from dataclasses import dataclass

import numpy as np

from msl_fem.actuator import Actuator, MagnetKind
from msl_fem.computing.arrays import Array
from msl_fem.errors import ComputationError, InputError
from msl_fem.materials.constants import (
    COPPER_DENSITY,
    COPPER_SPECIFIC_HEAT,
    REFERENCE_TEMPERATURE,
    TEMPERATURE_COEFFICIENT,
)

IRON_DENSITY, IRON_SPECIFIC_HEAT = 7650.0, 460.0
"""kg/m3, J/(kg K) of silicon steel (Bozorth, Ferromagnetism, 1951, table of iron-silicon alloys)."""

COPPER_CONDUCTIVITY = 400.0  # W/(m K), Incropera and DeWitt, table A.1
SMALLEST_DUTY = 1e-4


@dataclass(frozen=True)
class Cooling:
    """How a magnet is cooled, in W, m and K.

    Attributes
    ----------
    heat_transfer_coefficient : of all free surfaces, W/(m2 K). 10: about 5 by natural convection from surfaces of this
        size and 5 by radiation from a painted one (Incropera and DeWitt, ch. 9 and 12: gases 2 ... 25)
    insulation_conductivity : between coil and leg, and between the wires, W/(m K). 0.2: varnish and liner (Staton,
        Boglietti and Cavagnino, IEEE Trans. Energy Conversion 20, 2005)
    thermal_resistance : K/W from winding to ambient; where stated, nothing else is used
    """

    heat_transfer_coefficient: float = 10.0
    insulation_conductivity: float = 0.2
    thermal_resistance: float | None = None

    def __post_init__(self) -> None:
        for name, unit, low, high in (
            ("heat_transfer_coefficient", "W/(m2 K)", 0.1, 1e5),
            ("insulation_conductivity", "W/(m K)", 0.01, 100.0),
            ("thermal_resistance", "K/W", 1e-4, 1e6),
        ):
            value = getattr(self, name)
            if value is not None and not low <= value <= high:
                words = name.replace("_", " ")
                allowed = f"{low:g} ... {high:g} {unit}"
                raise InputError(f"a {words} of {value:g} {unit} is not allowed; it must be {allowed}")


@dataclass(frozen=True, eq=False)
class ThermalNetwork:
    """Nodes with heat capacities, joined to one another and to the ambient; the first node is the winding.

    Attributes
    ----------
    names : of the nodes
    capacity : (n_node,) J/K; nan where not known
    conductance : (n_node, n_node) W/K: heat leaving each node is this times the rises over ambient
    notes : on what grounds
    """

    names: tuple[str, ...]
    capacity: Array
    conductance: Array
    notes: tuple[str, ...]

    @property
    def resistance(self) -> float:
        """K/W: the winding's rise for each watt in the winding."""
        return float(np.linalg.inv(self.conductance)[0, 0])

    @property
    def core_resistance(self) -> float:
        """K/W: the winding's rise for each watt in the last node, the core."""
        return float(np.linalg.inv(self.conductance)[0, -1])

    @property
    def time_constants(self) -> Array:
        """(n_node,) s, the longest first, at constant resistance; nan where a heat capacity is not known."""
        if not np.isfinite(self.capacity).all():
            return np.full(self.capacity.size, math.nan)
        root = np.sqrt(self.capacity)
        return np.asarray(1 / np.linalg.eigvalsh(self.conductance / np.outer(root, root)))


def thermal_network(actuator: Actuator, cooling: Cooling) -> ThermalNetwork:
    """The network of one magnet.

    With a stated resistance: one node with the heat capacity of the copper alone (not known
    where the coil is not), so that a peak within a cycle is not taken too low. Else two nodes:

    - winding to core: conduction through the clearance to the leg, filled with insulation, and from the coil's
      mean temperature to that face, width/(3 k A), the coil's heat being even over its section. Its conductivity
      across the wires is k_i ((1 + f) k_cu + (1 - f) k_i)/((1 - f) k_cu + (1 + f) k_i) at the fill factor f
      (Hashin and Shtrikman, J. Appl. Phys. 33, 1962);
    - winding to ambient: the end turns' surface; core to ambient: its surface outside the window.

    The armature, what the core is mounted on, and the coil's other faces carry no heat away.

    Raises
    ------
    InputError : the magnet's surfaces are not known and no thermal resistance is stated
    """
    magnet = actuator.magnet
    if cooling.thermal_resistance is not None:
        known = isinstance(magnet, MagnetKind) and magnet.own_mesh() is None
        capacity = winding_capacity(magnet) if isinstance(magnet, MagnetKind) and known else math.nan
        note = f"stated thermal resistance of {cooling.thermal_resistance:g} K/W, winding to ambient"
        return ThermalNetwork(("winding",), np.array([capacity]), np.array([[1 / cooling.thermal_resistance]]), (note,))
    if not isinstance(magnet, MagnetKind) or magnet.core_surface is None:
        raise InputError(
            f"{actuator.name}: the cooling of this magnet is not known, as its surfaces are not; state it, like "
            '--thermal-resistance "2 K/W"'
        )
    h = cooling.heat_transfer_coefficient
    between = 1 / winding_to_core_resistance(magnet, cooling)
    ends = h * end_turn_surface(magnet)
    surface = h * magnet.core_surface
    turns = f"end turns to ambient {1 / ends:.3g} K/W" if ends else "no turns outside the core"
    return ThermalNetwork(
        ("winding", "core"),
        np.array([winding_capacity(magnet), core_capacity(magnet)]),
        np.array([[between + ends, -between], [-between, between + surface]]),
        (
            f"two nodes: winding to core {1 / between:.3g} K/W through insulation of "
            f"{cooling.insulation_conductivity:g} W/(m K), {turns} and core to ambient "
            f"{1 / surface:.3g} K/W at {h:g} W/(m2 K); no heat goes into what the core is mounted on",
        ),
    )


def winding_conductivity(fill_factor: float, insulation: float) -> float:
    """W/(m K) across round wires of a fill factor in an insulation: Hashin and Shtrikman's lower bound (1962)."""
    f, k, i = fill_factor, COPPER_CONDUCTIVITY, insulation
    return i * ((1 + f) * k + (1 - f) * i) / ((1 - f) * k + (1 + f) * i)


def winding_to_core_resistance(magnet: MagnetKind, cooling: Cooling) -> float:
    """K/W from the winding's mean temperature to the legs that it encloses, all around them."""
    space = magnet.winding_space
    area = space.coils * space.perimeter * space.height
    across = winding_conductivity(magnet.coil.fill_factor, cooling.insulation_conductivity)
    return (space.clearance / cooling.insulation_conductivity + space.width / (3 * across)) / area


def end_turn_surface(magnet: MagnetKind) -> float:
    """m2 of the coils outside the window: their outer face and both edges, along the turns there."""
    space = magnet.winding_space
    return space.coils * space.exposed * (space.height + 2 * space.width)


def winding_capacity(magnet: MagnetKind) -> float:
    """J/K of the copper."""
    return COPPER_DENSITY * COPPER_SPECIFIC_HEAT * magnet.copper_volume


def core_capacity(magnet: MagnetKind) -> float:
    """J/K of the core's iron."""
    section = magnet.section(0.1 * magnet.half_width)
    core = sum(section.part_volume(part) for part in section.parts if part.region != "armature")
    return IRON_DENSITY * IRON_SPECIFIC_HEAT * core


class ThermalRunaway(ComputationError):  # noqa: N818 - reads as the sentence it stands for
    """No finite temperature balances the loss, which grows with it."""


@dataclass(frozen=True)
class Heating:
    """What heats a network.

    Attributes
    ----------
    resistance : of the winding in ohm at 20 degC
    ambient : K
    core_loss : W in the last node while the current flows
    """

    resistance: float
    ambient: float = REFERENCE_TEMPERATURE
    core_loss: float = 0.0

    @property
    def ambient_resistance(self) -> float:
        """ohm with the winding at ambient temperature."""
        return self.resistance * (1 + TEMPERATURE_COEFFICIENT * (self.ambient - REFERENCE_TEMPERATURE))


@dataclass(frozen=True)
class Cycle:
    """Current for `duty` of each period in s, none for the rest; a period of None is short against everything."""

    duty: float = 1.0
    period: float | None = None

    def __post_init__(self) -> None:
        if not SMALLEST_DUTY <= self.duty <= 1:
            raise InputError(f"a duty of {self.duty:g} is not allowed; it must be {SMALLEST_DUTY:g} ... 1")
        if self.period is not None and not 0 < self.period < math.inf:
            raise InputError(f"a period of {self.period:g} s is not allowed; it must be above 0, or left out")


def runaway_current(network: ThermalNetwork, heating: Heating) -> float:
    """The direct current in A from which on no finite temperature balances the loss.

    The loss grows by i^2 R_20 alpha a kelvin, the heat carried away by 1/R_th: beyond i = 1/sqrt(R_20 alpha R_th).
    """
    return 1 / math.sqrt(heating.resistance * TEMPERATURE_COEFFICIENT * network.resistance)


def steady_rise(network: ThermalNetwork, heating: Heating, current_rms: float) -> Array:
    """(n_node,) K over ambient with a steady RMS current in A, the resistance being that at the winding's temperature.

    Raises
    ------
    ThermalRunaway : there is no finite equilibrium; the message says from which current on
    """
    limit = runaway_current(network, heating)
    if not current_rms < limit:
        raise ThermalRunaway(
            f"{current_rms:.4g} A heats the winding without end: its resistance grows with its temperature, and from "
            f"{limit:.4g} A on no temperature balances the loss; give a smaller current or a better cooling"
        )
    matrix, source = _matrix_and_source(network, heating, current_rms)
    return np.asarray(np.linalg.solve(matrix, source))


def _matrix_and_source(network: ThermalNetwork, heating: Heating, current: float) -> tuple[Array, Array]:
    """G with the resistance's growth taken off the winding, W/K, and the heat at zero rise, W."""
    matrix = network.conductance.copy()
    matrix[0, 0] -= current**2 * heating.resistance * TEMPERATURE_COEFFICIENT
    source = np.zeros(network.capacity.size)
    source[0] = current**2 * heating.ambient_resistance
    source[-1] += heating.core_loss
    return matrix, source


def peak_rise(network: ThermalNetwork, heating: Heating, current: float, *, cycle: Cycle) -> float:
    """K over ambient that the winding reaches at the end of each on phase, once the cycle repeats; inf on runaway.

    current : A (RMS) while it flows

    Both phases are linear in the temperatures, dx/dt = C^-1 (s - M x), and solved exactly; the periodic state is the
    fixed point of their composition. A period of None: the mean loss at a steady temperature, current sqrt(duty).

    Raises
    ------
    InputError : a period with heat capacities that are not known
    """
    if cycle.period is None or cycle.duty == 1.0:
        mean = Heating(heating.resistance, heating.ambient, heating.core_loss * cycle.duty)
        try:
            return float(steady_rise(network, mean, current * math.sqrt(cycle.duty))[0])
        except ThermalRunaway:
            return math.inf
    if not np.isfinite(network.capacity).all():
        raise InputError(
            "the winding's heat capacity is not known, so a period cannot be judged; leave --period out, or describe "
            "the magnet by its dimensions"
        )
    on = phase_transition(network, *_matrix_and_source(network, heating, current), cycle.duty * cycle.period)
    if on is None:
        return math.inf
    idle = Heating(heating.resistance, heating.ambient)
    off = phase_transition(network, *_matrix_and_source(network, idle, 0.0), (1 - cycle.duty) * cycle.period)
    assert off is not None  # without current nothing grows
    around = on @ off  # from the end of an on phase to the next one
    n = network.capacity.size
    if np.abs(np.linalg.eigvals(around[:n, :n])).max() >= 1:
        return math.inf
    return float(np.linalg.solve(np.eye(n) - around[:n, :n], around[:n, n])[0])


def phase_transition(network: ThermalNetwork, matrix: Array, source: Array, duration: float) -> Array | None:
    """(n_node + 1, n_node + 1): takes (rises, 1) at the beginning of a phase to those at its end; None beyond e^200."""
    n = source.size
    rates = np.zeros((n + 1, n + 1))
    rates[:n, :n] = -matrix / network.capacity[:, None]
    rates[:n, n] = source / network.capacity
    if float(np.linalg.eigvals(rates[:n, :n]).real.max()) * duration > 200:
        return None
    from scipy.linalg import expm

    return np.asarray(expm(rates * duration))
