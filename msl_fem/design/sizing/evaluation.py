"""A design evaluated: by the closed equations, and by field solutions; what cannot be built reaches neither."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

from msl_fem.actuator import LARGEST_MAGNET, THINNEST
from msl_fem.design.sizing.closed_form import Factors, Irons, MagneticCircuit, UnloadedCircuit, unloaded
from msl_fem.design.sizing.design import (
    GRID,
    Constraint,
    Design,
    Performance,
    SectionPoint,
    at_least,
    at_most,
    building_constraints,
    grown,
    magnet_of,
    performance_constraints,
    plain_magnet,
    section_lengths,
    total_violation,
    wound,
)
from msl_fem.design.sizing.field_point import TOLERANCE, FieldPoint, StackDemand, field_point, stack_point
from msl_fem.design.sizing.requirement import Objective, Requirement
from msl_fem.errors import ComputationError
from msl_fem.magnetics.field.accuracy import Accuracy
from msl_fem.magnetics.field.end_effects import EndEffects, ends_of, gap_depth, wanted_ends
from msl_fem.magnetics.kinds.kind import SMALLEST_GAP
from msl_fem.materials.material import laminated, load_iron

CLOSED_FORM_ERROR = 0.1
"""Relative: what the closed equations may be wrong by where they refuse a design (docs/sizing.md has their errors)."""
MOST_SLENDER, LEAST_STACK = 50.0, 1e-3
"""Of the stack's depth: over the core's half width at most, and in m at least."""
MOST_DEPTHS = 6
SAME_FORCE = 1e-3
"""Depths of a stack at most, and the relative change of the closed equations' force per depth after which they have
it."""
MOST_SIZES, SURPLUS, TRIM = 5, 1e-2, 1e-3
"""A body of revolution grows so often at most, until its force is more than the wanted one by no more than a share; the
flux density is then trimmed to a smaller share."""
NOT_BUILT, NO_FIELD, SOLVED = "not built", "refused by the closed equations", "solved"


def _gridded(depth: float) -> float:
    """The grid's next multiple."""
    return round(math.ceil(depth / GRID) * GRID, 9)


@dataclass(frozen=True)
class SizedByField:
    """A body of revolution that has grown, the field of it (but where it can no longer be built), and all solutions."""

    design: Design
    found: FieldPoint


@dataclass(frozen=True)
class DesignEvaluation:
    """What is known of a design.

    Attributes
    ----------
    stage : NOT_BUILT, NO_FIELD or SOLVED: how far it came
    constraints : all that is known of it at that point
    performance : None where it is not built
    solves : field solutions that were spent on it
    """

    stage: str
    constraints: tuple[Constraint, ...]
    performance: Performance | None = None
    solves: int = 0

    @property
    def feasible(self) -> bool:
        return self.stage == SOLVED and all(c.kept for c in self.constraints)

    @property
    def violation(self) -> float:
        return total_violation(self.constraints)


Outcome = DesignEvaluation | str
"""An evaluation, or why the design's field failed."""


