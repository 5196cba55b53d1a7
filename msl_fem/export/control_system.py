"""A linear model as an object of python-control, with its names."""

from typing import TYPE_CHECKING

from msl_fem.computing.statespace import StateSpace
from msl_fem.errors import InputError

if TYPE_CHECKING:
    import control


def control_system(model: StateSpace) -> "control.StateSpace":
    """The model of `linearise(...).model`, or any other, for `control.bode_plot`, `control.lqr` and the like.

    Signals and states keep their names and SI units; a sampled model keeps its period.

    Raises
    ------
    InputError : python-control is not installed
    """
    try:
        import control
    except ImportError as err:
        raise InputError("an object of python-control needs control: pip install control") from err
    named = {kind: list(getattr(model, kind)) for kind in ("states", "inputs", "outputs") if getattr(model, kind)}
    period = 0 if model.sampling_period is None else model.sampling_period
    return control.ss(model.A, model.B, model.C, model.D, period, **named)
