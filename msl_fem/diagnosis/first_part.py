"""What the first part of a long record tells at once: which candidates lead.

What a cause of some per cent leaves in a record of many seconds is hundreds of times what names it, and each look at a
candidate costs as much as the record is long. So all are looked at over the first stretches: which lead there is looked
at before the others over the whole record, and begins where it has come to. The whole record decides alone: where what
leads leaves more than a little of it, the others are looked at as well, and where it bends what is believed those that
do not lag far behind.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from msl_fem.diagnosis.fit import FitPlan, fit, fit_there
from msl_fem.diagnosis.fit_memory import FitMemory
from msl_fem.diagnosis.likelihood import Fit, Likelihood, white
from msl_fem.diagnosis.refinement import Refinement
from msl_fem.diagnosis.refits import LAST_STEPS, ROUGH, Refit, let_go
from msl_fem.diagnosis.scores import Score

PLENTY = 1_000.0
"""Nats of these samples above those of noise, from which they tell causes apart."""


def best_first(
    base: Fit, candidates: Sequence[Score], beside: Callable[..., Refinement], memory: FitMemory
) -> list[Refit]:
    """The refits of candidates `beside` a fit over a record, best first. Of a long one whose first part says what
    leads, the others are those over that part, their gains behind as if the rest were like it."""
    first = None if base.unknowns.effects else _over_first_part(base)
    if first is None:
        return beside(base, memory=memory).best_first(candidates)
    there = beside(first, memory=memory.part("its first part"), of_part=True)
    refits = there.best_first(candidates)
    let_go(refits)
    whole = beside(base, memory=memory, ends={one.variant: one.fit.z for one in refits})
    if refits and (there.lost or there.takes_all(refits[0])):
        near = {one.variant for one in refits if there.is_near(one, refits[0])}
        led = whole.best_first([score for score in candidates if score.variant in near])
        far = [one for one in refits if one.variant not in near]
        if not (led and whole.takes_all(led[0])):
            let_go(led)
            nearly = bool(led) and whole.takes_nearly_all(led[0])
            far = [one for one in far if nearly and there.lags(one, refits[0])]
            known = near | {one.variant for one in far}
            led = whole.best_first([score for score in candidates if score.variant not in known], led)
        share = first.residual.size / base.residual.size
        return [*led, *(replace(one, gain=led[0].gain - (refits[0].gain - one.gain) / share) for one in far)]
    return whole.best_first(candidates)


def _there(found: Fit, likelihood: Likelihood, numbers: NDArray[np.bool_]) -> Fit:
    """A fit over the first part of its record, where it is."""
    return fit_there(likelihood, found.unknowns, found.z, found.jacobian.T[:, numbers].T)


def in_first_part(found: Fit) -> Fit | None:
    """A fit over the first part of a long record, where it is; None where that does not tell causes apart."""
    whole = found.likelihood
    if not (whole.is_cut and whole.is_long) or white(found.excess):
        return None
    likelihood, numbers = whole.first_part()
    if found.nats_above_noise < PLENTY * found.residual.size / np.count_nonzero(numbers):
        return None
    return _there(found, likelihood, numbers)


def _over_first_part(base: Fit) -> Fit | None:
    """A fit led to its end over the first part of a long record; None where that is not worth it."""
    there = in_first_part(base)
    if there is None:
        return None
    if base.sane is not None:  # over its own stretches: from where those of a lost model begin it may not get anywhere
        return replace(there, sane=_there(base.sane, *base.sane.likelihood.first_part()))
    plan = FitPlan(LAST_STEPS, enough=ROUGH)
    return fit(there.likelihood, base.unknowns, base.z, plan=plan, goes_on=there, takes_columns=True)
