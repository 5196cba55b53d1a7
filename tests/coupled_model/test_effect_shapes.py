"""What the shapes of effects do: spread eddy currents, a core that warms, friction that falls over velocity, iron that
was magnetised before the run."""

import numpy as np
import pytest
from coupled_cases import changed, linear_table, locked
from effect_cases import effects, rig
from scipy.linalg import expm

from msl_fem.actuator import Actuator
from msl_fem.coupled_model.inputs import Inputs
from msl_fem.coupled_model.simulate import Options, simulate

INDUCTANCE = 2 * 1.08e-5 / 6.3e-4  # of a side of two magnets of `linear_table`, H


@pytest.mark.parametrize("frequency", [50.0, 200.0, 800.0])
def test_eddy_currents_in_sheets_follow_the_diffusion_equation(servo: Actuator, frequency: float) -> None:
    """Current over flux is (1 + (3 tau/T)(q coth q - 1))/L, q^2 = j w T, up to two skin depths a sheet."""
    tau, diffusion, rate, n = 1e-3, 2e-3, 100e3, int(100e3 / frequency)
    turns = 2 * np.pi * frequency * np.arange(12 * n) / rate
    command = 1.0 + 0.2 * np.sin(turns)
    run = simulate(
        locked(servo), linear_table(), Inputs(np.column_stack([command, command]), rate),
        effects=effects("eddy_currents", time_constant=tau, diffusion_time=diffusion),
        options=Options(currents=(1.0, 1.0), substeps=6),
    )  # fmt: skip
    turn = np.exp(-1j * turns[-n:])
    ratio = np.mean(run.current[-n:, 0] * turn) / np.mean(run.flux_linkage[-n:, 0] * turn) * INDUCTANCE
    q = np.sqrt(2j * np.pi * frequency * diffusion)
    expected = 1 + 3 * tau / diffusion * (q / np.tanh(q) - 1)
    assert ratio - 1 == pytest.approx(expected - 1, rel=0.02)
    alone = 1 + 2j * np.pi * frequency * tau
    assert abs(expected - alone) > 2 * abs(ratio - expected), "a single loop is another thing"
    assert abs(run.audit.imbalance) < 1e-6
    assert run.audit.eddy_currents > 0


def test_a_coil_warms_towards_its_core(servo: Actuator) -> None:
    """rho' = h P - c (rho - kappa), kappa' = r (rho - kappa) with P = R (1 + rho) i^2 at a held current."""
    h, c, r, current = 0.02, 1.5, 0.3, 2.0
    run = simulate(
        locked(servo), linear_table(), Inputs(np.full((4000, 2), [current, 0.0]), 1e3),
        effects=effects("coil_heating", rise_per_joule=h, cooling_rate=c, core_rate=r),
        options=Options(currents=(current, 0.0)),
    )  # fmt: skip
    power = 2.0 * current**2  # two coils of 1 ohm in series
    matrix = np.array([[h * power - c, c, h * power], [r, -r, 0.0], [0.0, 0.0, 0.0]])
    rise = np.array([expm(matrix * t)[0, 2] for t in run.time[::500] + 0.5e-3])
    assert run.voltage[::500, 0] / current / 2.0 - 1 == pytest.approx(rise, rel=2e-3, abs=2e-6)
    assert rise[-1] > 1.15 * rise[4], "the core goes on warming"


def test_friction_at_a_steady_velocity_falls_as_stated() -> None:
    """Push = c v + F (1 + rise/(1 + (v/v_s)^2)) at the velocities where the mover settles."""
    loose = rig(stiffness="0 N/m", damping="40 N s/m")
    values = effects("coulomb_friction", force=1.0, presliding=1e-6, stribeck_rise=0.5, stribeck_velocity=5e-3)
    for push in (1.6, 2.5):
        run = simulate(loose, None, Inputs(np.full((4000, 1), push), 2e3), effects=values)
        v = float(np.diff(run.position[-200:]).mean() * 2e3)
        assert v > 1e-3
        assert push == pytest.approx(40 * v + 1.0 + 0.5 / (1 + (v / 5e-3) ** 2), rel=1e-4)
        assert abs(run.audit.imbalance) < 1e-5


def test_iron_was_demagnetised_before_the_currents_rose(servo: Actuator) -> None:
    """At the start of a run with 1 A the branch is the rising one: its flux is of 1 A less the coercive current."""
    slow = changed(servo, drive={"bandwidth": 50.0}, motion={"moving_mass": 1e24})
    run = simulate(
        slow, linear_table(), Inputs(np.full((20, 2), [1.0, 0.0]), 1e3),
        effects=effects("magnetic_hysteresis", coercive_current=0.05, reversal_current=0.2),
        options=Options(currents=(1.0, 0.0)),
    )  # fmt: skip
    assert run.flux_linkage[:, 0] == pytest.approx(INDUCTANCE * 0.95, rel=1e-9)
    assert run.current[:, 0] == pytest.approx(1.0, rel=1e-9)
