"""Where the fits of a diagnosis ended, so that one that was interrupted goes on from there."""

import copy
import threading
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.diagnosis.unknowns import Unknowns


def _unkept(ends: Mapping[str, Sequence[float]]) -> None:
    """Nothing is kept."""


class FitMemory:
    """The unknowns at which fits ended, by what was fitted; `keep` takes all of them whenever one is new."""

    def __init__(
        self,
        known: Mapping[str, Sequence[float]] | None = None,
        keep: Callable[[Mapping[str, Sequence[float]]], None] = _unkept,
    ) -> None:
        self._ends = dict(known or {})
        self._keep, self._lock, self._part = keep, threading.Lock(), ""

    def part(self, name: str) -> "FitMemory":
        """The same memory, for fits whose names mean something else there: of the record otherwise stated."""
        part = copy.copy(self)
        part._part = f"{self._part}{name}: "
        return part

    def end_of(self, what: str, unknowns: Unknowns) -> Array | None:
        """(unknowns.size,) where a fit ended; None where it is not known, or not of these unknowns."""
        end = self._ends.get(self._part + what)
        if end is None or len(end) != unknowns.size or not np.isfinite(end).all():
            return None
        return unknowns.allowed(np.array(end))

    def ended(self, what: str, z: Array) -> None:
        with self._lock:
            self._ends[self._part + what] = [float(value) for value in z]
            self._keep(self._ends)


def fit_name(unknowns: Unknowns, variant: str = "") -> str:
    """What a fit is called: its effects, and the variant that is tried beside them."""
    effects = dict.fromkeys(unknown.effect for unknown in unknowns.effects)
    return f"{', '.join(effects) or 'none'}: {variant}"
