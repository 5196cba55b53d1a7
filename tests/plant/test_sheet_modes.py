"""Eddy currents in sheets beside a fast current loop: the loop's and the modes' own solution, at few steps."""

from collections.abc import Callable

import numpy as np
import pytest
from coupled_twin import changed, linear_table, locked
from scipy.linalg import expm

from msl_fem.actuator import Actuator
from msl_fem.plant.effects import EffectValues, kernel_coefficients
from msl_fem.plant.effects.magnetic import EDDY, EDDY_EXACT, EDDY_MODE, EDDY_RATE, N_EDDY
from msl_fem.plant.excitation import Inputs
from msl_fem.plant.lane_block import LaneSettings
from msl_fem.plant.lane_run import run_lanes
from msl_fem.plant.plant import plant_parameters, surface_of
from msl_fem.plant.simulate import Options, Simulation, simulate
from msl_fem.table.magnetic_table import MagneticTable

RATE, INDUCTANCE, RESISTANCE = 1e4, 2 * 1.08e-5 / 6.3e-4, 2.0
THICK, THIN, FOIL = (3.45e-3, 7.68), (1e-3, 0.02), (3e-4, 1e-4)
"""Time constant and diffusion time in s: rates up to 8, 3000 and 600 000 a sample."""


def sheets(time_constant: float, diffusion_time: float, **more: dict[str, float]) -> EffectValues:
    return EffectValues({"eddy_currents": {"time_constant": time_constant, "diffusion_time": diffusion_time}} | more)


