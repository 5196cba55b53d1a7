"""An excitation that the open loop bears: run it, or find the amplitude that it would bear."""

import numpy as np

from msl_fem.actuator import Actuator
from msl_fem.errors import ComputationError, InputError
from msl_fem.maps.guard import REGIONS, Guard
from msl_fem.plant.effects import EffectValues
from msl_fem.plant.excitation_kinds import Excitation
from msl_fem.plant.inputs import excitation_inputs
from msl_fem.plant.open_loop import check_open_loop
from msl_fem.plant.plant import plant_parameters
from msl_fem.plant.simulate import Simulation, simulate
from msl_fem.table.magnetic_table import MagneticTable

HALVINGS = 5


def bearable_run(
    actuator: Actuator,
    table: MagneticTable | None,
    excitation: Excitation,
    *,
    rate: float,
    effects: EffectValues | None = None,
    guard: Guard | None = None,
    generator: np.random.Generator | None = None,
) -> tuple[Simulation, Excitation]:
    """The run of an excitation, its amplitude halved until the open loop stays in range and map, and that excitation.

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
            run = simulate(actuator, table, inputs, effects=effects, generator=generator)
            check_map(actuator, run, guard)
            return run, tried
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
    effects: EffectValues | None = None,
    guard: Guard | None = None,
    generator: np.random.Generator | None = None,
) -> Simulation:
    """The run of an excitation as it stands.

    Raises
    ------
    InputError : the open loop does not bear it, or it leaves the map of the guard; the message names the limit, and an
        amplitude that is borne
    """
    inputs = excitation_inputs(actuator, excitation, rate=rate)
    try:
        check_open_loop(actuator, table, inputs)
        run = simulate(actuator, table, inputs, effects=effects, generator=generator)
        check_map(actuator, run, guard)
        return run
    except (InputError, ComputationError) as err:
        lower = excitation.model_copy(update={"amplitude": excitation.amplitude / 2})
        try:
            borne = bearable_run(actuator, table, lower, rate=rate, effects=effects, guard=guard)[1]
        except ComputationError:
            raise err from None
        raise InputError(f"{err}; an amplitude of {borne.amplitude:.3g} {borne.unit} is borne") from err


def check_map(actuator: Actuator, run: Simulation, guard: Guard | None) -> None:
    """Returns where every sample of a run lies in the guard's map, preferred or discouraged, or there is no guard.

    Raises
    ------
    InputError : names the first sample that the guard forbids, and why
    """
    plant = plant_parameters(actuator)
    for j in range(plant.sides if guard is not None else 0):
        assert guard is not None
        current = np.abs(plant.current_share * run.current[:, j])
        gap = plant.nominal_gap - (1 - 2 * j) * run.position
        forbidden = np.flatnonzero(guard.regions(current, gap) == REGIONS.index("unacceptable"))
        if forbidden.size:
            k = int(forbidden[0])
            judged = guard.judge(float(current[k]), float(gap[k]))
            raise InputError(
                f"{actuator.name}: side {j + 1} leaves the operating map after {run.time[k]:.4g} s: {judged.reason}; "
                "lower the amplitude or the bias"
            )
