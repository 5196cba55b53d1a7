"""What the rest of the house knows of a magnet: `MagnetKind`. A kind is one file that derives from it."""

import hashlib
import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from pydantic import model_validator

from msl_fem.files.schema import FrozenModel
from msl_fem.magnetics.kinds.ends import KnownEnds, StackEnds
from msl_fem.magnetics.kinds.parts import Air, Coil, IronSpec
from msl_fem.magnetics.kinds.proportions import metres
from msl_fem.magnetics.section import Section
from msl_fem.magnetics.triangles import TriangleMesh
from msl_fem.materials.constants import COPPER_RESISTIVITY

SMALLEST_GAP = 1e-4  # of the core's half width: a thinner strip of air cannot be meshed


@dataclass(frozen=True)
class WindingSpace:
    """Where the turns of a magnet lie; lengths in m.

    Attributes
    ----------
    coils : equal ones in series
    perimeter : of the leg that a coil encloses
    clearance : from the leg to the first turn
    width : of the coil, away from the leg
    height : of the coil, along the leg
    slot_width : of the window, across which the leakage field runs
    exposed : length of the mean turn that lies outside the window and gives its heat to the air
    """

    coils: int
    perimeter: float
    clearance: float
    width: float
    height: float
    slot_width: float
    exposed: float

    def turn_length(self, from_leg: float) -> float:
        """Length of a turn at a distance from the leg: straight sides, and a circular arc at each corner."""
        return self.perimeter + 2 * math.pi * from_leg

    @property
    def mean_turn_length(self) -> float:
        return self.turn_length(self.clearance + self.width / 2)

    @property
    def area(self) -> float:
        """m2, cross section of the coils, one side of each."""
        return self.coils * self.width * self.height


@dataclass(frozen=True)
class CircuitPart:
    """A part of the iron in the flux path: its length in m and the area in m2 (sheets and insulation) of all flux.

    `least_area` is that of the cut where flux density is read, where the flux spreads along the part.
    """

    name: str
    region: str
    length: float
    area: float
    least_area: float | None = None

    @property
    def cut_area(self) -> float:
        """m2 of the cut that bears the part's name."""
        return self.area if self.least_area is None else self.least_area


@dataclass(frozen=True)
class FringeEdge:
    """An edge of a pole face, of a length in m, beside which the face's side of a height in m carries flux too.

    `flush` : pole and armature end together, so that there are two corners in series over half the gap each.
    """

    length: float
    height: float
    flush: bool = False


@dataclass(frozen=True)
class PoleFace:
    """Faces in parallel across one of the gaps in series: area in m2 and edges."""

    area: float
    edges: tuple[FringeEdge, ...]


@dataclass(frozen=True)
class LeakageWindow:
    """The windows across which flux leaks: `breadth` (m, of all of them together) over `width` and `height` of one.

    The coil reaches from `face_clearance` above the pole faces up by `coil_height`.
    """

    breadth: float
    width: float
    height: float
    face_clearance: float
    coil_height: float


@dataclass(frozen=True)
class CircuitOfKind:
    """The closed equations of a kind, as data: two pole faces in series, the window between, the iron's parts.

    `crossed` names the parts that all leakage passes, `halfway` those whose middle it passes in part. The parts bear
    the names of the section's cuts; the first one is the wound pole.
    """

    faces: tuple[PoleFace, PoleFace]
    window: LeakageWindow
    parts: tuple[CircuitPart, ...]
    crossed: tuple[str, ...]
    halfway: tuple[str, ...]


@dataclass(frozen=True)
class SizedLengths:
    """What sizing varies of a core with two poles and a window: how the kind names it.

    Attributes
    ----------
    pole : the length across the wound pole, by its name in the actuator file
    return_pole : across the other one; None where both poles are alike
    parts : part of the circuit to the length that makes it thick or thin: "pole_width", "return_width",
        "yoke_thickness" or "armature_thickness" of a design
    coils : side by side in the window
    """

    pole: str
    return_pole: str | None
    parts: tuple[tuple[str, str], ...]
    coils: int = 1


@dataclass(frozen=True)
class DrawnLength:
    """A dimension of the drawing, by the name it has in the actuator file, between two points (x, y) in m."""

    name: str
    start: tuple[float, float]
    end: tuple[float, float]

    @property
    def length(self) -> float:
        return math.dist(self.start, self.end)


