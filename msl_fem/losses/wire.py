"""Round enamelled wire, the layer winding of a coil, and its resistance to direct and to alternating current."""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from msl_fem.actuator import Actuator, MagnetKind
from msl_fem.computing.arrays import Array
from msl_fem.errors import InputError
from msl_fem.files.quantity import format_quantity
from msl_fem.materials.constants import MU_0, REFERENCE_TEMPERATURE, resistivity

Grade = Literal[1, 2]
Series = Literal["metric", "awg"]

# conductor, largest overall diameter at grade 1, at grade 2; mm. Preferred diameters (R20) of IEC 60317-0-1, table 1
_SIZES = (
    (0.050, 0.060, 0.066), (0.056, 0.067, 0.074), (0.063, 0.076, 0.083), (0.071, 0.084, 0.091), (0.080, 0.094, 0.101),
    (0.090, 0.105, 0.113), (0.100, 0.117, 0.125), (0.112, 0.130, 0.139), (0.125, 0.144, 0.154), (0.140, 0.160, 0.171),
    (0.160, 0.182, 0.194), (0.180, 0.204, 0.217), (0.200, 0.226, 0.239), (0.224, 0.252, 0.266), (0.250, 0.281, 0.297),
    (0.280, 0.312, 0.329), (0.315, 0.349, 0.367), (0.355, 0.392, 0.411), (0.400, 0.439, 0.459), (0.450, 0.491, 0.513),
    (0.500, 0.544, 0.566), (0.560, 0.606, 0.630), (0.630, 0.679, 0.704), (0.710, 0.762, 0.789), (0.800, 0.855, 0.884),
    (0.900, 0.959, 0.989), (1.000, 1.062, 1.094), (1.120, 1.184, 1.217), (1.250, 1.316, 1.349), (1.400, 1.468, 1.502),
    (1.600, 1.670, 1.706), (1.800, 1.872, 1.909), (2.000, 2.074, 2.112), (2.240, 2.316, 2.355), (2.500, 2.578, 2.618),
    (2.800, 2.880, 2.922), (3.150, 3.233, 3.276), (3.550, 3.635, 3.679), (4.000, 4.088, 4.133), (4.500, 4.591, 4.637),
    (5.000, 5.093, 5.141),
)  # fmt: skip
THINNEST_GAUGE, THICKEST_GAUGE = 44, 4  # 0.050 ... 5.19 mm: about the range of the metric sizes
_SLACK = 1e-9  # of a wire's diameter: what rounding may take from a window that fits exactly
NEGLIGIBLE = 0.01  # of the resistance: what the copper's own tolerance hides


@dataclass(frozen=True)
class RoundWire:
    """An enamelled round copper wire.

    Attributes
    ----------
    name : "0.71 mm" or "AWG 21"
    diameter : of the copper, m
    outer_diameter : the largest over the insulation, m
    grade : of the insulation, IEC 60317-0-1
    """

    name: str
    diameter: float
    outer_diameter: float
    grade: Grade

    @property
    def section(self) -> float:
        """Cross section of the copper in m2."""
        return math.pi * self.diameter**2 / 4

    def resistance_per_length(self, temperature: float = REFERENCE_TEMPERATURE) -> float:
        """ohm/m at a temperature in K; InputError outside copper's range."""
        return resistivity(temperature) / self.section


def _grade_column(grade: int) -> int:
    if grade not in (1, 2):
        raise InputError(f"insulation grade {grade} is not known; choose 1 (thin) or 2 (thick)")
    return grade


def metric_wire(diameter: float, *, grade: Grade = 1) -> RoundWire:
    """The wire of a copper diameter in m that IEC 60317-0-1 prefers.

    Raises
    ------
    InputError : a diameter that is not preferred (the message names the two beside it), or an unknown grade
    """
    column = _grade_column(grade)
    for row in _SIZES:
        if abs(row[0] * 1e-3 - diameter) <= 1e-6 * diameter:
            return RoundWire(f"{row[0]:g} mm", row[0] * 1e-3, row[column] * 1e-3, grade)
    beside = [row[0] for row in _SIZES if 0.85 < row[0] * 1e-3 / diameter < 1.15]
    if not beside:
        beside = [_SIZES[0][0], _SIZES[-1][0]]
    raise InputError(
        f"a wire of {diameter * 1e3:g} mm is no preferred size; near it are {', '.join(map(str, beside))} mm"
    )


def gauge_diameter(gauge: int) -> float:
    """Copper diameter in m of an American wire gauge: 0.127 mm 92^((36 - n)/39), by definition (ASTM B258)."""
    return 0.127e-3 * 92.0 ** ((36 - gauge) / 39)


