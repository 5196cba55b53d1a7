"""A user's law: what is read, what is refused, its units, and its derivatives against complex steps."""

import ast
from fractions import Fraction
from types import SimpleNamespace

import numpy as np
import pytest

from msl_fem.computing.laws import LawExpression, causes_of, expression_of_toml, parse_expression, reading
from msl_fem.computing.laws.calculus import derivative, value_of
from msl_fem.computing.laws.grammar import parse_law
from msl_fem.computing.laws.units import parse_unit
from msl_fem.errors import InputError

DRAG = "drag: force = -a*v*abs(v); a: 0..1 N s2/m2"
NAMES = frozenset({"a", "x", "v"})
AT = {"a": 0.7, "x": 0.31, "v": -1.3}


def test_a_cause_is_read_whole() -> None:
    drag = parse_expression(DRAG)
    (a,) = drag.parameters
    assert (drag.effect, drag.equation, drag.text) == ("expression:drag", "force", "-a*v*abs(v)")
    assert (a.name, a.unit, a.low, a.high, a.value, a.amount) == ("a", "N s^2/m^2", 0.0, 1.0, None, True)
    assert value_of(drag.law, {"a": 0.5, "v": np.array([-2.0, 3.0])}) == pytest.approx([2.0, -4.5])
    assert expression_of_toml(drag.to_toml(), where="here") == drag


def test_units_prefixes_values_and_shapes() -> None:
    cause = parse_expression("cogging: force = a*sin(2*pi*x/p + q); a: -2..2 mN; p: 0.1..2 mm; q: 0.3")
    a, p, q = cause.parameters
    assert (a.low, a.high, a.unit, a.amount) == (-2e-3, 2e-3, "N", True)
    assert (p.low, p.high, p.amount) == (1e-4, 2e-3, False)
    assert (q.low, q.high, q.value) == (0.3, 0.3, 0.3)  # a constant
    stated = parse_expression("drag: force = -a*v*abs(v); a: 0.4 in 0..1 N s2/m2")
    assert stated.needed_values == {"a": 0.4}
    assert stated.bare == parse_expression(DRAG)
    with pytest.raises(InputError, match=r"drag: a has no value here; write 'a: VALUE in 0\.0\.\.1\.0 N"):
        _ = parse_expression(DRAG).needed_values


@pytest.mark.parametrize(
    ("text", "factor", "exponents"),
    [
        ("N s2/m2", 1.0, (1, -1, 0, 0, 0)),
        ("N s^2/m^2", 1.0, (1, -1, 0, 0, 0)),
        ("mm", 1e-3, (0, 1, 0, 0, 0)),
        ("1/ms", 1e3, (0, 0, -1, 0, 0)),
        ("kN/mm2", 1e9, (1, -1, -2, 0, 0)),
        ("s-1", 1.0, (0, 0, -1, 0, 0)),
        ("g", 1e-3, (1, 0, 0, 0, 0)),
        ("V/A", 1.0, (1, 2, -3, -2, 0)),
        ("%", 0.01, (0, 0, 0, 0, 0)),
        ("", 1.0, (0, 0, 0, 0, 0)),
    ],
)
def test_units(text: str, factor: float, exponents: tuple[int, ...]) -> None:
    unit = parse_unit(text)
    assert unit.factor == pytest.approx(factor, rel=1e-15)
    assert unit.dimension.exponents == tuple(Fraction(e) for e in exponents)
    assert parse_unit(unit.text) == unit._replace(factor=1.0)


MALICIOUS = {
    "__import__('os').system('true')": "allowed functions are abs",
    "__import__('os')": "allowed functions are abs",
    "x.__class__.__mro__": "'x.__class__.__mro__' is not allowed",
    "a*x.real": "'x.real' is not allowed",
    "().__class__": "is not allowed in a law",
    "eval('1')": "'eval' is not allowed",
    "(lambda: x)()": "is not allowed",
    "[x for x in (1, 2)]": "is not allowed",
    "a if x else v": "is not allowed",
    "x @ x": "'x @ x' is not allowed",
    "x or v": "'x or v' is not allowed",
    "(a := x)": "is not allowed",
    "f'{x}'": "is not allowed",
    "a['x']": "is not allowed",
    "a*True": "'True' is not allowed",
    "'x'*9": "allowed are numbers like",
    "1j*x": "allowed are numbers like",
    "9**9**9": "a power must be a number from -8 to 8",
    "x**1e9": "a power must be a number",
    "x**v": "a power must be a number",
    "1e999*x": "a number must be finite",
    "9" * 400 + "*x": "a number must be finite",
    "(" * 200 + "x" + ")" * 200: "brackets in one another",
    "-" * 300 + "x": "operations in one another",
    "+".join(["x"] * 60): "operations in one another",
    "x+" * 400 + "x": "at most 500 are read",
    "x; import os": "no formula",
    "x\nimport os": "no formula",
    "sin(x, v)": "sin takes 1 value",
    "sin(*x)": "is not allowed",
    "sin(x=1)": "sin takes 1 value",
    "sin": "it is a function; write sin",
    "z*x": "allowed are a, v, x and pi",
    "": "no formula",
}


@pytest.mark.parametrize("text", MALICIOUS)
def test_what_is_no_formula_is_refused(text: str) -> None:
    with pytest.raises(InputError) as caught:
        parse_law(text, NAMES)
    assert MALICIOUS[text] in str(caught.value)
    assert len(str(caught.value)) < 300


