"""Demands that no magnet meets together are named, with what there is room for; others are let through."""

import re
import time

import pytest
from sizing_requirements import envelope, evaluator

from msl_fem.design.sizing import closed_search, first_designs
from msl_fem.design.sizing.closed_search import ContradictionSearch
from msl_fem.design.sizing.evaluation import CLOSED_FORM_ERROR, SOLVED
from msl_fem.design.sizing.parameters import space_around, textbook_guess
from msl_fem.errors import RequirementError

TEN_KILONEWTON = {"force": {"minimum": "10 kN", "gap": "0.5 mm"}}


@pytest.fixture(autouse=True)
def short_searches(monkeypatch: pytest.MonkeyPatch) -> None:
    """A quarter of the generations find the same to some per cent."""
    monkeypatch.setattr(closed_search, "_GENERATIONS", 10)


def complaint(**changes: object) -> str:
    with pytest.raises(RequirementError) as caught:
        first_designs(evaluator(**changes))
    assert "\n" not in str(caught.value)
    return str(caught.value)


def fits(**changes: object) -> bool:
    """Whether the closest design is let through."""
    it = evaluator(**changes)
    asked = ContradictionSearch(it, space_around(textbook_guess(it), it))
    return asked.closest().score <= CLOSED_FORM_ERROR


def number(pattern: str, text: str) -> float:
    found = re.search(pattern, text)
    assert found, text
    return float(found.group(1))


def test_ten_kilonewton_in_a_thimble() -> None:
    """The constraints that clash, the force that there is room for, the envelope that would do: each checked.

    CPU seconds, not those that pass: a search of fields would take a minute.
    """
    started = time.process_time()
    said = complaint(**TEN_KILONEWTON, **envelope("60 mm", "60 mm", "60 mm"))
    assert time.process_time() - started < 20
    assert "10000 N at 500 µm below 1.2 T" in said
    for name in ("envelope_width", "envelope_height", "envelope_depth"):
        assert re.search(rf"{name} \S+ mm \(at most 60 mm\)", said), said
    room, by_field = number(r"at most (\S+) N \(iron", said), number(r", (\S+) N by the field", said)
    assert by_field == pytest.approx(room, rel=0.1)
    assert room < 10e3
    # what is said to fit fits, and much more is refused
    below, above = ({"force": {"minimum": f"{f * room} N", "gap": "0.5 mm"}} for f in (0.9, 1.8))
    assert fits(**below, **envelope("60 mm", "60 mm", "60 mm"))
    assert not fits(**above, **envelope("60 mm", "60 mm", "60 mm"))
    times = number(r"must be (\S+) times as large", said)
    assert times > 1.5
    side = f"{60 * times} mm"
    assert fits(**TEN_KILONEWTON, **envelope(side, side, side))


def test_a_slew_rate_that_the_supply_cannot_drive() -> None:
    force = {"minimum": "150 N", "gap": "0.5 mm", "slew_rate": "1e8 N/s"}
    said = complaint(force=force, supply={"voltage": "10 V", "current": "2 A"})
    assert re.search(r"force_slew_rate \S+ kN/s \(at least 100 MN/s\)", said), said
    assert "envelope" not in said.split(";")[1], "no envelope is stated, none is asked for"


def test_no_size_has_that_force() -> None:
    assert "no e-core of textbook proportions gives" in complaint(force={"minimum": "9e8 N", "gap": "0.5 mm"})
    assert "at most 1e+09 N" in complaint(force={"minimum": "1e12 N", "gap": "0.5 mm"})


def test_an_envelope_that_only_the_textbook_s_proportions_break() -> None:
    """A flat magnet: another shape is found inside it, and the field agrees."""
    it = evaluator(**envelope("70 mm", "30 mm", "80 mm"))
    assert it.by_closed_form(textbook_guess(it)).violation > 0.05
    _, designs = first_designs(it)
    evaluation = it.by_field(designs["closed-form mass"])
    assert evaluation.stage == SOLVED
    assert evaluation.violation < 0.05
