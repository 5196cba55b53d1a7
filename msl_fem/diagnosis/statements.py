"""What rig.toml states about a record that is either so or not, like the hold of its commands, judged by the record.

A wrong statement is an error of the model: at low rates as large as an effect, and one effect or another makes up for
part of it. Each is tried the other way round at what a search has found, with everything fitted anew; it has no number
of its own, so its evidence is that of the fit.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from msl_fem.diagnosis.decision import QUIET, TIE
from msl_fem.diagnosis.fit import FitPlan, fit
from msl_fem.diagnosis.kind import Kind
from msl_fem.diagnosis.likelihood import Fit
from msl_fem.errors import ComputationError

STEPS = 8  # of a fit: beside what a wrong statement costs, what further ones would bring is little


def restated(kind: Kind, fits: Sequence[Fit]) -> Kind | None:
    """The record with the statement turned round that explains it better than as it is stated, by more than a tie:
    without any effect, and then more than the last of these fits, with its effects or without one or all of them, since
    an effect may make up for the statement. None where none does, or nothing but noise is to be explained.

    Parameters
    ----------
    fits : of the record as it is stated: without effects, with the first, and so on
    """
    bare, last = fits[0], fits[-1]
    if max(bare.excess.values(), default=0.0) <= QUIET:
        return None
    for other in kind.restatements():
        turned = _evidence(other, bare)
        if turned <= bare.log_evidence + TIE:
            continue
        if max(turned, *(_evidence(other, last, without=name) for name in ("", *_effects(last)))) > (
            last.log_evidence + TIE
        ):
            return other
    return None


def _effects(found: Fit) -> list[str]:
    """The names of the effects of a fit."""
    return list(dict.fromkeys(one.effect for one in found.unknowns.effects))


def _evidence(other: Kind, found: Fit, *, without: str = "") -> float:
    """Log evidence of the record turned round, fitted from where a fit of the record as stated ended, `without` one of
    its effects; minus infinity where that cannot be simulated."""
    kept = np.array([one.effect != without for one in found.unknowns.effects], dtype=bool)
    n = found.unknowns.n_nuisance
    unknowns = replace(
        found.unknowns, effects=tuple(one for one, stays in zip(found.unknowns.effects, kept, strict=True) if stays)
    )
    start = found.z[np.concatenate([np.ones(n, dtype=bool), kept])]
    likelihood = replace(other.likelihood, strict=True) if found.likelihood.strict else other.likelihood
    plan = FitPlan(most_steps=STEPS, renew=False)
    try:
        return fit(likelihood, unknowns, start, plan=plan, nuisance_columns=found.jacobian[:, :n]).log_evidence
    except ComputationError:  # so it leaves the table where the record as stated does not
        return -np.inf
