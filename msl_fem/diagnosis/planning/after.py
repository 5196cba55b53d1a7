"""What a diagnosis leaves open: a cause that it named with others beside it, as the question of an experiment."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from msl_fem.diagnosis.planning.expected import ExpectedCause, expected_causes
from msl_fem.diagnosis.planning.experiments import ExperimentPlan, Progress, RigToPlan, experiments
from msl_fem.diagnosis.planning.separations import RUN_INSTRUMENTS
from msl_fem.plant.believed import PLAIN_BELIEF
from msl_fem.plant.effects import CATALOGUE, EffectValues
from msl_fem.plant.excitation_kinds import Excitation
from msl_fem.prediction import ModelHypothesis
from msl_fem.record import Tolerance


@dataclass(frozen=True, eq=False)
class OpenQuestion:
    """What an experiment is asked.

    Attributes
    ----------
    rig : without the causes in question
    asked : the causes in question
    possible : all that could be, by name
    read : the instruments
    named : the one of them that a record named; "" before anything is measured
    usual : the run that all others are made of; None: the standard one of the actuator
    """

    rig: RigToPlan
    asked: tuple[str, ...]
    possible: dict[str, ExpectedCause]
    read: tuple[str, ...]
    named: str = ""
    usual: Excitation | None = None

    def plan(
        self,
        names: Sequence[str] = (),
        instruments: Sequence[str] = (),
        *,
        progress: Progress = lambda done, total: None,
    ) -> ExperimentPlan:
        """The plan; of the causes asked about and with what is read, where no others are stated."""
        causes = [self.possible[name] for name in dict.fromkeys(names or self.asked)]
        named = self.named if self.named in {cause.effect for cause in causes} else ""
        read = instruments or self.read
        return experiments(self.rig, causes, read, excitation=self.usual, named=named, progress=progress)


def open_question(
    extended: ModelHypothesis,
    named: Sequence[tuple[str, Sequence[str]]],
    channels: Iterable[str],
    *,
    tolerance: Tolerance,
    rate: float,
    usual: Excitation | None = None,
) -> OpenQuestion | None:
    """The first named cause that has effects beside it, about the extended model without it; None where none has.

    Parameters
    ----------
    named : each cause with all that the record cannot tell from it
    channels : columns that were compared
    usual : how the record was excited (`diagnosis.usual_run`)
    """
    rivals = {effect: effects_of(beside) for effect, beside in named if effect in CATALOGUE}
    effect = next((effect for effect, beside in rivals.items() if beside), None)
    if effect is None:
        return None
    stated = {} if extended.effects is None else {name: dict(of) for name, of in extended.effects.stated.items()}
    fitted = ExpectedCause(effect, stated.pop(effect, {}), "the diagnosis")
    belief = ModelHypothesis(extended.actuator, extended.table, EffectValues(stated) if stated else None)
    every = expected_causes(extended.actuator, PLAIN_BELIEF, tolerance=tolerance, rate=rate)
    possible = {one.effect: one for one in every} | {effect: fitted}
    asked = (effect, *(name for name in rivals[effect] if name in possible))
    words = {name.partition("_")[0] for name in channels}
    read = tuple(name for name in RUN_INSTRUMENTS if name in words)
    return OpenQuestion(RigToPlan(belief, rate), asked, possible, read, effect, usual)


def effects_of(beside: Iterable[str]) -> list[str]:
    """Those of some names that are effects of the catalogue, each once."""
    return [name for name in dict.fromkeys(beside) if name in CATALOGUE]
