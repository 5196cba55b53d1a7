"""A stage at which evidence and what is taken point at two effects: what becomes of it with all effects together."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from msl_fem.diagnosis.conclusion import EffectSearch, _told_with
from msl_fem.diagnosis.decision import TIE, Rule
from msl_fem.diagnosis.effect_search import Chain, _Doubt
from msl_fem.diagnosis.likelihood import Fit
from msl_fem.diagnosis.null import NullDistribution
from msl_fem.diagnosis.search import SearchStage


def chain(*bests: tuple[str, float], loud: float, other: str) -> Chain:
    """A drift that leaves nearly all of what is loud, a hum that leaves a fifth more than the noise."""
    excesses = [{"x": 8.8, "u": 13.8}, {"x": 4.6, "u": 13.6}, {"x": 1.0, "u": loud}]
    fits: list[Any] = [SimpleNamespace(excess=excess) for excess in excesses[: len(bests) + 1]]
    found: list[Any] = []
    for effect, gain in bests:
        variant = SimpleNamespace(effect=effect, amounts=(SimpleNamespace(effect=effect, name="rms"),))
        found.append(SimpleNamespace(best=SimpleNamespace(gain=gain, variant=variant), null=NullDistribution()))
    return Chain(tuple(fits), tuple(found), _Doubt(0, other))


@pytest.mark.parametrize(
    ("loud", "other", "taken"),
    [(1.2, "periodic_disturbance", 2), (1.2, "coulomb_friction", 0), (1.05, "coulomb_friction", 2)],
    ids=["the other is one of them", "what remains unclear", "noise alone is left"],
)
def test_a_doubt_is_none_where_the_set_holds_both_or_leaves_noise(loud: float, other: str, taken: int) -> None:
    found = chain(("sensor_drift", 12e3), ("periodic_disturbance", 8e3), loud=loud, other=other).told(Rule())
    assert (found.taken, found.unclear) == (taken, "" if taken else other)


def refit(effect: str, gain: float, left: float) -> Any:
    """Effects beside a delay, that leave this number of a record's single one."""
    effects = tuple(SimpleNamespace(effect=name) for name in ("time_delay", effect))
    weights = SimpleNamespace(root=np.array([2.0]))
    fit = SimpleNamespace(unknowns=SimpleNamespace(effects=effects), residual=np.array([left]), weights=weights)
    fit.nats_apart = lambda other: Fit.nats_apart(fit, other)  # type: ignore[arg-type]
    return SimpleNamespace(variant=SimpleNamespace(effect=effect), gain=gain, fit=fit)


@pytest.mark.parametrize(
    ("behind", "apart", "told"),
    [(TIE - 1, 3.0, True), (TIE + 1, 0.9, True), (TIE + 1, 1.1, False), (2 * TIE + 1, 0.1, False)],
    ids=["as probable", "nearly as probable, and leaves the same", "leaves another rest", "priors speak against it"],
)
def test_what_a_record_cannot_tell_from_an_effect_is_told_with_it(behind: float, apart: float, told: bool) -> None:
    """Half the square of 2 times 1 is the limit of 2 nats."""
    best = refit("fringing", 100.0, 0.5)
    other = refit("leakage_inductance", 100.0 - behind, 0.5 + apart)
    alone = refit("gap_offset", 99.0 - 2 * TIE, 0.5)
    stages: Any = [None, SearchStage(best.fit, (), (best, other, alone))]
    found = EffectSearch((best.fit,) * 3, stages, ({},) * 3, 2)
    assert _told_with(found, 1) == (("leakage_inductance",) if told else ())
