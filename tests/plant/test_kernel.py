"""The compiled time loop: accuracy, order, energy, and how it ends."""

import numpy as np
import pytest
from coupled_twin import changed, reference_run

from msl_fem.actuator import Actuator
from msl_fem.plant import kernel, layout
from msl_fem.plant.excitation import Inputs
from msl_fem.plant.layout import (
    AT_CURRENT_LIMIT_2,
    I1,
    I2,
    N_STATE,
    NOT_FINITE,
    OK,
    OUTSIDE_RANGE,
    OUTSIDE_TABLE,
    SENSOR,
    V,
    X,
    initial_state,
)
from msl_fem.plant.plant import plant_parameters, surface_of
from msl_fem.plant.simulate import Options, simulate
from msl_fem.table.magnetic_table import MagneticTable

CHANNELS = ("current", "position", "velocity", "measured_position", "voltage")


def gentle(n: int, *, seed: int = 3) -> Inputs:
    """Correlated currents about 0.5 A that do not meet the voltage limit, after a slow start."""
    noise = np.random.default_rng(seed).standard_normal((n, 2))
    smooth = np.cumsum(noise, axis=0) / np.sqrt(np.arange(1, n + 1))[:, None]
    rise = np.minimum(np.arange(n) / 20, 1.0)[:, None]
    return Inputs(rise * (0.5 + 0.05 * smooth), 1e4, 3.0 * noise[:, 0])


def test_the_fixed_step_agrees_with_an_adaptive_integrator(servo: Actuator, table: MagneticTable) -> None:
    """The default step's error on the reference actuator, as `default_substeps` states it."""
    inputs = gentle(60)
    run, reference = simulate(servo, table, inputs), reference_run(servo, table, inputs)
    assert run.substeps == 10
    assert not run.samples_at_voltage_limit.any()
    for channel in CHANNELS:
        error = np.abs(getattr(run, channel) - reference[channel]).max() / np.abs(reference[channel]).max()
        assert error < 1e-7, channel


def test_the_voltage_limit_costs_accuracy_as_stated(servo: Actuator, table: MagneticTable) -> None:
    """Steps that meet the limit of 80 V: 1e-4 of full scale at the default step, and less with more steps."""
    inputs = Inputs(np.repeat([[0.0, 0.0], [3.0, 0.0], [0.5, 2.0], [1.0, 0.3]], 4, axis=0), 1e4)
    reference = reference_run(servo, table, inputs)
    errors = []
    for substeps in (10, 160):
        run = simulate(servo, table, inputs, options=Options(substeps=substeps))
        assert run.samples_at_voltage_limit.min() >= 2
        errors.append(np.abs(run.current - reference["current"]).max() / 3.0)
    assert errors[0] < 2e-4
    assert errors[1] < 2e-6


@pytest.mark.parametrize("kind", ["current", "voltage"])
def test_the_order_of_convergence_is_four(servo: Actuator, table: MagneticTable, kind: str) -> None:
    bench = changed(servo, drive={"kind": kind, "bandwidth": 1000.0}, position_sensor={"bandwidth": 3000.0})
    plant, surface = plant_parameters(bench), surface_of(table)
    command = np.array([1.3, 0.8]) if kind == "current" else np.array([6.0, 1.0])

    def end(steps: int) -> np.ndarray:
        state = initial_state(plant, 1.0, 0.9, 1e-4, -0.05)
        assert kernel.advance(surface, plant, None, state, command, 5.0, 4e-4 / steps, steps, np.zeros(2)) == OK
        return state[[I1, I2, X, V, SENSOR]]

    finest = end(1024)
    errors = np.array([np.abs(end(steps) - finest) for steps in (16, 32, 64)])
    orders = np.log2(errors[:-1] / errors[1:])
    assert orders[-1] == pytest.approx(np.full(5, 4.0), abs=0.15)


def test_run_is_advance_repeated(servo: Actuator, table: MagneticTable) -> None:
    plant, surface, inputs = plant_parameters(servo), surface_of(table), gentle(50)
    state, voltage = initial_state(plant, 0.0, 0.0, 1e-5, 0.0), np.zeros(2)
    together = state.copy()
    out = np.empty((50, layout.N_OUT))
    push = np.asarray(inputs.disturbance)
    assert kernel.run(surface, plant, None, together, inputs.commands, push, 2e-5, 5, out, False) == (OK, 50)
    for k in range(50):
        assert out[k, layout.OUT_X] == state[X]
        assert kernel.advance(surface, plant, None, state, inputs.commands[k], push[k], 2e-5, 5, voltage) == OK
        assert (out[k, [layout.OUT_VOLTAGE_1, layout.OUT_VOLTAGE_2]] == voltage).all()
    assert (state == together).all()


