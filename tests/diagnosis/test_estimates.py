"""What a fit tells of the believed parameters."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from msl_fem.actuator import Actuator
from msl_fem.diagnosis.estimates import believed_estimates, extended_belief
from msl_fem.diagnosis.likelihood import Likelihood
from msl_fem.diagnosis.unknowns import Unknowns
from msl_fem.plant.effects import EffectValues
from msl_fem.prediction import ModelHypothesis
from msl_fem.table.magnetic_table import MagneticTable


def test_the_lower_end_of_an_interval_stands_first_of_values_below_zero_too(
    servo: Actuator, table: MagneticTable
) -> None:
    """A mutual inductance is negative where the fluxes of both sides meet."""
    effects = EffectValues({"mutual_inductance": {"share": -0.056}})
    believed = (("mutual_inductance.share", 0.05), ("moving_mass", 0.005), ("position_zero", 1e-6))
    errors = SimpleNamespace(standard_errors=lambda found: np.ones(3))
    found = SimpleNamespace(unknowns=SimpleNamespace(believed=believed), z=np.full(3, 0.3), likelihood=errors)
    told = believed_estimates(ModelHypothesis(servo, table, effects), found)
    for one in told.values():
        assert one.low < one.value < one.high
    assert told["mutual_inductance.share"].high < 0


@pytest.mark.parametrize(("tolerances", "error"), [(10.0, 0.0204), (-300.0, -0.3), (300.0, 0.3)])
def test_a_gain_that_no_sensor_has_is_held_at_what_one_may_have(
    servo: Actuator, table: MagneticTable, tolerances: float, error: float
) -> None:
    """As of a fit that lacks a cause; it is an error of the reading in the model."""
    unknowns = Unknowns((("position_gain", 0.002),), 0, ())
    found = SimpleNamespace(unknowns=unknowns, z=np.array([tolerances]))
    problem = SimpleNamespace(table_error=None)
    model = extended_belief(ModelHypothesis(servo, table, None), problem, found)
    assert model.effects is not None
    assert model.effects.get("position_sensor_nonlinearity", "gain_error") == pytest.approx(error, abs=1e-3)


def test_standard_errors_are_those_of_the_inverse_and_finite_where_that_has_no_digits_left() -> None:
    column = np.random.default_rng(1).standard_normal((50, 3))
    precision = column.T @ column + np.eye(3)
    found: Any = SimpleNamespace(z=np.zeros(3), precision=precision)
    errors = Likelihood.standard_errors(None, found)  # type: ignore[arg-type]
    assert errors == pytest.approx(np.sqrt(np.diag(np.linalg.inv(precision))), rel=1e-10)
    along = np.array([[1.0, -2.0, 0.5]])
    exact = np.sqrt(along @ np.linalg.inv(precision) @ along.T)[0]
    assert Likelihood.standard_errors(None, found, along) == pytest.approx(exact, rel=1e-10)  # type: ignore[arg-type]
    turned = np.linalg.qr(column[:3])[0]
    lost: Any = SimpleNamespace(z=np.zeros(3), precision=turned @ np.diag([1e17, 1.0, -4.0]) @ turned.T)
    assert not np.all(np.diag(np.linalg.inv(lost.precision)) > 0.0)
    assert np.all(np.isfinite(Likelihood.standard_errors(None, lost)))  # type: ignore[arg-type]
