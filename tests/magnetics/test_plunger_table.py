"""A plunger magnet's table: consistent, refused where it must be, and the pull-in of a published solenoid on it."""

import numpy as np
import pytest
import solenoid_pull_in as study
from published_magnets import solenoid

from msl_fem.errors import InputError
from msl_fem.magnetics.field.plunger import plunger_table, solve_plunger

GAPS = np.r_[0.2, 0.25, 0.3, 0.4, 0.55, 0.75, 1, 1.5, 2, 3, 4, 5, 5.1] * 1e-3
CURRENTS = np.r_[0.02, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5, 0.7, 0.9, 1.1, 1.25]


@pytest.fixture(scope="module")
def table():
    return plunger_table(solenoid(), GAPS, CURRENTS, order=2)


@pytest.mark.parametrize(("current", "gap"), [(0.6, 0.34e-3), (1.2, 1.2e-3), (0.33, 2.4e-3)])
def test_between_its_nodes_it_is_what_the_field_says(table, current, gap) -> None:
    fresh = solve_plunger(solenoid(), current, gap)
    scale = np.abs(table.nodes["force"]).max()
    assert abs(float(table.force(current, gap)) + fresh.force) < 0.01 * abs(fresh.force) + 1e-4 * scale
    assert float(table.flux_linkage(current, gap)) == pytest.approx(fresh.flux_linkage, rel=5e-3)


def test_pull_in_of_the_published_solenoid(table) -> None:
    """0.30 mm at the published time within 2 %; the gap, and with the published static work the current as well."""
    wanted = study.reference()
    assert wanted.passed == pytest.approx(12.6e-3, rel=5e-3)
    time, _, gap = study.differences(study.pull_in(table), wanted)
    assert abs(time) < 0.02
    assert gap < 0.045
    time, current, gap = study.differences(study.pull_in(study.with_more_work(table, 0.032)), wanted)
    assert abs(time) < 0.01
    assert current < 0.04
    assert gap < 0.025


def test_refusals() -> None:
    for gaps in ([1e-3, 2e-3], [2e-3, 1e-3, 3e-3, 4e-3], [-1e-3, 1e-3, 2e-3, 3e-3]):
        with pytest.raises(InputError, match="gaps must be at least 4, positive and increasing"):
            plunger_table(solenoid(), gaps, CURRENTS)
    with pytest.raises(InputError, match="currents must be"):
        plunger_table(solenoid(), GAPS, [0.0, 0.1, 0.2, 0.3])
