"""A coil that begins warm: its resistance by the closed form of two nodes, and no more heat than it began with."""

import numpy as np
import pytest
from coupled_twin import linear_table, locked

from msl_fem.actuator import Actuator
from msl_fem.plant import Options, simulate
from msl_fem.plant.effects import EffectValues
from msl_fem.plant.excitation import Inputs

RATE, RISE, CORE = 1.5, (0.08, -0.02), 0.03


def _resistances(servo: Actuator, values: EffectValues) -> np.ndarray:
    """Of both sides over time, from voltage and current at a held current of the locked mover."""
    inputs = Inputs(np.full((300, 2), [3.0, 2.0]), 1e3)
    run = simulate(locked(servo), linear_table(), inputs, effects=values, options=Options(currents=(3.0, 2.0)))
    return np.asarray(run.voltage[:-1] / run.current[:-1])


def test_coils_settle_towards_the_core(servo: Actuator) -> None:
    """rho_j = core + (rise_j - core) e^(-rate t), in the mean of a sample; v = R (1 + rho) i."""
    stated = {"rise_1": RISE[0], "rise_2": RISE[1], "core_rise": CORE, "settling_rate": RATE, "core_rate": 1e-6}
    found = _resistances(servo, EffectValues({"thermal_history": stated}))
    time = np.arange(299) / 1e3
    fall = (np.exp(-RATE * time) - np.exp(-RATE * (time + 1e-3))) / (RATE * 1e-3)
    for j, rise in enumerate(RISE):
        assert found[:, j] == pytest.approx(2.0 * (1 + CORE + (rise - CORE) * fall), rel=2e-7)


def test_beside_heating_a_coil_has_its_rates_once(servo: Actuator) -> None:
    """A start that coil_heating states too is the same run, where both state the same rates; a trace of history moves
    the rates of heating by a trace."""
    heating = {"rise_per_joule": 0.01, "cooling_rate": 0.7, "core_rate": 0.02}
    one = _resistances(servo, EffectValues({"coil_heating": heating | {"initial_rise": 0.05}}))
    warm = {"rise_1": 0.05, "rise_2": 0.05, "settling_rate": 0.7, "core_rate": 0.02}
    two = _resistances(servo, EffectValues({"coil_heating": heating, "thermal_history": warm}))
    assert two == pytest.approx(one, rel=1e-13)
    alone = _resistances(servo, EffectValues({"coil_heating": heating}))
    trace = {"rise_1": 1e-9, "settling_rate": 9.0}
    beside = _resistances(servo, EffectValues({"coil_heating": heating, "thermal_history": trace}))
    assert beside == pytest.approx(alone, rel=1e-8)
