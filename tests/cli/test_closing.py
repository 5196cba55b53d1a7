"""The three lines below a result claim no more than its figures."""

from types import SimpleNamespace

import numpy as np
import pytest

from msl_fem.cli.closing import control_closing, identify_closing
from msl_fem.control.asked_voltage import AskedVoltage

RUN = SimpleNamespace(
    reference=np.array([-1e-4, 1e-4]),
    tracking_rms=2e-7,
    peak_current=1.0,
    guard_violations=0,
    force_limited=0,
    heat_limited=0,
)
MILD = AskedVoltage(overlap=0.0, largest=10.0, limit=80.0, copper_loss=1.0, needed=0.0)


@pytest.mark.parametrize(("share", "told", "way"), [(None, "", "take it along as C"), (0.5, "holds 50 %", "measure")])
def test_plants_that_are_not_held_are_told_beside_the_margins(share: float | None, told: str, way: str) -> None:
    """A sensitivity in zone A is of the believed plant; half of the possible ones lost is no loop for a board."""
    _, sure, next_step = control_closing(RUN, SimpleNamespace(peak_sensitivity=1.8), asked=MILD, held_share=share)
    assert "zone A" in sure
    assert told in sure
    assert ("holds" in sure) is bool(told)
    assert way in next_step


def identification(tests: dict[str, float], *, free_run: float | None) -> SimpleNamespace:
    """A held-out and a fitted run; residual tests by name and p-value, 0.01 being the band."""
    followed = SimpleNamespace(run="noise", free_run=99.0, one_step=99.9)
    unseen = SimpleNamespace(run="sweep", free_run=free_run, one_step=98.0)
    results = [SimpleNamespace(name=name, p_value=p, inside_band=p > 0.01) for name, p in tests.items()]
    return SimpleNamespace(fits=[followed, unseen], roles=("fit", "held-out"), residual_tests=results)


@pytest.mark.parametrize(
    ("tests", "free_run", "left", "way"),
    [
        ({"residuals": 1e-9, "i1^2/g1^2": 0.3}, 95.0, "on themselves (p = 1e-09)", "use it; msl-fem"),
        ({"residuals": 1e-3, "i1^2/g1^2": 1e-5}, 95.0, "themselves and i1^2/g1^2 (p = 1e-05)", "use it; msl-fem"),
        ({"residuals": 0.4, "i1^2/g1^2": 0.3}, 95.0, "white and depend on no input", "msl-fem control --model"),
        ({"residuals": 1e-9, "i1^2/g1^2": 0.3}, 40.0, "still depend on themselves", "try --orders auto"),
        ({"residuals": 0.4, "i1^2/g1^2": 0.3}, None, "white", "try --orders auto"),
    ],
    ids=["coloured", "coloured and of an input", "white", "poor", "diverged"],
)  # fmt: skip
def test_residuals_that_depend_on_something_are_told_with_what_to_do(
    tests: dict[str, float], free_run: float | None, left: str, way: str
) -> None:
    meaning, sure, next_step = identify_closing(identification(tests, free_run=free_run))
    assert "sweep (held-out)" in meaning
    assert ("leaves all bounds" in meaning) is (free_run is None)
    assert left in sure
    assert way in next_step
