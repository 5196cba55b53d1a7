"""What of a record does not count, and why: counted, and told in words and in diagnosis.json."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from msl_fem.diagnosis.stretches import Stretches
from msl_fem.errors import InputError
from msl_fem.prediction import KernelPlant, ModelHypothesis, RunData
from msl_fem.prediction.free_run import read_current
from msl_fem.prediction.hypothesis import plant_of_run
from msl_fem.prediction.run_data import POSITION_COLUMN

OUTSIDE = "the model leaves its table or range"


@dataclass(frozen=True)
class LeftOut:
    """Samples of a run that do not count.

    Attributes
    ----------
    channel : its column, whose readings they are; empty: of all of them
    samples : how many; `share` of those of the run
    first : s, the time of the first one
    details : beside the reason, in words
    """

    run: str
    channel: str
    reason: str
    samples: int
    share: float
    first: float
    details: str = ""

    @classmethod
    def of(cls, run: RunData, at: NDArray[np.intp], reason: str, *, channel: str = "", details: str = "") -> "LeftOut":
        """These samples of a run."""
        return cls(run.name, channel, reason, int(at.size), at.size / len(run.commands), at[0] / run.rate, details)

    @property
    def text(self) -> str:
        """In a sentence."""
        where = f"{self.channel} of {self.run}" if self.channel else self.run
        much = f"{self.samples} samples ({100 * self.share:.2g} %, the first at {self.first:.4g} s) do not count"
        return f"{where}: {much}, since {self.reason}{self.details}"

    def to_json(self) -> dict[str, Any]:
        """The entry in diagnosis.json."""
        found = asdict(self)
        found["first_s"] = found.pop("first")
        return found | {"channel": self.channel or None, "details": self.details.strip("; ")}


def about_invalid(runs: Sequence[RunData]) -> tuple[LeftOut, ...]:
    """What the record, or a clipped sensor, says does not count."""
    reason = "the record says so, or the sensor is clipped there"
    return tuple(LeftOut.of(run, at, reason, channel=name) for run in runs for name, at in run.invalid.items())


def left_outside(
    belief: ModelHypothesis, runs: Sequence[RunData], cuts: Sequence[Stretches | None]
) -> tuple[LeftOut, ...]:
    """What lies in stretches over which the model leaves its table or range."""
    found = []
    for run, cut in zip(runs, cuts, strict=True):
        at = np.flatnonzero(~cut.counts(len(run.commands))) if cut is not None else np.zeros(0, dtype=np.intp)
        if at.size:
            found.append(LeftOut.of(run, at, OUTSIDE, details=_reached(belief, run, at)))
    return tuple(found)


def runs_inside(
    belief: ModelHypothesis, runs: Sequence[RunData], cuts: Sequence[Stretches | None]
) -> list[tuple[RunData, Stretches | None]]:
    """The runs of which something counts, with their stretches.

    Raises
    ------
    InputError : nothing of what is fitted, or of what is held out, lies inside
    """
    pairs = list(zip(runs, cuts, strict=True))
    inside = [(run, cut) for run, cut in pairs if cut is None or cut.counted_parts(len(run.commands))]
    for role in sorted({run.role for run in runs}):
        if not any(run.role == role for run, _ in inside):
            lost = next(run for run in runs if run.role == role)
            reached = _reached(belief, lost, np.arange(len(lost.commands)))
            raise InputError(
                f"no sample of the runs with the role {role} can be simulated: {OUTSIDE}{reached}; check the units and "
                "zeros of the columns, or make a table that reaches so far"
            )
    return inside


def _reached(belief: ModelHypothesis, run: RunData, at: NDArray[np.intp]) -> str:
    """Where readings at these samples lie beside the table, in words; empty of a rig without one."""
    table = belief.table
    plant = plant_of_run(belief, run)
    if table is None or not plant.parameters.sides:
        return ""
    gaps, currents = _gaps(plant, run)[:, at], _currents(plant, run)[:, at]
    return (
        f"; gaps of {1e3 * gaps.min():.4g} to {1e3 * gaps.max():.4g} mm and currents to {np.abs(currents).max():.3g} A "
        f"are read there, the table holds {1e3 * table.gap[0]:.4g} to {1e3 * table.gap[-1]:.4g} mm and "
        f"{table.current[-1]:.3g} A"
    )


def _gaps(plant: KernelPlant, run: RunData) -> NDArray[np.float64]:
    """(n_side, n_sample) as read."""
    x = run.measured[POSITION_COLUMN] / plant.gain
    p = plant.parameters
    return np.array([p.nominal_gap - (1 - 2 * side) * x for side in range(p.sides)])


def _currents(plant: KernelPlant, run: RunData) -> NDArray[np.float64]:
    """(n_side, n_sample) of a magnet, as read or commanded."""
    p = plant.parameters
    return np.array([read_current(plant, run, side) * p.current_share for side in range(p.sides)])
