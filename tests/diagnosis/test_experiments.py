"""Which causes instruments can tell apart: the linear model by two routes, what an instrument adds, what decides."""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT

from msl_fem.actuator import Actuator, load_actuator
from msl_fem.cli.experiments import Said, print_plan, said_by, said_usual_run
from msl_fem.computing.arrays import Array
from msl_fem.diagnosis.next_experiment import DECIDES, Entry
from msl_fem.diagnosis.planning import experiments as planned
from msl_fem.diagnosis.planning.absorbed import BelievedRefit, channel_parts
from msl_fem.diagnosis.planning.after import open_question
from msl_fem.diagnosis.planning.expected import ExpectedCause
from msl_fem.diagnosis.planning.experiments import ExperimentPlan, RigToPlan, RunOption
from msl_fem.diagnosis.planning.forms import forms_of
from msl_fem.diagnosis.planning.planned_runs import PlannedRuns
from msl_fem.diagnosis.planning.separations import INSTRUMENTS, ROUNDS, CauseInRun, Separations, groups
from msl_fem.diagnosis.usual_run import usual_run
from msl_fem.diagnosis.variants import RecordFeatures
from msl_fem.errors import InputError
from msl_fem.plant import NamedRun, Simulation, plant_parameters, simulate, simulation_record
from msl_fem.plant.effects import CATALOGUE, EffectValues
from msl_fem.plant.excitation import excitation_inputs, parse_excitation
from msl_fem.plant.excitation_kinds import BandLimitedNoise
from msl_fem.prediction import ModelHypothesis
from msl_fem.record import Tolerance
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
FEATURES = RecordFeatures(1e-4, 0.6, 1e-2, 63.0, rate=5e3)
RUN, ALL = ("position", "current"), ("position", "current", "voltage")


@pytest.fixture(scope="module")
def refit() -> BelievedRefit:
    record = planned._with_voltmeter(PlannedRuns(SERVO, TABLE, [NOISE], 5e3).record())
    return BelievedRefit(record, BELIEF, every=True)


def simulated(spec: str) -> Simulation:
    text = spec if "duration" in spec else f"{spec},duration=0.2 s"
    return simulate(SERVO, TABLE, excitation_inputs(SERVO, parse_excitation(text, unit="A"), rate=5e3))


def separated(
    refit: BelievedRefit, *causes: ExpectedCause, forms: Sequence[ExpectedCause] = (), rounds: int = ROUNDS
) -> Separations:
    """Causes in the run of `refit`, each fitted in its own form; the last one in others where they are stated."""
    runs = PlannedRuns(SERVO, TABLE, [NOISE], 5e3)
    found = {one.effect: CauseInRun(one, (one,)) for one in causes}
    if forms:
        found[causes[-1].effect] = CauseInRun(causes[-1], tuple(forms))
    return Separations(
        refit, found, lambda cause: refit.change(runs.record(cause.beside(None))), weight=1.0, rounds=rounds
    )


@pytest.fixture(scope="module")
def separations(refit: BelievedRefit) -> Separations:
    return separated(refit, *CAUSES, rounds=0)


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
    found = {}
    late = ExpectedCause("time_delay", {"command": 4e-5}, "test")
    for size in (2e-5, 4e-5):
        lag = ExpectedCause("amplifier_bandwidth", {"lag": size}, "test")
        found[size] = separated(refit, late, lag).distance("time_delay", "amplifier_bandwidth", ALL)
    assert found[2e-5] == pytest.approx(found[4e-5], rel=0.1)
    assert found[4e-5] > DECIDES


def test_a_rival_takes_the_form_that_comes_nearest(refit: BelievedRefit) -> None:
    """A delay is far from a lag of one pole and next to one of many, whose own delay it is but for a twentieth; the
    second order that is left goes with the square of the lag, the noncentrality with the fourth power."""
    late = ExpectedCause("time_delay", {"command": 4e-5}, "test")
    lag = ExpectedCause("amplifier_bandwidth", {"lag": 4e-5}, "test")
    forms = forms_of(lag, FEATURES, plant_parameters(SERVO))
    assert forms[0] == lag
    one_pole, many, overshooting = [
        form for form in forms if form.values.get("delay_share", 2.0) in (0.95, 2.0) and "lag" in form.values
    ][:3]
    assert many.values == {"lag": 4e-5, "delay_share": 0.95}
    assert overshooting.values == {"lag": 4e-5, "delay_share": 2.0}

    def distance(*forms: ExpectedCause) -> float:
        return separated(refit, late, lag, forms=forms).distance("time_delay", "amplifier_bandwidth", ALL)

    assert distance(one_pole) > DECIDES
    assert distance(one_pole, many) < 0.01 * distance(one_pole)
    assert distance(*forms) <= distance(one_pole, many) * (1 + 1e-9)