def jumping(n: int, amplitude: float = 0.05) -> Inputs:
    """Currents about 0.5 A that jump at every other sample."""
    return Inputs(0.5 + amplitude * np.repeat(np.random.default_rng(3).standard_normal((n // 2, 2)), 2, axis=0), RATE)


def with_loop(actuator: Actuator, bandwidth: float, limit: float | None = None) -> Actuator:
    return changed(actuator, drive={"bandwidth": bandwidth, "voltage_limit": limit})


def rms(error: np.ndarray, of: np.ndarray) -> float:
    """From the thirtieth sample on."""
    return float(np.sqrt(np.mean((error[30:] - of[30:]) ** 2)) / np.std(of[30:]))


def exact_currents(servo: Actuator, values: EffectValues, bandwidth: float, inputs: Inputs) -> np.ndarray:
    """(n_sample,) of the coil of side 1 of a linear magnet that stands still, by the matrix exponential of the loop's
    equation, u' = w (target - i)/(1 + w L G), and those of the modes."""
    plant, w = plant_parameters(with_loop(servo, bandwidth)), 2 * np.pi * bandwidth
    e = kernel_coefficients(plant, values.vector(), inductance=INDUCTANCE, step=1 / RATE, n_step=1)
    assert e[EDDY_EXACT] == 1.0
    c, r = INDUCTANCE * e[EDDY_MODE : EDDY_MODE + N_EDDY], e[EDDY_RATE : EDDY_RATE + N_EDDY]
    at_once = INDUCTANCE * e[EDDY]
    matrix = np.zeros((N_EDDY + 2,) * 2)
    matrix[0, :-1], matrix[0, -1] = -w / (1 + w * at_once), w / (1 + w * at_once)
    for k in range(N_EDDY):
        matrix[k + 1] = c[k] * matrix[0]
        matrix[k + 1, k + 1] -= r[k]
    step, state, found = expm(matrix / RATE), np.zeros(N_EDDY + 2), [0.0]
    for command in inputs.commands[:-1, 0]:
        state[-1] = command
        state = step @ state
        found.append(float(state[:-1].sum() + at_once * (matrix[0] @ state)))
    return np.array(found)


@pytest.mark.parametrize(
    ("bandwidth", "one", "two"), [(2e3, 8e-3, 1e-3), (1e4, 3e-2, 2e-3), (1e5, 2e-2, 2e-3), (1e7, 3e-3, 1e-3)]
)
@pytest.mark.parametrize("sizes", [THICK, THIN, FOIL])
def test_the_loop_and_the_modes_have_an_own_solution(
    servo: Actuator, sizes: tuple[float, float], bandwidth: float, one: float, two: float
) -> None:
    inputs, values = jumping(200), sheets(*sizes)
    exact = exact_currents(servo, values, bandwidth, inputs)
    for steps, most in ((1, one), (2, two)):
        run = simulate(
            locked(with_loop(servo, bandwidth)), linear_table(), inputs, effects=values, options=Options(substeps=steps)
        )
        assert rms(run.current[:, 0], exact) < most, steps


def test_the_order_of_the_steps(servo: Actuator) -> None:
    """Of slow modes and a loop that a step nearly resolves: with twice the steps at least sixteen times less."""
    inputs, values = jumping(200), sheets(1e-3, 50.0)
    exact = exact_currents(servo, values, 4e3, inputs)
    errors = []
    for steps in (1, 2, 4):
        run = simulate(
            locked(with_loop(servo, 4e3)), linear_table(), inputs, effects=values, options=Options(substeps=steps)
        )
        errors.append(rms(run.current[:, 0], exact))
    assert errors[0] > 16 * errors[1] > 200 * errors[2]


@pytest.mark.parametrize("limit", [None, 20.0])
@pytest.mark.parametrize("bandwidth", [3e3, 1e7])
def test_no_bandwidth_is_too_fast_for_a_limit(
    servo: Actuator, table: MagneticTable, bandwidth: float, limit: float | None
) -> None:
    """The mover free, the voltage limited: few steps as many."""
    inputs, bench = jumping(200), with_loop(servo, bandwidth, limit)

    def run(steps: int) -> Simulation:
        return simulate(bench, table, inputs, effects=sheets(*THICK), options=Options(substeps=steps))

    many = run(40)
    if limit is not None:
        assert np.abs(many.voltage).max() > 0.5 * limit
    for steps, most in ((1, 0.08), (2, 0.03)):
        few = run(steps)
        assert rms(few.current, many.current) < most
        assert rms(few.position, many.position) < most


@pytest.mark.parametrize(
    ("more", "numbers"),
    [
        ({}, {"mutual": 2e-3}),
        ({"cross_coupling": {"share": 0.1}}, {}),
        ({"cross_coupling": {"share": 0.1}}, {"mutual": 2e-3}),
        ({"magnetic_hysteresis": {"coercive_current": 0.02, "reversal_current": 0.3}}, {}),
    ],
)
def test_sides_and_memory_go_along(
    servo: Actuator, table: MagneticTable, more: dict[str, dict[str, float]], numbers: dict[str, float]
) -> None:
    plant = plant_parameters(with_loop(servo, 2e3))._replace(**numbers)
    inputs = jumping(200)

    def run(steps: int) -> tuple[np.ndarray, np.ndarray]:
        settings = LaneSettings(effects=sheets(*THIN, **more).vector()[None])
        lanes = run_lanes(surface_of(table), [plant], inputs, substeps=steps, settings=settings)
        return lanes.current[0], lanes.true_position[0]

    (current, position), (few_current, few_position) = run(60), run(1)
    assert rms(few_current, current) < 0.02
    assert rms(few_position, position) < 0.02


def test_memory_alone_at_one_step(servo: Actuator, table: MagneticTable) -> None:
    """What iron remembers takes its part of the current from the loop on the way."""
    values = EffectValues({"magnetic_hysteresis": {"coercive_current": 0.02, "reversal_current": 0.3}})

    def run(steps: int) -> Simulation:
        options = Options(substeps=steps)
        return simulate(with_loop(servo, 2e3), table, jumping(200), effects=values, options=options)

    assert rms(run(1).current, run(60).current) < 0.01


@pytest.mark.parametrize("sizes", [THICK, THIN])
def test_little_of_it_changes_little(servo: Actuator, table: MagneticTable, sizes: tuple[float, float]) -> None:
    """The slope over the amount at nothing, at few steps as at many: what a search goes by."""
    inputs, bench, little = jumping(200), with_loop(servo, 2e3), 1e-6

    def slope(steps: int, of: Callable[[Simulation], np.ndarray]) -> np.ndarray:
        options = Options(substeps=steps)
        without = simulate(bench, table, inputs, effects=EffectValues(), options=options)
        return (
            of(simulate(bench, table, inputs, effects=sheets(little, sizes[1]), options=options)) - of(without)
        ) / little

    for of, one in ((lambda run: run.current[:, 0], 0.06), (lambda run: run.voltage[:, 0], 0.06),
                    (lambda run: run.position, 0.6)):  # fmt: skip
        many = slope(40, of)
        assert rms(slope(1, of), many) < one
        assert rms(slope(2, of), many) < 0.1 * one


def test_lanes_are_as_one_alone(servo: Actuator, table: MagneticTable) -> None:
    """To the last bit, beside sheets of other sizes, a shorted winding, and none."""
    every = [sheets(*THICK), sheets(*THIN), sheets(1e-3, 0.0), EffectValues(), sheets(*FOIL)]
    plant, inputs = plant_parameters(with_loop(servo, 2e3, 10.0)), jumping(100)
    rows = np.array([values.vector() for values in every])
    together = run_lanes(surface_of(table), [plant] * 5, inputs, substeps=1, settings=LaneSettings(effects=rows))
    for n in range(5):
        alone = run_lanes(
            surface_of(table), [plant], inputs, substeps=1, settings=LaneSettings(effects=rows[n : n + 1])
        )
        assert np.array_equal(alone.current[0], together.current[n])
        assert np.array_equal(alone.voltage[0], together.voltage[n])
        assert np.array_equal(alone.true_position[0], together.true_position[n])


def test_the_energies_close(servo: Actuator, table: MagneticTable) -> None:
    run = simulate(with_loop(servo, 2e3), table, jumping(400), effects=sheets(*THICK), options=Options(substeps=2))
    assert abs(run.audit.imbalance) < 2e-3
