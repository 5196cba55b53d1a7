"""The criterion's text: what it means, and what is refused."""

import math

import pytest

from msl_fem.errors import InputError
from msl_fem.maps.level_currents import CORNER_RADIUS, Criterion, parse_criterion


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("mean", Criterion("mean")),
        (" max ", Criterion("max", radius=CORNER_RADIUS)),
        ("max=0.5mm", Criterion("max", radius=5e-4)),
        ("max = 200 µm", Criterion("max", radius=2e-4)),
        ("percentile=95", Criterion("percentile", percent=95.0)),
        ("percentile=99.5 %", Criterion("percentile", percent=99.5)),
    ],
)
def test_a_criterion_s_text(text, wanted):
    found = parse_criterion(text)
    assert found.kind == wanted.kind
    for name in ("percent", "radius"):
        one, other = getattr(found, name), getattr(wanted, name)
        assert one == pytest.approx(other, nan_ok=True)


def test_what_it_means_is_said():
    assert "section" in parse_criterion("mean").meaning
    assert "99.5 %" in parse_criterion("percentile=99.5").meaning
    assert "200 µm from its corners" in parse_criterion("max=0.2mm").meaning
    assert all("in the iron" in parse_criterion(text).meaning for text in ("mean", "max", "percentile=50"))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "unknown; choose mean, percentile=95"),
        ("median", "'median' is unknown"),
        ("mean=3", "'mean=3' is unknown"),
        ("percentile", "'percentile' is unknown"),
        ("max=", "'max=': '' is not a quantity"),
        ("max=3", "has no unit"),
        ("max=3 T", "wrong dimension"),
        ("max=0 mm", "must be positive"),
        ("max=-1mm", "must be positive, -1 mm"),
        ("percentile=0", "between 0 and 100"),
        ("percentile=100", "between 0 and 100"),
        ("percentile=nan", "is not a quantity"),
        ("x" * 1000, "unknown"),
    ],
)
def test_another_text_is_one_clear_error(text, said):
    with pytest.raises(InputError, match=said) as caught:
        parse_criterion(text)
    assert len(str(caught.value)) < 300
    assert math.isnan(Criterion("mean").radius)
