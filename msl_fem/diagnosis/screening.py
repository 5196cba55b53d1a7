"""What is told while candidates are looked at, and what they keep of it."""

import threading
import time
from collections.abc import Callable
from typing import TypeVar

from msl_fem.diagnosis.refits import Refit, by_gain, let_go
from msl_fem.diagnosis.variants import Variant

WITH_COLUMNS = 3
"""Candidates over stretches that keep their Jacobians, the best: each is as large as that of the fit beside which they
are, and those behind seldom go on."""

LookedAt = TypeVar("LookedAt", bound=Refit | None)


class Screening:
    """What is told while candidates are looked at: how many are left, which leads, how long it may take."""

    def __init__(
        self, tell: Callable[[str], None], count: int, what: str, behind: Callable[[Refit, float], bool]
    ) -> None:
        self._tell, self._count, self._done, self._what, self._behind = tell, count, 0, what, behind
        self._front: list[Refit] = []  # the best first
        self._since, self._lock = time.monotonic(), threading.Lock()

    def ends(self, variant: Variant, refit: LookedAt) -> LookedAt:
        """Keeps what a candidate came to; the Jacobian of one far behind the best goes at once, and over stretches
        those of all but the best. All run at the same time, so the rest of them takes its share at most."""
        with self._lock:
            self._done += 1
            if refit is not None:
                self._takes(refit)
            left = self._count - self._done
            told = f"{variant.name}, {self._done} of {self._count}"
            if self._front:
                told += f"; best so far {self._front[0].variant.effect}, {self._front[0].gain:.3g} nats"
            if left:
                seconds = (time.monotonic() - self._since) * left / self._count
                told += f"; about {seconds:.0f} s left for {self._what}"
            self._tell(told)
        return refit

    def _takes(self, refit: Refit) -> None:
        front = sorted([*self._front, refit], key=by_gain)
        if self._behind(refit, front[0].gain):
            refit.fit.lets_go()
            return
        self._front = front
        if refit.fit.likelihood.is_cut:
            let_go(front[WITH_COLUMNS:])
