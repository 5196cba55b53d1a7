"""How often the decision names something on records in which nothing is hidden: what the study measured, per drive."""

from dataclasses import dataclass

from msl_fem.diagnosis.calibration_data import CLEAN
from msl_fem.plant.plant import CURRENT_DRIVE, VOLTAGE_DRIVE, PlantParameters
from msl_fem.prediction import RunData

DRIVES = {CURRENT_DRIVE: "current", VOLTAGE_DRIVE: "voltage"}
RATE = (8e3, 12e3)  # Hz
SECONDS = (1.5, 16.0)  # of all fit runs together


@dataclass(frozen=True)
class Calibration:
    """Clean records of one kind, by the largest gain in nats that any effect brought (sorted, largest first)."""

    gains: tuple[float, ...]
    named: int

    @property
    def records(self) -> int:
        return len(self.gains)

    def p_value(self, statistic: float) -> float:
        """Share of clean records that reach a statistic, counting this record as one of them."""
        return (1 + sum(gain >= statistic for gain in self.gains)) / (1 + self.records)


def calibration_of(plant: PlantParameters, runs: list[RunData]) -> tuple[Calibration | None, str]:
    """The calibration of a record's kind, and where it lies outside of it, in words; None where there is none."""
    drive = DRIVES.get(plant.drive)
    if drive is None or plant.sides != 2 or drive not in CLEAN:
        return None, "no clean records were studied for this kind of rig: the false-alarm rate is not known"
    gains, named = CLEAN[drive]
    found = Calibration(tuple(gains), named)
    rate, seconds = runs[0].rate, sum(len(run.commands) / run.rate for run in runs)
    if not RATE[0] <= rate <= RATE[1]:
        return found, f"{rate:g} samples a second; the false-alarm rate was measured at {RATE[0]:g} to {RATE[1]:g}"
    if not SECONDS[0] <= seconds <= SECONDS[1]:
        return found, f"{seconds:.3g} s of fit runs; the false-alarm rate was measured with 4 s"
    return found, ""
