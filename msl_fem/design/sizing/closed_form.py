"""The classical design equations of a core with two poles, a window and an armature: gaps, fringes, leakage and iron.

With the magnetomotive force U across the two gaps in series (Roters, Electromagnetic Devices, 1941; for an E-core the
form is that of Gutierrez and Ro, 1998, eq. for Phi_avg, with both gaps written as permeances):

    P_k = mu_0 (A_k/g + sum l f(h/g)),     P = P_1 P_2/(P_1 + P_2)
    Phi = P U,     F = -U^2/2 dP/dg,     B_k = Phi_k/(s A_k),     N i = U + sum H(B_k) l_k

Without the fringes f the force is that of Maxwell, the sum of B^2 A/(2 mu_0) over the faces. Areas, edges and lengths
are the kind's (`magnetics.kinds.kind.CircuitOfKind`).

- Fringe: f(h/g) is the permeance per length of an edge of the side face of a pole to the armature before it, up to the
  height h (Schwarz and Christoffel, `end_effects.corner_excess`; Roters' half cylinder and half shell are its
  estimate). Round edges take it for their length. Where pole and armature end flush, two corners are in series.
- Leakage: across the window of the width w the magnetomotive force is U from the pole faces to the coil and falls along
  it to nothing, Phi_l = mu_0 U/w times its integral; near the pole faces the tubes lead to the armature instead, so
  that the share min(1, (pi y/2)/w) is taken, y the height (as in `end_effects`). What leaves below mid-height crosses
  the middle of the legs, all of it the yoke.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from msl_fem.design.sizing.design import SectionPoint
from msl_fem.magnetics.field.end_effects import corner_excess
from msl_fem.magnetics.kinds.kind import CircuitOfKind, CircuitPart, LeakageWindow, PoleFace
from msl_fem.magnetics.kinds.parts import IronSpec
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
    """P/mu_0 in m of both gaps in series, its derivative with respect to the gap, and without fringes."""

    value: float
    slope: float
    plain: float

    def deeper(self, factor: float, slope: float) -> "GapPermeance":
        """Of air that is deeper than the poles by a factor, whose derivative with respect to the gap is `slope`."""
        return GapPermeance(factor * self.value, factor * self.slope + slope * self.value, self.plain)


@dataclass(frozen=True)
class MagneticCircuit:
    """The circuit of a magnet at a flux density.

    Attributes
    ----------
    point : what it says of the magnet
    flux : by part, over mu_0 times the gaps' magnetomotive force, in m
    areas : by part, of the iron in its cut, in m2
    gap_share : of the magnetomotive force across the gaps, the rest drives the iron
    fringing : gap permeance over that of the pole faces alone
    leakage : flux in the yoke over that through the gaps
    """

    point: SectionPoint
    flux: dict[str, float]
    areas: dict[str, float]
    gap_share: float
    fringing: float
    leakage: float

    @property
    def pole(self) -> str:
        """The wound pole."""
        return next(iter(self.flux))


@dataclass(frozen=True)
class UnloadedCircuit:
    """A kind's circuit before its flux density and the depth of its gap's air are given.

    Attributes
    ----------
    permeance : of air that is as deep as the stack
    leaking : leakage by part, over mu_0 times the gaps' magnetomotive force, in m
    leakage, linkage : all of it, and the flux linkage of one turn
    areas : of the iron by part, in m2
    """

    parts: tuple[CircuitPart, ...]
    permeance: GapPermeance
    leaking: dict[str, float]
    leakage: float
    linkage: float
    areas: dict[str, float]

    def driven(self, flux_density: float, air_depth: tuple[float, float] = (1.0, 0.0)) -> "DrivenGap":
        """The gaps where the most loaded section carries `flux_density` (T, in the iron).

        `air_depth` is that of the gap over the stack's, and its derivative with respect to the gap (`end_effects`).
        """
        permeance = self.permeance.deeper(*air_depth)
        flux = {name: permeance.value + leaking for name, leaking in self.leaking.items()}
        per_ampere = {name: MU_0 * flux[name] / area for name, area in self.areas.items()}
        section = max(per_ampere, key=per_ampere.__getitem__)
        drive = flux_density / per_ampere[section]
        return DrivenGap(permeance, flux, section, drive, -MU_0 * permeance.slope * drive**2 / 2)

    def corrected(self, loads: Mapping[str, float]) -> "UnloadedCircuit":
        """With parts that carry so many times the flux density that the circuit says, by name."""
        areas = {name: area / loads.get(name, 1.0) for name, area in self.areas.items()}
        return replace(self, areas=areas)

    def loaded(self, irons: Irons, flux_density: float, air_depth: tuple[float, float] = (1.0, 0.0)) -> MagneticCircuit:
        """The circuit at a flux density, given as in `driven`."""
        gap = self.driven(flux_density, air_depth)
        drive, value = gap.drive, gap.permeance.value
        ampere_turns = drive + _drop(self.parts, irons, {name: MU_0 * drive * gap.flux[name] for name in gap.flux})
        point = SectionPoint(
            ampere_turns=ampere_turns,
            force=gap.force,
            force_slope=2 * gap.force / ampere_turns,
            inductance=MU_0 * (value * drive / ampere_turns + self.linkage),
            flux_density=flux_density,
            section=gap.section,
            flux_densities={name: MU_0 * drive * gap.flux[name] / area for name, area in self.areas.items()},
        )
        fringing = value / self.permeance.plain
        return MagneticCircuit(point, gap.flux, self.areas, drive / ampere_turns, fringing, 1 + self.leakage / value)


@dataclass(frozen=True)
class DrivenGap:
    """The gaps' permeance, `flux` as in `MagneticCircuit`, the most loaded section, magnetomotive force and force."""

    permeance: GapPermeance
    flux: dict[str, float]
    section: str
    drive: float
    force: float


