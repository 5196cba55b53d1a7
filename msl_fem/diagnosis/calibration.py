"""How often the decision names something on records in which nothing is hidden: what the study measured, per drive.

A rate holds for what it was measured with alone: the rig and its tolerances, sampling and duration, the catalogue with
all that is tried of it, and the rule. Where one of them differs, no rate is stated.
"""

import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from msl_fem.diagnosis import decision
from msl_fem.diagnosis.decision import Rule
from msl_fem.diagnosis.variants import RecordFeatures, possible, variants
from msl_fem.plant.effects import CATALOGUE
from msl_fem.plant.plant import CURRENT_DRIVE, VOLTAGE_DRIVE, PlantParameters
from msl_fem.prediction import BELIEVED, RunData
from msl_fem.record import Record

DRIVES = {CURRENT_DRIVE: "current", VOLTAGE_DRIVE: "voltage"}
RATE = (8e3, 12e3)  # Hz
SECONDS = (3.0, 5.0)  # of all fit runs together
ANY_RECORD = RecordFeatures(position=1e-5, current=1.0, velocity=1e-3, own_frequency=60.0)
"""The features by which the variants that are tried are listed."""
OF_RULE = ("QUIET", "LEFT_OVER", "TOLERANCES", "WORSE", "WANDERED", "OWN_OF_A_RUN", "BESIDE", "STRONG")
"""Numbers of `decision` that decide beside those of the `Rule`."""


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


@dataclass(frozen=True)
class Conditions:
    """Digests of what a false-alarm rate was measured with: rig and tolerances, all that is tried, the rule."""

    rig: str
    catalogue: str
    rule: str


def conditions_of(record: Record, plant: PlantParameters, rule: Rule) -> Conditions:
    """The conditions under which a record is diagnosed."""
    actuator = record.actuator.model_dump(mode="json", include={"magnet", "sides", "motion", "drive"})
    rig = [actuator, record.tolerance.model_dump(mode="json", include={*BELIEVED, "table"})]
    constants = [sorted(value) if isinstance(value, set) else value for value in map(vars(decision).get, OF_RULE)]
    return Conditions(
        _digest(rig),
        _digest(_all_that_is_tried(plant)),
        _digest([asdict(rule), constants]),
    )


def _all_that_is_tried(plant: PlantParameters) -> list[Any]:
    """Every variant of every effect that a plant can have, and the numbers by which its amounts are scaled."""
    tried: list[Any] = []
    for effect in sorted(possible(plant)):
        tried += sorted(variant.name for variant in variants(effect, ANY_RECORD, plant))
        tried += sorted([p.name, p.neutral, p.scale, list(p.bounds), p.shape] for p in CATALOGUE[effect].parameters)
    return tried


def _digest(content: Any) -> str:
    """Of numbers six digits count."""
    return hashlib.sha256(json.dumps(_rounded(content), sort_keys=True).encode()).hexdigest()[:16]


def _rounded(content: Any) -> Any:
    if isinstance(content, dict):
        return {name: _rounded(value) for name, value in content.items()}
    if isinstance(content, list | tuple):
        return [_rounded(value) for value in content]
    return f"{content:.6g}" if isinstance(content, float) else content


def calibration_of(
    record: Record, plant: PlantParameters, runs: Sequence[RunData], rule: Rule
) -> tuple[Calibration | None, str]:
    """The calibration that holds for a record's fit runs under a rule; None and why, in words, where none does."""
    drive = DRIVES.get(plant.drive)
    if drive is None or plant.sides != 2 or drive not in CLEAN:
        return None, "no clean records were studied for this kind of rig: the false-alarm rate is not known"
    measured, gains, named = CLEAN[drive]
    here = conditions_of(record, plant, rule)
    rate, seconds = runs[0].rate, sum(len(run.commands) / run.rate for run in runs)
    if here.rig != measured.rig:
        return None, "the false-alarm rate was measured with another actuator or other tolerances: it is not known here"
    if here.catalogue != measured.catalogue:
        return None, "the false-alarm rate was measured with another catalogue of effects: it is not known here"
    if here.rule != measured.rule:
        return None, "the false-alarm rate was measured with another rule: it is not known here"
    if not RATE[0] <= rate <= RATE[1]:
        return None, f"{rate:g} samples a second; the false-alarm rate was measured at {RATE[0]:g} to {RATE[1]:g}"
    if not SECONDS[0] <= seconds <= SECONDS[1]:
        return None, f"{seconds:.3g} s of fit runs; the false-alarm rate was measured with 4 s"
    return Calibration(tuple(gains), named), ""


