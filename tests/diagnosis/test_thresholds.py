"""What acts beyond a threshold alone has no slope at nothing: it is tried in some sizes."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from diagnosed import SERVO, TABLE
from short_menu import cut_menu

from msl_fem.bench import BenchOptions, sealed_record
from msl_fem.diagnosis import DiagnosisSettings, diagnose
from msl_fem.diagnosis.problem import Points
from msl_fem.diagnosis.scores import Score
from msl_fem.diagnosis.search import FINITE, beyond_thresholds
from msl_fem.diagnosis.unknowns import EffectUnknown, Unknowns
from msl_fem.diagnosis.variants import Variant
from msl_fem.plant.excitation import parse_excitation

NOISE = "band-limited-noise:bias=0.6 A,amplitude=0.03 A,band=300 Hz,duration=1 s,seed=4,role=fit"
SWEEP = "swept-sine:bias=0.6 A,amplitude=0.02 A,start=10 Hz,stop=200 Hz,duration=0.6 s,role=held-out"
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

    threads = threads_here = 1

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


def test_an_amount_that_its_effect_s_candidates_lack_is_one_where_its_size_brings_a_good_part_of_any_score() -> None:
    found = beyond_thresholds(base(5000.0), EVERY, [DETUNED_DRIVE])
    assert [one.variant for one in found] == [SLEWING.variant, BOTH.variant], "friction's effect is not chosen"
    assert [one.guess.tolist() for one in found] == [[FINITE[2]], [FINITE[0], FINITE[2]]], "a lag begins at little"
    assert all(one.gain == pytest.approx(5000.0, abs=10.0) for one in found)
    assert not np.any([one.shift for one in found])


def test_none_is_where_a_linear_score_promises_four_times_as_much_or_candidates_have_it() -> None:
    assert beyond_thresholds(base(170.0), EVERY, [DETUNED_DRIVE]) == []
    assert beyond_thresholds(base(5000.0), EVERY, [DETUNED_DRIVE, BOTH]) == []


def test_a_delay_whose_slope_promises_nothing_is_tried_whatever_is_chosen() -> None:
    """Of an effect that is not chosen; where its slope tells of it, the linear score has chosen or left it."""
    late = EffectUnknown("time_delay", "command")
    delayed, guessed = score(-5.0, late), replace(score(5.0, late), guess=np.array([0.2]))

    class Late(Slewing):
        def spectra(self, points: Points) -> np.ndarray:
            assert points.effects is not None
            delay = np.array([late.z_of(float(row[late.place])) for row in points.effects])
            return 1e4 - self.depth * np.isclose(delay, FINITE[-1])[:, None]

    at = base(5000.0)
    at.likelihood = Late(5000.0)
    found = beyond_thresholds(at, [DETUNED_DRIVE, delayed, FRICTIONAL], [FRICTIONAL])
    assert [(one.variant, one.guess.tolist()) for one in found] == [(delayed.variant, [FINITE[-1]])]
    assert beyond_thresholds(at, [DETUNED_DRIVE, guessed, FRICTIONAL], [FRICTIONAL]) == []


def test_of_a_lag_within_a_period_counts_what_it_brings_when_all_else_has_moved_to_suit_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """That of an amplifier brought 486 nats as it was, and 1104 with the rest moved a step, of 3146 that a sensor's lag
    promised: it was never fitted, and that had its place."""
    monkeypatch.setattr("msl_fem.diagnosis.search.with_the_rest", lambda *at: 1e4 - 400.0)
    every = [DETUNED_DRIVE, replace(SLEWING, gain=-9.0), FRICTIONAL]
    found = beyond_thresholds(base(100.0), every, [DETUNED_DRIVE])
    assert [(one.variant, one.gain) for one in found] == [(SLEWING.variant, 400.0)]
    assert beyond_thresholds(base(-1.0), every, [DETUNED_DRIVE]) == [], "as it is it brings nothing"
    assert beyond_thresholds(base(100.0), [DETUNED_DRIVE, SLEWING], [DETUNED_DRIVE]) == [], "its slope tells of it"


def test_all_forms_of_an_amount_that_brings_more_are_tried() -> None:
    """With and without a shape: which of them lies first among scores that say nothing is chance."""
    shape = EffectUnknown("amplifier_bandwidth", "delay_share", 0.3, 0.8)
    shaped = replace(SLEWING, variant=replace(SLEWING.variant, shapes=(shape,)))
    found = beyond_thresholds(base(5000.0), [DETUNED_DRIVE, shaped, SLEWING], [DETUNED_DRIVE])
    assert [one.variant for one in found] == [shaped.variant, SLEWING.variant]


def test_a_drive_that_is_ten_thousand_times_slower_than_stated_has_its_name(monkeypatch: pytest.MonkeyPatch) -> None:
    """1 kHz, stated as 10 MHz: within a sample the stated drive follows, so the slope of its readings says nothing of
    a lag. A delay had the name, beside eddy currents and the sensor's lag."""
    runs = tuple(parse_excitation(text) for text in (NOISE, SWEEP))
    options = BenchOptions(seed=5, rate=1e4, excitations=runs, stated_bandwidth=10e6)
    cut_menu(monkeypatch, entries=0)
    told = diagnose(sealed_record(SERVO, TABLE, (), options).record, DiagnosisSettings(table=TABLE))
    assert told.names == ("amplifier_bandwidth",)
    [cause] = told.causes
    assert cause.parameters["lag"].value == pytest.approx(1 / (2 * np.pi * 1e3), rel=2e-3)
    assert told.verdict == "named"
