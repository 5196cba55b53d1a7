"""TOML texts: what is written reads back to the same numbers and the same words."""

import math
import tomllib
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msl_fem.actuator import load_actuator, parse_actuator
from msl_fem.files.quantity import parse_quantity
from msl_fem.files.schema import document
from msl_fem.files.toml_text import quantity_text, toml_text

GEOMETRIES = Path(__file__).parents[2] / "geometries"
FINITE = st.floats(allow_nan=False, allow_infinity=False, min_value=-1e200, max_value=1e200)
VALUES = st.recursive(
    st.booleans() | st.integers(-(2**62), 2**62) | FINITE | st.text(st.characters(exclude_categories=["Cs"])),
    lambda inner: st.lists(inner, max_size=3),
    max_leaves=4,
)
KEYS = st.text(st.characters(exclude_categories=["Cs"]), max_size=8)
DOCUMENTS = st.recursive(
    st.dictionaries(KEYS, VALUES, max_size=3), lambda inner: st.dictionaries(KEYS, inner, max_size=3), max_leaves=6
)


@given(FINITE, st.sampled_from(["m", "A", "kg", "N s/m", "Hz", "Wb", "N/m", ""]))
def test_a_quantity_reads_back(value: float, unit: str) -> None:
    assert math.isclose(parse_quantity(quantity_text(value, unit), unit), value, rel_tol=5e-16)


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [(5e-8, "m", "50 nm"), (2500.0, "Hz", "2.5 kHz"), (0.9, "kg", "0.9 kg"), (12345.678, "kg", "12345.678 kg")],
)
def test_a_quantity_is_written_for_people(value: float, unit: str, text: str) -> None:
    assert quantity_text(value, unit) == text


@given(DOCUMENTS)
def test_a_document_reads_back(content: dict[str, Any]) -> None:
    assert tomllib.loads(toml_text(content)) == content


def test_arrays_of_tables_read_back() -> None:
    content = {"run": [{"file": "a.csv", "gain": {"kp": 1.5}}, {"file": "b.csv"}], "x": {"y": [[1, 2], [3]]}, "e": []}
    assert tomllib.loads(toml_text(content)) == content


@pytest.mark.parametrize("value", [None, object(), 1j])
def test_what_toml_has_no_word_for_is_refused(value: object) -> None:
    with pytest.raises(TypeError, match="has no TOML form"):
        toml_text({"key": value})


@pytest.mark.parametrize("name", ["e1", "fast_tool_servo"])
def test_an_actuator_reads_back_equal(name: str) -> None:
    actuator = load_actuator(GEOMETRIES / f"{name}.toml")
    again = parse_actuator(tomllib.loads(toml_text(document(actuator))))
    assert again == actuator.model_copy(update={"file": None})
    assert again.digest == actuator.digest
