"""What all kinds of magnets share: accuracy levels, one field solution with its error estimated, notes on the irons."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, Protocol, Self, TypeVar

from msl_fem.errors import InputError
from msl_fem.files.quantity import format_quantity
from msl_fem.files.shown import Shown
from msl_fem.magnetics.solver.magnetostatics import FieldModel, FieldSolution
from msl_fem.magnetics.solver.mesh import MeshSize
from msl_fem.magnetics.solver.postprocess import FieldQuantities
from msl_fem.materials.material import AnalyticIron, Iron, laminated, load_iron

Accuracy = Literal["fast", "normal", "fine"]


@dataclass(frozen=True)
class Discretisation:
    """Mesh sizes and polynomial degree of an accuracy level, and the factor of its error estimate.

    The force's relative error is estimated as `safety` times the larger of the relative changes of force and coenergy
    with one polynomial degree more on the same mesh. At a right-angled iron corner A behaves like r^(2/3), so a
    quadratic quantity's error falls like p^(-8/3) (Babuska and Suri 1987) and the change is 0.66 (p = 2) or 0.54
    (p = 3) of it: 2 covers both. Measured as needed, over E1's reference and at 78 (`fine`: 114) points of random
    magnets with a measured B-H curve: `fast` 2.05, `normal` 1.75, `fine` 3.7, in the median about 1. At `fine` the
    fronts of saturation inside the iron show at the knee of its curve, where a higher degree does not bring much.
    """

    size: MeshSize
    order: int
    safety: float = 2.0


LEVELS: dict[str, Discretisation] = {
    "fast": Discretisation(MeshSize(corner=0.1, gap=1.5, iron=0.6, growth=0.7), 2, 2.5),
    "normal": Discretisation(MeshSize(corner=0.02, gap=2.0, iron=0.6, growth=0.5), 2),
    "fine": Discretisation(MeshSize(corner=0.004, gap=3.0, iron=0.6, growth=0.75, across=0.2), 3, 4.0),
}


DOUBTFUL = 0.1
"""How far both routes of the force may be apart before a note says that."""


@dataclass(frozen=True, repr=False)
class PointResult(Shown):
    """One field solution of one magnet: `quantities`, the force's error estimate, and what it took.

    Attributes
    ----------
    force_error_estimate : relative to the force, see `Discretisation`; at least what both routes of the force differ by
    notes : what the reader must know: an iron's curve that was cut, a result that rests on a saturation tail
    """

    current: float
    gap: float
    quantities: FieldQuantities
    force_error_estimate: float
    unknowns: int
    newton_iterations: int
    residual_trail: tuple[float, ...]
    notes: tuple[str, ...] = ()

    def facts(self) -> dict[str, str]:
        """The point, its force with the error, flux linkage, inductance and the sections' flux density."""
        q = self.quantities
        force = f"{format_quantity(q.force, 'N')} ± {100 * self.force_error_estimate:.2g} %"
        at = f"{format_quantity(self.current, 'A')}, gap {format_quantity(self.gap, 'm')}"
        return {
            "at": at,
            "force": force,
            "flux linkage": format_quantity(q.flux_linkage, "Wb"),
            "incremental inductance": format_quantity(q.incremental_inductance, "H"),
            **{name.replace("_", " "): f"{density.mean:.3g} T" for name, density in q.flux_density.items()},
        }


class RefinableField(Protocol):
    """A meshed magnet that can be solved, read, and meshed again with one polynomial degree more."""

    model: FieldModel
    notes: tuple[str, ...]

    def quantities(self, solution: FieldSolution) -> FieldQuantities:
        """The numbers of the last solution."""
        ...

    def refined(self) -> Self:
        """The same mesh with one polynomial degree more."""
        ...


def level_of(accuracy: str) -> Discretisation:
    """The discretisation of an accuracy; InputError where there is none of that name."""
    if accuracy not in LEVELS:
        raise InputError(f"accuracy '{accuracy}' is unknown; choose one of {', '.join(LEVELS)}")
    return LEVELS[accuracy]


def irons_of(stated: Mapping[str, tuple[str, float]], folder: Path) -> dict[str, Iron | AnalyticIron]:
    """Region to its laminated iron, from region to (iron's name, stacking factor); raises MaterialError."""
    irons = {}
    for region, (name, stacking) in stated.items():
        irons[region] = laminated(load_iron(name, folder=folder), stacking)
    return irons


def iron_notes(irons: Mapping[str, Iron | AnalyticIron]) -> tuple[str, ...]:
    """What was done to the irons' curves, each note once."""
    return tuple(dict.fromkeys(iron.note for iron in irons.values() if iron.note))


def routes_apart(force: float, stress_tensor: float) -> float:
    """How far virtual work and stress tensor are apart, relative to the force; 0 where both vanish.

    On the exact field they agree (Coulomb and Meunier 1984), so the error of one of them is about that at least.
    """
    difference = abs(force - stress_tensor)
    return difference / abs(force) if force else math.inf if difference else 0.0


def force_error_estimate(level: Discretisation, coarse: FieldQuantities, fine: FieldQuantities) -> float:
    """The estimated relative error of a level's force, from the same point with one polynomial degree more."""
    pairs = [(coarse.force, fine.force), (coarse.coenergy, fine.coenergy)]
    return level.safety * max(abs(c - f) / abs(f) if f else 0.0 for c, f in pairs)


Field = TypeVar("Field", bound=RefinableField)


def solve_with_estimate(
    field: Field, solve: Callable[[Field], FieldSolution], *, accuracy: Accuracy
) -> tuple[PointResult, FieldSolution]:
    """One solution of a field and its numbers, with the force's error estimated; raises as `solve`.

    `solve` is called with the field and with the field of one polynomial degree more.
    """
    solution = solve(field)
    quantities = field.quantities(solution)
    finer = field.refined()
    error = force_error_estimate(level_of(accuracy), quantities, finer.quantities(solve(finer)))
    apart = routes_apart(quantities.force, quantities.force_stress_tensor)
    notes = field.notes
    if apart > DOUBTFUL:
        notes += (
            f"the force by virtual work, {quantities.force:.4g} N, and by the stress tensor, "
            f"{quantities.force_stress_tensor:.4g} N, are {apart:.0%} apart: the mesh cannot tell this force",
        )
    if quantities.rests_on_tail:
        regions = " and ".join(quantities.rests_on_tail)
        notes += (f"more than 1 % of the {regions} lies beyond the B-H curve's last point, on its saturation tail",)
    point = PointResult(
        current=solution.current,
        gap=solution.gap,
        quantities=quantities,
        force_error_estimate=max(error, apart),
        unknowns=field.model.free.size,
        newton_iterations=len(solution.trail),
        residual_trail=solution.trail,
        notes=notes,
    )
    return point, solution