def unloaded(circuit: CircuitOfKind, iron: IronSpec, *, gap: float, factors: Factors | None = None) -> UnloadedCircuit:
    """What flux density and depth of air leave as it is."""
    factors = factors or Factors()
    middle, whole, linkage = window_leakage(circuit.window) if factors.leakage else (0.0, 0.0, 0.0)
    leaking = dict.fromkeys((part.name for part in circuit.parts), 0.0)
    leaking |= dict.fromkeys(circuit.crossed, whole) | dict.fromkeys(circuit.halfway, middle)
    stacking = {"core": iron.core_stacking, "armature": iron.armature_stacking}
    areas = {part.name: stacking[part.region] * part.cut_area for part in circuit.parts}
    permeance = gap_permeance(circuit, gap, fringing=factors.fringing)
    return UnloadedCircuit(circuit.parts, permeance, leaking, whole, linkage, areas)


def _drop(parts: tuple[CircuitPart, ...], irons: Irons, flux: dict[str, float]) -> float:
    """A across all iron at a flux in Wb by part; parts of one curve are read at once."""
    drop = 0.0
    regions = {"core": irons[0], "armature": irons[1]}
    for iron in irons if irons[0] is not irons[1] else irons[:1]:
        alike = [part for part in parts if regions[part.region] is iron]
        averaged = np.array([flux[part.name] / part.area for part in alike])
        drop += float(iron.field_strength_at(averaged) @ [part.length for part in alike])
    return drop


def gap_permeance(circuit: CircuitOfKind, gap: float, *, fringing: bool = True) -> GapPermeance:
    """The permeance of the two pole faces' gaps in series."""
    (first, first_slope), (other, other_slope) = (_face(face, gap, fringing) for face in circuit.faces)
    total = first + other
    slope = (other**2 * first_slope + first**2 * other_slope) / total**2
    plain = 1 / (gap * sum(1 / face.area for face in circuit.faces))
    return GapPermeance(first * other / total, slope, plain)


def _face(face: PoleFace, gap: float, fringing: bool) -> tuple[float, float]:
    """P/mu_0 in m of a face with its edges, and its derivative with respect to the gap."""
    value = face.area / gap
    slope = -value / gap
    for edge in face.edges if fringing else ():
        corners = 2 if edge.flush else 1  # in series, over a share of the gap each
        excess, excess_slope = _corner(edge.height, gap / corners)
        value += edge.length * excess / corners
        slope += edge.length * excess_slope / corners**2
    return value, slope


def _corner(height: float, distance: float) -> tuple[float, float]:
    """f(height/distance) and its derivative with respect to the distance."""
    ratio = height / distance
    value, slope, _ = corner_excess(ratio)
    return value, -slope * ratio / distance


def window_leakage(window: LeakageWindow) -> tuple[float, float, float]:
    """Leakage over mu_0 U in m: flux below mid-height, all flux, flux linkage of one turn."""
    width = window.width
    middle = window.height / 2
    begin = window.face_clearance
    end = window.face_clearance + window.coil_height

    def densities(y: float) -> tuple[float, float]:  # of flux, and of flux linkage, at a height between two legs
        force = min(1.0, max(0.0, (end - y) / (end - begin)))  # of U
        density = window.breadth * force * min(1.0, math.pi * y / (2 * width)) / width
        return density, density * force

    kinks = sorted({0.0, begin, end, middle, min(2 * width / math.pi, window.height), window.height})
    lower = upper = linkage = 0.0
    at_low = densities(kinks[0])
    for low, high in pairwise(kinks):
        at_middle, at_high = densities((low + high) / 2), densities(high)
        # Simpson's rule, exact for the cubics between two kinks
        part, linked = ((high - low) / 6 * (a + 4 * b + c) for a, b, c in zip(at_low, at_middle, at_high, strict=True))
        lower, upper = (lower + part, upper) if high <= middle else (lower, upper + part)
        linkage += linked
        at_low = at_high
    return lower, lower + upper, linkage
