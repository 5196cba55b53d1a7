"""A user's law as a checked tree: numbers, names, + - * / **, and calls of a few functions; nothing of it is executed.

The text is parsed by Python's own grammar (`ast`), then each node is held against the list of what is allowed and
rebuilt as a `Node`; what is not on the list is refused with its place in the text. A power has a number as its
exponent, so that no number grows beyond bounds before the law is evaluated.
"""

import ast
import math
from collections.abc import Iterator
from dataclasses import dataclass

from msl_fem.errors import InputError

LONGEST = 500  # characters
DEEPEST = 30  # nested operations
LARGEST_POWER = 8.0
FUNCTIONS = {"abs": 1, "sign": 1, "sqrt": 1, "exp": 1, "log": 1, "sin": 1, "cos": 1, "tanh": 1, "min": 2, "max": 2}
"""Names that a law may call, and how many arguments each takes."""
CONSTANTS = {"pi": math.pi}
_OPERATORS: dict[type[ast.operator], str] = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.Pow: "**"}


@dataclass(frozen=True)
class Node:
    """One operation of a law.

    Attributes
    ----------
    kind : "number", "name", an operator (+ - * / **), "negative", or a name of `FUNCTIONS`
    inner : what it works on; the exponent of ** is a number
    value : of a number
    name : of a variable or a parameter
    """

    kind: str
    inner: tuple["Node", ...] = ()
    value: float = 0.0
    name: str = ""

    @property
    def names(self) -> frozenset[str]:
        """All variables and parameters in it."""
        return frozenset({node.name for node in self.walk() if node.kind == "name"})

    def walk(self) -> Iterator["Node"]:
        """This node and all below it."""
        yield self
        for node in self.inner:
            yield from node.walk()

    @property
    def text(self) -> str:
        """As a law that parses back to this tree."""
        if self.kind == "number":
            return f"{self.value!r}" if self.value >= 0 else f"({self.value!r})"
        if self.kind == "name":
            return self.name
        if self.kind == "negative":
            return f"(-{self.inner[0].text})"
        if self.kind in FUNCTIONS:
            return f"{self.kind}({', '.join(node.text for node in self.inner)})"
        return f"({self.inner[0].text} {self.kind} {self.inner[1].text})"


def number(value: float) -> Node:
    """A constant."""
    return Node("number", value=float(value))


def parse_law(text: str, names: frozenset[str]) -> Node:
    """The tree of a law in which `names` alone stand for numbers.

    Raises
    ------
    InputError : not a formula, a name, function or operation that is not allowed, too long, too deep, a power that is
        no number or too large; names what is wrong and what is allowed
    """
    if len(text) > LONGEST:
        raise InputError(f"the law has {len(text)} characters; at most {LONGEST} are read")
    if _depth_of_brackets(text) > DEEPEST:
        raise InputError(f"the law has more than {DEEPEST} brackets in one another; write it flatter")
    try:
        tree = ast.parse(text.strip(), mode="eval")
    except SyntaxError as err:
        raise InputError(f"'{text.strip()}' is no formula: {err.msg} at character {err.offset}") from err
    except (RecursionError, MemoryError, ValueError) as err:
        raise InputError(f"the law cannot be read ({err}); write it shorter") from err
    return _Reader(text.strip(), names).node(tree.body, 1)


def _depth_of_brackets(text: str) -> int:
    depth = deepest = 0
    for character in text:
        depth += (character in "([{") - (character in ")]}")
        deepest = max(deepest, depth)
    return deepest


class _Reader:
    """Rebuilds what is allowed of Python's tree."""

    def __init__(self, text: str, names: frozenset[str]) -> None:
        self._text, self._names = text, names

    def node(self, tree: ast.expr, depth: int) -> Node:
        if depth > DEEPEST:
            raise InputError(f"the law has more than {DEEPEST} operations in one another; write it flatter")
        if isinstance(tree, ast.Constant):
            return self._number(tree)
        if isinstance(tree, ast.Name):
            return self._name(tree)
        if isinstance(tree, ast.UnaryOp) and isinstance(tree.op, ast.USub | ast.UAdd):
            inner = self.node(tree.operand, depth + 1)
            return Node("negative", (inner,)) if isinstance(tree.op, ast.USub) else inner
        if isinstance(tree, ast.BinOp) and type(tree.op) in _OPERATORS:
            return self._operation(tree, depth)
        if isinstance(tree, ast.Call):
            return self._call(tree, depth)
        raise self._refused(tree, "allowed are numbers, names, + - * / ** and brackets, and functions")

    def _number(self, tree: ast.Constant) -> Node:
        if isinstance(tree.value, bool) or not isinstance(tree.value, int | float):
            raise self._refused(tree, "allowed are numbers like 0.5 or 1e-3")
        try:
            value = float(tree.value)
        except OverflowError:
            value = math.inf
        if not math.isfinite(value):
            raise self._refused(tree, "a number must be finite")
        return number(value)

    def _name(self, tree: ast.Name) -> Node:
        if tree.id in CONSTANTS:
            return number(CONSTANTS[tree.id])
        if tree.id in FUNCTIONS:
            raise self._refused(tree, f"it is a function; write {tree.id}(...)")
        if tree.id not in self._names:
            raise self._refused(tree, f"allowed are {', '.join(sorted(self._names))} and pi")
        return Node("name", name=tree.id)

    def _operation(self, tree: ast.BinOp, depth: int) -> Node:
        kind = _OPERATORS[type(tree.op)]
        left, right = self.node(tree.left, depth + 1), self.node(tree.right, depth + 1)
        if kind == "**":
            right = _folded_sign(right)
            if right.kind != "number" or abs(right.value) > LARGEST_POWER:
                raise self._refused(
                    tree.right,
                    f"a power must be a number from -{LARGEST_POWER:g} to {LARGEST_POWER:g}; use exp and log",
                )
        return Node(kind, (left, right))

    def _call(self, tree: ast.Call, depth: int) -> Node:
        if not isinstance(tree.func, ast.Name) or tree.func.id not in FUNCTIONS:
            raise self._refused(tree.func, f"allowed functions are {', '.join(FUNCTIONS)}")
        name, count = tree.func.id, FUNCTIONS[tree.func.id]
        if tree.keywords or len(tree.args) != count:
            raise self._refused(tree, f"{name} takes {count} {'value' if count == 1 else 'values'}")
        return Node(name, tuple(self.node(one, depth + 1) for one in tree.args))

    def _refused(self, tree: ast.expr, way_out: str) -> InputError:
        token = ast.get_source_segment(self._text, tree) or type(tree).__name__
        shown = token if len(token) <= 40 else f"{token[:40]}..."
        return InputError(f"'{shown}' is not allowed in a law; {way_out}")


def _folded_sign(node: Node) -> Node:
    """A negative number as a number."""
    if node.kind == "negative" and node.inner[0].kind == "number":
        return number(-node.inner[0].value)
    return node
