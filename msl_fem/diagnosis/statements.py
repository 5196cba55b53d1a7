"""What rig.toml states about a record that is either so or not, like the hold of its commands, judged by the record.

A wrong statement is an error of the model: at low rates as large as an effect, and one effect or another makes up for
part of it. Each is tried the other way round at what a search has found, with everything fitted anew; it has no number
of its own, so its evidence is that of the fit.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from msl_fem.diagnosis.decision import TIE
from msl_fem.diagnosis.fit import FitPlan, fit
from msl_fem.diagnosis.kind import Kind
from msl_fem.diagnosis.likelihood import Fit, white
from msl_fem.diagnosis.refits import CATCHING_UP
from msl_fem.errors import ComputationError

NEARLY = 0.05
"""Share of an effect's nats that may be lost where a statement turned round stands in its place."""
STEPS = 8  # of a fit: beside what a wrong statement costs, what further ones would bring is little


def in_doubt(kind: Kind, fits: Sequence[Fit]) -> Kind | None:
    """The record with the statement turned round that explains it better without effects, by more than a tie, and comes
    near what the first effect brings, with that effect or without: where the statement is wrong, what was found to make
    up for it is no worse beside the true one. None where none does, or nothing but noise is to be explained.

    Parameters
    ----------
    fits : of the record as it is stated: without effects, and with the first, if there is one
    """
    bare, last = fits[0], fits[-1]
    if white(bare.excess):
        return None
    least = last.log_evidence - NEARLY * (last.log_evidence - bare.log_evidence)
    for other in kind.restatements():
        better = bare.log_evidence + TIE
        alone = _evidence(other, bare, better)
        if alone > better and (alone > least or _evidence(other, last, least) > least):
            return other
    return None


def restated(kind: Kind, fits: Sequence[Fit]) -> Kind | None:
    """The record with the statement turned round that may explain it better than the last of these fits: by more than a
    tie without one of its effects, which may make up for the statement, or, where it explains it better without any
    effect too, with all of them or none; or that loses next to nothing of an effect's nats without it. None where none
    does, or nothing but noise is to be explained.

    Parameters
    ----------
    fits : of the record as it is stated: without effects, with the first, and so on
    """
    bare, last = fits[0], fits[-1]
    if white(bare.excess):
        return None
    gains = [after.log_evidence - before.log_evidence for before, after in pairwise(fits)]
    for other in kind.restatements():
        least = [last.log_evidence - NEARLY * gain for gain in gains]
        every = zip(_effects(last), least, strict=True)
        turned = [_evidence(other, last, nats, without=name) for name, nats in every]
        if any(nats > needed for nats, needed in zip(turned, least, strict=True)):
            return other
        better = bare.log_evidence + TIE
        alone = _evidence(other, bare, better)
        if alone > better:
            turned += [alone, _evidence(other, last, last.log_evidence + TIE)]
        if max(turned, default=-np.inf) > last.log_evidence + TIE:
            return other
    return None


def _effects(found: Fit) -> list[str]:
    """The names of the effects of a fit."""
    return list(dict.fromkeys(one.effect for one in found.unknowns.effects))


def _evidence(other: Kind, found: Fit, least: float, *, without: str = "") -> float:
    """Log evidence of the record turned round, fitted from where a fit of the record as stated ended, `without` one of
    its effects; minus infinity where that cannot be simulated. A fit of which the first step shows that it does not
    come to the `least` nats that count ends there."""
    kept = np.array([one.effect != without for one in found.unknowns.effects], dtype=bool)
    n = found.unknowns.n_nuisance
    unknowns = replace(
        found.unknowns, effects=tuple(one for one, stays in zip(found.unknowns.effects, kept, strict=True) if stays)
    )
    start = found.z[np.concatenate([np.ones(n, dtype=bool), kept])]
    likelihood = replace(other.likelihood, strict=True) if found.likelihood.strict else other.likelihood
    plan = FitPlan(most_steps=1, renew=False)
    try:
        begun = fit(likelihood, unknowns, start, plan=plan, nuisance_columns=found.jacobian[:, :n])
        if begun.log_evidence + CATCHING_UP * begun.to_come(STEPS) < least:
            return begun.log_evidence
        plan = FitPlan(most_steps=STEPS, damping=begun.damping, renew=False)
        return fit(begun.likelihood, unknowns, begun.z, plan=plan, goes_on=begun).log_evidence
    except ComputationError:  # so it leaves the table where the record as stated does not
        return -np.inf
