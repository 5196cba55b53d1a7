"""The levitation rig's record: its table is that of its static data, and the question that it raises stands."""

import levitation_rig as study
import numpy as np
import pytest
from conftest import ROOT

from msl_fem.record import load_record
from msl_fem.record.measured_table import table_from_measurements
from msl_fem.table.magnetic_table import read_table

RIG = ROOT / "measurements" / "levitation_rig"
WEIGHT = 61.57e-3 * 9.81


@pytest.fixture(scope="module")
def record():
    return load_record(RIG)


@pytest.fixture(scope="module")
def table():
    return read_table(RIG / "table.nc")


def test_the_stored_table_is_that_of_the_static_data(record, table):
    remade, report = table_from_measurements(record.static, record.noise)
    assert report.flux_linkage_residual < 1.5
    for name in ("coenergy", "force", "flux_linkage"):
        scale = np.abs(table.nodes[name]).max()
        assert np.abs(remade.nodes[name] - table.nodes[name]).max() < 1e-6 * scale


def test_the_weight_is_the_balls(record):
    assert -record.actuator.motion.constant_force == pytest.approx(WEIGHT, rel=1e-4)


def test_ohms_law_holds_at_rest(record):
    """At a rest dlambda/dt is nought, so mean voltage over mean current is the stated resistance."""
    for run in record.runs:
        late = slice(-1500, None)
        resistance = run["voltage_1_V"][late].mean() / (run["current_1_A"][late].mean() - 0.02)
        assert resistance == pytest.approx(4.17, rel=0.06), run.name


def test_the_flux_table_asks_for_more_current_than_the_ball_needs(record, table):
    """In every run, with every controller, by 13 to 18 %."""
    for run in record.runs:
        for rest in study.rests(record, run.name):
            error = study.holding_current(table, rest.gap, WEIGHT) / rest.current - 1
            assert 0.12 < error < 0.19, (run.name, rest)


def test_a_remanence_fitted_on_one_run_holds_on_the_others(record, table):
    size, length = study.remanence_law(table, study.rests(record, "steps"), WEIGHT)
    for run in record.runs_of("held-out"):
        for rest in study.rests(record, run.name):
            slope = size * np.exp(-rest.gap / length)
            assert study.holding_current(table, rest.gap, WEIGHT, slope) == pytest.approx(rest.current, rel=0.035)
