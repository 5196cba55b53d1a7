"""The extended kernel against its slow twin, its order of convergence, and its lanes against single runs."""

from dataclasses import replace
from typing import Literal

import numpy as np
import pytest
from coupled_twin import changed
from effect_sets import ALL_EFFECTS, rough
from extended_twin import SMOOTH, twin

from msl_fem.actuator import Actuator
from msl_fem.computing.arrays import Array
from msl_fem.errors import InputError
from msl_fem.plant import kernel, layout
from msl_fem.plant.effects import PARAMETER_INDEX, EffectValues, kernel_coefficients, neutral_vector
from msl_fem.plant.excitation import Inputs
from msl_fem.plant.lane_block import LaneSettings
from msl_fem.plant.lane_run import LaneRun, run_lanes
from msl_fem.plant.layout import (
    BASE,
    CREEP,
    HEAT_1,
    I1,
    I2,
    MODE,
    OK,
    SENSOR,
    V,
    X,
    initial_state,
)
from msl_fem.plant.plant import plant_parameters, surface_of
from msl_fem.plant.preparation import effect_coefficients, small_signal_inductance, start_effects
from msl_fem.plant.simulate import Options, simulate
from msl_fem.table.magnetic_table import MagneticTable


def test_the_kernel_agrees_with_its_twin(servo: Actuator, table: MagneticTable) -> None:
    """At the default step: 1e-6 of full scale in every channel, with 17 effects at work; from the second sample on, as
    a start in remanent iron has its currents without what mutual flux does to the iron in series."""
    inputs = rough(50)
    run, exact = simulate(servo, table, inputs, effects=SMOOTH), twin(servo, table, inputs, SMOOTH)
    plain = simulate(servo, table, inputs)
    assert not run.samples_at_voltage_limit.any()
    for channel, values in exact.items():
        error = np.abs(getattr(run, channel) - values)[1:].max() / np.abs(values).max()
        assert error < 1e-6, channel
        assert np.abs(getattr(plain, channel) - values).max() > 1e-3 * np.abs(values).max(), channel


@pytest.mark.parametrize("kind", ["current", "voltage"])
def test_the_order_of_convergence_is_four(servo: Actuator, table: MagneticTable, kind: str) -> None:
    bench = changed(servo, drive={"kind": kind}, position_sensor={"bandwidth": 3000.0})
    plant, surface = plant_parameters(bench), surface_of(table)
    command = np.array([1.3, 0.8]) if kind == "current" else np.array([6.0, 1.0])

    def end(steps: int) -> np.ndarray:
        step = 4e-4 / steps
        e = effect_coefficients(plant, surface, SMOOTH, step=step, n_step=steps)
        state = initial_state(plant, 1.0, 0.9, 1e-4, -0.05)
        start_effects(surface, plant, e, state)
        assert kernel.advance(surface, plant, e, state, command, 5.0, step, steps, np.zeros(2)) == OK
        return state[[I1, I2, X, V, SENSOR, HEAT_1, CREEP, MODE, BASE]]

    finest = end(1024)
    errors = np.array([np.abs(end(steps) - finest) for steps in (16, 32, 64)])
    orders = np.log2(errors[:-1] / errors[1:])
    assert orders[-1] == pytest.approx(np.full(9, 4.0), abs=0.15)


def lane_plants(servo: Actuator) -> list:
    p = plant_parameters(servo)
    others = {
        "mass": 0.91, "resistance": 2.1, "bandwidth": 5000.0, "nominal_gap": 6.1e-4, "stiffness": 1.5e5,
        "damping": 20.0, "sensor_bandwidth": 4e4, "voltage_limit": 3.0, "constant_force": 3.0,
    }  # fmt: skip
    return [p, *(p._replace(**{name: value}) for name, value in others.items())]


