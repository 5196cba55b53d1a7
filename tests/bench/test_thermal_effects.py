"""Heat of what was done before a run: against an integrator, and as the resistance that a run begins with."""

import numpy as np
import pytest
from bench_rigs import RATE, setting_in
from scipy.integrate import solve_ivp

from msl_fem.bench.catalogue import INSIDE
from msl_fem.bench.equations import thermal_rates, warm_resistance
from msl_fem.bench.plant import Thermal
from msl_fem.bench.running import run_rig
from msl_fem.bench.thermal_effects import warmed

NODES = Thermal(0.8, 0.2, 0.5, 8.0)


def test_work_and_pause_by_another_route() -> None:
    """The matrix exponential against the bench's own rates, integrated: 1 W for 5 s, then a pause of 0.3 s."""
    rates = thermal_rates.py_func

    def heat(power: float, span: float, start: np.ndarray) -> np.ndarray:
        found = solve_ivp(lambda t, y: rates(NODES, y[0], y[1], power), (0, span), start, rtol=1e-10, atol=1e-12)
        return found.y[:, -1]

    expected = heat(0.0, 0.3, heat(1.0, 5.0, np.zeros(2)))
    assert warmed(NODES, work=5.0, pause=0.3) == pytest.approx(expected, rel=1e-7)
    assert warmed(NODES, work=1e4, pause=0.0) == pytest.approx([1.0, 0.2], rel=1e-9)


def test_a_run_begins_with_the_resistance_of_its_history() -> None:
    """R i + d lambda/dt = v in the first sample, side 1 as warm as asked for, side 2 less; then both cool."""
    it = setting_in("voltage", duration=0.2)
    rig, parameters = INSIDE["thermal_history"].hide(it, it.rig, 30.0)
    assert parameters["rise"] == 30.0
    assert 0 < parameters["core_rise"] < 30.0
    assert rig.warm[2] == pytest.approx(parameters["other_side"] * 30.0)
    run = run_rig(rig, it.commands[0], rate=RATE)
    coil = run.end_state[-4:]
    assert np.all(coil[[0, 2]] < [rig.warm[0], rig.warm[2]])
    assert np.all(coil[[0, 2]] > [rig.warm[1], rig.warm[3]])
    cold = rig.plant.circuit.resistance
    assert warm_resistance.py_func(cold, rig.warm[0]) > 1.1 * cold