@dataclass(frozen=True)
class DesignEvaluator:
    """Evaluates designs against one requirement; a job whose rows are designs.

    `end_effects` : of the fields, by default what the kind knows of its ends
    """

    requirement: Requirement
    end_effects: EndEffects = None

    def solver(self) -> "DesignEvaluator":
        """Itself."""
        return self

    def solve(self, design: Design) -> Outcome:
        """The field's evaluation, or why there is none."""
        try:
            return self.by_field(design)
        except ComputationError as err:
            return str(err)

    @property
    def digest(self) -> str:
        """What a study's verdicts belong to: the requirement and the end effects."""
        return f"{self.requirement.digest} end_effects={self.end_effects}"

    @cached_property
    def irons(self) -> Irons:
        iron = self.requirement.iron
        folder = self.requirement.folder
        core = laminated(load_iron(iron.core, folder=folder), iron.core_stacking)
        if (iron.armature, iron.armature_stacking) == (iron.core, iron.core_stacking):
            return core, core  # one curve, read once for both
        return core, laminated(load_iron(iron.armature, folder=folder), iron.armature_stacking)

    def not_built(self, design: Design) -> DesignEvaluation | None:
        """The evaluation of a design that cannot be built, or None."""
        constraints = (*building_constraints(design, self.requirement), *self._proportions(design))
        return DesignEvaluation(NOT_BUILT, constraints) if any(not c.kept for c in constraints) else None

    def _proportions(self, design: Design) -> tuple[Constraint, ...]:
        """What a section's mesh and an actuator file ask for; only what is broken."""
        lengths = section_lengths(design, self.requirement)
        gap = self.requirement.force.gap
        largest = max(lengths)
        half_width = plain_magnet(design, self.requirement).half_width
        limits = (
            at_most("largest_length", largest, min(LARGEST_MAGNET, gap / SMALLEST_GAP), "m"),
            at_least("smallest_length", min(length for length in lengths if length > 0), THINNEST * largest, "m"),
            at_least("half_width", half_width, gap, "m"),
        )
        return tuple(c for c in limits if not c.kept)

    def by_closed_form(
        self, design: Design, *, factors: Factors | None = None, loads: Mapping[str, float] | None = None
    ) -> DesignEvaluation:
        """The evaluation by the closed equations (its `stage` is NO_FIELD where the design can be built).

        `loads` : by part of the iron how many times the flux density of the closed equations it carries
        """
        refused = self.not_built(design)
        if refused is not None:
            return refused
        return self._evaluated(NO_FIELD, design, self._closed(design, factors=factors, loads=loads))

    def circuit(self, design: Design, *, factors: Factors | None = None, depth: float | None = None) -> MagneticCircuit:
        """The closed equations at a design's flux density, 1 m deep where there is a depth.

        The gap's air is as deep as the ends of a stack of `depth` (m) make it; without one as the stack.
        """
        air_depth = (1.0, 0.0) if depth is None else self._air_depth(design)(depth)
        return self._unloaded(design, factors).loaded(self.irons, design.flux_density, air_depth)

    def _unloaded(self, design: Design, factors: Factors | None = None) -> UnloadedCircuit:
        circuit = plain_magnet(design, self.requirement).circuit
        assert circuit is not None, "a kind that is sized states its circuit"
        return unloaded(circuit, self.requirement.iron, gap=self.requirement.force.gap, factors=factors)

    def _air_depth(self, design: Design) -> Callable[[float], tuple[float, float]]:
        """By the depth of a stack in m: that of its gap's air over it, and the derivative with respect to the gap."""
        magnet = plain_magnet(design, self.requirement)
        factors = wanted_ends(magnet, self.end_effects)
        if factors is False:
            return lambda depth: (1.0, 0.0)
        ends, gap = ends_of(magnet), self.requirement.force.gap
        return lambda depth: gap_depth(replace(ends, depth=depth), factors, gap)[:2]

    def _closed(
        self, design: Design, *, factors: Factors | None = None, loads: Mapping[str, float] | None = None
    ) -> SectionPoint:
        """The closed equations' point, without factors with the gap's ends of the stack that has the force."""
        circuit = self._unloaded(design, factors)
        if loads:
            circuit = circuit.corrected(loads)
        air_depth = (1.0, 0.0)
        if factors is None and not self.requirement.revolved and self.end_effects is not False:
            at_depth = self._air_depth(design)
            force = circuit.driven(design.flux_density).force
            for _ in range(MOST_DEPTHS):
                before, air_depth = force, at_depth(design.force / force)
                force = circuit.driven(design.flux_density, air_depth).force
                if abs(force - before) <= SAME_FORCE * before:
                    break
        return circuit.loaded(self.irons, design.flux_density, air_depth).point

    def by_field(self, design: Design, *, accuracy: Accuracy = "fast") -> DesignEvaluation:
        """The evaluation by field solutions; without any where the design cannot be built.

        A design whose depth is far outside the envelope by the closed equations already is not solved either.

        Raises
        ------
        ComputationError : the mesher failed or a field did not converge
        """
        first = self.by_closed_form(design)
        if first.stage == NOT_BUILT or any(
            c.name == "envelope_depth" and c.violation > CLOSED_FORM_ERROR for c in first.constraints
        ):
            return first
        if self.requirement.revolved:
            return self._by_fields_of_sizes(design, accuracy)
        if self.end_effects is False:
            found = self.point_by_field(design, self.circuit(design).point.ampere_turns, accuracy=accuracy)
        else:
            found = self._with_ends(design, accuracy)
        return self._evaluated(SOLVED, design, found.point, depth=found.depth, solves=found.solves)

    def _with_ends(self, design: Design, accuracy: Accuracy) -> FieldPoint:
        """The field of the stack, on the grid, that has the force with its ends."""
        requirement = self.requirement
        point = self._closed(design)
        demand = StackDemand(
            flux_density=self._aimed_at(design),
            force=design.force,
            magnet=lambda depth: magnet_of(design, requirement, depth=depth, turns=requirement.sized.coils),
            allowed=lambda depth: all(c.kept for c in self._stack_limits(design, depth)),
            on_grid=_gridded,
        )
        return stack_point(
            demand, requirement.force.gap, FieldPoint(point, 0, _gridded(design.force / point.force)),
            slope=self.circuit(design).point.force, folder=requirement.folder, accuracy=accuracy,
            end_effects=self.end_effects,
        )  # fmt: skip

    def _aimed_at(self, design: Design) -> float:
        return min(design.flux_density, self.requirement.flux.limit * (1 - 2 * TOLERANCE))

    def point_by_field(
        self, design: Design, guess: float, *, depth: float | None = None, accuracy: Accuracy = "fast"
    ) -> FieldPoint:
        """The field at the design's flux density, of a stack with its ends, or without a depth of the plane section.

        The guess is of the ampere turns.
        """
        requirement = self.requirement
        deep = plain_magnet(design, requirement).half_width if depth is None else depth
        plane = depth is None and not requirement.revolved
        return field_point(
            magnet_of(design, requirement, depth=deep, turns=requirement.sized.coils), requirement.force.gap,
            self._aimed_at(design), guess=guess, folder=requirement.folder, accuracy=accuracy,
            end_effects=False if plane else self.end_effects,
        )  # fmt: skip

    def _by_fields_of_sizes(self, design: Design, accuracy: Accuracy) -> DesignEvaluation:
        """A body of revolution with the iron that its force asks for, found by cheap fields first."""
        sized = SizedByField(design, FieldPoint(self.circuit(design).point, 0))
        for level in dict.fromkeys(("fast", accuracy)):
            sized = self._sized(sized, level)
            refused = self.not_built(sized.design)
            if refused is not None:
                return replace(refused, solves=sized.found.solves)
        point, solves = sized.found.point, sized.found.solves
        surplus = point.force / sized.design.force
        if surplus > 1 + TRIM:
            less = math.sqrt((1 + TRIM) / surplus)
            trimmed = replace(sized.design, flux_density=less * point.flux_density)
            found = self.point_by_field(trimmed, less * point.ampere_turns, accuracy=accuracy)
            point, solves = found.point, solves + found.solves
        return self._evaluated(SOLVED, sized.design, point, solves=solves)

    def _sized(self, begin: SizedByField, accuracy: Accuracy) -> SizedByField:
        """The design whose iron has grown, with which the force goes as the square, until it has the force."""
        design, guess, solves = begin.design, begin.found.point.ampere_turns, begin.found.solves
        for size in range(1, MOST_SIZES + 1):
            found = self.point_by_field(design, guess, accuracy=accuracy)
            solves += found.solves
            surplus = found.point.force / design.force
            if 1 <= surplus <= 1 + SURPLUS or size == MOST_SIZES:
                break
            design = grown(design, math.sqrt((1 + SURPLUS / 2) / surplus))
            guess = found.point.ampere_turns
            if self.not_built(design) is not None:
                break
        return SizedByField(design, FieldPoint(found.point, solves))

    def _evaluated(
        self, stage: str, design: Design, point: SectionPoint, *, depth: float = 0.0, solves: int = 0
    ) -> DesignEvaluation:
        """The depth that gives the force, on the grid's next multiple, if not known; the winding; all constraints."""
        building = building_constraints(design, self.requirement)
        if self.requirement.revolved:
            depth = 1.0
        else:
            depth = depth or _gridded(design.force / point.force)
            broken = [c for c in self._stack_limits(design, depth) if not c.kept]
            if broken:
                return DesignEvaluation(stage, (*building, *broken), None, solves)
        found = wound(design, point, self.requirement, depth=depth)
        rest = (c for c in building if c.name != "envelope_depth")  # it was that of the end turns alone
        return DesignEvaluation(stage, (*rest, *performance_constraints(found, self.requirement)), found, solves)

    def _stack_limits(self, design: Design, depth: float) -> tuple[Constraint, Constraint]:
        largest = max(section_lengths(design, self.requirement))
        half_width = plain_magnet(design, self.requirement).half_width
        return (
            at_least("stack_depth", depth, max(LEAST_STACK, THINNEST * largest), "m"),
            at_most("stack_depth", depth, min(LARGEST_MAGNET, MOST_SLENDER * half_width), "m"),
        )


def objective_values(found: Performance, objectives: tuple[Objective, ...]) -> tuple[float, ...]:
    """The objectives in SI units, in the requirement's order."""
    values = {"mass": found.masses.total, "loss": found.loss, "force": found.force, "inductance": found.inductance}
    return tuple(values[name] for name in objectives)


def direction(objective: Objective) -> str:
    """ "maximize" or "minimize", as Optuna has it."""
    return "maximize" if objective == "force" else "minimize"
