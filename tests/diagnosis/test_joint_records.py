"""Runs and a static map of one record together: one likelihood, the same unknowns, sharper answers."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from diagnosed import RUNS, TABLE, VOLTAGE_SERVO

from msl_fem.bench import BenchOptions, parse_requests, sealed_record
from msl_fem.diagnosis import DiagnosisSettings, diagnose
from msl_fem.diagnosis.fit import FitPlan, fit
from msl_fem.diagnosis.measured_map import measured_map
from msl_fem.diagnosis.problem import Points
from msl_fem.diagnosis.runs import prepared_runs
from msl_fem.diagnosis.static_maps import MAP_BESIDE, JointLikelihood, map_beside
from msl_fem.plant.excitation import parse_excitation
from msl_fem.prediction import ModelHypothesis, run_data
from msl_fem.record import Noise, StaticMap


@cache
def sealed(*hidden: str):
    excitations = tuple(parse_excitation(text, unit="V") for text in RUNS)
    options = BenchOptions(seed=7, excitations=excitations, static=True)
    return sealed_record(VOLTAGE_SERVO, TABLE, parse_requests(hidden), options)


def likelihoods(record):
    """(runs alone, unknowns), (runs and map, unknowns)."""
    belief = ModelHypothesis(record.actuator, TABLE)
    runs = [data for data in (run_data(record, run) for run in record.runs) if data.role == "fit"]
    alone = prepared_runs(belief, runs, record.tolerance)
    return alone, prepared_runs(belief, runs, record.tolerance, static=map_beside(record, belief))


def test_the_numbers_of_runs_and_map_stand_side_by_side() -> None:
    (alone, few), (both, unknowns) = likelihoods(sealed().record)
    assert isinstance(both, JointLikelihood)
    z = np.zeros((2, unknowns.size))
    z[1, [name for name, _ in unknowns.believed].index("magnetic_scale")] = 1.0
    found = both.spectra(Points.of(unknowns, z))
    n = both.static.labels.size
    assert found.shape == (2, both.labels.size)
    assert both.ceilings.size == both.labels.max() + 1
    assert np.isfinite(found).all()
    assert found[0, :-n] == pytest.approx(alone.spectra(Points.of(few, np.zeros((1, few.size))))[0], abs=1e-9)
    assert np.mean(found[0, -n:] != found[1, -n:]) > 0.9, "all rows with a current"
    assert unknowns.n_table >= few.n_table, "the map goes farther than the runs"


def test_a_map_beside_the_runs_tells_the_magnets_apart_from_the_mover() -> None:
    """Scaling magnets, gap, mass and sensor together changes no run: a map breaks the tie."""
    (alone, few), (both, unknowns) = likelihoods(sealed().record)
    plan, at = FitPlan(most_steps=8), [name for name, _ in few.believed].index("magnetic_scale")
    one, two = fit(alone, few, np.zeros(few.size), plan=plan), fit(both, unknowns, np.zeros(unknowns.size), plan=plan)
    before, after = (np.sqrt(np.linalg.inv(found.precision)[at, at]) for found in (one, two))
    assert after < 0.5 * before
    true = sealed().answer["true_parameters"]["magnetic_scale"]["relative_error"]
    assert abs(two.z[at] * few.believed[at][1] - true) < 4 * after * few.believed[at][1]
    only_runs, as_runs = both.runs_part(two)
    assert as_runs.residual.size == as_runs.jacobian.shape[0] == only_runs.labels.size


def test_what_is_hidden_in_runs_and_map_is_found_by_both() -> None:
    found = diagnose(sealed("fringing=3%").record, DiagnosisSettings(table=TABLE))
    assert found.names[:1] == ("fringing",)
    assert MAP_BESIDE in found.notes
    assert found.verdict in ("named", "named-and-unexplained")


@pytest.mark.parametrize(("stated", "least", "most"), [(0.5, 1.4, 2.8), (1.0, 1.0, 1.3)])
def test_rows_that_scatter_more_than_stated_tell_their_noise(stated: float, least: float, most: float) -> None:
    excitations = tuple(parse_excitation(text, unit="V") for text in RUNS)
    options = BenchOptions(seed=11, excitations=excitations, static=True, stated_noise=stated)
    found = measured_map(sealed_record(VOLTAGE_SERVO, TABLE, (), options).record, TABLE)
    assert least < found.louder.get("force_N", 1.0) + 1e-9 < most
    assert len(found.notes) == len(found.louder)


def test_what_is_smooth_along_a_sweep_is_no_noise() -> None:
    """A pull of a tenth more than believed, a hundred times its noise, and a coarse sweep."""
    gap, current = (each.ravel() for each in np.meshgrid(np.linspace(0.4e-3, 0.8e-3, 6), np.linspace(0.2, 1.6, 8)))
    order = np.lexsort((current, gap))
    force = 1.1 * TABLE.force(current, gap)
    rows = StaticMap(gap, current, force, None, np.full(gap.size, "fit")).at(order)
    record = replace(sealed().record, static=rows, noise=Noise(force=0.1 / 100 * float(np.median(force))))
    assert not measured_map(record, TABLE).louder
