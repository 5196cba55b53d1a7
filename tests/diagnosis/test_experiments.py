"""Which causes instruments can tell apart: the linear model by two routes, what an instrument adds, what decides."""

import json
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT

from msl_fem.actuator import Actuator, load_actuator
from msl_fem.cli.experiments import print_plan
from msl_fem.diagnosis.next_experiment import DECIDES
from msl_fem.diagnosis.planning import experiments as planned
from msl_fem.diagnosis.planning.absorbed import BelievedRefit, channel_parts
from msl_fem.diagnosis.planning.expected import ExpectedCause
from msl_fem.diagnosis.planning.experiments import ExperimentPlan, RigToPlan, RunOption
from msl_fem.diagnosis.planning.planned_runs import PlannedRuns
from msl_fem.diagnosis.planning.separations import INSTRUMENTS, CauseInRun, Separations, groups
from msl_fem.errors import InputError
from msl_fem.plant.excitation import parse_excitation
from msl_fem.prediction import ModelHypothesis
from msl_fem.table.magnetic_table import MagneticTable, read_table

SERVO: Actuator = load_actuator(ROOT / "geometries" / "fast_tool_servo.toml")
TABLE: MagneticTable = read_table(ROOT / "lookup_tables" / "fast_tool_servo.nc")
BELIEF = ModelHypothesis(SERVO, TABLE)
NOISE = parse_excitation("band-limited-noise:bias=0.6 A,amplitude=50 mA,band=300 Hz,duration=0.2 s,seed=3")
CAUSES = (
    ExpectedCause("time_delay", {"command": 2e-5}, "test"),
    ExpectedCause("amplifier_bandwidth", {"lag": 2e-5}, "test"),
    ExpectedCause("gap_offset", {"offset": 3e-6}, "test"),
    ExpectedCause("position_sensor_nonlinearity", {"gain_error": 0.01}, "test"),
    ExpectedCause("mutual_inductance", {"share": 0.03}, "test"),
)
RUN, ALL = ("position", "current"), ("position", "current", "voltage")


@pytest.fixture(scope="module")
def refit() -> BelievedRefit:
    record = planned._with_voltmeter(PlannedRuns(SERVO, TABLE, [NOISE], 5e3).record())
    return BelievedRefit(record, BELIEF, every=True)


@pytest.fixture(scope="module")
def separations(refit: BelievedRefit) -> Separations:
    runs = PlannedRuns(SERVO, TABLE, [NOISE], 5e3)
    found = {}
    for cause in CAUSES:
        found[cause.effect] = CauseInRun(cause.beside(None), partial(planned._change_at, runs, refit, cause))
    return Separations(refit, found, weight=1.0)


def test_a_distance_is_the_least_squares_of_rival_and_tolerances(
    refit: BelievedRefit, separations: Separations
) -> None:
    """By the normal equations and by orthogonal columns."""
    kept = np.concatenate(
        [np.arange(part.start, part.stop) for name, part in channel_parts(refit.likelihood) if not name.startswith("v")]
    )
    truth, rival = (separations.changes[name][kept] for name in ("time_delay", "amplifier_bandwidth"))
    n = refit.unknowns.size
    columns = np.vstack([np.column_stack([refit.columns[kept], rival]), np.eye(n, n + 1)])
    target = np.append(truth, np.zeros(n))
    move = np.linalg.lstsq(columns, target, rcond=None)[0]
    expected = float(np.sum((target - columns @ move) ** 2))
    assert separations.distance("time_delay", "amplifier_bandwidth", RUN) == pytest.approx(expected, rel=1e-3)
    assert 0 < expected < 0.1 * separations.distance("time_delay", None, RUN)


def test_a_rival_is_taken_at_the_amount_that_suits(refit: BelievedRefit) -> None:
    """A lag beside a delay twice as long: what is left is the second order at equal amounts, not at half."""
    runs = PlannedRuns(SERVO, TABLE, [NOISE], 5e3)
    found = {}
    for size in (2e-5, 4e-5):
        late = ExpectedCause("time_delay", {"command": 4e-5}, "test")
        lag = ExpectedCause("amplifier_bandwidth", {"lag": size}, "test")
        causes = {
            one.effect: CauseInRun(one.beside(None), partial(planned._change_at, runs, refit, one))
            for one in (late, lag)
        }
        found[size] = Separations(refit, causes, weight=1.0).distance("time_delay", "amplifier_bandwidth", ALL)
    assert found[2e-5] == pytest.approx(found[4e-5], rel=0.1)
    assert found[4e-5] > DECIDES


def test_a_rival_takes_the_form_that_comes_nearest(refit: BelievedRefit) -> None:
    """A delay is far from a lag of one pole and next to one of many, whose own delay it is but for a twentieth; the
    second order that is left goes with the square of the lag, the noncentrality with the fourth power."""
    runs = PlannedRuns(SERVO, TABLE, [NOISE], 5e3)
    late = ExpectedCause("time_delay", {"command": 4e-5}, "test")
    lag = ExpectedCause("amplifier_bandwidth", {"lag": 4e-5}, "test")
    assert [form.values.get("delay_share") for form in lag.forms] == [None, 0.95]
    assert late.forms == (late,)

    def distance(forms: Sequence[ExpectedCause]) -> float:
        lags = [partial(planned._change_at, runs, refit, form) for form in forms]
        causes = {
            "time_delay": CauseInRun(late.beside(None), partial(planned._change_at, runs, refit, late)),
            "amplifier_bandwidth": CauseInRun(lag.beside(None), lags[0], tuple(lags[1:])),
        }
        return Separations(refit, causes, weight=1.0).distance("time_delay", "amplifier_bandwidth", ALL)

    assert distance(lag.forms[:1]) > DECIDES
    assert distance(lag.forms) < 0.01 * distance(lag.forms[:1])


