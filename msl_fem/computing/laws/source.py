"""Laws as source of compiled Python: one operation a line, written from the checked tree and from nothing else.

The functions work on `Rows`, so they serve one run and lanes, and the printer of C reads them as it reads the kernel.
"""

import linecache
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from hashlib import sha256
from typing import Any

from msl_fem.computing import lanes
from msl_fem.computing.laws.expression import LawExpression
from msl_fem.computing.laws.grammar import Node

_CALLS = {
    "abs": "size", "sign": "sign_of", "sqrt": "square_root", "exp": "exponential", "log": "logarithm", "sin": "sine_of",
    "cos": "cosine_of", "tanh": "hyperbolic_tangent", "min": "smaller", "max": "larger",
}  # fmt: skip
_USED = {name: getattr(lanes, name) for name in (*_CALLS.values(), "choose")}


@dataclass
class Lines:
    """The body of a function that is being written; an operation that was written before is not written again."""

    lines: list[str] = field(default_factory=list)
    _known: dict[str, str] = field(default_factory=dict)

    def value(self, text: str) -> str:
        """The name under which the value of an operation stands."""
        if text not in self._known:
            self._known[text] = f"t{len(self._known)}"
            self.lines.append(f"{self._known[text]} = {text}")
        return self._known[text]

    def law(self, node: Node, names: Mapping[str, str]) -> str:
        """The name or number of a tree's value, its own names standing as `names` say."""
        if node.kind == "number":
            return repr(node.value) if node.value >= 0 else f"({node.value!r})"
        if node.kind == "name":
            return names[node.name]
        if node.kind == "**":
            return self._power(self.law(node.inner[0], names), node.inner[1].value)
        inner = [self.law(one, names) for one in node.inner]
        if node.kind == "negative":
            return self.value(f"0.0 - {inner[0]}")
        if node.kind in _CALLS:
            return self.value(f"{_CALLS[node.kind]}({', '.join(inner)})")
        return self.value(f"{inner[0]} {node.kind} {inner[1]}")

    def _power(self, base: str, exponent: float) -> str:
        size = abs(exponent)
        if size != int(size):
            logarithm = self.value(f"logarithm({base})")
            exponent_times = self.value(
                f"{exponent!r} * {logarithm}" if exponent > 0 else f"({exponent!r}) * {logarithm}"
            )
            return self.value(f"exponential({exponent_times})")
        power = "1.0"
        for _ in range(int(size)):
            power = base if power == "1.0" else self.value(f"{power} * {base}")
        return power if exponent >= 0 else self.value(f"1.0 / {power}")


@dataclass(frozen=True)
class Places:
    """Where a function finds and puts its numbers.

    Attributes
    ----------
    inputs : name of a variable to its row of the workspace
    output : the row that receives the sum of the laws
    """

    inputs: Mapping[str, int]
    output: int


def sum_of_laws(
    name: str,
    meaning: str,
    groups: Sequence[tuple[Sequence[LawExpression], Places]],
    parameter_rows: Mapping[tuple[str, str], int],
) -> Callable[[Any, Any], None]:
    """The function (coefficients, workspace) that puts the sum of each group's laws where its places say.

    A law whose amounts are all 0 gives 0, also where it is not defined. `parameter_rows` are rows of the coefficients
    by name of the cause and of the parameter.
    """
    body = Lines()
    for expressions, places in groups:
        _write_group(body, expressions, places, parameter_rows)
    return made(name, ("e", "work"), meaning, body.lines or ["pass"], _USED)


def _write_group(
    body: Lines, expressions: Sequence[LawExpression], places: Places, rows: Mapping[tuple[str, str], int]
) -> None:
    total = "0.0"
    for one in expressions:
        names = {v: body.value(f"work[{places.inputs[v]}]") for v in sorted(one.variables)}
        names |= {p.name: body.value(f"e[{rows[one.name, p.name]}]") for p in one.parameters}
        there = "0.0"
        for p in one.parameters:
            if p.amount:
                there = body.value(f"{there} + size({names[p.name]})")
        value = body.value(f"choose({there} > 0.0, {body.law(one.law, names)}, 0.0)")
        total = body.value(f"{total} + {value}")
    body.lines.append(f"work[{places.output}] = {total}")


def made(
    name: str, arguments: Sequence[str], meaning: str, lines: Sequence[str], namespace: Mapping[str, Any]
) -> Callable[..., Any]:
    """The function of these lines; its source can be read back, as that of a function of a file."""
    text = "\n    ".join([f"def {name}({', '.join(arguments)}):", f'"""{meaning}"""', *lines]) + "\n"
    file = f"<laws {name} {sha256(text.encode()).hexdigest()[:12]}>"
    found: dict[str, Any] = {**namespace, "__name__": __name__}
    exec(compile(text, file, "exec"), found)  # written above, from a checked tree
    linecache.cache[file] = (len(text), None, text.splitlines(keepends=True), file)
    function: Callable[..., Any] = found[name]
    return function
