"""Statements of compiled Python as C: where names are declared, branches that are known, loops, what is returned."""

import ast
import re
from collections import Counter
from collections.abc import Iterator, Mapping
from typing import Any

from msl_fem.export.c_assignments import Assignments, Path
from msl_fem.export.c_expressions import FunctionPrinter
from msl_fem.export.c_types import (
    FIXED,
    NOTHING,
    WHOLE,
    Expression,
    PrintError,
    Several,
    constant,
    joined_type,
)

_MOST_PASSES = 8


class FunctionBody(Assignments):
    """Prints one function for arguments of known types.

    It goes over the function until the types of its names stand still, then once more with what that told: which names
    are read at all, and in which block each is declared.

    Attributes
    ----------
    result, value : type of what the function returns, after `print`; it, where it is no number and known
    read, writes : names that are read; parameters whose rows are written to
    """

    def __init__(
        self, printer: FunctionPrinter, python: Any, compiled: bool, arguments: Mapping[str, Expression]
    ) -> None:
        super().__init__(printer, python, compiled, arguments)
        self.result: Any = None
        self.value: Any = None
        self._blocks = 0

    def print(self, tree: ast.FunctionDef) -> list[str]:
        """The lines of the body."""
        self._counts = _assignments(tree)
        for _ in range(_MOST_PASSES):
            types, result = dict(self._types), self.result
            self._begin()
            self._block(_without_docstring(tree))
            if types == self._types and result == self.result:
                break
        self._plan = {name: _common(places) for name, places in self._places.items()}
        self._needed, former = set(self.read), set[str]()
        self._final = True
        while self._needed != former:
            former = set(self._needed)
            self._hoisted = []
            self._begin()
            self._block(_without_docstring(tree))
            self._needed -= self._unread()
        if self.result is None:
            self.result = NOTHING
        return self._hoisted + self._lines

    def _begin(self) -> None:
        self._lines, self._path = [], ()
        self._blocks = self._temporaries = 0
        self._declared, self.read = set(), set()
        self._places, self._known = {}, {}
        self._stores, self._origins = {}, {}

    def _unread(self) -> set[str]:
        """Names that the lines set and never read."""
        words = Counter(re.findall(r"\w+", "\n".join(self._lines)))
        return {name for name, n in self._stores.items() if words[self.c_name(name)] <= n}

    def _block(self, statements: list[ast.stmt]) -> bool:
        """Whether the block ends the function."""
        return any(self._statement(one) for one in statements)  # stops behind a return

    def _statement(self, node: ast.stmt) -> bool:
        method = getattr(self, f"_do_{type(node).__name__.lower()}", None)
        if method is None:
            raise self.refuse(node)
        self._rows_read.clear()
        self._root = getattr(node, "value", None)
        return bool(method(node))

    def _inner(self, statements: list[ast.stmt]) -> bool:
        """A block within braces."""
        self._blocks += 1
        self._path = (*self._path, self._blocks)
        ended = self._block(statements)
        self._path = self._path[:-1]
        return ended

    def _do_pass(self, node: ast.Pass) -> None:
        pass

    def _do_expr(self, node: ast.Expr) -> None:
        if isinstance(node.value, ast.Constant):
            return
        value = self.expression(node.value)
        if value.text:
            self._line(f"{value.text};" if value.type == NOTHING else f"(void){value.text};")

    def _do_return(self, node: ast.Return) -> bool:
        if node.value is None:
            self._line("return;")
            return True
        value = self.expression(node.value)
        if value.type == FIXED:
            self.result = None if value.constant is None else FIXED
            self.value = value.constant
            return True
        kind = Several(tuple(p.type for p in value.parts)) if value.parts else value.type
        self.result = joined_type(self.result, kind)
        if value.parts:
            assert isinstance(self.result, Several)
            value = Expression(self.result, value.text, parts=value.parts)
            value = self.kept(value)
        self._line(f"return {value.text};")
        return True

    def _do_assign(self, node: ast.Assign) -> None:
        if _is_new_array(node.value):
            self._new_array(node)
            return
        value = self.expression(node.value)
        if len(node.targets) > 1 and not value.known and len(value.text) > 12:
            value = self.kept(value)
        for target in reversed(node.targets):
            self._assign(target, value)

    def _do_annassign(self, node: ast.AnnAssign) -> None:
        if node.value is not None:
            self._assign(node.target, self.expression(node.value))

    def _do_augassign(self, node: ast.AugAssign) -> None:
        loaded = ast.parse(ast.unparse(node.target), mode="eval").body
        value = self.operation(node, node.op, self.number(loaded), self.number(node.value))
        self._assign(node.target, Expression(value.type, value.text, level=value.level))

    def _do_if(self, node: ast.If) -> bool:
        test = self.truth(node.test)
        if test.known:
            return self._block(node.body if test.constant else node.orelse)
        self._line(f"if ({test.text}) {{")
        ended = self._inner(node.body)
        if node.orelse:
            self._line("} else {")
            ended = self._inner(node.orelse) and ended
        self._line("}")
        return ended and bool(node.orelse)

    def _do_while(self, node: ast.While) -> None:
        self._lazy += 1
        test = self.truth(node.test)
        self._lazy -= 1
        if node.orelse:
            raise self.refuse(node)
        self._line(f"while ({test.text}) {{")
        self._inner(node.body)
        self._line("}")

    def _do_break(self, node: ast.Break) -> None:
        self._line("break;")

    def _do_for(self, node: ast.For) -> None:
        if node.orelse:
            raise self.refuse(node)
        if not (isinstance(node.iter, ast.Call) and getattr(node.iter.func, "id", "") == "range"):
            for value in self._items(node):
                self._once(node, value)
            return
        ends = [self.number(one) for one in node.iter.args]
        unrolled = isinstance(node.target, ast.Name) and self._printer.unrolled(node.target.id)
        if all(e.known for e in ends) and (unrolled or len(range(*(e.constant for e in ends))) <= 1):
            for value in range(*(e.constant for e in ends)):
                self._once(node, value)
            return
        self._counted(node, ends)

    def _counted(self, node: ast.For, ends: list[Expression]) -> None:
        if not isinstance(node.target, ast.Name):
            raise self.refuse(node.target)
        begin, end, step = (constant(0), *ends, constant(1)) if len(ends) == 1 else (*ends, constant(1))[:3]
        if not step.known or step.constant not in (1, -1):
            raise self.refuse(node, "steps are 1 or -1")
        if not end.known and not end.text.isidentifier():
            end = self.kept(end)
        name = self.c_name(node.target.id) if node.target.id != "_" else f"n_{self._blocks}"
        sign, change = ("<", "++") if step.constant == 1 else (">", "--")
        self._line(f"for (int {name} = {begin.text}; {name} {sign} {end.text}; {change}{name}) {{")
        before = self._known.get(node.target.id)
        self._known[node.target.id] = Expression(WHOLE, name)
        self._inner(node.body)
        del self._known[node.target.id]
        if before is not None:
            self._known[node.target.id] = before
        self._line("}")

    def _items(self, node: ast.For) -> list[Any]:
        """The constants that a loop goes over."""
        names = {n.id for n in ast.walk(node.iter) if isinstance(n, ast.Name)}
        if names & (set(self._types) | set(self._parameters)):
            raise self.refuse(node, "what it goes over is not known")
        code = compile(ast.Expression(node.iter), "<loop>", "eval")
        return list(eval(code, self._python.__globals__))  # constants of our own source

    def _once(self, node: ast.For, value: Any) -> None:
        """The body with the loop's names standing for constants."""
        pairs = list(_paired(node.target, value))
        for name, one in pairs:
            self._known[name] = constant(one)
        self._block(node.body)
        for name, _ in pairs:
            del self._known[name]


def _paired(target: ast.expr, value: Any) -> Iterator[tuple[str, Any]]:
    if isinstance(target, ast.Name):
        yield target.id, value
    elif isinstance(target, ast.Tuple):
        for one, part in zip(target.elts, value, strict=True):
            yield from _paired(one, part)
    else:
        raise PrintError(f"{ast.unparse(target)} is no name of a loop")


def _assignments(tree: ast.FunctionDef) -> dict[str, int]:
    """How often each name is assigned to."""
    counts: dict[str, int] = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            counts[node.id] = counts.get(node.id, 0) + 1
    return counts


def _without_docstring(tree: ast.FunctionDef) -> list[ast.stmt]:
    return tree.body[1:] if ast.get_docstring(tree) is not None else tree.body


def _common(places: list[Path]) -> Path:
    """The innermost block that holds all places."""
    found = places[0]
    for place in places[1:]:
        n = 0
        while n < min(len(found), len(place)) and found[n] == place[n]:
            n += 1
        found = found[:n]
    return found


def _is_new_array(node: ast.expr) -> bool:
    return isinstance(node, ast.Call) and ast.unparse(node.func) in ("np.empty", "np.zeros")
