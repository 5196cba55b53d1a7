"""Two equal magnets on either side of one armature, meshed once for every position of it between them.

Half of the section, from the armature's middle upwards, is meshed and mirrored, so that exchanging the sides changes
nothing but names. The strips of air on both sides of the armature stretch in opposite directions as it moves: every
derivative with respect to position and both currents is exact, as for one magnet.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse

from msl_fem.actuator import Actuator
from msl_fem.computing.arrays import Array
from msl_fem.errors import ActuatorError
from msl_fem.magnetics.field.accuracy import LEVELS, Accuracy, Discretisation, irons_of
from msl_fem.magnetics.field.end_effects import EndEffects, deeper_air_of_both, ends_of, wanted_ends
from msl_fem.magnetics.kinds.ends import leaked
from msl_fem.magnetics.kinds.kind import PlaneMagnet
from msl_fem.magnetics.section import Line, Region, Section, rectangle
from msl_fem.magnetics.solver.magnetostatics import FieldModel, FieldSolution, NewtonSettings, solve_field
from msl_fem.magnetics.solver.mesh import MeshSize, triangulate
from msl_fem.magnetics.solver.postprocess import (
    Cuts,
    SectionFluxDensity,
    cut_probe,
    gradient_maps,
    mid_gap,
)
from msl_fem.magnetics.solver.strip import STRIP, Strip, StripStiffness
from msl_fem.magnetics.triangles import TriangleMesh
from msl_fem.materials.constants import MU_0

SHARED = ("armature",)
"""Regions and cuts that both sides have in common."""
_COARSE = Discretisation(MeshSize(corner=1.0, gap=8.0, iron=2.0, growth=2.0), 2)
COMMON: dict[Accuracy, Discretisation] = {
    "fast": _COARSE,
    "normal": _COARSE,
    "fine": LEVELS["normal"],
}
"""For what both sides have in common, the field of both less that of each alone: what a mesh gets wrong of either side
falls out of the difference, so it may be coarse."""
ON_MIDDLE = 1e-9  # of the mesh's width: a point nearer to the armature's middle is its own mirror image


@dataclass(frozen=True)
class PairQuantities:
    """What the field of both magnets says, for the full stack depth, in SI units; equal signs of currents aid.

    `force` is on the armature towards side 1, by virtual work; all are derivatives of one discrete coenergy
    W'(x, i_1, i_2), x the armature's position towards side 1: force = dW'/dx, flux_linkage_k = dW'/di_k,
    incremental_inductance_k = d2W'/di_k2, mutual_inductance = d2W'/di_1 di_2, force_current_slope_k = d2W'/dx di_k,
    force_position_slope = d2W'/dx2.
    """

    coenergy: float
    flux_linkage_1: float
    flux_linkage_2: float
    force: float
    incremental_inductance_1: float
    incremental_inductance_2: float
    mutual_inductance: float
    force_current_slope_1: float
    force_current_slope_2: float
    force_position_slope: float


def pair_magnet(actuator: Actuator) -> PlaneMagnet:
    """The magnet of each side; ActuatorError where there are no two, or where they share no flat armature."""
    magnet = actuator.magnet_kind("the field of both sides")
    if not isinstance(magnet, PlaneMagnet):
        raise ActuatorError(
            f"{actuator.name}: the field of both sides is that of plane sections with a flat armature between; "
            "this magnet has none to share"
        )
    return magnet


def half_pair_section(magnet: PlaneMagnet, gap: float) -> Section:
    """Side 1 at a gap over the upper half of the armature; x = 0 is as in the magnet's own section."""
    part = magnet.section(gap)
    middle = -magnet.armature_thickness / 2
    wide = magnet.armature_half_width
    air = magnet.air_box
    side = max(magnet.half_width, wide) + air.side
    top = gap + magnet.height + air.top
    kept = [r for r in part.regions[1:] if r.name not in (STRIP, "armature")]
    return replace(
        part,
        regions=(
            rectangle("air", 0, middle, side, top),
            rectangle(STRIP, 0, 0, side, gap),
            rectangle("armature", 0, middle, wide, 0),
            *(Region({"air": STRIP}.get(r.name, r.name), r.vertices) if _in_strip(r, gap) else r for r in kept),
        ),
        corners=tuple(corner for corner in part.corners if corner[1] >= 0),
        cuts=(),
        far=1.0,
        parts=(),
    )


def _in_strip(region: Region, gap: float) -> bool:
    return max(y for _, y in region.vertices) <= gap