class MagnetKind(FrozenModel, ABC):
    """A magnet known by its dimensions: the base of all kinds, and all that other rooms know of a magnet.

    A kind is a section of the actuator file; its validators refuse bad dimensions. It must state its section and size;
    what it can state beside that (winding, surfaces, circuit, ends) opens losses, cooling, sizing and end effects.

    Attributes
    ----------
    iron : of core and armature
    coil : the winding
    TOLERANCED : names of the kind's lengths that manufacturing varies; one is "stack_depth" in a plane section
    OWN_MESHES : a mesh cannot follow the gap far, so that each gap has its own
    SIZED : what sizing varies (needs `circuit` and `outer_size`); None where the kind is not sized
    """

    TOLERANCED: ClassVar[tuple[str, ...]] = ()
    OWN_MESHES: ClassVar[bool] = False
    SIZED: ClassVar[SizedLengths | None] = None

    if TYPE_CHECKING:  # a kind declares them among its own fields, in the order of its file
        iron: IronSpec
        coil: Coil

        @property
        def turns(self) -> int:
            """Of all coils in series."""

    @abstractmethod
    def section(self, gap: float) -> Section:
        """The half section at a gap in m: armature's surface at y = 0, pole faces at y = gap, a strip between."""

    @property
    @abstractmethod
    def half_width(self) -> float:
        """Of the core (its outer radius) in m: gaps are compared with it."""

    def own_mesh(self) -> TriangleMesh | None:
        """The mesh that a kind brings with it; None where the section is meshed."""
        return None

    @property
    def doubts(self) -> tuple[str, ...]:
        """What in the magnet's file may be wrong, a sentence each; results say it."""
        return ()

    @property
    def gaps(self) -> tuple[float, float]:
        """The smallest and the largest gap in m that can be solved."""
        return SMALLEST_GAP * self.half_width, self.half_width

    @property
    @abstractmethod
    def winding_space(self) -> WindingSpace:
        """Where the turns lie."""

    def measures(self, gap: float) -> tuple[DrawnLength, ...]:
        """The dimensions that a drawing shows, in the section's coordinates; along x or along y."""
        return ()

    @property
    def digest(self) -> str:
        """SHA-256 of what the file states of the magnet: equal for equal magnets."""
        return hashlib.sha256(self.model_dump_json().encode()).hexdigest()

    @property
    def copper_area(self) -> float:
        """m2 of copper in the coils' cross section, one side of each."""
        return self.coil.fill_factor * self.winding_space.area

    @property
    def mean_turn_length(self) -> float:
        return self.winding_space.mean_turn_length

    @property
    def copper_volume(self) -> float:
        """m3 of copper."""
        return self.copper_area * self.mean_turn_length

    @property
    def winding_resistance(self) -> float:
        """Resistance of the coils at 20 degC from their copper section: R = rho N^2 l_turn / (k_fill A_coil)."""
        return COPPER_RESISTIVITY * self.turns**2 * self.mean_turn_length / self.copper_area

    @property
    def core_surface(self) -> float | None:
        """m2 of the core that gives heat to the air, without pole faces and window; None where it is not known."""
        return None

    @property
    def pole_faces(self) -> tuple[tuple[float, float], ...]:
        """Width and length in m of each rectangular pole face; none where they have another shape."""
        return ()

    @property
    def stack_ends(self) -> StackEnds | None:
        """What end effects need to know; None where the kind has no ends or does not state them."""
        return None

    @property
    def known_ends(self) -> KnownEnds:
        """The factors of the stack's ends and what they leave; the formulas' where solutions tell no others."""
        return KnownEnds()

    @property
    def circuit(self) -> CircuitOfKind | None:
        """The closed equations; None where the kind does not state them."""
        return None

    @property
    def outer_size(self) -> tuple[float, float, float] | None:
        """Width, height and depth in m of core, coil and armature together, the gap closed; None if not stated."""
        return None


class FlatFaceMagnet(MagnetKind):
    """A core with a yoke and a window over a flat armature, in an air box."""

    @property
    def turns(self) -> int:
        return self.coil.turns

    if TYPE_CHECKING:
        window_height: float
        yoke_thickness: float
        armature_thickness: float
        armature_overhang: float
        air: Air | None

    @model_validator(mode="after")
    def _air_box_holds_the_armature(self) -> "FlatFaceMagnet":
        if self.air is not None and self.air.side <= self.armature_overhang:
            raise ValueError(
                f"air.side {metres(self.air.side)} counts from the core and must be above "
                f"armature_overhang {metres(self.armature_overhang)}; make the air box wider"
            )
        return self

    @property
    def height(self) -> float:
        """From the pole faces to the back of the yoke."""
        return self.window_height + self.yoke_thickness

    @property
    def armature_half_width(self) -> float:
        return self.half_width + self.armature_overhang

    @property
    def air_box(self) -> Air:
        """The stated air box, or eight times the core's width to every side.

        The cut's error falls like the square of the box. That of the default moves the force by less than 1e-4 and the
        flux linkage by less than 2e-4; E1's own box, two half widths away, by 2e-3 (saturated) and 6e-3 (1 mm).
        """
        if self.air is not None:
            return self.air
        margin = 16.0 * self.half_width
        return Air(side=margin, bottom=margin, top=margin)


class PlaneMagnet(FlatFaceMagnet):
    """A stack of sheets over a flat armature, which it may share with its mirror image."""

    if TYPE_CHECKING:
        stack_depth: float
