"""The field of a magnet of any kind at a stated accuracy, and which points may be solved."""

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import replace
from functools import lru_cache, partial
from pathlib import Path

import numpy as np

from msl_fem.actuator import Actuator, MagnetKind
from msl_fem.computing.arrays import Array
from msl_fem.computing.blas_threads import one_blas_thread
from msl_fem.errors import InputError
from msl_fem.files.quantity import format_quantity
from msl_fem.magnetics.field.accuracy import (
    LEVELS,
    Accuracy,
    PointResult,
    iron_notes,
    irons_of,
    level_of,
    solve_with_estimate,
)
from msl_fem.magnetics.field.end_effects import EndEffects, KnownFactors, deeper_air, ends_of, wanted_ends
from msl_fem.magnetics.kinds.ends import leaked
from msl_fem.magnetics.section import MovingRegions, Section
from msl_fem.magnetics.solver.magnetostatics import (
    FieldModel,
    FieldSolution,
    NewtonSettings,
    field_response,
    solve_field,
)
from msl_fem.magnetics.solver.mesh import MeshSize, triangulate
from msl_fem.magnetics.solver.moving_air import moving_triangles
from msl_fem.magnetics.solver.postprocess import FieldQuantities, Probes, evaluate_field
from msl_fem.magnetics.solver.strip import AirDepth
from msl_fem.magnetics.solver.virtual_work import MovingProbes, Symmetry, displacement_share
from msl_fem.magnetics.triangles import MeshMotion, TriangleMesh
from msl_fem.materials.material import AnalyticIron, Iron

LARGEST_CURRENT_DENSITY = 1e10  # A/m2 in the copper; adiabatic, rho J^2 / (c d) is 5e5 K/s there

FINER = MeshSize(iron=0.4, growth=0.5)
MOST_SHEAR = 0.3  # of a triangle, up to which a mesh follows a body that slides along what stands still
Remesh = Callable[[float], TriangleMesh]

MOST_NODES = 1000  # gaps or currents of a table
CLOSEST = 1e-6  # of the largest: the least distance of two of them


class MagnetField:
    """A magnet's section meshed for gaps near `mesh.gap`, ready to be solved at any current and gap.

    With `end_effects` (`wanted_ends`) the air of strip and window is deeper than the stack, and the end turns leak.
    `remesh` gives the mesh at another gap, where a mesh cannot follow far. Raises ActuatorError, MaterialError,
    InputError (ends of a kind that states none) or ComputationError (mesher).
    """

    def __init__(
        self,
        magnet: MagnetKind,
        mesh: TriangleMesh,
        *,
        folder: Path,
        order: int,
        end_effects: EndEffects = False,
        remesh: Remesh | None = None,
    ) -> None:
        self.magnet = magnet
        self.folder = folder
        self.order = order
        self.ends: KnownFactors = wanted_ends(magnet, end_effects)
        self.remesh = remesh
        self.section: Section = magnet.section(mesh.gap)
        self.irons = irons_of(self.section.iron, folder)
        self.notes = (*magnet.doubts, *iron_notes(self.irons))
        self.model = FieldModel(
            mesh,
            self.irons,
            turns_density=self.section.turns_density,
            order=order,
            symmetry=self.section.symmetry,
            air_depth=deeper_air(ends_of(magnet), mesh.gap, self.ends) if self.ends else None,
        )
        self.probes = _probes(self.model, self.section)

    def solve(self, current: float, gap: float, *, start: Array | None = None) -> FieldSolution:
        """The field at a coil current and a gap; raises NotConverged."""
        return solve_field(self.model, current, gap, start=start, settings=NewtonSettings())

    def slope(self, solution: FieldSolution) -> Array:
        """dA/di at the last solution: the predictor of the next current."""
        return field_response(self.model, solution).by_current

    def quantities(self, solution: FieldSolution) -> FieldQuantities:
        """The numbers of the last solution; the end turns' leakage is in flux linkage, coenergy and inductance."""
        found = evaluate_field(self.probes, solution)
        added = leaked(self.leakage, solution.current) if self.leakage else {}
        return replace(found, **{name: getattr(found, name) + value for name, value in added.items()})

    @property
    def leakage(self) -> float:
        """H of the end turns; 0 in a plane section."""
        return self.ends.leakage if self.ends else 0.0

    def refined(self) -> "MagnetField":
        """The same mesh with one polynomial degree more."""
        return self._on(self.model.mesh, self.order + 1)

    def near(self, gap: float) -> "MagnetField":
        """This field, or where its mesh cannot follow to a gap one on a mesh made there, of the same irons."""
        motion = self.model.mesh.motion
        if self.remesh is None or motion is None:
            return self
        slope = moving_triangles(self.model.mesh, motion).slope
        if float(np.hypot(*slope).max()) * abs(gap - self.model.mesh.gap) <= MOST_SHEAR:
            return self
        return self._on(self.remesh(gap), self.order).with_irons(self.irons)

    def _on(self, mesh: TriangleMesh, order: int) -> "MagnetField":
        return MagnetField(
            self.magnet,
            mesh,
            folder=self.folder,
            order=order,
            end_effects=self.ends,
            remesh=self.remesh,
        )

    def with_irons(self, irons: dict[str, Iron | AnalyticIron]) -> "MagnetField":
        """The same mesh with other irons in the same regions."""
        other = copy(self)
        other.irons = irons
        other.model = self.model.with_irons(irons)
        other.probes = copy(self.probes)
        other.probes.model = other.model
        return other

    def of(self, magnet: MagnetKind, points: Array | None = None, *, end_effects: EndEffects = None) -> "MagnetField":
        """The field of another magnet of the same topology on this mesh, whose corners lie at points (2, n_point).

        Without points, of a magnet that is the same but for the depth of its stack. End effects as of `wanted_ends`;
        a mesh with a motion cannot be moved.
        """
        other = copy(self)
        other.magnet, other.ends = magnet, wanted_ends(magnet, end_effects)
        gap = self.model.mesh.gap
        other.section = section = magnet.section(gap)
        air = deeper_air(ends_of(magnet), gap, other.ends) if other.ends else None
        if points is None:
            other.model = self.model.in_air(air or AirDepth())
            other.probes = copy(self.probes)
            other.probes.model, other.probes.scale = other.model, section.scale
            return other
        model = self.model.moved(points, section.turns_density, air_depth=air)
        if section.iron != self.section.iron:
            other.irons = irons_of(section.iron, self.folder)
            model = model.with_irons(other.irons)
        assert isinstance(self.probes, Probes), "the mesh has a strip"
        other.model, other.probes = model, self.probes.moved(model, section)
        return other