@pytest.mark.parametrize(
    "drive",
    [
        {"kind": "current"},
        {"kind": "current", "bandwidth": None},
        {"kind": "voltage", "bandwidth": None},
        {"kind": "voltage", "bandwidth": 2000.0},
    ],
)
@pytest.mark.parametrize("connection", ["series", "parallel"])
def test_the_energy_ledger_closes(
    servo: Actuator, table: MagneticTable, drive: dict[str, object], connection: str
) -> None:
    """Electrical input and outside work = copper and damping loss + change of field and mechanical energy, to 1e-6."""
    rng = np.random.default_rng(8)
    bench = changed(servo, drive=drive, sides={"connection": connection}, motion={"constant_force": 4.0})
    commands = (0.45 if connection == "series" else 0.9) * (1 + 0.3 * rng.standard_normal((2000, 2)))
    resistance = plant_parameters(bench).resistance
    commands *= resistance if drive["kind"] == "voltage" else 1.0
    run = simulate(bench, table, Inputs(commands, 1e4, 5 * rng.standard_normal(2000)), options=Options(substeps=20))
    audit = run.audit
    assert min(abs(audit.field), audit.mechanical, audit.damping, abs(audit.external)) > 1e-5
    assert abs(audit.imbalance) < 1e-6


def test_the_state_stays_where_a_run_ends(servo: Actuator, table: MagneticTable) -> None:
    """Each way to end leaves the last good state, and says which way it was."""
    plant, surface, voltage = plant_parameters(servo), surface_of(table), np.zeros(2)
    state = initial_state(plant, 1.0, 1.0, 0.0, 0.0)

    before = state.copy()
    assert kernel.advance(surface, plant, None, state, np.array([1.0, np.nan]), 0.0, 1e-5, 10, voltage) == NOT_FINITE
    assert (state == before).all()

    status = kernel.advance(surface, plant, None, state, np.array([8.0, 0.0]), 0.0, 1e-5, 10_000, voltage)
    assert status == OUTSIDE_RANGE
    assert 4.9e-4 < state[X] <= 5e-4

    far = plant._replace(travel=np.inf)
    state = initial_state(far, 1.0, 1.0, 0.0, 0.0)
    assert kernel.advance(surface, far, None, state, np.array([8.0, 0.0]), 0.0, 1e-5, 10_000, voltage) == OUTSIDE_TABLE
    assert 5e-4 < state[X] < 5.5e-4  # the table begins at a gap of 0.05 mm
    assert np.isfinite(state).all()

    beyond = plant._replace(current_limit=np.inf)
    state = initial_state(beyond, 11.0, 11.0, 0.0, 0.0)
    assert (
        kernel.advance(surface, beyond, None, state, np.array([13.0, 13.0]), 0.0, 1e-5, 1000, voltage) == OUTSIDE_TABLE
    )
    assert 11.5 < state[I1] <= 12.0


def test_a_command_beyond_the_current_limit_is_clipped_and_counted(servo: Actuator, table: MagneticTable) -> None:
    plant, surface = plant_parameters(changed(servo, motion={"moving_mass": 1e9})), surface_of(table)
    clipped, at_limit = initial_state(plant, 0.0, 0.0, 0.0, 0.0), initial_state(plant, 0.0, 0.0, 0.0, 0.0)
    for _ in range(3):
        kernel.advance(surface, plant, None, clipped, np.array([0.0, 40.0]), 0.0, 1e-5, 100, np.zeros(2))
        kernel.advance(surface, plant, None, at_limit, np.array([0.0, 12.0]), 0.0, 1e-5, 100, np.zeros(2))
    assert clipped[AT_CURRENT_LIMIT_2] == 3
    assert at_limit[AT_CURRENT_LIMIT_2] == 0
    clipped[AT_CURRENT_LIMIT_2] = 0
    assert (clipped == at_limit).all()
    assert clipped.shape == (N_STATE,)
