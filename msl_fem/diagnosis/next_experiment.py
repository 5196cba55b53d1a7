"""The experiment that would tell two effects apart: the best of a small menu, judged before anything is measured.

On the menu are excitations that `simulate` can make (smaller, larger, faster, on both sides alike or against each
other, a sweep, two tones, steps), a run with the mover locked, and measurements beside a run as it was: the mover
weighed, a gauge block under the position sensor, the resistance, one force at rest. Each is judged by `separation`.
Where no effect has a name, the next run is the one that moves what the rest depends on farther.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from msl_fem.diagnosis.likelihood import Likelihood
from msl_fem.diagnosis.noise import make_bands
from msl_fem.diagnosis.problem import START, FitProblem
from msl_fem.diagnosis.search import SearchStage
from msl_fem.diagnosis.separation import Hypothesis, Measure, PlannedRecord, beside_a_run
from msl_fem.diagnosis.unknowns import Unknowns, fixed_of
from msl_fem.errors import ComputationError, InputError
from msl_fem.files.quantity import format_quantity
from msl_fem.plant import Simulation, bearable_run
from msl_fem.plant.effects import find_parameter
from msl_fem.plant.excitation import DRIVE_UNIT, parse_excitation
from msl_fem.plant.excitation_kinds import Excitation
from msl_fem.prediction import KernelPlant, ModelHypothesis, RunData, Start
from msl_fem.prediction.free_run import start_sigmas
from msl_fem.prediction.run_data import POSITION_COLUMN

TOLD_APART = 5.0
"""Nats within which two names are not told apart."""
DECIDES = float((np.sqrt(2 * TOLD_APART) + 1.645) ** 2)
"""Noncentrality at which the evidence exceeds `TOLD_APART` in 95 of 100 records; where one false choice in 100 is
allowed, it is (2.576 + 1.645)^2 = 17.8."""
SIMULATED, PLANNED = 0.4, 4.0  # s: simulated of a run, and its planned length
HEAVY = 1e6  # times the mass: a locked mover
MUCH = 1e4  # noncentrality: more is as good
WIDER = 1.1  # times the spread of the run as it was, that is worth a run
_OF_CURRENT = ("current", "flux", "voltage", "command")


@dataclass(frozen=True, eq=False)
class Question:
    """What is known when the next experiment is asked for: the rig as believed, its channels with their noise, what is
    uncertain within tolerances, and how it was excited."""

    belief: ModelHypothesis
    problem: FitProblem
    believed: tuple[tuple[str, float], ...]

    @property
    def run(self) -> RunData:
        """The longest run."""
        return max(self.problem.runs, key=lambda run: len(run.commands))

    @property
    def sides(self) -> int:
        return max(self.problem.plant.parameters.sides, 1)


@dataclass(frozen=True)
class Entry:
    """What could be done: in words, the excitation, and whether the mover is locked."""

    words: str
    excitation: Excitation
    locked: bool = False


@dataclass(frozen=True)
class Option:
    """An entry of the menu, judged.

    Attributes
    ----------
    words : what to do
    excitation : as `simulate` takes it; of a measurement, that of the run it stands beside
    noncentrality : d^2 at the size found; it decides at `DECIDES`
    """

    words: str
    excitation: str
    noncentrality: float


@dataclass(frozen=True, eq=False)
class JudgedOption:
    """An option with the planned record and the measures by which it was judged."""

    option: Option
    plan: PlannedRecord
    measures: tuple[Measure, ...] = ()

    @property
    def worth(self) -> float:
        """Noncentrality, all that is ample alike: of these the first of the menu is taken."""
        return min(self.option.noncentrality, MUCH)


@dataclass(frozen=True)
class Proposal:
    """The menu judged for two effects, best first.

    Attributes
    ----------
    decides_from : share of the size found from which on the best option decides; inf where it never does
    amount : the first effect's leading parameter (name, value at which the best option decides, unit)
    """

    first: str
    second: str
    options: tuple[Option, ...]
    decides_from: float
    amount: tuple[str, float, str]

    @property
    def decides(self) -> bool:
        return bool(self.options) and self.options[0].noncentrality >= DECIDES

    @property
    def text(self) -> str:
        """What to do, and what it would bring."""
        first, second = (name.replace("_", " ") for name in (self.first, self.second))
        if not self.options:
            return f"no run of the menu is borne by the rig; {first} and {second} stay together"
        best = self.options[0]
        said = f'{best.words}: simulate --excitation "{best.excitation}"'
        both = f"{first} from {second}"
        apart = f"the two models then lie {best.noncentrality**0.5:.3g} sigma of the noise apart"
        name, value, unit = self.amount
        limit = f"{name} = {format_quantity(value, unit, digits=3) if unit else f'{value:.2g}'}"
        if self.decides:
            return f"{said}; it tells {both} from {limit} on ({apart}, {DECIDES**0.5:.2g} are enough)"
        from_where = f", which it reaches from {limit} on" if np.isfinite(value) else ""
        return (
            f"no run that was tried tells {both} at this size. The nearest one: {said}; {apart}, "
            f"{DECIDES**0.5:.2g} are needed{from_where}"
        )


def separating(question: Question, stage: SearchStage, rivals: Sequence[str]) -> str:
    """What would tell a stage's best effect from the first of its rivals; empty without rivals."""
    if not rivals or stage.best is None:
        return ""
    rival = next(r for r in stage.refits if r.variant.effect == rivals[0])
    try:
        return next_experiment(question, Hypothesis.of(stage.best.fit), Hypothesis.of(rival.fit)).text
    except (InputError, ComputationError) as err:
        return f"no experiment could be planned: {err}"


