"""Starts of stretches go along with the numbers of a fit, to first order before a step and exactly behind it."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import levitator
import numpy as np
import pytest
from conftest import ROOT

from msl_fem.actuator import load_actuator
from msl_fem.diagnosis import fit as fitting
from msl_fem.diagnosis.fit import FitPlan, fit
from msl_fem.diagnosis.gathered import GatheredRuns
from msl_fem.diagnosis.likelihood import Likelihood, columns_and_start_slopes
from msl_fem.diagnosis.problem import Points
from msl_fem.diagnosis.runs import Runs, dynamic_runs
from msl_fem.diagnosis.shooting import Shooting
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
    _, slopes = columns_and_start_slopes(likelihood, unknowns, z, which, here[0], led, nearer)

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
