"""The classical design equations of an E-core: a magnetic circuit of gaps, fringes, leakage and iron.

Per metre of depth, with the magnetomotive force U across the two gaps in series (Roters, Electromagnetic Devices, 1941;
the form is that of Gutierrez and Ro, 1998, eq. for Phi_avg, with both gaps written as permeances):

    P_c = mu_0 (c/g + 2 f(h_c/g)),     P_o = 2 mu_0 (o/g + f(h_o/g) + f(2 a/g)/2),     P = P_c P_o/(P_c + P_o)
    Phi = P U,     F = -U^2/2 dP/dg,     B_k = Phi_k/(s t_k),     N i = U + sum H(B_k) l_k

Without the fringes f and with o = c/2 the force is B^2 (c + 2 o)/(2 mu_0), Maxwell's.

- Fringe: f(h/g) is the permeance of the side face of a pole to the armature before it, up to the height h (Schwarz and
  Christoffel, `end_effects.corner_excess`; Roters' half cylinder and half shell are its estimate). h is the geometric
  mean of the heights at which the magnetomotive force between leg and armature is lost along the coil, and at most
  2 w/pi, where the tubes lead to the next leg. On the outer side pole and armature end flush (two corners in series).
- Leakage: across the window of the width w the magnetomotive force is U from the pole faces to the coil and falls along
  it to nothing, Phi_l = mu_0 U/w times its integral; near the pole faces the tubes lead to the armature instead, so
  that the share min(1, (pi y/2)/w) is taken, y the height (as in `end_effects`). What leaves below mid-height crosses
  the middle of the legs, all of it the yoke.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from msl_fem.actuator import ECore
from msl_fem.design.sizing.design import PlanePoint
from msl_fem.magnetics.field.end_effects import corner_excess
from msl_fem.materials.constants import MU_0
from msl_fem.materials.material import AnalyticIron, Iron

Irons = tuple[Iron | AnalyticIron, Iron | AnalyticIron]
"""Core and armature, as laminated (`material.laminated`)."""


@dataclass(frozen=True)
class Factors:
    """Which corrections the circuit has; without both it is the textbook's uniform gap."""

    fringing: bool = True
    leakage: bool = True


@dataclass(frozen=True)
class GapPermeance:
    """P/mu_0 per metre of depth of both gaps in series, its derivative with respect to the gap, and without fringes."""

    value: float
    slope: float
    plain: float


@dataclass(frozen=True)
class MagneticCircuit:
    """The circuit of a section at a flux density.

    Attributes
    ----------
    point : what it says per metre of depth
    flux : by section, of one side of the core per metre of depth, over mu_0 times the gaps' magnetomotive force
    gap_share : of the magnetomotive force across the gaps, the rest drives the iron
    fringing : gap permeance over that of the pole faces alone
    leakage : flux in the yoke over that through the gaps
    """

    point: PlanePoint
    flux: dict[str, float]
    gap_share: float
    fringing: float
    leakage: float


@dataclass(frozen=True)
class _Part:
    """A part of the iron: thickness that one side's flux has, stacking factor, curve, length of the path in it."""

    thickness: float
    stacking: float
    iron: Iron | AnalyticIron
    length: float


def _parts(magnet: ECore, irons: Irons) -> dict[str, _Part]:
    leg = magnet.window_height + magnet.yoke_thickness / 2
    across = magnet.window_width + magnet.centre_leg_width / 4 + magnet.outer_leg_width / 2
    core = magnet.iron.core_stacking, irons[0]
    return {
        "centre_leg": _Part(magnet.centre_leg_width / 2, *core, leg),
        "yoke": _Part(magnet.yoke_thickness, *core, across),
        "outer_leg": _Part(magnet.outer_leg_width, *core, leg),
        "armature": _Part(magnet.armature_thickness, magnet.iron.armature_stacking, irons[1], across),
    }


