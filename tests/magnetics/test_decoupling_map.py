"""Decoupling over the map against single two-sided solutions, its symmetries, and what it says of the region."""

import json

import numpy as np
import pytest
from level_jobs import E1, SERVO

from msl_fem.errors import InputError
from msl_fem.magnetics.field.magnet_field import solve
from msl_fem.magnetics.field.two_sided import decoupling, solve_two_sided
from msl_fem.magnetics.field.two_sided_section import TwoSidedPosition
from msl_fem.magnetics.field_map import DecouplingMap, FieldMapSettings, decoupling_map
from msl_fem.report.pictures import draw_decoupling

FAST = FieldMapSettings(accuracy="fast")


@pytest.fixture(scope="module")
def found() -> DecouplingMap:
    return decoupling_map(SERVO, levels=(1.2,), positions=(0.0, 0.3e-3), settings=FAST)


def test_the_pairs_are_those_of_direct_solutions(found):
    """At 0.3 mm, 1.2 T on side 1 and 0.6 T on side 2, aiding and opposing."""
    p, j, k = 1, 2, 1
    i_1, i_2 = found.current[p, 0, j], found.current[p, 1, k]
    position = TwoSidedPosition(0.3e-3, 0.9e-3)
    singles = [
        solve(SERVO, float(i), gap, accuracy="fast", end_effects=False).quantities
        for i, gap in ((i_1, 0.3e-3), (i_2, 0.9e-3))
    ]
    larger = max(q.force for q in singles)
    for s, sign in enumerate((1.0, -1.0)):
        together = solve_two_sided(SERVO, (float(i_1), float(sign * i_2)), position, accuracy="fast").quantities
        expected = (singles[0].force - singles[1].force - together.net_force) / larger
        assert found.force_error[s, p, j, k] == pytest.approx(expected, abs=1e-5)
        both = decoupling(SERVO, (float(i_1), float(sign * i_2)), position, accuracy="fast")
        assert found.superposition_error[s, p, j, k] == pytest.approx(both.force_error, abs=1e-4)
        assert found.linked_share[p, 0, j] == pytest.approx(abs(both.linked_share_1), rel=1e-5)
        assert found.linked_share[p, 1, k] == pytest.approx(abs(both.linked_share_2), rel=1e-5)
        flux = (singles[0].flux_linkage - together.flux_linkage_1) / together.flux_linkage_1
        assert found.flux_error[s, 0, p, j, k] == pytest.approx(flux, abs=1e-5)


def test_in_the_middle_equal_sides_pull_equally(found):
    """No net force, whatever is shared; and the sides exchange."""
    for error in found.force_error[:, 0]:
        np.testing.assert_allclose(np.diag(error)[1:], 0, atol=1e-3)
        np.testing.assert_allclose(error[1:, 1:], -error[1:, 1:].T, atol=2e-3)
    np.testing.assert_allclose(found.linked_share[0, 0], found.linked_share[0, 1], rtol=2e-3)
    assert np.isnan(found.force_error[:, :, 0, 0]).all()


def test_one_side_on_is_decoupled_and_opposing_sides_share_their_armature(found):
    """The armature, 6 mm thick, carries both sides' flux where they oppose: half a leg's width of 5 mm each."""
    one = np.abs(found.force_error[0])[:, found.one_side_on()]
    assert np.nanmax(one) < 2e-3
    aiding, opposing = (abs(error[1, 2, 2]) for error in found.force_error)
    assert aiding < 0.01 < 0.05 < opposing
    assert (np.nanmax(np.abs(found.linked_share)) < 0.04).all()
    sentences = found.findings()
    assert sentences[0].endswith("% of a side's flux linkage links the other side")
    assert any(s.startswith("one side on") and s.endswith(": decoupled") for s in sentences)
    (said,) = [s for s in sentences if s.startswith("both on, opposing")]
    assert said.endswith(
        "decoupled to 1 % only up to 300 µm with both at 0.6 T or below, in the middle with both at 1.2 T or below"
    )
    assert 0 < found.uncertainty < 5e-3


def test_a_level_that_is_not_reached_leaves_holes_and_no_error():
    settings = FieldMapSettings(accuracy="fast", current_max=3.0)
    found = decoupling_map(SERVO, levels=(1.2,), positions=(0.3e-3,), settings=settings)
    assert np.isnan(found.current[0, 1, 2])
    assert np.isfinite(found.current[0, 0]).all()
    assert np.isnan(found.force_error[:, 0, :, 2]).all()
    assert np.isfinite(found.force_error[:, 0, 1:, 1]).all()
    assert found.findings()


def test_json_and_figure_hold_what_was_found(found):
    content = json.loads(json.dumps(found.to_json(), allow_nan=False))
    assert content["force_error"]["opposing"][1][2][2] == found.force_error[1, 1, 2, 2]
    assert content["force_error"]["aiding"][0][0][0] is None
    assert content["findings"] == list(found.findings())
    assert content["polarity"] == "opposing"
    figure = draw_decoupling(found)
    share, aiding, opposing = figure.axes
    line = next(line for line in share.lines if line.get_label() == "1.2 T")
    np.testing.assert_allclose(line.get_xdata(), [0.3, 0.6, 0.6, 0.9])
    np.testing.assert_allclose(line.get_ydata()[[0, 3]], 100 * found.linked_share[1, :, 2])
    drawn = next(line for line in opposing.lines if line.get_label() == "both at 1.2 T")
    assert drawn.get_ydata()[1] == pytest.approx(100 * abs(found.force_error[1, 1, 2, 2]))
    assert len(aiding.lines) == 4


@pytest.mark.parametrize(
    ("actuator", "wishes", "said"),
    [
        (E1, {}, "e1 has no two sides that share an armature"),
        (SERVO, {"positions": (-1e-4,)}, "between 0 and the nominal gap, 600 µm"),
        (SERVO, {"positions": (7e-4,)}, "between 0 and the nominal gap"),
        (SERVO, {"levels": (0.0,)}, "positive"),
    ],
)
def test_wishes_that_cannot_be_are_refused(actuator, wishes, said):
    with pytest.raises(InputError, match=said):
        decoupling_map(actuator, **wishes)
