"""Models and lookups with the table of a pair, as C and as FMU: the bits and the runs of Python."""

import subprocess
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from c_programs import VARIANTS, compile_c
from conftest import ROOT
from coupled_twin import shared_coenergy
from effect_sets import ALL_EFFECTS
from fmpy.validation import validate_fmu
from fmu_master import Master, assert_equal_runs, cases, exported, run_in_python, steps

from msl_fem.actuator import Actuator
from msl_fem.export.c_pair_table import pair_table_header
from msl_fem.plant import Options, simulate
from msl_fem.plant.effects import EffectValues
from msl_fem.plant.excitation import Inputs
from msl_fem.table.magnetic_table import MagneticTable
from msl_fem.table.pair_table import PairTable, read_pair_table, save_table

SERVO = str(ROOT / "geometries" / "fast_tool_servo.toml")
Run = Callable[..., "Outcome"]  # noqa: F821 - the fixture's type, tests/conftest.py
PROGRAM = """
#include <stdio.h>
#include "exported.h"
/* triples (position, current 1, current 2) on stdin; ten doubles for each on stdout */
int main(void)
{
    double at[3], out[10];
    while (fread(at, sizeof at[0], 3, stdin) == 3) {
        (void)m_pair_evaluate(at[0], at[1], at[2], out);
        if (fwrite(out, sizeof out[0], 10, stdout) != 10)
            return 2;
    }
    return m_pair_self_check() || m_table_self_check();
}
"""


@pytest.fixture(scope="module")
def both(table: MagneticTable) -> MagneticTable:
    return replace(table, shared=shared_coenergy("curved", largest=12.0))


@pytest.fixture(scope="module")
def lookup(both: MagneticTable, tmp_path_factory: pytest.TempPathFactory) -> PairTable:
    return read_pair_table(save_table(both, tmp_path_factory.mktemp("pair") / "pair.nc"))


@pytest.mark.parametrize("kind", ["current", "voltage"])
def test_the_fmu_runs_as_python_does(servo: Actuator, both: MagneticTable, tmp_path: Path, kind: str) -> None:
    actuator = cases(servo)[kind][0]
    archive = exported(actuator, both, tmp_path)
    assert validate_fmu(str(archive)) == []
    commands = steps([1.5, 1.0], n=300)
    wanted = run_in_python(actuator, both, commands)
    found = Master(archive).initialise().run(commands, sides=2, disturbance=3.0)
    assert_equal_runs(found, wanted, within=1e-10)
    apart = run_in_python(actuator, replace(both, shared=None), commands)
    change = np.abs(apart.flux_linkage - wanted.flux_linkage).max()
    assert change > 1e-3 * np.abs(wanted.flux_linkage).max()  # the table of the pair does make a difference


def test_the_fmu_with_effects_runs_as_python_does(servo: Actuator, both: MagneticTable, tmp_path: Path) -> None:
    effects = EffectValues(
        {name: dict(ALL_EFFECTS.stated[name]) for name in ("gap_offset", "eddy_currents", "fringing")}
    )
    master = Master(exported(servo, both, tmp_path, effects=effects)).initialise()
    commands = steps([0.5, 0.3], n=120)
    substeps = max(1, int(np.ceil(1e-4 / master.get("largest_step")[0] - 1e-9)))
    wanted = simulate(servo, both, Inputs(commands, 1e4, 3.0), effects=effects, options=Options(substeps=substeps))
    found = master.run(commands, sides=2, disturbance=3.0)
    for name in ("position", "current", "flux_linkage"):
        reference = getattr(wanted, name)
        np.testing.assert_allclose(found[name], reference, rtol=0, atol=1e-9 * np.abs(reference).max(), err_msg=name)


@pytest.mark.parametrize("variant", VARIANTS)
def test_a_lookup_in_c_gives_the_bits_of_python(lookup: PairTable, tmp_path: Path, variant: str) -> None:
    (tmp_path / "exported.h").write_text(pair_table_header(lookup, name="m"))
    program = compile_c(tmp_path, PROGRAM, variant, "-lm")
    rng = np.random.default_rng(3)
    points = rng.uniform([axis[0] for axis in lookup.axes], [axis[-1] for axis in lookup.axes], (200, 3))
    done = subprocess.run([program], input=points.tobytes(), capture_output=True, check=False)
    assert done.returncode == 0
    found = np.frombuffer(done.stdout).reshape(-1, 10)
    assert np.array_equal(found, np.stack(list(lookup.evaluate(*points.T).values()), axis=-1))


@pytest.mark.parametrize("what", [("fmu",), ("c", "--what", "controller")])
def test_models_leave_by_the_command(msl_fem: Run, both: MagneticTable, tmp_path: Path, what: tuple[str, ...]) -> None:
    target, pair = tmp_path / "made", save_table(both, tmp_path / "pair.nc")
    assert msl_fem("export", SERVO, "--table", str(pair), "--to", *what, "-o", str(target)).status == 0
    assert target.stat().st_size > 0


def test_a_lookup_leaves_by_the_command(msl_fem: Run, both: MagneticTable, tmp_path: Path) -> None:
    target, pair = tmp_path / "pair.h", save_table(both, tmp_path / "pair.nc")
    assert msl_fem("export", str(pair), "--to", "c", "--name", "m", "-o", str(target)).status == 0
    assert "m_pair_evaluate" in target.read_text()
