"""Movers held at rest: the force at rest beside the flux linkage."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq

from msl_fem.diagnosis import DiagnosisSettings, diagnose
from msl_fem.diagnosis.driver import diagnosis_of
from msl_fem.diagnosis.equilibria import StaticEquilibria, map_with_equilibria, static_equilibria
from msl_fem.prediction import ModelHypothesis
from msl_fem.record import load_record
from msl_fem.table.magnetic_table import read_table

RIG = Path(__file__).parents[2] / "measurements" / "levitation_rig"
WEIGHT = 0.604  # N


@pytest.fixture(scope="module")
def record():
    return load_record(RIG)


@pytest.fixture(scope="module")
def table():
    return read_table(RIG / "table.nc")


def test_the_levitation_rig_cannot_decide(record, table):
    """A constant force fits the two gaps of the fit run and errs ten times as much on the others: no name is given."""
    found = diagnose(record, DiagnosisSettings(table=table))
    assert (found.verdict, found.names) == ("undecidable", ())
    assert "force_offset" in found.reason
    assert "current reversed" in found.unexplained.next_experiment
    fit, held = (
        next(a for a in found.accuracy if (a.nominal.role, a.nominal.channel) == (role, "force_N"))
        for role in ("fit", "held-out")
    )
    assert fit.nominal.rms == pytest.approx(0.3 * WEIGHT, rel=0.1)
    assert fit.extended.rms < 0.01 * WEIGHT
    assert held.extended.rms > 0.03 * WEIGHT


def test_rests_are_where_reference_and_ball_stand(record):
    found = static_equilibria(record)
    assert np.allclose(found.force, WEIGHT)
    steps = found.gap[found.role == "fit"]
    assert set(np.round(steps * 1e3)) == {10.0, 12.0}
    assert steps.size == 14  # all seconds of the log but none of the step, which takes less than half of one


def simulated(record, table, *, hidden):
    """A map and rests of which the table is true, with a force that nobody believes."""
    rng = np.random.default_rng(3)
    static = record.static
    inside = (static.gap > 1e-3) & (static.gap < 0.95 * table.gap[-1]) & (static.current < 0.95 * table.current[-1])
    gap, current = static.gap[inside], static.current[inside]
    flux = table.evaluate(current, gap)["flux_linkage"] + record.noise.flux_linkage * rng.standard_normal(gap.size)
    rows = replace(
        static, gap=gap, current=current, force=None, flux_linkage=flux, role=np.full(gap.size, "fit"), extra={}
    )
    z = np.linspace(6e-3, 14e-3, 24)
    held = np.array([brentq(lambda i, g=g: float(table.force(i, g)) - (WEIGHT - hidden), 0.05, 2.5) for g in z])
    held *= 1 + 3e-4 * rng.standard_normal(z.size)
    role = np.where(np.arange(z.size) % 3 == 1, "held-out", "fit")
    return replace(record, static=rows), StaticEquilibria(z, held, np.full(z.size, WEIGHT), role)


@pytest.mark.parametrize("hidden", [0.0, 0.1])
def test_a_force_that_is_there_is_named_and_none_that_is_not(record, table, hidden):
    made, stood = simulated(record, table, hidden=hidden)
    kind = map_with_equilibria(made, ModelHypothesis(record.actuator, table), stood)
    found = diagnosis_of(kind, DiagnosisSettings(table=table))
    assert found.names == (("force_offset",) if hidden else ())
    if hidden:
        force = found.causes[0].parameters["force"]
        assert force.value == pytest.approx(hidden, rel=0.05)
        assert force.low < hidden < force.high
    else:
        assert found.verdict == "nothing-found"
