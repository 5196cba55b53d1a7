"""A stage at which evidence and what is taken point at two effects: what becomes of it with all effects together."""

from types import SimpleNamespace
from typing import Any

import pytest

from msl_fem.diagnosis.decision import Rule
from msl_fem.diagnosis.effect_search import _Chain, _Doubt
from msl_fem.diagnosis.null import NullDistribution


def chain(*bests: tuple[str, float], loud: float, other: str) -> _Chain:
    """A drift that leaves nearly all of what is loud, a hum that leaves a fifth more than the noise."""
    excesses = [{"x": 8.8, "u": 13.8}, {"x": 4.6, "u": 13.6}, {"x": 1.0, "u": loud}]
    fits: list[Any] = [SimpleNamespace(excess=excess) for excess in excesses[: len(bests) + 1]]
    found: list[Any] = []
    for effect, gain in bests:
        variant = SimpleNamespace(effect=effect, amounts=(SimpleNamespace(effect=effect, name="rms"),))
        found.append(SimpleNamespace(best=SimpleNamespace(gain=gain, variant=variant), null=NullDistribution()))
    return _Chain(tuple(fits), tuple(found), _Doubt(0, other))


@pytest.mark.parametrize(
    ("loud", "other", "taken"),
    [(1.2, "periodic_disturbance", 2), (1.2, "coulomb_friction", 0), (1.05, "coulomb_friction", 2)],
    ids=["the other is one of them", "what remains unclear", "noise alone is left"],
)
def test_a_doubt_is_none_where_the_set_holds_both_or_leaves_noise(loud: float, other: str, taken: int) -> None:
    found = chain(("sensor_drift", 12e3), ("periodic_disturbance", 8e3), loud=loud, other=other).told(Rule())
    assert (found.taken, found.unclear) == (taken, "" if taken else other)
