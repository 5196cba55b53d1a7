"""Numbers, names and foreign texts survive as C, and cannot become other C."""

import math
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from msl_fem.errors import InputError
from msl_fem.export.c_text import c_comment, c_number, c_prefix, c_rows, index_type


@given(st.floats())
def test_a_literal_is_exactly_the_number(value):
    text = c_number(value)
    if math.isfinite(value):
        assert re.fullmatch(r"-?0x[01](\.[0-9a-f]+)?p[+-]\d+", text)
        assert float.fromhex(text) == value
        assert math.copysign(1, float.fromhex(text)) == math.copysign(1, value)
    else:
        assert text in ("NAN", "INFINITY", "-INFINITY")


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.0, "0x0p+0"), (-0.0, "-0x0p+0"), (1.5, "0x1.8p+0"), (0.1, "0x1.999999999999ap-4"),
     (5e-324, "0x0.0000000000001p-1022"),
     (np.float64(-16.0), "-0x1p+4"), (math.inf, "INFINITY"), (-math.inf, "-INFINITY"), (math.nan, "NAN")],
)  # fmt: skip
def test_literals(value, text):
    assert c_number(value) == text


def test_rows_nest_and_break_into_lines():
    assert c_rows([[1, 2], [3, 4]], of="integer") == "{1, 2},\n{3, 4}"
    assert c_rows(np.array([0.5, 2.0])) == "0x1p-1, 0x1p+1"
    long = c_rows(np.linspace(0, 1, 40))
    assert max(map(len, long.splitlines())) <= 101
    assert len(re.split(r",\s+", long)) == 40


@given(st.text())
def test_any_actuator_name_gives_an_identifier(name):
    prefix = c_prefix(name, None)
    assert re.fullmatch(r"[a-z][a-z0-9]*(_[a-z0-9]+)*", prefix)
    assert len(prefix) <= 24
    assert c_prefix(prefix, prefix) == prefix


@pytest.mark.parametrize(
    ("name", "prefix"),
    [("fast_tool_servo", "fast_tool_servo"), ("Fast Tool-Servo", "fast_tool_servo"), ("", "magnet"), ("*/ x; /*", "x"),
     ("9 lives", "magnet_9_lives"), ("_Bool", "bool"), ("größe", "gr_e"), ("a" * 23 + "_b", "a" * 23)],
)  # fmt: skip
def test_prefixes(name, prefix):
    assert c_prefix(name, None) == prefix


@pytest.mark.parametrize("wanted", ["", "Servo", "2servo", "_x", "a__b", "x y", "x;int y", "a\n", "é", "a" * 25])
def test_a_wanted_prefix_that_is_none_is_refused(wanted):
    with pytest.raises(InputError, match=r"--name .* small letters"):
        c_prefix("fine", wanted)


@given(st.text(st.sampled_from("*/\\?\n\r\"'%=#ab é\0")) | st.text())
def test_no_text_leaves_its_comment(text):
    said = c_comment(text)
    assert said.isascii()
    assert said.isprintable()
    assert not set(said) & set("*/\\?\"'#")
    assert len(said) <= 112


def test_what_a_comment_keeps():
    assert c_comment("percentile=95") == "percentile=95"
    assert c_comment("50 µm ... 1.2 mm (12 A)") == "50 um ... 1.2 mm (12 A)"


def test_the_type_of_an_index_holds_it():
    assert [index_type(n) for n in (255, 256, 65535, 65536)] == [
        "unsigned char", "unsigned short", "unsigned short", "unsigned long",
    ]  # fmt: skip
