"""Suspects: changes by closed forms, what a re-fit and an ARMAX make up for, what is told where nothing can be."""

from functools import partial
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT

from msl_fem.actuator import Actuator, load_actuator
from msl_fem.cli.suspects import print_ranking
from msl_fem.diagnosis.planning import PlannedRuns, ranking, standard_excitations
from msl_fem.diagnosis.planning.expected import ExpectedCause
from msl_fem.diagnosis.planning.ranking import NOT_BORNE, Suspect, SuspectJudge, SuspectRanking
from msl_fem.errors import InputError
from msl_fem.plant import linearise
from msl_fem.plant.effects import EffectValues
from msl_fem.plant.excitation import parse_excitation
from msl_fem.prediction import ModelHypothesis
from msl_fem.table.magnetic_table import MagneticTable, read_table

SERVO: Actuator = load_actuator(ROOT / "geometries" / "fast_tool_servo.toml")
TABLE: MagneticTable = read_table(ROOT / "lookup_tables" / "fast_tool_servo.nc")
BIAS, RATE = 0.6, 5e3
RUNS = (
    f"band-limited-noise:bias={BIAS} A,amplitude=50 mA,band=300 Hz,duration=0.3 s,seed=3,role=fit",
    f"swept-sine:bias={BIAS} A,amplitude=20 mA,start=20 Hz,stop=200 Hz,duration=0.2 s,role=held-out",
)


@pytest.fixture(scope="module")
def judge() -> SuspectJudge:
    runs = PlannedRuns(SERVO, TABLE, [parse_excitation(text) for text in RUNS], RATE)
    return SuspectJudge(runs, ModelHypothesis(SERVO, TABLE))


@pytest.fixture
def quick(judge: SuspectJudge, monkeypatch: pytest.MonkeyPatch) -> SuspectJudge:
    """The judge without ARMAX, which takes longest."""
    monkeypatch.setattr(judge.armax, "absorbed", lambda other: None)
    return judge


def test_a_constant_force_moves_the_mover_by_its_compliance(judge: SuspectJudge) -> None:
    """F over the stiffness that the magnets leave; no believed parameter makes it, ARMAX has a constant."""
    force = 0.2
    found = judge.judged(ExpectedCause("force_offset", {"force": force}, "test"))
    at_bias = linearise(SERVO, TABLE, currents=(BIAS, BIAS), position=0.0)
    moved = force / (at_bias.natural_frequency * 2 * np.pi) ** 2 / SERVO.motion.moving_mass
    position = np.concatenate([run["position_m"] for run in judge.base.runs])
    assert found.change_of_position == pytest.approx(moved / np.sqrt(np.mean(position**2)), rel=0.05)
    assert found.absorbed_by_refit < 0.2
    assert found.absorbed_by_armax > 0.8
    assert found.shown_by == "position"


def test_a_cause_that_is_a_believed_parameter_is_made_up_for(judge: SuspectJudge) -> None:
    offset = judge.judged(ExpectedCause("gap_offset", {"offset": 1e-6}, "test"))
    assert offset.absorbed_by_refit > 0.97
    hum = judge.judged(ExpectedCause("periodic_disturbance", {"force_cosine": 0.05, "frequency": 50.0}, "test"))
    assert hum.absorbed_by_refit < 0.4
    assert hum.absorbed_by_armax < 0.2
    assert hum.noncentrality > 100 * offset.noncentrality


def test_a_change_is_linear_in_its_size(quick: SuspectJudge) -> None:
    small, large = (
        quick.judged(ExpectedCause("time_delay", {"command": late}, "test")).change for late in (5e-6, 10e-6)
    )
    assert large == pytest.approx(2 * small, rel=0.02)


def test_of_sides_whose_signs_are_unknown_the_worse_ones_count(quick: SuspectJudge) -> None:
    """Remanence of equal signs makes the magnets stiffer, of opposite ones it pulls to one side; a drawn sign stays."""
    alike, opposed = {"current_1": 0.01, "current_2": 0.01}, {"current_1": 0.01, "current_2": -0.01}
    drawn = [quick.judged(ExpectedCause("remanent_flux", values, "the drawing: test")) for values in (alike, opposed)]
    assert abs(drawn[0].change - drawn[1].change) > 0.01 * drawn[0].change
    for values in (alike, opposed):
        found = quick.judged(ExpectedCause("remanent_flux", values, "iron"))
        assert found.change == max(one.change for one in drawn)


