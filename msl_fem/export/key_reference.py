"""The keys of the files that people write, from the records that read them: tables for the documentation, JSON Schema.

Meanings are the entries "name, name : text" under "Attributes" of a record's docstring.
"""

import inspect
import re
import types
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from msl_fem.files.schema import In

_BOUNDS = {"gt": "above {}", "ge": "at least {}", "lt": "below {}", "le": "at most {}"}


@dataclass(frozen=True)
class FileKey:
    """A key of a section: what may stand there, and what stands there where it is left out ("" : it must be stated)."""

    name: str
    value: str
    default: str
    meaning: str


@dataclass(frozen=True)
class FileSection:
    """A section of a file, like "[magnet.coil]", with its keys; `kind` where its `kind` chooses among several."""

    path: str
    kind: str
    meaning: str
    keys: tuple[FileKey, ...]


def sections_of(model: type[BaseModel], path: str = "") -> Iterator[FileSection]:
    """The sections of a file, from the top, those inside after the one that they are in."""
    told = meanings(model)
    keys, inner = [], []
    for name, info in model.model_fields.items():
        key = info.alias or name
        if info.exclude or name == "kind":
            continue
        records = _records(info.annotation)
        if records:
            many = "tuple" in str(info.annotation)
            inner += [(one, f"{path}.{key}" if path else key, many) for one in records]
            continue
        keys.append(FileKey(key, _value(info), _default(info), told.get(name, "")))
    kind = model.model_fields.get("kind")
    words = ", ".join(map(str, get_args(kind.annotation))) if kind is not None else ""
    yield FileSection(path, words if path == "magnet" else "", _first_sentence(model), tuple(keys))
    for one, inside, _ in inner:
        yield from sections_of(one, inside)


def meanings(model: type[BaseModel]) -> dict[str, str]:
    """Field to what the docstrings of a record and of those that it derives from say of it."""
    told: dict[str, str] = {}
    for record in reversed(model.__mro__):
        text = inspect.cleandoc(record.__doc__ or "")
        _, _, listed = text.partition("Attributes\n")
        for names, meaning in re.findall(r"^([a-z_0-9, ]+) : (.*(?:\n {4}.*)*)", listed, flags=re.MULTILINE):
            told |= {name.strip(): " ".join(meaning.split()) for name in names.split(",")}
    return told


def _first_sentence(model: type[BaseModel]) -> str:
    text = inspect.cleandoc(model.__doc__ or "").split("\n\n")[0]
    return " ".join(text.split())


def _records(annotation: Any) -> list[type[BaseModel]]:
    """The records within an annotation: of a section, of one of several kinds, of a list."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [record for part in get_args(annotation) for record in _records(part)]


def _value(info: FieldInfo) -> str:
    unit = _unit_in((info.annotation, *info.metadata))
    bounds = [_BOUNDS[name].format(f"{limit:g}") for name, limit in _limits((info.annotation, *info.metadata))]
    choices = _choices(info.annotation)
    if choices:
        return " or ".join(f'"{choice}"' if isinstance(choice, str) else str(choice) for choice in choices)
    what = f"quantity in {unit}" if unit else _plain(info.annotation)
    return ", ".join([what, *bounds])


def _unit_in(parts: tuple[Any, ...]) -> str | None:
    for part in parts:
        unit = part.unit or "number or %" if isinstance(part, In) else _unit_in(get_args(part))
        if unit:
            return unit
    return None


def _limits(parts: tuple[Any, ...]) -> list[tuple[str, float]]:
    found: dict[str, float] = {}
    for part in parts:
        for holder in (part, *getattr(part, "metadata", ())):
            found |= {name: getattr(holder, name) for name in _BOUNDS if getattr(holder, name, None) is not None}
        found |= dict(_limits(get_args(part))) if get_origin(part) is not None else {}
    return list(found.items())


def _choices(annotation: Any) -> tuple[Any, ...]:
    if get_origin(annotation) is Literal:
        return get_args(annotation)
    if get_origin(annotation) in (Union, types.UnionType, Annotated):
        return next((found for part in get_args(annotation) if (found := _choices(part))), ())
    return ()


def _plain(annotation: Any) -> str:
    text = str(annotation)
    if "tuple" in text or "list" in text:
        return "list"
    if "dict" in text:
        return "section with keys of its own"
    return next((word for kind, word in (("bool", "true or false"), ("int", "whole number"), ("float", "number"))
                 if kind in text), "text")  # fmt: skip


def _default(info: FieldInfo) -> str:
    if info.is_required():
        return ""
    value = info.default if info.default is not PydanticUndefined else None
    if value is None or value == ():
        return "none"
    unit = _unit_in((info.annotation, *info.metadata)) or ""
    shown = f"{value:g}" if isinstance(value, float) else f"{value}"
    return f"{shown} {unit}".strip() if unit and unit != "number or %" else shown


def markdown_table(section: FileSection) -> str:
    """The keys of a section as a table of a page."""
    rows = ["| key | value | if left out | meaning |", "| --- | --- | --- | --- |"]
    rows += [
        f"| `{k.name}` | {_cell(k.value)} | {_cell(k.default) or '**must be stated**'} | {_cell(k.meaning)} |"
        for k in section.keys
    ]
    return "\n".join(rows)


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("<", "&lt;")


def json_schema(model: type[BaseModel], *, title: str) -> dict[str, Any]:
    """JSON Schema (draft 2020-12) of a file as editors and validators take it; quantities are texts with a unit."""
    made = model.model_json_schema(by_alias=True)
    made = _without_exact_defaults(made)
    made["properties"].pop("file", None)
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": title} | made


def _without_exact_defaults(content: Any) -> Any:
    """Defaults of quantities are SI numbers inside and texts in files: they are left to the meaning."""
    if isinstance(content, dict):
        return {
            key: _without_exact_defaults(value)
            for key, value in content.items()
            if not (key == "default" and not isinstance(value, str | int | bool | None))
        }
    return [_without_exact_defaults(each) for each in content] if isinstance(content, list) else content