def _probes(model: FieldModel, section: Section) -> Probes | MovingProbes:
    return Probes(model, section) if model.mesh.motion is None else MovingProbes(model, section)


def magnet_mesh(magnet: MagnetKind, gap: float, accuracy: Accuracy = "normal") -> TriangleMesh:
    """The mesh of a magnet at a gap, for an accuracy level."""
    return section_mesh(magnet, magnet.section(gap), size_of(magnet, accuracy))


def size_of(magnet: MagnetKind, accuracy: Accuracy) -> MeshSize:
    """The sizes of a mesh; finer where each gap has its own, so that energies of different meshes can be compared."""
    size = LEVELS[accuracy].size
    if not magnet.OWN_MESHES:
        return size
    return replace(size, iron=min(size.iron, FINER.iron), growth=min(size.growth, FINER.growth))


def degree_of(magnet: MagnetKind, accuracy: Accuracy) -> int:
    """The polynomial degree; 3 where each gap has its own mesh.

    A table's force between two gaps rests on the difference of two coenergies. On meshes of Roters' plunger magnet of
    their own at 2.5 and 3.5 mm, where the coenergy falls by 2 %, it missed the work of the force by 12 % at the sizes
    and the degree of `fast`, by 0.3 % with degree 3.
    """
    return max(LEVELS[accuracy].order, 3) if magnet.OWN_MESHES else LEVELS[accuracy].order


def section_mesh(magnet: MagnetKind, section: Section, size: MeshSize) -> TriangleMesh:
    """The mesh of a magnet's section, with its motion where it has no strip; raises ComputationError, InputError."""
    mesh = magnet.own_mesh() or triangulate(section, size)
    if section.moving is None:
        return mesh
    return replace(mesh, motion=_motion(mesh, section.moving, "x=0" if section.axisymmetric else "none"))


@lru_cache(maxsize=8)
def _motion(mesh: TriangleMesh, moving: MovingRegions, symmetry: Symmetry) -> MeshMotion:
    """How a mesh follows what moves; kept, as a mesh from a file is asked for at many gaps."""
    share = displacement_share(mesh, moving.names, air=moving.air, symmetry=symmetry)
    return MeshMotion(share, np.array(moving.direction))


def gap_reach(magnet: MagnetKind) -> tuple[float, float]:
    """The smallest and the largest gap in m that can be solved; of a mesh from a file those that it can follow to."""
    low, high = magnet.gaps
    if magnet.own_mesh() is None:
        return low, high
    section = magnet.section(low)
    mesh = section_mesh(magnet, section, MeshSize())
    assert mesh.motion is not None, "what is in a mesh from a file moves"
    down, up = moving_triangles(mesh, mesh.motion).reach()
    return max(low, mesh.gap + down), min(high, mesh.gap + up)


