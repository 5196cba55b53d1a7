"""Plants that no free run can follow, being unstable or in closed loop: loops, and movers held at rest.

Where the laws that drove the runs are all stated and the believed model follows them to their ends, the runs are
simulated in closed loop (`prediction.closed_run`): the residual is that of an output error, shaped by the loop's
sensitivity, which the noise's colour takes up. Else the residual is the innovation of an extended Kalman predictor
with the process noise that suits the belief; that noise takes up much of what a model gets wrong, so that less is
seen. Fit runs and held-out runs are predicted alike. A static map of the same magnet adds its rows:
table, scale and gap are the same unknowns on both sides.

A mover at rest is a static measurement: its weight and spring say what the magnet pulls with.
Where a loop is unstable without its controller, the seconds in which the mover rests are worth most: the mean of
position and current then lie on the static map, with a force that is known. As rows beside those of flux linkage they
ask whether one coenergy has both, which is what a prediction of the current that holds a mover rests on.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from msl_fem.computing.arrays import Array
from msl_fem.diagnosis.kind import ErrorSignal, Kind, without_those_of
from msl_fem.diagnosis.likelihood import START, Fit, FitProblem, Points, highest_line, make_bands, transformed
from msl_fem.diagnosis.static_maps import MAP_BESIDE, JointLikelihood, MapAlone, common_error, map_alone, prepared_map
from msl_fem.diagnosis.unknowns import EffectUnknown, Unknowns
from msl_fem.diagnosis.variants import Variant, variables_of
from msl_fem.errors import InputError
from msl_fem.plant import plant_parameters
from msl_fem.plant.effects import kernel_coefficients
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
    noise_floor,
    tuned_process_noise,
)
from msl_fem.prediction.free_run import moved_start, start_sigmas
from msl_fem.prediction.hypothesis import with_factors
from msl_fem.prediction.run_data import POSITION_COLUMN
from msl_fem.record import Record, Run, StaticMap

Way = Literal["closed-loop", "one-step"]
WINDOW = 1.0  # s; its second half is averaged
STILL = 2.5  # times the position's noise
FAITHFUL = 3.0  # a run rests at a few gaps: what is right there by chance errs elsewhere
OFFSET = Variant("force_offset", (EffectUnknown("force_offset", "force"),))
REVERSE = (
    "rest or lift off once more with the current reversed: the force of a flux that stays in the iron changes its sign "
    "with the current, that of a wrong gap, scale or weight does not; and weigh the mover under the coil at no current"
)


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
        return np.array([self._row(points.unknowns, z, effects) for z, effects in points.each()])

    def _row(self, unknowns: Unknowns, z: Array, effects: Array) -> Array:
        parts = []
        for n, run in enumerate(self.problem.runs):
            missed = self._missed(n, unknowns, z, effects)
            lines = self.bands.lines[n]
            parts += [transformed(missed[name] / run.noise[name].sigma, lines) for name in self.problem.channels(n)]
        return np.concatenate(parts)

    def _missed(self, n: int, unknowns: Unknowns, z: Array, effects: Array) -> dict[str, Array]:
        """What the plant at a point of the unknowns misses of a run."""
        run, start = self.problem.runs[n], None
        if self.way == "closed-loop":
            moved = z[unknowns.start_rows(n)] * self.problem.start_sigmas[n]
            start = moved_start(self.problem.guesses[n], moved)
        try:
            plant = plant_at(self.problem, unknowns, z, effects)
            return missed_by(self.way, plant, run, start=start, noise=self.noise)
        except InputError:  # an effect beyond what the kernel takes
            return {name: np.full(len(run.commands), np.nan) for name in run.measured}

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


def plant_at(problem: FitProblem, unknowns: Unknowns, z: Array, effects: Array) -> KernelPlant:
    """The plant at a point of the unknowns, with the steps of the believed one."""
    base, factors = problem.plant, unknowns.factors(z)
    p = with_factors(base.parameters, factors)
    surface = base.surface
    if problem.table_error is not None:
        surface = problem.surface(factors.get("magnetic_scale", 1.0), z[unknowns.table_rows])
    inductance = small_signal_inductance(p, surface)
    coefficients = kernel_coefficients(p, effects, inductance=inductance, step=base.step, n_step=base.substeps)
    gain = base.gain * factors.get("position_gain", 1.0)
    return KernelPlant(surface, p, coefficients, effects, gain, base.rate, base.substeps)


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
    error = common_error(record, belief, plant, runs, static)
    problem = FitProblem(plant, runs, guesses, sigmas, error)
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


@dataclass(frozen=True, eq=False)
class Loops(Kind):
    """Runs in closed loop or by one-step predictions, and the rows of a static map beside them; `runs` are all."""

    runs: tuple[RunData, ...] = ()

    @property
    def loops(self) -> "LoopLikelihood":
        assert isinstance(self.likelihood, LoopLikelihood)
        return self.likelihood

    @property
    def prediction(self) -> Way:  # type: ignore[override]
        return self.loops.way

    def errors(self, belief: ModelHypothesis, fit: Fit | None) -> list[ErrorSignal]:
        """From measured starts; of one-step predictions without the first sample, which none precedes."""
        signals = []
        for run in map(_without_voltages, self.runs):
            plant = kernel_plant(belief, rate=run.rate, ideal_current=run.ideal_current)
            if self.prediction == "closed-loop":
                predicted = closed_run(plant, run, measured_start(plant, run)).readings
            else:
                predicted = kalman_filter(plant, run, self.loops.noise).one_step
            for name in run.measured:
                values = (run.measured[name] - predicted[name])[self._first :]
                signals.append(ErrorSignal.of_run(run, name, values))
        return signals

    def variables(self) -> dict[str, Mapping[str, Array]]:
        found: dict[str, Mapping[str, Array]] = {}
        for run in self.runs:
            found[run.name] = {name: values[self._first :] for name, values in variables_of(run).items()}
        return found

    @property
    def _first(self) -> int:
        return 0 if self.prediction == "closed-loop" else 1


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


def loops(record: Record, belief: ModelHypothesis, runs: Sequence[RunData]) -> Loops:
    """A record of loops, made ready."""
    way, why = way_of(belief, runs)
    likelihood, unknowns = prepared_loops(record, belief, [run for run in runs if run.role == "fit"], way=way)
    notes = []
    if way == "one-step":
        told = "the process noise of the predictor takes up part of what the model gets wrong"
        notes.append(f"judged by one-step predictions: {why}, and {told}")
    if likelihood.static is not None:
        notes.append(MAP_BESIDE)
    return Loops(belief, likelihood, unknowns, tuple(notes), tuple(runs))


@dataclass(frozen=True, eq=False)
class StaticEquilibria:
    """StaticEquilibria of runs, (n_rest,) each: gap m, a magnet's current A, its force N, role of the run."""

    gap: Array
    current: Array
    force: Array
    role: NDArray[np.str_]


