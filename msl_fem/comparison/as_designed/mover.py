"""Leaves that stretch, and the film of air between the faces."""

import math

from msl_fem.actuator import Actuator, MagnetKind
from msl_fem.errors import InputError
from msl_fem.materials.constants import AIR_VISCOSITY
from msl_fem.plant.believed import BelievedValue
from msl_fem.table.magnetic_table import MagneticTable

CLAMPS = 0.1
"""Relative sigma of the leaves' cubic stiffness: clamps and frame give way to the tension by some per cent."""
FILM = 0.2  # of the film's damping: the air escapes at the coil's face and between the legs
_TERMS = 12


def hardening_of_leaves(actuator: Actuator) -> tuple[BelievedValue, ...]:
    """The cubic stiffness of leaves that hold each other's ends; none without leaves, or where they can shorten."""
    motion = actuator.motion
    if motion is None or motion.flexure is None or not motion.flexure.cubic_stiffness:
        return ()
    cubic = motion.flexure.cubic_stiffness
    source = "motion.flexure: k_3 = 18/25 E A / L^3 of each leaf (actuator.leaf), clamps that give way a little"
    return (BelievedValue("stiffness_nonlinearity", "cubic", cubic, CLAMPS * cubic, source),)


def plate_film_damping(width: float, length: float, *, gap: float) -> float:
    """c in N s/m of the air between a rectangular face (m) and a plate at a gap (m), Reynolds' equation.

    c = mu l b^3 / g^3 (1 - 192/pi^5 b/l sum tanh(n pi l/(2 b))/n^5), n odd, b the shorter side: Hamrock,
    Fundamentals of Fluid Film Lubrication, 1994, ch. 13; mu of air at 20 degC.
    """
    b, long = min(width, length), max(width, length)
    odd = range(1, 2 * _TERMS, 2)
    ends = sum(math.tanh(n * math.pi * long / (2 * b)) / n**5 for n in odd)
    return AIR_VISCOSITY * long * b**3 / gap**3 * (1 - 192 / math.pi**5 * b / long * ends)


def film_of_faces(actuator: Actuator, table: MagneticTable) -> tuple[BelievedValue, ...]:
    """The damping of each side's film of air at the nominal gap.

    Raises
    ------
    InputError : the faces are not known
    """
    magnet, motion = actuator.magnet, actuator.motion
    faces = magnet.pole_faces if isinstance(magnet, MagnetKind) else ()
    if not faces or motion is None or motion.nominal_gap is None or actuator.sides is None:
        raise InputError("the pole faces of this magnet are not known as rectangles")
    gap = motion.nominal_gap
    side = actuator.sides.magnets_per_side * sum(plate_film_damping(*face, gap=gap) for face in faces)
    source = "pole faces at the nominal gap in air: Reynolds' equation of a rectangle"
    return (BelievedValue("squeeze_film", "damping", side, FILM * side, source),)
