"""Records whose runs the recorded inputs make: simulated from their starts, as a whole or over stretches."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import ClassVar

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.computing.threads import in_threads
from msl_fem.diagnosis.decision import Rule
from msl_fem.diagnosis.fit import FitPlan, beyond_sanity, fit
from msl_fem.diagnosis.kind import ErrorSignal, Kind, Size
from msl_fem.diagnosis.left_out import about_invalid, left_outside, runs_inside
from msl_fem.diagnosis.likelihood import Fit, Likelihood
from msl_fem.diagnosis.next_experiment import Question, farther, separating
from msl_fem.diagnosis.noise import highest_line, make_bands
from msl_fem.diagnosis.outside import Dependence, dependences
from msl_fem.diagnosis.problem import FitProblem, Points, simulated_residuals
from msl_fem.diagnosis.refits import ROUGH
from msl_fem.diagnosis.search import SearchStage
from msl_fem.diagnosis.shooting import SHORT, ModelSpread, Shooting
from msl_fem.diagnosis.spikes import about_spikes, without_spikes
from msl_fem.diagnosis.static_maps import MAP_BESIDE, StaticLikelihood, joined, map_beside, own_of_map
from msl_fem.diagnosis.stretches import Stretches
from msl_fem.diagnosis.table_error import Visited, table_error
from msl_fem.diagnosis.unknowns import Unknowns, fixed_of
from msl_fem.diagnosis.variants import variables_of
from msl_fem.errors import ComputationError
from msl_fem.plant.effects import EffectValues
from msl_fem.prediction import (
    KernelPlant,
    ModelHypothesis,
    RunData,
    Start,
    free_parameters,
    free_run,
    kernel_plant,
    measured_start,
)
from msl_fem.prediction.free_run import counted
from msl_fem.prediction.hypothesis import closed_form_steps, plant_of_run
from msl_fem.prediction.run_data import Hold
from msl_fem.record import Record, Tolerance
from msl_fem.record.validity import bridged

ROUNDS = 3
"""How often stretches are chosen anew at a better model."""
FAR, LOSES = 10.0, 2.0
"""Times the noise that a fitted model may leave over longer stretches, or what it leaves over those before. Beyond
both a cause is missing, and what of it piles up over a stretch is no more a small change of the model."""
ROUGH_BEGINNING = 100.0
"""Nats that a fit may still gain over parts of stretches: over whole ones it goes on."""
OF_ALL_RUNS, STEPS_OF_ALL = 0.5, 24
"""The same of one of fitted and held-out runs together: little beside what refuses a name; and its steps at most, for
what begins at the end of a fit of most of these runs is near its own, or finds none."""
OTHER_HOLD: Mapping[Hold, Hold] = {"zero-order": "linear", "linear": "zero-order"}
ALIKE, FINER = 0.05, 3
"""Nats by which runs may differ in coarse steps from others, so many times finer than fine ones."""
COMPARABLE = 2.0
"""Times the nats by which runs in fine steps differ from these, by which those in coarse ones may."""
STEPS_A_TURN = 40.0
"""Coarse steps in which a second resonance turns once at least; the method of fourth order errs by 2e-4 of it then."""
Cuts = tuple[Stretches | None, ...]


@dataclass(frozen=True, eq=False)
class Runs(Kind):
    """Runs, and the rows of a static map beside them; `runs` are all of which something counts, those held out
    too, with their `cuts`; `recorded` all that there are; `turned` what tells of statements turned round."""

    record: Record | None = None
    runs: tuple[RunData, ...] = ()
    cuts: Cuts = ()
    recorded: tuple[RunData, ...] = ()
    threads: int = 1
    turned: tuple[str, ...] = ()
    _followed: dict[tuple[object, ...], Mapping[str, Array]] = field(default_factory=dict, init=False, repr=False)

    takes_laws: ClassVar[bool] = True

    @property
    def prediction(self) -> str:  # type: ignore[override]
        return "free-run" if self.whole else "multiple-shooting"

    @property
    def tolerance(self) -> Tolerance | None:
        return None if self.record is None else self.record.tolerance

    @property
    def whole(self) -> bool:
        """Whether every run is followed from its start to its end."""
        return all(cut is None for cut in self.cuts)

    def settled(self, tell: Callable[[str], None]) -> "Runs":
        """With stretches chosen anew at the model without effects, which bears longer ones than the belief, as long as
        it follows them."""
        kind = self
        for n in range(ROUNDS):
            if kind.whole:
                break
            told = partial(_of_round, tell, n + 1)
            if n == 0 and (renewed := kind.begun(told)) is not None:
                done = _lengths(renewed.cuts) == _lengths(kind.cuts)
                kind = renewed
                if done:
                    break
                continue
            told("fitted over stretches of the runs, which are then chosen anew")
            start = np.zeros(kind.unknowns.size) if kind.begin is None else kind.begin
            found = fit(kind.likelihood, kind.unknowns, start, plan=FitPlan(enough=ROUGH, tell=told))
            if found.sane and beyond_sanity(kind.unknowns, found.z):
                kind = replace(kind, likelihood=found.likelihood, begin=found.z, sane=found.sane)
                break
            renewed = kind.renewed(found)
            if _loses(renewed, found):
                kind = replace(kind, likelihood=found.likelihood, begin=found.z)
                break
            done = _lengths(renewed.cuts) == _lengths(kind.cuts)
            kind = renewed
            if done:
                break
        return kind

    def begun(self, tell: Callable[[str], None]) -> "Runs | None":
        """With stretches chosen anew at a model that was fitted over shorter ones, in which it is nearly linear: from
        the belief that is a short way. None where it is not, where a linear model has moved a start out of the table,
        or where from there it does not follow the longer ones."""
        assert self.record is not None
        tell("fitted over parts of the stretches of the runs, which are then chosen anew")
        problem, cuts = self.likelihood.problem, []
        for n, cut in enumerate(problem.stretches):
            shot = Shooting(problem, n, ModelSpread.of_tolerances(self.unknowns), substeps=self.likelihood.substeps)
            cuts.append(None if cut is None else shot.split(cut))
        static = map_beside(self.record, self.belief)
        cut_anew = replace(problem, stretches=tuple(cuts))
        likelihood, unknowns = _likelihood(cut_anew, self.unknowns, static, alike=self._in_coarse_steps)
        plan = FitPlan(enough=ROUGH_BEGINNING, heats=False, tell=tell)
        try:
            found = fit(likelihood, unknowns, np.zeros(unknowns.size), plan=plan)
        except ComputationError:
            return None
        if found.sane is not None or (beyond_sanity(unknowns, found.z) and found.predicted > ROUGH_BEGINNING):
            return None
        renewed = self.renewed(found)
        return None if _loses(renewed, found) else renewed

    def renewed(self, found: Fit) -> "Runs":
        """With stretches chosen, and their starts, at a fit."""
        assert self.record is not None
        n = len(self.unknowns.believed) + self.unknowns.n_table
        covariance = np.linalg.inv(found.precision)[:n, :n]
        values, vectors = np.linalg.eigh(covariance)
        moves = (vectors * np.sqrt(np.maximum(values, 0.0))).T
        known = {run.name: cut for run, cut in zip(self.runs, self.cuts, strict=True)}
        made = _made(
            self.record, self.belief, self.recorded, found.z[:n], moves,
            threads=self.threads, known=known, alike=self._in_coarse_steps,
        )  # fmt: skip
        return replace(made, notes=(*made.notes, *self.turned), turned=self.turned)

    def errors(self, belief: ModelHypothesis, fit: Fit | None) -> list[ErrorSignal]:
        signals = []
        own = list(zip(self.runs, self.cuts, strict=True))
        every = in_threads(lambda of: self._missed(belief, *of, fit=fit), own, self.threads)
        for (run, cut), values in zip(own, every, strict=True):
            outside = None if cut is None else ~cut.counts(len(run.commands))
            signals += [ErrorSignal.of_run(run, name, values[name], outside) for name in counted(run)]
        return signals

    def restatements(self) -> "Sequence[Runs]":
        """With commands held the other way than stated."""
        stated = self.runs[0].hold
        other = OTHER_HOLD[stated]
        problem = self.likelihood.problem
        likelihood = replace(self.likelihood, problem=replace(problem, runs=_held(problem.runs, other)))
        note = (
            f'the commands of the runs act as held "{other}" and not "{stated}" as rig.toml says, which explains '
            "the record better; that is taken for true here: correct hold"
        )
        runs, recorded = _held(self.runs, other), _held(self.recorded, other)
        turned = replace(self, likelihood=likelihood, runs=runs, recorded=recorded, turned=(note,))
        return (replace(turned, notes=(*self.notes, note)),)

    def rule(self, rule: Rule) -> Rule:
        return rule

    def predictive_gain(self, before: Fit, after: Fit) -> float:
        without = self._evidence_of_all(before, FitPlan(STEPS_OF_ALL, enough=OF_ALL_RUNS)) - before.log_evidence
        nothing = after.log_evidence + without  # beyond it more steps bring more
        found = self._evidence_of_all(after, FitPlan(STEPS_OF_ALL, enough=OF_ALL_RUNS, until=nothing))
        return found - nothing if found > -np.inf else -np.inf

    def dependences(
        self, fit: Fit, belief: ModelHypothesis, *, few: bool = False, threads: int = 1
    ) -> list[Dependence]:
        return dependences(*fit.likelihood.runs_part(fit), belief, few=few, threads=threads)

    def separating(self, stage: SearchStage, rivals: Sequence[str]) -> str:
        return separating(self._question, stage, rivals) if self.whole else super().separating(stage, rivals)

    def above_noise(self, fit: Fit) -> list[str]:
        likelihood, own = fit.likelihood.runs_part(fit)
        return likelihood.above_noise(own)

    def look_further(self, variables: Sequence[str]) -> str:
        return farther(self._question, variables) if self.whole else ""

    def variables(self) -> dict[str, Mapping[str, Array]]:
        return {run.name: variables_of(run) for run in self.runs}

    def sizes(self, belief: ModelHypothesis, effects: Sequence[str]) -> list[Size]:
        sizes = [self._size(belief, effect) for effect in effects]
        return [size for size in sizes if size is not None]

    def _evidence_of_all(self, found: Fit, plan: FitPlan) -> float:
        """Log evidence of fitted and held-out runs together under a fit's model, which goes on from there: more than
        its own by the log of the density that it predicts for the held-out ones. Minus infinity where it does not
        follow them."""
        assert self.record is not None
        of_fit, own = found.likelihood.problem, found.unknowns
        held = [(run, cut) for run, cut in zip(self.runs, self.cuts, strict=True) if run.role != "fit"]
        problem = replace(of_fit, runs=(*of_fit.runs, *(run for run, _ in held)))
        fitted = (None,) * len(of_fit.runs) if not of_fit.stretches else of_fit.stretches
        cuts = (*fitted, *(cut for _, cut in held))
        n = len(own.believed) + own.n_table
        static = map_beside(self.record, self.belief)
        likelihood, every = _likelihood(_cut_problem(problem, cuts, range(len(cuts))), own, static, found.z[:n])
        likelihood = replace(likelihood, strict=found.likelihood.strict)
        z = np.insert(found.z, own.n_nuisance, np.zeros(every.size - own.size))
        try:
            return fit(likelihood, every, z, plan=plan).log_evidence
        except ComputationError:
            return -np.inf

    def _missed(
        self, model: ModelHypothesis, run: RunData, cut: Stretches | None, fit: Fit | None = None
    ) -> Mapping[str, Array]:
        """Measured less simulated by channel; a run is followed once by each model, one that was fitted from the starts
        that its `fit` came to."""
        if (key := (model, run)) not in self._followed:
            problem = self.likelihood.problem
            names = [one.name for one in problem.runs]
            fitted = None if fit is None else dict(zip(names, fit.likelihood.problem.cuts, strict=True)).get(run.name)
            self._followed[key] = _simulated_missed(
                model, run, fitted or cut, self.tolerance, coarse=problem.coarse, settled=fitted is not None
            )
        return self._followed[key]

    @property
    def _in_coarse_steps(self) -> bool:
        """Whether the runs were found to be the same in coarse steps."""
        return self.likelihood.problem.coarse is not None

    @property
    def _question(self) -> Question:
        return Question(self.belief, self.likelihood.problem, self.unknowns.believed)

    def _size(self, extended: ModelHypothesis, effect: str) -> Size | None:
        """The largest size of an effect over the runs; None where the model does not bear its absence."""
        assert extended.effects is not None
        rest = {name: dict(values) for name, values in extended.effects.stated.items() if name != effect}
        if self.belief.effects is not None and effect in self.belief.effects.stated:
            rest[effect] = dict(self.belief.effects.stated[effect])
        without = replace(extended, effects=EffectValues(rest) if rest else None)
        sizes = []
        own = list(zip(self.runs, self.cuts, strict=True))

        def missed_by(model: ModelHypothesis) -> list[Mapping[str, Array]]:
            return in_threads(lambda of: self._missed(model, *of), own, self.threads)

        of_both = missed_by(extended), missed_by(without)
        for (run, cut), present, absent in zip(own, *of_both, strict=True):
            counts = slice(None) if cut is None else cut.counts(len(run.commands))
            for name in counted(run):
                change = float(np.sqrt(np.mean((present[name] - absent[name])[counts] ** 2)))
                share = change / float(np.sqrt(np.mean((run.measured[name] - absent[name])[counts] ** 2)))
                sizes.append(Size(effect, run.name, name, share, change))
        finite = (size for size in sizes if np.isfinite(size.share))
        return max(finite, key=lambda size: size.share, default=None)


def dynamic_runs(record: Record, belief: ModelHypothesis, runs: Sequence[RunData], *, threads: int = 1) -> Runs:
    """A record of runs, made ready; a static map that a fit can use stands beside them. Spikes of readings do not
    count."""
    return _made(record, belief, [without_spikes(run) for run in runs], None, None, threads=threads)


def _made(
    record: Record,
    belief: ModelHypothesis,
    runs: Sequence[RunData],
    at: Array | None,
    moves: Array | None,
    *,
    threads: int,
    known: Mapping[str, Stretches | None] | None = None,
    alike: bool = False,
) -> Runs:
    """The kind, its stretches chosen at numbers `at` of believed parameters and table, and `moves` of one sigma of
    them; at the belief and its tolerances without. `known` are stretches by a run's name of a model near by, `alike` as
    in `_likelihood`."""
    static = map_beside(record, belief)
    problem, unknowns = _problem(belief, runs, record.tolerance, static, threads=threads)
    spread = ModelSpread.of_tolerances(unknowns)
    if at is not None and moves is not None:
        spread = ModelSpread(unknowns, at, moves)
    substeps = problem.plant.substeps
    shots = [Shooting(problem, n, spread, substeps=substeps) for n in range(len(runs))]
    before = known or {}
    every: Cuts = tuple(
        in_threads(lambda shot: shot.chosen(before.get(shot.data.name), with_moves=at is not None), shots, threads)
    )
    left_out = left_outside(belief, runs, every)
    inside = runs_inside(belief, runs, every)
    recorded, runs, cuts = tuple(runs), tuple(run for run, _ in inside), tuple(cut for _, cut in inside)
    kept = [n for n, run in enumerate(runs) if run.role == "fit"]
    fitted = _cut_problem(replace(problem, runs=runs), cuts, kept)
    likelihood, unknowns = _likelihood(fitted, unknowns, static, at, alike=alike)
    notes = [] if static is None else [MAP_BESIDE, *static.measured.notes]
    left_out += about_spikes(runs) + about_invalid(runs)
    notes += [*_told(runs, cuts), *(one.text for one in left_out)]
    begin = None
    if at is not None:
        begin = np.pad(at, (0, unknowns.size - at.size))
    return Runs(belief, likelihood, unknowns, tuple(notes), begin, left_out, record, runs, cuts, recorded, threads)


def prepared_runs(
    belief: ModelHypothesis,
    runs: Sequence[RunData],
    tolerance: Tolerance,
    *,
    static: StaticLikelihood | None = None,
    threads: int = 1,
) -> tuple[Likelihood, Unknowns]:
    """The likelihood of runs that are followed from start to end, a static map beside them where there is one, and
    what it does not know without any effect."""
    problem, unknowns = _problem(belief, runs, tolerance, static, threads=threads)
    every = range(len(runs))
    return _likelihood(_cut_problem(problem, (None,) * len(runs), every), unknowns, static)


def _problem(
    belief: ModelHypothesis,
    runs: Sequence[RunData],
    tolerance: Tolerance,
    static: StaticLikelihood | None,
    *,
    threads: int,
) -> tuple[FitProblem, Unknowns]:
    """All runs as a problem, followed as a whole, and what is unknown in it and in a static map beside them, but for
    their starts."""
    plant = kernel_plant(belief, rate=runs[0].rate, ideal_current=runs[0].ideal_current)
    error = None
    if belief.table is not None and plant.parameters.sides and tolerance.table:
        fitted = [run for run in runs if run.role == "fit"]
        visited = Visited.by_runs(plant, fitted or runs)
        if static is not None:
            visited = visited.joined(static.measured.visited)
        error = table_error(belief.table, visited, tolerance=tolerance.table)
    coarse = closed_form_steps(plant, belief)
    problem = FitProblem(plant, tuple(runs), (), (), error, threads, tolerance=tolerance, coarse=coarse)
    believed = free_parameters(belief, tolerance, runs=runs)
    if static is not None:
        believed |= own_of_map(static.measured, tolerance)
    n_table = 0 if error is None else len(error.modes)
    slow = slow_turns(plant, coarse)
    return problem, Unknowns(tuple(believed.items()), n_table, (), fixed=fixed_of(belief), slow=slow)


def slow_turns(plant: KernelPlant, coarse: int | None) -> float:
    """Hz, up to which what turns does with coarse steps; 0 where there are none."""
    return 0.0 if coarse is None else plant.rate * coarse / STEPS_A_TURN


def _cut_problem(problem: FitProblem, cuts: Cuts, kept: Sequence[int]) -> FitProblem:
    """The runs that are kept, with their stretches, or first guesses of their starts."""
    runs = tuple(problem.runs[n] for n in kept)
    guesses, sigmas = [], []
    for n, run in zip(kept, runs, strict=True):
        whole = cuts[n] is None
        guesses.append(measured_start(problem.plant, run) if whole else Start((0.0, 0.0), 0.0, 0.0))
        sigmas.append(problem.start_unit(n) if whole else np.zeros(0))
    stretches = tuple(cuts[n] for n in kept)
    return replace(problem, runs=runs, guesses=tuple(guesses), start_sigmas=tuple(sigmas), stretches=stretches)


def _likelihood(
    problem: FitProblem,
    unknowns: Unknowns,
    static: StaticLikelihood | None,
    at: Array | None = None,
    *,
    alike: bool = False,
) -> tuple[Likelihood, Unknowns]:
    """Of runs that are cut and of a map beside them, and its unknowns with the starts of runs that are not cut; the
    steps are chosen at numbers `at` of believed parameters and table, at the belief without, unless these runs were
    `alike` in coarse steps at a model near by."""
    unknowns = replace(unknowns, starts=tuple(sigma.size for sigma in problem.start_sigmas))
    points = Points.of(unknowns, np.zeros((1, unknowns.size)))
    found = simulated_residuals(problem, points, substeps=problem.plant.substeps)
    highest = 0.0
    for n, run in enumerate(problem.runs):
        readings = {
            name: run.measured[name] - left[0] for name, left in zip(problem.channels(n), found[n], strict=True)
        }
        highest = max(highest, highest_line(run, readings))
    pieces = problem.pieces
    lengths = [part.stop - part.start for _, part in pieces]
    counted = np.bincount([run for run, _ in pieces], weights=lengths)
    bands = make_bands(lengths, problem.plant.rate, highest=highest, longest=int(counted.max()))
    likelihood = Likelihood(problem, bands, problem.plant.substeps)
    z = np.zeros(unknowns.size)
    if at is not None:
        z[: at.size] = at
    if not alike and not _alike_in_coarse_steps(likelihood, unknowns, z):
        likelihood = replace(likelihood, problem=replace(problem, coarse=None))
    return likelihood if static is None else joined(static, likelihood), unknowns


def _alike_in_coarse_steps(likelihood: Likelihood, unknowns: Unknowns, z: Array) -> bool:
    """Whether the runs at numbers (unknowns.size,) are, in coarse steps, those of far finer ones, or not much farther
    from them than in fine ones."""
    if likelihood.problem.coarse is None:
        return True
    points = Points.of(unknowns, z[None])
    every = replace(points, times=None)
    finer = replace(likelihood, substeps=FINER * likelihood.substeps).spectra(every)
    off = np.sum((likelihood.spectra(points) - finer) ** 2) / 2
    return bool(off <= ALIKE or off <= COMPARABLE * np.sum((likelihood.spectra(every) - finer) ** 2) / 2)


def _simulated_missed(
    model: ModelHypothesis,
    run: RunData,
    cut: Stretches | None,
    tolerance: Tolerance | None,
    *,
    coarse: int | None,
    settled: bool = False,
) -> Mapping[str, Array]:
    """Channel to (n_sample,) measured less simulated: from a measured start, or over stretches with starts that suit
    the model, next to theirs where these are `settled`; in coarse steps where there are such and no effect of it wants
    more."""
    plant = plant_of_run(model, run)
    if cut is None:
        readings = free_run(plant, run, measured_start(plant, run)).readings
        missed = {name: run.measured[name] - readings[name] for name in run.measured}
        return missed | {name: bridged(missed[name], at) for name, at in run.left_out.items()}
    problem = FitProblem(plant, (run,), (), (), None, tolerance=tolerance, coarse=coarse)
    times = Unknowns((), 0, (), fixed=fixed_of(model), slow=slow_turns(plant, coarse)).times_steps
    problem = replace(problem, coarse=problem.steps(plant.substeps, times))
    shot = Shooting(
        problem, 0, ModelSpread(Unknowns((), 0, ()), np.zeros(0), np.zeros((0, 0))), substeps=plant.substeps
    )
    return shot.missed(shot.refined(cut, SHORT)) if settled else shot.followed(cut)


def _held(runs: Sequence[RunData], hold: Hold) -> tuple[RunData, ...]:
    return tuple(replace(run, hold=hold) for run in runs)


def _loses(renewed: Runs, found: Fit) -> bool:
    """Whether a fitted model no longer follows the runs over the stretches that were chosen at it."""
    return not renewed.whole and _largest_left(renewed, found) > max(FAR, LOSES * max(found.excess.values()))


def _largest_left(kind: Runs, found: Fit) -> float:
    """The largest RMS residual over the noise that a fit's believed parameters and table leave over a kind's runs."""
    n = len(found.unknowns.believed) + found.unknowns.n_table
    z = np.zeros(kind.unknowns.size)
    z[:n] = found.z[:n]
    return max(kind.likelihood.excess_of_runs(replace(found, unknowns=kind.unknowns, z=z)).values())


def _of_round(tell: Callable[[str], None], n: int, text: str) -> None:
    """Tells what a round of choosing stretches does."""
    tell(f"round {n} of at most {ROUNDS}: {text}")


def _lengths(cuts: Cuts) -> list[list[int]]:
    """The first samples of the stretches that count."""
    return [[] if cut is None else [part.start for part in cut.counted_parts(cut.begins[-1] + 1)] for cut in cuts]


def _told(runs: Sequence[RunData], cuts: Cuts) -> list[str]:
    """How runs are cut, in words."""
    told = []
    for run, cut in zip(runs, cuts, strict=True):
        if cut is not None:
            lengths = np.diff([*cut.begins, len(run.commands)]) / run.rate
            span = f"{1e3 * lengths.min():.3g} to {1e3 * lengths.max():.3g} ms"
            told.append(
                f"{run.name} is followed over {cut.begins.size} stretches of {span} with free starts, since errors "
                "grow in it: what acts more slowly than a stretch is seen less"
            )
    return told
