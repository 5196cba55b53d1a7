"""Assignments of compiled Python as C: names and where they are declared, several at once, rows and parts of them."""

import ast
import re
from collections.abc import Mapping
from typing import Any

from msl_fem.export.c_calls import Calls
from msl_fem.export.c_expressions import FunctionPrinter
from msl_fem.export.c_types import (
    FIXED,
    FLAG,
    REAL,
    WHOLE,
    Expression,
    Number,
    Pointer,
    Several,
    c_type_of,
    constant,
    joined_type,
)

Path = tuple[int, ...]
"""The blocks within which a line stands."""


class Assignments(Calls):
    """Adds assignments to the expressions of a function."""

    def __init__(
        self, printer: FunctionPrinter, python: Any, compiled: bool, arguments: Mapping[str, Expression]
    ) -> None:
        super().__init__(printer, python, compiled, arguments)
        self._types: dict[str, Any] = {}
        self._counts: dict[str, int] = {}  # how often names are assigned to
        self._places: dict[str, list[Path]] = {}  # where they occur
        self._plan: dict[str, Path] = {}  # where they are declared
        self._known: dict[str, Expression] = {}
        self._origins: dict[str, str] = {}
        self._stores: dict[str, int] = {}
        self._needed: set[str] = set()
        self._declared: set[str] = set()
        self._hoisted: list[str] = []
        self._lines: list[str] = []
        self._path: Path = ()
        self._temporaries = 0
        self._final = False

    def local(self, node: ast.Name) -> Expression | None:
        name = node.id
        if name in self._known:
            return self._known[name]
        if name in self._types:
            self.read.add(name)
            self._places.setdefault(name, []).append(self._path)
            return Expression(self._types[name], self.c_name(name))
        if name in self._parameters:
            self.read.add(name)
            return self._parameters[name]
        return None

    def kept(self, value: Expression) -> Expression:
        self._temporaries += 1
        name = f"value_{self._temporaries}_"
        self._line(f"const {value.type.declared(name)} = {self._initial(value)};")
        return Expression(value.type, name)

    def _initial(self, value: Expression) -> str:
        """What a declaration sets: several in braces."""
        if not value.parts:
            return value.text
        assert isinstance(value.type, Several)
        self._printer.several(value.type)
        return f"{{{', '.join(self._initial(p) for p in value.parts)}}}"

    def origin(self, text: str) -> str:
        """The rows of which a text names a part."""
        base = re.match(r"\w*", text)[0]  # type: ignore[index]
        return self._origins.get(base, base)

    def store(self, rows: Expression, place: str, value: Expression) -> None:
        base = self.origin(rows.text)
        self.writes |= {n for n, p in self._parameters.items() if p.type != FIXED and p.text == base}
        self._line(f"{place} = {value.text};")

    def _line(self, text: str) -> None:
        self._lines.append("    " * (len(self._path) + 1) + text)

    def _assign(self, target: ast.expr, value: Expression) -> None:
        if isinstance(target, ast.Name):
            self._to_name(target, value)
        elif isinstance(target, ast.Tuple):
            self._to_several(target, value)
        elif isinstance(target, ast.Subscript):
            self._to_rows(target, value)
        else:
            raise self.refuse(target)

    def _to_name(self, target: ast.Name, value: Expression) -> None:
        name = target.id
        if value.type == FIXED or (value.known and value.type in (FLAG, WHOLE) and self._counts[name] == 1):
            if self._counts[name] > 1:
                raise self.refuse(target, "it is no number, and changes")
            self._known[name] = value
            return
        if isinstance(value.type, Pointer):
            self._origins[self.c_name(name)] = self.origin(value.text)
        if isinstance(value.type, Several) and value.parts:
            value = self.kept(value)
        if name in self._parameters:
            self._own_parameter(target, value)
            return
        self._types[name] = joined_type(self._types.get(name), value.type)
        self._places.setdefault(name, []).append(self._path)
        if self._final and name not in self._needed:
            if "(" in value.text and value.text.endswith(")") and "_" in value.text.split("(")[0]:
                self._line(f"(void){value.text};")
            return
        self._stores[name] = self._stores.get(name, 0) + 1
        self._line(f"{self._declaration(name)} = {value.text};")

    def _own_parameter(self, target: ast.Name, value: Expression) -> None:
        parameter = self._parameters[target.id]
        if not isinstance(parameter.type, Number) or joined_type(parameter.type, value.type) != parameter.type:
            raise self.refuse(target, "a parameter becomes another kind of thing")
        self._line(f"{parameter.text} = {value.text};")

    def _declaration(self, name: str) -> str:
        """The name, with its type where it is declared."""
        text = self.c_name(name)
        if not self._final or name in self._declared:
            return text
        self._declared.add(name)
        kind = self._types[name]
        if self._places[name] == [self._path] and self._plan[name] == self._path:
            return str(kind.declared(text))
        nothing = "{0}" if isinstance(kind, Several) else "0" if kind != REAL else "0.0"
        self._hoisted.append(f"    {kind.declared(text)} = {nothing};")
        return text

    def _to_several(self, target: ast.Tuple, value: Expression) -> None:
        if value.type == FIXED:
            value = Expression(Several(tuple(c_type_of(c) for c in value.constant)), "",
                               parts=tuple(constant(c) for c in value.constant))  # fmt: skip
        if not isinstance(value.type, Several) or len(value.type.parts) != len(target.elts):
            raise self.refuse(target, "it is not as many")
        if not value.parts:
            if not value.text.isidentifier():
                value = self.kept(value)
            parts = [Expression(kind, f"{value.text}.a{n}") for n, kind in enumerate(value.type.parts)]
        else:
            parts = self._apart(target, value)
        for one, part in zip(target.elts, parts, strict=True):
            self._assign(one, part)

    def _apart(self, target: ast.Tuple, value: Expression) -> list[Expression]:
        """The parts; those that a target before them would change are kept first."""
        changed: list[str] = []
        found = []
        for one, part in zip(target.elts, value.parts, strict=True):
            clash = not part.known and any(_has_word(part.text, word) for word in changed)
            found.append(self.kept(part) if clash else part)
            names = [n for n in ast.walk(one) if isinstance(n, ast.Name)]
            changed += [self.c_name(n.id) for n in names[:1]]
        return found

    def _to_rows(self, target: ast.Subscript, value: Expression) -> None:
        base = self.expression(target.value)
        if not isinstance(base.type, Pointer) or base.type.fixed:
            raise self.refuse(target, "it is not to be written to")
        if isinstance(target.slice, ast.Slice):
            self._to_part(target, base, value)
            return
        place = self.element(target, base)
        if place.type != REAL or not isinstance(value.type, Number):
            raise self.refuse(target, "numbers go into rows one by one")
        self.store(base, place.text, value)

    def _to_part(self, target: ast.Subscript, base: Expression, value: Expression) -> None:
        """A slice: one number into all of it, or several numbers one by one."""
        assert isinstance(target.slice, ast.Slice)
        low = self.number(target.slice.lower) if target.slice.lower else constant(0)
        if isinstance(value.type, Several):
            if not value.parts:
                value = self.kept(value)
            for n in range(len(value.type.parts)):
                part = value.parts[n].text if value.parts else f"{value.text}.a{n}"
                self.store(base, f"{base.text}[{low.text} + {n}]", Expression(REAL, part))
            return
        high = self.number(target.slice.upper) if target.slice.upper else constant(base.type.shape[0])
        if low.known and high.known and high.constant <= low.constant:
            return
        if isinstance(value.type, Pointer):
            value = Expression(REAL, f"{value.text}[n_]")
            if low.text != "0":
                raise self.refuse(target, "rows are copied as a whole")
        simple = value.known or value.text.isidentifier() or value.text.endswith("[n_]")
        kept = value if simple else self.kept(value)
        self._line(f"for (int n_ = {low.text}; n_ < {high.text}; ++n_)")
        self.store(base, f"    {base.text}[n_]", kept)

    def _new_array(self, node: ast.Assign) -> None:
        [target] = node.targets
        assert isinstance(target, ast.Name)
        assert isinstance(node.value, ast.Call)
        size = self.number(node.value.args[0])
        if not size.known:
            raise self.refuse(node, "how long it is is not known")
        self._types[target.id] = Pointer((size.constant,))
        if size.constant:
            self._line(f"double {self.c_name(target.id)}[{size.text}] = {{0.0}};")


def _has_word(text: str, word: str) -> bool:
    before, found, after = text.partition(word)
    while found:
        if not (before[-1:].isalnum() or before[-1:] == "_") and not (after[:1].isalnum() or after[:1] == "_"):
            return True
        before, found, after = after.partition(word)
    return False
