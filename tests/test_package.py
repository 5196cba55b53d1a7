"""The package's door: its verbs are functions, whatever was imported before."""

import inspect
import re
import subprocess
import sys

import pytest
from conftest import ROOT

import msl_fem
from msl_fem.table.magnetic_table import MagneticTable, read_table

VERBS = ("load_actuator", "solve", "sweep", "operating_map", "simulate", "identify", "design_controller", "diagnose")


@pytest.mark.parametrize("verb", VERBS)
def test_a_verb_is_a_function_every_time(verb: str) -> None:
    assert callable(getattr(msl_fem, verb))
    assert callable(getattr(msl_fem, verb)), "and still is after its module was imported"
    assert verb in dir(msl_fem)


def test_modules_of_a_verb_s_name_can_still_be_imported_from() -> None:
    from msl_fem.magnetics.sweep.table_sweep import default_grid
    from msl_fem.maps import Guard

    assert Guard.__name__ == "Guard"
    assert callable(default_grid)
    with pytest.raises(AttributeError, match="no attribute 'conjure'"):
        _ = msl_fem.conjure


def test_control_needs_no_finite_elements() -> None:
    """With scikit-fem and netgen made unimportable, the model half works."""
    code = (
        "import sys\n"
        "sys.modules['skfem'] = sys.modules['netgen'] = None\n"
        "import msl_fem.control, msl_fem.identification, msl_fem.plant, msl_fem.maps\n"
        "import msl_fem; assert callable(msl_fem.simulate) and callable(msl_fem.operating_map)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_first_lines_of_a_notebook() -> None:
    """Load, look at, draw: short lines, and a figure that matplotlib shows."""
    from matplotlib.figure import Figure

    actuator = msl_fem.load_actuator("fast_tool_servo")
    assert repr(actuator) == "Actuator(fast_tool_servo: e-core, 0.9 kg at 0.6 mm, 2 x 2 magnets, current drive)"
    assert isinstance(msl_fem.draw(actuator), Figure)


def test_the_map_s_signature_says_what_it_takes_and_gives(table: MagneticTable) -> None:
    signature = inspect.signature(msl_fem.operating_map)
    assert list(signature.parameters) == ["source", "gap", "levels", "further"]
    assert signature.return_annotation == "OperatingMap"
    made = msl_fem.operating_map(table, table.gap[:3], levels=(0.5, 1.0))
    assert made.current.shape == (2, 3)


def test_the_run_of_the_notebook_s_first_lines_stays_in_range() -> None:
    """The excitation on the page about notebooks, taken from there."""
    page = (ROOT / "docs" / "python.md").read_text(encoding="utf-8")
    spec, rate = re.findall(r'excitation_inputs\(actuator, "([^"]+)", rate=([0-9e]+)\)', page)[0]
    actuator = msl_fem.load_actuator("fast_tool_servo")
    inputs = msl_fem.excitation_inputs(actuator, spec, rate=float(rate))
    run = msl_fem.simulate(actuator, read_table(ROOT / "lookup_tables" / "fast_tool_servo.nc"), inputs)
    assert 1e-6 < abs(run.position).max() < 5e-4