@pytest.mark.parametrize("values", [None, EffectValues(), ALL_EFFECTS], ids=["plain", "neutral", "all"])
def test_lanes_equal_single_runs_to_the_last_bit(
    servo: Actuator, table: MagneticTable, values: EffectValues | None
) -> None:
    """Ten lanes (so two blocks, one filled up) of other plants, starts and effects, through many cells of the table."""
    plants, surface, inputs = lane_plants(servo), surface_of(table), rough(150, level=0.6)
    starts = np.zeros((10, 4))
    starts[3] = [0.2, 0.1, 1e-5, 1e-3]
    vectors = None
    if values is not None:
        vectors = np.array([neutral_vector() + (values.vector() - neutral_vector()) * k / 9 for k in range(10)])
        vectors[5] = neutral_vector()
    run = run_lanes(surface, plants, inputs, substeps=10, settings=LaneSettings(effects=vectors, starts=starts))
    assert run.done.tolist() == [150] * 10
    for lane, plant in enumerate(plants):
        state, e = initial_state(plant, *starts[lane]), None
        if vectors is not None:
            inductance = small_signal_inductance(plant, surface)
            e = kernel_coefficients(plant, vectors[lane], inductance=inductance, step=1e-5, n_step=10)
            start_effects(surface, plant, e, state)
        out = np.empty((150, layout.N_OUT))
        push = np.asarray(inputs.disturbance)
        assert kernel.run(surface, plant, e, state, inputs.for_sides(2), push, 1e-5, 10, out, False) == (OK, 150)
        assert np.array_equal(run.true_position[lane], out[:, layout.OUT_X])
        assert np.array_equal(run.voltage[lane], out[:, [layout.OUT_VOLTAGE_1, layout.OUT_VOLTAGE_2]])
        assert np.array_equal(run.flux_linkage[lane], out[:, [layout.OUT_FLUX_1, layout.OUT_FLUX_2]])
        if vectors is None:
            assert np.array_equal(run.current[lane], out[:, :2])
            assert np.array_equal(run.position[lane], out[:, layout.OUT_SENSOR])
    assert np.ptp(run.true_position[:, -1]) > 1e-7


def test_lanes_read_as_simulate_does(servo: Actuator, table: MagneticTable) -> None:
    plant, inputs = plant_parameters(servo), rough(100)
    vectors = np.tile(ALL_EFFECTS.vector(), (3, 1))
    run = run_lanes(surface_of(table), [plant] * 3, inputs, substeps=10, settings=LaneSettings(effects=vectors))
    alone = simulate(servo, table, inputs, effects=ALL_EFFECTS, options=Options(substeps=10))
    for lane in range(3):
        assert np.array_equal(run.position[lane], alone.measured_position)
        assert np.array_equal(run.current[lane], alone.measured_current)


def test_lanes_may_have_surfaces_of_their_own(servo: Actuator, table: MagneticTable) -> None:
    plant, surface, inputs = plant_parameters(servo), surface_of(table), rough(60)
    stronger = surface._replace(coefficients=np.stack([surface.coefficients, 1.01 * surface.coefficients]))
    index = np.array([0, 1, 1, 0])
    run = run_lanes(stronger, [plant] * 4, inputs, substeps=10, settings=LaneSettings(surface_index=index))
    for lane, own in enumerate(index):
        single = surface._replace(coefficients=stronger.coefficients[own])
        alone = run_lanes(single, [plant], inputs, substeps=10)
        assert np.array_equal(run.true_position[lane], alone.true_position[0])
    assert np.abs(run.true_position[1] / run.true_position[0] - 1)[-1] > 1e-3


