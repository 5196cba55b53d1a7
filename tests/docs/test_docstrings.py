"""Public functions and classes say what comes out, and of arrays their shape or unit."""

import importlib
import inspect
import pkgutil
import re
from typing import Any

import pytest

import msl_fem

PACKAGES = ["msl_fem", *(f"msl_fem.{m.name}" for m in pkgutil.iter_modules(msl_fem.__path__))]
FIRST_LINE = 120
UNITS = re.compile(
    r"\(n\w*(, ?[\w .+*-]+)*,?\)|\(N_\w+,\)|\(\.\.\., |\(\w+, \.\.\.\)|per cent|index|shape"
    r"|\b(m|mm|A|V|N|Wb|T|H|J|s|Hz|kg|K|W|rad|Pa|ohm|SI)\b"
)
"""Words of which one must stand in the docstring where arrays go in or come out: a shape or a unit."""


def public() -> list[tuple[str, Any]]:
    """(name, object) of all that the packages' and modules' `__all__` offer, each once."""
    found: dict[int, tuple[str, Any]] = {}
    for package in PACKAGES:
        module = importlib.import_module(package)
        for name in getattr(module, "__all__", []):
            it = getattr(module, name)
            if (inspect.isclass(it) or inspect.isroutine(it)) and it.__module__.startswith("msl_fem"):
                found.setdefault(id(it), (f"{package}.{name}", it))
    return list(found.values())


OFFERED = public()


def described(it: Any) -> str:
    """Docstring of a function or class; a compiled function has its source's."""
    return inspect.getdoc(getattr(it, "py_func", it)) or ""


def test_the_packages_offer_something() -> None:
    assert len(OFFERED) > 150


@pytest.mark.parametrize(("name", "it"), OFFERED, ids=[name for name, _ in OFFERED])
def test_the_first_line_is_a_sentence(name: str, it: Any) -> None:
    text = described(it)
    assert text, f"{name} has no docstring"
    if inspect.isclass(it):
        assert not text.startswith(f"{it.__name__}("), f"{name} has the docstring that a dataclass makes up"
    first = text.splitlines()[0]
    assert len(first) <= FIRST_LINE
    assert len(first) > 14, f"{name}: '{first}'"
    assert first.endswith((".", ":", ";", ",")) or len(text.splitlines()) > 1, f"{name}: '{first}'"


def is_array(kind: Any) -> bool:
    """Whether a type is an array, by itself or in a tuple or union; not arrays by name, nor functions of arrays."""
    text = str(kind)
    return bool(re.search(r"ndarray|_SupportsArray", text)) and not re.search(r"dict\[|Mapping\[|Callable", text)


def has_arrays(it: Any) -> bool:
    """Whether a parameter, a result or a field of it is an array."""
    if inspect.isclass(it):
        return any(map(is_array, vars(it).get("__annotations__", {}).values()))
    try:
        signature = inspect.signature(it)
    except (TypeError, ValueError):
        return False
    return any(map(is_array, [*(p.annotation for p in signature.parameters.values()), signature.return_annotation]))


WITH_ARRAYS = [(name, it) for name, it in OFFERED if has_arrays(it)]


def test_arrays_are_recognised() -> None:
    assert len(WITH_ARRAYS) > 40


@pytest.mark.parametrize(("name", "it"), WITH_ARRAYS, ids=[name for name, _ in WITH_ARRAYS])
def test_arrays_have_a_unit_or_a_shape(name: str, it: Any) -> None:
    assert UNITS.search(described(it)), f"{name} says neither unit nor shape of its arrays"


@pytest.mark.parametrize(("name", "it"), [o for o in OFFERED if inspect.isclass(o[1])], ids=lambda o: str(o)[:60])
def test_methods_of_public_classes_are_described(name: str, it: type) -> None:
    """Own public methods; a property may be told by its name."""
    for member, value in vars(it).items():
        if not member.startswith("_") and inspect.isfunction(value) and value.__module__ == it.__module__:
            assert inspect.getdoc(value), f"{name}.{member} has no docstring"
