"""Multiple shooting: starts eliminated as if they were fitted, stretches as long as the plant allows, causes found."""

from dataclasses import replace

import levitator
import numpy as np
import pytest
from conftest import ROOT
from short_menu import cut_menu

from msl_fem.actuator import load_actuator
from msl_fem.diagnosis import DiagnosisSettings, diagnose
from msl_fem.diagnosis import likelihood as likelihood_module
from msl_fem.diagnosis import runs as runs_module
from msl_fem.diagnosis import shooting as shooting_module
from msl_fem.diagnosis.fit import FitPlan, fit
from msl_fem.diagnosis.noise import transformed
from msl_fem.diagnosis.problem import FitProblem, Points, _lane_settings, lanes
from msl_fem.diagnosis.runs import dynamic_runs
from msl_fem.diagnosis.shooting import GENTLE, HOPELESS, MOST_GROWTH, SHORTEST, ModelSpread, Shooting, guessed
from msl_fem.diagnosis.static_maps import MAP_BESIDE
from msl_fem.diagnosis.stretches import Stretches
from msl_fem.diagnosis.unknowns import Unknowns
from msl_fem.diagnosis.variants import RecordFeatures, variants
from msl_fem.plant import plant_parameters
from msl_fem.plant.excitation import Inputs
from msl_fem.plant.lane_run import run_lanes
from msl_fem.prediction import ModelHypothesis, free_parameters, kernel_plant, run_data
from msl_fem.record import StaticMap

TRUTH = levitator.Truth(mass=1.004, resistance=0.99, inductance=1.001)


@pytest.fixture(scope="module")
def base():
    return load_actuator(ROOT / "measurements" / "levitation_rig" / "actuator.toml")


@pytest.fixture(scope="module")
def table():
    return levitator.table()


@pytest.fixture(scope="module")
def short(base):
    """Half a second, nothing hidden, all as believed."""
    return levitator.record(base, levitator.Truth(), seconds=0.5)


def shooting(record, table, begins) -> tuple[Shooting, Stretches]:
    data = run_data(record, record.runs[0])
    plant = kernel_plant(ModelHypothesis(record.actuator, table), rate=data.rate)
    spread = ModelSpread(Unknowns((), 0, ()), np.zeros(0), np.zeros((0, 0)))
    shot = Shooting(FitProblem(plant, (data,), (), (), None), 0, spread, substeps=plant.substeps)
    return shot, guessed(plant, data, np.array(begins), 3)


def random_stretches(chance: np.random.Generator) -> Stretches:
    slopes = chance.standard_normal((2, 3, 90))
    return Stretches(np.array([0, 20, 50]), np.zeros((3, 4)), slopes)


def test_eliminated_starts_leave_what_a_fit_of_them_leaves() -> None:
    """By the normal equations of all starts of a stretch with their prior, one stretch after the other."""
    chance = np.random.default_rng(1)
    cut, over = random_stretches(chance), chance.standard_normal((2, 2, 90))
    left = cut.without_starts(over)
    for part in cut.parts(90):
        s = np.concatenate([slopes[:, part] for slopes in cut.slopes], axis=1).T
        for row in range(2):
            r = np.concatenate([values[row, part] for values in over])
            fitted = np.linalg.lstsq(np.vstack([s, np.eye(3)]), np.concatenate([-r, np.zeros(3)]), rcond=None)[0]
            expected = r + s @ fitted
            assert np.allclose(np.concatenate([values[row, part] for values in left]), expected, atol=1e-12)


def test_starts_that_all_act_alike_are_left_out_as_one() -> None:
    """By 1e20 times their step, one with the other sign and another size: their products are a singular matrix."""
    chance = np.random.default_rng(7)
    way = chance.standard_normal((2, 1, 90))
    cut = Stretches(np.array([0, 20, 50]), np.zeros((3, 4)), way * np.array([1e20, -3e19, 2e20])[:, None])
    over = chance.standard_normal((2, 1, 90))
    left = cut.without_starts(over)
    for part in cut.parts(90):
        one, r = way[:, 0, part].ravel(), over[:, 0, part].ravel()
        assert np.allclose(left[:, 0, part].ravel(), r - one * (one @ r) / (one @ one), atol=1e-6)
    assert np.abs(cut.moves(over)).max() < 1e-19
    spent = np.sum(cut.orthonormal() ** 2)
    assert spent == pytest.approx(3.0, abs=1e-6), "of each stretch one number"


