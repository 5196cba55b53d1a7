"""Numbers without a unit: one list of them serves actuator files and what rig.toml states in their place."""

import re
from pathlib import Path
from typing import Any, get_args

import pytest
from pydantic import BaseModel

from msl_fem.actuator import PURE_NUMBERS, Actuator, load_actuator
from msl_fem.errors import ActuatorError
from msl_fem.files.schema import In
from msl_fem.record.reader import load_record

GEOMETRIES = Path(__file__).parents[2] / "geometries"


def plain_numbers(model: type[BaseModel], seen: frozenset[type] = frozenset()) -> set[str]:
    """Names of the fields of a section, and of the sections in it, that hold a number and state no unit for it."""
    found: set[str] = set()
    for name, info in model.model_fields.items():
        leaves = list(_leaves((info.annotation, *info.metadata)))
        sections = [leaf for leaf in leaves if isinstance(leaf, type) and issubclass(leaf, BaseModel)]
        for section in set(sections) - seen:
            found |= plain_numbers(section, seen | {section})
        numbers = any(leaf in (int, float) or type(leaf) in (int, float) for leaf in leaves)
        if numbers and not any(isinstance(leaf, In) and leaf.unit for leaf in leaves):
            found.add(info.alias or name)
    return found


def _leaves(parts: tuple[Any, ...]) -> Any:
    for part in parts:
        inner = get_args(part)
        yield from _leaves(inner) if inner else (part,)


def test_the_list_names_the_numbers_without_a_unit_and_no_others() -> None:
    assert plain_numbers(Actuator) == PURE_NUMBERS


def test_rig_toml_states_a_number_without_a_unit(tmp_path: Path) -> None:
    """An end stop's restitution was once refused here, as a number without a unit."""
    actuator = GEOMETRIES / "fast_tool_servo.toml"
    (tmp_path / "own.toml").write_bytes(actuator.read_bytes())
    (tmp_path / "rig.toml").write_text(
        'schema = 1\norigin = "measured"\nactuator = "own.toml"\n[static]\nrole = "fit"\n'
        '[motion]\nend_stop = "0.55 mm"\nend_stop_restitution = 0.3\n',
        encoding="utf-8",
    )
    (tmp_path / "static.csv").write_text("gap_m,current_A,force_N\n0.0003,1.0,20.0\n", encoding="utf-8")
    motion = load_record(tmp_path).actuator.motion
    assert motion is not None
    assert motion.end_stop_restitution == pytest.approx(0.3)


@pytest.mark.parametrize(("key", "text"), [("turns", "400"), ("fill_factor", " 0.5"), ("count", "2")])
def test_a_number_in_quotes_is_told_with_its_mend(tmp_path: Path, key: str, text: str) -> None:
    content = (GEOMETRIES / "fast_tool_servo.toml").read_text()
    quoted = re.sub(rf"^{key} = .*$", f'{key} = "{text}"', content, count=1, flags=re.MULTILINE)
    assert quoted != content
    (tmp_path / "a.toml").write_text(quoted)
    with pytest.raises(ActuatorError, match=rf"{key}: '{text}' is a text; write the number without quotes, {key} = "):
        load_actuator(tmp_path / "a.toml")