def test_a_cause_is_at_no_distance_from_itself_and_instruments_only_add(separations: Separations) -> None:
    for cause in CAUSES:
        alone = separations.distance(cause.effect, None, RUN)
        assert separations.distance(cause.effect, cause.effect, RUN) == pytest.approx(0.0, abs=1e-6 * alone + 1e-6)
        assert separations.distance(cause.effect, None, ALL) >= alone * (1 - 1e-9)
    assert separations.distance("gap_offset", None, ()) == 0.0


def test_a_gauge_block_shows_a_gain_that_the_tolerance_hides_in_part(separations: Separations) -> None:
    """The reading's gain is known within 0.2 %: an error of 1 % is five sigma of it, by whatever instrument."""
    with_block = separations.distance("position_sensor_nonlinearity", None, ("gauge-block",))
    sigma = np.hypot(0.002, 2e-4)
    assert with_block == pytest.approx((np.log(1.01) / sigma) ** 2, rel=0.02)


def test_groups_hold_what_no_chain_of_pairs_tells_apart() -> None:
    near, far = 0.5 * DECIDES, 2 * DECIDES
    pairs = {("a", "b"): near, ("b", "c"): far, ("a", "c"): far, ("c", "d"): near, ("b", "d"): far, ("a", "d"): far}
    assert sorted(map(sorted, groups(["a", "b", "c", "d"], pairs))) == [["a", "b"], ["c", "d"]]
    chain = {**pairs, ("b", "c"): near}
    assert sorted(map(sorted, groups(["a", "b", "c", "d"], chain))) == [["a", "b", "c", "d"]]


def test_the_instrument_to_add_is_the_one_that_tells_most(separations: Separations) -> None:
    """All that it is said to tell it does, and no other instrument tells more."""
    have = ("position",)
    added, helped = planned._instrument_to_add(separations, have)
    assert helped
    counts = {}
    for name in (one for one in INSTRUMENTS if one not in have):
        more = (*have, name)
        shown = {(one,) for one in separations.unseen(have)} - {(one,) for one in separations.unseen(more)}
        pairs = separations.pairs(have)
        apart = {p for p, d in pairs.items() if d < DECIDES <= separations.apart(*p, more)}
        counts[name] = len(shown | apart)
        if name == added:
            assert set(helped) == shown | apart
    assert counts[added] == max(counts.values())


def test_a_plan_of_one_run(monkeypatch: pytest.MonkeyPatch) -> None:
    """Groups, and the menu judged by what is open: a delay and a lag that the usual run leaves together."""
    menu = planned.menu
    monkeypatch.setattr(planned, "menu", lambda question: list(menu(question))[:1])
    plan = planned.experiments(RigToPlan(BELIEF, 5e3), CAUSES[:2], RUN, excitation=NOISE)
    assert plan.groups == (("time_delay", "amplifier_bandwidth"),)
    (run,) = plan.runs
    assert run.words == "the same again"
    assert set(run.seen) == {"time_delay", "amplifier_bandwidth"}
    assert "duration=4 s" in run.excitation
    assert json.loads(json.dumps(plan.to_json()))["groups"] == [["time_delay", "amplifier_bandwidth"]]
    with pytest.raises(InputError, match="'clock' is no instrument"):
        planned.experiments(RigToPlan(BELIEF, 5e3), CAUSES[:2], ("clock",), excitation=NOISE)


def test_what_is_wrong_is_one_line(msl_fem, tmp_path: Path) -> None:
    servo, table = str(ROOT / "geometries" / "fast_tool_servo.toml"), str(ROOT / "lookup_tables" / "fast_tool_servo.nc")
    common = ("experiments", servo, "--table", table)
    assert "'no_cause' is no cause here" in msl_fem(*common, "--suspects", "no_cause,time_delay").complaint
    assert "name at least two" in msl_fem(*common, "--suspects", "time_delay").complaint
    assert "has no diagnosis.json" in msl_fem("experiments", str(tmp_path)).complaint
    (tmp_path / "extended_model.toml").write_text(Path(servo).read_text())
    (tmp_path / "diagnosis.json").write_text(json.dumps({"causes": [], "parameters": {}}))
    assert "there is nothing to decide" in msl_fem("experiments", str(tmp_path)).complaint


def test_a_plan_is_printed_with_what_to_do(capsys: pytest.CaptureFixture[str]) -> None:
    run = RunOption("steps", "step:channel=1", True, ("a", "b"), 0, {("a", "b"): 1.0})
    print_plan(ExperimentPlan(("position",), (("a", "b"),), ("c",), "voltage", (("c",),), (run,)), "servo")
    said = " ".join(capsys.readouterr().out.split())
    assert "not told apart" in said
    assert "add voltage: it tells 1 more" in said
    assert '"step:channel=1" --locked; no run at this size tells a from b.' in said