def gauge_wire(gauge: int, *, grade: Grade = 1) -> RoundWire:
    """The wire of an American wire gauge with an insulation of a grade of IEC 60317-0-1.

    The insulation's build is that of the next larger preferred diameter, as the standard has it for sizes between.

    Raises
    ------
    InputError : a gauge outside 4 ... 44, or an unknown grade
    """
    column = _grade_column(grade)
    if not THICKEST_GAUGE <= gauge <= THINNEST_GAUGE:
        raise InputError(f"AWG {gauge} is not allowed; it must be {THICKEST_GAUGE} ... {THINNEST_GAUGE}")
    diameter = gauge_diameter(gauge)
    larger = next((row for row in _SIZES if row[0] * 1e-3 >= diameter), _SIZES[-1])
    build = (larger[column] - larger[0]) * 1e-3
    return RoundWire(f"AWG {gauge}", diameter, diameter + build, grade)


def wires(series: Series = "metric", *, grade: Grade = 1) -> tuple[RoundWire, ...]:
    """All wires of a series, the thinnest first; InputError for an unknown series or grade."""
    if series == "metric":
        return tuple(metric_wire(row[0] * 1e-3, grade=grade) for row in _SIZES)
    if series == "awg":
        return tuple(gauge_wire(n, grade=grade) for n in range(THINNEST_GAUGE, THICKEST_GAUGE - 1, -1))
    raise InputError(f"wire series '{series}' is unknown; choose metric or awg")


Packing = Literal["square", "orthocyclic"]


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
    """Equal coils in series, wound with a wire turn by turn.

    Attributes
    ----------
    layers : of one coil: turns a layer, from the leg outwards; the last may be part full
    capacity : turns of one coil that would fit
    turn_length : of each layer's turns in m
    window : width and height of the coil's window in m
    mean_turn_length : of the window's middle in m, what the fill factor's formula takes
    coils : in series
    """

    wire: RoundWire
    packing: Packing
    layers: tuple[int, ...]
    capacity: int
    turn_length: tuple[float, ...]
    window: tuple[float, float]
    mean_turn_length: float
    coils: int = 1

    @property
    def turns(self) -> int:
        """Of all coils."""
        return self.coils * sum(self.layers)

    @property
    def fill_factor(self) -> float:
        """Copper over the window's section."""
        return self.turns * self.wire.section / (self.coils * self.window[0] * self.window[1])

    @property
    def length(self) -> float:
        """Of the wire in m, without leads."""
        return self.coils * sum(n * length for n, length in zip(self.layers, self.turn_length, strict=True))

    def resistance(self, temperature: float = REFERENCE_TEMPERATURE) -> float:
        """ohm at a temperature in K, from the wire's length and section."""
        return self.wire.resistance_per_length(temperature) * self.length

    def resistance_by_fill_factor(self, temperature: float = REFERENCE_TEMPERATURE) -> float:
        """ohm at a temperature in K by the second route, that of the actuator file: rho N^2 l_mean / (k_fill A).

        It takes the window's middle turn for all turns, hence a little more than `resistance` where the outer part of
        the window stays empty.
        """
        area = self.coils * self.window[0] * self.window[1]
        return resistivity(temperature) * self.turns**2 * self.mean_turn_length / (self.fill_factor * area)


