"""What is between a current loop and the coils: converters, a switched full bridge, its dead time."""

from typing import NamedTuple

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.computing.compiled import compiled
from msl_fem.control.current_step import ACTING, N_OF_SIDE, CurrentLoopParameters, current_step
from msl_fem.plant.layout import COIL_1, OK
from msl_fem.plant.sampled_plant import SampledPlant, advance_sample


class PowerStage(NamedTuple):
    """The hardware of a current loop.

    Of a period's mean voltage dead time takes 2 t rate V against the current (Mohan, Undeland, Robbins, Power
    Electronics, 3rd ed., sec. 8-5-2); where the ripple changes the current's sign within a period, in proportion less.
    Currents are sampled in the middle of the pulses, where the ripple is not seen.
    """

    dead_time_voltage: float  # V
    ripple: float  # A, half of the ripple from peak to peak
    current_step: float  # A, of the converter; 0: any
    current_end: float  # A, that it reads at most
    periods: int  # of the loop, in a sample of the controller


class CurrentLoopInPlant(NamedTuple):
    """A current loop, its hardware, and the noise of its readings (n_sample, periods, 2) A."""

    parameters: CurrentLoopParameters
    stage: PowerStage
    noise: Array
    state: Array


@compiled
def converted(stage: PowerStage, current: float) -> float:
    """A, what the converter makes of a current."""
    if stage.current_step == 0.0:
        return current
    steps = np.floor(current / stage.current_step + 0.5)
    most = np.floor(stage.current_end / stage.current_step)
    return float(min(max(steps, -most), most) * stage.current_step)


@compiled
def bridge_voltage(stage: PowerStage, voltage: float, current: float) -> float:
    """V, the mean that the bridge gives for a wanted one while a current flows."""
    share = 1.0 if stage.ripple == 0.0 else min(abs(current) / stage.ripple, 1.0)
    return voltage - (stage.dead_time_voltage * share if current > 0.0 else -stage.dead_time_voltage * share)


@compiled
def advance_on_current_loop(
    plant: SampledPlant, state: Array, loop: CurrentLoopInPlant, k: int, wanted: Array, measured: float, aim: float,
    push: float, voltage: Array,
) -> int:  # fmt: skip
    """`advance_sample` over one sample of the controller: the current loop is asked for `wanted` (2,) A, which were
    inverted at `aim` (m)."""
    stage, memory = loop.stage, loop.state
    read, given, applied, mean = np.zeros(2), np.zeros(2), np.zeros(2), np.zeros(2)
    voltage[0] = voltage[1] = 0.0
    status = OK
    for n in range(stage.periods):
        for side in range(2):
            current = state[COIL_1 + side]
            c = plant.instruments.polynomial[1 + side]
            seen = c[0] + current * (c[1] + current * (c[2] + current * c[3]))
            read[side] = converted(stage, seen + loop.noise[k, n, side])
            applied[side] = bridge_voltage(stage, memory[side * N_OF_SIDE + ACTING], current)
        current_step(loop.parameters, memory, wanted, read, measured, aim, given)
        status = advance_sample(plant, state, applied, push, mean)
        if status != OK:
            return status
        for side in range(2):
            voltage[side] += mean[side] / stage.periods
    return status