@pytest.mark.parametrize("hold", ["zero-order", "linear"])
@pytest.mark.parametrize("values", [None, ALL_EFFECTS], ids=["plain", "all"])
def test_lanes_may_have_inputs_of_their_own(
    servo: Actuator, table: MagneticTable, values: EffectValues | None, hold: Literal["zero-order", "linear"]
) -> None:
    """Ten, so two blocks, one filled up, and one by itself, over two stretches; each as with these inputs alone."""
    plant, surface, inputs = plant_parameters(servo), surface_of(table), replace(rough(120, level=0.6), hold=hold)
    rng = np.random.default_rng(5)
    more, pushes = rng.uniform(-0.05, 0.05, (10, 120, 2)), rng.uniform(-1.0, 1.0, (10, 120))
    begins, starts = np.array([0, 70]), np.zeros((10, 2, 4))
    starts[:, 1, 2] = 1e-5

    def run_of(count: int, asked: Inputs, more: Array | None = None, pushes: Array | None = None) -> LaneRun:
        effects = None if values is None else np.tile(values.vector(), (count, 1))
        settings = LaneSettings(effects=effects, starts=starts[:count], begins=begins, more=more, pushes=pushes)
        return run_lanes(surface, [plant] * count, asked, substeps=10, settings=settings)

    together = run_of(10, inputs, more=more, pushes=pushes)
    for lane in range(10):
        own = replace(inputs, commands=inputs.commands + more[lane], disturbance=inputs.disturbance + pushes[lane])
        alone = run_of(1, own)
        assert np.array_equal(together.true_position[lane], alone.true_position[0])
        assert np.array_equal(together.voltage[lane], alone.voltage[0])
    single = run_of(1, inputs, more=more[:1], pushes=pushes[:1])
    assert np.array_equal(single.true_position[0], together.true_position[0])
    assert np.ptp(together.true_position[:, 60]) > 1e-8, "the lanes differ"
    with pytest.raises(InputError, match=r"more has the shape \(9, 120, 2\); 10 lanes need \(10, 120, 2\)"):
        run_of(10, inputs, more=more[:9], pushes=pushes)


def test_threads_change_nothing_but_the_time(servo: Actuator, table: MagneticTable) -> None:
    plant, inputs = plant_parameters(servo), rough(200)
    plants = [plant._replace(mass=plant.mass * (1 + 0.001 * n)) for n in range(19)]
    effects = np.tile(SMOOTH.vector(), (19, 1))
    one, two = (
        run_lanes(
            surface_of(table), plants, inputs, substeps=5, settings=LaneSettings(effects=effects, threads=threads)
        )
        for threads in (1, 3)
    )
    assert np.array_equal(one.position, two.position)
    assert np.array_equal(one.current, two.current)
    assert np.ptp(one.true_position[:, -1]) > 0, "the lanes differ"


def test_a_lane_that_leaves_the_table_does_not_stop_the_others(servo: Actuator, table: MagneticTable) -> None:
    plant, inputs = plant_parameters(servo), Inputs(np.tile([0.5, 0.4], (600, 1)), 1e4)
    weak = plant._replace(stiffness=1e3)
    run = run_lanes(surface_of(table), [plant, weak, plant], inputs, substeps=10)
    assert run.done[0] == run.done[2] == 600
    assert 20 < run.done[1] < 600
    assert np.isnan(run.position[1, run.done[1] + 1 :]).all()
    assert np.array_equal(run.position[0], run.position[2])


def test_lanes_that_do_not_fit_are_refused(servo: Actuator, table: MagneticTable) -> None:
    plant, surface, inputs = plant_parameters(servo), surface_of(table), rough(20)
    with pytest.raises(InputError, match="the lanes' plants differ in sides, magnets, drive"):
        run_lanes(surface, [plant, plant._replace(drive=1)], inputs, substeps=10)
    with pytest.raises(InputError, match=rf"effects has the shape \(3,\); 1 lanes need \(1, {len(PARAMETER_INDEX)}\)"):
        run_lanes(surface, [plant], inputs, substeps=10, settings=LaneSettings(effects=np.zeros(3)))
    with pytest.raises(InputError, match="surface_index goes from 1 to 1; there are 1 surfaces"):
        run_lanes(surface, [plant], inputs, substeps=10, settings=LaneSettings(surface_index=np.array([1])))