def test_a_rival_is_fitted_in_each_of_its_amounts(refit: BelievedRefit) -> None:
    """A delay of the command beside one of the readings: told apart by the amount that is expected alone, by none of
    the forms that a diagnosis tries."""
    late = ExpectedCause("time_delay", {"command": 2e-5}, "test")
    seen_late = ExpectedCause("position_sensor_lag", {"lag": 2e-5}, "test")
    forms = forms_of(late, FEATURES, plant_parameters(SERVO))
    assert [form.amounts for form in forms] == [("command",), ("position",), ("current",), ("position", "current")]
    alone = separated(refit, seen_late, late).distance("position_sensor_lag", "time_delay", RUN)
    assert alone > DECIDES
    every = separated(refit, seen_late, late, forms=forms)
    assert every.distance("position_sensor_lag", "time_delay", RUN) < 0.01 * alone
    _, taken = every.all_suited("position_sensor_lag", RUN)
    assert taken.values["position"] == pytest.approx(2e-5, rel=0.1)


def test_amounts_that_are_never_below_nothing_are_fitted_so(refit: BelievedRefit) -> None:
    """A lag makes up for nothing of what turning it round would do."""
    lag = ExpectedCause("amplifier_bandwidth", {"lag": 2e-5}, "test")
    film = ExpectedCause("squeeze_film", {"damping": 0.5}, "test")
    both = separated(refit, film, lag)
    read = both._read(ALL)
    free = read._free(lag)
    assert free is not None
    target = read.of(lag)
    assert free.least(target) == pytest.approx([1.0], rel=1e-6)
    assert free.least(-target) == pytest.approx([0.0], abs=1e-12)
    assert free.nearer(-2 * target, np.array([1.0])) == pytest.approx([-1.0])
    assert lag.most("lag")[1] * 2e-5 == pytest.approx(CATALOGUE["amplifier_bandwidth"].parameter("lag").allowed[1])
    assert free.least(1e9 * target) == pytest.approx([lag.most("lag")[1]])


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
    added, helped = planned._instrument_to_add(separations, have, separations.pairs(have))
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
    run = RunOption("steps", "step:channel=1", True, ("a", "b"), {("a", "b"): 1.0}, {("a", "b"): 2.0})
    print_plan(ExperimentPlan(("position",), (("a", "b"),), ("c",), "voltage", (("c",),), (run,)), "servo")
    said = " ".join(capsys.readouterr().out.split())
    assert "not told apart" in said
    assert "add voltage: it tells 1 more" in said
    assert '"step:channel=1" --locked; no run at this size, made 3 times, tells a from b.' in said


def test_what_a_run_tells_only_thrice_or_one_way_does_not_stay_together() -> None:
    """Two runs, of which the second made thrice tells a pair if the right one is true; the other pair none does."""
    near, far = ("a", "b"), ("a", "c")
    none = {near: 0.0, far: 0.0}
    runs = [
        RunOption("steps", "step:channel=1", False, ("a",), none, {near: 0.1 * DECIDES, far: 0.2 * DECIDES}),
        RunOption("sweep", "step:channel=1", False, ("a",), none, {near: 0.4 * DECIDES, far: 0.3 * DECIDES}),
    ]
    plan = ExperimentPlan(("position",), (), (), "", (), tuple(runs))
    assert plan.together == {far: 0.3 * DECIDES}
    assert plan.to_json()["together"] == [["a", "c", 0.3 * DECIDES]]


def test_of_runs_that_tell_as_much_the_one_with_more_to_spare_is_better() -> None:
    def run(seen: int, *distances: float, lucky: float = 0.0) -> RunOption:
        pairs = {("a", str(n)): distance for n, distance in enumerate(distances)}
        return RunOption("", "", False, ("a",) * seen, pairs, {pair: max(d, lucky) for pair, d in pairs.items()})

    assert run(2, 30.0).worth > run(2, 25.0).worth
    assert run(2, 2e4).worth == run(2, 3e4).worth
    assert run(2, 25.0).worth > run(1, 3e4).worth
    assert run(2, 30.0, 20.0).worth > run(2, 3e4, 10.0).worth
    assert run(2, 1.0, lucky=30.0).worth > run(2, 20.0).worth


