"""What a second input makes of parameters, after a fit: their values at its levels."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.diagnosis.estimates import INTERVAL, Estimate
from msl_fem.diagnosis.likelihood import Fit
from msl_fem.prediction import ModelHypothesis
from msl_fem.prediction.hypothesis import believed_value, unit_of_believed
from msl_fem.prediction.scheduling import Schedule

STEP = 1e-4  # of z, of a difference


@dataclass(frozen=True)
class ScheduledEstimate:
    """A parameter over a second input.

    Attributes
    ----------
    parameter, unit : "damping" or "effect.parameter", SI
    column : of the second input, its unit in its name
    at : its levels; between them the parameter goes straight
    values : the parameter there
    """

    parameter: str
    unit: str
    column: str
    at: tuple[float, ...]
    values: tuple[Estimate, ...]

    @property
    def text(self) -> str:
        """In a sentence."""
        told = ", ".join(f"{v.value:.4g} ({v.low:.4g} to {v.high:.4g})" for v in self.values)
        levels = ", ".join(f"{at:.4g}" for at in self.at)
        return f"{self.parameter} goes with {self.column}: at {levels} it is {told} {self.unit}".rstrip()

    def to_json(self) -> dict[str, Any]:
        """The entry in diagnosis.json."""
        return {
            "parameter": self.parameter,
            "unit": self.unit,
            "column": self.column,
            "at": list(self.at),
            "value": [v.value for v in self.values],
            "ci95": [[v.low, v.high] for v in self.values],
        }


def scheduled_estimates(
    belief: ModelHypothesis, found: Fit, schedules: Sequence[Schedule]
) -> tuple[ScheduledEstimate, ...]:
    """Of the parameters that a fit has; of an effect that it does not have none."""
    made = []
    for one in schedules:
        rows = _logarithms(belief, found, one, np.vstack([found.z, found.z + STEP * np.eye(found.z.size)]))
        if not np.isfinite(rows).all():
            continue
        slopes = (rows[1:] - rows[0]).T / STEP
        errors = found.likelihood.standard_errors(found, slopes)
        values = tuple(
            Estimate(*(float(np.exp(middle + k * INTERVAL * error)) for k in (0, -1, 1)))
            for middle, error in zip(rows[0], errors, strict=True)
        )
        unit = unit_of_believed(one.parameter)
        made.append(ScheduledEstimate(one.parameter, unit, one.column, tuple(map(float, one.at)), values))
    return tuple(made)


def _logarithms(belief: ModelHypothesis, found: Fit, schedule: Schedule, rows: Array) -> Array:
    """(n_row, n_level) of a parameter's sizes at values of the unknowns (n_row, unknowns.size)."""
    effect, _, name = schedule.parameter.rpartition(".")
    made = []
    for z in rows:
        factors = found.unknowns.factors(z)
        if effect:
            (place,) = [u.place for u in found.unknowns.effects if (u.effect, u.name) == (effect, name)] or [-1]
            first = abs(float(found.unknowns.effect_vector(z)[place])) if place >= 0 else 0.0
        else:
            first = believed_value(belief, name) * factors.get(name, 1.0)
        made.append([first, *(first * factors[one] for one in schedule.names)])
    with np.errstate(divide="ignore"):
        return np.log(np.array(made))


def about_schedules(schedules: Sequence[Schedule], estimates: Sequence[ScheduledEstimate]) -> list[str]:
    """What a second input does, in sentences."""
    if not schedules:
        return []
    column, first = schedules[0].column, schedules[0].at[0]
    return [one.text for one in estimates] + [
        f"parameters that go with {column}, and the extended model, are stated as they are at {first:.4g}"
    ]
