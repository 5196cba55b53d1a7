"""Requirements that the tests of sizing share."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from msl_fem.design.sizing import DesignEvaluator, Requirement, first_designs, parse_requirement, search

SERVO: dict[str, Any] = {
    "schema": 1,
    "name": "servo",
    "force": {"minimum": "150 N", "gap": "0.5 mm"},
    "heat": {"current_density": "6 A/mm^2"},
}
"""A magnet of about the reference actuator's size; everything else by default."""


def envelope(width: str, height: str, depth: str) -> dict[str, Any]:
    return {"envelope": {"width": width, "height": height, "depth": depth}}


def requirement(**changes: Any) -> Requirement:
    return parse_requirement({**SERVO, **changes})


def evaluator(**changes: Any) -> DesignEvaluator:
    return DesignEvaluator(requirement(**changes))


@contextmanager
def one_beginning() -> Iterator[None]:
    """What the closed equations begin a search with is found once for each requirement: it draws nothing."""
    known: dict[str, Any] = {}

    def begin(it: DesignEvaluator) -> Any:
        key = it.requirement.model_dump_json(exclude={"file"}) + repr(it.end_effects)
        if key not in known:
            known[key] = first_designs(it)
        return known[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(search, "first_designs", begin)
        yield
