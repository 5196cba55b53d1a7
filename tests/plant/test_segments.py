"""Runs over stretches that are advanced in segments: each is what it is in one piece."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from coupled_twin import changed
from effect_sets import ALL_EFFECTS, rough

from msl_fem.actuator import Actuator
from msl_fem.plant import segments as segments_module
from msl_fem.plant.effects import EffectValues, find_effect, find_parameter, neutral_vector
from msl_fem.plant.lane_block import Lanes, LaneSettings
from msl_fem.plant.lane_run import LaneRun, run_lanes
from msl_fem.plant.layout import OUT_I1, OUT_I2, OUT_V, OUT_X
from msl_fem.plant.plant import plant_parameters, surface_of
from msl_fem.plant.segments import Settling, run_segments, segments_for, segments_of
from msl_fem.table.magnetic_table import MagneticTable

N_SAMPLE, SHORT = 6000, 50
SETTLES = {
    "amplifier_bandwidth",
    "armature_tilt",
    "cross_coupling",
    "current_sensor_error",
    "drive_limit",
    "early_saturation",
    "force_offset",
    "fringing",
    "gap_offset",
    "leakage_inductance",
    "mutual_inductance",
    "position_sensor_crosstalk",
    "position_sensor_lag",
    "position_sensor_nonlinearity",
    "remanent_flux",
    "sensor_drift",
    "squeeze_film",
    "stiffness_nonlinearity",
    "time_delay",
}


def uneven(seed: int = 3) -> np.ndarray:
    """First samples of stretches of 50, 100 and 200."""
    lengths = np.random.default_rng(seed).choice([SHORT, 2 * SHORT, 4 * SHORT], 200)
    begins = np.concatenate([[0], np.cumsum(lengths)])
    return begins[begins < N_SAMPLE - SHORT]


def lanes_of(
    servo: Actuator, table: MagneticTable, kind: str, effects: np.ndarray, *, substeps: int = 4, **own: Any
) -> Lanes:
    """As many lanes as rows of effects, of a plant with lags of drive and sensor, their starts off what went before. In
    one step a sample a current loop is known in closed form."""
    drive = {"kind": kind} | ({"bandwidth": 5e3 if substeps > 1 else 3e4} if kind == "current" else {})
    plant = plant_parameters(changed(servo, drive=drive))._replace(sensor_bandwidth=5e4)
    count, begins = len(effects), uneven()
    plants = [plant._replace(mass=plant.mass * (1 + 0.02 * n)) for n in range(count)]
    noise = np.random.default_rng(5).normal(size=(count, begins.size, 4))
    starts = np.array([0.9, 0.6, 0.0, 0.0]) + noise * [0.05, 0.05, 2e-6, 2e-3]
    settings = LaneSettings(effects=effects, starts=starts, begins=begins, threads=2, in_segments=True)
    inputs = rough(N_SAMPLE, level=0.6)
    return Lanes(surface_of(table), plants, inputs, substeps, replace(settings, **own))


def run_of(lanes: Lanes, *, in_segments: bool) -> LaneRun:
    settings = replace(lanes.settings, in_segments=in_segments)
    return run_lanes(lanes.surface, lanes.plants, lanes.inputs, substeps=lanes.substeps, settings=settings)


def count_of(lanes: Lanes) -> int:
    return len(segments_for(lanes, np.arange(len(lanes.plants))))


def apart(lanes: Lanes) -> float:
    """By how much readings differ in segments, over the largest of each; infinite where other samples are missing."""
    whole, cut = (run_of(lanes, in_segments=on) for on in (False, True))
    worst = 0.0
    for name in ("position", "velocity", "current", "voltage"):
        one, other = getattr(whole, name), getattr(cut, name)
        if not np.array_equal(np.isnan(one), np.isnan(other)):
            return np.inf
        worst = max(worst, float(np.nanmax(np.abs(other - one)) / np.nanmax(np.abs(one))))
    return worst


def only(effect: str, count: int = 1) -> np.ndarray:
    return np.tile(EffectValues({effect: dict(ALL_EFFECTS.stated[effect])}).vector(), (count, 1))


@pytest.mark.parametrize("hold", ["zero-order", "linear"])
@pytest.mark.parametrize(("kind", "substeps"), [("current", 4), ("current", 1), ("voltage", 4)])
@pytest.mark.parametrize("effect", list(ALL_EFFECTS.stated))
def test_each_effect_settles_or_stays_in_one_piece(
    servo: Actuator, table: MagneticTable, kind: str, substeps: int, hold: Any, effect: str
) -> None:
    lanes = lanes_of(servo, table, kind, only(effect), substeps=substeps)
    lanes = replace(lanes, inputs=replace(lanes.inputs, hold=hold))
    assert (count_of(lanes) > 1) == (effect in SETTLES)
    assert apart(lanes) < 1e-12


@pytest.mark.parametrize(
    ("effect", "amount"),
    [(e, p.name) for e in ALL_EFFECTS.stated for p in find_effect(e).parameters if not p.shape],
)
def test_each_amount_does_by_itself(servo: Actuator, table: MagneticTable, effect: str, amount: str) -> None:
    parameter = find_parameter(effect, amount)
    shapes = {key: value for key, value in ALL_EFFECTS.stated[effect].items() if find_parameter(effect, key).shape}
    size = ALL_EFFECTS.stated[effect].get(amount, parameter.scale)
    vector = EffectValues({effect: shapes | {amount: size}}).vector()
    assert apart(lanes_of(servo, table, "voltage", vector[None])) < 1e-12


@pytest.mark.parametrize("kind", ["current", "voltage"])
def test_eddy_currents_in_sheets_stay_in_one_piece(servo: Actuator, table: MagneticTable, kind: str) -> None:
    """What they keep moves the mover, which they follow: it outlives a start."""
    sheets = EffectValues({"eddy_currents": {"time_constant": 2e-4, "diffusion_time": 1e-3}}).vector()[None]
    assert count_of(lanes_of(servo, table, kind, sheets)) == 1


@pytest.mark.parametrize("count", [1, 2, 3, 5, 8])
def test_a_few_lanes_share_vectors_and_threads(servo: Actuator, table: MagneticTable, count: int) -> None:
    lanes = lanes_of(servo, table, "voltage", np.tile(neutral_vector(), (count, 1)))
    assert count_of(lanes) == 16 // count
    assert apart(lanes) < 1e-12
    assert np.ptp(run_of(lanes, in_segments=True).position[:, -1]) > 0.0 or count == 1, "the lanes differ"


@pytest.mark.parametrize("kind", ["current", "voltage"])
def test_what_a_slow_lag_keeps_needs_its_time(
    servo: Actuator, table: MagneticTable, kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    slow = EffectValues({"amplifier_bandwidth": {"lag": 2e-3}}).vector()[None]
    lanes = lanes_of(servo, table, kind, slow)
    assert count_of(lanes) > 1
    assert apart(lanes) < 1e-12
    monkeypatch.setattr(segments_module, "SETTLED", 1.0)
    assert apart(lanes) > 1e-6


@pytest.mark.parametrize("lag", [0.0, 1e-5])
def test_a_slew_limit_has_the_time_to_follow_all_that_commands_cross(
    servo: Actuator, table: MagneticTable, lag: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    slow = EffectValues({"amplifier_bandwidth": {"lag": lag, "slew_time": 0.03}}).vector()[None]
    lanes = lanes_of(servo, table, "voltage", slow)
    assert count_of(lanes) > 1
    assert apart(lanes) < 1e-12
    monkeypatch.setattr(np, "ptp", lambda *_: 0.0)
    assert apart(lanes) > 1e-6


def test_a_sensor_s_lag_settles_behind_what_moves_the_mover(
    servo: Actuator, table: MagneticTable, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The stretch in which a drive's lag settles leaves the mover where it is not; the sensor follows the next one."""
    late = EffectValues({"time_delay": {"command": 1e-3}, "position_sensor_lag": {"lag": 5e-4}}).vector()[None]
    lanes = lanes_of(servo, table, "voltage", late)
    assert apart(lanes) < 1e-12
    settling = segments_module.settling_of

    def at_once(*args: Any, **kwargs: Any) -> Settling:
        return replace(settling(*args, **kwargs), of_commands=0.0)

    monkeypatch.setattr(segments_module, "settling_of", at_once)
    assert apart(lanes) > 1e-8


