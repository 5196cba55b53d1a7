"""A layer winding in a coil's window: which wire fits, how full the window is, and its resistance by two routes."""

import math
from dataclasses import dataclass
from typing import Literal

from msl_fem.actuator import Actuator, ECore
from msl_fem.errors import InputError
from msl_fem.files.quantity import format_quantity
from msl_fem.losses.round_wire import Grade, RoundWire, Series, wires
from msl_fem.materials.constants import REFERENCE_TEMPERATURE, resistivity

Packing = Literal["square", "orthocyclic"]
_SLACK = 1e-9  # of a wire's diameter: what rounding may take from a window that fits exactly


@dataclass(frozen=True)
class Layers:
    """How many turns of a wire lie in a window: `turns` a layer, from the leg outwards."""

    turns: tuple[int, ...]
    pitch: float
    """Distance in m between the middles of neighbouring layers."""

    @property
    def capacity(self) -> int:
        """Turns that fit in all."""
        return sum(self.turns)


def fitting_layers(outer_diameter: float, *, width: float, height: float, packing: Packing = "square") -> Layers:
    """The full layers of a wire in a window: layers lie along `height` and stand one on the other along `width`.

    square : each turn on top of the one below, pitch D.
    orthocyclic : each turn in the groove of two below, pitch D sqrt(3)/2; every other layer is half a turn aside and
    has one turn less where the height does not leave room for it (Wolf 1958; DIN 46431). On the side where the
    wire climbs to the next turn the layers stand as in the square packing: no room is taken off for that.

    Raises
    ------
    InputError : an unknown packing
    """
    if packing not in ("square", "orthocyclic"):
        raise InputError(f"packing '{packing}' is unknown; choose square or orthocyclic")
    slack = _SLACK * outer_diameter
    along = math.floor((height + slack) / outer_diameter)
    pitch = outer_diameter if packing == "square" else outer_diameter * math.sqrt(3) / 2
    if along < 1 or width + slack < outer_diameter:
        return Layers((), pitch)
    count = 1 + math.floor((width - outer_diameter + slack) / pitch)
    short = packing == "orthocyclic" and height + slack < (along + 0.5) * outer_diameter
    turns = tuple(along - (1 if short and n % 2 else 0) for n in range(count))
    return Layers(tuple(t for t in turns if t), pitch)


@dataclass(frozen=True)
class Winding:
    """A coil wound with a wire, turn by turn.

    Attributes
    ----------
    layers : turns a layer, from the leg outwards; the last may be part full
    capacity : turns that would fit
    turn_length : of each layer's turns in m
    window : width and height of the coil's window in m
    mean_turn_length : of the window's middle in m, what the fill factor's formula takes
    """

    wire: RoundWire
    packing: Packing
    layers: tuple[int, ...]
    capacity: int
    turn_length: tuple[float, ...]
    window: tuple[float, float]
    mean_turn_length: float

    @property
    def turns(self) -> int:
        return sum(self.layers)

    @property
    def fill_factor(self) -> float:
        """Copper over the window's section."""
        return self.turns * self.wire.section / (self.window[0] * self.window[1])

    @property
    def length(self) -> float:
        """Of the wire in m, without leads."""
        return sum(n * length for n, length in zip(self.layers, self.turn_length, strict=True))

    def resistance(self, temperature: float = REFERENCE_TEMPERATURE) -> float:
        """ohm at a temperature in K, from the wire's length and section."""
        return self.wire.resistance_per_length(temperature) * self.length

    def resistance_by_fill_factor(self, temperature: float = REFERENCE_TEMPERATURE) -> float:
        """ohm at a temperature in K by the second route, that of the actuator file: rho N^2 l_mean / (k_fill A).

        It takes the window's middle turn for all turns, hence a little more than `resistance` where the outer part of
        the window stays empty.
        """
        area = self.window[0] * self.window[1]
        return resistivity(temperature) * self.turns**2 * self.mean_turn_length / (self.fill_factor * area)


def wind(magnet: ECore, wire: RoundWire, *, packing: Packing = "square") -> Winding:
    """The coil of an E-core wound with a wire, layer on layer from the leg outwards.

    Raises
    ------
    InputError : the turns do not fit; the message says how many do
    """
    coil = magnet.coil
    fitting = fitting_layers(wire.outer_diameter, width=coil.width, height=coil.height, packing=packing)
    if fitting.capacity < coil.turns:
        raise InputError(
            f"{coil.turns} turns of {wire.name} (over all {format_quantity(wire.outer_diameter, 'm')}) do not fit the "
            f"coil's {coil.width * 1e3:g} mm by {coil.height * 1e3:g} mm, {fitting.capacity} do; "
            "take a thinner wire, fewer turns or a larger window"
        )
    layers, left = [], coil.turns
    for capacity in fitting.turns:
        layers.append(min(capacity, left))
        left -= layers[-1]
        if left == 0:
            break
    straight = 2 * (magnet.stack_depth + magnet.centre_leg_width)
    radii = (coil.leg_clearance + wire.outer_diameter / 2 + n * fitting.pitch for n in range(len(layers)))
    return Winding(
        wire=wire,
        packing=packing,
        layers=tuple(layers),
        capacity=fitting.capacity,
        turn_length=tuple(straight + 2 * math.pi * r for r in radii),
        window=(coil.width, coil.height),
        mean_turn_length=magnet.mean_turn_length,
    )


@dataclass(frozen=True)
class WireChoice:
    """The thickest wire that fits, and how far the stated fill factor is from it."""

    winding: Winding
    stated_fill_factor: float

    @property
    def fill_factor_ratio(self) -> float:
        """The winding's fill factor over the stated one: below 1, the file promises more copper than fits."""
        return self.winding.fill_factor / self.stated_fill_factor


def choose_wire(
    actuator: Actuator, *, series: Series = "metric", grade: Grade = 1, packing: Packing = "square"
) -> WireChoice:
    """The thickest wire of a series whose turns fit the coil of an actuator's E-core.

    Raises
    ------
    ActuatorError : the magnet is no E-core
    InputError : not even the thinnest wire fits; an unknown series, grade or packing
    """
    magnet, coil = actuator.e_core(), actuator.e_core().coil
    candidates = wires(series, grade=grade)
    for wire in reversed(candidates):
        room = fitting_layers(wire.outer_diameter, width=coil.width, height=coil.height, packing=packing)
        if room.capacity >= coil.turns:
            return WireChoice(wind(magnet, wire, packing=packing), coil.fill_factor)
    raise InputError(
        f"{coil.turns} turns do not fit the coil's {coil.width * 1e3:g} mm by {coil.height * 1e3:g} mm even with "
        f"{candidates[0].name}; take fewer turns or a larger window"
    )