def wind(magnet: MagnetKind, wire: RoundWire, *, packing: Packing = "square") -> Winding:
    """One of a magnet's coils wound with a wire, layer on layer from the leg outwards.

    Raises
    ------
    InputError : the turns do not fit; the message says how many do
    """
    coil, space = magnet.coil, magnet.winding_space
    turns = coil.turns // space.coils
    fitting = fitting_layers(wire.outer_diameter, width=coil.width, height=coil.height, packing=packing)
    if fitting.capacity < turns:
        raise InputError(
            f"{turns} turns of {wire.name} (over all {format_quantity(wire.outer_diameter, 'm')}) do not fit the "
            f"coil's {coil.width * 1e3:g} mm by {coil.height * 1e3:g} mm, {fitting.capacity} do; "
            "take a thinner wire, fewer turns or a larger window"
        )
    layers: list[int] = []
    left = turns
    for capacity in fitting.turns:
        layers.append(min(capacity, left))
        left -= layers[-1]
        if left == 0:
            break
    distances = (space.clearance + wire.outer_diameter / 2 + n * fitting.pitch for n in range(len(layers)))
    return Winding(
        wire=wire,
        packing=packing,
        layers=tuple(layers),
        capacity=fitting.capacity,
        turn_length=tuple(space.turn_length(distance) for distance in distances),
        window=(coil.width, coil.height),
        mean_turn_length=magnet.mean_turn_length,
        coils=space.coils,
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
    """The thickest wire of a series whose turns fit the coils of an actuator's magnet.

    Raises
    ------
    ActuatorError : the magnet's dimensions are not known
    InputError : not even the thinnest wire fits; an unknown series, grade or packing
    """
    magnet = actuator.magnet_kind("the choice of a wire")
    coil = magnet.coil
    turns = coil.turns // magnet.winding_space.coils
    candidates = wires(series, grade=grade)
    for wire in reversed(candidates):
        room = fitting_layers(wire.outer_diameter, width=coil.width, height=coil.height, packing=packing)
        if room.capacity >= turns:
            return WireChoice(wind(magnet, wire, packing=packing), coil.fill_factor)
    raise InputError(
        f"{turns} turns do not fit the coil's {coil.width * 1e3:g} mm by {coil.height * 1e3:g} mm even with "
        f"{candidates[0].name}; take fewer turns or a larger window"
    )


@dataclass(frozen=True)
class SlotRows:
    """The winding as the one-dimensional slot sees it: `rows` of `abreast` wires, from the yoke to the pole faces."""

    rows: int
    abreast: float
    breadth: float
    """Of the slot across which the leakage field runs, in m."""
    diameter: float


def slot_rows(winding: Winding, magnet: MagnetKind) -> SlotRows:
    """The rows of a winding in the window of a magnet.

    The window is a slot between two legs that opens at the pole faces. Its leakage field runs across, from leg to leg,
    and grows from nothing at the yoke to N i / w at the last row (Field 1905; Emde 1908): what Dowell calls a layer
    is here one row of wires across the window, and there are as many rows as turns in a layer along the leg.
    """
    rows = max(winding.layers)
    return SlotRows(rows, winding.turns / rows, magnet.winding_space.slot_width, winding.wire.diameter)


def skin_depth(frequency: ArrayLike, temperature: float = REFERENCE_TEMPERATURE) -> Array:
    """delta in m at frequencies in Hz: sqrt(rho / (pi f mu_0)); inf at 0."""
    f = np.asarray(frequency, dtype=float)
    with np.errstate(divide="ignore"):
        return np.asarray(np.sqrt(resistivity(temperature) / (math.pi * MU_0 * f)))


def resistance_factor(rows: SlotRows, frequency: ArrayLike, *, temperature: float = REFERENCE_TEMPERATURE) -> Array:
    """R_ac/R_dc at frequencies in Hz, of the shape given; 1 at 0.

    Each row of round wires becomes a foil of the same section, of height h = d sqrt(pi)/2 and of the conductivity
    times eta = abreast h / breadth; with D = h sqrt(eta)/delta and p rows (Dowell, Proc. IEE 113, 1966, eq. 10)

        F = D [ (sinh 2D + sin 2D)/(cosh 2D - cos 2D) + 2 (p^2 - 1)/3 (sinh D - sin D)/(cosh D + cos D) ].

    The fringe of the air gap is not in it: turns close to the pole faces have more.

    Raises
    ------
    InputError : a negative frequency or one that is not a number
    """
    f = np.asarray(frequency, dtype=float)
    if not (f >= 0).all() or not np.isfinite(f).all():
        raise InputError(f"frequencies must be finite and not negative, these are {np.unique(f)[:3].tolist()} Hz")
    height = rows.diameter * math.sqrt(math.pi) / 2
    porosity = min(rows.abreast * height / rows.breadth, 1.0)
    ratio = height * math.sqrt(porosity) / skin_depth(f, temperature)
    x = np.minimum(ratio, 300.0)  # cosh 600 is near the end of floats
    low = x < 0.05  # the quotients lose digits there: their series to x^4, exact to 1e-9
    y = np.where(low, 1.0, x)
    skin = y * (np.sinh(2 * y) + np.sin(2 * y)) / (np.cosh(2 * y) - np.cos(2 * y))
    proximity = y * (np.sinh(y) - np.sin(y)) / (np.cosh(y) + np.cos(y))
    skin = np.where(low, 1 + 4 * x**4 / 45, skin)
    proximity = np.where(low, x**4 / 6, proximity)
    return np.asarray(skin + 2 * (rows.rows**2 - 1) / 3 * proximity)


def negligible_below(rows: SlotRows, *, temperature: float = REFERENCE_TEMPERATURE, share: float = NEGLIGIBLE) -> float:
    """The frequency in Hz up to which R_ac exceeds R_dc by less than `share`."""
    low, high = 1e-3, 1e9
    for _ in range(80):
        middle = math.sqrt(low * high)
        if float(resistance_factor(rows, middle, temperature=temperature)) - 1 < share:
            low = middle
        else:
            high = middle
    return low
