"""End effects: how much deeper than the stack the air of a magnet's plane section is.

At the stack's two ends flux bulges out of the gap and of the window. In the plane across such an edge two faces of
iron end together, and the permeance beyond it is that of an air that is deeper by delta at each end, while the iron
keeps its depth: the extra flux goes through the same iron and saturates it.

- Gap: pole and armature face each other in the plane (y, z). The pole's end face keeps the magnetomotive force of the
  gap up to the coil; along the coil's end turns it falls linearly, to nothing where the pole is at the armature's
  potential. The permeance grows like the logarithm of the height at which the face ends, so the height that counts is
  the geometric mean of those at which the force is lost, and at most the armature's thickness.
- Window: the turns lie in planes y = const., so that no current crosses these planes and the magnetomotive force
  between two legs at the height y is the same around the end as through the window. A plane section (x, z) across the
  legs has their fringe, half the centre leg on its plane of symmetry and the outer leg with all its faces; solutions of
  such sections are kept as a polynomial (`between_legs.py`).

What is left out, and how much it may be: docs/end_effects.md.

The fringe beside a gap between two blocks of iron that end together comes from a plane section of its own
(`EndSection`): the blocks lie a gap apart, joined by an iron bridge at the left; a coil in the gap, along the bridge,
drives a magnetomotive force of 1 A across all of the gap to its right. The air beyond the right end holds the fringe.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Literal

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.errors import InputError
from msl_fem.magnetics.field.between_legs import excess_between
from msl_fem.magnetics.kinds.ends import DERIVED, EndFactors, StackEnds
from msl_fem.magnetics.kinds.kind import MagnetKind
from msl_fem.magnetics.section import Section, rectangle
from msl_fem.magnetics.solver.magnetostatics import FieldModel, solve_field
from msl_fem.magnetics.solver.mesh import MeshSize, triangulate
from msl_fem.magnetics.solver.strip import AirDepth
from msl_fem.materials.constants import MU_0
from msl_fem.materials.material import linear_iron

PERMEABILITY = 1e7
SIZE = MeshSize(corner=0.02, gap=0.5, iron=1.0, growth=0.4)
OUTER_AIR = "air"
METHOD = "gap by the closed form of two flush edges, window by a plane section across the legs; iron at stack depth"
NONE = "none: plane section times stack depth"


@dataclass(frozen=True)
class EndTurns:
    """A rectangle of turns in front of the upper block's end, and its current in A (that of the gap is 1)."""

    x: tuple[float, float]
    y: tuple[float, float]
    current: float


@dataclass(frozen=True)
class EndSection:
    """Blocks of heights `upper` and `lower` that end at x = 0, the lower one's top at y = 0, a `gap` between; in m.

    With `mirror` the lower edge of the lower block is a plane of symmetry, which no flux crosses.
    """

    gap: float
    upper: float
    lower: float
    turns: EndTurns | None = None
    mirror: bool = False

    def excess(self, *, height: float | None = None) -> float:
        """Permeance beyond the end, per unit width and mu_0, of the lower block's flux.

        All of that flux, or only what ends below a height on the upper block's end face. The difference of A between
        two points is the flux that passes between them; within the gap the field is uniform.

        Raises
        ------
        ComputationError : the mesher failed
        """
        g, length = self.gap, 4 * self.gap
        bridge = min(self.upper, self.lower)
        coil = g / 2
        left = -length - coil
        far = 12 * (self.upper + self.lower + g)
        bottom = -self.lower if self.mirror else -far
        regions = [
            rectangle("air", left - bridge, bottom, far, far),
            rectangle("iron", left - bridge, g, 0, g + self.upper),
            rectangle("iron", left - bridge, -self.lower, 0, 0),
            rectangle("iron", left - bridge, 0, left, g),
            rectangle("gap", -length, 0, 0, g),
            rectangle("coil", left, 0, -length, g),
        ]
        turns = {"coil": 1 / (coil * g)}
        if self.turns is not None:
            (x0, x1), (y0, y1) = self.turns.x, self.turns.y
            regions.append(rectangle("turns", x0, y0, x1, y1))
            turns["turns"] = self.turns.current / ((x1 - x0) * (y1 - y0))
        corners = ((0, g, 1.0), (0, 0, 1.0), (0, g + self.upper, 0.2), (0, -self.lower, 0.2))
        section = Section(tuple(regions), corners, (), {"iron": ("", 1.0)}, turns, 1.0, g)
        model = FieldModel(
            triangulate(section, SIZE), {"iron": linear_iron(PERMEABILITY)}, turns_density=turns, order=3
        )
        potential = solve_field(model, 1.0, g).potential
        inside = _at_vertex(model, potential, -length, 0.0)
        outside = _on_side(model, potential, height + g) if height is not None else 0.0
        return abs(inside - outside) / MU_0 - length / g


