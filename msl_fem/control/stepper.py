"""A controller's steps one by one: what it takes of a reference, its commands, and what a record states of it."""

from typing import Any

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.control.controller import COMING, causal_step, controller_state, controller_step
from msl_fem.control.current_step import N_STATE, current_step
from msl_fem.control.design import ControllerDesign
from msl_fem.control.output_stage import BIAS
from msl_fem.control.preview import carried_on, known_ahead

_KNOWN_AHEAD = 6  # numbers of a reference in a step


def reference_rows(design: ControllerDesign, samples: Array, *, period: float) -> Array:
    """(n, 6) what the controller's step takes for samples (n, 3) of a reference, `period` s apart.

    Position, velocity, acceleration of now; then those of a lead later, known ahead or carried on.
    """
    lead = design.parameters.lead
    later = known_ahead(samples, period=period, lead=lead) if design.law.preview else carried_on(samples, lead)
    return np.ascontiguousarray(np.hstack([samples, later]))


class Stepper:
    """A design in a loop; whoever runs the loop keeps the command until it acts."""

    def __init__(self, design: ControllerDesign) -> None:
        self._design = design
        self._parameters = design.parameters
        self._plant = design.law.plant
        self._state = controller_state(design.parameters)
        self._command, self._voltage = np.zeros(2), np.zeros(2)
        self._loop_state, self._aims = np.zeros(N_STATE), np.zeros(self._plant.delay + 1)

    @property
    def rate(self) -> float:
        """Commands a second, Hz."""
        return round(1.0 / self._plant.period, 9)

    @property
    def delay_samples(self) -> int:
        """Periods from a command's computation until it acts."""
        return self._plant.delay

    @property
    def current_loop_rate(self) -> float | None:
        """Voltages a second, Hz, of the current loop around a voltage drive; None: the drive takes the commands."""
        loop = self._design.current_loop
        return None if loop is None else round(loop.rate, 9)

    def start(self) -> None:
        """Forgets all runs before."""
        self._state = controller_state(self._parameters)
        self._loop_state[:] = self._aims[:] = 0.0

    def rows(self, samples: Array, *, period: float) -> Array:
        """(n, 6) what `command` takes for samples (n, 3) of a reference, `period` s apart; see `reference_rows`."""
        return reference_rows(self._design, samples, period=period)

    def command(self, reference: Array, measured: float) -> Array:
        """(n_side,) A for a row (6,) of the reference, or what is wanted now (3,), and the measured position in m."""
        step = controller_step if reference.size == _KNOWN_AHEAD else causal_step
        step(self._parameters, self._state, reference, measured, self._command)
        self._aims[:-1] = self._aims[1:]
        self._aims[-1] = self._state[COMING]
        return self._command[: self._parameters.inverse.sides].copy()

    def voltage(self, wanted: Array, read: Array, measured: float) -> Array:
        """(n_side,) V of the current loop, to act one of its periods later.

        Parameters
        ----------
        wanted : (2,) A, the commands that act now
        read : (2,) A
        measured : m, the position

        Raises
        ------
        ValueError : there is no current loop
        """
        loop = self._design.current_loop
        if loop is None:
            raise ValueError("the design has no current loop: its drive takes currents")
        current_step(loop.parameters, self._loop_state, wanted, read, measured, float(self._aims[0]), self._voltage)
        return self._voltage[: self._parameters.inverse.sides].copy()


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
        "law": design.summary,
        "design": design.kind,
        **wishes,
        "feedforward": law.feedforward,
        "gain": law.gains.state.tolist(),
        "integral_gain": law.gains.integral,
        "filter_gain": law.estimator.gain.tolist(),
    }
