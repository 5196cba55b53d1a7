"""The files that an actuator names, which come along with its record: they are what they are named as, or refused.

An actuator file or a record may come from elsewhere, and may name any file of this machine. What is copied into a
record, which others get to see, was therefore read as a B-H curve or a table before, from wherever; a mesh has to lie
with its actuator.
"""

from pathlib import Path
from typing import Any

from msl_fem.actuator import Actuator
from msl_fem.errors import RecordError
from msl_fem.files.schema import document
from msl_fem.materials.material import load_iron
from msl_fem.table.magnetic_table import read_table


def file_keys(content: dict[str, Any]) -> list[tuple[dict[str, Any], str]]:
    """The sections and keys of an actuator's document that name files."""
    magnet = content.get("magnet", {})
    iron = magnet.get("iron", {})
    curves = [(iron, key) for key in ("core", "armature") if iron.get(key, "").endswith(".csv")]
    return [(magnet, key) for key in ("table", "mesh") if key in magnet] + curves


def companions(actuator: Actuator) -> dict[Path, str]:
    """Files that the actuator names, and what they are called beside actuator.toml."""
    named = [section[key] for section, key in file_keys(document(actuator))]
    return {actuator.folder / name: Path(name).name for name in named}


def check_companions(actuator: Actuator) -> None:
    """Errors where a file is not what the actuator names it as.

    Raises
    ------
    RecordError : a mesh that lies outside the actuator's folder, or is no file
    TableError, MaterialError : no table, no B-H curve
    """
    for section, key in file_keys(document(actuator)):
        if key == "table":
            read_table(actuator.folder / section[key])
        elif key == "mesh":
            _check_mesh(section[key], actuator)
        else:
            load_iron(section[key], folder=actuator.folder)


def _check_mesh(name: str, actuator: Actuator) -> None:
    folder = actuator.folder.resolve()
    inside = "\0" not in name and (folder / name).resolve().is_relative_to(folder)
    if not inside or not (folder / name).is_file():
        raise RecordError(
            f"{actuator.file or actuator.name}: magnet.mesh: '{name}' is no file in the actuator's folder or below, "
            "and no other comes along with a record; copy it there"
        )
