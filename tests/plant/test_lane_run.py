"""Lanes of `run_lanes` beside lanes of other kinds, and those left over: each is the run that it is alone."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from coupled_twin import changed
from effect_sets import ALL_EFFECTS, rough

from msl_fem.actuator import Actuator
from msl_fem.computing.lanes import LANES
from msl_fem.plant.effects import EffectValues, neutral_vector
from msl_fem.plant.excitation import Inputs
from msl_fem.plant.lane_block import AT_A_TIME, FEW, LINE, LaneSettings, in_lines
from msl_fem.plant.lane_run import LaneRun, run_lanes
from msl_fem.plant.layout import N_OUT
from msl_fem.plant.plant import plant_parameters, surface_of
from msl_fem.table.magnetic_table import MagneticTable


def drive_of(servo: Actuator, kind: str) -> tuple[Any, Any]:
    """A plant in that drive, and commands that suit it."""
    inputs = rough(60, level=0.6)
    return plant_parameters(changed(servo, drive={"kind": kind})), inputs


@pytest.mark.parametrize("kind", ["current", "voltage"])
@pytest.mark.parametrize("substeps", [1, 10])
@pytest.mark.parametrize("mutual", [0.0, -2e-4])
def test_each_effect_beside_others_is_what_it_is_alone(
    servo: Actuator, table: MagneticTable, kind: str, substeps: int, mutual: float
) -> None:
    """What a lane has not is passed by only where no lane has it; passed by or not, it changes no bit. One step a
    sample is that of a fast current loop in closed form."""
    plant, inputs = drive_of(servo, kind)
    coupled = plant._replace(mutual=mutual)
    vectors = [neutral_vector()]
    vectors += [EffectValues({name: dict(values)}).vector() for name, values in ALL_EFFECTS.stated.items()]
    rows = np.array(vectors)
    plants = [coupled if n % 2 else plant for n in range(len(rows))]
    surface = surface_of(table)
    together = run_lanes(surface, plants, inputs, substeps=substeps, settings=LaneSettings(effects=rows))
    assert together.done.tolist() == [60] * len(rows)
    for lane, one in enumerate(plants):
        settings = LaneSettings(effects=rows[lane : lane + 1])
        alone = run_lanes(surface, [one], inputs, substeps=substeps, settings=settings)
        assert np.array_equal(together.rows(lane), alone.rows(0)), list(ALL_EFFECTS.stated)[lane - 1]
    assert len({together.true_position[lane].tobytes() for lane in range(len(rows))}) > 20


@pytest.mark.parametrize("over", range(1, LANES))
def test_a_few_lanes_left_over_are_run_one_by_one(servo: Actuator, table: MagneticTable, over: int) -> None:
    plant, inputs = drive_of(servo, "current")
    plants = [plant._replace(mass=plant.mass * (1 + 0.01 * n)) for n in range(LANES + over)]
    found = run_lanes(surface_of(table), [*plants, plants[3]], inputs, substeps=5, settings=LaneSettings(threads=2))
    widths = [block.shape[1] for block in found.blocks]
    assert widths == ([LANES] + [1] * over if over <= FEW else [LANES, LANES])
    assert found.place[-1] == found.place[3]  # alike, so run once
    for lane, one in enumerate(plants):
        alone = run_lanes(surface_of(table), [one], inputs, substeps=5)
        assert np.array_equal(found.rows(lane), alone.rows(0))
        assert np.array_equal(found.true_position[lane], alone.true_position[0])
        assert np.array_equal(found.voltage[lane], alone.voltage[0])


@pytest.mark.parametrize("over", [1, 3])
@pytest.mark.parametrize("late", [False, True])
@pytest.mark.parametrize("hold", ["zero-order", "linear"])
def test_what_is_asked_for_alone_is_kept(
    servo: Actuator, table: MagneticTable, over: int, late: bool, hold: Any
) -> None:
    """Of runs of several parts that stay in the cache, in a block, where the last lanes run by themselves and where
    they do not."""
    plant, n_sample = drive_of(servo, "current")[0], 2 * AT_A_TIME + 60
    inputs = replace(rough(n_sample, level=0.6), hold=hold)
    each = [1 + 0.01 * n for n in range(LANES + over)]
    plants = [plant._replace(mass=plant.mass * more, bandwidth=plant.bandwidth * more) for more in each]
    delays = EffectValues({"time_delay": {"position": 1.7e-4, "current": 0.6e-4}}) if late else EffectValues({})
    effects = np.tile(delays.vector(), (len(plants), 1))
    every = run_lanes(surface_of(table), plants, inputs, substeps=5, settings=LaneSettings(effects=effects))
    assert every.columns.size == N_OUT
    assert every.done.tolist() == [n_sample] * len(plants)
    for name in ("position", "velocity", "current", "voltage"):
        settings = LaneSettings(effects=effects, quantities=frozenset({name}))
        found = run_lanes(surface_of(table), plants, inputs, substeps=5, settings=settings)
        assert np.array_equal(getattr(found, name), getattr(every, name))
        assert np.ptp(getattr(every, name)[:, -30], axis=0).max() > 0, "the lanes differ"
        assert found.columns.size < 8
        assert np.array_equal(found.true_position, every.true_position)
    for lane in (0, LANES - 1):
        own = LaneSettings(effects=effects[:1])
        alone = run_lanes(surface_of(table), plants[lane : lane + 1], inputs, substeps=5, settings=own)
        assert np.array_equal(every.rows(lane), alone.rows(0))


@pytest.mark.parametrize("kind", ["current", "voltage"])
@pytest.mark.parametrize("substeps", [1, 10])
def test_what_is_done_for_whole_rows_alone_changes_none_of_the_others(
    servo: Actuator, table: MagneticTable, kind: str, substeps: int
) -> None:
    """With every effect by itself, eight times in a block, over two stretches: memories and the coils' currents are
    found where flux linkages and slopes are not asked for as well."""
    plant, inputs = drive_of(servo, kind)
    starts = np.zeros((LANES, 2, 4))
    starts[:, 1] = [0.02, 0.01, 1e-6, 1e-3]
    seen = 0
    for name, values in ALL_EFFECTS.stated.items():
        effects = np.tile(EffectValues({name: dict(values)}).vector(), (LANES, 1))
        settings = LaneSettings(effects=effects, starts=starts, begins=np.array([0, 30]))
        plants = [plant._replace(mass=plant.mass * (1 + 0.01 * n)) for n in range(LANES)]
        whole = run_lanes(surface_of(table), plants, inputs, substeps=substeps, settings=settings)
        asked = replace(settings, quantities=frozenset({"position", "current", "voltage"}))
        found = run_lanes(surface_of(table), plants, inputs, substeps=substeps, settings=asked)
        for quantity in ("position", "current", "voltage"):
            assert np.array_equal(getattr(found, quantity), getattr(whole, quantity)), (name, quantity)
        seen += found.columns.size < N_OUT - 5
    assert seen > 20


def test_rows_of_eight_begin_with_a_line_of_the_cache() -> None:
    for size in range(1, 20):
        values = np.random.default_rng(size).random((size, LANES))
        found = in_lines(values.T.copy().T)
        assert np.array_equal(found, values)
        assert found.ctypes.data % LINE == 0
        assert found.flags.c_contiguous


@pytest.mark.parametrize("count", [1, LANES])
def test_what_a_stretch_that_leaves_the_table_has_done_is_forgotten(
    servo: Actuator, table: MagneticTable, count: int
) -> None:
    """One by one and in a block: the heat behind it is that before it, as if it had not been."""
    plant, part = drive_of(servo, "voltage")[0]._replace(bandwidth=np.inf), 200
    inputs = Inputs(rough(3 * part, level=0.6).commands, 1e4)
    heat = EffectValues({"coil_heating": {"rise_per_joule": 20.0, "cooling_rate": 0.1}})
    effects = np.tile(heat.vector(), (count, 1))
    starts = np.zeros((count, 3, 4))
    starts[:, 1, 3] = 0.5  # m/s: out of the gap within the stretch
    plants = [plant._replace(mass=plant.mass * (1 + 0.01 * n)) for n in range(count)]

    def run_of(inputs: Inputs, begins: list[int], starts: np.ndarray) -> LaneRun:
        settings = LaneSettings(effects=effects, starts=starts, begins=np.array(begins))
        return run_lanes(surface_of(table), plants, inputs, substeps=5, settings=settings)

    through = run_of(inputs, [0, part, 2 * part], starts)
    assert np.isfinite(through.true_position[:, part : part + 5]).all()
    assert np.isnan(through.true_position[:, 2 * part - 1]).all(), "it has left"
    rest = np.r_[0:part, 2 * part : 3 * part]
    without = run_of(Inputs(inputs.commands[rest], inputs.rate), [0, part], starts[:, [0, 2]])
    fresh = run_of(Inputs(inputs.commands[2 * part :], inputs.rate), [0], starts[:, [2]])
    behind = through.current[:, 2 * part :]
    assert behind == pytest.approx(without.current[:, part:], rel=1e-9, abs=1e-12)
    assert np.abs(behind - fresh.current).max() > 1e-3 * np.abs(behind).max(), "heat shows"


@pytest.mark.parametrize("count", [1, LANES])
@pytest.mark.parametrize("diffusion_time", [1e-4, 2e-3, 0.05, 5.0])
def test_eddy_currents_behind_a_stretch_that_went_astray_are_those_of_one_that_did_not(
    servo: Actuator, table: MagneticTable, count: int, diffusion_time: float
) -> None:
    """A mover that nothing moves drifts evenly through a stretch; the next one begins where it is in truth. Fast modes
    have followed the drift and slow ones have not: the voltage there is that of a mover that has stood still."""
    fast = changed(servo, drive={"bandwidth": 1e4})
    plant, part, rate, steps = plant_parameters(fast)._replace(mass=1e9), 50, 1e4, 10
    plants = [plant._replace(mass=plant.mass * (1 + 0.01 * n)) for n in range(count)]
    commands = np.tile([0.9, 0.6], (2 * part, 1)) + np.linspace(0.0, 0.1, 2 * part)[:, None]
    sheets = EffectValues({"eddy_currents": {"time_constant": 4e-4, "diffusion_time": diffusion_time}})

    def run_of(speed: float, currents: np.ndarray) -> LaneRun:
        starts = np.tile([0.9, 0.6, 0.0, 0.0], (count, 2, 1))
        starts[:, 1, :2], starts[:, 0, 3] = currents, speed
        effects = np.tile(sheets.vector(), (count, 1))
        settings = LaneSettings(effects=effects, starts=starts, begins=np.array([0, part]))
        return run_lanes(surface_of(table), plants, Inputs(commands, rate), substeps=steps, settings=settings)

    there = run_of(0.0, np.array([0.9, 0.6])).current[:, part]
    still, drifting = run_of(0.0, there), run_of(2e-3, there)
    astray = np.abs(drifting.voltage - still.voltage).max(axis=(0, 2))
    assert np.isfinite(astray).all()
    assert astray[part:].max() < 0.15 * astray[:part].max()


@pytest.mark.parametrize("count", [1, LANES])
@pytest.mark.parametrize(
    ("effect", "most"), [("magnetic_hysteresis", 3e-6), ("early_saturation", 1e-8), ("remanent_flux", 1e-8)]
)
def test_a_coil_s_current_behind_a_stretch_that_went_astray_is_that_of_the_start(
    servo: Actuator, table: MagneticTable, count: int, effect: str, most: float
) -> None:
    """Where the mover is put back, the flux linkage and with it what iron takes of the current change, and the
    magnetising current by as much the other way."""
    plant, part = plant_parameters(changed(servo, drive={"bandwidth": 1e3}))._replace(mass=1e9), 50
    plants = [plant._replace(mass=plant.mass * (1 + 0.01 * n)) for n in range(count)]
    commands = np.tile([0.9, 0.6], (2 * part, 1)) + np.linspace(0.0, 0.1, 2 * part)[:, None]
    effects = np.tile(EffectValues({effect: dict(ALL_EFFECTS.stated[effect])}).vector(), (count, 1))

    def run_of(speed: float, currents: np.ndarray) -> LaneRun:
        starts = np.tile([0.9, 0.6, 0.0, 0.0], (count, 2, 1))
        starts[:, 1, :2], starts[:, 0, 3] = currents, speed
        settings = LaneSettings(effects=effects, starts=starts, begins=np.array([0, part]))
        return run_lanes(surface_of(table), plants, Inputs(commands, 1e5), substeps=2, settings=settings)

    there = run_of(0.0, np.array([0.9, 0.6])).current[:, part]
    still, drifting = run_of(0.0, there), run_of(5e-2, there)
    astray = np.abs(drifting.current - still.current).max(axis=(0, 2))
    assert astray[:part].max() > 0.0
    assert astray[part + 1] < most


@pytest.mark.parametrize("count", [1, LANES])
def test_currents_that_leak_to_the_other_side_begin_a_stretch_where_it_says(
    servo: Actuator, table: MagneticTable, count: int
) -> None:
    """A start moves both coils' currents, and each magnetising current by a share of the other's too."""
    plant, part = plant_parameters(changed(servo, drive={"kind": "voltage"}))._replace(bandwidth=np.inf), 30
    plants = [plant._replace(mass=plant.mass * (1 + 0.01 * n)) for n in range(count)]
    effects = np.tile(EffectValues({"cross_coupling": {"share": 0.2}}).vector(), (count, 1))
    starts = np.tile([[0.9, 0.6, 0.0, 0.0], [0.5, 0.7, 0.0, 0.0]], (count, 1, 1))
    inputs = Inputs(rough(2 * part, level=0.6).commands, 1e5)

    def run_of(inputs: Inputs, begins: list[int], starts: np.ndarray) -> LaneRun:
        settings = LaneSettings(effects=effects, starts=starts, begins=np.array(begins))
        return run_lanes(surface_of(table), plants, inputs, substeps=4, settings=settings)

    behind = run_of(inputs, [0, part], starts).current[:, part:]
    fresh = run_of(Inputs(inputs.commands[part:], inputs.rate), [0], starts[:, 1:]).current
    assert behind[:, 0] == pytest.approx(np.tile([0.5, 0.7], (count, 1)), rel=1e-12)
    assert behind == pytest.approx(fresh, rel=1e-9)


@pytest.mark.parametrize("time_constant", [1e-4, 2e-3, 1.0])
def test_a_flexure_behind_a_stretch_that_went_astray_is_relaxed_as_behind_one_that_did_not(
    servo: Actuator, table: MagneticTable, time_constant: float
) -> None:
    """What it presses with would move the mover in the next stretch."""
    stiffness, mass, part = 1e6, 1e6, 50  # so heavy that the spring does not brake it
    plant = plant_parameters(servo)._replace(stiffness=stiffness, mass=mass)
    inputs = Inputs(np.zeros((2 * part, 2)), 1e4)
    creep = EffectValues({"flexure_relaxation": {"strength": 0.5, "time_constant": time_constant}}).vector()[None]
    starts = np.zeros((1, 2, 4))
    starts[0, 0, 3] = 1e-3
    settings = LaneSettings(effects=creep, starts=starts, begins=np.array([0, part]))
    position = run_lanes(surface_of(table), [plant], inputs, substeps=10, settings=settings).true_position[0]
    assert position[part - 1] == pytest.approx(4.9e-6, rel=1e-3)
    pressed = 0.5 * stiffness * 4.9e-6 * (part / 1e4) ** 2 / (2 * mass)
    assert abs(position[-1]) < 0.01 * pressed


@pytest.mark.parametrize("effect", ["eddy_currents", "magnetic_hysteresis", "early_saturation", "remanent_flux"])
def test_stretches_of_lanes_in_whose_iron_something_goes_on_beside_others_are_what_they_are_alone(
    servo: Actuator, table: MagneticTable, effect: str
) -> None:
    plant, commands = plant_parameters(servo), rough(60, level=0.6).commands
    values = [EffectValues({effect: dict(ALL_EFFECTS.stated[effect])}), EffectValues({})] * (LANES // 2)
    rows = np.array([one.vector() for one in values])
    plants = [plant._replace(mass=plant.mass * (1 + 0.01 * n)) for n in range(LANES)]
    starts = np.tile([0.9, 0.6, 2e-6, 0.0], (LANES, 2, 1))

    def run_of(which: slice) -> LaneRun:
        settings = LaneSettings(effects=rows[which], starts=starts[which], begins=np.array([0, 30]))
        return run_lanes(surface_of(table), plants[which], Inputs(commands, 1e4), substeps=5, settings=settings)

    together = run_of(slice(0, LANES))
    assert [block.shape[1] for block in together.blocks] == [LANES]
    assert np.isfinite(together.current).all()
    for lane in range(LANES):
        assert np.array_equal(run_of(slice(lane, lane + 1)).current[0], together.current[lane])


@pytest.mark.parametrize(
    "stated",
    [
        {},
        {"current_sensor_error": {"gain_2": 0.02}},
        {"sensor_drift": {"offset": 1e-6}},
        {"time_delay": {"position": 3e-4}},
        {"periodic_disturbance": {"frequency": 50.0, "current_cosine": 0.01, "position_sine": 1e-7}},
    ],
    ids=["faithful", "gain", "offset", "delay", "hum"],
)
def test_a_channel_is_read_as_its_instrument_reads_it(
    servo: Actuator, table: MagneticTable, stated: dict[str, dict[str, float]]
) -> None:
    """Beside a lane whose instruments are faithful, which the kernel's own rows do for where all are."""
    plant, inputs = drive_of(servo, "current")
    rows = np.array([neutral_vector(), EffectValues(stated).vector()])
    found = run_lanes(surface_of(table), [plant] * 2, inputs, substeps=5, settings=LaneSettings(effects=rows))
    assert np.array_equal(found.as_read("position"), found.position)
    assert np.array_equal(found.as_read("velocity"), found.velocity)
    for side in range(2):
        assert np.array_equal(found.as_read("current", side), found.current[..., side])
        assert np.array_equal(found.as_read("voltage", side), found.voltage[..., side])
    own = [found.as_read("position"), *(found.as_read("current", side) for side in range(2))]
    shows = [not np.array_equal(lanes[0], lanes[1]) for lanes in own]
    assert any(shows) == bool(stated)