def test_nothing_of_a_text_is_run(monkeypatch: pytest.MonkeyPatch) -> None:
    """What Python would run has no way in: the text is parsed and never compiled."""
    import builtins

    def never(*_: object, **__: object) -> None:
        raise AssertionError("run")

    parse = ast.parse
    monkeypatch.setattr(ast, "parse", lambda text, mode: parse(text, mode=mode))
    monkeypatch.setattr(builtins, "eval", never)
    monkeypatch.setattr(builtins, "exec", never)
    assert parse_law("a*x", NAMES).text == "(a * x)"


@pytest.mark.parametrize(
    "text",
    [
        "-a*v*abs(v)",
        "a*x**3 - v/(1 + x**2)",
        "a*sin(3*x + 1)*cos(v) + exp(-x/a)",
        "a*tanh(x/0.2)*sqrt(1 + v**2) + log(2 + x*v)",
        "min(a*x, v**2) + max(a, x) - x**-2 + a**0.5",
        "a*sign(v)*x**1.5",
    ],
)
def test_derivatives_are_those_of_differences(text: str) -> None:
    law, h = parse_law(text, NAMES), 1e-6
    for name in NAMES:
        up, down = (value_of(law, AT | {name: AT[name] + s * h}) for s in (1, -1))
        assert value_of(derivative(law, name), AT) == pytest.approx((up - down) / (2 * h), rel=1e-8, abs=1e-8)


def test_a_derivative_s_error_goes_with_the_step_squared() -> None:
    """Taylor: what is left of a law beside value and slope is of second order."""
    law = parse_law("a*tanh(x/0.2)*sqrt(1 + v**2) + exp(-x)", NAMES)
    value, slope = value_of(law, AT), value_of(derivative(law, "x"), AT)
    rest = [abs(value_of(law, AT | {"x": AT["x"] + h}) - value - h * slope) for h in (1e-2, 5e-3, 2.5e-3)]
    assert np.log2(rest[0] / rest[1]) == pytest.approx(2.0, abs=0.05)
    assert np.log2(rest[1] / rest[2]) == pytest.approx(2.0, abs=0.03)


def test_nothing_is_of_any_unit() -> None:
    one_way = parse_expression("one_way: force = -a*max(v, 0) + a*min(0, v)/2; a: 0..1 N s/m")
    assert value_of(one_way.law, {"a": 2.0, "v": np.array([-4.0, 4.0])}) == pytest.approx([-4.0, -8.0])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("b: force = a*max(x, 1); a: 0..1 N/m", "puts together 'x' in m and '1.0' in 1"),
        ("b: force = a*x; a: 0..1 N", "a factor in m^-1 is missing"),
        ("b: force = a*x + v; a: 0..1 N/m", "puts together '(a * x)' in kg m s^-2 and 'v' in m s^-1"),
        ("b: force = a*exp(x); a: 0..1 N", "exp takes a pure number, 'x' is in m"),
        ("b: torque = a*x; a: 0..1 N/m", "'torque' is no equation; there are force, voltage, position_reading"),
        ("b: voltage = a*i1; a: 0..1 ohm", "'i1' is not allowed in a law; allowed are a, g, i, v, x and pi"),
        ("B: force = a*x; a: 0..1 N/m", "'B' is no name of a cause"),
        ("b: force = a*x; a: 1..2 N/m", "does not vanish without any parameter whose range holds 0"),
        ("b: force = a*x + k*x; a: 0..1 N/m; k: 1..2 N/m", "does not vanish without a"),
        ("b: force = a*(x-c)**3; a: 0..1 N/m3; c: -1..1 mm", "c says how, not how much (a switch the law off)"),
        ("b: force = a*x; a: 0..1 N/mx", "'mx' in the unit 'N/mx' is no unit"),
        ("b: force = a*x; a: 2 in 0..1 N/m", "2 N/m is not allowed; it must be 0..1 N/m"),
        ("b: force = a*x; a: 1..0 N/m", "must go from a smaller to a larger number"),
        ("b: force = a*x; a: much", "'a: much' is no parameter"),
        ("b: force = a*x; a: 0..1 N/m; a: 0..2 N/m", "a is there twice"),
        ("b: force = a*x; a: 0..1 N/m; c: 0..1 N", "the law has no c"),
        ("b: force = a*x; sin: 0..1 N/m", "'sin' cannot be a parameter's name"),
        ("b: force", "is no cause; write it like"),
    ],
)
def test_errors_name_the_part_and_the_way_out(text: str, said: str) -> None:
    with pytest.raises(InputError) as caught:
        parse_expression(text)
    assert said in str(caught.value)


def test_causes_from_files_and_entry_points(tmp_path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "effects.toml"
    file.write_text(
        '[[effects.expression]]\nname = "drag"\nequation = "force"\nlaw = "-a*v*abs(v)"\n'
        'parameters = { a = "0..1 N s2/m2" }\n'
    )
    drag = parse_expression(DRAG)
    assert causes_of(str(file)) == (drag,)
    given = {"texts": [DRAG, drag], "broken": 3}
    points = [SimpleNamespace(name=name, load=lambda name=name: given[name]) for name in given]
    monkeypatch.setattr(reading, "entry_points", lambda group: points if group == "msl_fem.effects" else [])
    found = causes_of("texts")
    assert found == (drag, drag)
    assert all(isinstance(one, LawExpression) for one in found)
    with pytest.raises(InputError, match=r"gives a int; give texts or LawExpressions"):
        causes_of("broken")
    with pytest.raises(InputError, match=r"'nothing' is no cause: .*installed are broken, texts"):
        causes_of("nothing")
    file.write_text('[[effects.expression]]\nname = "drag"\nequation = "force"\nlaws = "x"\n')
    with pytest.raises(InputError, match=r"effects.expression.0.laws: unknown key; there are name, equation"):
        causes_of(str(file))
