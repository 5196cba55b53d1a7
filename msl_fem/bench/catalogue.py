"""All effects that can be hidden, by name, and what a request to hide some says."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

from msl_fem.bench.electrical_effects import ELECTRICAL
from msl_fem.bench.magnetic_effects import MAGNETIC
from msl_fem.bench.mechanical_effects import MECHANICAL
from msl_fem.bench.outside_effects import OUTSIDE
from msl_fem.bench.sensing_effects import SENSING
from msl_fem.bench.setting import Effect
from msl_fem.errors import InputError

INSIDE = {effect.name: effect for effect in (*MAGNETIC, *ELECTRICAL, *MECHANICAL, *SENSING)}
OUTSIDE_BY_NAME = {effect.name: effect for effect in OUTSIDE}
USUAL_SIZE = 0.03
MOST_HIDDEN = 3
_PERCENT = re.compile(r"\s*(\d+\.?\d*|\.\d+)\s*%\s*")


@dataclass(frozen=True)
class Request:
    """What is to be hidden: an effect (None: any one outside the catalogue) and its size (0.03: three per cent)."""

    effect: Effect | None
    size: float


def parse_requests(texts: Sequence[str]) -> tuple[Request, ...]:
    """The requests of texts "NAME=3%", "outside", "outside:NAME=2%" or "none"; without a size three per cent.

    Raises
    ------
    InputError : an unknown effect, a size that is no percentage above 0, the same effect twice, more than three
    """
    wanted = [text.strip() for text in texts if text.strip() != "none"]
    if len(wanted) < len(texts) and wanted:
        raise InputError("--hide none goes alone; leave the others out, or leave out none")
    if len(wanted) > MOST_HIDDEN:
        raise InputError(f"--hide is given {len(wanted)} times; at most {MOST_HIDDEN} effects are hidden together")
    requests = tuple(_request(text) for text in wanted)
    names = [request.effect.name if request.effect else "outside" for request in requests]
    if len(set(names)) < len(names):
        raise InputError(f"--hide {names[0]} is there twice; name each effect once")
    return requests


def _request(text: str) -> Request:
    name, equals, size = (part.strip() for part in text.partition("="))
    group, colon, inner = (part.strip() for part in name.partition(":"))
    percent = _percent(size, text) if equals else USUAL_SIZE
    if name == "outside":
        return Request(None, percent)
    if group == "outside" and colon:
        if inner not in OUTSIDE_BY_NAME:
            raise InputError(f"--hide {text}: '{inner}' is no effect outside; there are {', '.join(OUTSIDE_BY_NAME)}")
        return Request(OUTSIDE_BY_NAME[inner], percent)
    if name not in INSIDE:
        raise InputError(
            f"--hide {text}: '{name}' is no effect; there are {', '.join(INSIDE)}; none; and outside[:NAME] with "
            f"{', '.join(OUTSIDE_BY_NAME)}"
        )
    return Request(INSIDE[name], percent)


def _percent(text: str, whole: str) -> float:
    match = _PERCENT.fullmatch(text)
    value = float(match.group(1)) / 100 if match else 0.0
    if not 0 < value <= 1:
        raise InputError(f"--hide {whole}: '{text}' is no size; give a percentage above 0 and up to 100, like 3%")
    return value
