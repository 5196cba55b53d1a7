"""What a diagnosis takes beside a record."""

from collections.abc import Callable
from dataclasses import dataclass, field

from msl_fem.diagnosis.decision import Rule
from msl_fem.diagnosis.fit_memory import FitMemory
from msl_fem.plant.believed import PLAIN_BELIEF, Belief
from msl_fem.table.magnetic_table import MagneticTable


def _untold(text: str) -> None:
    """No progress is told."""


@dataclass(frozen=True, eq=False)
class DiagnosisSettings:
    """What a diagnosis takes beside the record: the table of its magnets, the rule, threads, a progress report, and
    where fits of an interrupted one ended; `belief` is what the plain model is believed to have beside."""

    table: MagneticTable | None = None
    rule: Rule = field(default_factory=Rule)
    threads: int = 1
    progress: Callable[[str], None] = _untold
    memory: FitMemory = field(default_factory=FitMemory)
    belief: Belief = PLAIN_BELIEF