def mirrored(mesh: TriangleMesh, middle: float, shared: tuple[str, ...]) -> TriangleMesh:
    """The mesh and its mirror image about y = `middle`, which is its lower edge.

    Regions get the names NAME_1 above and NAME_2 below, but for those of `shared`, which keep theirs.
    """
    x, y = mesh.points
    width = float(np.ptp(x))
    own_image = np.abs(y - middle) < ON_MIDDLE * width
    y = np.where(own_image, middle, y)
    image = np.empty(x.size, dtype=np.int64)
    image[own_image] = np.flatnonzero(own_image)
    image[~own_image] = x.size + np.arange(np.count_nonzero(~own_image))
    points = np.stack([np.r_[x, x[~own_image]], np.r_[y, 2 * middle - y[~own_image]]])
    triangles = np.concatenate([mesh.triangles, image[mesh.triangles][[0, 2, 1]]], axis=1)
    upper = [name if name in shared else f"{name}_1" for name in mesh.names]
    lower = [name if name in shared else f"{name}_2" for name in mesh.names]
    names = tuple(dict.fromkeys([*upper, *lower]))
    numbers = [np.array([names.index(name) for name in of_half])[mesh.region] for of_half in (upper, lower)]
    return TriangleMesh(points, triangles, np.concatenate(numbers), names, mesh.gap)


def pair_mesh(
    magnet: PlaneMagnet, gap: float, accuracy: Accuracy = "normal", size: MeshSize | None = None
) -> TriangleMesh:
    """The mesh of both sides, each at the same gap, for an accuracy level or of stated sizes."""
    half = triangulate(half_pair_section(magnet, gap), size or LEVELS[accuracy].size)
    return mirrored(half, -magnet.armature_thickness / 2, SHARED)


