"""Readings that do not count make no cause, and take with them what they would have told."""

from dataclasses import replace

import numpy as np
import pytest
from sprung import DAMPING, N, damping_interval, record

from msl_fem.diagnosis import diagnose
from msl_fem.record import Run, Tolerance

LEANT_ON = slice(1200, 2100)
ALL_BUT_DAMPING = Tolerance(**dict.fromkeys(Tolerance.model_fields, 0.0) | {"damping": 0.2})


def clipped(run: Run) -> Run:
    """Of a sensor with 20 nm steps that ends at 60 % of the largest position."""
    position = np.round(run["position_m"] / 2e-8) * 2e-8
    return replace(run, columns={**run.columns, "position_m": np.minimum(position, 0.6 * position.max())})


def test_a_clipped_sensor_is_no_cause() -> None:
    """Counted as read, its flat tops leave 25 times the noise, and the nearest cause is a nonlinear sensor."""
    whole = record()
    found = diagnose(replace(whole, runs=tuple(map(clipped, whole.runs))))
    assert (found.verdict, found.names) == ("nothing-found", ())
    assert [(one.run, one.channel) for one in found.left_out] == [("a", "position_m"), ("b", "position_m")]
    assert all(0.01 < one.share < 0.03 for one in found.left_out)


def test_what_is_not_valid_tells_nothing() -> None:
    """A probe that someone leant on for 30 % of the run: no cause, and the interval that the others leave."""
    whole = record()
    run = whole.runs[0]
    valid = np.ones(N, dtype=bool)
    valid[LEANT_ON] = False
    position = np.where(valid, run["position_m"], run["position_m"] + 30e-6)
    spoilt = replace(run, columns={**run.columns, "position_m": position}, valid={"position_m": valid})
    found = diagnose(replace(whole, runs=(spoilt, whole.runs[1])))
    assert (found.verdict, found.names) == ("nothing-found", ())
    assert [one.samples for one in found.left_out] == [900], "and no corner of it passes for a spike"
    known = diagnose(replace(whole, runs=(spoilt, whole.runs[1]), tolerance=ALL_BUT_DAMPING)).parameters["damping"]
    assert known.high - known.low == pytest.approx(damping_interval(run["force_N"], valid), rel=0.12)
    assert known.low < DAMPING < known.high
