"""From a requirement to an actuator in one call, as a notebook wants it; `msl-fem size` shows each stage's progress."""

import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

from msl_fem.actuator import Actuator
from msl_fem.design.sizing.choice import DesignChoice, choose_design, sized_actuator
from msl_fem.design.sizing.evaluation import DesignEvaluator
from msl_fem.design.sizing.requirement import Requirement
from msl_fem.design.sizing.search import SearchResult, SearchSettings, search_designs
from msl_fem.magnetics.field.end_effects import EndEffects


@dataclass(frozen=True, eq=False)
class SizedMagnet:
    """A sized magnet: the actuator around it, the choice with its front, and the search that it was chosen from."""

    actuator: Actuator
    choice: DesignChoice
    search: SearchResult


def size_magnet(
    requirement: Requirement, settings: SearchSettings | None = None, *, end_effects: EndEffects = None
) -> SizedMagnet:
    """The magnet of a requirement, by closed equations, a search and fields.

    `settings.storage` keeps judged designs, so that the same call goes on; without settings nothing is kept.
    `end_effects` are those of the fields, by default what the kind knows; with False the actuator says so.

    Raises
    ------
    InputError : as `search_designs`
    ComputationError : no design meets all constraints; names the closest one and what it misses
    """
    with tempfile.TemporaryDirectory() as folder:
        how = settings or SearchSettings(storage="")
        if not how.storage:
            how = replace(how, storage=f"sqlite:///{folder}/trials.sqlite3")
        evaluator = DesignEvaluator(requirement, end_effects)
        search = search_designs(evaluator, how)
        choice = choose_design(evaluator, search)
    performance = choice.evaluation.performance
    assert performance is not None
    target = Path(f"{requirement.name}.toml")
    actuator = sized_actuator(performance, requirement, target=target, end_effects=end_effects)
    return SizedMagnet(actuator, choice, search)