def closed_form(
    magnet: ECore, irons: Irons, gap: float, flux_density: float, *, factors: Factors | None = None
) -> MagneticCircuit:
    """The circuit whose most loaded section carries `flux_density` (T, in the iron); the magnet's depth is not used."""
    factors = factors or Factors()
    permeance = gap_permeance(magnet, gap, fringing=factors.fringing)
    middle, whole, linkage = window_leakage(magnet) if factors.leakage else (0.0, 0.0, 0.0)
    half = permeance.value / 2
    flux = {"centre_leg": half + middle, "yoke": half + whole, "outer_leg": half + middle, "armature": half}
    parts = _parts(magnet, irons)
    per_ampere = {name: MU_0 * flux[name] / (part.stacking * part.thickness) for name, part in parts.items()}
    section = max(per_ampere, key=per_ampere.__getitem__)
    drive = flux_density / per_ampere[section]
    drop = 0.0
    for iron in irons if irons[0] is not irons[1] else irons[:1]:  # all parts of a curve at once
        mine = {name: part for name, part in parts.items() if part.iron is iron}
        averaged = np.array([part.stacking * drive * per_ampere[name] for name, part in mine.items()])
        drop += float(iron.magnetise(averaged)[0] @ [part.length for part in mine.values()])
    ampere_turns = drive + drop
    force = -MU_0 * permeance.slope * drive**2 / 2
    point = PlanePoint(
        ampere_turns=ampere_turns,
        force=force,
        force_slope=2 * force / ampere_turns,
        inductance=MU_0 * (permeance.value * drive / ampere_turns + 2 * linkage),
        flux_density=flux_density,
        section=section,
    )
    return MagneticCircuit(point, flux, drive / ampere_turns, permeance.value / permeance.plain, 1 + whole / half)


def gap_permeance(magnet: ECore, gap: float, *, fringing: bool = True) -> GapPermeance:
    """The permeance of the centre leg's gap and the two outer ones in series."""
    c = magnet.centre_leg_width
    o = magnet.outer_leg_width
    centre = c / gap
    centre_slope = -c / gap**2
    outer = 2 * o / gap
    outer_slope = -2 * o / gap**2
    plain = centre * outer / (centre + outer)
    if fringing:
        share = 2 * o / (c + 2 * o)  # of the magnetomotive force across the centre leg's gap, as the reluctances
        edge, edge_slope = _corner(_reach(magnet, share), gap)
        centre = centre + 2 * edge
        centre_slope = centre_slope + 2 * edge_slope
        edge, edge_slope = _corner(_reach(magnet, 1 - share), gap)
        flush, flush_slope = _corner(magnet.armature_thickness, gap / 2)  # two in series over half the gap each
        outer += 2 * (edge + flush / 2)
        outer_slope += 2 * (edge_slope + flush_slope / 4)
    total = centre + outer
    slope = (outer**2 * centre_slope + centre**2 * outer_slope) / total**2
    return GapPermeance(centre * outer / total, slope, plain)


def _corner(height: float, distance: float) -> tuple[float, float]:
    """f(height/distance) and its derivative with respect to the distance."""
    ratio = height / distance
    value, slope, _ = corner_excess(ratio)
    return value, -slope * ratio / distance


def _reach(magnet: ECore, share: float) -> float:
    """The height of a leg's side that counts in its fringe: the geometric mean of those where the force is lost."""
    begin = magnet.coil.face_clearance
    end = begin + share * magnet.coil.height
    mean_log = math.log(end) - 1 + begin / (end - begin) * (math.log(end / begin) if begin else 0.0)
    return min(math.exp(mean_log), 2 * magnet.window_width / math.pi)


def window_leakage(magnet: ECore) -> tuple[float, float, float]:
    """A window's leakage over mu_0 U and the depth: flux below mid-height, all flux, flux linkage of one turn."""
    width = magnet.window_width
    middle = magnet.window_height / 2
    begin = magnet.coil.face_clearance
    end = magnet.coil.face_clearance + magnet.coil.height

    def force(y: float) -> float:  # of U, between two legs at a height
        return min(1.0, max(0.0, (end - y) / (end - begin)))

    def density(y: float) -> float:
        return force(y) * min(1.0, math.pi * y / (2 * width)) / width

    kinks = sorted({0.0, begin, end, middle, min(2 * width / math.pi, magnet.window_height), magnet.window_height})
    lower = upper = linkage = 0.0
    for low, high in pairwise(kinks):
        part = _integral(density, low, high)
        lower, upper = (lower + part, upper) if high <= middle else (lower, upper + part)
        linkage += _integral(lambda y: density(y) * force(y), low, high)
    return lower, lower + upper, linkage


def _integral(function: Callable[[float], float], start: float, end: float) -> float:
    """Simpson's rule, exact for the cubics between two kinks."""
    return (end - start) / 6 * (function(start) + 4 * function((start + end) / 2) + function(end))