class PairField:
    """The field of both sides on one mesh, ready for any position and currents.

    Parameters
    ----------
    actuator : with a plane magnet on either side
    mesh : of `pair_mesh`
    gap_sum : both gaps together, in m
    order : polynomial degree of the potential
    end_effects : of each side, as of one magnet (`wanted_ends`)

    Raises
    ------
    ActuatorError : the magnets share no armature
    InputError : end effects of a kind that states none
    """

    def __init__(
        self, actuator: Actuator, mesh: TriangleMesh, *, gap_sum: float, order: int, end_effects: EndEffects = False
    ) -> None:
        self.actuator, self.gap_sum, self.order = actuator, gap_sum, order
        self.magnet = magnet = pair_magnet(actuator)
        section = magnet.section(mesh.gap)
        core = section.iron["core"]
        iron = {"core_1": core, "core_2": core, "armature": section.iron["armature"]}
        self.irons = irons_of(iron, actuator.folder)
        self.scale = section.scale
        self.ends = ends = wanted_ends(magnet, end_effects)
        self.leakage = ends.leakage if ends else 0.0
        centre, middle = -magnet.armature_thickness / 2, gap_sum / 2
        self.model = FieldModel(
            mesh,
            self.irons,
            turns_density={},
            order=order,
            symmetry=section.symmetry,
            air_depth=deeper_air_of_both(ends_of(magnet), mesh.gap, ends, centre) if ends else None,
            strips=(Strip(f"{STRIP}_1", middle, -1.0), Strip(f"{STRIP}_2", middle, 1.0)),
        )
        turns = section.turns_density
        sides = ({f"{name}_{side}": density for name, density in turns.items()} for side in (1, 2))
        self.sources = tuple(self.model.with_turns(density).source for density in sides)
        self.mid_gaps = _mid_gaps(self.model)
        self.cuts = Cuts((cut.name, cut_probe(self.model, cut)) for cut in _cuts_of_both(section, magnet))

    def refined(self) -> "PairField":
        """The same mesh with one polynomial degree more."""
        mesh = self.model.mesh
        return PairField(self.actuator, mesh, gap_sum=self.gap_sum, order=self.order + 1, end_effects=self.ends)

    def solve(
        self,
        position: float,
        current_1: float,
        current_2: float,
        *,
        start: Array | None = None,
        settings: NewtonSettings | None = None,
    ) -> FieldSolution:
        """The field with the armature at `position` (m, towards side 1), from a potential nearby; NotConverged."""
        self.model.source = current_1 * self.sources[0] + current_2 * self.sources[1]
        return solve_field(self.model, 1.0, position, start=start, settings=settings)

    def responses(self, solution: FieldSolution) -> tuple[Array, Array]:
        """(3, n_dof) dA/dx, dA/di_1 and dA/di_2 at the last solution, and R.K^-1 R (3, 3), R = (-dS/dx A, f_1, f_2).

        The first by the factors at hand, those of the tangent one of Newton's steps before. With Y = K_0^-1 R of these,
        Y.R + R.Y - Y.K Y is wrong by the square of Y's error.
        """
        pull, _ = self.model.strip_products(solution.potential, solution.gap)
        rights = np.stack([-pull, *self.sources])
        found = self.model.tangent.substitute(rights)
        images = np.stack([self.model.tangent.product(solution.tangent, one) for one in found])
        both = rights @ found.T
        return found, both + both.T - found @ images.T

    def quantities(self, solution: FieldSolution, currents: tuple[float, float]) -> PairQuantities:
        """The numbers of the last solution."""
        _, seconds = self.responses(solution)
        found = self.row_quantities(solution.gap, np.array([currents]), solution.potential[None], seconds[None])
        return PairQuantities(**{name: float(values[0]) for name, values in found.items()})

    def row_quantities(self, position: float, currents: Array, potentials: Array, seconds: Array) -> dict[str, Array]:
        """The arrays (n,) of `PairQuantities` at a position and currents (n, 2).

        With E the field's energy at a given potential, dW'/dx = -dE/dx: virtual work (Coulomb 1983). The slopes follow
        by the responses of the potential, as those of one magnet. The end turns' leakage belongs to each side alone.

        Parameters
        ----------
        potentials : (n, n_dof)
        seconds : (n, 3, 3) the products of their `responses`
        """
        scale, first = self.scale, self.first_quantities(position, currents, potentials)
        _, bend = self.model.strip_products(potentials.T, position)
        leaks = [leaked(self.leakage, current) for current in currents.T]
        energy = scale * self.model.energies(potentials, position)
        stored = (currents * scale * (potentials @ np.stack(self.sources).T)).sum(axis=1) - energy
        seconds = scale * seconds
        return {
            "coenergy": stored + leaks[0]["coenergy"] + leaks[1]["coenergy"],
            **first,
            "incremental_inductance_1": seconds[:, 1, 1] + self.leakage,
            "incremental_inductance_2": seconds[:, 2, 2] + self.leakage,
            "mutual_inductance": seconds[:, 1, 2],
            "force_current_slope_1": seconds[:, 0, 1],
            "force_current_slope_2": seconds[:, 0, 2],
            "force_position_slope": seconds[:, 0, 0] - scale * (potentials * bend.T).sum(axis=1) / 2,
        }

    def first_quantities(self, position: float, currents: Array, potentials: Array) -> dict[str, Array]:
        """Both flux linkages and the force, (n,), of `row_quantities`."""
        pull, _ = self.model.strip_products(potentials.T, position)
        flux = [self.scale * (potentials @ source) for source in self.sources]
        leaks = [leaked(self.leakage, current)["flux_linkage"] for current in currents.T]
        return {
            "flux_linkage_1": flux[0] + leaks[0],
            "flux_linkage_2": flux[1] + leaks[1],
            "force": -self.scale * (potentials * pull.T).sum(axis=1) / 2,
        }

    def force_stress_tensor(self, solution: FieldSolution) -> float:
        """N on the armature towards side 1 by the second route: Maxwell's stress on the middle of both strips."""
        model, a = self.model, solution.potential
        total = 0.0
        for (along_x, along_y, weight), strip in zip(self.mid_gaps, model.strips, strict=True):
            assert isinstance(strip, StripStiffness), "a pair's mesh has strips"
            height = strip.strip.height(solution.gap)
            k, slope, _ = model.air_depth.strip(height)
            b_y, b_x = along_x @ a, (along_y @ a) * (model.mesh.gap / height)
            stress = float(weight @ (b_y**2 - b_x**2)) / (2 * MU_0) / k
            energy = float(a @ strip.product(a, solution.gap, model.air_depth)) / 2
            total -= strip.strip.rate * (stress - energy * slope / k)
        return self.scale * total

    def flux_densities(self, solution: FieldSolution) -> dict[str, SectionFluxDensity]:
        """|B| in the iron over the cuts of both sides, NAME_1 and NAME_2, and of the armature."""
        return self.cuts.flux_density(self.model, solution.potential)


def _mid_gaps(model: FieldModel) -> list[tuple[sparse.csr_matrix, sparse.csr_matrix, Array]]:
    """Maps to dA/dx and dA/dy on the lines in the middle of the strips, 1 and 2, and the points' weights."""
    points, elements, weight = mid_gap(model, f"{STRIP}_1")
    below = model.mesh.points[1].min() + model.mesh.points[1].max()  # twice the height of the plane of reflection
    image = np.stack([points[0], below - points[1]])
    lines = ((points, elements), (image, elements + model.mesh.region.size // 2))
    return [(*gradient_maps(model, *line), weight) for line in lines]


def _cuts_of_both(section: Section, magnet: PlaneMagnet) -> list[Line]:
    """The magnet's cuts on both sides, those of the armature once."""
    double = -magnet.armature_thickness
    cuts = []
    for cut in section.cuts:
        if max(cut.start[1], cut.end[1]) <= 0:
            cuts.append(cut)
            continue
        below = [(x, double - y) for x, y in (cut.start, cut.end)]
        cuts += [replace(cut, name=f"{cut.name}_1"), Line(f"{cut.name}_2", below[0], below[1])]
    return cuts
