"""The film of air or oil that is squeezed between pole faces and armature.

Reynolds' equation for an incompressible film between a plate w by l (w <= l) and a flat face, with ambient pressure at
the edges, gives the force c(g) v with

    c = eta w^3 l b(w/l)/g^3,   b = 1 - (192/pi^5) (w/l) sum over odd n of tanh(n pi l/(2 w))/n^5

(Hays, J. Basic Eng. 83, 1961; b -> 1 for a long plate, 0.4217 for a square). It is incompressible where the squeeze
number 12 eta omega w^2/(p_a g^2) is small (Blech, J. Lubr. Technol. 105, 1983), and free of cavitation where the peak
pressure, about 1.5 c v/(w l), stays below p_a; `film_numbers` gives both, and the bench's effect keeps to both.
"""

import math

from msl_fem.actuator import Actuator, ECore
from msl_fem.bench.plant import Film
from msl_fem.computing.compiled import compiled

AIR_VISCOSITY = 1.81e-5  # Pa s at 20 degC
AMBIENT_PRESSURE = 1.013e5  # Pa
_TERMS = 40


@compiled
def film_damping(film: Film, gap: float) -> float:
    """N s/m of a side at its gap: as the inverse cube."""
    ratio = film.gap / gap
    return film.damping * ratio * ratio * ratio


def finite_length(width: float, length: float) -> float:
    """The factor b of a rectangle against an endlessly long plate; the shorter side counts as its width."""
    w, l = min(width, length), max(width, length)  # noqa: E741 - the textbook's letters
    total = sum(math.tanh(n * math.pi * l / (2 * w)) / n**5 for n in range(1, 2 * _TERMS, 2))
    return 1 - 192 / math.pi**5 * (w / l) * total


def plate_damping(width: float, length: float, *, gap: float, viscosity: float = AIR_VISCOSITY) -> float:
    """c in N s/m of a rectangle (m) at a gap (m) in a film of a viscosity (Pa s)."""
    w, l = min(width, length), max(width, length)  # noqa: E741
    return viscosity * w**3 * l * finite_length(w, l) / gap**3


def faces(actuator: Actuator) -> tuple[tuple[float, float], ...]:
    """Width and length in m of the pole faces of a side; none where the magnet's shape is not known."""
    if not isinstance(actuator.magnet, ECore) or actuator.sides is None:
        return ()
    m = actuator.magnet
    one = [(m.centre_leg_width, m.stack_depth)] + 2 * [(m.outer_leg_width, m.stack_depth)]
    return tuple(one * actuator.sides.magnets_per_side)


def film_numbers(
    actuator: Actuator, damping: float, *, gap: float, velocity: float, frequency: float
) -> dict[str, float]:
    """Viscosity (Pa s), squeeze number and peak pressure over ambient that a side's damping (N s/m) at `gap` means.

    `velocity` (m/s) and `frequency` (rad/s) are the largest of the motion. Empty where the faces are not known.
    """
    plates = faces(actuator)
    if not plates:
        return {}
    viscosity = damping / sum(plate_damping(*plate, gap=gap, viscosity=1.0) for plate in plates)
    widest = max(plates, key=lambda plate: plate_damping(*plate, gap=gap, viscosity=1.0))
    share = plate_damping(*widest, gap=gap, viscosity=viscosity)
    return {
        "viscosity": viscosity,
        "squeeze_number": 12 * viscosity * frequency * min(widest) ** 2 / (AMBIENT_PRESSURE * gap**2),
        "peak_pressure": 1.5 * share * velocity / (widest[0] * widest[1]) / AMBIENT_PRESSURE,
    }
