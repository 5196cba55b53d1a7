"""What is done with a law's tree: its values on arrays, its derivatives, its dimension."""

from collections.abc import Callable, Mapping
from fractions import Fraction
from typing import Any

import numpy as np

from msl_fem.computing.laws.grammar import Node, number
from msl_fem.computing.laws.units import NUMBER, Dimension
from msl_fem.errors import InputError

_VALUES: dict[str, Callable[..., Any]] = {
    "+": np.add, "-": np.subtract, "*": np.multiply, "/": np.divide, "**": np.power, "negative": np.negative,
    "abs": np.abs, "sign": np.sign, "sqrt": np.sqrt, "exp": np.exp, "log": np.log, "sin": np.sin, "cos": np.cos,
    "tanh": np.tanh, "min": np.minimum, "max": np.maximum,
}  # fmt: skip
_ZERO, _ONE = number(0.0), number(1.0)


def value_of(node: Node, values: Mapping[str, Any]) -> Any:
    """The law's value where its names have these values, numbers or arrays of one shape; nan outside its domain."""
    if node.kind == "number":
        return node.value
    if node.kind == "name":
        return values[node.name]
    with np.errstate(all="ignore"):
        return _VALUES[node.kind](*(value_of(one, values) for one in node.inner))


def replaced(node: Node, values: Mapping[str, float]) -> Node:
    """The law with numbers in place of some names, made shorter where it can be."""
    if node.kind == "name":
        return number(values[node.name]) if node.name in values else node
    if node.kind == "number":
        return node
    return simplified(Node(node.kind, tuple(replaced(one, values) for one in node.inner)))


def simplified(node: Node) -> Node:
    """The node with sums with 0, products with 0 and 1, and operations on numbers alone worked out."""
    if node.inner and all(one.kind == "number" for one in node.inner):
        value = float(value_of(node, {}))
        return number(value) if np.isfinite(value) else node
    if node.kind not in ("+", "-", "*", "/", "**"):
        return node
    left, right = node.inner
    if node.kind == "*" and _ZERO in (left, right):
        return _ZERO
    if node.kind == "/" and left == _ZERO:
        return _ZERO
    if node.kind == "+" and _ZERO in (left, right):
        return right if left == _ZERO else left
    if node.kind == "-" and left == _ZERO:
        return Node("negative", (right,))
    if node.kind == "*" and _ONE in (left, right):
        return right if left == _ONE else left
    if (node.kind == "-" and right == _ZERO) or (node.kind in ("/", "**") and right == _ONE):
        return left
    return node


def derivative(node: Node, name: str) -> Node:
    """The law's derivative with respect to a name; of abs, min and max at their kinks that of one side or the mean."""
    if node.kind == "name":
        return _ONE if node.name == name else _ZERO
    if name not in node.names:
        return _ZERO
    inner = [derivative(one, name) for one in node.inner]
    return _RULES[node.kind](node.inner, inner)


def _do(kind: str, *inner: Node) -> Node:
    return simplified(Node(kind, inner))


def _power(u: tuple[Node, ...], d: list[Node]) -> Node:
    exponent = u[1].value
    return _do("*", _do("*", u[1], _do("**", u[0], number(exponent - 1.0))), d[0])


def _quotient(u: tuple[Node, ...], d: list[Node]) -> Node:
    return _do("-", _do("/", d[0], u[1]), _do("/", _do("*", u[0], d[1]), _do("**", u[1], number(2.0))))


def _chosen(larger: bool) -> Callable[[tuple[Node, ...], list[Node]], Node]:
    def rule(u: tuple[Node, ...], d: list[Node]) -> Node:
        side = _do("sign", _do("-", u[0], u[1]) if larger else _do("-", u[1], u[0]))
        half = number(0.5)
        first = _do("*", _do("*", half, _do("+", _ONE, side)), d[0])
        return _do("+", first, _do("*", _do("*", half, _do("-", _ONE, side)), d[1]))

    return rule


_RULES: dict[str, Callable[[tuple[Node, ...], list[Node]], Node]] = {
    "+": lambda u, d: _do("+", d[0], d[1]),
    "-": lambda u, d: _do("-", d[0], d[1]),
    "*": lambda u, d: _do("+", _do("*", d[0], u[1]), _do("*", u[0], d[1])),
    "/": _quotient,
    "**": _power,
    "negative": lambda u, d: _do("negative", d[0]),
    "abs": lambda u, d: _do("*", _do("sign", u[0]), d[0]),
    "sign": lambda u, d: _ZERO,
    "sqrt": lambda u, d: _do("/", d[0], _do("*", number(2.0), _do("sqrt", u[0]))),
    "exp": lambda u, d: _do("*", _do("exp", u[0]), d[0]),
    "log": lambda u, d: _do("/", d[0], u[0]),
    "sin": lambda u, d: _do("*", _do("cos", u[0]), d[0]),
    "cos": lambda u, d: _do("negative", _do("*", _do("sin", u[0]), d[0])),
    "tanh": lambda u, d: _do("*", _do("-", _ONE, _do("**", _do("tanh", u[0]), number(2.0))), d[0]),
    "min": _chosen(larger=False),
    "max": _chosen(larger=True),
}


def dimension_of(node: Node, known: Mapping[str, Dimension]) -> Dimension:
    """The dimension of a law whose names have these dimensions.

    Raises
    ------
    InputError : a sum of unlike dimensions, a function of what is no pure number; names the part of the law
    """
    if node.kind == "number":
        return NUMBER
    if node.kind == "name":
        return known[node.name]
    inner = [dimension_of(one, known) for one in node.inner]
    if node.kind in ("+", "-", "min", "max"):
        if _ZERO in node.inner:  # nothing is nothing in any unit
            return inner[0] if node.inner[1] == _ZERO else inner[1]
        if inner[0] != inner[1]:
            raise InputError(
                f"'{node.text}' puts together '{node.inner[0].text}' in {inner[0].text} and '{node.inner[1].text}' in "
                f"{inner[1].text}; give parameters the units that make them alike"
            )
        return inner[0]
    if node.kind in ("negative", "abs"):
        return inner[0]
    if node.kind == "*":
        return inner[0].times(inner[1])
    if node.kind == "/":
        return inner[0].times(inner[1].power(Fraction(-1)))
    if node.kind == "sqrt":
        return inner[0].power(Fraction(1, 2))
    if node.kind == "**":
        return inner[0].power(Fraction(node.inner[1].value).limit_denominator(1000))
    if node.kind != "sign" and inner[0] != NUMBER:
        raise InputError(
            f"{node.kind} takes a pure number, '{node.inner[0].text}' is in {inner[0].text}; divide it by a parameter "
            "of that unit"
        )
    return NUMBER
