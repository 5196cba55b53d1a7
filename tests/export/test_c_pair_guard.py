"""The C header of a pair's guard is printed from the Python, compiles without a warning and judges alike to the bit."""

import subprocess
from pathlib import Path

import numpy as np
import pytest
from c_programs import VARIANTS, any_doubles, assert_same_bits, compile_c
from conftest import ROOT

from msl_fem.cli.app import app
from msl_fem.cli.output import run_guarded
from msl_fem.export.c_pair_guard import pair_check_points, write
from msl_fem.maps.pair_guard import PairGuard, pair_limit_at
from msl_fem.maps.pair_limits import PairMap, pair_map
from msl_fem.maps.pair_map_file import write_pair_map
from msl_fem.table.pair_table import read_pair_table

TABLE = ROOT / "lookup_tables/fast_tool_servo_pair.nc"
N_POINTS = 200_000
PROGRAM = r"""
#include <stdio.h>
#include "exported.h"
int main(void)
{
    double point[3], out[3];
    while (fread(point, sizeof point[0], 3, stdin) == 3) {
        out[0] = (double)m_pair_guard_region(point[0], point[1], point[2]);
        out[1] = m_pair_guard_limit(0, 1, point[2], point[0]);
        out[2] = m_pair_guard_limit(1, 0, point[2], point[1]);
        if (fwrite(out, sizeof out[0], 3, stdout) != 3)
            return 200;
    }
    return m_pair_guard_self_check();
}
"""


@pytest.fixture(scope="module")
def made() -> PairMap:
    return pair_map(read_pair_table(TABLE))


@pytest.fixture(scope="module")
def judged(made: PairMap) -> tuple[np.ndarray, np.ndarray]:
    """(n, 3) currents and positions, hard ones among them, and (n, 3) regions and limits as Python has them."""
    guard, rng = PairGuard(made), np.random.default_rng(7)
    one, two = rng.uniform(-13, 13, (2, N_POINTS)) * rng.choice([1.0, 0.2], (2, N_POINTS))
    position = rng.uniform(-0.6e-3, 0.6e-3, N_POINTS)
    for values, start in ((one, 0), (two, 1), (position, 2)):
        values[start::50] = any_doubles(rng, values[start::50].size)
    fixed = pair_check_points(guard)
    for values, checked in zip((one, two, position), fixed, strict=True):
        values[: checked.size] = checked
    limits = [
        [pair_limit_at(guard.arrays, relation, level, x, j) for x, j in zip(position, other, strict=True)]
        for relation, level, other in ((0, 1, one), (1, 0, two))
    ]
    return np.column_stack([one, two, position]), np.column_stack([guard.regions(one, two, position), *limits])


@pytest.mark.parametrize("variant", VARIANTS)
def test_c_says_the_same_as_python_to_the_last_bit(
    made: PairMap, judged: tuple[np.ndarray, np.ndarray], variant: str, tmp_path: Path
) -> None:
    given, answers = judged
    write(made, tmp_path / "exported.h", name="m")
    program = compile_c(tmp_path, PROGRAM, variant, "-lm")
    done = subprocess.run([program], input=given.tobytes(), capture_output=True, check=False)
    assert done.returncode == 0
    found = np.frombuffer(done.stdout).reshape(-1, 3)
    assert np.array_equal(found[:, 0], answers[:, 0])
    assert_same_bits(found[:, 1:], answers[:, 1:])


def test_the_command_writes_it(made: PairMap, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source, target = write_pair_map(made, tmp_path / "pair.json"), tmp_path / "pair.h"
    assert run_guarded(lambda: app(["export", str(source), "--to", "c", "-o", str(target)])) == 0
    assert "fast_tool_servo_pair_guard_region" in target.read_text()
    assert run_guarded(lambda: app(["export", str(source), "--to", "csv", "-o", str(target)])) == 2
    assert len(capsys.readouterr().err.strip().splitlines()) == 1
