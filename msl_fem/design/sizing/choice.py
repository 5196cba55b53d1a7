"""The chosen design: verified at fine accuracy, as the rule asks."""

from collections.abc import Callable
from dataclasses import dataclass

from msl_fem.design.sizing.clash import broken
from msl_fem.design.sizing.design import Design
from msl_fem.design.sizing.judge import NOT_BUILT, Judge, Verdict
from msl_fem.design.sizing.parameters import design_from
from msl_fem.design.sizing.pareto import pareto_front
from msl_fem.design.sizing.search import GUESS, SearchResult
from msl_fem.design.sizing.trial_record import JudgedTrial
from msl_fem.errors import ComputationError
from msl_fem.files.quantity import format_quantity
from msl_fem.magnetics.kinds.accuracy import Accuracy

RULE = "the best in the first objective of all designs that meet all constraints, verified at fine accuracy"
VERIFIED: Accuracy = "fine"
MOST_TRIES = 10


@dataclass(frozen=True)
class Choice:
    """The chosen trial, and what the finest field says of its design; the front that it was chosen from.

    Attributes
    ----------
    guess : what the finest field says of the first guess, None where it cannot be built
    """

    trial: JudgedTrial
    design: Design
    verdict: Verdict
    front: tuple[JudgedTrial, ...]
    guess: Verdict | None


def choose(judge: Judge, found: SearchResult, *, progress: Callable[[int, int], None] | None = None) -> Choice:
    """The chosen design of a search, by `RULE`.

    The depth and the current are those of the finest field, so that the force is the wanted one there.

    Raises
    ------
    ComputationError : no trial met all constraints, or none of the front's first ones does at the finest accuracy
    """
    tell = progress or (lambda *_: None)
    front = pareto_front(found.trials, judge.requirement.objectives)
    if not front:
        raise ComputationError(_nothing_found(judge, found))
    tell(0, 2)
    guess = _verified_guess(judge, found)
    tell(1, 2)
    verdict = None
    for trial in front[:MOST_TRIES]:
        design = design_from(trial.parameters, found.space, judge)
        verdict = judge.by_field(design, accuracy=VERIFIED)
        if verdict.feasible:
            tell(2, 2)
            return Choice(trial, design, verdict, tuple(front), guess)
    assert verdict is not None
    raise ComputationError(
        f"the best designs miss a constraint at {VERIFIED} accuracy, the last one tried has "
        f"{', '.join(broken(verdict.constraints))}; "
        "run again with more --trials"
    )


def _verified_guess(judge: Judge, found: SearchResult) -> Verdict | None:
    """The first guess's design by the finest field, its constraints kept or not."""
    first = next((t for t in found.trials if t.first_design == GUESS), None)
    if first is None:
        return None
    try:
        verdict = judge.by_field(design_from(first.parameters, found.space, judge), accuracy=VERIFIED)
    except ComputationError:
        return None
    return verdict if verdict.performance is not None and verdict.judged != NOT_BUILT else None


def _nothing_found(judge: Judge, found: SearchResult) -> str:
    """The trial that comes closest, and what it misses."""
    requirement = judge.requirement
    wanted = f"{requirement.force.minimum:g} N at {format_quantity(requirement.force.gap, 'm')}"
    if not found.trials:
        return f"{requirement.name}: no design of {wanted} came to a verdict ({found.failed} fields failed)"
    closest = min(found.trials, key=lambda t: t.violation)
    return (
        f"{requirement.name}: none of {len(found.trials)} designs of {wanted} meets all constraints; the closest "
        f"(trial {closest.number}) has {', '.join(broken(closest.constraints))}; ask for less, allow more, or run "
        "again with more --trials"
    )
