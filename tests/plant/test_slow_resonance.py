"""A second resonance that is slow against the step: beside a fast current loop one step a sample tells it."""

import numpy as np
import pytest
from coupled_twin import changed

from msl_fem.actuator import Actuator
from msl_fem.diagnosis.runs import STEPS_A_TURN
from msl_fem.plant.effects import EffectValues
from msl_fem.plant.excitation import Inputs
from msl_fem.plant.lane_block import LaneSettings
from msl_fem.plant.lane_run import run_lanes
from msl_fem.plant.plant import plant_parameters, surface_of
from msl_fem.table.magnetic_table import MagneticTable

RATE, MANY = 1e4, 24
FARTHEST = float(np.exp(3 * 0.15))  # by which a fit may move a frequency from where it begins


def answers(servo: Actuator, table: MagneticTable, frequency: float, share: float, steps: int) -> np.ndarray:
    """(n_sample,) the position, less that of the plant without the resonance."""
    plant = plant_parameters(changed(servo, drive={"bandwidth": 2e3}))
    mode = {"mass_share": share, "frequency": frequency, "damping_ratio": 0.015}
    effects = np.array([EffectValues(of).vector() for of in ({}, {"structural_mode": mode})])
    chance = np.random.default_rng(5).standard_normal((600, 2))
    inputs = Inputs(0.5 + 0.1 * np.sin(np.cumsum(0.3 * chance, axis=0)), RATE)
    found = run_lanes(
        surface_of(table), [plant, plant], inputs, substeps=steps, settings=LaneSettings(effects=effects)
    ).true_position
    return np.asarray(found[1] - found[0])


def off(servo: Actuator, table: MagneticTable, frequency: float, share: float, steps: int) -> float:
    few, many = (answers(servo, table, frequency, share, n) for n in (steps, MANY))
    return float(np.linalg.norm(few - many) / np.linalg.norm(many))


@pytest.mark.parametrize("share", [0.003, 0.1])
@pytest.mark.parametrize("turns", [0.3, 1.0, FARTHEST])
def test_one_step_is_as_good_as_many_where_it_turns_slowly(
    servo: Actuator, table: MagneticTable, turns: float, share: float
) -> None:
    assert off(servo, table, turns * RATE / STEPS_A_TURN, share, 1) < 4e-3


def test_one_step_is_too_coarse_for_a_fast_one(servo: Actuator, table: MagneticTable) -> None:
    assert off(servo, table, RATE / 8, 0.003, 1) > 1e-2
    assert off(servo, table, RATE / 8, 0.003, 6) < 4e-3