def friction(lanes: Lanes, *, force: float, presliding: float, travel: float) -> Lanes:
    """With friction, and starts of stretches that many metres apart, from side to side."""
    vector = EffectValues({"coulomb_friction": {"force": force, "presliding": presliding}}).vector()
    starts = lanes.settings.starts.copy()
    starts[:, :, 2] += 0.5 * travel * (-1.0) ** np.arange(starts.shape[1])
    effects = np.tile(vector, (len(lanes.plants), 1))
    return replace(lanes, settings=replace(lanes.settings, effects=effects, starts=starts))


@pytest.mark.parametrize("count", [1, 3])
def test_friction_settles_where_the_mover_goes_far(
    servo: Actuator, table: MagneticTable, count: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    plain = lanes_of(servo, table, "current", np.tile(neutral_vector(), (count, 1)))
    moving = friction(plain, force=0.3, presliding=5e-7, travel=2e-5)
    assert count_of(moving) > 1
    assert apart(moving) < 1e-10
    assert count_of(friction(plain, force=0.3, presliding=2e-5, travel=2e-5)) == 1, "it does not go that far"
    monkeypatch.setattr(segments_module, "TRAVELS", 0)
    assert apart(moving) > 1e-8


def test_a_mover_that_sticks_is_run_in_one_piece(servo: Actuator, table: MagneticTable) -> None:
    """Its stretches begin far from one another, and in none of them it goes anywhere."""
    stuck = friction(
        lanes_of(servo, table, "current", neutral_vector()[None]), force=200.0, presliding=1e-6, travel=1e-4
    )
    stuck.settings.starts[:, :, 3] = 0.0
    segments = segments_for(stuck, np.arange(1))
    assert len(segments) > 1
    assert run_segments(stuck, np.arange(1), segments) is None
    assert apart(stuck) == 0.0


def test_a_stretch_that_leaves_the_table_is_missing_alone(servo: Actuator, table: MagneticTable) -> None:
    lanes = lanes_of(servo, table, "voltage", np.tile(neutral_vector(), (2, 1)))
    lanes.settings.starts[1, 20, 3] = 2.0  # m/s: out of the gap within the stretch
    found = run_of(lanes, in_segments=True)
    assert np.isnan(found.true_position[1]).any()
    assert np.isfinite(found.true_position[0]).all()
    assert apart(lanes) < 1e-12


@pytest.mark.parametrize("own", [{"more": np.zeros((1, N_SAMPLE, 2))}, {"in_segments": False}])
def test_lanes_with_inputs_of_their_own_stay_in_one_piece(servo: Actuator, table: MagneticTable, own: Any) -> None:
    assert count_of(lanes_of(servo, table, "voltage", neutral_vector()[None], **own)) == 1


@pytest.mark.parametrize("settling", [Settling(0.0, 0.0), Settling(0.0, 130.0), Settling(70.0, 20.0)])
@pytest.mark.parametrize("count", [2, 7, 16])
def test_segments_tell_each_sample_once_and_begin_early_enough(settling: Settling, count: int) -> None:
    begins = uneven(8)
    made = segments_of(begins, N_SAMPLE, count, settling)
    assert 1 < len(made) <= count
    assert made[0].begin == 0
    assert made[-1].end == N_SAMPLE
    for before, one in zip(made[:-1], made[1:], strict=True):
        assert before.end == one.begin
        first = begins[one.stretch]
        between = begins[(begins > first) & (begins <= one.begin)]
        turns = [
            b for b in (*between, first) if b - first >= settling.of_commands and one.begin - b >= settling.of_motion
        ]
        assert turns or first == 0, "a start behind which motion settles, and commands before it"


@pytest.mark.parametrize(
    ("begins", "count", "settling"),
    [
        (np.array([0]), 8, Settling(0.0, 0.0)),
        (uneven(), 1, Settling(0.0, 0.0)),
        (np.array([0, 1000, 2000, 3000]), 8, Settling(0.0, 0.0)),
        (uneven(), 8, Settling(np.inf, 0.0)),
        (uneven(), 8, Settling(0.0, np.inf)),
        (uneven(), 8, Settling(0.0, 0.9 * N_SAMPLE)),
    ],
    ids=["one stretch", "one segment", "few stretches", "commands last", "motion lasts", "nothing spared"],
)
def test_runs_that_are_better_in_one_piece(begins: np.ndarray, count: int, settling: Settling) -> None:
    assert len(segments_of(begins, N_SAMPLE, count, settling)) == 1


@pytest.mark.parametrize("count", [1, 3])
@pytest.mark.parametrize("hold", ["zero-order", "linear"])
@pytest.mark.parametrize("effect", ["time_delay", "periodic_disturbance", "amplifier_bandwidth", "position_sensor_lag"])
def test_stretches_that_begin_where_the_run_is_change_nothing(
    servo: Actuator, table: MagneticTable, effect: str, hold: Any, count: int
) -> None:
    """What waits, lags and turns goes on over a start, no sample twice."""
    plain = lanes_of(servo, table, "voltage", only(effect, count))
    lanes = replace(plain, inputs=replace(plain.inputs, hold=hold))
    at = replace(lanes.settings, begins=None, starts=lanes.settings.starts[:, 0], in_segments=False)
    whole = run_lanes(lanes.surface, lanes.plants, lanes.inputs, substeps=lanes.substeps, settings=at)
    begins = lanes.settings.begins
    assert begins is not None
    rows = np.array([whole.rows(lane)[begins] for lane in range(count)])
    starts = rows[:, :, [OUT_I1, OUT_I2, OUT_X, OUT_V]]
    starts[:, 0] = lanes.settings.starts[:, 0]
    of_all = replace(lanes, settings=replace(lanes.settings, starts=starts))
    for in_segments in (False, True):
        found = run_of(of_all, in_segments=in_segments)
        for name in ("position", "velocity", "current", "voltage"):
            one, other = getattr(whole, name), getattr(found, name)
            assert np.abs(other - one).max() < 1e-9 * np.abs(one).max(), (name, in_segments)
