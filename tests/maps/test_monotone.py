"""Why a curve falls with the gap."""

import numpy as np
import pytest

from msl_fem.maps.level_currents import monotone_or_why_not

GAP = np.array([1e-4, 2e-4, 4e-4])
LEGS = (("centre_leg",) * 3,)


def said(current, error=0.0, section=LEGS):
    row = np.array([current])
    return monotone_or_why_not(
        np.array([1.2]), GAP, row, error=np.full(row.shape, error), section=section, cause="look there"
    )


def test_a_rising_curve_and_one_that_ends_say_nothing():
    assert said([1.0, 1.0, 2.0]) == ()
    assert said([1.0, 2.0, np.nan]) == ()
    assert said([np.nan] * 3) == ()


@pytest.mark.parametrize(
    ("current", "more", "why"),
    [
        ([1.0, 0.9, 2.0], {}, "a larger gap should need more current; look there"),
        ([1.0, 0.9, 2.0], {"error": 0.06}, "the fall lies within the stated error of the currents"),
        (
            [1.0, 0.9, 2.0],
            {"section": (("centre_leg", "yoke", "yoke"),)},
            "the loading section changes from centre leg to yoke",
        ),
        ([np.nan, 0.9, 2.0], {}, "the level is not reached at the smaller gap"),
    ],
)
def test_a_fall_is_located_and_explained(current, more, why):
    (sentence,) = said(current, **more)
    assert sentence.startswith("the 1.2 T curve falls between gaps 100 µm and 200 µm")
    assert sentence.endswith(why)
