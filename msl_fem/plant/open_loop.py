"""Whether the open loop bears an excitation: judged before it is run, or run, or at which amplitude it would."""

import math

import numpy as np

from msl_fem.actuator import Actuator
from msl_fem.computing.arrays import Array
from msl_fem.errors import ComputationError, InputError
from msl_fem.maps.guard import REGIONS, Guard
from msl_fem.plant.effects import EffectValues
from msl_fem.plant.excitation import Inputs, excitation_inputs
from msl_fem.plant.excitation_kinds import Excitation
from msl_fem.plant.layout import OK, OUT_I1, OUT_I2, initial_state
from msl_fem.plant.operating_point import resting_point, stability_limit
from msl_fem.plant.plant import PlantParameters, plant_parameters, surface_of
from msl_fem.plant.simulate import Options, Simulation, integrate, simulate
from msl_fem.plant.step_count import default_substeps
from msl_fem.table.magnetic_table import MagneticTable


def check_open_loop(actuator: Actuator, table: MagneticTable | None, inputs: Inputs) -> None:
    """Returns where the averaged plant has a stable rest all the time, else raises.

    Force and negative stiffness of a magnet go with the square of its current (below saturation), and the mover
    averages them over its natural period T = 2 pi sqrt(m/k). So the currents' RMS values over every window of length T
    have to leave an equilibrium that the mover reaches from x = 0 (`resting_point`); for equal sides that is RMS <=
    `stability_limit`. A slow signal is judged by its peak, a fast one by its mean square. Tried are the windows with
    the largest sum, sides and differences of the mean squares. The currents are those of the drive, with its bandwidth
    and limits, at the locked mover.

    The condition is necessary, not sufficient: resonance near the natural frequency, and a modulated stiffness near
    twice it, can carry the mover off below the limit; `simulate` raises then. A force drive has nothing to check.

    Raises
    ------
    InputError : the limit is exceeded; names it, the time, and the factor by which to scale the currents
    """
    plant = plant_parameters(actuator)
    if plant.sides == 0 or table is None:
        return
    currents = _locked_currents(actuator, plant, table, inputs)
    period = 2 * math.pi * math.sqrt(plant.mass / plant.stiffness) if plant.stiffness > 0 else math.inf
    window = int(min(max(1, round(min(period, inputs.time.size / inputs.rate) * inputs.rate)), inputs.time.size))
    for start, rms in _telling_windows(currents, window):
        if not _rests(actuator, table, rms, 1.0):
            stated = f"{rms[0]:.3g} A RMS" + ("" if plant.sides == 1 else f" on side 1 and {rms[1]:.3g} A on side 2")
            raise InputError(
                f"{actuator.name}: from t = {start / inputs.rate:.4g} s the inputs make {stated} (over "
                f"{window / inputs.rate * 1e3:.3g} ms); {_way_out(actuator, table, rms)}"
            )


def _way_out(actuator: Actuator, table: MagneticTable, rms: tuple[float, float]) -> str:
    """What the open loop bears, and what to do; a mover that nothing holds has other ways than smaller currents."""
    limit, factor = stability_limit(actuator, table), _bearable(actuator, table, rms)
    others = (
        "hold the mover (simulate --locked), state motion.end_stop so that it has something to be pulled against, or "
        "follow a reference in closed loop ('msl-fem control')"
    )
    if factor <= 0:
        return f"no such current leaves the mover at rest in open loop, for nothing holds it; {others}"
    known = f"up to {limit:.3g} A RMS on all sides at x = 0" if math.isfinite(limit) else "for smaller currents"
    return f"the open loop is stable {known}; scale the currents by {factor:.2g}, {others}"


def _locked_currents(actuator: Actuator, plant: PlantParameters, table: MagneticTable, inputs: Inputs) -> Array:
    """The currents (n_sample, 2) that the drive makes while the mover is held at x = 0."""
    locked = plant._replace(mass=math.inf)
    state = initial_state(locked, 0.0, 0.0, 0.0, 0.0)
    substeps = default_substeps(plant, table, rate=inputs.rate, commands=inputs.commands)
    status, rows = integrate(surface_of(table), locked, inputs, state=state, substeps=substeps)
    if status != OK:
        raise InputError(
            f"{actuator.name}: the inputs drive a current or the nominal gap out of the table ({table.rectangle}) at "
            f"t = {len(rows) / inputs.rate:.4g} s; lower the amplitude or extend the sweep"
        )
    return rows[:, [OUT_I1, OUT_I2]]


def _telling_windows(currents: Array, window: int) -> list[tuple[int, tuple[float, float]]]:
    """(first sample, RMS currents) of the windows in which the mean squares are extreme."""
    total = np.vstack([np.zeros(2), np.cumsum(currents**2, axis=0)])
    square = np.maximum(total[window:] - total[:-window], 0.0) / window
    first, second = square.T
    sizes = (first + second, first, second, first - second, second - first)
    starts = sorted({int(np.argmax(size)) for size in sizes})
    return [(n, (math.sqrt(first[n]), math.sqrt(second[n]))) for n in starts]


def _rests(actuator: Actuator, table: MagneticTable, rms: tuple[float, float], factor: float) -> bool:
    try:
        resting_point(actuator, table, currents=(factor * rms[0], factor * rms[1]))
    except ComputationError:
        return False
    return True


def _bearable(actuator: Actuator, table: MagneticTable, rms: tuple[float, float]) -> float:
    """The largest factor on the currents that leaves a stable rest, rounded down to a hundredth."""
    low, high = 0, 100
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if _rests(actuator, table, rms, middle / 100) else (low, middle)
    return low / 100


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
    options: Options | None = None,
) -> Simulation:
    """The run of an excitation as it stands.

    A mover that is locked, or that has end stops to be pulled against, bears every excitation: a pull-in is a run.

    Raises
    ------
    InputError : the open loop does not bear it, or it leaves the map of the guard; the message names the limit, and an
        amplitude that is borne
    """
    inputs = excitation_inputs(actuator, excitation, rate=rate)
    options = options or Options()
    if options.locked or (actuator.motion is not None and actuator.motion.end_stop is not None):
        run = simulate(actuator, table, inputs, effects=effects, generator=generator, options=options)
        check_map(actuator, run, guard)
        return run
    try:
        check_open_loop(actuator, table, inputs)
        run = simulate(actuator, table, inputs, effects=effects, generator=generator, options=options)
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