def _at_vertex(model: FieldModel, potential: Array, x: float, y: float) -> float:
    points = model.mesh.points
    k = int(np.argmin(np.hypot(points[0] - x, points[1] - y)))
    return float(potential[model.basis.nodal_dofs[0, k]])


def _on_side(model: FieldModel, potential: Array, y: float) -> float:
    """The potential at a height of the end face x = 0, between its mesh points."""
    points = model.mesh.points
    on = np.flatnonzero(points[0] == 0.0)
    on = on[np.argsort(points[1, on])]
    return float(np.interp(y, points[1, on], potential[model.basis.nodal_dofs[0, on]]))


@dataclass(frozen=True)
class FlushEdges:
    """Two faces a gap apart that end together at both ends of a depth, and end faces of the height `reach`, in m."""

    depth: float
    reach: float

    def factor(self, gap: float) -> tuple[float, float, float]:
        """(depth + 2 delta)/depth at a gap, and its first and second derivative with respect to the gap.

        Midway between the faces lies an equipotential, so each edge is a corner over a plane at half the gap, and two
        of them in series give delta = (g / 2) f(2 h / g), f of `corner_excess`.
        """
        ratio = 2 * self.reach / gap
        excess, first, second = corner_excess(ratio)
        return (
            1 + gap * excess / self.depth,
            (excess - ratio * first) / self.depth,
            ratio**2 * second / (gap * self.depth),
        )


def corner_excess(ratio: float) -> tuple[float, float, float]:
    """f(h/s): a corner's permeance per unit width and mu_0 beyond that of its front face, and f', f''.

    The corner stands s over a plane that goes on, its side face counts to the height h above the corner. By Schwarz and
    Christoffel z = (s/pi) (2 v + ln((v - 1)/(v + 1))), v = sqrt(w + 1), maps the half plane onto the air (e.g.
    Binns, Lawrenson and Trowbridge, The Analytical and Numerical Solution of Electric and Magnetic Fields, 1992); with
    q = sqrt(-w - 1) on the side face

        h/s = (2/pi) (q - arctan q),    f = (2 - ln 4 + ln(1 + q^2))/pi,    f' = 1/q.

    Roters' half cylinder and half shell (Electromagnetic Devices, 1941, ch. V), 0.26 + ln(1 + h/s)/pi for two such
    corners in series, is within 0.05 of f/2 from h/s = 1 on.
    """
    target = math.pi * ratio / 2
    q = target + math.pi / 2  # above the root of a convex function: Newton falls to it without a step too far
    for _ in range(60):
        step = (q - math.atan(q) - target) * (1 + 1 / q**2)
        q -= step
        if step <= 1e-15 * q:
            break
    excess = (2 - math.log(4) + math.log1p(q**2)) / math.pi
    return excess, 1 / q, -math.pi / 2 * (1 + q**2) / q**4


def gap_edges(ends: StackEnds) -> FlushEdges:
    """The edges of pole and armature at the stack's ends."""
    return FlushEdges(ends.depth, ends.reach)


