"""Causes from where users keep them: a text, a TOML file with [[effects.expression]], an entry point of a package."""

from collections.abc import Iterable, Mapping
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

from msl_fem.computing.laws.expression import LawExpression, expression_of_toml, parse_expression
from msl_fem.errors import InputError
from msl_fem.files.schema import read_toml

GROUP = "msl_fem.effects"
"""Of the entry points: each names a text, an `LawExpression`, or several of them, in a Python file of an installed
package."""


def causes_of(text: str) -> tuple[LawExpression, ...]:
    """The causes of a text "NAME: EQUATION = LAW; ...", of a TOML file, or of the entry point of that name.

    Raises
    ------
    InputError : there are none; names what is wrong
    """
    if ":" in text and "=" in text:
        return (parse_expression(text),)
    if text.endswith(".toml"):
        content = read_toml(Path(text), error=InputError, wanted="a file with [[effects.expression]]")
        found = expressions_of_table(content.get("effects", {}), where=text)
        if not found:
            raise InputError(f"{text}: has no [[effects.expression]]; write one, with name, equation, law, parameters")
        return found
    return _of_entry_point(text.strip())


def expressions_of_table(effects: object, *, where: str) -> tuple[LawExpression, ...]:
    """The causes of the key `expression` of a file's table `effects`.

    Raises
    ------
    InputError : it is no list of tables, or one of them is no cause
    """
    listed = effects.get("expression", []) if isinstance(effects, Mapping) else []
    if not isinstance(listed, list | tuple):
        raise InputError(f"{where}: effects.expression is no list; write [[effects.expression]] before each")
    return tuple(expression_of_toml(one, where=f"{where}: effects.expression.{n}") for n, one in enumerate(listed))


def _of_entry_point(name: str) -> tuple[LawExpression, ...]:
    known = {point.name: point for point in entry_points(group=GROUP)}
    if name not in known:
        offered = f"; installed are {', '.join(sorted(known))}" if known else ""
        raise InputError(
            f"'{name}' is no cause: write it like \"drag: force = -a*v*abs(v); a: 0..1 N s2/m2\", name a TOML file "
            f"with [[effects.expression]], or an entry point of the group {GROUP}{offered}"
        )
    try:
        loaded = known[name].load()
    except Exception as err:  # whatever the user's file raises
        raise InputError(f"the entry point {name} of {GROUP} cannot be loaded: {err}") from err
    return tuple(_of_object(name, one) for one in _listed(loaded))


def _listed(loaded: Any) -> Iterable[Any]:
    return loaded if isinstance(loaded, list | tuple) else (loaded,)


def _of_object(name: str, one: object) -> LawExpression:
    if isinstance(one, LawExpression):
        return one
    if isinstance(one, str):
        return parse_expression(one)
    raise InputError(f"the entry point {name} of {GROUP} gives a {type(one).__name__}; give texts or LawExpressions")
