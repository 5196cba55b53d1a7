"""What a command loads: help, a look-up and a judgement load no library of theirs that takes long to import."""

import inspect
import re
import subprocess
import sys
from importlib import import_module
from typing import Any

import pytest

from msl_fem.cli.app import COMMANDS, stand_in

HEAVY = {
    "numba",
    "scipy",
    "pandas",
    "xarray",
    "pint",
    "skfem",
    "netgen",
    "matplotlib",
    "plotly",
    "optuna",
    "sqlalchemy",
}
HEAVY_FOR_HELP = HEAVY | {"numpy", "h5py", "h5netcdf"}


def loaded(*words: str) -> set[str]:
    """The modules, by their first names, that a process has loaded when the command is done."""
    code = (
        f"import sys; sys.argv = ['msl-fem', *{list(words)}]\n"
        "from msl_fem.cli.__main__ import main\n"
        "try: main()\n"
        "except SystemExit as leaving: assert not leaving.code, leaving.code\n"
        "print(*{name.partition('.')[0] for name in sys.modules}, file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout
    return set(done.stderr.splitlines()[-1].split())


@pytest.mark.parametrize("command", COMMANDS)
def test_help_shows_the_options_of_the_command(command: str) -> None:
    module, _, name = COMMANDS[command].partition(":")
    real, shown = getattr(import_module(module), name), stand_in(COMMANDS[command])
    assert signature(shown) == signature(real)
    assert shown.__doc__ == real.__doc__


def signature(function: Any) -> str:
    return re.sub(r" at 0x\w+", "", str(inspect.signature(function)))


def test_help_loads_nothing_heavy() -> None:
    assert not loaded("size", "--help") & HEAVY_FOR_HELP
    assert not loaded("--help") & HEAVY_FOR_HELP
