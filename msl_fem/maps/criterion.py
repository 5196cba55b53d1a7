"""Where in the iron a map's flux density is read: the criterion and its text."""

import math
from dataclasses import dataclass
from typing import Literal

from msl_fem.errors import InputError, QuantityError
from msl_fem.files.quantity import format_quantity, parse_quantity

MEAN, PERCENTILE, MAX = "mean", "percentile", "max"
CORNER_RADIUS = 0.5e-3
"""m: the default radius around the iron's corners that the criterion `max` leaves out."""
WAY_OUT = "choose mean, percentile=95 (per cent of the iron's area) or max=0.5mm (radius left out at corners)"


@dataclass(frozen=True)
class Criterion:
    """A criterion: `percent` of the area for a percentile, `radius` in m around the corners for the largest value."""

    kind: Literal["mean", "percentile", "max"]
    percent: float = math.nan
    radius: float = math.nan

    @property
    def meaning(self) -> str:
        """What is read, in words; |B| always in the iron itself, not averaged over a stack's sheets."""
        if self.kind == MEAN:
            return (
                "mean of |B| in the iron over the most loaded section: legs at mid-window height, yoke and armature at "
                "mid-window width"
            )
        if self.kind == PERCENTILE:
            return f"|B| in the iron that {self.percent:g} % of the iron's area, core and armature, does not exceed"
        return f"largest |B| in the iron farther than {format_quantity(self.radius, 'm')} from its corners"


def parse_criterion(text: str) -> Criterion:
    """The criterion of a text: `mean`, `percentile=95`, `max` or `max=0.5mm`.

    Raises
    ------
    InputError : another text, a percentile that is not between 0 and 100, a radius that is not positive
    """
    kind, given, value = (part.strip() for part in text.partition("="))
    if kind == MEAN and not given:
        return Criterion("mean")
    try:
        if kind == MAX:
            return _largest(text, parse_quantity(value, "m") if given else CORNER_RADIUS)
        if kind == PERCENTILE and given:
            return _percentile(text, parse_quantity(value.removesuffix("%"), ""))
    except QuantityError as err:
        raise InputError(f"criterion '{text[:80]}': {err}") from err
    raise InputError(f"criterion '{text[:80]}' is unknown; {WAY_OUT}")


def _largest(text: str, radius: float) -> Criterion:
    if not radius > 0:
        raise InputError(f"criterion '{text}': the radius must be positive, {format_quantity(radius, 'm')} is not")
    return Criterion("max", radius=radius)


def _percentile(text: str, percent: float) -> Criterion:
    if not 0 < percent < 100:
        raise InputError(f"criterion '{text}': the percentile must lie between 0 and 100, {percent:g} does not")
    return Criterion("percentile", percent=percent)
