"""What the files that people write have in common: quantities with units, no unknown keys, one clear complaint."""

import math
import os
import stat
import tomllib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Any, get_args

from pydantic import BaseModel, ConfigDict, GetCoreSchemaHandler, GetJsonSchemaHandler, ValidationError
from pydantic_core import CoreSchema, core_schema

from msl_fem.errors import QuantityError
from msl_fem.files.quantity import parse_quantity
from msl_fem.files.toml_text import quantity_text

LARGEST = 1e18  # of any quantity in SI units
LARGEST_OF_UNIT = {"m": 1e3, "A": 1e6, "V": 1e7, "N": 1e9, "kg": 1e7, "Hz": 1e12, "T": 1e3, "N/m": 1e12, "ohm": 1e9}
"""More than any machine of this kind has."""
LARGEST_TEXT = 16_000_000  # bytes of a file that people write: a device or a wrong file ends here, not the memory
NUMBER = r"^\s*[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?\s*"
"""The number that begins a quantity."""
DEEPEST = 40  # levels of nesting: no file of ours has more than five


@dataclass(frozen=True)
class In:
    """Annotation of a float: the text of a file with a unit of this dimension, or an SI number given from Python."""

    unit: str

    def read(self, given: object) -> float:
        """The SI value; ValueError where the text is not a quantity of this dimension, or not finite."""
        if isinstance(given, float) or (isinstance(given, int) and not isinstance(given, bool)):
            if isinstance(given, float) and not math.isfinite(given):
                raise ValueError(f"{given} is not finite")
            return float(self._plausible(given))
        try:
            return self._plausible(parse_quantity(given, self.unit))  # type: ignore[arg-type]
        except QuantityError as err:
            raise ValueError(str(err)) from err

    def _plausible(self, value: float) -> float:
        """The value; ValueError beyond what any machine has, where squares and products would overflow later."""
        most = LARGEST_OF_UNIT.get(self.unit, LARGEST)
        if abs(value) > most:
            limit = f"{most:g} {self.unit}".rstrip()
            size = f"{value:g}" if isinstance(value, float) else "a number"  # an integer of many digits is no float
            raise ValueError(f"{size} {self.unit} is out of range; in size it must be at most {limit}")
        return value

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.no_info_before_validator_function(self.read, handler(source))

    def __get_pydantic_json_schema__(self, core: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        """What editors are told: a text, a number and a unit; of a pure number the number alone will do."""
        del core, handler
        text = {"type": "string", "pattern": NUMBER + (r"\S.*$" if self.unit else r"%?\s*$")}
        return (
            text | {"description": f"a quantity in {self.unit}"} if self.unit else {"anyOf": [{"type": "number"}, text]}
        )


class FrozenModel(BaseModel):
    """A section of a file: frozen, and an unknown key is an error."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    def implied(self) -> frozenset[str]:
        """Names of the fields that follow from others, which a file therefore leaves out."""
        return frozenset()


def document(model: BaseModel) -> dict[str, Any]:
    """The model as a file states it: texts with units, aliases as keys, nothing where there is nothing."""
    content: dict[str, Any] = {}
    implied = model.implied() if isinstance(model, FrozenModel) else frozenset()
    for name, info in type(model).model_fields.items():
        value = getattr(model, name)
        if value is None or info.exclude or value == {} or name in implied:
            continue
        unit = _unit((info.annotation, *info.metadata))
        content[info.alias or name] = document(value) if isinstance(value, BaseModel) else _with_unit(value, unit)
    return content


def _with_unit(value: Any, unit: str) -> Any:
    """Numbers of a unit as texts, in lists as well."""
    if isinstance(value, tuple):
        return [_with_unit(each, unit) for each in value]
    return quantity_text(value, unit) if isinstance(value, float) and unit else value


def _unit(parts: tuple[Any, ...]) -> str:
    """The unit of the first `In` within an annotation and its metadata, "" without one."""
    for part in parts:
        unit = part.unit if isinstance(part, In) else _unit(get_args(part))
        if unit:
            return unit
    return ""


def read_toml(path: str | Path, *, error: type[Exception], wanted: str) -> dict[str, Any]:
    """The content of a TOML file; raises `error`, saying what file is wanted, where there is none or it is not TOML."""
    try:
        text = small_text(path)
    except UnicodeDecodeError as err:
        raise error(
            f"{path}: cannot be read (byte {err.start} is no UTF-8); give {wanted} (TOML) saved as UTF-8"
        ) from err
    except (OSError, ValueError) as err:
        raise error(f"{path}: cannot be read ({reason(err)}); give {wanted} (TOML)") from err
    try:
        content = tomllib.loads(text.removeprefix("\ufeff"))  # some editors put a byte order mark first
    except (tomllib.TOMLDecodeError, RecursionError) as err:
        raise error(f"{path}: not valid TOML: {err}") from err
    if depth(content) > DEEPEST:
        raise error(f"{path}: is nested more than {DEEPEST} levels deep; give {wanted} (TOML)")
    return content


def small_text(path: str | Path, *, encoding: str = "utf-8") -> str:
    """The text of a file of up to `LARGEST_TEXT` bytes.

    Raises
    ------
    OSError : it cannot be read
    ValueError : it is larger, no text of that encoding, a device or a pipe with a name
    """
    refuse_what_never_ends(path)
    with Path(path).open("rb") as stream:
        content = stream.read(LARGEST_TEXT + 1)
    if len(content) > LARGEST_TEXT:
        raise ValueError(f"more than {LARGEST_TEXT // 1_000_000} MB")
    return content.decode(encoding)


def refuse_what_never_ends(path: str | Path) -> None:
    """ValueError for a device and for a pipe with a name, which waits for ever where nobody writes into it.

    The pipe of a shell's `<(...)` has no name in the file system, and a writer.
    """
    mode = os.stat(path).st_mode
    if stat.S_ISCHR(mode) or stat.S_ISBLK(mode):
        raise ValueError("a device, no file")
    if stat.S_ISFIFO(mode) and os.path.lexists(os.path.realpath(path)):
        raise ValueError("a named pipe, no file")


def depth(content: object) -> int:
    """How many levels there are below the top, in tables and lists; found without recursion."""
    levels, inside = 0, [content]
    while inside := [v for one in inside if isinstance(one, dict | list)
                     for v in (one.values() if isinstance(one, dict) else one)]:  # fmt: skip
        levels += 1
    return levels


def bare_number(
    content: Mapping[Any, Any], pure: Collection[str], *, path: str = "", words: Collection[str] = ()
) -> str | None:
    """The complaint about the first number without a unit or, of keys in `pure`, which need none, in quotes.

    Keys in `words` take both: the channel 1 and the channel "common".
    """
    for key, value in content.items():
        inner = dict(enumerate(value)) if isinstance(value, list) else value
        if isinstance(inner, dict):
            said = bare_number(inner, pure, path=f"{path}{key}.", words=words)
            if said:
                return said
        elif isinstance(value, str) and key in pure and key not in words and _is_number(value):
            return f"{path}{key}: '{value}' is a text; write the number without quotes, {key} = {value.strip()}"
        elif isinstance(value, bool):
            return f"{path}{key}: {str(value).lower()} is not what is expected here; write a number or a text"
        elif isinstance(value, int | float) and key not in pure:
            return f'{path}{key}: {value} has no unit; write a text with one, like "0.6 mm"'
    return None


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def has_unknown_key(err: ValidationError) -> bool:
    """Whether a key that no section has is among the complaints."""
    return any(one["type"] == "extra_forbidden" for one in err.errors())


def first_complaint(err: ValidationError, *, unions: Collection[str] = (), of: type[BaseModel] | None = None) -> str:
    """One line: the key path, what is wrong with it, and how many complaints more there are.

    `unions` names the keys that hold one of several kinds: pydantic puts the kind into the path, the file does not.
    `of` is the record of the file: of an unknown key those that are known beside it are then told.
    """
    errors, explained = err.errors(), 1
    first = min(errors, key=lambda one: one["type"] != "extra_forbidden")  # a misspelt key explains a missing one
    loc = first["loc"]
    path = ".".join(str(p) for k, p in enumerate(loc) if k == 0 or loc[k - 1] not in unions)
    kind = first["type"]
    if kind == "extra_forbidden":
        missing = [str(one["loc"][-1]) for one in errors if one["type"] == "missing" and one["loc"][:-1] == loc[:-1]]
        meant = get_close_matches(str(loc[-1]), missing, n=1)
        explained += len(meant)
        known = known_keys(of, loc[:-1]) if of is not None else []
        meant = meant or get_close_matches(str(loc[-1]), known, n=1, cutoff=0.75)
        there = f"; there are {', '.join(known)}" if known else "; check its spelling or remove it"
        said = f"unknown key; is {meant[0]} meant?" if meant else f"unknown key{there}"
    elif kind == "missing":
        said = "is missing; write schema = 1" if loc == ("schema",) else "is missing"
    elif kind == "union_tag_invalid":
        context = first["ctx"]
        key = context["discriminator"].strip("'")
        said = f"{key} {context['tag']!r} is unknown; choose one of {context['expected_tags']}"
    elif kind == "union_tag_not_found":
        said = f"{first['ctx']['discriminator']} is missing".replace("'", "")
    else:
        said = first["msg"].removeprefix("Value error, ")
        if not isinstance(first["input"], dict | BaseModel) and kind != "value_error":
            said += f", not {first['input']!r}"
    more = f" (and {err.error_count() - explained} more)" if err.error_count() > explained else ""
    return f"{path + ': ' if path else ''}{said}{more}"


def known_keys(model: type[BaseModel], place: Sequence[int | str]) -> list[str]:
    """The keys of the section at a place of a file, as pydantic names it: keys, numbers in lists, kinds of unions."""
    records = [model]
    for step in place:
        if isinstance(step, int):
            continue
        inner = [info.annotation for record in records for name, info in record.model_fields.items()
                 if step in (name, info.alias)]  # fmt: skip
        chosen = [one for annotation in inner for one in _records_in(annotation)]
        of_kind = [one for one in records if step in _kinds_of(one)]
        records = chosen or of_kind or []
    return sorted(
        {info.alias or name for one in records for name, info in one.model_fields.items() if not info.exclude}
    )


def _records_in(annotation: Any) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [one for part in get_args(annotation) for one in _records_in(part)]


def _kinds_of(model: type[BaseModel]) -> tuple[Any, ...]:
    kind = model.model_fields.get("kind")
    return () if kind is None else get_args(kind.annotation)


def reason(err: Exception) -> str:
    """Why a file could not be read, without its path (which the caller names)."""
    return err.strerror or "error" if isinstance(err, OSError) else str(err)
