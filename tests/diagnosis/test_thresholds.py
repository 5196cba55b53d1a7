"""What acts beyond a threshold alone has no slope at nothing: it is tried in some sizes."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from msl_fem.diagnosis.problem import Points
from msl_fem.diagnosis.scores import Score
from msl_fem.diagnosis.search import FINITE, beyond_thresholds
from msl_fem.diagnosis.unknowns import EffectUnknown, Unknowns
from msl_fem.diagnosis.variants import Variant

LAG, SLEW = (EffectUnknown("amplifier_bandwidth", name) for name in ("lag", "slew_time"))
DETUNED = EffectUnknown("amplifier_bandwidth", "bandwidth_error")
FRICTION = EffectUnknown("coulomb_friction", "force")


def score(gain: float, *amounts: EffectUnknown) -> Score:
    n = len(amounts)
    return Score(Variant(amounts[0].effect, amounts), gain, np.zeros(n), np.ones(2), np.eye(n))


DETUNED_DRIVE, BOTH, SLEWING, LAGGING = score(700.0, DETUNED), score(20.0, LAG, SLEW), score(9.0, SLEW), score(8.0, LAG)
FRICTIONAL = score(5.0, FRICTION)
EVERY = [DETUNED_DRIVE, BOTH, SLEWING, LAGGING, FRICTIONAL]


class Slewing:
    """A likelihood that falls by `depth` where a slew limit has one size, and by half of it where friction has any."""

    threads = 1

    def __init__(self, depth: float) -> None:
        self.depth = depth

    def gathering(self, runs: object) -> "Slewing":
        return self

    def spectra(self, points: Points) -> np.ndarray:
        assert points.effects is not None
        slew = np.array([SLEW.z_of(float(row[SLEW.place])) for row in points.effects])
        friction = np.array([FRICTION.z_of(float(row[FRICTION.place])) for row in points.effects])
        return 1e4 - self.depth * (np.isclose(slew, FINITE[2]) + 0.5 * (friction > 0.0))[:, None]

    def weights(self, residual: np.ndarray, unknowns: Unknowns) -> SimpleNamespace:
        return SimpleNamespace(nats=float(residual[0]))


def base(depth: float) -> Any:
    unknowns = Unknowns((("moving_mass", 0.01), ("stiffness", 0.01)), 0, ())
    return SimpleNamespace(unknowns=unknowns, z=np.zeros(2), objective=1e4, likelihood=Slewing(depth))


def test_an_amount_that_its_effect_s_candidates_lack_is_one_where_its_size_brings_more_than_any_score() -> None:
    found = beyond_thresholds(base(5000.0), EVERY, [DETUNED_DRIVE])
    assert [one.variant for one in found] == [SLEWING.variant, BOTH.variant], "friction's effect is not chosen"
    assert [one.guess.tolist() for one in found] == [[FINITE[2]], [0.0, FINITE[2]]]
    assert all(one.gain == pytest.approx(5000.0, abs=10.0) for one in found)
    assert not np.any([one.shift for one in found])


def test_none_is_where_a_linear_score_promises_more_or_candidates_have_it() -> None:
    assert beyond_thresholds(base(600.0), EVERY, [DETUNED_DRIVE]) == []
    assert beyond_thresholds(base(5000.0), EVERY, [DETUNED_DRIVE, BOTH]) == []
