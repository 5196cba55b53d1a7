"""The current loop in the controller's header gives voltages to the last bit, in the table and far beyond it."""

import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from c_programs import assert_same_bits, compile_c
from servo_controllers import TABLE, servo, servo_design, servo_map

from msl_fem.actuator.current_loop import CurrentLoop
from msl_fem.control import design_model_of
from msl_fem.control.current_step import N_LIMITED, N_STATE, current_step
from msl_fem.export.c_controller import ControllerSource, controller_header

BOARD = r"""
#include <stdio.h>
#include "exported.h"
int main(void)
{
    m_current_loop l;
    double in[6], out[2];
    if (m_controller_self_check() || m_current_loop_self_check())
        return 3;
    m_current_loop_start(&l);
    while (fread(in, sizeof in[0], 6, stdin) == 6) {
        m_current_loop_step_at(&l, in, in + 2, in[4], in[5], out);
        if (fwrite(out, sizeof out[0], 2, stdout) != 2)
            return 2;
    }
    fprintf(stderr, "%lu", l.limited);
    return 0;
}
"""


@pytest.mark.parametrize("corner", [None, 10.0], ids=["table", "observed"])
def test_every_voltage_is_that_of_python(tmp_path: Path, corner: float | None) -> None:
    section = CurrentLoop.model_validate({"flux_corner": None if corner is None else f"{corner} Hz"})
    rig = servo(drive={"kind": "voltage", "bandwidth": None, "current_loop": section})
    loop = design_model_of(rig, TABLE, servo_map()).current_loop
    assert loop is not None
    parameters = loop.parameters._replace(leakage_1=2e-3, leakage_2=3e-3, mutual=-2e-4)
    design = replace(servo_design(), current_loop=replace(loop, parameters=parameters))
    (tmp_path / "exported.h").write_text(controller_header(ControllerSource(design, servo_map()), name="m"))
    board = compile_c(tmp_path, BOARD, "gcc -O2", "-Wl,--no-as-needed", "-lm")
    rng, n = np.random.default_rng(3), 3000
    wanted = np.abs(np.cumsum(rng.standard_normal((n, 2)), axis=0)) * 0.2
    read = wanted + 0.1 * rng.standard_normal((n, 2))
    rows = np.column_stack([wanted, read, 7e-4 * rng.uniform(-1, 1, (n, 2))])
    rows[100, 2], rows[200, 4], rows[300, 0], rows[400, 5] = np.nan, np.inf, -np.inf, np.nan
    done = subprocess.run([board], input=rows.tobytes(), capture_output=True, check=False)
    assert done.returncode == 0, f"self-check or pipe: {done.returncode}"
    state, voltage = np.zeros(N_STATE), np.zeros((n, 2))
    for row, out in zip(rows, voltage, strict=True):
        current_step(parameters, state, row[:2], row[2:4], float(row[4]), float(row[5]), out)
    assert_same_bits(np.frombuffer(done.stdout).reshape(-1, 2), voltage)
    assert int(done.stderr) == state[N_LIMITED]
    assert 0 < state[N_LIMITED] < 2 * n
    assert (np.abs(voltage) < 80.0).any(axis=0).all()
