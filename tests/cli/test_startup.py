"""What a command loads: help, a look-up and a judgement load no library of theirs that takes long to import."""

import inspect
import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from msl_fem.cli.app import COMMANDS, stand_in
from msl_fem.maps import Guard, operating_map, write_map
from msl_fem.maps.guard import limit_at, margin_of, reason_of, region_of
from msl_fem.table import MagneticTable, read_table
from msl_fem.table.coenergy_surface import STATES, evaluate_many

ROOT = Path(__file__).parents[2]

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


def test_a_lookup_loads_nothing_heavy() -> None:
    table = str(ROOT / "lookup_tables" / "fast_tool_servo.nc")
    assert not loaded("lookup", table, "--current", "5 A", "--gap", "0.5 mm") & (HEAVY | {"h5netcdf"})


def test_a_judgement_loads_nothing_heavy(tmp_path: Path) -> None:
    table = read_table(ROOT / "lookup_tables" / "fast_tool_servo.nc")
    write_map(operating_map(table), tmp_path / "map.json")
    words = ("guard", str(tmp_path / "map.json"), "--current", "5 A", "--gap", "0.5 mm")
    assert not loaded(*words) & (HEAVY | {"h5py", "h5netcdf"})


def test_the_model_half_loads_nothing_heavy() -> None:
    """A control engineer who imports `msl_fem.control` waits for none of them."""
    code = "import sys, msl_fem.control; print(*{name.partition('.')[0] for name in sys.modules})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not set(done.stdout.split()) & HEAVY


def test_fields_wait_for_no_fit_and_no_plotter() -> None:
    """What fits measured forces, and what draws, is imported where something is fitted or drawn."""
    code = "import sys, msl_fem.cli.table, msl_fem.cli.solve; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not set(done.stdout.split()) & {"scipy.optimize", "matplotlib", "plotly"}


def test_who_has_a_table_waits_for_no_mesher() -> None:
    names = ("simulate", "import_log", "losses", "control", "compare", "diagnose", "calibrate", "export", "bench")
    modules = ", ".join(f"msl_fem.cli.{name}" for name in names)
    code = f"import sys, {modules}; print(*{{name.partition('.')[0] for name in sys.modules}})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not set(done.stdout.split()) & {"netgen", "skfem", "optuna", "sqlalchemy"}


def test_few_points_by_python_are_those_of_the_machine_code(table: MagneticTable) -> None:
    """To the last bit, inside, on the edges, outside and for what is not a number."""
    surface, guard = table.surface, Guard(operating_map(table)).arrays
    generator = np.random.default_rng(0)
    i = np.r_[generator.uniform(-13, 13, 300), 0.0, -0.0, np.nan, np.inf, surface.current[-1], -surface.current[-1]]
    g = np.r_[generator.uniform(4e-5, 1.3e-3, 300), surface.gap[[0, -1, 1, 2]], np.nan, 5e-4]
    arrays = (surface.gap, surface.current, surface.coefficients, i, g)
    out, by_python = np.empty((STATES, i.size)), np.empty((STATES, i.size))
    evaluate_many(*arrays, out)
    evaluate_many.interpreted(*arrays, by_python)  # type: ignore[attr-defined]
    np.testing.assert_array_equal(out, by_python)
    for function in (limit_at, margin_of, reason_of, region_of):
        for point in zip(i, g, strict=True):
            given = (guard, 0, point[1]) if function is limit_at else (guard, *point)
            np.testing.assert_equal(function(*given), function.interpreted(*given))
