"""The search along the current: on criteria that behave, and on such that do not."""

import math

import numpy as np
import pytest
from level_jobs import linear_field

from msl_fem.errors import NotConverged
from msl_fem.magnetics.field_map.gap_levels import MOST_SOLUTIONS, CurrentContinuation
from msl_fem.magnetics.field_map.readings import LevelReading

GAP = 5e-4


def climb_of(value, slope):
    """A climb on a linear iron whose criterion is a function of the current, with the slope it claims."""
    field = linear_field(1000)
    unit = float(field.model.source @ field.solve(1.0, GAP).potential)

    def reader(model, potentials):
        current = float(model.source @ potentials.potential) / unit
        return LevelReading(value(current), slope(current), 0.0, "somewhere")

    return CurrentContinuation(field, reader, GAP)


def saturating(i):
    return 2 * math.tanh(i / 5)


def saturating_slope(i):
    return 0.4 / math.cosh(i / 5) ** 2


def test_newton_needs_few_solutions():
    continuation = climb_of(saturating, saturating_slope)
    roots = [continuation.root(level, 40.0) for level in (1.2, 1.6)]
    np.testing.assert_allclose([r.current for r in roots], 5 * np.arctanh([0.6, 0.8]), rtol=1e-7)
    assert len(continuation.known) <= 9


@pytest.mark.parametrize("claimed", [lambda i: 0.0, lambda i: -1.0, lambda i: 3 * saturating_slope(i), lambda i: 1e-3])
def test_a_wrong_slope_costs_solutions_and_no_accuracy(claimed):
    root = climb_of(saturating, claimed).root(1.2, 40.0)
    assert root.current == pytest.approx(5 * math.atanh(0.6), rel=3e-5)


@pytest.mark.parametrize("step", [0.0, 0.3])
def test_a_kink_or_a_jump_is_bracketed(step):
    """A criterion that changes its place: the slope changes at once, the value may too; the level lies in the jump."""

    def value(i):
        return 0.2 * i if i < 5 else 1.0 + step + 0.5 * (i - 5)

    continuation = climb_of(value, lambda i: 0.2 if i < 5 else 0.5)
    assert continuation.root(1.0 + step / 2, 40.0).current == pytest.approx(5.0, rel=3e-5)


def test_a_level_beyond_the_largest_current_is_nan_and_names_the_place():
    continuation = climb_of(saturating, saturating_slope)
    below = continuation.root(1.2, 3.0)
    assert math.isnan(below.current)
    assert below.point.current == 3.0
    assert below.point.reading.place == "somewhere"
    assert math.isnan(continuation.root(1.6, 3.0).current)
    assert continuation.root(1.2, 40.0).current == pytest.approx(5 * math.atanh(0.6), rel=1e-7), (
        "and is found further out"
    )


def test_a_search_without_end_ends_with_an_error_that_says_where():
    continuation = climb_of(lambda i: 0.5, lambda i: 1e-30)
    with pytest.raises(NotConverged, match=r"1.2 T was found at gap 0.5 mm in \d+ field solutions"):
        continuation.root(1.2, math.inf)
    assert len(continuation.known) <= MOST_SOLUTIONS
