"""Quantities: what people write becomes SI, what is no quantity is refused in one line."""

import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msl_fem.actuator import load_actuator
from msl_fem.design.sizing import load_requirement
from msl_fem.errors import InputError, QuantityError
from msl_fem.files import quantity
from msl_fem.files.quantity import format_quantity, parse_quantities, parse_quantity, parse_temperature


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("0.6 mm", "m", 0.6e-3),
        ("50 nm", "m", 50e-9),
        ("20 µm", "m", 20e-6),  # the micro sign
        ("20 μm", "m", 20e-6),  # the Greek letter
        ("20 um", "m", 20e-6),
        ("1 in", "m", 0.0254),
        ("2.5 kHz", "Hz", 2500.0),
        ("1.4e5 N/m", "N/m", 1.4e5),
        ("12 N s/m", "N s/m", 12.0),
        ("12 N·s/m", "N s/m", 12.0),
        ("1.0 ohm", "ohm", 1.0),
        ("4 Ω", "ohm", 4.0),
        ("20 uWb", "Wb", 20e-6),
        ("0.90 kg", "kg", 0.9),
        ("3 %", "", 0.03),
        ("0.96", "", 0.96),
        ("  -5A ", "A", -5.0),
        (".5 A", "A", 0.5),
    ],
)
def test_texts_become_si_values(text: str, unit: str, value: float) -> None:
    assert parse_quantity(text, unit) == pytest.approx(value, rel=1e-14)


@pytest.mark.parametrize(
    ("text", "unit", "said"),
    [
        ("0.6", "m", "no unit"),
        ("0.6 kg", "m", "wrong dimension"),
        ("0.6 blah", "m", "not a unit"),
        ("0.6 m", "", "wrong dimension"),
        ("20 degC", "K", "offset"),
        ("150000 rpm", "Hz", "counts radian; give turns a second"),
        ("2500 turn/s", "Hz", "counts radian"),
        ("15708 rad/s", "Hz", "counts radian"),
        ("2500 Bq", "Hz", "counts count"),
        ("3 pi", "", "counts pi; give a pure number"),
        ("5 count", "", "counts count"),
        ("1 rad", "", "counts radian"),
        ("1 bit", "", "counts bit"),
        ("1e999 m", "m", "not finite"),
        ("mm", "m", "not a quantity"),
        ("", "m", "not a quantity"),
        ("0,6 mm", "m", "not a quantity"),
        ("0.6 mm; import os", "m", "not a quantity"),
        ("nan m", "m", "not a quantity"),
        (None, "m", "not a quantity"),
        (0.6, "m", "not a quantity"),
    ],
)
def test_what_is_no_quantity_is_refused_in_one_line(text: object, unit: str, said: str) -> None:
    with pytest.raises(QuantityError, match=said) as caught:
        parse_quantity(text, unit)  # type: ignore[arg-type]
    assert "\n" not in str(caught.value)
    assert isinstance(caught.value, InputError)
    assert isinstance(caught.value, ValueError)


def test_a_list_takes_its_unit_from_the_next_that_has_one() -> None:
    assert parse_quantities("0.5, 1, 2 A", "A") == [0.5, 1.0, 2.0]
    assert parse_quantities("100, 200 um, 1 mm", "m") == pytest.approx([1e-4, 2e-4, 1e-3], rel=1e-14)


@pytest.mark.parametrize("text", ["", "1,,2 A", "1 A, 2", "1 A, 2 m"])
def test_a_list_with_a_hole_or_a_last_element_without_unit_is_refused(text: str) -> None:
    with pytest.raises(QuantityError):
        parse_quantities(text, "A")


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [(0.6e-3, "m", "600 µm"), (1e3, "Hz", "1 kHz"), (1e-3, "A", "1 mA"), (-5.0, "A", "-5 A"), (0.0, "m", "0 m")],
)
def test_texts_for_people(value: float, unit: str, text: str) -> None:
    assert format_quantity(value, unit) == text


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (0.01, "", "0.01"), (1234.5, "", "1234"), (-2e-9, "", "-2e-09"), (2e7, "", "2e+07"), (0.02, "%", "0.02 %"),
        (0.25, "kg", "0.25 kg"), (2e-4, "kg m^2", "0.0002 kg m^2"), (1e-5, "m^2", "1e-05 m^2"),
        (2e-3, "m^-1", "0.002 m^-1"), (4e3, "s^-1", "4000 s^-1"), (2e3, "1/s", "2000 1/s"), (0.5, "degC", "0.5 degC"),
        (2e6, "A/m^2", "2 MA/m^2"), (0.02, "m/s^2", "20 mm/s^2"), (4e-3, "N s/m", "4 mN s/m"), (2e-3, "ohm", "2 mohm"),
    ],
)  # fmt: skip
def test_what_bears_no_prefix_has_none(value: float, unit: str, text: str) -> None:
    """0.01 is not "10 m", 1e-5 m^2 is not "10 µm^2", and half a kilogram has a prefix already."""
    assert format_quantity(value, unit) == text