def test_the_numbers_spent_on_starts_are_the_trace_of_what_eliminates_them() -> None:
    chance = np.random.default_rng(2)
    cut = random_stretches(chance)
    spent = 0.0
    for n in range(2):
        for part in cut.parts(90):
            length = part.stop - part.start
            spent += float(np.sum(transformed(cut.orthonormal()[n][:, part], length // 2 + 1) ** 2))
    white = np.array([np.eye(180)[:, :90], np.eye(180)[:, 90:]])
    kept = cut.without_starts(white)
    trace = sum(np.trace(values[n * 90 : (n + 1) * 90]) for n, values in enumerate(kept))
    assert spent == pytest.approx(180 - trace, rel=1e-9)


def test_a_run_over_stretches_begins_each_at_its_start_and_is_whole_where_there_is_one(short, table) -> None:
    """From starts on its own way a run in stretches is the whole run; the last stretch does not know the first."""
    shot, one = shooting(short, table, [0])
    data = shot.data
    inputs, points = Inputs(data.commands[:60, :1], data.rate), Points(Unknowns((), 0, ()), np.zeros((1, 0)), None)

    def rows(cut: Stretches) -> np.ndarray:
        surface, plants, settings = _lane_settings(shot.problem, points, 0, cut)
        settings = replace(settings, quantities=None)  # the velocity too
        return run_lanes(surface, plants, inputs, substeps=shot.substeps, settings=settings).rows(0)

    whole = rows(replace(one, starts=one.starts[None]))
    starts = np.concatenate([one.starts, [[whole[40, 0], 0.0, whole[40, 2], whole[40, 3]]]])
    two = Stretches(np.array([0, 40]), starts, one.slopes)
    assert np.allclose(rows(replace(two, starts=starts[None]))[:, :5], whole[:, :5], rtol=1e-9, atol=1e-12)
    starts[0, 2] += 1e-4
    moved = rows(replace(two, starts=starts[None]))
    assert np.abs(moved[:40, 2] - whole[:40, 2]).min() > 5e-5
    assert np.allclose(moved[40:, :4], whole[40:, :4], rtol=1e-9, atol=1e-12)


def test_lanes_over_stretches_are_single_runs_over_stretches(short, table) -> None:
    shot, cut = shooting(short, table, np.arange(0, 960, 32))
    data = shot.data
    cut = shot.refined(cut)
    inputs = Inputs(data.commands[:, :1], data.rate)

    def rows(count: int) -> list[np.ndarray]:
        points = Points(Unknowns((), 0, ()), np.zeros((count, 0)), None)
        own = replace(cut, starts=np.tile(cut.starts, (count, 1, 1)))
        return list(lanes(shot.problem, points, 0, inputs=inputs, substeps=shot.substeps, own=own).position)

    alone, together = rows(1)[0], rows(3)
    assert np.isfinite(alone).all()
    assert all(np.array_equal(lane, alone) for lane in together)


def test_starts_refined_beside_others_are_those_refined_alone(short, table) -> None:
    shot, cut = shooting(short, table, np.arange(0, 960, 32))
    aside = replace(cut, starts=cut.starts + np.array([0.0, 0.0, 2e-4, 0.0]))
    together = shot._refined_together([shot._refinement(each) for each in (cut, aside)], 3)
    for one, beside in zip((cut, aside), together, strict=True):
        alone = shot.refined(one, 3)
        assert np.array_equal(beside.starts, alone.starts)
        assert np.array_equal(beside.slopes, alone.slopes)
        assert not np.array_equal(alone.starts, one.starts)


def test_where_errors_grow_too_much_no_start_is_looked_for(short, table, monkeypatch) -> None:
    """Over the whole run of an unstable plant that leaves its table early, as it grows until there; over short
    stretches they are."""
    shot, whole = shooting(short, table, [0])
    simulated: list[int] = []

    def noted(*args, **more):
        simulated.append(len(args[1].rows))
        return lanes(*args, **more)

    monkeypatch.setattr(shooting_module, "lanes", noted)
    tried = shot._tried(whole)
    assert len(simulated) == 1
    assert np.array_equal(tried.starts, whole.starts)
    assert shot._growth(tried)[0] > HOPELESS * MOST_GROWTH
    shot, cut = shooting(short, table, np.arange(0, 960, 32))
    assert shot._growth(shot._tried(cut)).max() < MOST_GROWTH
    assert np.array_equal(shot._tried(cut).starts, shot.refined(cut).starts)


def test_stretches_are_those_reached_from_the_shortest(short, table, monkeypatch) -> None:
    """Begun with those of a stretch's growth, joined once in vain; with those over which errors hardly grow where the
    model does not bear these, and with the shortest where it does not bear those either."""
    shot, whole = shooting(short, table, [0])
    gentle, longest = (shot._grown_by(most, shot._tried(whole)) for most in (GENTLE, MOST_GROWTH))
    assert longest > gentle >= 4 * SHORTEST
    lost = replace(whole, slopes=np.zeros_like(whole.slopes))
    assert shot._grown_by(MOST_GROWTH, lost) == SHORTEST, "where the model leaves its table at once"
    tried: list[int] = []
    plain = Shooting._tried

    def noted(self: Shooting, cut: Stretches) -> Stretches:
        tried.append(cut.begins.size)
        return plain(self, cut)

    monkeypatch.setattr(Shooting, "_tried", noted)
    found = shot.chosen()
    assert found is not None
    assert np.diff(found.begins).tolist() == [longest] * (found.begins.size - 1)
    counts = [len(tried)]
    assert counts == [2], "the whole run, and neighbours joined"
    too_long = 4 * len(shot.data.commands)
    for grown in ({MOST_GROWTH: too_long, GENTLE: gentle}, {MOST_GROWTH: too_long, GENTLE: too_long}):
        tried.clear()
        monkeypatch.setattr(Shooting, "_grown_by", lambda self, most, whole, grown=grown: grown[most])
        anew = shot.chosen()
        assert anew is not None
        last = found.begins.size - 1  # an odd one at the end is joined no further
        assert np.array_equal(found.begins, anew.begins[: last + 1])
        assert np.abs(found.starts[:last] - anew.starts[:last]).max(axis=0) == pytest.approx([0.0] * 4, abs=2e-5)
        counts.append(len(tried))
    assert counts[0] < counts[1] < counts[2]


def test_an_unstable_plant_is_cut_and_left_noise_by_the_true_model(short, table) -> None:
    """The growth of a stretch is that of the unstable pole: cosh of it over the stretch."""
    shot, whole = shooting(short, table, [0])
    assert not shot._borne(shot.refined(whole))[0]
    cut = shot.chosen()
    assert cut is not None
    lengths = np.diff([*cut.begins, len(shot.data.commands)])
    assert lengths.max() <= 256
    assert lengths.max() >= 32
    left = shot.missed(cut)["position_m"]
    assert np.sqrt(np.mean(left**2)) == pytest.approx(levitator.POSITION_NOISE, rel=0.1)


def test_known_stretches_that_the_model_bears_are_where_the_choice_begins(short, table, monkeypatch) -> None:
    """Else as if there were none."""
    shot, _ = shooting(short, table, [0])
    cut = shot.chosen()
    tried: list[int] = []
    plain = Shooting.refined
    monkeypatch.setattr(
        Shooting, "refined", lambda self, one, *more: tried.append(one.begins.size) or plain(self, one, *more)
    )
    again = shot.chosen(cut)
    assert np.isin(again.begins, cut.begins).all(), "neighbours at the end that had none before may be joined"
    assert max(tried) == cut.begins.size
    tried.clear()
    too_long = replace(cut, begins=cut.begins[:1], starts=cut.starts[:1])
    assert np.array_equal(shot.chosen(too_long).begins, cut.begins)
    assert max(tried) == cut.begins.size


def test_what_is_hopeless_or_has_just_been_simulated_is_not_simulated_with_all_moves(short, table, monkeypatch) -> None:
    shot, _ = shooting(short, table, [0])
    cut = shot.chosen()
    borne: list[int] = []
    looked: list[int] = []
    plain, inside = Shooting._borne, Shooting._inside
    monkeypatch.setattr(Shooting, "_borne", lambda self, one: borne.append(one.begins.size) or plain(self, one))
    monkeypatch.setattr(Shooting, "_inside", lambda self, *all_: looked.append(1) or inside(self, *all_))
    again = shot.chosen(cut, with_moves=True)
    assert (borne, looked) == ([cut.begins.size], []), "neither the whole run, nor neighbours joined"
    assert np.array_equal(again.outside, ~inside(shot, again, shot.spread.rows))
    monkeypatch.setattr(Shooting, "_hopeless", lambda self, one: np.zeros(one.begins.size, dtype=bool))
    monkeypatch.setattr(shooting_module, "_key", lambda _: np.random.default_rng().bytes(8))
    other = shot.chosen(cut, with_moves=True)
    assert len(borne) > 2
    assert looked == [1]
    assert np.array_equal(other.begins, again.begins)
    assert np.array_equal(other.outside, again.outside)


def test_stretches_are_split_into_parts_that_know_what_does_not_count(short, table) -> None:
    shot, cut = shooting(short, table, np.array([0, 256, 264]))
    split = shot.split(replace(cut, outside=np.array([True, False, False])))
    n = len(shot.data.commands)
    assert split.begins.tolist() == [0, 64, 128, 192, 256, *(264 + (n - 264) * k // 4 for k in range(4))]
    assert split.outside.tolist() == [True] * 4 + [False] * 5
    assert shot.split(cut).outside is None
    left = shot.missed(split)["position_m"]
    assert np.sqrt(np.mean(left**2)) == pytest.approx(levitator.POSITION_NOISE, rel=0.1)


@pytest.mark.parametrize("loses", [False, True])
def test_a_model_is_fitted_over_parts_first_and_over_the_stretches_where_it_does_not_follow_them_then(
    base, table, monkeypatch, loses: bool
) -> None:
    record = levitator.record(base, levitator.Truth(inductance=0.97), seconds=0.5)
    believed = dynamic_runs(
        record, ModelHypothesis(record.actuator, table), [run_data(record, run) for run in record.runs]
    )
    lengths: list[int] = []
    plain = runs_module.fit

    def noted(likelihood, *one, **more):
        lengths.append(likelihood.problem.stretches[0].begins.size)
        return plain(likelihood, *one, **more)

    monkeypatch.setattr(runs_module, "fit", noted)
    if loses:
        monkeypatch.setattr(runs_module, "_loses", lambda renewed, found: len(lengths) == 1)
    settled = believed.settled(lambda text: None)
    whole = believed.cuts[0].begins.size
    assert lengths[0] > 2 * whole
    assert (whole in lengths) == loses
    found = plain(settled.likelihood, settled.unknowns, settled.begin)
    assert max(found.excess.values()) < 1.1


def test_a_statement_turned_round_stays_so_where_stretches_are_chosen_anew(short, table) -> None:
    believed = dynamic_runs(short, ModelHypothesis(short.actuator, table), [run_data(short, run) for run in short.runs])
    (turned,) = believed.restatements()
    for kind, hold in ((believed, "zero-order"), (turned, "linear")):
        settled = kind.settled(lambda text: None)
        assert settled is not kind
        assert {run.hold for run in (*settled.runs, *settled.likelihood.problem.runs)} == {hold}
        assert any("correct hold" in note for note in settled.notes) == (hold == "linear")


def test_what_is_left_at_a_fit_is_simulated_once_for_all_who_ask(short, table, monkeypatch) -> None:
    believed = dynamic_runs(short, ModelHypothesis(short.actuator, table), [run_data(short, run) for run in short.runs])
    found = fit(believed.likelihood, believed.unknowns, np.zeros(believed.unknowns.size), plan=FitPlan(most_steps=1))
    asked: list[Points] = []
    plain = likelihood_module.simulated_residuals

    def noted(problem, points, **more):
        asked.append(points)
        return plain(problem, points, **more)

    monkeypatch.setattr(likelihood_module, "simulated_residuals", noted)
    elsewhere = replace(found, z=found.z + 0.5)
    for _ in range(2):
        one = replace(found, finished=True)  # a copy, which has been asked for nothing
        excess = one.excess, one.likelihood.loudness(one), one.nats_of_noise
        other = replace(elsewhere, finished=True).excess
    assert len(asked) == 2
    assert other != excess[0]
    cut = found.likelihood.problem.cuts[0]
    begun = found.likelihood.starting((cut.starts[None] + 1e-5,))
    assert begun.excess(found) != excess[0]
    assert len(asked) == 3


def test_a_stable_plant_is_followed_as_a_whole(short, table) -> None:
    """A spring stiffer than the magnet's pull falls holds the ball: no growth, one stretch."""
    motion = short.actuator.motion.model_copy(update={"stiffness": 400.0, "damping": 1.0})
    held = replace(short, actuator=short.actuator.model_copy(update={"motion": motion}))
    shot, _ = shooting(held, table, [0])
    assert shot.chosen() is None


@pytest.fixture(scope="module")
def clean(base, table):
    return diagnose(levitator.record(base, TRUTH, seconds=1.6), DiagnosisSettings(table=table))


def test_nothing_is_named_on_a_clean_levitator(clean) -> None:
    assert clean.verdict == "nothing-found"
    assert all(accuracy.prediction == "multiple-shooting" for accuracy in clean.accuracy)
    for accuracy in clean.accuracy:
        assert accuracy.refitted.rms < 1.05 * accuracy.refitted.floor
    mass = clean.parameters["moving_mass"]
    assert mass.low < TRUTH.mass * levitator.MASS < mass.high
    assert any("stretches" in note for note in clean.notes)


def test_friction_is_named_on_an_unstable_levitator(base, table, monkeypatch) -> None:
    """One per cent of the weight; the friction's own form is another than the catalogue's."""
    cut_menu(monkeypatch)
    hidden = replace(TRUTH, friction=0.01 * levitator.WEIGHT)
    found = diagnose(levitator.record(base, hidden, seconds=1.6), DiagnosisSettings(table=table, threads=2))
    assert found.names[:1] == ("coulomb_friction",)
    assert found.causes[0].parameters["force"].value == pytest.approx(hidden.friction, rel=0.1)


@pytest.mark.parametrize(
    ("effect", "amounts", "shape", "centre"),
    [
        ("leakage_inductance", ("share_1", "share_2"), "halving_current", 30.0),
        ("early_saturation", ("knee_excess",), "knee_current", 3.0),
    ],
)
def test_iron_that_may_saturate_is_tried_with_and_without(
    effect: str, amounts: tuple[str, ...], shape: str, centre: float
) -> None:
    features = RecordFeatures(1e-3, 1.0, 5e-3, 20.0, peak=3.0)
    plant = plant_parameters(load_actuator(ROOT / "geometries" / "fast_tool_servo.toml"))
    tried = variants(effect, features, plant)
    own = [one.shapes for one in tried if tuple(amount.name for amount in one.amounts) == amounts]
    assert [tuple(one.name for one in shapes) for shapes in own] == [(), (shape,)]
    assert own[1][0].centre == pytest.approx(centre)


def test_a_second_resonance_is_tried_at_the_peaks_of_what_is_left_too(base) -> None:
    features = RecordFeatures(1e-3, 1.0, 5e-3, 20.0, resonances=(181.7, 95.0))
    tried = variants("structural_mode", features, plant_parameters(levitator.actuator(base)))
    for n_amount in (1, 2):
        own = [one.shapes[0].centre for one in tried if len(one.amounts) == n_amount]
        assert own[-2:] == [181.7, 95.0]
        assert own[:2] == pytest.approx([32.0, 37.76])
    springs = variants("support_compliance", features, plant_parameters(levitator.actuator(base)))
    assert all(one.shapes[0].centre not in features.resonances for one in springs)


def test_friction_is_tried_in_each_of_its_forms(base) -> None:
    """Elastic before it slides and falling beyond, or passing zero with the velocity: never both in one."""
    features = RecordFeatures(1e-3, 1.0, 5e-3, 20.0)
    tried = variants("coulomb_friction", features, plant_parameters(levitator.actuator(base)))
    forms = {tuple(shape.name for shape in one.shapes) for one in tried}
    assert forms == {("presliding", "stribeck_rise", "stribeck_velocity"), ("transition_velocity",)}


def test_stretches_grow_as_the_model_improves(base, table) -> None:
    """Where the coil pulls a fifth less than believed, the belief bears shorter stretches than the fitted model."""
    record = levitator.record(base, levitator.Truth(inductance=0.8), seconds=0.5)
    runs = [run_data(record, run) for run in record.runs]
    believed = dynamic_runs(record, ModelHypothesis(record.actuator, table), runs)
    told: list[str] = []
    fitted = believed.settled(told.append)
    assert believed.cuts[0].begins.size > fitted.cuts[0].begins.size
    assert told[0].startswith("round 1 of at most 3")  # a long record takes minutes here: every step is told
    assert sum("a further step promises" in text for text in told) > 2


def test_a_static_map_beside_the_runs_stays_beside_stretches_that_are_chosen_anew(base, table) -> None:
    """It has unknowns of its own: zero and gain of its gauges, and the table's error wherever it goes."""
    record = replace(levitator.record(base, levitator.Truth(inductance=0.8), seconds=0.5), static=measured_map(table))
    runs = [run_data(record, run) for run in record.runs]
    believed = dynamic_runs(record, ModelHypothesis(record.actuator, table), runs)
    fitted = believed.settled(lambda text: None)
    assert believed.cuts[0].begins.size > fitted.cuts[0].begins.size
    assert MAP_BESIDE in fitted.notes
    of_runs = free_parameters(believed.belief, record.tolerance, runs=runs)
    assert dict(fitted.unknowns.believed).keys() > of_runs.keys()
    assert fitted.unknowns.believed == believed.unknowns.believed
    scale = [name for name, _ in fitted.unknowns.believed].index("magnetic_scale")
    assert fitted.begin[scale] < -1.0, "runs and map pull a fifth less than believed"


def measured_map(table) -> StaticMap:
    """The pull of a coil of four fifths, each third row held out."""
    current, gap = (each.ravel() for each in np.meshgrid(np.linspace(0.3, 1.5, 7), np.linspace(9e-3, 15e-3, 7)))
    noise = 2e-3 * np.random.default_rng(4).standard_normal(gap.size)
    role = np.where(np.arange(gap.size) % 3 == 2, "held-out", "fit")
    sigma = {"force": np.full(gap.size, 2e-3)}
    return StaticMap(gap, current, 0.8 * table.force(current, gap) + noise, None, role, sigma=sigma)


def test_stretches_stay_where_longer_ones_leave_far_more(base, table, monkeypatch) -> None:
    """The record above, with no growth of what is left allowed: the fit goes on from where it came to."""
    for name in ("FAR", "LOSES"):
        monkeypatch.setattr(f"msl_fem.diagnosis.runs.{name}", 0.0)
    record = levitator.record(base, levitator.Truth(inductance=0.8), seconds=0.5)
    runs = [run_data(record, run) for run in record.runs]
    believed = dynamic_runs(record, ModelHypothesis(record.actuator, table), runs)
    kept = believed.settled(lambda text: None)
    assert [cut.begins.size for cut in kept.cuts] == [cut.begins.size for cut in believed.cuts]
    assert kept.begin is not None
    assert np.abs(kept.begin).max() > 1
