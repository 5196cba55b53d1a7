"""Starts of stretches go along with the numbers of a fit, to first order before a step and exactly behind it."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from types import SimpleNamespace

import levitator
import numpy as np
import pytest
from conftest import ROOT

from msl_fem.actuator import load_actuator
from msl_fem.diagnosis import fit as fitting
from msl_fem.diagnosis.fit import FitPlan, fit
from msl_fem.diagnosis.gathered import GatheredRuns
from msl_fem.diagnosis.likelihood import Likelihood, put_columns
from msl_fem.diagnosis.problem import Points
from msl_fem.diagnosis.runs import Runs, dynamic_runs
from msl_fem.diagnosis.shooting import REFINED, ModelSpread, Shooting
from msl_fem.diagnosis.start_refinement import LOST, Simulated, StartRefinement
from msl_fem.prediction import ModelHypothesis, run_data
from msl_fem.record import Record


@pytest.fixture(scope="module")
def record() -> Record:
    base = load_actuator(ROOT / "measurements" / "levitation_rig" / "actuator.toml")
    return levitator.record(base, levitator.Truth(inductance=0.9, resistance=1.05), seconds=0.5)


@pytest.fixture(scope="module")
def kind(record) -> Runs:
    runs = [run_data(record, run) for run in record.runs]
    return dynamic_runs(record, ModelHypothesis(record.actuator, levitator.table()), runs)


def scale_of(kind: Runs) -> int:
    return [name for name, _ in kind.unknowns.believed].index("magnetic_scale")


def test_the_starts_that_are_told_leave_less(kind) -> None:
    """As many as there are stretches, farther where the model is off, and from there next to nothing is left to do."""
    likelihood, z = kind.likelihood, np.zeros(kind.unknowns.size)
    z[scale_of(kind)] = -20.0
    points = Points.of(kind.unknowns, z[None])
    before, nearer, far = likelihood.spectra_and_starts(points)
    after, again, rest = likelihood.spectra_and_starts(replace(points, starts=nearer))
    assert [own.shape for own in nearer] == [(1, *cut.starts.shape) for cut in likelihood.problem.stretches]
    assert 0 < rest < 0.2 * far
    unknowns = kind.unknowns
    costs = [likelihood.weights(left[0], unknowns).nats for left in (before, after)]
    assert costs[1] < costs[0] - 10.0
    refined = likelihood.followed(unknowns, z).problem.stretches
    for own, cut, old in zip(again, refined, likelihood.problem.stretches, strict=True):
        off, were_off = (np.abs(starts - cut.starts)[:, [0, 2]].max(axis=0) for starts in (own[0], old.starts))
        assert np.all(off < 0.2 * were_off)


def test_starts_go_along_with_a_number(kind) -> None:
    """Behind a step a fraction is left to be moved of what is left where starts stay."""
    likelihood, unknowns, z = kind.likelihood, kind.unknowns, np.zeros(kind.unknowns.size)
    here, led, _ = likelihood.spectra_and_starts(Points.of(unknowns, z[None]))
    here, nearer, _ = likelihood.spectra_and_starts(Points.of(unknowns, z[None], led))
    which = np.array([scale_of(kind)])
    slopes = put_columns(np.empty((here[0].size, 1), order="F"), likelihood, unknowns, z, which, here[0], led, nearer)

    moved = z.copy()
    moved[which] += 4.0
    along = tuple(own + 4.0 * slope for own, slope in zip(nearer, slopes, strict=True))
    stay, go = (likelihood.spectra_and_starts(Points.of(unknowns, moved[None], own))[2] for own in (nearer, along))
    assert go < 0.2 * stay


def test_a_point_keeps_the_better_starts(kind, monkeypatch) -> None:
    """Where those that a linear model tells leave more, a point begins where it was."""
    likelihood, unknowns = kind.likelihood, kind.unknowns
    plain, worse = Likelihood.spectra_and_starts, []

    def astray(self: Likelihood, points: Points):
        found, nearer, _ = plain(self, points)
        worse.append(points.starts)
        return found, tuple(own + 1e-4 for own in nearer), 1.0

    monkeypatch.setattr(Likelihood, "spectra_and_starts", astray)
    posterior = fitting._FitPosterior(likelihood, unknowns, FitPlan())
    point = posterior.at(np.zeros(unknowns.size))
    assert len(worse) == 2
    assert point.starts is None


def test_a_fit_comes_to_the_same_end_in_fewer_rounds(kind, monkeypatch) -> None:
    """As where starts stay for a round: there it goes to and fro between starts and numbers."""
    rounds: list[int] = []
    plain = Likelihood.followed

    def noted(self: Likelihood, *one):
        rounds[-1] += 1
        return plain(self, *one)

    monkeypatch.setattr(Likelihood, "followed", noted)
    ends = []
    for good in (fitting.AS_GOOD, np.inf):
        monkeypatch.setattr(fitting, "AS_GOOD", good)
        rounds.append(0)
        ends.append(fit(kind.likelihood, kind.unknowns, np.zeros(kind.unknowns.size), plan=FitPlan(96)))
    assert ends[0].z == pytest.approx(ends[1].z, abs=0.05)
    assert ends[0].objective <= ends[1].objective + 0.5
    assert rounds[0] <= rounds[1]


def test_a_fitted_model_is_judged_from_the_starts_of_its_fit(kind, monkeypatch) -> None:
    """It leaves what its fit has left; others look for starts of their own."""
    found = fit(kind.likelihood, kind.unknowns, np.zeros(kind.unknowns.size))
    looked_for: list[str] = []

    def noted(self: Shooting, *args: object) -> dict[str, np.ndarray]:
        looked_for.append(self.data.role)
        return followed(self, *args)

    followed = Shooting.followed
    monkeypatch.setattr(Shooting, "followed", noted)
    every = kind.errors(kind.extend(found), found)
    for signal in (one for one in every if one.role == "fit"):
        sigma = kind.runs[0].noise[signal.channel].sigma
        assert signal.summary.rms / sigma == pytest.approx(found.excess[signal.channel], rel=0.02)
    assert "fit" not in looked_for
    kind.errors(kind.belief, None)
    assert "fit" in looked_for


def test_a_point_that_will_not_do_is_left_as_soon_as_that_shows(kind) -> None:
    posterior = fitting._FitPosterior(kind.likelihood, kind.unknowns, FitPlan())
    z = np.zeros(kind.unknowns.size)
    z[scale_of(kind)] = -20.0
    whole = posterior.at(z)
    taken = posterior.simulations
    left = posterior.at(z, most=whole.objective - 100.0)
    assert posterior.simulations - taken < taken
    assert left.objective >= whole.objective


def test_starts_go_half_as_far_each_time_that_a_move_has_failed(kind, monkeypatch) -> None:
    """From one point; from the next one they go all the way again."""
    likelihood, unknowns, z = kind.likelihood, kind.unknowns, np.zeros(kind.unknowns.size)
    slopes = tuple(np.zeros((z.size, *cut.starts.shape)) for cut in likelihood.problem.stretches)
    posterior = fitting._FitPosterior(likelihood, unknowns, FitPlan(), slopes)
    here = likelihood.problem.starts(1)
    points = [fitting._FitPoint(z, np.zeros(1), None, 0.0, nearer=tuple(own + 1e-6 for own in here)) for _ in range(2)]
    went: list[float] = []

    def noted(z: np.ndarray, starts: tuple[np.ndarray, ...], most: float) -> None:
        went.append(float(np.max(starts[0] - here[0])))

    monkeypatch.setattr(posterior, "at", noted)
    for point in (points[0], points[0], points[0], points[1]):
        posterior.moved(point, np.zeros(z.size))
    assert went == pytest.approx([1e-6, 0.5e-6, 0.25e-6, 1e-6], rel=1e-6)


@pytest.mark.parametrize(("most", "looks"), [(np.inf, 4), (1.0, 4), (50.0, 2), (-50.0, 1)])
def test_starts_that_are_nearly_as_good_do_where_a_step_has_failed(kind, monkeypatch, most: float, looks: int) -> None:
    """A point far above the one before is not looked at again for a hundredth of a sigma."""
    posterior, asked = fitting._FitPosterior(kind.likelihood, kind.unknowns, FitPlan()), []

    def near_by(z: np.ndarray, starts: object) -> tuple[SimpleNamespace, tuple[()], float]:
        asked.append(starts)
        return SimpleNamespace(objective=-0.1 * len(asked)), (), 0.01

    monkeypatch.setattr(posterior, "_from", near_by)
    posterior.at(np.zeros(kind.unknowns.size), most=most)
    assert len(asked) == looks


def test_fits_that_meet_begin_each_at_its_own_starts(kind) -> None:
    """Asked together, with starts of their own or those of the record, they get what each gets alone."""
    likelihood, unknowns, z = kind.likelihood, kind.unknowns, np.zeros((1, kind.unknowns.size))
    aside = tuple(own + 1e-5 for own in likelihood.problem.starts(1))
    every = [Points.of(unknowns, z), Points.of(unknowns, z, aside)]
    meeting = GatheredRuns(2)
    together: dict[int, np.ndarray] = {}

    def ask(n: int) -> None:
        with meeting.one_of_them():
            together[n] = likelihood.gathering(meeting).spectra(every[n])

    with ThreadPoolExecutor(2) as pool:
        list(pool.map(ask, range(2)))
    for n, points in enumerate(every):
        assert np.array_equal(together[n], likelihood.spectra(points))
    assert not np.array_equal(together[0], together[1])


def test_a_point_that_is_heated_keeps_the_starts_that_leave_less(kind) -> None:
    """A round that begins with a heat has slopes of the starts from the round before, and takes new ones."""
    likelihood, unknowns, z = kind.likelihood, kind.unknowns, np.zeros(kind.unknowns.size)
    z[scale_of(kind)] = -20.0
    slopes = tuple(np.zeros((z.size, *cut.starts.shape)) for cut in likelihood.problem.stretches)
    posterior = fitting._FitPosterior(likelihood, unknowns, FitPlan(), slopes)
    point = posterior.at(z)
    heated = posterior.heated(point, 5.0, 100.0)
    assert posterior.heat > 1.0
    assert heated.nearer is point.nearer is not None
    posterior.linearised(heated, None)
    assert all(np.abs(own).max() > 0 for own in posterior.start_slopes)


@pytest.mark.parametrize(("gained", "times"), [(0.5, 2), (20.0, 4)])
def test_starts_are_moved_again_where_that_brings_some_of_what_the_step_has_brought(
    kind, monkeypatch, gained: float, times: int
) -> None:
    """Each time brings so much; the step was one of a thousand nats."""
    told: list[object] = []

    def posterior_from(self, z, starts):
        told.append(starts)
        point = fitting._FitPoint(z, np.zeros(1), None, -gained * len(told))
        return point, (np.zeros(1),), 1.0

    monkeypatch.setattr(fitting._FitPosterior, "_from", posterior_from)
    posterior = fitting._FitPosterior(kind.likelihood, kind.unknowns, FitPlan())
    posterior.at(np.zeros(kind.unknowns.size), most=1000.0)
    assert len(told) == times
    told.clear()
    posterior.at(np.zeros(kind.unknowns.size))
    assert len(told) == 4, "without a step before it, as often as it may be"


def test_what_has_lost_its_way_over_a_stretch_stays_there(kind) -> None:
    """Of two beginnings one is far behind over two stretches: the other goes on over all of them."""
    problem = kind.likelihood.problem
    cut, n_channel = problem.stretches[0], len(problem.channels(0))
    here, there = (StartRefinement(cut, np.ones(cut.slopes.shape[1]), by_themselves=True) for _ in range(2))
    left = np.ones(cut.slopes.shape[-1])
    here.take(np.tile(left, (n_channel, 1)), cut.slopes)
    there.take(np.tile(np.where(np.arange(left.size) < cut.begins[2], 3.0, left), (n_channel, 1)), cut.slopes)
    least = np.minimum(here.least, there.least)
    for one in (here, there):
        one.give_up(least)
    assert np.all(here._part > 0)
    assert (there._part == 0).nonzero()[0].tolist() == [0, 1]


def test_one_of_two_beginnings_is_given_up_where_the_better_one_is_wanted(kind, monkeypatch) -> None:
    """After some steps: before, the one that will be better may be far behind."""
    asked: list[int] = []
    shot = Shooting(kind.likelihood.problem, 0, ModelSpread.of_tolerances(kind.unknowns), substeps=4)
    cut, steps = kind.likelihood.problem.stretches[0], []
    plain = StartRefinement.take
    monkeypatch.setattr(StartRefinement, "take", lambda self, *one: steps.append(id(self)) or plain(self, *one))
    monkeypatch.setattr(StartRefinement, "give_up", lambda self, least: asked.append(len(steps)))
    shot.refined(cut)
    assert not asked
    steps.clear()
    shot.followed(cut)
    before = steps[: asked[0]]
    assert max(map(before.count, before)) == REFINED // 2 + 1


def test_s_of_noise_is_that_of_white_noise_as_loud_as_its_instruments(kind, monkeypatch) -> None:
    """Twice as loud in the position, as stated in the rest; but for what chance makes of each band's density."""
    likelihood = kind.likelihood
    names, n_band = likelihood.channel_names, likelihood.bands.n_band
    loud = dict.fromkeys(names, 1.0) | {"position_m": 2.0}
    monkeypatch.setattr(Likelihood, "_loudness_at", lambda self, unknowns, z: loud)
    told = likelihood.nats_of_noise(kind.unknowns, np.zeros(kind.unknowns.size))
    noise = np.random.default_rng(11).standard_normal(likelihood.labels.size)
    spent = np.sqrt(1.0 - likelihood.spent / np.bincount(likelihood.labels))[likelihood.labels]
    made = noise * spent * np.array([loud[names[label // n_band]] for label in likelihood.labels])
    own = np.array([names[label // n_band] == "position_m" for label in range(likelihood.spent.size)])
    count = (np.bincount(likelihood.labels) - likelihood.spent)[own].sum()
    assert told == pytest.approx(np.log(2.0) * count), "numbers that went into starts are none"
    assert likelihood.plain_weights(made).nats == pytest.approx(told, abs=6 * np.sqrt(noise.size / 2) + 5 * n_band)


def test_a_fit_may_go_on_with_columns_of_where_it_is(kind) -> None:
    """Those that it has may be of places before."""
    begun = fit(kind.likelihood, kind.unknowns, np.zeros(kind.unknowns.size), plan=FitPlan(3))
    for fresh in (False, True):
        plan = FitPlan(1, enough=1e9, fresh_begin=fresh, fresh_end=False)
        on = fit(begun.likelihood, kind.unknowns, begun.z, plan=plan, goes_on=begun)
        assert on.simulations == (kind.unknowns.size if fresh else 0)


def test_a_copy_knows_what_was_found_where_it_is_the_same_there(kind) -> None:
    """What starts spend goes with their slopes, which are others where they are moved to another model."""
    z, ways = np.zeros(kind.unknowns.size), ("gathering", "starting", "followed")
    z[scale_of(kind)] = -20.0
    likelihood = replace(kind.likelihood)
    spent, labels = likelihood.spent, likelihood.labels
    asked = {"gathering": (None,), "starting": (likelihood.problem.starts(1),), "followed": (kind.unknowns, z)}
    for way in ways:
        other = getattr(likelihood, way)(*asked[way])
        anew = replace(other)
        assert other.labels is labels
        assert anew.labels is not labels
        np.testing.assert_array_equal(anew.labels, labels)
        np.testing.assert_array_equal(other.spent, anew.spent)
        assert (other.spent is spent) == (way != "followed")
    assert not np.array_equal(likelihood.followed(kind.unknowns, z).spent, spent)


def test_what_cannot_be_simulated_leaves_nothing_and_costs_much(kind) -> None:
    cut = kind.likelihood.problem.stretches[0]
    over = np.ones((len(kind.likelihood.problem.channels(0)), cut.slopes.shape[-1]))
    whole = Simulated.of(cut, over)
    over[0, cut.begins[2] - 1] = np.nan
    lost = Simulated.of(cut, over)
    np.testing.assert_array_equal(np.flatnonzero(lost.costs != whole.costs), [1])
    assert lost.costs[1] > LOST**2
    np.testing.assert_array_equal(lost.left, np.where(np.isnan(over), 0.0, 1.0))
    assert not np.may_share_memory(whole.left, over)