def next_experiment(
    question: Question, truth: Hypothesis, other: Hypothesis, *, entries: Sequence[Entry] | None = None
) -> Proposal:
    """What would tell two explanations apart.

    Parameters
    ----------
    truth, other : as fitted to the record at hand; the last effect of each is what they differ in, and the size of
        `truth` is the one that is judged
    entries : the menu, the run as it was first; None: `menu`
    """
    judged: list[JudgedOption] = []
    for entry in menu(question) if entries is None else entries:
        try:
            plan, borne = planned(question, entry.excitation, locked=entry.locked)
        except (InputError, ComputationError):
            continue
        excitation = borne.spec
        beside = () if judged else tuple(beside_a_run(question.problem))
        judged.append(JudgedOption(Option(entry.words, excitation, plan.distance(truth, other)), plan))
        for measure in beside:
            distance = plan.distance(truth, other, (measure,))
            option = Option(f"{measure.name} beside a run as before", excitation, distance)
            judged.append(JudgedOption(option, plan, (measure,)))
    finite = [option for option in judged if np.isfinite(option.option.noncentrality)]
    ranked = sorted(finite, key=lambda option: -option.worth)
    share = _decides_from(ranked[0], truth, other) if ranked else np.inf
    first, second = (hypothesis.effects[-1].effect for hypothesis in (truth, other))
    return Proposal(first, second, tuple(option.option for option in ranked), share, _amount(truth, share))


def _decides_from(best: JudgedOption, truth: Hypothesis, other: Hypothesis) -> float:
    """The share of the size at which d^2 is enough, by the power with which it grows: 2 where the effects differ in
    first order, 4 where they differ in second."""
    option = best.option
    half = best.plan.distance(truth.scaled(0.5), other.scaled(0.5), best.measures)
    if not (option.noncentrality > 0 and half > 0):
        return np.inf
    power = float(np.clip(np.log2(option.noncentrality / half), 1.0, 6.0))
    return float((DECIDES / option.noncentrality) ** (1 / power))


