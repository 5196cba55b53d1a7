"""Lanes of `run_lanes` beside lanes of other kinds, and those left over: each is the run that it is alone."""

from typing import Any

import numpy as np
import pytest
from coupled_twin import changed
from effect_sets import ALL_EFFECTS, rough

from msl_fem.actuator import Actuator
from msl_fem.computing.lanes import LANES
from msl_fem.plant.effects import EffectValues, neutral_vector
from msl_fem.plant.lane_run import FEW, LaneSettings, run_lanes
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
