"""The reference page of the functions of `msl_fem`: signatures as they stand in the sources, and docstrings.

`make_reference.py` writes it.
"""

import ast
import inspect
from functools import cache
from pathlib import Path
from typing import Any

import msl_fem

WIDTH = 100
_INTRO = """# Functions of msl_fem

What `import msl_fem` has, by name; which verb of the command line each belongs to, stands in
[In a notebook](../python.md). All quantities are in SI units. Errors derive from built-in ones: `InputError` and its
kin from `ValueError`, `ComputationError` from `RuntimeError`.
"""


def api_page() -> str:
    """All of `msl_fem.__all__`: a heading, the signature, the docstring."""
    parts = [_INTRO]
    for name in msl_fem.__all__:
        definition = definition_of(getattr(msl_fem, name))
        parts += [f"## `{name}`", "", "```python", *_lines(definition, name), "```", ""]
        parts += ["``` { .text .docstring }", inspect.cleandoc(ast.get_docstring(definition) or ""), "```", ""]
    return "\n".join(parts)


def definition_of(member: Any) -> ast.ClassDef | ast.FunctionDef:
    """The definition of a function, class or method in its source file."""
    found: Any = _parsed(inspect.getsourcefile(inspect.unwrap(member)) or "")
    for part in member.__qualname__.split("."):
        found = next(one for one in found.body if getattr(one, "name", "") == part)
    return found  # type: ignore[no-any-return]


@cache
def _parsed(file: str) -> ast.Module:
    return ast.parse(Path(file).read_text(encoding="utf-8"))


def _lines(definition: ast.ClassDef | ast.FunctionDef, name: str) -> list[str]:
    """The signature, an argument a line where it is long; of a class its fields and public methods."""
    if isinstance(definition, ast.FunctionDef):
        return _signature(definition, name)
    lines = [f"class {name}:"]
    for one in definition.body:
        if isinstance(one, ast.AnnAssign) and not ast.unparse(one.target).startswith("_"):
            lines.append(f"    {ast.unparse(one)}")
        elif isinstance(one, ast.FunctionDef) and not one.name.startswith("_") and not _overload(one):
            lines += [f"    {line}" for line in _signature(one, one.name)]
    return lines


def _overload(function: ast.FunctionDef) -> bool:
    return any(ast.unparse(one) == "overload" for one in function.decorator_list)


def _signature(function: ast.FunctionDef, name: str) -> list[str]:
    gives = f" -> {ast.unparse(function.returns)}" if function.returns else ""
    whole = f"def {name}({ast.unparse(function.args)}){gives}"
    if len(whole) <= WIDTH:
        return [whole]
    return [f"def {name}(", *(f"    {one}," for one in _arguments(function.args)), f"){gives}"]


def _arguments(given: ast.arguments) -> list[str]:
    """Each argument as text, `*` and `/` between them where they stand."""
    missing: list[ast.expr | None] = [None] * (len(given.posonlyargs) + len(given.args) - len(given.defaults))
    defaults = [*missing, *given.defaults]
    told = [_argument(one, default) for one, default in zip([*given.posonlyargs, *given.args], defaults, strict=True)]
    if given.posonlyargs:
        told.insert(len(given.posonlyargs), "/")
    if given.vararg or given.kwonlyargs:
        told.append(f"*{ast.unparse(given.vararg)}" if given.vararg else "*")
    told += [_argument(one, default) for one, default in zip(given.kwonlyargs, given.kw_defaults, strict=True)]
    return told + ([f"**{ast.unparse(given.kwarg)}"] if given.kwarg else [])


def _argument(one: ast.arg, default: ast.expr | None) -> str:
    return ast.unparse(one) if default is None else f"{ast.unparse(one)} = {ast.unparse(default)}"
