"""The design that a search ends with: the front, the choice verified at fine accuracy, and its actuator file."""

import math
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import numpy as np

from msl_fem.actuator import Actuator, Drive, IronSpec, Motion
from msl_fem.design.sizing.closed_search import broken
from msl_fem.design.sizing.design import Design, Performance
from msl_fem.design.sizing.evaluation import NOT_BUILT, DesignEvaluation, DesignEvaluator, direction
from msl_fem.design.sizing.parameters import design_from
from msl_fem.design.sizing.requirement import Objective, Requirement
from msl_fem.design.sizing.search import GUESS, SearchResult
from msl_fem.design.sizing.trials import EvaluatedTrial, unbeaten
from msl_fem.errors import ComputationError
from msl_fem.files.quantity import format_quantity
from msl_fem.files.schema import document
from msl_fem.files.toml_text import toml_text
from msl_fem.files.whole_file import whole_file
from msl_fem.magnetics.field.accuracy import Accuracy
from msl_fem.magnetics.field.end_effects import EndEffects
from msl_fem.magnetics.kinds import Magnet

RULE = "the best in the first objective of all designs that meet all constraints, verified at fine accuracy"
VERIFIED: Accuracy = "fine"
MOST_TRIES = 10
NATURAL_FREQUENCY = 60.0
"""Hz of the mover on its suspension where no stiffness is stated: about the reference actuator's."""
DAMPING_RATIO = 0.02
"""Where no damping is stated: flexures and air."""


def pareto_front(trials: Sequence[EvaluatedTrial], objectives: tuple[Objective, ...]) -> list[EvaluatedTrial]:
    """The feasible trials that no other one beats, best in the first objective first.

    A trial is beaten by one that is at least as good in all objectives and better in one; of equal ones the first
    stays.
    """
    feasible = sorted((t for t in trials if t.feasible), key=lambda t: t.number)
    if not feasible:
        return []
    signs = np.array([-1.0 if direction(o) == "maximize" else 1.0 for o in objectives])
    costs = np.array([t.values for t in feasible]) * signs
    first = {tuple(costs[k]): k for k in reversed(unbeaten(costs))}
    return [feasible[first[cost]] for cost in sorted(first)]


@dataclass(frozen=True)
class DesignChoice:
    """The chosen trial, and what the finest field says of its design; the front that it was chosen from.

    Attributes
    ----------
    guess : what the finest field says of the first guess, None where it cannot be built
    """

    trial: EvaluatedTrial
    design: Design
    evaluation: DesignEvaluation
    front: tuple[EvaluatedTrial, ...]
    guess: DesignEvaluation | None


def choose_design(
    evaluator: DesignEvaluator, found: SearchResult, *, progress: Callable[[int, int], None] | None = None
) -> DesignChoice:
    """The chosen design of a search, by `RULE`.

    The depth and the current are those of the finest field, so that the force is the wanted one there.

    Raises
    ------
    ComputationError : no trial met all constraints, or none of the front's first ones does at the finest accuracy
    """
    tell = progress or (lambda *_: None)
    front = pareto_front(found.trials, evaluator.requirement.objectives)
    if not front:
        raise ComputationError(_nothing_found(evaluator, found))
    tell(0, 2)
    guess = _verified_guess(evaluator, found)
    tell(1, 2)
    evaluation = None
    for trial in front[:MOST_TRIES]:
        design = design_from(trial.parameters, found.space, evaluator)
        evaluation = evaluator.by_field(design, accuracy=VERIFIED)
        if evaluation.feasible:
            tell(2, 2)
            return DesignChoice(trial, design, evaluation, tuple(front), guess)
    assert evaluation is not None
    raise ComputationError(
        f"the best designs miss a constraint at {VERIFIED} accuracy, the last one tried has "
        f"{', '.join(broken(evaluation.constraints))}; "
        "run again with more --trials"
    )


def _verified_guess(evaluator: DesignEvaluator, found: SearchResult) -> DesignEvaluation | None:
    """The first guess's design by the finest field, its constraints kept or not."""
    first = next((t for t in found.trials if t.first_design == GUESS), None)
    if first is None:
        return None
    try:
        evaluation = evaluator.by_field(design_from(first.parameters, found.space, evaluator), accuracy=VERIFIED)
    except ComputationError:
        return None
    return evaluation if evaluation.performance is not None and evaluation.stage != NOT_BUILT else None


