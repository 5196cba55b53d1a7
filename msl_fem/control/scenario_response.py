"""The reference's response on plants that are not the believed one, by the linear loop about the middle.

With P the believed plant, P' another and C the feedback, the loop that follows the model's promise x gives on P'

    y = P' (u + C (x - y)),  x = P u:      T'/T = R (1 + L)/(1 + R L),   R = P'/P,  L = C P

at the command, sampled. T is the response on the belief (`LinearLaw.reference_response`).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.control.closed_loop import PlantUnderTest
from msl_fem.control.design import ControllerDesign
from msl_fem.control.design_model import plant_with_effects, surface_with_effects
from msl_fem.control.inverse import believed_gap, magnet_force, side_surface
from msl_fem.control.linear_loop import Complex
from msl_fem.control.linear_plant import LinearPlant, linear_plant
from msl_fem.control.robust_design import Deviation, deviating_plant
from msl_fem.plant.effects import EffectValues, design_change

_CURRENT_SHARE = 0.1  # of the magnet's largest current: where the magnets' gains are compared
_DESCRIBING = 0.75  # of k_3 a^2: the stiffness of a cubic spring to the fundamental of a sine of amplitude a


@dataclass(frozen=True)
class Scenario:
    """A plant about the middle: its motion and drive, how it deviates, and what its sensor adds in time (s)."""

    plant: LinearPlant
    deviation: Deviation
    sensor_lag: float = 0.0
    sensor_delay: float = 0.0


def scenarios_of(
    design: ControllerDesign, plants: Sequence[PlantUnderTest], *, amplitude: float
) -> tuple[Scenario, ...]:
    """One for each side of each plant, whose force that side's magnets give; `amplitude` in m is the reference's.

    A cubic spring counts by its describing function. Of effects there are those that a design can know
    (`design_change`), second mass, and the sensor's gain, lag and delay.
    """
    return tuple(
        _scenario(design, one, side, amplitude) for one in plants for side in range(design.parameters.inverse.sides)
    )


def _scenario(design: ControllerDesign, under_test: PlantUnderTest, side: int, amplitude: float) -> Scenario:
    effects = under_test.effects or EffectValues({})
    sides = design.parameters.inverse.sides
    plant = plant_with_effects(linear_plant(under_test.actuator, design.current_loop), effects, sides=sides)
    change = design_change(effects, sides=sides)
    more, late = change.cubic - design.parameters.cubic, change.delay % plant.period
    deviation = Deviation(
        mass_share=effects.get("structural_mode", "mass_share"),
        frequency=effects.get("structural_mode", "frequency"),
        damping_ratio=effects.get("structural_mode", "damping_ratio"),
        gain=_force_gain(design, under_test, effects, side)
        * (1 + effects.get("position_sensor_nonlinearity", "gain_error")),
    )
    return Scenario(
        replace(
            plant,
            stiffness=plant.stiffness + _DESCRIBING * more * amplitude**2,
            dead_time=plant.dead_time + late,  # whole samples are in the delay already
        ),
        deviation,
        effects.get("position_sensor_lag", "lag"),
        effects.get("time_delay", "position"),
    )


def _force_gain(design: ControllerDesign, under_test: PlantUnderTest, effects: EffectValues, side: int) -> float:
    """The force of a side's magnet over the believed one, at the same current in the middle."""
    inverse = design.parameters.inverse
    motion = under_test.actuator.motion
    assert motion is not None
    assert motion.nominal_gap is not None
    change = design_change(effects, sides=inverse.sides)
    gap = motion.nominal_gap + (change.gap_1 if side == 0 else change.gap_2)
    current = _CURRENT_SHARE * inverse.current_limit
    true = magnet_force(surface_with_effects(under_test.table, effects), current, gap)
    return float(true / magnet_force(side_surface(inverse, side), current, believed_gap(inverse, side, 0.0)))


def response_over_belief(design: ControllerDesign, scenario: Scenario, frequency: Array) -> Complex:
    """(n_frequency,) T'/T of a scenario; nan where the loop is unstable with it."""
    law = design.law
    member = deviating_plant(scenario.plant, scenario.deviation, 0.0)
    if law.spectral_radius(plant=member) >= 1:
        return np.full(frequency.size, np.nan, dtype=complex)
    jw = 2j * np.pi * frequency
    sensor = np.exp(-jw * scenario.sensor_delay) / (1 + jw * scenario.sensor_lag)
    over = sensor * member.response(frequency)[:, 0, 0] / law.plant.driven().response(frequency)[:, 0, 0]
    loop = law.loop_transfer(frequency)
    return np.asarray(over * (1 + loop) / (1 + over * loop))
