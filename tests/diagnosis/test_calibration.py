"""A false-alarm rate is stated for what it was measured with, and for nothing else."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from diagnosed import SERVO, VOLTAGE_SERVO

from msl_fem.diagnosis import calibration
from msl_fem.diagnosis.calibration import calibration_of
from msl_fem.diagnosis.decision import Rule
from msl_fem.plant import plant_parameters
from msl_fem.plant.effects import CATALOGUE
from msl_fem.record import Noise, Record, Sampling, Tolerance

RECORD = Record("simulated", VOLTAGE_SERVO, Sampling(rate=1e4), Noise())


def stated(record: Record = RECORD, *, rule: Rule | None = None, seconds: float = 4.0, rate: float = 1e4) -> Any:
    run: Any = SimpleNamespace(rate=rate, commands=np.zeros((round(seconds * rate), 2)))
    return calibration_of(record, plant_parameters(record.actuator), [run], rule or Rule())


@pytest.mark.parametrize("servo", [VOLTAGE_SERVO, SERVO])
def test_the_studied_rigs_are_calibrated_with_the_catalogue_and_the_rule_of_today(servo: Any) -> None:
    """Where this fails, catalogue or rule have changed: make the study anew, or its rate is stated no more."""
    found, note = stated(replace(RECORD, actuator=servo))
    assert found is not None, note
    assert (found.named, found.records, note) == (0, 150, "")


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ({"rule": Rule(threshold=1.0)}, "another rule"),
        ({"seconds": 2.0}, "2 s of fit runs"),
        ({"seconds": 16.0}, "16 s of fit runs"),
        ({"rate": 2e4}, "samples a second"),
        ({"record": replace(RECORD, tolerance=Tolerance(table=0.0))}, "other tolerances"),
    ],
)
def test_no_rate_is_stated_beyond_what_was_measured(changed: dict[str, Any], told: str) -> None:
    found, note = stated(**changed)
    assert found is None
    assert told in note


def test_another_actuator_is_not_calibrated() -> None:
    heavier = VOLTAGE_SERVO.model_copy(update={"motion": VOLTAGE_SERVO.motion.model_copy(update={"moving_mass": 1.3})})
    found, note = stated(replace(RECORD, actuator=heavier))
    assert found is None
    assert "another actuator" in note


def test_an_effect_more_in_the_catalogue_asks_for_another_study(monkeypatch: pytest.MonkeyPatch) -> None:
    added = replace(CATALOGUE["force_offset"], name="cable_drag")
    monkeypatch.setitem(calibration.CATALOGUE, "cable_drag", added)
    found, note = stated()
    assert found is None
    assert "another catalogue" in note
