"""Round enamelled copper wire: metric sizes, American gauges, build of the insulation, resistance."""

import math
from dataclasses import dataclass
from typing import Literal

from msl_fem.errors import InputError
from msl_fem.materials.constants import REFERENCE_TEMPERATURE, resistivity

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
    beside = [row[0] for row in _SIZES if 0.85 < row[0] * 1e-3 / diameter < 1.15] or [_SIZES[0][0], _SIZES[-1][0]]
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
