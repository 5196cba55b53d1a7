"""A user's cause: a law that adds to the force, to a side's voltage or to the position reading, with its parameters.

    drag: force = -a*v*abs(v); a: 0..1 N s2/m2

A parameter is stated by its range, "0..1 N s2/m2", by its value and range, "0.4 in 0..1 N s2/m2", or by its value.
"""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

from msl_fem.computing.laws.calculus import dimension_of, replaced
from msl_fem.computing.laws.grammar import CONSTANTS, FUNCTIONS, Node, number, parse_law
from msl_fem.computing.laws.units import Dimension, parse_unit
from msl_fem.errors import InputError

_OF_THE_PLANT = {"x": "m", "v": "m/s", "i1": "A", "i2": "A", "g1": "m", "g2": "m"}
VARIABLES: dict[str, dict[str, str]] = {
    "force": _OF_THE_PLANT,
    "voltage": {"i": "A", "g": "m", "x": "m", "v": "m/s"},
    "position_reading": _OF_THE_PLANT,
}
"""What a law of each equation may look at, and in which unit: position, velocity, currents of the coils, gaps; for
`voltage` current and gap of the side that it is taken for."""
UNIT_OF = {"force": "N", "voltage": "V", "position_reading": "m"}
MOST_PARAMETERS = 16
_NAME = re.compile(r"[a-z][a-z0-9_]{0,30}")
_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,3})?"
_SPANNED = rf"({_NUMBER})\s*\.\.\s*({_NUMBER})\s*(.*?)\s*"
_FORMS = {
    "range": re.compile(rf"\s*{_SPANNED}"),
    "value and range": re.compile(rf"\s*({_NUMBER})\s+in\s+{_SPANNED}"),
    "value": re.compile(rf"\s*({_NUMBER})(?!\s*\.\.|\s+in\b)\s*(.*?)\s*"),
}


@dataclass(frozen=True)
class LawParameter:
    """A parameter of a law in SI units.

    Attributes
    ----------
    unit : without prefixes, as files write it
    low, high : its range
    value : stated; None: its neutral value until it is fitted
    amount : at 0 it switches the law off, alone or together with the other amounts; else it is a shape
    """

    name: str
    unit: str
    dimension: Dimension
    low: float
    high: float
    value: float | None = None
    amount: bool = False

    @property
    def text(self) -> str:
        """As an expression states it."""
        unit = f" {self.unit}" if self.unit else ""
        if self.low == self.high:
            return f"{self.low!r}{unit}"
        stated = "" if self.value is None else f"{self.value!r} in "
        return f"{stated}{self.low!r}..{self.high!r}{unit}"


@dataclass(frozen=True)
class LawExpression:
    """A user's cause.

    Attributes
    ----------
    equation : what its law adds to: "force", "voltage", "position_reading"
    law : the checked tree, in SI units
    text : of the law, as it was written
    """

    name: str
    equation: str
    law: Node
    text: str
    parameters: tuple[LawParameter, ...]

    @property
    def effect(self) -> str:
        """Its name in the catalogue and in files."""
        return f"expression:{self.name}"

    @property
    def stated(self) -> dict[str, float]:
        """The parameters whose values are stated."""
        return {p.name: p.value for p in self.parameters if p.value is not None}

    @property
    def bare(self) -> "LawExpression":
        """Without stated values: what the catalogue keeps."""
        return replace(self, parameters=tuple(replace(p, value=None) for p in self.parameters))

    def with_values(self, values: Mapping[str, float]) -> "LawExpression":
        """With these values stated."""
        stated = (replace(p, value=values.get(p.name, p.value)) for p in self.parameters)
        return replace(self, parameters=tuple(stated))

    @property
    def needed_values(self) -> dict[str, float]:
        """The values with which it is there.

        Raises
        ------
        InputError : an amount has none
        """
        for p in self.parameters:
            if p.amount and p.value is None:
                raise InputError(f"{self.name}: {p.name} has no value here; write '{p.name}: VALUE in {p.text}'")
        return self.stated

    @property
    def variables(self) -> frozenset[str]:
        """What of the plant its law looks at."""
        return self.law.names & VARIABLES[self.equation].keys()

    def to_toml(self) -> dict[str, Any]:
        """As `[[effects.expression]]` states it."""
        parameters = {p.name: p.text for p in self.parameters}
        return {"name": self.name, "equation": self.equation, "law": self.text, "parameters": parameters}


def parse_expression(text: str) -> LawExpression:
    """The cause of a text "NAME: EQUATION = LAW; PARAMETER: RANGE UNIT; ...".

    Raises
    ------
    InputError : it is none; names the part that is wrong and what is allowed
    """
    head, *rest = text.split(";")
    name, colon, formula = head.partition(":")
    equation, equals, law = formula.partition("=")
    if not colon or not equals:
        raise InputError(
            f"'{text}' is no cause; write it like \"drag: force = -a*v*abs(v); a: 0..1 N s2/m2\", or name a TOML file"
        )
    parameters: dict[str, str] = {}
    for part in rest:
        if not part.strip():
            continue
        key, colon, spec = part.partition(":")
        if not colon:
            raise InputError(f"{name.strip()}: '{part.strip()}' is no parameter; write 'a: 0..1 N s2/m2'")
        if key.strip() in parameters:
            raise InputError(f"{name.strip()}: the parameter {key.strip()} is there twice")
        parameters[key.strip()] = spec
    return expression(name.strip(), equation.strip(), law.strip(), parameters)


