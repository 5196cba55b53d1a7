"""Free runs of the coupled model along a record's run: inputs given, readings simulated."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from msl_fem.computing.gauss_newton import FitSettings, fit_map
from msl_fem.errors import ComputationError, OutOfTable
from msl_fem.plant import kernel, linearise
from msl_fem.plant.coefficients import drive_lags
from msl_fem.plant.plant import FORCE_DRIVE, plant_parameters
from msl_fem.plant.readings import Channels, currents_before_noise, position_before_noise
from msl_fem.plant.simulate import STATUS
from msl_fem.plant.starting import start_effects
from msl_fem.plant.state import OK, initial_state
from msl_fem.prediction.believed import KernelPlant, ModelHypothesis
from msl_fem.prediction.run_data import POSITION_COLUMN, RunData

Array = NDArray[np.float64]
GROWTH = 20.0  # of an error in one stretch of a run, beyond which a free run says nothing
LOOKED_AT = 4000  # samples of a run at which its stiffness is looked at
START_SECONDS, START_SAMPLES = 0.05, 100  # what the start of a run is estimated from, the longer of both
FIRST_LOOK = 9  # samples of the straight line that gives a first guess of position and velocity


@dataclass(frozen=True)
class Start:
    """Where a run begins: A of each side, m, m/s."""

    currents: tuple[float, float]
    position: float
    velocity: float


@dataclass(frozen=True, eq=False)
class FreeRun:
    """Simulated readings by channel, (n_sample,) each, nan from `ended` on, which is None for a whole run."""

    readings: Mapping[str, Array]
    ended: int | None = None
    reason: str = ""


def open_loop_stable(belief: ModelHypothesis, data: RunData) -> bool:
    """Whether the plant returns from a small push at the run's mean position and RMS currents, and nowhere along the
    run grows an error by more than `GROWTH`.

    A rig without a spring does not return: an error of its force stays in its position.
    """
    p = believed_currents(belief, data)
    try:
        at = linearise(
            belief.actuator, belief.table, currents=p, position=float(np.mean(data.measured[POSITION_COLUMN]))
        )
    except OutOfTable:
        return False
    return at.stiffness > 0 and at.is_stable and error_growth(belief, data) <= GROWTH


def error_growth(belief: ModelHypothesis, data: RunData) -> float:
    """The largest factor by which a small error of the position grows in one stretch of a run, by the stiffness K that
    the belief has at the measured positions and currents: exp of the integral of sqrt(-K/m) - c/(2 m) where K < 0."""
    p, table = plant_parameters(belief.actuator), belief.table
    if table is None or not p.sides:
        return 1.0
    every = max(1, len(data.commands) // LOOKED_AT)
    x = data.measured[POSITION_COLUMN][::every]
    stiffness = np.full(x.shape, p.stiffness)
    for j in range(p.sides):
        current = np.abs(data.measured.get(f"current_{j + 1}_A", data.commands[:, j])[::every]) * p.current_share
        gap = np.clip(p.nominal_gap - (1 - 2 * j) * x, table.gap[0], table.gap[-1])
        magnet = table.evaluate(np.minimum(current, table.current[-1]), gap)
        stiffness = stiffness + p.magnets * magnet["force_gap_slope"]
    rate = np.sqrt(np.maximum(-stiffness, 0.0) / p.mass) - p.damping / (2 * p.mass)
    grown, largest = 0.0, 0.0
    for step in rate * every / data.rate:
        grown = grown + step if step > 0 else 0.0
        largest = max(largest, grown)
    return float(np.exp(min(largest, 700.0)))


def believed_currents(belief: ModelHypothesis, data: RunData) -> tuple[float, float]:
    """RMS currents of the sides over a run: as measured, else as commanded."""
    sides = belief.actuator.sides.count if belief.actuator.sides and belief.actuator.magnet else 0
    found = [0.0, 0.0]
    for j in range(sides):
        values = data.measured.get(f"current_{j + 1}_A", data.commands[:, j])
        found[j] = float(np.sqrt(np.mean(values**2)))
    return found[0], found[1]


def free_run(plant: KernelPlant, data: RunData, start: Start) -> FreeRun:
    """The run from a start to its end, or to where the plant leaves table or range."""
    n = len(data.commands)
    out = np.full((n, kernel.N_OUT), np.nan)
    status, done = kernel.run(
        plant.surface, plant.parameters, plant.effects, kernel_state(plant, start), data.commands, np.zeros(n),
        plant.step, plant.substeps, out,
    )  # fmt: skip
    out[done:] = np.nan
    readings = readings_of(plant, data, out)
    if status == OK:
        return FreeRun(readings)
    return FreeRun(readings, int(done), f"{STATUS[int(status)]} at sample {int(done)}")


def kernel_state(plant: KernelPlant, start: Start) -> Array:
    """The kernel's state (N_STATE,) at a start."""
    state = initial_state(plant.parameters, *start.currents, start.position, start.velocity)
    if plant.effects is not None:
        start_effects(plant.surface, plant.parameters, plant.effects, state)
    return state


