"""A map that a command is given, and what speaks against it."""

from pathlib import Path

from msl_fem.actuator import Actuator
from msl_fem.cli.output import say
from msl_fem.maps import OperatingMap, read_map
from msl_fem.maps.doubts import doubt_about_map, falls_unsaid


def given_map(path: Path, actuator: Actuator | None = None) -> OperatingMap:
    """The map in a file, after a line for each thing that speaks against it (and against its use for an actuator)."""
    record = read_map(path)
    doubt = None if actuator is None else doubt_about_map(actuator, record)
    for said in (*record.warnings, *falls_unsaid(record), *filter(None, [doubt])):
        say(f"note: {path}: {said}")
    return record