def test_a_lag_is_told_from_a_delay_and_not_the_other_way(refit: BelievedRefit) -> None:
    """A lag of one pole is no delay; a delay may be a lag of many poles."""
    late = ExpectedCause("time_delay", {"command": 4e-5}, "test")
    lag = ExpectedCause("amplifier_bandwidth", {"lag": 4e-5}, "test")
    both = separated(refit, late, lag, forms=forms_of(lag, FEATURES, plant_parameters(SERVO)))
    pairs = both.pairs(ALL)
    assert pairs["time_delay", "amplifier_bandwidth"] < DECIDES
    assert both.one_way(pairs, ALL)["time_delay", "amplifier_bandwidth"] > DECIDES


def test_after_a_diagnosis_the_question_is_that_of_its_record() -> None:
    """The first cause with effects beside it, without it in the rig; the run is noise as the record's first one was,
    whatever was added."""
    tones = "multisine:channel=1,bias=0.5 A,amplitude=10 mA,start=40 Hz,stop=60 Hz,periods=4"
    runs = [
        NamedRun("steps", "", "held-out", simulated("step:channel=1,frequency=5 Hz,bias=0.6 A,amplitude=40 mA")),
        NamedRun("noise", "", "fit", simulated(NOISE.spec)),
        NamedRun("tones", "", "fit", simulated(tones)),
    ]
    record = simulation_record(SERVO, runs)
    excited = usual_run(record)
    assert excited is not None
    usual = excited.excitation
    assert isinstance(usual, BandLimitedNoise)
    assert usual.bias == pytest.approx(0.6, rel=0.02)
    assert usual.amplitude == pytest.approx(0.05, rel=0.1)
    assert usual.band == pytest.approx(300.0, rel=0.05)
    assert excited.rate == pytest.approx(5e3)
    said = str(excited.to_json()["excitation"])
    assert parse_excitation(said, unit="A") == usual
    slower = {name: values[::2] for name, values in record.runs[1].columns.items()}
    locked = replace(record.runs[1], name="locked", mover="locked", columns=slower)
    assert usual_run(replace(record, runs=(locked, *record.runs))) == excited
    effects = EffectValues({"time_delay": {"command": 3e-5}, "squeeze_film": {"damping": 0.5}})
    named = [
        ("squeeze_film", ["damping"]),
        ("time_delay", ["amplifier_bandwidth", "amplifier_bandwidth", "position_gain"]),
    ]
    extended = ModelHypothesis(SERVO, TABLE, effects)
    question = open_question(extended, named, ["position_m", "current_1_A"], tolerance=Tolerance(), rate=5e3)
    assert question is not None
    assert question.asked == ("time_delay", "amplifier_bandwidth")
    assert question.named == "time_delay"
    assert question.read == ("position", "current")
    assert question.possible["time_delay"].values == {"command": 3e-5}
    assert question.rig.belief.effects == EffectValues({"squeeze_film": {"damping": 0.5}})
    assert open_question(extended, named[:1], [], tolerance=Tolerance(), rate=5e3) is None


def test_after_a_diagnosis_a_rival_has_the_size_that_suits(monkeypatch: pytest.MonkeyPatch) -> None:
    """A delay of 40 us that could be a lag, expected at 0.1 us, at which it would not be seen."""
    menu = planned.menu
    monkeypatch.setattr(planned, "menu", lambda question: list(menu(question))[:1])
    late = ExpectedCause("time_delay", {"command": 4e-5}, "test")
    lag = ExpectedCause("amplifier_bandwidth", {"lag": 1e-7}, "test")
    rig = RigToPlan(BELIEF, 5e3)
    assert planned.experiments(rig, [late, lag], RUN, excitation=NOISE).unseen == ("amplifier_bandwidth",)
    plan = planned.experiments(rig, [late, lag], RUN, excitation=NOISE, named="time_delay")
    assert plan.unseen == ()
    assert plan.groups == (("time_delay", "amplifier_bandwidth"),)
    assert list(plan.runs[0].pairs) == [("time_delay", "amplifier_bandwidth")]


