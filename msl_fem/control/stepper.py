"""A designed controller as an object that is asked sample by sample, and how rig.toml states it."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from msl_fem.control.controller import controller_state, controller_step
from msl_fem.control.design import KINDS, ControllerDesign
from msl_fem.control.output_stage import BIAS

Array = NDArray[np.float64]


class Stepper:
    """A design in a loop; whoever runs the loop keeps the command until it acts."""

    def __init__(self, design: ControllerDesign) -> None:
        self._parameters, self._plant = design.parameters, design.law.plant
        self._state, self._command = controller_state(design.parameters), np.zeros(2)

    @property
    def rate(self) -> float:
        """Commands a second, Hz."""
        return round(1.0 / self._plant.period, 9)

    @property
    def delay_samples(self) -> int:
        """Periods from a command's computation until it acts."""
        return self._plant.delay

    def start(self) -> None:
        """Forgets all runs before."""
        self._state = controller_state(self._parameters)

    def command(self, reference: Array, measured: float) -> Array:
        """(n_side,) A for position, velocity, acceleration wanted now (3,) and the measured position in m."""
        controller_step(self._parameters, self._state, reference, measured, self._command)
        return self._command[: self._parameters.inverse.sides].copy()


def stated(design: ControllerDesign, **wishes: Any) -> dict[str, Any]:
    """The section [controller] of a record that this design drove.

    `law` is for people; `design` and the wishes make the same controller again from the record's actuator and table;
    by the gains it is recognised, and they stand there for who has another program.
    """
    law, stage = design.law, design.parameters.stage
    if stage.kind == BIAS:
        wishes = {"bias": f"{stage.bias!r} A", **wishes}
    elif stage.overlap > 0.0:
        wishes = {"overlap": f"{stage.overlap!r} N", **wishes}
    return {
        "rate": f"{round(1.0 / law.plant.period, 9):.12g} Hz",
        "delay_samples": law.plant.delay,
        "law": KINDS[design.kind],
        "design": design.kind,
        **wishes,
        "feedforward": law.feedforward,
        "gain": law.gains.state.tolist(),
        "integral_gain": law.gains.integral,
        "filter_gain": law.estimator.gain.tolist(),
    }