def expression_of_toml(content: object, *, where: str) -> LawExpression:
    """The cause of an entry of `[[effects.expression]]`; `where` is the entry's place for messages.

    Raises
    ------
    InputError : a key is missing or unknown, or the entry is no cause; names the place
    """
    keys = ("name", "equation", "law", "parameters")
    if not isinstance(content, Mapping):
        raise InputError(f"{where}: is no table; write [[effects.expression]] before it")
    for key in content:
        if key not in keys:
            raise InputError(f"{where}.{key}: unknown key; there are {', '.join(keys)}")
    for key in keys[:3]:
        if not isinstance(content.get(key), str):
            raise InputError(f'{where}.{key}: is missing or no text; write it like law = "-a*v*abs(v)"')
    parameters = content.get("parameters", {})
    if not isinstance(parameters, Mapping) or not all(isinstance(v, str) for v in parameters.values()):
        raise InputError(f'{where}.parameters: write it like parameters = {{ a = "0..1 N s2/m2" }}')
    try:
        return expression(content["name"], content["equation"], content["law"], dict(parameters))
    except InputError as err:
        raise InputError(f"{where}: {err}") from err


def expression(name: str, equation: str, law: str, parameters: Mapping[str, str]) -> LawExpression:
    """The cause of that name, checked.

    Raises
    ------
    InputError : a name, an equation, a law or a parameter that is not allowed, wrong units, a law that does not vanish
        where its amounts are 0
    """
    if not _NAME.fullmatch(name):
        raise InputError(
            f"'{name}' is no name of a cause; take small letters, digits and _, a letter first, at most 31"
        )
    if equation not in VARIABLES:
        raise InputError(f"{name}: '{equation}' is no equation; there are {', '.join(VARIABLES)}")
    if len(parameters) > MOST_PARAMETERS:
        raise InputError(f"{name}: has {len(parameters)} parameters; at most {MOST_PARAMETERS} are taken")
    try:
        found = [_parameter(key, spec, equation) for key, spec in parameters.items()]
        tree = parse_law(law, frozenset(VARIABLES[equation]) | parameters.keys())
        _check_units(tree, equation, found)
    except InputError as err:
        raise InputError(f"{name}: {err}") from err
    for one in found:
        if one.name not in tree.names:
            raise InputError(f"{name}: the law has no {one.name}; leave the parameter out")
    return LawExpression(name, equation, tree, law, _with_amounts(name, tree, found))


def _parameter(name: str, spec: str, equation: str) -> LawParameter:
    taken = {*VARIABLES[equation], *FUNCTIONS, *CONSTANTS}
    if not _NAME.fullmatch(name) or name in taken:
        raise InputError(f"'{name}' cannot be a parameter's name; take small letters, and none of {', '.join(taken)}")
    form, numbers, unit_text = _read(name, spec)
    unit = parse_unit(unit_text)
    sizes = [float(text) * unit.factor for text in numbers]
    stated = None if form == "range" else sizes[0]
    first, last = sizes[-2:] if len(sizes) > 1 else sorted((0.0, sizes[0]))
    if not (math.isfinite(first) and math.isfinite(last) and first < last):
        raise InputError(f"{name}: the range {first:g}..{last:g} {unit.text} must go from a smaller to a larger number")
    if stated is not None and not first <= stated <= last:
        raise InputError(f"{name}: {stated:g} {unit.text} is not allowed; it must be {first:g}..{last:g} {unit.text}")
    return LawParameter(name, unit.text, unit.dimension, first, last, stated)


def _read(name: str, spec: str) -> tuple[str, tuple[str, ...], str]:
    """(form, numbers, unit) of a parameter's text."""
    for form, pattern in _FORMS.items():
        match = pattern.fullmatch(spec)
        if match:
            return form, match.groups()[:-1], match.groups()[-1]
    raise InputError(
        f"'{name}: {spec.strip()}' is no parameter; write a range '{name}: 0..1 N s2/m2', or a value and its range "
        f"'{name}: 0.4 in 0..1 N s2/m2'"
    )


def _check_units(tree: Node, equation: str, parameters: list[LawParameter]) -> None:
    known = {name: parse_unit(unit).dimension for name, unit in VARIABLES[equation].items()}
    known |= {p.name: p.dimension for p in parameters}
    found, needed = dimension_of(tree, known), parse_unit(UNIT_OF[equation]).dimension
    if found != needed and tree != number(0.0):
        raise InputError(
            f"the law is in {found.text}, {equation} is in {UNIT_OF[equation]} ({needed.text}); a factor in "
            f"{needed.times(found.power(Fraction(-1))).text} is missing from a parameter"
        )


def _with_amounts(name: str, tree: Node, parameters: list[LawParameter]) -> tuple[LawParameter, ...]:
    """The parameters, told amounts from shapes: amounts are those that it takes to switch the law off."""
    amounts = [p.name for p in parameters if p.low <= 0.0 <= p.high]
    if replaced(tree, dict.fromkeys(amounts, 0.0)) != number(0.0):
        words = " and ".join(amounts) or "any parameter whose range holds 0"
        raise InputError(
            f"{name}: the law does not vanish without {words}; multiply each term by an amount, whose range holds 0"
        )
    for one in reversed(amounts[:]):
        rest = [other for other in amounts if other != one]
        if replaced(tree, dict.fromkeys(rest, 0.0)) == number(0.0):
            amounts = rest
    told = []
    for p in parameters:
        if p.name not in amounts and p.value is not None and 0.0 in (p.low, p.high) and p.value in (p.low, p.high):
            p = replace(p, low=p.value, high=p.value)  # stated alone: a constant
        if p.name not in amounts and p.low <= 0.0 and p.low != p.high:
            raise InputError(
                f"{name}: {p.name} says how, not how much ({' and '.join(amounts)} switch the law off); its range "
                f"{p.low:g}..{p.high:g} must lie above 0"
            )
        told.append(replace(p, amount=p.name in amounts))
    return tuple(told)