def chosen_ends(actuator: Actuator, wanted: EndEffects = None) -> KnownFactors:
    """The ends that are wanted of an actuator's magnet, by default what its file says; else as `wanted_ends`."""
    stated = False if wanted is None and actuator.end_effects == "none" else wanted
    return wanted_ends(actuator.magnet_kind(), stated)


def field_of(
    actuator: Actuator, gap: float, *, accuracy: Accuracy = "normal", end_effects: EndEffects = None
) -> MagnetField:
    """The field of an actuator's magnet, meshed at `gap`; end effects as in `chosen_ends`."""
    magnet = actuator.magnet_kind()
    mesh = magnet_mesh(magnet, gap, accuracy)
    remesh = partial(magnet_mesh, magnet, accuracy=accuracy) if magnet.OWN_MESHES else None
    ends = chosen_ends(actuator, end_effects)
    return MagnetField(
        magnet, mesh, folder=actuator.folder, order=degree_of(magnet, accuracy), end_effects=ends, remesh=remesh
    )


def with_margin(actuator: Actuator, travel: tuple[float, float], margin: tuple[float, float]) -> tuple[float, float]:
    """The ends of a default grid in m: as far beyond the travel as wanted, where the magnet can be solved so far."""
    smallest, largest = gap_reach(actuator.magnet_kind())
    return min(travel[0], max(margin[0], smallest)), max(travel[1], min(margin[1], largest))


def check_point(actuator: Actuator, current: float, gap: float) -> None:
    """InputError unless the gap is of the section's size and the current one that copper bears for a moment."""
    magnet = actuator.magnet_kind()
    smallest, largest = gap_reach(magnet)
    if not smallest <= gap <= largest:
        what = "the core's half width, " if largest == magnet.half_width else ""
        raise InputError(
            f"gap {format_quantity(gap, 'm')} is not allowed; it must be above 0, at least "
            f"{format_quantity(smallest, 'm')} and at most {what}{format_quantity(largest, 'm')}"
        )
    most = LARGEST_CURRENT_DENSITY * magnet.copper_area / magnet.turns
    if not abs(current) <= most:
        raise InputError(
            f"current {format_quantity(current, 'A')} is not allowed; it must be finite and within "
            f"-{most:.4g} ... {most:.4g} A: there the copper carries {LARGEST_CURRENT_DENSITY:g} A/m2, "
            "which melts it in milliseconds; lower it"
        )


def check_grid(actuator: Actuator, gaps: Sequence[float], currents: Sequence[float]) -> None:
    """InputError unless a table can be made of these gaps and currents: allowed points, apart, and not too many."""
    for gap in gaps:
        check_point(actuator, 0.0, gap)
    for current in currents:
        check_point(actuator, current, gaps[0])
    for name, values, unit in (("gaps", gaps, "m"), ("currents", currents, "A")):
        given = np.unique([0.0, *values])
        if given.size > MOST_NODES:
            raise InputError(f"{given.size} {name} are more than {MOST_NODES}; make the grid coarser")
        near = np.flatnonzero(np.diff(given) < CLOSEST * np.abs(given).max())
        if near.size:
            a, b = (format_quantity(float(v), unit) for v in given[near[0] : near[0] + 2])
            raise InputError(f"{name} {a} and {b} are closer than {CLOSEST:g} of the largest; leave one of them out")


def solve(
    actuator: Actuator, current: float, gap: float, *, accuracy: Accuracy = "normal", end_effects: EndEffects = None
) -> PointResult:
    """One field solution, with the force's error estimated by one polynomial degree more on the same mesh.

    `end_effects` : False for the plane section, True or factors for its correction; by default as the file says

    Raises
    ------
    InputError : a gap that is not positive or larger than the core's half width, an unknown accuracy
    ComputationError : the mesher or Newton's iteration failed
    """
    return solve_with_field(actuator, current, gap, accuracy=accuracy, end_effects=end_effects)[0]


@one_blas_thread
def solve_with_field(
    actuator: Actuator, current: float, gap: float, *, accuracy: Accuracy = "normal", end_effects: EndEffects = None
) -> tuple[PointResult, MagnetField, FieldSolution]:
    """As `solve`, with the field itself for pictures."""
    level_of(accuracy)
    check_point(actuator, current, gap)
    field = field_of(actuator, gap, accuracy=accuracy, end_effects=end_effects)
    point, solution = solve_with_estimate(field, lambda meshed: meshed.solve(current, gap), accuracy=accuracy)
    return point, field, solution
