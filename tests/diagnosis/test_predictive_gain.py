"""What an effect brings on held-out runs where the numbers are as free as the fit runs leave them."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from diagnosed import TABLE, bench_record

from msl_fem.computing.arrays import Array
from msl_fem.diagnosis import runs as runs_module
from msl_fem.diagnosis.driver import kind_of
from msl_fem.diagnosis.fit import FitPlan, fit
from msl_fem.diagnosis.kind import about_belief
from msl_fem.diagnosis.likelihood import Fit, Likelihood, jacobian_columns
from msl_fem.diagnosis.noise import NoiseWeights
from msl_fem.diagnosis.problem import Points
from msl_fem.diagnosis.runs import STEPS_OF_ALL, Runs, prepared_runs
from msl_fem.diagnosis.settings import DiagnosisSettings
from msl_fem.diagnosis.unknowns import Unknowns
from msl_fem.errors import ComputationError
from msl_fem.record import Record

TO_THE_END = FitPlan(enough=1e-3)
EFFECT = "time_delay"
HIDDEN = bench_record(f"{EFFECT}=0.1%", noise="white").record
ELSEWHERE = bench_record(noise="white").record


@cache
def fitted(record: Record) -> tuple[Runs, Fit, Fit]:
    """A record made ready, and its fits without and with the effect."""
    kind = kind_of(record, DiagnosisSettings(table=TABLE))
    assert isinstance(kind, Runs)
    before = fit(kind.likelihood, kind.unknowns, np.zeros(kind.unknowns.size), plan=TO_THE_END)
    variant = next(one for one in about_belief(kind, before) if one.effect == EFFECT)
    unknowns = replace(kind.unknowns, effects=variant.unknowns)
    start = np.concatenate([before.z, np.zeros(len(unknowns.effects))])
    return kind, before, fit(kind.likelihood, unknowns, start, plan=TO_THE_END)


@cache
def held_out(kind: Runs) -> tuple[Likelihood, Unknowns]:
    """The held-out run by itself."""
    assert kind.record is not None
    held = [replace(run, role="fit") for run in kind.runs if run.role == "held-out"]
    likelihood, unknowns = prepared_runs(kind.belief, held, kind.record.tolerance)
    error = kind.likelihood.problem.table_error
    unknowns = replace(unknowns, believed=kind.unknowns.believed, n_table=kind.unknowns.n_table)
    return replace(likelihood, problem=replace(likelihood.problem, table_error=error)), unknowns


def log_density(kind: Runs, found: Fit) -> float:
    """Of the held-out run in white noise of unit variance: residuals r, with slopes J by numbers of covariance C, are
    normal with covariance 1 + JCJ'; the start of the run has a unit prior."""
    likelihood, unknowns = held_out(kind)
    unknowns = replace(unknowns, effects=found.unknowns.effects)
    n, own, starts = found.z.size, found.unknowns.n_nuisance, sum(unknowns.starts)
    shared = len(unknowns.believed) + unknowns.n_table
    keep = [*range(shared), *range(own, n)]
    covariance = np.eye(unknowns.size)
    places = [*range(shared), *range(shared + starts, unknowns.size)]
    covariance[np.ix_(places, places)] = np.linalg.inv(found.precision)[np.ix_(keep, keep)]
    z = np.zeros(unknowns.size)
    z[places] = found.z[keep]
    residual = likelihood.spectra(Points.of(unknowns, z[None]))[0]
    slopes = jacobian_columns(likelihood, unknowns, z, np.arange(z.size), residual).astype(float)
    told = slopes.T @ residual
    precision = np.linalg.inv(covariance) + slopes.T @ slopes
    spread = np.linalg.slogdet(covariance @ precision)[1]
    return float(told @ np.linalg.solve(precision, told) - residual @ residual - spread) / 2


def white(likelihood: Likelihood, residual: Array) -> NoiseWeights:
    """Noise that is what its statement says."""
    ones = np.ones(likelihood.spent.size)
    return NoiseWeights(ones, np.ones(residual.size), float(residual @ residual) / 2, ones, ones)


def test_it_is_the_normal_density_s_with_what_the_fit_leaves_uncertain(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Likelihood, "plain_weights", white)
    kind, before, after = fitted.__wrapped__(HIDDEN)
    told = [kind._evidence_of_all(one, FitPlan(enough=0.01)) - one.log_evidence for one in (before, after)]
    gain = told[1] - told[0]
    assert gain > 100.0
    assert 0.0 < kind.predictive_gain(before, after) <= gain
    assert gain == pytest.approx(log_density(kind, after) - log_density(kind, before), abs=1.0)


def test_an_effect_of_the_fit_run_alone_is_foretold_wrong() -> None:
    """Its held-out run is of a bench without it: the amount that both runs agree on suits neither."""
    record = replace(HIDDEN, runs=(HIDDEN.runs[0], ELSEWHERE.runs[1]))
    kind, before, after = fitted(record)
    assert after.log_evidence - before.log_evidence > 100.0
    assert kind.predictive_gain(before, after) < -50.0


def test_where_neither_model_follows_the_held_out_runs_nothing_is_gained(monkeypatch: pytest.MonkeyPatch) -> None:
    kind, before, after = fitted(HIDDEN)
    monkeypatch.setattr(Runs, "_evidence_of_all", lambda *_: -np.inf)
    assert kind.predictive_gain(before, after) == -np.inf


def test_a_model_that_cannot_follow_the_held_out_runs_foretells_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    kind, before, _ = fitted(HIDDEN)

    def failing(*_: object, **__: object) -> Fit:
        raise ComputationError("the simulation fails at the start of the fit")

    monkeypatch.setattr(runs_module, "fit", failing)
    assert kind._evidence_of_all(before, FitPlan()) == -np.inf


@pytest.mark.parametrize("beyond", [-1e6, -30.0, 10.0])
def test_a_fit_ends_once_it_has_come_to_what_is_asked(beyond: float) -> None:
    """Before it has gone anywhere, on its way, or at its own end where more is asked."""
    kind, before, after = fitted(HIDDEN)
    start = np.concatenate([before.z + 2.0, np.zeros(len(after.unknowns.effects))])
    asked = after.log_evidence + beyond
    found = fit(kind.likelihood, after.unknowns, start, plan=FitPlan(enough=1e-3, until=asked))
    whole = fit(kind.likelihood, after.unknowns, start, plan=TO_THE_END)
    if beyond > 0.0:
        assert found.log_evidence == pytest.approx(whole.log_evidence, abs=0.01)
    else:
        assert asked < found.log_evidence < whole.log_evidence - 0.1
        assert found.simulations < whole.simulations


def test_a_fit_of_all_runs_goes_on_until_it_confirms_an_effect(monkeypatch: pytest.MonkeyPatch) -> None:
    """More steps make the held-out runs more probable, never less."""
    kind, before, after = fitted(HIDDEN)
    plans: list[FitPlan] = []
    evidences = iter([before.log_evidence + 5.0, after.log_evidence + 45.0])

    def evidence(self: Runs, found: Fit, plan: FitPlan) -> float:
        plans.append(plan)
        return next(evidences)

    monkeypatch.setattr(Runs, "_evidence_of_all", evidence)
    assert kind.predictive_gain(before, after) == pytest.approx(40.0)
    assert [plan.until for plan in plans] == [np.inf, pytest.approx(after.log_evidence + 5.0)]
    assert {plan.most_steps for plan in plans} == {STEPS_OF_ALL}, "neither may come further than the other"
