"""The plant that a controller acts on, with what its drive takes: currents, or voltages from a current loop."""

import numpy as np

from msl_fem.actuator import Actuator
from msl_fem.control.current_loop import CurrentLoopDesign, current_noise
from msl_fem.control.current_step import N_STATE
from msl_fem.control.power_stage import CurrentLoopInPlant
from msl_fem.errors import InputError
from msl_fem.plant.effects import EffectValues
from msl_fem.plant.plant import CURRENT_DRIVE, VOLTAGE_DRIVE
from msl_fem.plant.sampled_plant import SampledPlant, sampled_plant
from msl_fem.table.magnetic_table import MagneticTable

STEP_OF_FASTEST = 0.42  # of the plant's fastest time constant: within 20 nm of steps a tenth as long, in motion


def driven_plant(
    plant: tuple[Actuator, MagneticTable, EffectValues | None], current_loop: CurrentLoopDesign | None,
    samples: tuple[int, float], *, generator: np.random.Generator | None,
) -> tuple[SampledPlant, CurrentLoopInPlant | None]:  # fmt: skip
    """The plant as a controller sees it, and the current loop around its voltages where it has one.

    Parameters
    ----------
    samples : how many the controller takes, and how many a second
    generator : of the current readings' noise

    Raises
    ------
    InputError : the plant has another drive than the controller believes; it cannot have one of its effects
    """
    (actuator, table, effects), (n, rate) = plant, samples

    def sampled_at(rate: float) -> SampledPlant:
        return sampled_plant(actuator, table, rate=rate, effects=effects, largest_step=STEP_OF_FASTEST)

    true = sampled_at(rate)
    drive = true.parameters.drive
    if current_loop is None:
        if drive != CURRENT_DRIVE:
            raise InputError(f'{actuator.name}: the controller commands currents; use drive.kind = "current"')
        return true, None
    if drive != VOLTAGE_DRIVE:
        raise InputError(
            f"{actuator.name}: the controller has a current loop of its own and gives voltages; use drive.kind = "
            '"voltage"'
        )
    noise = current_noise(current_loop, actuator, n, generator=generator)
    inner = CurrentLoopInPlant(current_loop.parameters, current_loop.stage, noise, np.zeros(N_STATE))
    return sampled_at(current_loop.rate)._replace(instruments=true.instruments), inner
