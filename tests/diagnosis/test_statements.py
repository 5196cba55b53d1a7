"""The hold of the commands, stated wrongly: what the record says against what rig.toml says."""

import numpy as np
from diagnosed import TABLE, bench_record

from msl_fem.diagnosis.problem import Points
from msl_fem.diagnosis.runs import Runs, dynamic_runs
from msl_fem.prediction import ModelHypothesis, run_data


def believed(kind: Runs) -> float:
    """Nats of the belief."""
    residual = kind.likelihood.spectra(Points.of(kind.unknowns, np.zeros((1, kind.unknowns.size))))[0]
    return -kind.likelihood.weights(residual).nats


def test_the_hold_is_turned_round_in_all_runs_and_the_true_one_is_more_probable() -> None:
    record = bench_record(seed=11, rate=2e3).record
    runs = [run_data(record, run) for run in record.runs]
    kind = dynamic_runs(record, ModelHypothesis(record.actuator, TABLE), runs)
    (turned,) = kind.restatements()
    assert {run.hold for run in (*turned.runs, *turned.likelihood.problem.runs)} == {"linear"}
    assert {run.hold for run in kind.runs} == {"zero-order"}
    assert believed(kind) > believed(turned) + 1000
    (back,) = turned.restatements()
    assert believed(back) == believed(kind)
    assert 'held "linear" and not "zero-order"' in turned.notes[-1]
