"""What lies outside the table does not count and is counted; a record that lies outside as a whole is an error."""

from dataclasses import replace

import levitator
import numpy as np
import pytest
from conftest import ROOT

from msl_fem.actuator import load_actuator
from msl_fem.diagnosis import DiagnosisSettings, diagnose
from msl_fem.diagnosis.fit import FitPlan, fit
from msl_fem.diagnosis.kind import LOST, ErrorSignal, on_common_ground
from msl_fem.diagnosis.problem import FitProblem, Points, lanes
from msl_fem.diagnosis.runs import Runs, dynamic_runs
from msl_fem.diagnosis.shooting import guessed
from msl_fem.diagnosis.unknowns import Unknowns
from msl_fem.errors import InputError
from msl_fem.plant.effects import EffectValues
from msl_fem.plant.excitation import Inputs
from msl_fem.prediction import ModelHypothesis, kernel_plant, run_data
from msl_fem.record import Record
from msl_fem.table.magnetic_table import MagneticTable

TRUTH = levitator.Truth(mass=1.004, resistance=0.99, inductance=1.001, friction=0.01 * levitator.WEIGHT)


def table_from(gap: float) -> MagneticTable:
    """The coil as it is believed, from a gap on."""
    whole = levitator.table()
    kept = whole.gap >= gap
    return MagneticTable(whole.gap[kept], whole.current, {name: node[kept] for name, node in whole.nodes.items()})


@pytest.fixture(scope="module")
def record() -> Record:
    base = load_actuator(ROOT / "measurements" / "levitation_rig" / "actuator.toml")
    return levitator.record(base, TRUTH, seconds=2.0)


@pytest.fixture(scope="module")
def short_table(record: Record) -> MagneticTable:
    """A table that begins where 5 to 30 % of the run with the role fit lie below."""
    gaps = levitator.GAP - record.runs[0]["position_m"]
    table = table_from(float(np.quantile(gaps, 0.1)))
    assert 0.05 < np.mean(gaps < table.gap[0]) < 0.3
    return table


@pytest.fixture(scope="module")
def kind(record: Record, short_table: MagneticTable) -> Runs:
    runs = [run_data(record, run) for run in record.runs]
    return dynamic_runs(record, ModelHypothesis(record.actuator, short_table), runs)


def test_what_does_not_count_are_the_stretches_that_reach_below(
    kind: Runs, record: Record, short_table: MagneticTable
) -> None:
    """And hardly more: every sample below, and at most as many beside them that lie inside."""
    runs = [run_data(record, run) for run in record.runs]
    below = levitator.GAP - runs[0].measured["position_m"] < short_table.gap[0] - 4 * levitator.POSITION_NOISE
    counts = kind.likelihood.problem.counts(0)
    assert not np.any(counts & below)
    assert np.sum(~counts) < 2 * np.sum(below)
    assert kind.left_out[0].samples == np.sum(~counts)
    told = [one.to_json() for one in kind.left_out]
    assert [one["run"] for one in told] == ["loop_1", "loop_2"]
    assert all(f"{short_table.gap[0] * 1e3:.4g} to 20 mm" in one["details"] for one in told)
    assert sum("do not count" in note for note in kind.notes) == 2
    points = Points.of(kind.unknowns, np.zeros((1, kind.unknowns.size)))
    assert len(kind.likelihood.labels) == len(kind.likelihood.spectra(points)[0])


def test_a_fit_goes_on_beside_stretches_outside(kind: Runs) -> None:
    """Their starts stay where they are: what cannot be simulated does not move, and holds up no step of a fit."""
    cut = kind.likelihood.problem.cuts[0]
    points = Points.of(kind.unknowns, np.zeros((1, kind.unknowns.size)))
    _, [starts], _ = kind.likelihood.spectra_and_starts(points)
    assert 0 < np.sum(cut.outside) < cut.outside.size
    assert np.isfinite(starts).all()
    assert np.any(np.all(starts[0] == cut.starts, axis=1) & cut.outside)
    found = fit(kind.likelihood, kind.unknowns, np.zeros(kind.unknowns.size), plan=FitPlan(most_steps=4))
    assert found.objective < kind.likelihood.objective(kind.unknowns, np.zeros(kind.unknowns.size)) - 5.0


@pytest.mark.parametrize("count", [1, 3])
def test_time_goes_on_where_a_model_left_its_table(record: Record, short_table: MagneticTable, count: int) -> None:
    """What a periodic force does behind stretches outside is what it does with the whole table, in each lane."""
    effects = EffectValues({"periodic_disturbance": {"frequency": 33.0, "force_sine": 0.02}}).vector()
    points = Points(Unknowns((), 0, ()), np.zeros((count, 0)), np.tile(effects, (count, 1)))
    position = []
    for table in (levitator.table(), short_table):
        data = run_data(record, record.runs[0])
        plant = kernel_plant(ModelHypothesis(record.actuator, table), rate=data.rate)
        problem = FitProblem(plant, (data,), (), (), None)
        cut = guessed(plant, data, np.arange(0, len(data.commands), 16), 3)
        inputs = Inputs(data.commands[:, :1], data.rate)
        own = replace(cut, starts=np.tile(cut.starts, (count, 1, 1)))
        position.append(lanes(problem, points, 0, inputs=inputs, substeps=plant.substeps, own=own).position[-1])
    inside = np.repeat(np.isfinite(position[1].reshape(-1, 16)).all(axis=1), 16)
    assert 0.6 < inside.mean() < 0.98
    assert np.abs(position[0] - position[1])[inside].max() < 1e-9


def test_a_record_that_lies_outside_as_a_whole_is_one_error(record: Record) -> None:
    with pytest.raises(InputError, match=r"no sample of the runs with the role fit .* table holds 12\.\d+ to 20 mm"):
        diagnose(record, DiagnosisSettings(table=table_from(12e-3)))


def signal(values: np.ndarray) -> ErrorSignal:
    return ErrorSignal("run", "held-out", "position_m", values, deviation=1.0, floor=0.1, rate=1e3)


def test_models_are_compared_where_all_follow_and_who_loses_more_does_not_follow() -> None:
    base, few, many = np.ones(1000), 2 * np.ones(1000), np.ones(1000)
    few[: round(LOST * 1000)] = np.nan
    many[: round(LOST * 1000) + 1] = np.nan
    rms = [[one.summary.rms for one in of] for of in on_common_ground([[signal(v)] for v in (base, few, many)])]
    assert rms == [[1.0], [2.0], [np.inf]]
    first = on_common_ground([[signal(base)], [signal(few)]])[0][0]
    assert first.summary.samples == 980
    assert on_common_ground([[signal(base)], [signal(many)]])[0][0].summary.samples == 1000
    outside = np.arange(1000) < 500
    half = replace(signal(base), values=np.where(outside, np.nan, base)).without(outside)
    assert on_common_ground([[half], [half]])[1][0].summary.rms == 1.0
