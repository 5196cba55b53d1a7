"""Requirements that the tests of sizing share."""

from typing import Any

from msl_fem.design.sizing import DesignEvaluator, Requirement, parse_requirement

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
