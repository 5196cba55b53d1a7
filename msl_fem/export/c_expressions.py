"""Expressions of compiled Python as C: the same operations in the same order."""

import ast
import math
from collections.abc import Callable, Mapping
from types import ModuleType
from typing import Any, Protocol

import numpy as np

from msl_fem.export.c_types import (
    ATOM,
    BITS,
    CHOICE,
    COMPARISON,
    CONJUNCTION,
    DISJUNCTION,
    FIXED,
    FLAG,
    PRODUCT,
    REAL,
    SUM,
    UNARY,
    WHOLE,
    Expression,
    Number,
    Pointer,
    PrintedFunction,
    PrintError,
    RecordType,
    Several,
    Values,
    constant,
    joined_type,
)


class FunctionPrinter(Protocol):
    """What prints a whole function, and keeps what several functions share."""

    def printed(self, function: Any, arguments: Mapping[str, Expression]) -> PrintedFunction: ...

    def named(self, name: str, value: float) -> Expression: ...

    def several(self, kind: Several) -> None: ...

    def array(self, values: Any, name: str) -> Expression: ...

    def unrolled(self, name: str) -> bool: ...


_SUMS = {ast.Add: "+", ast.Sub: "-"}
_ORDER: dict[type[ast.cmpop], str] = {
    ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!=",
}  # fmt: skip
_BY_VALUE: dict[str, Callable[..., Any]] = {
    "+": lambda a, b: a + b, "-": lambda a, b: a - b, "*": lambda a, b: a * b, "/": lambda a, b: a / b,
    "<": lambda a, b: a < b, "<=": lambda a, b: a <= b, ">": lambda a, b: a > b, ">=": lambda a, b: a >= b,
    "==": lambda a, b: a == b, "!=": lambda a, b: a != b, "//": lambda a, b: a // b, "%": lambda a, b: a % b,
}  # fmt: skip
_RESERVED = {
    "auto", "break", "case", "char", "const", "default", "do", "double", "enum", "extern", "float", "goto", "inline",
    "int", "long", "register", "restrict", "short", "signed", "sizeof", "static", "struct", "switch", "typedef",
    "union", "unsigned", "void", "volatile", "cos", "exp", "expm1", "fabs", "ldexp",
    "log", "logb", "rint", "sin", "sqrt",
}  # fmt: skip


