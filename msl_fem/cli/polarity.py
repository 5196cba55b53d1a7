"""What both polarities of two sides cost on the armature at hand, for the commands that say it."""

from typing import Any

from msl_fem.actuator import Actuator
from msl_fem.magnetics.field.accuracy import Accuracy
from msl_fem.magnetics.field.end_effects import EndEffects
from msl_fem.magnetics.field.two_sided import polarity_costs
from msl_fem.magnetics.field.two_sided_section import TwoSidedPosition
from msl_fem.magnetics.kinds.kind import PlaneMagnet


def what_a_polarity_costs(
    actuator: Actuator,
    currents: tuple[float, float],
    position: TwoSidedPosition,
    *,
    accuracy: Accuracy,
    end_effects: EndEffects = None,
) -> dict[str, Any]:
    """The JSON field `polarity`: what two magnets apart miss of force and flux linkage, by how the fluxes meet.

    Opposing ones add up in the armature, aiding ones go straight through it. Empty where one side has no current.
    """
    if not all(currents):
        return {}
    costs: dict[str, Any] = {"of_these_currents": "aiding" if currents[0] * currents[1] > 0 else "opposing"}
    if actuator.sides is not None:
        costs["of_the_actuator"] = actuator.sides.polarity
    for name, apart in polarity_costs(actuator, currents, position, accuracy=accuracy, end_effects=end_effects).items():
        costs[name] = {
            "force_error_of_sides_apart": apart.force_error,
            "flux_error_of_sides_apart": [apart.flux_error_1, apart.flux_error_2],
        }
    return {"polarity": costs}


def polarity_off_the_middle(actuator: Actuator, current: float, *, accuracy: Accuracy = "normal") -> dict[str, Any]:
    """`what_a_polarity_costs` with the armature half its range off the middle and that current (A) in both magnets.

    Empty where there are no two plane magnets with an armature between.
    """
    motion, sides = actuator.motion, actuator.sides
    two_plane = sides is not None and sides.count == 2 and isinstance(actuator.magnet, PlaneMagnet)
    if not two_plane or motion is None or motion.nominal_gap is None or motion.range is None:
        return {}
    gaps = motion.nominal_gap - motion.range / 2, motion.nominal_gap + motion.range / 2
    return what_a_polarity_costs(actuator, (current, current), TwoSidedPosition(*gaps), accuracy=accuracy)


def polarity_sentence(costs: dict[str, Any]) -> str:
    """What `polarity_off_the_middle` found, in words."""
    opposing, aiding = (100 * abs(costs[name]["force_error_of_sides_apart"]) for name in ("opposing", "aiding"))
    flux = [100 * max(map(abs, costs[name]["flux_error_of_sides_apart"])) for name in ("opposing", "aiding")]
    return (
        f"half the range off the middle, both sides at this current: two magnets apart miss {opposing:.2g} % of the "
        f"force and {flux[0]:.2g} % of the flux linkage where they oppose, {aiding:.2g} % and {flux[1]:.2g} % where "
        f"they aid; the file says {costs['of_the_actuator']}, and the armature is sized for one side on at a time"
    )