# Written by benchmarks/diagnosis_study_tables.py, to the end: conditions, clean records' largest gains in nats, how
# many of these records were named.
CLEAN: dict[str, tuple[Conditions, list[float], int]] = {
    "voltage": (Conditions("d870aeb557944168", "30db9788b4f81e73", "2a79a528f88df406"), [
        3.78, 2.24, 2.20, 2.17, 2.14, 1.73, 1.60, 1.54, 1.48, 1.44, 1.35, 1.33, 1.32, 1.18, 0.85, 0.84,
        0.76, 0.74, 0.66, 0.53, 0.51, 0.51, 0.26, 0.08, 0.04, 0.03, -0.02, -0.03, -0.04, -0.04, -0.07,
        -0.09, -0.10, -0.13, -0.13, -0.14, -0.16, -0.17, -0.24, -0.30, -0.31, -0.32, -0.33, -0.33, -0.34,
        -0.36, -0.37, -0.39, -0.45, -0.53, -0.54, -0.56, -0.58, -0.59, -0.64, -0.69, -0.69, -0.72, -0.74,
        -0.74, -0.74, -0.74, -0.75, -0.76, -0.76, -0.81, -0.87, -0.88, -0.89, -0.90, -0.91, -0.92, -0.94,
        -0.97, -0.98, -0.99, -1.02, -1.06, -1.08, -1.09, -1.10, -1.12, -1.15, -1.17, -1.18, -1.18, -1.19,
        -1.19, -1.20, -1.21, -1.23, -1.24, -1.26, -1.27, -1.28, -1.31, -1.31, -1.32, -1.32, -1.34, -1.35,
        -1.35, -1.36, -1.38, -1.40, -1.40, -1.41, -1.41, -1.42, -1.43, -1.43, -1.43, -1.44, -1.44, -1.44,
        -1.46, -1.46, -1.46, -1.46, -1.47, -1.47, -1.47, -1.47, -1.48, -1.48, -1.48, -1.49, -1.49, -1.50,
        -1.50, -1.50, -1.50, -1.50, -1.50, -1.51, -1.55, -1.57, -1.58, -1.59, -1.64, -1.68, -1.83, -1.90,
        -1.91, -1.93, -1.94, -1.94, -1.95, -1.96, -1.99
    ], 0),
    "current": (Conditions("8e73cf318e64d580", "0b4dcab53a141399", "2a79a528f88df406"), [
        5.64, 5.04, 4.03, 3.08, 2.62, 2.15, 2.12, 2.09, 1.96, 1.87, 1.83, 1.72, 1.71, 1.60, 1.41, 1.15,
        1.10, 0.98, 0.83, 0.75, 0.74, 0.67, 0.64, 0.53, 0.43, 0.36, 0.03, 0.01, -0.04, -0.07, -0.09, -0.15,
        -0.21, -0.22, -0.27, -0.28, -0.34, -0.35, -0.36, -0.37, -0.42, -0.45, -0.46, -0.46, -0.47, -0.50,
        -0.52, -0.52, -0.53, -0.54, -0.55, -0.58, -0.60, -0.63, -0.64, -0.66, -0.69, -0.71, -0.74, -0.76,
        -0.81, -0.82, -0.83, -0.87, -0.88, -0.89, -0.90, -0.91, -0.94, -0.97, -0.99, -1.01, -1.01, -1.02,
        -1.06, -1.06, -1.08, -1.09, -1.09, -1.09, -1.09, -1.11, -1.12, -1.12, -1.13, -1.13, -1.15, -1.17,
        -1.17, -1.20, -1.21, -1.22, -1.23, -1.23, -1.24, -1.24, -1.24, -1.25, -1.25, -1.26, -1.27, -1.28,
        -1.29, -1.30, -1.30, -1.30, -1.30, -1.31, -1.31, -1.31, -1.31, -1.32, -1.33, -1.33, -1.34, -1.36,
        -1.36, -1.37, -1.38, -1.38, -1.38, -1.39, -1.39, -1.39, -1.41, -1.41, -1.44, -1.46, -1.46, -1.50,
        -1.52, -1.57, -1.64, -1.67, -1.69, -1.70, -1.73, -1.74, -1.76, -1.77, -1.78, -1.81, -1.81, -1.88,
        -1.88, -2.04, -2.10, -2.10, -2.12, -2.12
    ], 0),
}  # fmt: skip