def guessed_start(plant: KernelPlant, data: RunData) -> Start:
    """Position and velocity of the straight line through the first samples, currents as read or commanded."""
    time = np.arange(FIRST_LOOK) / data.rate
    slope, position = np.polyfit(time, data.measured[POSITION_COLUMN][:FIRST_LOOK] / plant.gain, 1)
    currents = [0.0, 0.0]
    if plant.parameters.drive != FORCE_DRIVE:
        for j in range(plant.parameters.sides):
            read = data.measured.get(f"current_{j + 1}_A")
            currents[j] = float(data.commands[0, j] if read is None else read[0])
    return Start((currents[0], currents[1]), float(position), float(slope))


def start_sigmas(plant: KernelPlant, data: RunData) -> Array:
    """One sigma of the first guess: position, velocity, and the currents that cannot jump."""
    position = data.noise[POSITION_COLUMN].sigma
    lagging = [
        data.noise[f"current_{j + 1}_A"].sigma
        for j in range(plant.parameters.sides)
        if drive_lags(plant.parameters) and f"current_{j + 1}_A" in data.measured
    ]
    return np.array([position, position * data.rate, *lagging])


def moved_start(guess: Start, by: Array) -> Start:
    """A start moved by (position, velocity, currents ...)."""
    currents = np.array(guess.currents)
    currents[: by.size - 2] += by[2:]
    return Start((float(currents[0]), float(currents[1])), guess.position + float(by[0]), guess.velocity + float(by[1]))


def measured_start(plant: KernelPlant, data: RunData) -> Start:
    """Where a run begins, most probably: the model's own run through its first samples, from a guess by the readings.

    A start taken from single readings would carry their noise into a lightly damped mode.
    """
    guess = guessed_start(plant, data)
    head = data.first(max(START_SAMPLES, int(START_SECONDS * data.rate)))
    sigmas = start_sigmas(plant, data)

    size = 1.0

    def residuals(z: Array) -> Array:
        return np.array([weighted(free_run(plant, head, moved_start(guess, row * sigmas)), head) / size for row in z])

    try:
        found = fit_map(residuals, np.zeros(sigmas.size), settings=FitSettings(step=1e-3, damping=1.0, most_steps=15))
        size = max(1.0, float(np.sqrt(np.mean(found.residual**2))))  # a model error is no information
        if size > 1.0:
            found = fit_map(residuals, found.parameters, settings=FitSettings(step=1e-3, damping=1.0, most_steps=15))
    except ComputationError:
        return guess
    return moved_start(guess, found.parameters * sigmas)


def weighted(run: FreeRun, data: RunData, scale: Mapping[str, float] | None = None) -> Array:
    """Measured less simulated over the noise (times `scale`), channel after channel; of those with stated noise, or
    position and currents."""
    scale = scale or {}
    return np.concatenate(
        [
            (data.measured[name] - run.readings[name]) / (data.noise[name].sigma * scale.get(name, 1.0))
            for name in counted(data)
        ]
    )


def counted(data: RunData) -> list[str]:
    """Channels that a fit looks at: voltages only where their noise is stated."""
    return [name for name in data.measured if not name.startswith("voltage") or data.noise[name].stated]


def readings_of(plant: KernelPlant, data: RunData, out: Array) -> dict[str, Array]:
    """What a run's instruments read, before noise, of the kernel's rows (n_sample, N_OUT): channel to (n_sample,)."""
    channels = Channels.of(out, plant.parameters.sides)
    found = {POSITION_COLUMN: plant.gain * position_before_noise(channels, plant.readings, rate=data.rate)}
    if plant.parameters.sides:
        currents = currents_before_noise(channels, plant.readings, rate=data.rate)
        for j in range(plant.parameters.sides):
            found[f"current_{j + 1}_A"] = currents[:, j]
            found[f"voltage_{j + 1}_V"] = out[:, kernel.OUT_VOLTAGE_1 + j]
    return {name: found[name] for name in data.measured}
