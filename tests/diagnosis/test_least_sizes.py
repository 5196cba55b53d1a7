"""The least size of an effect that a record shows: its size by another route, and what tolerances cost."""

import sys

import numpy as np
import pytest
from conftest import ROOT
from diagnosed import TABLE, VOLTAGE_SERVO, bench_record

from msl_fem.diagnosis.fit import fit
from msl_fem.diagnosis.runs import prepared_runs
from msl_fem.diagnosis.scores import scores
from msl_fem.diagnosis.variants import record_features, variants
from msl_fem.plant.effects import EffectValues
from msl_fem.prediction import ModelHypothesis, free_run, kernel_plant, measured_start, run_data

sys.path.insert(0, str(ROOT / "benchmarks"))
from least_sizes import least_sizes

TRIED = ("time_delay", "force_offset", "gap_offset", "squeeze_film")


@pytest.fixture(scope="module")
def found():
    record = bench_record(seed=11).record
    run = run_data(record, record.runs[0])
    likelihood, unknowns = prepared_runs(ModelHypothesis(record.actuator, TABLE), [run], record.tolerance)
    base = fit(likelihood, unknowns, np.zeros(unknowns.size))
    plant = likelihood.problem.plant.parameters
    tried = [v for name in TRIED for v in variants(name, record_features(likelihood, base), plant)]
    return {one.effect: one for one in least_sizes(likelihood, base, scores(base, tried))}, run


def test_a_size_is_what_free_runs_with_and_without_the_effect_differ_by(found) -> None:
    sizes, run = found
    start = measured_start(kernel_plant(ModelHypothesis(VOLTAGE_SERVO, TABLE), rate=run.rate), run)
    for name, parameter in (("time_delay", "command"), ("force_offset", "force")):
        one = sizes[name]
        assert one.name == parameter
        runs = []
        for amount in (0.0, 10 * one.amount):
            values = EffectValues({name: {parameter: amount}})
            plant = kernel_plant(ModelHypothesis(VOLTAGE_SERVO, TABLE, values), rate=run.rate)
            runs.append(free_run(plant, run, start))
        changes = [
            np.sqrt(np.mean((runs[1].readings[c] - runs[0].readings[c]) ** 2) / np.mean(run.measured[c] ** 2))
            for c in run.measured
        ]
        assert max(changes) == pytest.approx(10 * one.size, rel=0.1)


def test_tolerances_cost_what_noise_does_not(found) -> None:
    """An offset of the gap has to be four of its tolerances; a film hides in the damping's; a delay in none."""
    sizes, _ = found
    assert sizes["gap_offset"].amount >= 4 * 0.005 * 6e-4 * 0.999
    assert sizes["gap_offset"].size > 100 * sizes["gap_offset"].alone
    assert sizes["squeeze_film"].size > 20 * sizes["squeeze_film"].alone
    assert sizes["time_delay"].size < 5 * sizes["time_delay"].alone
    assert list(sizes.values()) == sorted(sizes.values(), key=lambda one: one.size)