def _amount(truth: Hypothesis, share: float) -> tuple[str, float, str]:
    from_where = truth.scaled(share if np.isfinite(share) else 1.0)
    last = truth.effects[-1].effect
    n = next(k for k, e in enumerate(truth.effects) if e.effect == last and not e.width)
    one = truth.effects[n]
    value = float(one.value(np.array(from_where.z[n]))) if np.isfinite(share) else np.inf
    return one.name.replace("_", " "), value, find_parameter(one.effect, one.name).unit


def menu(question: Question) -> Iterator[Entry]:
    """The menu, the run as it was first."""
    base = usual(question)
    unit = DRIVE_UNIT[_drive(question)]
    yield Entry("the same again", base)
    yield Entry("half the amplitude", base.model_copy(update={"amplitude": base.amplitude / 2}))
    yield Entry("one and a half times the amplitude", base.model_copy(update={"amplitude": 1.5 * base.amplitude}))
    fast = min(1000.0, question.run.rate / 5)
    if fast > 1.2 * base.highest_frequency:
        yield Entry("a wider band", base.model_copy(update={"band": fast}))
    if question.sides == 2:
        for channel in ("common", "differential"):
            yield Entry(f"{channel} drive", base.model_copy(update={"channel": channel}))
    size = f"bias={base.bias!r} {unit},amplitude={1.5 * base.amplitude!r} {unit},duration={SIMULATED} s"
    channel = "differential" if question.sides == 2 else "1"
    top = format_quantity(min(base.highest_frequency, question.run.rate / 20), "Hz")
    for words, kind in (
        ("a swept sine", f"swept-sine:start=5 Hz,stop={top}"),
        ("two tones", "multisine:start=40 Hz,stop=60 Hz,periods=8"),
        ("steps", "step:frequency=5 Hz"),
    ):
        yield Entry(words, parse_excitation(f"{kind},channel={channel},{size}", unit=unit))
    if question.problem.plant.parameters.sides:
        yield Entry("the mover locked", base, locked=True)


def usual(question: Question) -> Excitation:
    """Band-limited noise of the bias, size and band that the record's longest run has."""
    return noise_like(question.run, sides=question.sides, drive=_drive(question))


def noise_like(run: RunData, *, sides: int, drive: str) -> Excitation:
    """Band-limited noise of the bias, size and band that the commands of a run have."""
    commands = run.commands[:, :sides]
    bias, spread = float(commands.mean()), float(commands.std(axis=0).max())
    power = np.abs(np.fft.rfft(commands - commands.mean(axis=0), axis=0)) ** 2
    total = np.cumsum(power.sum(axis=1))
    band = float(np.searchsorted(total, 0.97 * total[-1])) * run.rate / len(commands)
    unit = DRIVE_UNIT[drive]
    bias = 0.0 if abs(bias) < 0.05 * spread else bias
    channel = "independent" if sides == 2 else "1"
    text = (
        f"band-limited-noise:channel={channel},bias={bias:.3g} {unit},amplitude={spread:.3g} {unit},"
        f"band={format_quantity(max(band, 20.0), 'Hz', digits=2)},duration={SIMULATED} s,seed=1"
    )
    return parse_excitation(text, unit=unit)


def _drive(question: Question) -> str:
    drive = question.belief.actuator.drive
    if drive is None:
        raise InputError(f"{question.belief.actuator.name} has no [drive]; no excitation can be planned")
    return drive.kind