def gap_depth(ends: StackEnds, factors: EndFactors, gap: float) -> tuple[float, float, float]:
    """The depth of the gap's air over the stack's, and its first and second derivative with respect to the gap."""
    value, first, second = gap_edges(ends).factor(gap)
    return 1 + factors.gap * (value - 1), factors.gap * first, factors.gap * second


def window_factor(ends: StackEnds) -> float:
    """(depth + 2 delta)/depth of the window; raises ComputationError where the mesher fails."""
    width = ends.window_width
    upper, lower = (leg / width for leg in ends.legs)
    known = excess_between(upper, lower, mirror=ends.mirror)
    excess = _solved_between(upper, lower, ends.mirror) if known is None else known
    return 1 + 2 * width * excess / ends.depth


@lru_cache(maxsize=16)
def _solved_between(upper: float, lower: float, mirror: bool) -> float:
    """The excess of a section across legs that are so many windows wide."""
    return EndSection(1.0, upper, lower, mirror=mirror).excess()


EndEffects = bool | EndFactors | None
"""Which ends are wanted: of given factors, those of the kind (True), none (False), or what the kind knows (None)."""
KnownFactors = EndFactors | Literal[False]
"""Which ends a field has: False for a plane section."""


def wanted_ends(magnet: MagnetKind, wanted: EndEffects) -> KnownFactors:
    """The factors of the ends that are wanted; False for a plane section. With None those of a kind that states ends.

    Raises
    ------
    InputError : ends are asked for, and the kind states none
    """
    if wanted is False or (wanted is None and magnet.stack_ends is None):
        return False
    ends_of(magnet)
    return wanted if isinstance(wanted, EndFactors) else magnet.known_ends.factors


def ends_of(magnet: MagnetKind) -> StackEnds:
    """The stack's ends; InputError where the kind states none."""
    if magnet.stack_ends is None:
        raise InputError("this kind of magnet states no ends of a stack; leave the end effects out")
    return magnet.stack_ends


def deeper_air(ends: StackEnds, mesh_gap: float, factors: EndFactors = DERIVED) -> AirDepth:
    """The depth of the air of a magnet's section over that of its stack, for a mesh made at a gap.

    In the strip it is the factor of the gap. In the window, at the height y above the pole faces, it is that of the
    window times the share (pi y / 2) / window_width, at most 1: what a tube of flux gains at its ends goes with its
    length, and the tubes near the pole faces lead from a leg's side to the armature, not to the next leg.

    Raises
    ------
    ComputationError : the mesher failed
    """
    beyond = factors.window * (window_factor(ends) - 1)
    width = ends.window_width

    def window(points: Array) -> Array:
        height = np.maximum(points[1] - mesh_gap, 0.0)
        return 1 + beyond * np.minimum(math.pi / 2 * height / width, 1.0)

    def outer(points: Array) -> Array:
        return np.full(points.shape[1:], 1 + factors.outer)

    regions = dict.fromkeys(ends.regions, window)
    return AirDepth(partial(gap_depth, ends, factors), {**regions, OUTER_AIR: outer} if factors.outer else regions)


def deeper_air_of_both(ends: StackEnds, mesh_gap: float, factors: EndFactors, middle: float) -> AirDepth:
    """As `deeper_air`, of a magnet above the armature and its mirror image about y = `middle`, NAME_1 and NAME_2."""
    one = deeper_air(ends, mesh_gap, factors)
    regions: dict[str, Callable[[Array], Array]] = {}
    for name, depth in one.regions.items():
        regions[f"{name}_1"] = depth
        regions[f"{name}_2"] = partial(_mirrored, depth, middle)
    return AirDepth(one.strip, regions)


def _mirrored(depth: Callable[[Array], Array], middle: float, points: Array) -> Array:
    return depth(np.stack([points[0], 2 * middle - points[1]]))