class Expressions:
    """Prints the expressions of one function; `FunctionBody` adds the statements."""

    def __init__(self, printer: FunctionPrinter, python: Any, compiled: bool, arguments: Any) -> None:
        self._printer = printer
        self._python = python
        self._compiled = compiled
        self._parameters: dict[str, Expression] = {
            n: a if a.type == FIXED or a.known else Expression(a.type, self.c_name(n)) for n, a in arguments.items()
        }
        self.read: set[str] = set()
        self.writes: set[str] = set()
        self._rows_read: set[str] = set()  # in the present statement
        self._lazy = 0  # inside what C may not evaluate
        self._root: ast.AST | None = None  # the call that a statement is, or assigns

    @staticmethod
    def c_name(name: str) -> str:
        """A name of Python in C."""
        return f"{name}_" if name in _RESERVED else name

    def refuse(self, node: ast.AST, why: str = "") -> PrintError:
        line = self._python.__code__.co_firstlineno + getattr(node, "lineno", 1) - 1
        return PrintError(
            f"{self._python.__module__}.{self._python.__qualname__}, line {line}: {ast.unparse(node)!r} is not printed "
            f"as C{f' ({why})' if why else ''}; write it with numbers, rows, if, while, for range and compiled "
            "functions, or teach msl_fem.export.c_printer"
        )

    def local(self, node: ast.Name) -> Expression | None:
        raise NotImplementedError

    def kept(self, value: Expression) -> Expression:
        """The value of a call in a variable of its own, put before the present statement."""
        raise NotImplementedError

    def origin(self, text: str) -> str:
        """The rows of which a text names a part."""
        raise NotImplementedError

    def store(self, rows: Expression, place: str, value: Expression) -> None:
        """Writes a number into rows."""
        raise NotImplementedError

    def expression(self, node: ast.expr) -> Expression:
        """The node as C."""
        method = getattr(self, f"_{type(node).__name__.lower()}", None)
        if method is None:
            raise self.refuse(node)
        found: Expression = method(node)
        return found

    def number(self, node: ast.expr) -> Expression:
        """The node, which must be a number."""
        found = self.expression(node)
        if not isinstance(found.type, Number):
            raise self.refuse(node, "it is no number")
        return found

    def truth(self, node: ast.expr) -> Expression:
        """The node as a condition."""
        found = self.expression(node)
        if found.known:
            return constant(bool(found.constant))
        if found.type == REAL:
            return Expression(FLAG, f"{found.at(SUM)} != 0.0", level=COMPARISON)
        if not isinstance(found.type, Number):
            raise self.refuse(node, "it is no condition")
        return found

    def _constant(self, node: ast.Constant) -> Expression:
        if node.value is not None and not isinstance(node.value, bool | int | float | str):
            raise self.refuse(node)
        return constant(node.value)

    def _joinedstr(self, node: ast.JoinedStr) -> Expression:
        texts = [p.value if isinstance(p, ast.Constant) else self.expression(p.value).constant for p in node.values
                 if isinstance(p, ast.Constant | ast.FormattedValue)]  # fmt: skip
        return constant("".join(map(str, texts)))

    def _name(self, node: ast.Name) -> Expression:
        found = self.local(node)
        if found is not None:
            return found
        names = self._python.__globals__
        builtins = names["__builtins__"]
        known = builtins if isinstance(builtins, dict) else vars(builtins)
        if node.id not in names and node.id not in known:
            raise self.refuse(node, "the name is not known there")
        return self._of_python(node.id, names[node.id] if node.id in names else known[node.id])

    def _of_python(self, name: str, value: Any) -> Expression:
        if isinstance(value, int | float) and not isinstance(value, bool):
            return self._printer.named(name.strip("_"), value)
        return constant(value)

    def _attribute(self, node: ast.Attribute) -> Expression:
        base = self.expression(node.value)
        if base.type == FIXED and isinstance(base.constant, ModuleType):
            value = getattr(base.constant, node.attr)
            ours = base.constant.__name__.startswith("msl_fem.")
            prefix = base.constant.__name__.rpartition(".")[2].upper()
            return self._of_python(f"{prefix}_{node.attr.strip('_')}", value) if ours else constant(value)
        if base.type == FIXED and hasattr(base.constant, "_fields"):
            value = getattr(base.constant, node.attr)
            return self._printer.array(value, node.attr) if isinstance(value, np.ndarray) else constant(value)
        if isinstance(base.type, RecordType):
            return self._member(node, base)
        if isinstance(base.type, Pointer) and base.type.shape:
            if node.attr == "size":
                return constant(math.prod(base.type.shape))
            if node.attr == "shape":
                return constant(base.type.shape)
        raise self.refuse(node)

    def _member(self, node: ast.Attribute, base: Expression) -> Expression:
        assert isinstance(base.type, RecordType)
        found = base.type.member(node.attr)
        if found is None:
            raise self.refuse(node, f"{base.type.name} has no such field in C")
        kind, value = found
        text = f"{base.text}{'->' if base.pointer else '.'}{node.attr}"
        if value is None or kind == FIXED:
            return constant(value)
        if isinstance(kind, Number) and base.type.known and node.attr in dict(base.type.known):
            return constant(value)
        return Expression(kind, text, pointer=False)

    def _subscript(self, node: ast.Subscript) -> Expression:
        base = self.expression(node.value)
        if base.type == FIXED:
            index = self.expression(node.slice)
            if index.known or not (isinstance(node.value, ast.Name) and isinstance(base.constant, np.ndarray)):
                return constant(base.constant[index.constant])
            return self.element(node, self._printer.array(base.constant, node.value.id.lower()))
        if isinstance(base.type, Several):
            index = self.expression(node.slice)
            if not index.known:
                raise self.refuse(node, "which of several is not known")
            kind = base.type.parts[index.constant]
            return base.parts[index.constant] if base.parts else Expression(kind, f"{base.text}.a{index.constant}")
        if isinstance(base.type, Values):
            return self._of_effect(node, base)
        if not isinstance(base.type, Pointer):
            raise self.refuse(node)
        if isinstance(node.slice, ast.Slice):
            return self._part(node, node.slice, base)
        self._rows_read.add(self.origin(base.text))
        return self.element(node, base)

    def _part(self, node: ast.Subscript, part: ast.Slice, base: Expression) -> Expression:
        """Rows from one on, as many as the slice has."""
        low = self.number(part.lower) if part.lower else constant(0)
        high = self.number(part.upper) if part.upper else constant(base.type.shape[0] if base.type.shape else None)
        if not (low.known and high.known) or high.constant is None or low.constant < 0 or high.constant < 0:
            raise self.refuse(node, "how long it is is not known")
        shape = (high.constant - low.constant,)
        return Expression(Pointer(shape, base.type.fixed), f"{base.text} + {low.at(SUM)}", level=SUM)

    def _of_effect(self, node: ast.Subscript, base: Expression) -> Expression:
        assert isinstance(node.slice, ast.Tuple)
        effect, name = (self.expression(part).constant for part in node.slice.elts)
        index = base.type.index[effect, name]
        constant_name = f"{effect}_{name}".upper().replace(":", "_")
        return Expression(REAL, f"{base.text}[{self._printer.named(constant_name, index).text}]")

    def element(self, node: ast.Subscript, base: Expression) -> Expression:
        """A number of rows, or a part of an array."""
        nodes = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
        shape, text = base.type.shape, base.text
        for one in nodes:
            if isinstance(one, ast.Constant) and one.value is Ellipsis:
                continue
            index = self.number(one)
            if index.type == REAL:
                raise self.refuse(node, "an index is no whole number")
            if index.known and index.constant < 0:
                if not shape:
                    raise self.refuse(node, "how long it is is not known")
                index = constant(shape[0] + index.constant)
            text, shape = f"{text}[{index.text}]", shape[1:]
        return Expression(Pointer(shape, base.type.fixed), text) if shape else Expression(REAL, text)

    def _tuple(self, node: ast.Tuple) -> Expression:
        parts = tuple(self.expression(one) for one in node.elts)
        if all(p.type == FIXED for p in parts):
            return constant(tuple(p.constant for p in parts))
        return Expression(Several(tuple(p.type for p in parts)), "", parts=parts)

    def _unaryop(self, node: ast.UnaryOp) -> Expression:
        if isinstance(node.op, ast.Not):
            value = self.truth(node.operand)
            if value.known:
                return constant(not value.constant)
            return Expression(FLAG, f"!{value.at(UNARY)}", level=UNARY)
        value = self.number(node.operand)
        if isinstance(node.op, ast.USub):
            if value.known and value.text == constant(value.constant).text:
                return constant(-value.constant)
            known = {"constant": -value.constant} if value.known else {}
            return Expression(value.type, f"-{value.at(ATOM)}", level=UNARY, **known)
        raise self.refuse(node)

    def _binop(self, node: ast.BinOp) -> Expression:
        left, right = self.number(node.left), self.number(node.right)
        return self.operation(node, node.op, left, right)

    def operation(self, node: ast.AST, op: ast.operator, left: Expression, right: Expression) -> Expression:
        """Two numbers with an operator between."""
        kind = max(joined_type(left.type, right.type), WHOLE, key=lambda t: t.rank)
        if type(op) in _SUMS:
            sign = _SUMS[type(op)]
            return self._both(kind, f"{left.at(SUM)} {sign} {right.at(PRODUCT)}", sign, left, right, SUM)
        if isinstance(op, ast.Mult):
            return self._both(kind, f"{left.at(PRODUCT)} * {right.at(UNARY)}", "*", left, right, PRODUCT)
        if isinstance(op, ast.Div):
            above = left.at(PRODUCT) if kind == REAL else f"(double){left.at(ATOM)}"
            return self._both(REAL, f"{above} / {right.at(UNARY)}", "/", left, right, PRODUCT)
        if isinstance(op, ast.FloorDiv | ast.Mod) and kind == WHOLE:
            name, sign = ("quotient", "//") if isinstance(op, ast.FloorDiv) else ("rest", "%")
            return self._both(WHOLE, f"printed_{name}({left.text}, {right.text})", sign, left, right, ATOM)
        if isinstance(op, ast.Pow) and kind == REAL and right.known and right.constant == 2:
            if not self._compiled:
                raise self.refuse(node, "Python's own power rounds otherwise than a product; write the product")
            return Expression(REAL, f"printed_square({left.text})")
        if isinstance(op, ast.BitAnd) and left.type == right.type == FLAG:
            if left.known or right.known:
                one, other = (left, right) if left.known else (right, left)
                return other if one.constant else constant(False)
            return Expression(FLAG, f"{left.at(BITS) if left.level == BITS else left.at(UNARY)} & {right.at(UNARY)}",
                              level=BITS)  # fmt: skip
        raise self.refuse(node)

    @staticmethod
    def _both(kind: Any, text: str, sign: str, left: Expression, right: Expression, level: int) -> Expression:
        known = {}
        if left.known and right.known and not (sign in ("/", "//", "%") and right.constant == 0):
            known = {"constant": _BY_VALUE[sign](left.constant, right.constant)}
        return Expression(kind, text, level=level, **known)

    def _compare(self, node: ast.Compare) -> Expression:
        if isinstance(node.ops[0], ast.Is | ast.IsNot):
            return self._is_none(node)
        values = [self.number(one) for one in (node.left, *node.comparators)]
        parts = []
        for op, left, right in zip(node.ops, values, values[1:], strict=False):
            if type(op) not in _ORDER:
                raise self.refuse(node)
            sign = _ORDER[type(op)]
            parts.append(self._both(FLAG, f"{left.at(SUM)} {sign} {right.at(SUM)}", sign, left, right, COMPARISON))
        return self._joined(parts, "&&", CONJUNCTION)

    def _is_none(self, node: ast.Compare) -> Expression:
        value, wanted = self.expression(node.left), isinstance(node.ops[0], ast.Is)
        if value.type == FIXED:
            return constant((value.constant is None) == wanted)
        if isinstance(value.type, RecordType) and value.type.optional:
            there = f"{value.text}{'->' if value.pointer else '.'}there"
            return Expression(FLAG, f"!{there}" if wanted else there, level=UNARY)
        return constant(not wanted)

    def _boolop(self, node: ast.BoolOp) -> Expression:
        conjunction = isinstance(node.op, ast.And)
        parts = []
        for n, one in enumerate(node.values):
            self._lazy += n > 0
            value = self.truth(one)
            self._lazy -= n > 0
            if value.known and bool(value.constant) != conjunction:
                parts.append(value)
                break
            parts.append(value)
        if conjunction:
            return self._joined(parts, "&&", CONJUNCTION)
        return self._joined(parts, "||", DISJUNCTION)

    @staticmethod
    def _joined(parts: list[Expression], sign: str, level: int) -> Expression:
        """Conditions of which all, or one, must hold; those that are known decide or drop out."""
        deciding = sign == "||"
        left = [p for p in parts if not p.known]
        if any(p.known and bool(p.constant) == deciding for p in parts):
            return constant(deciding)
        if not left:
            return constant(not deciding)
        if len(left) == 1:
            return left[0]
        return Expression(FLAG, f" {sign} ".join(p.at(COMPARISON) for p in left), level=level)

    def _ifexp(self, node: ast.IfExp) -> Expression:
        test = self.truth(node.test)
        if test.known:
            return self.expression(node.body if test.constant else node.orelse)
        self._lazy += 1
        one, other = self.expression(node.body), self.expression(node.orelse)
        self._lazy -= 1
        if one.parts and len(one.parts) == len(other.parts):
            parts = tuple(self.choice(test, a, b) for a, b in zip(one.parts, other.parts, strict=True))
            return Expression(Several(tuple(p.type for p in parts)), "", parts=parts)
        if not (isinstance(one.type, Number) and isinstance(other.type, Number)):
            raise self.refuse(node, "it is no number")
        return self.choice(test, one, other)

    @staticmethod
    def choice(test: Expression, one: Expression, other: Expression) -> Expression:
        kind = joined_type(one.type, other.type)
        return Expression(kind, f"{test.at(DISJUNCTION)} ? {one.at(DISJUNCTION)} : {other.at(CHOICE)}", level=CHOICE)
