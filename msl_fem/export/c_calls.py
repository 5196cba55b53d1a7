"""Calls in compiled Python as C: of what `lanes` generates, of mathematics, of other compiled functions."""

import ast
import inspect
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from msl_fem.computing.compiled import Compiled
from msl_fem.export.c_expressions import Expressions
from msl_fem.export.c_types import (
    ATOM,
    COMPARISON,
    FIXED,
    FLAG,
    NOTHING,
    PRODUCT,
    REAL,
    SUM,
    UNARY,
    WHOLE,
    Expression,
    RecordType,
    constant,
)

_FUNCTIONS = {
    np.exp: "exp", np.cos: "cos", np.sin: "sin", np.sqrt: "sqrt", np.sign: "printed_sign", np.round: "rint",
    np.nextafter: "nextafter", math.exp: "exp", math.log: "log", math.expm1: "expm1", math.asinh: "asinh",
    math.cos: "cos", math.sin: "sin", math.sqrt: "sqrt", math.floor: "floor", np.floor: "floor", np.ceil: "ceil",
}  # fmt: skip
_GENERATED = {"size": "fabs", "square_root": "sqrt", "sine_of": "sin", "cosine_of": "cos", "exponent_of": "logb"}
_SAME = ("every", "some", "first", "rows_of")


class Calls(Expressions):
    """Adds calls to the expressions of a function."""

    def _call(self, node: ast.Call) -> Expression:
        function = self.expression(node.func)
        if function.type != FIXED:
            raise self.refuse(node)
        called = function.constant
        if type(called).__name__ == "_Generated":
            return self._generated(node, called._name)
        if called in (min, max, abs, int, float, np.isinf, math.isinf, np.isfinite) or _in(called, _FUNCTIONS):
            return self._of_library(node, called)
        if isinstance(called, Compiled) or hasattr(called, "__code__"):
            return self._own(node, called)
        raise self.refuse(node)

    def _generated(self, node: ast.Call, name: str) -> Expression:
        if name == "keep":
            return Expression(NOTHING, "")
        values = [self.expression(one) for one in node.args]
        if name in _SAME:
            return values[0]
        if name == "width":
            return constant(1)
        if name == "fma":
            return Expression(REAL, f"printed_fma({', '.join(v.text for v in values)})")
        if name == "power_of_two":
            return Expression(REAL, f"ldexp(1.0, (int){values[0].at(ATOM)})")
        if name in _GENERATED:
            known = {"constant": abs(values[0].constant)} if name == "size" and values[0].known else {}
            return Expression(REAL, f"{_GENERATED[name]}({values[0].text})", **known)
        if name == "choose":
            test = values[0]
            if test.known:
                return values[1] if test.constant else values[2]
            return self.choice(test, values[1], values[2])
        if name == "set_lane":
            self.store(values[0], f"{values[0].text}[{values[1].text}]", values[3])
            return Expression(NOTHING, "")
        if name == "lane_of":
            self._rows_read.add(self.origin(values[0].text))
            return Expression(REAL, f"{values[0].text}[{values[1].text}]")
        raise self.refuse(node)

    def _of_library(self, node: ast.Call, called: Any) -> Expression:
        values = [self.number(one) for one in node.args]
        texts = [v.text for v in values]
        if called in (np.isinf, math.isinf):
            if values[0].known:
                return constant(math.isinf(values[0].constant))
            return Expression(FLAG, f"isinf({texts[0]}) != 0", level=COMPARISON)
        if called is np.isfinite:
            return Expression(FLAG, f"{values[0].at(SUM)} - {values[0].at(PRODUCT)} == 0.0", level=COMPARISON)
        if called is int:
            return Expression(WHOLE, f"(int){values[0].at(ATOM)}", level=UNARY)
        if called is float:
            return values[0] if values[0].type == REAL else Expression(REAL, f"(double){values[0].at(ATOM)}",
                                                                     level=UNARY)  # fmt: skip
        if called is abs and values[0].type == REAL:
            return Expression(REAL, f"fabs({texts[0]})")
        if called in (min, max) and len(values) == 2:
            sign = "<" if called is min else ">"
            values = [self.kept(v) if "(" in v.text and not self._lazy else v for v in values]
            test = Expression(FLAG, f"{values[1].at(SUM)} {sign} {values[0].at(SUM)}", level=COMPARISON)
            return self.choice(test, values[1], values[0])
        if _in(called, _FUNCTIONS):
            return Expression(REAL, f"{_FUNCTIONS[called]}({', '.join(texts)})")
        raise self.refuse(node)

    def _own(self, node: ast.Call, called: Any) -> Expression:
        """A call of a function that is printed too."""
        if any(isinstance(one, ast.Starred) for one in node.args):
            raise self.refuse(node)
        before = set(self._rows_read)
        given = [self.expression(one) for one in node.args]
        named = {k.arg: self.expression(k.value) for k in node.keywords if k.arg is not None}
        arguments = bound(getattr(called, "py_func", called), given, named)
        printed = self._printer.printed(called, arguments)
        texts = [self._passed(arguments[n]) for n, kind in printed.parameters]
        if printed.result == FIXED:
            return constant(printed.value)
        written = {self.origin(arguments[n].text) for n in printed.writes}
        self.writes |= {n for n, p in self._parameters.items() if p.type != FIXED and p.text in written}
        value = Expression(printed.result, f"{printed.name}({', '.join(texts)})")
        if written & before:
            raise self.refuse(node, "it changes rows that were read before in the same statement")
        alone = node is self._root or self._lazy or printed.result == NOTHING
        return value if alone or not written else self.kept(value)

    def _passed(self, value: Expression) -> str:
        if isinstance(value.type, RecordType) and not value.pointer:
            return f"&{value.text}"
        return self.kept(value).text if value.parts else value.text


def _in(value: Any, table: dict[Any, str]) -> bool:
    try:
        return value in table
    except TypeError:
        return False


def bound(python: Any, given: Sequence[Expression], named: Mapping[str, Expression]) -> dict[str, Expression]:
    """The arguments of a call by the names of the parameters, defaults among them."""
    whole = inspect.signature(python).bind(*given, **named)
    whole.apply_defaults()
    return {n: v if isinstance(v, Expression) else constant(v) for n, v in whole.arguments.items()}
