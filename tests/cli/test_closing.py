"""The three lines below a result claim no more than its figures."""

from types import SimpleNamespace

import numpy as np
import pytest

from msl_fem.cli.closing import control_closing

RUN = SimpleNamespace(
    reference=np.array([-1e-4, 1e-4]),
    tracking_rms=2e-7,
    peak_current=1.0,
    guard_violations=0,
    force_limited=0,
    heat_limited=0,
)


@pytest.mark.parametrize(("share", "told", "way"), [(None, "", "take it along as C"), (0.5, "holds 50 %", "measure")])
def test_plants_that_are_not_held_are_told_beside_the_margins(share: float | None, told: str, way: str) -> None:
    """A sensitivity in zone A is of the believed plant; half of the possible ones lost is no loop for a board."""
    _, sure, next_step = control_closing(RUN, SimpleNamespace(peak_sensitivity=1.8), held_share=share)
    assert "zone A" in sure
    assert told in sure
    assert ("holds" in sure) is bool(told)
    assert way in next_step
