"""A ranking of causes before any measurement: by what each, at its expected size, changes in a standard run."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from msl_fem.actuator import Actuator
from msl_fem.comparison.armax_beside import ArmaxBeside
from msl_fem.comparison.as_designed import as_designed
from msl_fem.computing.arrays import Array
from msl_fem.diagnosis.next_experiment import DECIDES
from msl_fem.diagnosis.planning.absorbed import BelievedRefit
from msl_fem.diagnosis.planning.expected import ExpectedCause, expected_causes, unexpected
from msl_fem.diagnosis.planning.planned_runs import PlannedRuns, standard_excitations
from msl_fem.errors import ComputationError, InputError
from msl_fem.plant.believed import PLAIN_BELIEF
from msl_fem.plant.effects import EffectValues
from msl_fem.plant.excitation_kinds import Excitation
from msl_fem.plant.plant import CURRENT_DRIVE
from msl_fem.prediction import ModelHypothesis
from msl_fem.prediction.run_data import POSITION_COLUMN
from msl_fem.record import Record
from msl_fem.table.magnetic_table import MagneticTable

RATE = 1e4  # Hz
NOT_BORNE, NOT_SHOWN = "the runs do not bear it", "none of these runs"
VOLTAGE = "voltage, where its noise is stated"
Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Suspect:
    """A cause, how large it is expected to be, and what it then does.

    Attributes
    ----------
    change : RMS change over RMS of the channel that shows it most, of all runs together; inf where they do not bear it
    channel : that channel's column
    change_of_position : the same of the position
    absorbed_by_refit : share of the change, in units of the noise, that the believed parameters make up for
    absorbed_by_armax : share of the position's change that an ARMAX follows which is identified with the cause; None
        where the position hardly changes
    noncentrality : what the re-fit leaves, over the noise, squared and summed
    shown_by : the instrument that shows what the re-fit leaves
    """

    cause: ExpectedCause
    change: float
    channel: str
    change_of_position: float
    absorbed_by_refit: float
    absorbed_by_armax: float | None
    noncentrality: float
    shown_by: str

    def to_json(self) -> dict[str, Any]:
        """The JSON object of a suspect."""
        cause = self.cause
        return {
            "effect": cause.effect,
            "parameter": cause.leading,
            "size": cause.size,
            "unit": cause.unit,
            "parameters": dict(cause.values),
            "source": cause.source,
            "change": self.change if np.isfinite(self.change) else None,
            "channel": self.channel,
            "change_of_position": self.change_of_position if np.isfinite(self.change) else None,
            "absorbed_by_refit": self.absorbed_by_refit,
            "absorbed_by_armax": self.absorbed_by_armax,
            "noncentrality": self.noncentrality,
            "shown_by": self.shown_by,
        }


@dataclass(frozen=True, eq=False)
class SuspectRanking:
    """The suspects, those that change a run most first, and the runs that they were judged by."""

    suspects: tuple[Suspect, ...]
    excitations: tuple[str, ...]
    belief: str
    left_out: tuple[str, ...]

    def to_json(self) -> dict[str, Any]:
        """The JSON object of the ranking."""
        return {
            "suspects": [one.to_json() for one in self.suspects],
            "excitations": list(self.excitations),
            "belief": self.belief,
            "left_out": list(self.left_out),
        }


@dataclass(frozen=True)
class SuspectSettings:
    """How suspects are judged.

    Attributes
    ----------
    known : what the drawing tells is believed already, and suspects are what may be left of it
    excitations : none: `standard_excitations`
    rate : samples a second, Hz
    """

    known: bool = False
    excitations: tuple[Excitation, ...] = ()
    rate: float = RATE


def suspects(
    actuator: Actuator,
    table: MagneticTable | None,
    settings: SuspectSettings | None = None,
    *,
    progress: Progress = lambda done, total: None,
) -> SuspectRanking:
    """All causes that the actuator can have, ranked by their change of its runs.

    Raises
    ------
    InputError : no excitation, and no spring or travel to choose one by; one that the open loop does not bear
    """
    settings = settings or SuspectSettings()
    drawn = as_designed(actuator, table)
    belief = drawn if settings.known else PLAIN_BELIEF
    excitations = settings.excitations or standard_excitations(actuator, table, rate=settings.rate)
    runs = PlannedRuns(actuator, table, excitations, settings.rate, belief.effects)
    judge = SuspectJudge(runs, ModelHypothesis.of(actuator, table, belief))
    causes = expected_causes(actuator, drawn, tolerance=judge.base.tolerance, rate=settings.rate, known=settings.known)
    found = []
    for n, cause in enumerate(causes):
        progress(n, len(causes))
        found.append(judge.judged(cause))
    progress(len(causes), len(causes))
    ranked = sorted(found, key=lambda one: -one.change)
    left_out = [f"{name}: {why}" for name, why in unexpected(runs.plant).items()]
    specs = tuple(excitation.spec for excitation in excitations)
    return SuspectRanking(tuple(ranked), specs, belief.name, (*drawn.left_out, *left_out))


class SuspectJudge:
    """The runs without a cause, and all that is the same for every cause."""

    def __init__(self, runs: PlannedRuns, belief: ModelHypothesis) -> None:
        self.runs, self.belief = runs, belief
        self.base = runs.record()
        self.refit = BelievedRefit(self.base, belief)
        self.armax = ArmaxBeside(runs.with_noise(self.base))

    def judged(self, cause: ExpectedCause) -> Suspect:
        """The suspect of a cause at its size, with the signs of its sides that change a run most."""
        return max((self._of_signs(one) for one in cause.by_signs()), key=lambda one: one.change)

    def _of_signs(self, cause: ExpectedCause) -> Suspect:
        effects = cause.beside(self.belief.effects)
        try:
            other = self.runs.record(effects)
        except (InputError, ComputationError):
            return Suspect(cause, np.inf, "", np.inf, 0.0, None, np.inf, NOT_BORNE)
        changes = changes_of(other, self.base, voltages=self.runs.plant.drive == CURRENT_DRIVE)
        channel = max(changes, key=lambda name: changes[name])
        change = self.refit.change(other)
        unread = channel.startswith("voltage") and channel not in self.refit.channels
        left = self.refit.left(change)
        return Suspect(
            cause,
            changes[channel],
            channel,
            changes.get(POSITION_COLUMN, 0.0),
            left.absorbed,
            self.armax.absorbed(self.runs.with_noise(other)),
            left.noncentrality,
            VOLTAGE if unread else self._shown_by(change, left.by_channel, effects),
        )

    def _shown_by(self, change: Array, left: dict[str, float], effects: EffectValues) -> str:
        """The channel that shows most of what is left, or the measurement beside the runs that makes it seen."""
        if sum(left.values()) >= DECIDES:
            return max(left, key=lambda name: left[name]).rpartition("_")[0].replace("_", " ")
        beside = {one.name: self.refit.with_measure(change, one, effects) for one in self.refit.measures()}
        best = max(beside, key=lambda name: beside[name], default="")
        return best if best and beside[best] >= DECIDES else NOT_SHOWN


def changes_of(other: Record, base: Record, *, voltages: bool) -> dict[str, float]:
    """Column to RMS change over RMS of all runs together, the constant part included: position, currents, and voltages
    where they answer."""
    found = {}
    for name in base.runs[0].columns:
        if not name.startswith(("position", "current", "voltage") if voltages else ("position", "current")):
            continue
        whole = np.concatenate([run[name] for run in base.runs])
        change = np.concatenate([run[name] for run in other.runs]) - whole
        size = float(np.sqrt(np.mean(whole**2)))
        found[name] = float(np.sqrt(np.mean(change**2))) / size if size else 0.0
    return found