def test_a_re_fit_is_the_least_squares_of_change_and_tolerances(judge: SuspectJudge) -> None:
    """By the normal equations and by orthogonal columns; nothing is absorbed where nothing changes."""
    change = judge.refit.change(judge.runs.record(EffectValues({"time_delay": {"command": 1e-5}})))
    n = judge.refit.unknowns.size
    stacked = np.vstack([judge.refit.columns, np.eye(n)])
    target = np.append(change, np.zeros(n))
    z = -np.linalg.lstsq(stacked, target, rcond=None)[0]
    rest = target + stacked @ z
    assert judge.refit.left(change).absorbed == pytest.approx(1 - np.sqrt(rest @ rest / (change @ change)), abs=1e-6)
    assert 0.1 < judge.refit.left(change).absorbed < 0.9
    assert judge.refit.left(0 * change).absorbed == 0.0


def test_what_the_runs_do_not_bear_is_told_and_ranks_first(judge: SuspectJudge) -> None:
    found = judge.judged(ExpectedCause("force_offset", {"force": 500.0}, "test"))
    assert found.shown_by == NOT_BORNE
    assert found.change == np.inf
    assert found.to_json()["change"] is None


def test_standard_runs_keep_to_a_fifth_of_the_range_and_need_a_spring() -> None:
    excitations = standard_excitations(SERVO, TABLE, rate=RATE, seconds=0.2)
    assert [one.role for one in excitations] == ["fit", "held-out"]
    record = PlannedRuns(SERVO, TABLE, excitations, RATE).record()
    peak = max(float(np.abs(run["position_m"]).max()) for run in record.runs)
    assert 0.03 * SERVO.motion.range < peak < 0.22 * SERVO.motion.range
    loose = SERVO.model_copy(update={"motion": SERVO.motion.model_copy(update={"stiffness": 0.0})})
    with pytest.raises(InputError, match="state --excitation"):
        standard_excitations(loose, TABLE, rate=RATE)


def test_the_command_prints_one_object(msl_fem, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(ranking, "expected_causes", partial(_few, ranking.expected_causes))
    table = str(ROOT / "lookup_tables" / "fast_tool_servo.nc")
    servo = str(ROOT / "geometries" / "fast_tool_servo.toml")
    common = ("suspects", servo, "--table", table, *(f"--excitation={text}" for text in RUNS), "--rate", "5 kHz")
    found = msl_fem(*common, "--json").json
    changes = [one["change"] for one in found["suspects"]]
    assert changes == sorted(changes, reverse=True)
    named = {one["effect"]: one for one in found["suspects"]}
    assert named["mutual_inductance"]["size"] == pytest.approx(-0.0565, rel=0.01)
    keys = {"effect", "size", "unit", "change", "absorbed_by_refit", "absorbed_by_armax", "shown_by"}
    assert keys <= set(found["suspects"][0])
    assert found["belief"] == "plain"
    assert "must be above 0 Hz" in msl_fem("suspects", servo, "--table", table, "--rate", "0 Hz").complaint


def test_a_ranking_is_printed_with_what_it_means(capsys: pytest.CaptureFixture[str]) -> None:
    drawn = ExpectedCause("leakage_inductance", {"share_1": 0.1, "share_2": 0.1}, "the drawing: ends")
    first = Suspect(drawn, 0.14, "position_m", 0.14, 0.9, None, 1e4, "position")
    second = Suspect(
        ExpectedCause("gap_offset", {"offset": 3e-6}, "tolerance"), 0.01, "position_m", 0.01, 1.0, 0.8, 0.1, ""
    )
    print_ranking(SuspectRanking((first, second), ("a run",), "plain", ()), "servo")
    printed = capsys.readouterr().out
    assert "leakage inductance" in printed
    assert "a free run is changed most by leakage inductance (14 %)" in " ".join(printed.split())
    assert "size of leakage inductance: the drawing: ends; a change goes" in " ".join(printed.split())
    assert "100 %" in printed


def _few(every, *arguments, **options):  # type: ignore[no-untyped-def]
    return tuple(one for one in every(*arguments, **options) if one.effect in ("mutual_inductance", "time_delay"))
