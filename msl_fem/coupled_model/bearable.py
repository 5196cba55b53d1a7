"""An excitation that the open loop bears: run it, or find the amplitude that it would bear."""

import numpy as np

from msl_fem.actuator import Actuator
from msl_fem.coupled_model.excitation_kinds import Excitation
from msl_fem.coupled_model.inputs import excitation_inputs
from msl_fem.coupled_model.open_loop import check_open_loop
from msl_fem.coupled_model.simulate import Simulation, simulate
from msl_fem.errors import ComputationError, InputError
from msl_fem.table import MagneticTable

HALVINGS = 5


def bearable_run(
    actuator: Actuator,
    table: MagneticTable | None,
    excitation: Excitation,
    *,
    rate: float,
    generator: np.random.Generator | None = None,
) -> tuple[Simulation, Excitation]:
    """The run of an excitation with its amplitude halved until the open loop stays in its range, and that excitation.

    Raises
    ------
    InputError : the excitation does not fit the actuator
    ComputationError : no amplitude down to a 32nd is borne
    """
    first: Exception | None = None
    for n in range(HALVINGS + 1):
        tried = excitation.model_copy(update={"amplitude": excitation.amplitude / 2**n})
        inputs = excitation_inputs(actuator, tried, rate=rate)
        try:
            check_open_loop(actuator, table, inputs)
            return simulate(actuator, table, inputs, generator=generator), tried
        except (InputError, ComputationError) as err:
            first = first or err
    raise ComputationError(
        f"no amplitude down to {tried.amplitude:.2g} {tried.unit} keeps the mover in its range: {first}"
    )


def refused_unless_borne(
    actuator: Actuator,
    table: MagneticTable | None,
    excitation: Excitation,
    *,
    rate: float,
    generator: np.random.Generator | None = None,
) -> Simulation:
    """The run of an excitation as it stands.

    Raises
    ------
    InputError : the open loop does not bear it; the message names the limit, and an amplitude that is borne
    """
    inputs = excitation_inputs(actuator, excitation, rate=rate)
    try:
        check_open_loop(actuator, table, inputs)
        return simulate(actuator, table, inputs, generator=generator)
    except (InputError, ComputationError) as err:
        lower = excitation.model_copy(update={"amplitude": excitation.amplitude / 2})
        try:
            borne = bearable_run(actuator, table, lower, rate=rate)[1]
        except ComputationError:
            raise err from None
        raise InputError(f"{err}; an amplitude of {borne.amplitude:.3g} {borne.unit} is borne") from err