def test_after_a_diagnosis_what_is_not_seen_is_judged_too(monkeypatch: pytest.MonkeyPatch) -> None:
    """A delay that is hardly seen beside a lag that is not: their pair is in every run of the menu."""
    menu = planned.menu
    monkeypatch.setattr(planned, "menu", lambda question: list(menu(question))[:1])
    small = [
        ExpectedCause("time_delay", {"command": 1e-7}, "test"),
        ExpectedCause("amplifier_bandwidth", {"lag": 1e-7}, "test"),
    ]
    plan = planned.experiments(RigToPlan(BELIEF, 5e3), small, RUN, excitation=NOISE, named="time_delay")
    assert plan.unseen == ("time_delay", "amplifier_bandwidth")
    assert plan.groups == (("time_delay", "amplifier_bandwidth"),)
    assert set(plan.together) == {("time_delay", "amplifier_bandwidth")}


def test_what_tolerances_make_up_for_they_do_in_all_orders() -> None:
    """A leakage of six of its tolerances is the believed one, in voltage drive a change of hundreds of sigma: d^2 is at
    most that of its prior, and the linear model takes it for more."""
    assert SERVO.drive is not None
    drive = SERVO.drive.model_copy(update={"kind": "voltage", "bandwidth": None})
    servo = SERVO.model_copy(update={"drive": drive})
    noise = parse_excitation("band-limited-noise:bias=1 V,amplitude=1 V,band=200 Hz,duration=0.2 s,seed=3", unit="V")
    runs = PlannedRuns(servo, TABLE, [noise], 5e3)
    refit = BelievedRefit(runs.record(), ModelHypothesis(servo, TABLE), every=True)
    leak = ExpectedCause("leakage_inductance", {"share_1": 0.06, "share_2": 0.06}, "test")

    def distance(rounds: int) -> float:
        found = {leak.effect: CauseInRun(leak, (leak,))}

        def change_of(cause: ExpectedCause) -> Array:
            return refit.change(runs.record(cause.beside(None)))

        return Separations(refit, found, change_of, weight=10.0, rounds=rounds).distance(leak.effect, None, RUN)

    assert distance(ROUNDS) <= 2 * (0.06 / Tolerance().leakage_inductance) ** 2 * 1.01
    assert distance(0) > 1.5 * distance(ROUNDS)


def test_a_run_is_borne_over_its_planned_length() -> None:
    """A piece of 0.4 s is borne and the 4 s are not, whose noise has higher peaks; beyond what keeps currents positive
    no room is asked for."""
    rig = RigToPlan(BELIEF, 5e3)

    def borne(amplitude: str) -> float:
        text = f"band-limited-noise:bias=0.6 A,amplitude={amplitude},band=300 Hz,duration=0.4 s,seed=3"
        piece = parse_excitation(text, unit="A")
        found = planned._borne(rig, Entry("", piece))
        assert found == piece.model_copy(update={"amplitude": found.amplitude})
        return found.amplitude

    assert borne("0.1 A") == 0.1
    assert borne("0.15 A") == 0.075
    assert borne("0.2 A") == 0.1


def test_the_command_takes_the_usual_run_of_the_diagnosis() -> None:
    said = Said.model_validate({"usual_run": {"excitation": NOISE.spec, "rate": 2e3}})
    assert said_usual_run(said, SERVO) == (2e3, NOISE)
    assert said_usual_run(Said(), SERVO) == (None, None)


@pytest.mark.parametrize(
    ("content", "named"),
    [
        ('{"usual_run": {"excitation": "sine"}}', "usual_run.rate"),
        ('{"usual_run": {"excitation": 3, "rate": 1e3}}', "usual_run.excitation"),
        ('{"usual_run": {"excitation": "sine", "rate": -1}}', "usual_run.rate"),
        ('{"usual_run": {"excitation": "sine", "rate": 1e999}}', "usual_run.rate"),
        ('{"causes": [{"indistinguishable_from": []}]}', "causes.0.effect"),
        ('{"causes": [3]}', "causes.0"),
        ("[]", "diagnose the record again"),
    ],
)
def test_a_diagnosis_that_says_odd_things_is_one_clear_error(tmp_path: Path, content: str, named: str) -> None:
    (tmp_path / "diagnosis.json").write_text(content, encoding="utf-8")
    with pytest.raises(InputError, match=named):
        said_by(tmp_path / "diagnosis.json")