def _nothing_found(evaluator: DesignEvaluator, found: SearchResult) -> str:
    """The trial that comes closest, and what it misses."""
    requirement = evaluator.requirement
    wanted = f"{requirement.force.minimum:g} N at {format_quantity(requirement.force.gap, 'm')}"
    if not found.trials:
        return f"{requirement.name}: no design of {wanted} came to a verdict ({found.failed} fields failed)"
    closest = min(found.trials, key=lambda t: t.violation)
    return (
        f"{requirement.name}: none of {len(found.trials)} designs of {wanted} meets all constraints; the closest "
        f"(trial {closest.number}) has {', '.join(broken(closest.constraints))}; ask for less, allow more, or run "
        "again with more --trials"
    )


def sized_actuator(
    found: Performance, requirement: Requirement, *, target: Path, end_effects: EndEffects = None
) -> Actuator:
    """The actuator around a sized magnet; the requirement's defaults fill what it does not state.

    `target` is the file that it is meant for: names of B-H files are made relative to it. A magnet that was sized
    without end effects says so in its file, so that what solves it sees the magnet that was sized.
    """
    motion = requirement.motion
    supply = requirement.supply
    mass = motion.payload + requirement.sides.magnets_per_side * found.masses.armature
    stiffness = motion.stiffness
    if stiffness is None:
        stiffness = _three_digits(mass * (2 * math.pi * NATURAL_FREQUENCY) ** 2)
    damping = motion.damping
    if damping is None:
        damping = _three_digits(2 * DAMPING_RATIO * math.sqrt(stiffness * mass))
    return Actuator(
        schema=1,
        name=requirement.name,
        end_effects="none" if end_effects is False else "section",
        magnet=cast(Magnet, found.magnet.model_copy(update={"iron": _iron(requirement, target)})),
        sides=requirement.sides,
        motion=Motion(
            moving_mass=float(f"{mass:.4g}"),
            stiffness=stiffness,
            damping=damping,
            nominal_gap=requirement.nominal_gap,
            range=requirement.range,
            constant_force=motion.constant_force,
        ),
        drive=Drive(
            kind="current", bandwidth=supply.bandwidth, voltage_limit=supply.voltage, current_limit=supply.current
        ),
        position_sensor=requirement.position_sensor,
        current_sensor=requirement.current_sensor,
        controller=requirement.controller,
        sources=_sources(found, requirement),
        file=target,
    )


def write_sized_actuator(actuator: Actuator, path: Path) -> None:
    """The actuator file, whole or not at all; InputError where it cannot be written."""
    with whole_file(path) as partial:
        partial.write_text(toml_text(document(actuator)), encoding="utf-8")


def _three_digits(value: float) -> float:
    return float(f"{value:.3g}")


def _iron(requirement: Requirement, target: Path) -> IronSpec:
    """The irons, their files named relative to the actuator file's folder."""

    def moved(name: str) -> str:
        if not name.endswith(".csv") or Path(name).is_absolute():
            return name
        return Path(os.path.relpath(requirement.folder / name, target.parent)).as_posix()

    iron = requirement.iron
    return iron.model_copy(update={"core": moved(iron.core), "armature": moved(iron.armature)})


def _sources(found: Performance, requirement: Requirement) -> dict[str, str]:
    wanted = f"{requirement.force.minimum:g} N at {requirement.force.gap * 1e3:g} mm below {requirement.flux.limit:g} T"
    armatures = requirement.sides.magnets_per_side
    said = {
        "magnet": f"sized by 'msl-fem size' from the requirement '{requirement.name}' ({wanted}): a magnet has "
        f"{found.force:.5g} N at {found.current:.5g} A with {found.flux_density:.4g} T in the "
        f"{found.section.replace('_', ' ')}",
        "motion.moving_mass": f"payload {requirement.motion.payload:g} kg and {armatures} armature(s) of "
        f"{found.masses.armature:.4g} kg",
    }
    if requirement.motion.stiffness is None:
        said["motion.stiffness"] = f"chosen: {NATURAL_FREQUENCY:g} Hz with the moving mass"
    if requirement.motion.damping is None:
        said["motion.damping"] = f"chosen: damping ratio {DAMPING_RATIO:g}"
    said["drive"] = "the requirement's supply; resistance from the winding"
    return said
