"""Runs in closed loop, or of a plant that is not stable in open loop, as a likelihood; a static map beside them.

Where the laws that drove the runs are all stated and the believed model follows them to their ends, the runs are
simulated in closed loop (`prediction.closed_loop`): the residual is that of an output error, shaped by the loop's
sensitivity, which the noise's colour takes up. Else the residual is the innovation of an extended Kalman predictor
with the process noise that suits the belief; that noise takes up much of what a model gets wrong, so that less is
seen. Fit runs and held-out runs are predicted alike. A static map of the same magnet adds its rows:
table, scale and gap are the same unknowns on both sides.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from msl_fem.diagnosis.extension import extended_belief
from msl_fem.diagnosis.fit import Fit, Likelihood
from msl_fem.diagnosis.held_out import Followed
from msl_fem.diagnosis.joint import NOTE, JointLikelihood, common_error
from msl_fem.diagnosis.noise_bands import make_bands, transformed
from msl_fem.diagnosis.other_records import Kind
from msl_fem.diagnosis.prepare import START, highest_line
from msl_fem.diagnosis.scene import scene
from msl_fem.diagnosis.simulator import Points, Problem
from msl_fem.diagnosis.static_maps import prepared_map
from msl_fem.diagnosis.unknowns import Unknowns
from msl_fem.diagnosis.variants import Variant, possible, variants
from msl_fem.errors import InputError
from msl_fem.plant.effects import kernel_coefficients, neutral_vector
from msl_fem.plant.preparation import small_signal_inductance
from msl_fem.prediction import (
    KernelPlant,
    ModelHypothesis,
    ProcessNoise,
    RunData,
    Start,
    closed_run,
    free_parameters,
    kalman_filter,
    kernel_plant,
    measured_start,
    tuned_process_noise,
)
from msl_fem.prediction.free_run import moved_start, start_sigmas
from msl_fem.prediction.hypothesis import with_factors
from msl_fem.record import Record

Array = NDArray[np.float64]
Way = Literal["closed-loop", "one-step"]


@dataclass(frozen=True, eq=False)
class LoopLikelihood(JointLikelihood):
    """Runs by closed loop or by innovations, and the rows of a static map.

    Attributes
    ----------
    way : how the runs are predicted
    noise : of the predictor, for innovations
    """

    way: Way
    noise: ProcessNoise

    def of_runs(self, points: Points) -> Array:
        """Residuals of the runs in the frequency domain over their white sigma, (n_row, n_number)."""
        vectors = points.effects if points.effects is not None else [neutral_vector()] * len(points.rows)
        rows = [self._row(points.unknowns, z, effects) for z, effects in zip(points.rows, vectors, strict=True)]
        return np.array(rows)

    def _row(self, unknowns: Unknowns, z: Array, effects: Array) -> Array:
        parts = []
        for run, data in enumerate(self.problem.runs):
            try:
                plant = plant_at(self.problem, unknowns, z, effects)
                start = None
                if self.way == "closed-loop":
                    start = moved_start(
                        self.problem.guesses[run], z[unknowns.start_rows(run)] * self.problem.start_sigmas[run]
                    )
                missed = missed_by(self.way, plant, data, start=start, noise=self.noise)
            except InputError:  # an effect beyond what the kernel takes
                missed = {name: np.full(len(data.commands), np.nan) for name in data.measured}
            n = self.bands.lines[run]
            parts += [transformed(missed[name] / data.noise[name].sigma, n) for name in self.problem.channels(run)]
        return np.concatenate(parts)

    def excess_of_runs(self, found: Fit) -> dict[str, float]:
        """Channel to RMS residual over the noise, of the lines that the bands hold."""
        power: dict[str, list[float]] = {}
        at = 0
        for run in range(len(self.problem.runs)):
            for name in self.problem.channels(run):
                width = 2 * self.bands.lines[run]
                power.setdefault(name, []).append(float(np.mean(found.residual[at : at + width] ** 2)))
                at += width
        return {name: float(np.sqrt(np.mean(values))) for name, values in power.items()}


def plant_at(problem: Problem, unknowns: Unknowns, z: Array, effects: Array) -> KernelPlant:
    """The plant at a point of the unknowns, with the steps of the believed one."""
    base, f = problem.plant, unknowns.factors(z)
    p = with_factors(base.parameters, f)
    surface = base.surface
    if problem.table_error is not None:
        change = np.tensordot(z[unknowns.table_rows], problem.table_error.modes, axes=1)
        surface = surface._replace(coefficients=f.get("magnetic_scale", 1.0) * (surface.coefficients + change))
    e = kernel_coefficients(
        p, effects, inductance=small_signal_inductance(p, surface), step=base.step, n_step=base.substeps
    )
    return KernelPlant(surface, p, e, effects, base.gain * f.get("position_gain", 1.0), base.rate, base.substeps)


def missed_by(
    way: Way, plant: KernelPlant, data: RunData, *, start: Start | None, noise: ProcessNoise
) -> dict[str, Array]:
    """Channel to (n_sample,) measured less predicted; nan where the model left its table or range.

    Innovations are scaled such that they have the noise's sigma where the predictor's variance is right.
    """
    if way == "closed-loop":
        found = closed_run(plant, data, start or measured_start(plant, data)).readings
        return {name: data.measured[name] - found[name] for name in data.measured}
    followed = kalman_filter(plant, data, noise)
    made = {name: followed.whitened[name] * data.noise[name].sigma for name in data.measured}
    for values in made.values():
        values[0] = 0.0
    return made


def loop_candidates(likelihood: Likelihood, found: Fit) -> list[Variant]:
    """All variants of all effects that the plant can have."""
    looked, plant = scene(likelihood, found), likelihood.problem.plant.parameters
    have = {one.effect for one in found.unknowns.effects}
    return [v for effect in possible(plant) if effect not in have for v in variants(effect, looked, plant)]


def prepared_loops(
    record: Record, belief: ModelHypothesis, data: Sequence[RunData], *, way: Way = "one-step"
) -> tuple[LoopLikelihood, Unknowns]:
    """The likelihood of fit runs (and the static map), and what it does not know without any effect."""
    runs = tuple(_without_voltages(run) for run in data)
    plant = kernel_plant(belief, rate=runs[0].rate, ideal_current=runs[0].ideal_current)
    guesses: tuple[Start, ...] = ()
    sigmas, noise = (np.zeros(0),) * len(runs), ProcessNoise(0.0, 0.0)
    if way == "closed-loop":
        guesses = tuple(measured_start(plant, run) for run in runs)
        sigmas = tuple(START * start_sigmas(plant, run) for run in runs)
    else:
        noise = tuned_process_noise(plant, runs)
    static = None
    if record.static is not None and belief.table is not None:
        static = prepared_map(record, belief.table)[0]
    error = common_error(record, belief, plant, (runs, static))
    problem = Problem(plant, runs, guesses, sigmas, error)
    if static is not None:
        static = replace(static, problem=replace(static.problem, table_error=error))
    highest = max(highest_line(run, run.measured) for run in runs)
    bands = make_bands([len(run.commands) for run in runs], runs[0].rate, highest=highest)
    believed = tuple(free_parameters(belief, record.tolerance).items())
    n_table = 0 if error is None else len(error.modes)
    unknowns = Unknowns(believed, n_table, tuple(s.size for s in sigmas))
    return LoopLikelihood(problem, bands, plant.substeps, static, way, noise), unknowns


def _without_voltages(run: RunData) -> RunData:
    return replace(run, measured={n: v for n, v in run.measured.items() if not n.startswith("voltage")})


def loops_followed(
    belief: ModelHypothesis, runs: Sequence[RunData], way: Way, *, noise: ProcessNoise
) -> list[Followed]:
    """How well a model follows runs, channel by channel, from their measured starts."""
    found = []
    for run in runs:
        data = _without_voltages(run)
        plant = kernel_plant(belief, rate=data.rate, ideal_current=data.ideal_current)
        missed = missed_by(way, plant, data, start=None, noise=noise)
        if way == "one-step":
            one_step = kalman_filter(plant, data, noise).one_step
            missed = {name: (data.measured[name] - one_step[name])[1:] for name in data.measured}
        for name, error in missed.items():
            rms = float(np.sqrt(np.mean(error**2))) if np.isfinite(error).all() else float("inf")
            deviation = float(data.measured[name].std())
            floor = data.noise[name].sigma
            found.append(Followed(data.name, data.role, name, rms, rms / deviation, floor, error.size, deviation))
    return found


def way_of(belief: ModelHypothesis, data: Sequence[RunData]) -> tuple[Way, str]:
    """How runs are predicted, and why not in closed loop."""
    without = [run.name for run in data if run.law is None]
    if without:
        told = f"the law that drove {', '.join(without)} is not stated"
        return "one-step", "no law of the controller is stated" if len(without) == len(data) else told
    for run in data:
        plant = kernel_plant(belief, rate=run.rate, ideal_current=run.ideal_current)
        if closed_run(plant, run, measured_start(plant, run)).ended is not None:
            return "one-step", f"in closed loop with its stated law the believed model does not follow {run.name}"
    return "closed-loop", ""


def of_loops(record: Record, belief: ModelHypothesis, data: Sequence[RunData]) -> tuple[LoopLikelihood, Unknowns, Kind]:
    """What the diagnosis of such a record needs."""
    way, why = way_of(belief, data)
    likelihood, unknowns = prepared_loops(record, belief, [run for run in data if run.role == "fit"], way=way)

    def extend(found: Fit) -> ModelHypothesis:
        return extended_belief(belief, likelihood.problem, found)

    notes = []
    if way == "one-step":
        told = "the process noise of the predictor takes up part of what the model gets wrong"
        notes.append(f"judged by one-step predictions: {why}, and {told}")
    if likelihood.static is not None:
        notes.append(NOTE)
    kind = Kind(
        way, belief, loop_candidates,
        lambda found: loops_followed(
            belief if found is None else extend(found), data, way, noise=likelihood.noise
        ), extend,
        notes=tuple(notes),
    )  # fmt: skip
    return likelihood, unknowns, kind