def planned(question: Question, excitation: Excitation, *, locked: bool = False) -> tuple[PlannedRecord, Excitation]:
    """The record of an excitation, and the excitation at its planned length with an amplitude that the rig bears.

    Raises
    ------
    InputError, ComputationError : the rig bears no amplitude of it
    """
    rate = question.run.rate
    simulation, borne = bearable_run(question.belief.actuator, question.belief.table, excitation, rate=rate)
    commands = np.zeros((simulation.time.size, 2))
    commands[:, : simulation.command.shape[1]] = simulation.command
    plant = question.problem.plant
    names = [name for name in question.run.measured if not (locked and name == POSITION_COLUMN)]
    if locked:
        plant = _locked(plant)
    nothing = np.zeros(len(commands))
    noise = question.run.noise
    run = RunData("planned", "fit", rate, commands, dict.fromkeys(names, nothing), noise, question.run.ideal_current)
    currents = [float(c) for c in simulation.current[0]] + [0.0, 0.0]
    start = Start((currents[0], currents[1]), float(simulation.position[0]), 0.0)
    sigmas = START * start_sigmas(plant, run)
    problem = FitProblem(plant, (run,), (start,), (sigmas,), question.problem.table_error)
    n_table = 0 if problem.table_error is None else len(problem.table_error.modes)
    likelihood = Likelihood(problem, make_bands([len(commands)], rate, highest=rate / 2), plant.substeps)
    plain = Unknowns(question.believed, n_table, (sigmas.size,), fixed=fixed_of(question.belief))
    plan = PlannedRecord(likelihood, plain, weight=PLANNED / SIMULATED)
    return plan, at_planned_length(borne)


def _locked(plant: KernelPlant) -> KernelPlant:
    """The plant with a mover so heavy that it stays where it is."""
    from_believed = plant.parameters
    return KernelPlant(
        plant.surface,
        from_believed._replace(mass=HEAVY * from_believed.mass),
        plant.effects,
        plant.readings,
        plant.gain,
        plant.rate,
        plant.substeps,
    )


def at_planned_length(excitation: Excitation) -> Excitation:
    """The excitation at its planned length, with as many periods more."""
    update: dict[str, object] = {"duration": PLANNED}
    periods = getattr(excitation, "periods", None)
    if periods is not None:
        update["periods"] = round(periods * PLANNED / SIMULATED)
    return excitation.model_copy(update=update)


def farther(question: Question, variables: Sequence[str]) -> str:
    """What to do next, in words and as an excitation.

    Parameters
    ----------
    variables : that the rest was found to depend on; none: amplitudes are compared instead
    """
    name = variables[0] if variables else ""
    runs = _runs(question)
    if not runs:
        return ""
    base = spread(runs[0][2], name)
    if not name or not base:
        return _smaller(runs)
    words, excitation, simulation = max(runs, key=lambda run: spread(run[2], name))
    factor = spread(simulation, name) / base
    if factor < WIDER:
        return f"nothing on the menu moves {name} farther than this record did; a longer record narrows the curve"
    return f'{words}, simulate --excitation "{excitation.spec}": {name} moves {factor:.2g} times as far'


def spread(run: Simulation, variable: str) -> float:
    """RMS deviation of what a variable is about: a current, a velocity, or else the position."""
    if variable.startswith(_OF_CURRENT) and run.current.size:
        return float(run.current.std(axis=0).max())
    values = run.velocity if "velocity" in variable else run.position
    return 0.0 if variable.startswith("time") else float(values.std())


def _runs(question: Question) -> list[tuple[str, Excitation, Simulation]]:
    """The entries of the menu in motion that the rig bears, the run as it was first."""
    belief, found = question.belief, []
    for entry in menu(question):
        if entry.locked:
            continue
        try:
            run, borne = bearable_run(belief.actuator, belief.table, entry.excitation, rate=question.run.rate)
        except (InputError, ComputationError):
            continue
        found.append((entry.words, at_planned_length(borne), run))
    return found


def _smaller(runs: Sequence[tuple[str, Excitation, Simulation]]) -> str:
    half = next((excitation for words, excitation, _ in runs if words == "half the amplitude"), None)
    if half is None:
        return ""
    return (
        f'half the amplitude, simulate --excitation "{half.spec}": a rest that halves is linear in the motion, one '
        "that falls faster is not, one that stays is a disturbance from elsewhere"
    )
