"""What rig.toml states about a record that is either so or not, like the hold of its commands, judged by the record.

A wrong statement is an error of the model: at low rates as large as an effect, and one effect or another makes up for
part of it. Each is tried the other way round, with everything fitted anew as for an effect; it has no number of its
own, so its evidence is that of the fit.
"""

from msl_fem.diagnosis.decision import QUIET, TIE
from msl_fem.diagnosis.fit import FitPlan, fit
from msl_fem.diagnosis.kind import Kind, about_belief
from msl_fem.diagnosis.search import SearchStage, search_stage
from msl_fem.errors import ComputationError

STEPS = 8  # of a fit: beside what a wrong statement costs, what further ones would bring is little


def restated(kind: Kind, stage: SearchStage) -> Kind | None:
    """The record with the statement turned round that explains it better, with one effect or none, than it is explained
    as stated with the best effect of the first stage, by more than a tie; None where none does, or nothing but noise is
    to be explained."""
    base = stage.base
    if max(base.excess.values(), default=0.0) <= QUIET:
        return None
    columns = base.jacobian[:, : base.unknowns.n_nuisance]
    best = _explained(stage)
    for other in kind.restatements():
        plan = FitPlan(most_steps=STEPS, renew=False)
        try:
            found = fit(other.likelihood, base.unknowns, base.z, plan=plan, nuisance_columns=columns)
        except ComputationError:  # so it leaves the table where the record as stated does not
            continue
        if found.log_evidence < base.log_evidence + TIE:
            continue
        turned = search_stage(found, about_belief(other, found), tell=_untold)
        if _explained(turned) > best + TIE:
            return other
    return None


def _explained(stage: SearchStage) -> float:
    """Log evidence with the best effect of a stage, where that brings anything."""
    return stage.base.log_evidence + max(stage.best.gain if stage.best is not None else 0.0, 0.0)


def _untold(text: str) -> None:
    """No progress is told."""
