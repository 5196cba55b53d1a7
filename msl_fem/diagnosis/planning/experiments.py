"""Which causes instruments can tell apart, which instrument to add, and the run that decides."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from msl_fem.actuator import Actuator
from msl_fem.computing.arrays import Array
from msl_fem.diagnosis.next_experiment import (
    DECIDES,
    HEAVY,
    MUCH,
    PLANNED,
    SIMULATED,
    Entry,
    Question,
    at_planned_length,
    menu,
)
from msl_fem.diagnosis.planning.absorbed import BelievedRefit
from msl_fem.diagnosis.planning.expected import ExpectedCause
from msl_fem.diagnosis.planning.forms import forms_of
from msl_fem.diagnosis.planning.planned_runs import PlannedRuns, standard_excitations
from msl_fem.diagnosis.planning.separations import (
    INSTRUMENTS,
    CauseInRun,
    Pair,
    Separations,
    groups,
)
from msl_fem.diagnosis.variants import features_of_runs
from msl_fem.errors import ComputationError, InputError
from msl_fem.plant import bearable_run
from msl_fem.plant.excitation_kinds import Excitation
from msl_fem.prediction import ModelHypothesis
from msl_fem.record import Record
from msl_fem.table.magnetic_table import MagneticTable

ROOM = 1.2  # times the amplitude of a run that its rig has to bear as well
TIMES = 3  # that a run may be made
VOLTMETER = 1e-3  # of the RMS voltage: one sigma of a voltage that is read, where none is stated
Progress = Callable[[int, int], None]
USUAL_INSTRUMENTS = ("position", "current")


@dataclass(frozen=True)
class RunOption:
    """A run of the menu, judged.

    Attributes
    ----------
    seen : causes that it shows
    pairs : d^2 of pairs of these, of a record's causes of all pairs, whichever is true
    one_way : the same of the one of both that is told better from the other
    """

    words: str
    excitation: str
    locked: bool
    seen: tuple[str, ...]
    pairs: Mapping[Pair, float]
    one_way: Mapping[Pair, float]

    @property
    def undecided(self) -> dict[Pair, float]:
        """The pairs that it does not tell apart."""
        return {pair: distance for pair, distance in self.pairs.items() if distance < DECIDES}

    @property
    def decided(self) -> int:
        """How many pairs it tells apart."""
        return len(self.pairs) - len(self.undecided)

    @property
    def worth(self) -> tuple[float, float, float, float]:
        """By which runs are sorted: what it shows and tells; what it tells if the right one is true; how near it comes
        to telling the others; and how far apart the nearest pair is, where all that is ample is alike."""
        lucky = sum(distance >= DECIDES for distance in self.one_way.values())
        near = sum(np.log(max(d, 1e-3)) for d in self.undecided.values())
        return self.decided + len(self.seen), lucky, float(near), min(min(self.pairs.values(), default=0.0), MUCH)

    def to_json(self) -> dict[str, Any]:
        """The entry in `runs`."""
        return {
            "what": self.words,
            "excitation": self.excitation,
            "locked": self.locked,
            "seen": list(self.seen),
            "decided": self.decided,
            "undecided": [[*pair, distance] for pair, distance in self.undecided.items()],
        }


@dataclass(frozen=True)
class ExperimentPlan:
    """What a set of instruments can tell.

    Attributes
    ----------
    instruments : that there are
    groups : causes that the usual run does not tell apart
    unseen : causes that what is not known within tolerances makes up for
    instrument_to_add : the one more that tells most causes apart or shows most; "" where none helps
    helped : causes that it shows, and pairs that it tells apart
    runs : of the menu, those that show most causes and tell most pairs apart first
    """

    instruments: tuple[str, ...]
    groups: tuple[tuple[str, ...], ...]
    unseen: tuple[str, ...]
    instrument_to_add: str
    helped: tuple[tuple[str, ...], ...]
    runs: tuple[RunOption, ...]

    @property
    def together(self) -> dict[Pair, float]:
        """Pairs that the best run for them does not tell apart whichever is true, even where it is made `TIMES` times,
        with d^2 of one."""
        best: dict[Pair, float] = {}
        for run in self.runs:
            for pair, distance in run.one_way.items():
                best[pair] = max(distance, best.get(pair, 0.0))
        return {pair: distance for pair, distance in best.items() if TIMES * distance < DECIDES}

    def to_json(self) -> dict[str, Any]:
        """The JSON object of the command."""
        return {
            "instruments": list(self.instruments),
            "groups": [list(group) for group in self.groups],
            "unseen": list(self.unseen),
            "instrument_to_add": self.instrument_to_add or None,
            "it_tells": [list(told) for told in self.helped],
            "together": [[*pair, distance] for pair, distance in self.together.items()],
            "runs": [run.to_json() for run in self.runs],
        }


@dataclass(frozen=True, eq=False)
class RigToPlan:
    """What experiments are planned for: what is believed of an actuator, and the sampling rate in Hz."""

    belief: ModelHypothesis
    rate: float

    @property
    def actuator(self) -> Actuator:
        """The actuator that is believed."""
        return self.belief.actuator

    @property
    def table(self) -> MagneticTable | None:
        """Its table; None for a rig that a force drives."""
        return self.belief.table


def experiments(
    rig: RigToPlan,
    causes: Sequence[ExpectedCause],
    instruments: Sequence[str] = USUAL_INSTRUMENTS,
    *,
    excitation: Excitation | None = None,
    named: str = "",
    progress: Progress = lambda done, total: None,
) -> ExperimentPlan:
    """What these instruments can tell of the causes, which one to add, and which run decides.

    Parameters
    ----------
    excitation : the usual run; None: the noise of `standard_excitations`
    named : the cause that a record named, from which it does not tell the others: these are taken at the amounts at
        which each comes nearest to it

    The runs are judged by the causes that the usual one leaves open; with `named` by all, seen or not.

    Raises
    ------
    InputError : an unknown instrument; the rig has no usual run, or does not bear it
    """
    if unknown := [name for name in instruments if name not in INSTRUMENTS]:
        raise InputError(f"'{unknown[0]}' is no instrument; choose of {', '.join(INSTRUMENTS)}")
    usual = excitation or standard_excitations(rig.actuator, rig.table, rate=rig.rate, seconds=SIMULATED)[0]
    first = _separations(rig, Entry("the usual run", usual), causes)
    if named:
        causes = first.separations.all_suited(named, instruments)
        first = _separations(rig, Entry("the usual run", usual), causes)
    entries = _entries(rig, first.refit)
    pairs = first.separations.pairs(instruments, every=bool(named))
    unseen = first.separations.unseen(instruments)
    apart = () if named else unseen
    together = groups([cause.effect for cause in causes if cause.effect not in apart], pairs)
    settled = set() if named else {group[0] for group in together if len(group) == 1}
    in_question = [cause for cause in causes if cause.effect not in settled] or causes
    judged = []
    for n, entry in enumerate(entries):
        progress(n, len(entries))
        judged += _judged(rig, entry, in_question, instruments, every=bool(named))
    progress(len(entries), len(entries))
    added, helped = _instrument_to_add(first.separations, instruments, pairs)
    ranked = sorted(judged, key=lambda run: run.worth, reverse=True)
    return ExperimentPlan(tuple(instruments), tuple(map(tuple, together)), tuple(unseen), added, helped, tuple(ranked))


@dataclass(frozen=True, eq=False)
class _Planned:
    refit: BelievedRefit
    separations: Separations


def _separations(rig: RigToPlan, entry: Entry, causes: Sequence[ExpectedCause]) -> _Planned:
    """The causes in a run of the menu; raises as `PlannedRuns.record`."""
    actuator = _locked(rig.actuator) if entry.locked else rig.actuator
    excitation = entry.excitation.model_copy(update={"role": "fit"})
    runs = PlannedRuns(actuator, rig.table, [excitation], rig.rate, rig.belief.effects)
    record = _with_voltmeter(runs.record())
    refit = BelievedRefit(record, replace(rig.belief, actuator=actuator), every=True)

    def change_of(cause: ExpectedCause) -> Array:
        return refit.change(runs.record(cause.beside(runs.believed)))

    features, plant = features_of_runs(refit.likelihood.problem), runs.plant
    found = {cause.effect: CauseInRun(cause, forms_of(cause, features, plant)) for cause in causes}
    seconds = len(record.runs[0].columns["time_s"]) / rig.rate
    separations = Separations(refit, found, change_of, believed=rig.belief.effects, weight=PLANNED / seconds)
    return _Planned(refit, separations)


def _locked(actuator: Actuator) -> Actuator:
    """The actuator with a mover so heavy that it stays where it is."""
    assert actuator.motion is not None
    heavy = {"moving_mass": HEAVY * actuator.motion.moving_mass}
    return actuator.model_copy(update={"motion": actuator.motion.model_copy(update=heavy)})


def _with_voltmeter(record: Record) -> Record:
    """The record with a noise of its voltages."""
    voltages = [v for run in record.runs for name, v in run.columns.items() if name.startswith("voltage")]
    if record.noise.voltage is not None or not voltages:
        return record
    rms = float(np.sqrt(np.mean(np.concatenate(voltages) ** 2)))
    return replace(record, noise=record.noise.model_copy(update={"voltage": VOLTMETER * rms}))


def _entries(rig: RigToPlan, refit: BelievedRefit) -> list[Entry]:
    return list(menu(Question(rig.belief, refit.likelihood.problem, refit.unknowns.believed)))


def _judged(
    rig: RigToPlan, entry: Entry, causes: Sequence[ExpectedCause], instruments: Sequence[str], *, every: bool
) -> list[RunOption]:
    """The entry with an amplitude that the rig bears; nothing where it bears none, or not the causes."""
    try:
        borne = _borne(rig, entry)
        planned = _separations(rig, replace(entry, excitation=borne), causes)
    except (InputError, ComputationError):
        return []
    pairs = planned.separations.pairs(instruments, every=every)
    hidden = planned.separations.unseen(instruments)
    seen = tuple(cause.effect for cause in causes if cause.effect not in hidden)
    one_way = planned.separations.one_way(pairs, instruments)
    return [RunOption(entry.words, at_planned_length(borne).spec, entry.locked, seen, pairs, one_way)]


def _borne(rig: RigToPlan, entry: Entry) -> Excitation:
    """The entry's excitation with an amplitude that the rig bears with room to spare over the planned length, whose
    noise has higher peaks than the piece of it that is simulated; raises as `bearable_run`."""
    actuator = _locked(rig.actuator) if entry.locked else rig.actuator
    longer = at_planned_length(entry.excitation)
    larger = longer.model_copy(update={"amplitude": ROOM * longer.amplitude})
    try:
        _, borne = bearable_run(actuator, rig.table, larger, rate=rig.rate, effects=rig.belief.effects)
    except InputError:  # with currents that would be negative there is no larger run
        larger = longer
        _, borne = bearable_run(actuator, rig.table, larger, rate=rig.rate, effects=rig.belief.effects)
    share = borne.amplitude / larger.amplitude
    return entry.excitation.model_copy(update={"amplitude": share * entry.excitation.amplitude})


def _instrument_to_add(
    separations: Separations, instruments: Sequence[str], pairs: Mapping[Pair, float]
) -> tuple[str, tuple[tuple[str, ...], ...]]:
    """The instrument that helps most, and what it tells: causes it shows, pairs it separates."""
    unseen = separations.unseen(instruments)
    best: tuple[str, tuple[tuple[str, ...], ...]] = ("", ())
    for name in (one for one in INSTRUMENTS if one not in instruments):
        more = [*instruments, name]
        shown = [(cause,) for cause in unseen if cause not in separations.unseen(more)]
        apart = [p for p, d in pairs.items() if d < DECIDES <= separations.apart(*p, more)]
        if len(shown) + len(apart) > len(best[1]):
            best = (name, (*shown, *apart))
    return best
