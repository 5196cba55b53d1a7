"""What a trial of the search leaves in its storage, and how it is read back."""

import math
from dataclasses import asdict, dataclass
from typing import Any

from optuna.trial import FrozenTrial, TrialState

from msl_fem.design.sizing.constraints import Constraint, total_violation
from msl_fem.design.sizing.design import Design
from msl_fem.design.sizing.judge import Verdict

FIRST_DESIGN = "first_design"
VERDICT = "verdict"
"""Name of the user attribute of a judged trial; a trial without it was lost on the way."""


@dataclass(frozen=True)
class JudgedTrial:
    """A trial as the storage has it: `figures` in SI units, of the magnet that the field says it takes."""

    number: int
    parameters: dict[str, float]
    judged: str
    feasible: bool
    values: tuple[float, ...]
    figures: dict[str, Any]
    constraints: tuple[Constraint, ...]
    solves: int
    first_design: str | None = None
    """Its name, where the trial was put in front of the search."""

    @property
    def violation(self) -> float:
        return total_violation(self.constraints)


def verdict_attribute(design: Design, verdict: Verdict) -> dict[str, Any]:
    """The user attribute of a trial: one JSON value, so that it is one write."""
    return {
        "judged": verdict.judged,
        "feasible": verdict.feasible,
        "solves": verdict.solves,
        "design": asdict(design),
        "figures": {} if verdict.performance is None else figures(verdict),
        "constraints": [asdict(c) for c in verdict.constraints],
    }


def figures(verdict: Verdict) -> dict[str, Any]:
    """The numbers of a design that scripts read, names with units."""
    found = verdict.performance
    assert found is not None, "only what can be built has figures"
    numbers = {
        "mass_kg": found.masses.total,
        "moving_mass_kg": found.masses.armature,
        "loss_W": found.loss,
        "force_N": found.force,
        "inductance_H": found.inductance,
        "flux_density_T": found.flux_density,
        "section": found.section,
        "current_A": found.current,
        "turns": found.magnet.coil.turns,
        "resistance_ohm": found.resistance,
        "current_density_A_per_m2": found.current_density,
        "temperature_rise_K": found.temperature_rise,
        "slew_rate_N_per_s": found.slew_rate,
        "stack_depth_m": found.magnet.stack_depth,
    }
    # the rise is infinite where no temperature balances the loss: JSON has no word for that
    return {k: None if isinstance(v, float) and not math.isfinite(v) else v for k, v in numbers.items()}


def judged_trial(trial: FrozenTrial) -> JudgedTrial:
    """A storage's trial that has a verdict."""
    stored, values = trial.user_attrs[VERDICT], trial.values if trial.state == TrialState.COMPLETE else None
    return JudgedTrial(
        number=trial.number,
        parameters=dict(trial.params),
        judged=stored["judged"],
        feasible=bool(stored["feasible"]) and values is not None,
        values=tuple(values or ()),
        figures=stored["figures"],
        constraints=tuple(Constraint(**fields) for fields in stored["constraints"]),
        solves=int(stored["solves"]),
        first_design=trial.user_attrs.get(FIRST_DESIGN),
    )
