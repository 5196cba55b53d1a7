"""The best design by the closed equations, thousands of them in a second; and demands that no magnet meets together."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.optimize import differential_evolution, minimize

from msl_fem.computing.arrays import Array
from msl_fem.design.sizing.design import GRID, Constraint, Design, plain_magnet
from msl_fem.design.sizing.evaluation import CLOSED_FORM_ERROR, DesignEvaluation, DesignEvaluator
from msl_fem.design.sizing.parameters import BEYOND, ParameterSpan, SearchSpace, design_from, parameters_of
from msl_fem.design.sizing.requirement import Envelope
from msl_fem.errors import ComputationError, RequirementError
from msl_fem.files.quantity import format_quantity

Score = Callable[[DesignEvaluation], float]
"""Of a design with a performance; the least is wanted."""
REFUSED = 1e6
"""Of a score that is no answer: worse than all that are."""
_POPULATION, _GENERATIONS = 6, 40
_STEP, _EVALUATIONS = 0.15, 300  # of the simplex: of each span
ROOMY = 1e4
"""Times the envelope: in it every design can be evaluated, whatever its size."""
LEAST_FLUX = 0.02
"""Of the flux limit: how little the iron may carry where room for copper is what lacks."""
LEAST_FORCE = 1e-3
"""Of the wanted force: how little there may be room for."""
_PENALTY = 100.0  # of what is not asked about
_SLIGHT = 0.01  # of a limit: what rounded dimensions break
_ENVELOPE = "envelope_"


@dataclass(frozen=True)
class ClosedFormOptimum:
    """The design with the least score."""

    design: Design
    evaluation: DesignEvaluation
    score: float


@dataclass(frozen=True)
class ClosedSearch:
    """Looks for the design with the least score; what cannot be built scores by what is broken, above all others.

    Attributes
    ----------
    change : made to each design before it is evaluated
    """

    evaluator: DesignEvaluator
    space: SearchSpace
    score: Score
    change: Callable[[Design], Design] = lambda design: design

    def everywhere(self, *, seed: int = 1) -> ClosedFormOptimum:
        """In the whole space (differential evolution, Storn and Price 1997)."""
        found = differential_evolution(
            self._cost, [(0.0, 1.0)] * len(self.space.spans), popsize=_POPULATION, maxiter=_GENERATIONS, tol=1e-4,
            rng=np.random.default_rng(seed), polish=False,
        )  # fmt: skip
        return self._found(found.x)

    def near(self, start: Design) -> ClosedFormOptimum:
        """Downhill from a design (Nelder and Mead 1965, coefficients of Gao and Han 2012)."""
        values = parameters_of(start, self.space, self.evaluator)
        origin = np.array([_place(values[name], span) for name, span in self.space.spans.items()])
        inward = np.diag(np.where(origin < 0.5, _STEP, -_STEP))
        found = minimize(
            self._cost, origin, method="Nelder-Mead", bounds=[(0.0, 1.0)] * origin.size,
            options={
                "maxfev": _EVALUATIONS, "initial_simplex": np.vstack([origin, origin + inward]), "adaptive": True,
                "xatol": 1e-3, "fatol": 1e-4,
            },
        )  # fmt: skip
        return self._found(found.x)

    def _cost(self, places: Array) -> float:
        evaluation = self.evaluator.by_closed_form(self._design(places))
        return REFUSED * (1 + evaluation.violation) if evaluation.performance is None else self.score(evaluation)

    def _design(self, places: Array) -> Design:
        spans = self.space.spans.items()
        parameters = {name: _value(float(place), span) for place, (name, span) in zip(places, spans, strict=True)}
        return self.change(design_from(parameters, self.space, self.evaluator))

    def _found(self, places: Array) -> ClosedFormOptimum:
        design = self._design(places)
        return ClosedFormOptimum(design, self.evaluator.by_closed_form(design), self._cost(places))


def _value(place: float, span: ParameterSpan) -> float:
    """The value at a place between 0 and 1."""
    if span.log:
        return span.low * (span.high / span.low) ** place
    return span.low + (span.high - span.low) * place


def _place(value: float, span: ParameterSpan) -> float:
    if span.log:
        return float(np.log(value / span.low) / np.log(span.high / span.low))
    return (value - span.low) / (span.high - span.low)


@dataclass(frozen=True)
class ContradictionSearch:
    """Asks the closed equations what a requirement would need."""

    evaluator: DesignEvaluator
    space: SearchSpace

    @cached_property
    def roomy(self) -> DesignEvaluator:
        """The evaluator without an envelope."""
        envelope = self.evaluator.requirement.envelope
        stated = {name: getattr(envelope, name) for name in ("width", "height", "depth")}
        # as large as it comes: no actuator file is to hold it
        wide = Envelope.model_construct(**{n: None if size is None else size * ROOMY for n, size in stated.items()})
        return DesignEvaluator(self.evaluator.requirement.model_copy(update={"envelope": wide}))

    def closest(self) -> ClosedFormOptimum:
        """The design whose largest violation is the least; its verdict's constraints are the requirement's own."""
        found = ClosedSearch(self.roomy, self.space, lambda v: _worst(_narrow(v.constraints))).everywhere()
        return replace(found, evaluation=replace(found.evaluation, constraints=_narrow(found.evaluation.constraints)))

    def needed_envelope(self) -> tuple[float, tuple[Constraint, ...]]:
        """How many times as large the envelope must be, all else kept, and its constraints at that design."""

        def score(evaluation: DesignEvaluation) -> float:
            demands = _narrow(evaluation.constraints)
            return (
                1
                + _worst(c for c in demands if _of_envelope(c))
                + _PENALTY * max(0.0, _worst(c for c in demands if not _of_envelope(c)))
            )

        found = ClosedSearch(self.roomy, self.space, score).everywhere()
        return found.score, tuple(c for c in _narrow(found.evaluation.constraints) if _of_envelope(c))

    def strongest(self) -> ClosedFormOptimum:
        """The design inside the envelope with the most force: its stack, or its pole, as large as there is room for."""
        flux = {"flux_share": ParameterSpan(LEAST_FLUX, BEYOND, False)}
        if self.evaluator.requirement.revolved:
            more, change = {"force_share": ParameterSpan(LEAST_FORCE, 1.0, True)}, lambda design: design
        else:
            more, change = {}, self._deepest
        space = replace(self.space, spans=self.space.spans | flux | more)

        def score(evaluation: DesignEvaluation) -> float:
            assert evaluation.performance is not None
            others = _worst(c for c in evaluation.constraints if c.name != "force")
            return -evaluation.performance.force * (1 - _PENALTY * max(0.0, others))

        return ClosedSearch(self.evaluator, space, score, change).everywhere()

    def _deepest(self, design: Design) -> Design:
        """The design with the force of the deepest stack that the envelope has room for."""
        requirement = self.evaluator.requirement
        size = plain_magnet(design, requirement, depth=0.0).outer_size
        assert requirement.envelope.depth is not None
        assert size is not None
        stack = max(requirement.envelope.depth - GRID - size[2], GRID)
        return replace(design, force=stack * self.evaluator.circuit(design, depth=stack).point.force)


def refuse_contradiction(evaluator: DesignEvaluator, space: SearchSpace) -> Design:
    """The closed equations' closest design, where the requirement may be met.

    Raises
    ------
    RequirementError : even that design breaks a constraint by more than the closed equations are wrong by; the message
        names the constraints, the force that there is room for, and the envelope that would do
    """
    asked = ContradictionSearch(evaluator, space)
    requirement = evaluator.requirement
    closest = asked.closest()
    if closest.score <= CLOSED_FORM_ERROR:
        return closest.design
    said = [
        f"{requirement.name} cannot be met: {requirement.force.minimum:g} N at "
        f"{format_quantity(requirement.force.gap, 'm')} below {requirement.flux.limit:g} T; the closest design has "
        + ", ".join(broken(closest.evaluation.constraints, beyond=_SLIGHT))
    ]
    stated = requirement.envelope.model_dump(exclude_none=True)
    if stated and (requirement.revolved or "depth" in stated):
        said.append(_room(asked))
    if any(_of_envelope(c) for c in closest.evaluation.constraints):
        times, sides = asked.needed_envelope()
        if times < _PENALTY:
            sizes = " x ".join(f"{c.limit * times * 1e3:.3g}" for c in sides)
            names = " x ".join(c.name.removeprefix(_ENVELOPE) for c in sides)
            said.append(f"the envelope must be {times:.3g} times as large, {sizes} mm ({names})")
    raise RequirementError("; ".join([*said, "ask for less force, or allow more flux density, room, heat or supply"]))


def broken(constraints: Iterable[Constraint], *, beyond: float = 0.0) -> list[str]:
    """The constraints broken beyond a share of their limit, the worst first: "envelope_width 35 mm (at most 20 mm)"."""
    worst_first = sorted((c for c in constraints if c.violation > beyond), key=lambda c: -c.violation)
    return [
        f"{c.name} {format_quantity(c.value, c.unit, digits=3)} (at {'most' if c.upper else 'least'} "
        f"{format_quantity(c.limit, c.unit, digits=3)})"
        for c in worst_first
    ]


def _room(asked: ContradictionSearch) -> str:
    """How much force the envelope has room for, by the closed equations and, at that design, by the field."""
    found = asked.strongest()
    if found.evaluation.performance is None or found.score >= 0:
        return "into the envelope fits no magnet at all"
    force = found.evaluation.performance.force
    magnet = found.evaluation.performance.magnet
    iron = found.design.flux_density
    depth = magnet.section(magnet.half_width).depth
    text = f"in the stated envelope the other limits allow at most {force:.3g} N (iron at {iron:.3g} T)"
    try:
        guess = asked.evaluator.circuit(found.design).point.ampere_turns
        point = asked.evaluator.point_by_field(found.design, guess, depth=depth).point
    except ComputationError:
        return text
    return f"{text} by the closed equations, {depth * point.force:.3g} N by the field of that design"


def _of_envelope(constraint: Constraint) -> bool:
    return constraint.name.startswith(_ENVELOPE)


def _narrow(constraints: Iterable[Constraint]) -> tuple[Constraint, ...]:
    """The constraints with the envelope's own limits."""
    return tuple(replace(c, limit=c.limit / ROOMY) if _of_envelope(c) else c for c in constraints)


def _worst(constraints: Iterable[Constraint]) -> float:
    return max((c.violation for c in constraints), default=0.0)
