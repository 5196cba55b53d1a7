"""The option `--belief`: what the coupled model is believed to have beside the plain one."""

from dataclasses import replace
from typing import Any

from msl_fem.actuator import Actuator
from msl_fem.cli.output import say
from msl_fem.errors import InputError
from msl_fem.plant.believed import AS_DESIGNED, PLAIN, PLAIN_BELIEF, Belief
from msl_fem.plant.effects import EffectValues
from msl_fem.plant.extended_model import ExtendedModel
from msl_fem.record import Record
from msl_fem.record.rig_file import BeliefWord
from msl_fem.table.magnetic_table import MagneticTable

DEFAULT: BeliefWord = AS_DESIGNED
"""What commands believe of a measured record or an actuator where neither --belief nor rig.toml says."""


def stated_belief(name: str) -> BeliefWord:
    """The name of a belief; InputError where there is none of that name."""
    for known in (AS_DESIGNED, PLAIN):
        if name == known:
            return known
    raise InputError(f"--belief '{name}' is unknown; choose {AS_DESIGNED} or {PLAIN}")


def belief_of(name: str | None, actuator: Actuator, table: MagneticTable | None) -> Belief:
    """The belief of that name, told on stderr in a line; without a name `DEFAULT`. Raises as `stated_belief`."""
    if stated_belief(name or DEFAULT) == PLAIN:
        return PLAIN_BELIEF
    # here, for the field solver's import takes longer than a small command
    from msl_fem.comparison.as_designed import as_designed

    belief = as_designed(actuator, table)
    if belief.values:
        told = f"believed as designed: {_effects(belief)}"
        say(f"{told} (simulate --json lists values and sources; --belief plain goes without)")
    for reason in belief.left_out:
        say(f"note: not in the belief: {reason}")
    return belief


def _effects(belief: Belief) -> str:
    """The believed effects by name: those that add something, and those that the table has."""
    adds: dict[str, bool] = {}
    for one in belief.values:
        adds[one.effect] = adds.get(one.effect, False) or one.value != 0.0
    added, there = (
        ", ".join(name.replace("_", " ") for name, it_adds in adds.items() if it_adds == wanted)
        for wanted in (True, False)
    )
    return f"{added}; in the table already: {there}" if there else added


def belief_about(record: Record, table: MagneticTable | None) -> Belief:
    """The belief that a record states; of a simulated one that states none plain, for it has what it was told."""
    simulated = PLAIN if record.origin == "simulated" else None
    return belief_of(record.belief or simulated, record.actuator, table)


def model_with_belief(
    name: str | None, model: ExtendedModel, table: MagneticTable | None
) -> tuple[ExtendedModel, Belief]:
    """(the model, the belief): a plain actuator has the effects of the belief, an extended model its own alone.

    Raises
    ------
    InputError : as `stated_belief`; an extended model is asked to be as designed
    """
    if model.effects.stated:
        if name is not None and stated_belief(name) == AS_DESIGNED:
            raise InputError(
                f"{model.actuator.name}: states its own effects, which --belief {AS_DESIGNED} would replace; give the "
                "plain actuator, or leave the option out"
            )
        return model, PLAIN_BELIEF
    belief = belief_of(name, model.actuator, table)
    return replace(model, effects=belief.effects or EffectValues()), belief


def belief_fields(belief: Belief, *, as_json: bool) -> dict[str, Any]:
    """What a command's result says of the belief: all of it in JSON; for people, who read it on stderr, its name."""
    return {"belief": belief.to_json() if as_json else belief.name}