UNITS = ["m", "A", "Hz", "N", "V", "Wb", "T", "", "kg", "m^2", "m^-1", "s^-1", "A^-2", "m/s^2", "A/m^2", "kg m^2"]


@given(st.floats(min_value=1e-9, max_value=1e8), st.sampled_from(UNITS), st.booleans())
def test_a_formatted_quantity_parses_back(size: float, unit: str, negative: bool) -> None:
    value = -size if negative else size
    again = parse_quantity(format_quantity(value, unit, digits=17), unit)
    assert math.isclose(again, value, rel_tol=1e-15 * 4)


@pytest.mark.parametrize(
    ("text", "kelvin"),
    [("20 degC", 293.15), ("20 °C", 293.15), ("-10.5 degC", 262.65), ("293.15 K", 293.15), ("68 degF", 293.15)],
)
def test_temperatures_are_absolute(text: str, kelvin: float) -> None:
    assert parse_temperature(text) == pytest.approx(kelvin, rel=1e-12)


@pytest.mark.parametrize("text", ["20", "20 m", "-300 degC", "-1 K", "nan K", "warm", "", "20 degC m"])
def test_what_is_no_temperature(text: str) -> None:
    with pytest.raises(QuantityError):
        parse_temperature(text)


def test_a_unit_with_brackets_is_read_as_it_is_written() -> None:
    """The heat transfer of a requirement: what the program writes and suggests, it reads."""
    assert parse_quantity("10.0 W/(m^2 K)", "W/(m^2 K)") == 10.0
    assert parse_quantity("1 mW/(cm^2*K)", "W/(m^2 K)") == pytest.approx(10.0)
    for bad in ("1 W/(m^2 K", "1 ()", "1 m()()", "1 W/((((((((((", "1 (m"):
        with pytest.raises(QuantityError):
            parse_quantity(bad, "W/(m^2 K)")


@pytest.mark.parametrize("unit", ["m^9^9^9", "m^(9^9^9)", "m**9**9**9", "m ^ 9 ^9^9", "m^-9^9^9^9", "m^999", "m^2.5^9"])
def test_a_tower_of_powers_is_refused_before_it_is_computed(unit: str) -> None:
    """9^9^9 has 370 million digits: a unit in a file could stop the program for ever."""
    with pytest.raises(QuantityError, match="a power that no unit has"):
        parse_quantity(f"1 {unit}", "m")
    with pytest.raises(QuantityError, match="not a temperature"):
        parse_temperature(f"1 {unit}")


@pytest.mark.parametrize(("text", "unit"), [("1 m^2 s^-1", "m^2/s"), ("1 kg m**2", "kg m^2"), ("1 kg*m*s^-2", "N")])
def test_the_powers_of_units_stay(text: str, unit: str) -> None:
    assert parse_quantity(text, unit) == 1.0


def test_units_read_without_pint_are_those_of_pint() -> None:
    """The same number to the last bit."""
    for text, (factor, unit) in quantity.PLAIN.items():
        assert quantity._factor_by_pint(text, unit) == factor, text


@pytest.mark.parametrize(("text", "scale"), [("20 degC", "degC"), ("-10.5 degC", "degC"), ("293.15 K", "K")])
def test_temperatures_read_without_pint_are_those_of_pint(text: str, scale: str) -> None:
    """The same number to the last bit."""
    assert quantity._temperature_by_pint(text, float(text.split()[0]), scale) == parse_temperature(text)


def test_the_files_that_come_along_are_read_without_pint(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its import and its list of units take as long as all else of a command that begins with an actuator."""

    def registry() -> None:
        raise AssertionError("pint was asked")

    quantity._factor.cache_clear()
    monkeypatch.setattr(quantity, "_registry", registry)
    root = Path(__file__).parents[2]
    for file in sorted((root / "geometries").glob("*.toml")):
        assert load_actuator(file).name
    for file in sorted((root / "requirements").glob("*.toml")):
        assert load_requirement(file).name
