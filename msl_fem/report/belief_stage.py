"""What was believed before anything was measured, and from where, as a stage of a page."""

from collections.abc import Mapping

from msl_fem.files.quantity import format_quantity
from msl_fem.plant.believed import PLAIN, Belief, BelievedValue
from msl_fem.plant.effects import find_parameter
from msl_fem.report.page import Grid, Stage

COLUMNS = ("parameter", "believed", "sigma", "from")


def belief_stage(belief: Belief, found: Mapping[tuple[str, str], float] | None = None) -> Stage:
    """The stage of a belief; `found` are values in SI units, by effect and parameter, to hold against it."""
    if belief.name == PLAIN:
        sentence = "The plain model: the table of one magnet, a mass on a spring, and nothing else (--belief plain)."
        return Stage("What was believed", sentence, ())
    rows = [(one.name, _text(one, one.value), _text(one, one.sigma), one.source) for one in belief.values]
    sentence = "The coupled model with all that the drawing tells, each value known within its sigma."
    if belief.left_out:
        sentence += f" Left out: {'; '.join(belief.left_out)}."
    for doubt in drawn_otherwise(belief, found or {}):
        sentence += f" {doubt}"
    return Stage("What was believed", sentence, (), table=Grid(COLUMNS, rows))


def drawn_otherwise(belief: Belief, found: Mapping[tuple[str, str], float]) -> list[str]:
    """Sentences on values found that the drawing does not allow: ten of its sigmas away."""
    told = []
    for one in belief.values:
        value = found.get(one.key)
        if value is not None and one.sigma and abs(value - one.value) > 10 * one.sigma:
            told.append(
                f"{one.name}: the drawing tells {_text(one, one.value)} within {_text(one, one.sigma)}, the record "
                f"{_text(one, value)}; look for another cause of the same form, or another drawing."
            )
    return told


def _text(one: BelievedValue, value: float) -> str:
    return format_quantity(value, find_parameter(*one.key).unit, digits=3)