def static_equilibria(record: Record) -> StaticEquilibria:
    """All rests of a record's runs: seconds of a constant reference in which the mover stands within its noise."""
    p = plant_parameters(record.actuator)
    gaps, currents, forces, roles = [], [], [], []
    for run in record.runs:
        for late in _still(record, run):
            position = float(run[POSITION_COLUMN][late].mean())
            gaps.append(p.nominal_gap - position)
            currents.append(p.current_share * float(run["current_1_A"][late].mean()))
            forces.append((p.stiffness * position - p.constant_force) / p.magnets)
            roles.append(run.role)
    return StaticEquilibria(np.array(gaps), np.array(currents), np.array(forces), np.array(roles, dtype=str))


def _still(record: Record, run: Run) -> list[slice]:
    """The second halves of the windows in which a run rests."""
    if "current_1_A" not in run:
        return []
    n, x = round(WINDOW / run.sampling_period), run[POSITION_COLUMN]
    limit = STILL * noise_floor(record, POSITION_COLUMN).sigma
    found = []
    for start in range(0, x.size - n + 1, n):
        late = slice(start + n // 2, start + n)
        reference = run["reference_m"][start : start + n] if "reference_m" in run else np.zeros(1)
        if np.ptp(reference) == 0 and x[late].std() < limit:
            found.append(late)
    return found


def with_equilibria(record: Record, found: StaticEquilibria) -> Record:
    """The record with its rests as rows of its static map, and no runs."""
    static = record.static
    n, m = found.gap.size, 0 if static is None else static.gap.size
    none = np.full(m, np.nan)

    def joined(own: Array | None, more: Array) -> Array:
        return np.concatenate([none if own is None else own, more])

    empty = StaticMap(none, none, None, None, none.astype(str)) if static is None else static
    rows = StaticMap(
        gap=joined(empty.gap, found.gap),
        current=joined(empty.current, found.current),
        force=joined(empty.force, found.force),
        flux_linkage=joined(empty.flux_linkage, np.full(n, np.nan)),
        role=np.concatenate([empty.role, found.role]),
    )
    noise = record.noise
    if noise.force is None:
        noise = noise.model_copy(update={"force": _force_noise(record, found)})
    return replace(record, runs=(), sampling=None, static=rows, noise=noise)


def _force_noise(record: Record, found: StaticEquilibria) -> float:
    """N: the noise of the means of current and position, a force that grows as i^2/g^2 assumed."""
    share = WINDOW / 2 * (record.sampling.rate if record.sampling else 1.0)
    current = noise_floor(record, "current_1_A").sigma / np.abs(found.current).mean()
    gap = noise_floor(record, POSITION_COLUMN).sigma / found.gap.mean()
    return float(2 * np.abs(found.force).mean() * np.hypot(current, gap) / np.sqrt(share))


@dataclass(frozen=True, eq=False)
class MapWithEquilibria(MapAlone):
    """A static map, and beside its flux linkage the force at the equilibria of runs."""

    faithful: ClassVar[float] = FAITHFUL
    advice: ClassVar[str] = REVERSE

    def candidates(self, fit: Fit) -> list[Variant]:
        """What a static map can show, and a force beside the magnet's."""
        return [*super().candidates(fit), *without_those_of(fit, [OFFSET])]


def map_with_equilibria(record: Record, belief: ModelHypothesis, found: StaticEquilibria) -> MapWithEquilibria:
    """The equilibria of a record's runs beside its static map, made ready."""
    alone = map_alone(with_equilibria(record, found), belief)
    told = f"judged by the force at {found.gap.size} rests beside the flux linkage of the static map"
    return MapWithEquilibria(belief, alone.likelihood, alone.unknowns, (told, *alone.notes))


def equilibria_or_loops(record: Record, belief: ModelHypothesis, runs: Sequence[RunData]) -> Kind:
    """An unstable plant made ready: by its equilibria where there is a static map and some are held out, else by its
    runs."""
    if record.static is not None and plant_parameters(record.actuator).sides == 1:
        found = static_equilibria(record)
        if {"fit", "held-out"} <= set(found.role):
            return map_with_equilibria(record, belief, found)
    return loops(record, belief, runs)
