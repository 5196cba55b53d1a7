"""The best design by the closed equations: thousands of them in a second, where fields would take minutes."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import differential_evolution, minimize

from msl_fem.design.sizing.design import Design
from msl_fem.design.sizing.judge import Judge, Verdict
from msl_fem.design.sizing.parameters import Space, Span, design_from, parameters_of

Array = NDArray[np.float64]
Score = Callable[[Verdict], float]
"""Of a design with a performance; the least is wanted."""
REFUSED = 1e6
"""Of a score that is no answer: worse than all that are."""
_POPULATION, _GENERATIONS = 6, 40
_STEP, _EVALUATIONS = 0.15, 300  # of the simplex: of each span


@dataclass(frozen=True)
class Found:
    """The design with the least score."""

    design: Design
    verdict: Verdict
    score: float


@dataclass(frozen=True)
class ClosedSearch:
    """Looks for the design with the least score; what cannot be built scores by what is broken, above all others.

    Attributes
    ----------
    change : made to each design before it is judged
    """

    judge: Judge
    space: Space
    score: Score
    change: Callable[[Design], Design] = lambda design: design

    def everywhere(self, *, seed: int = 1) -> Found:
        """In the whole space (differential evolution, Storn and Price 1997)."""
        found = differential_evolution(
            self._cost, [(0.0, 1.0)] * len(self.space.spans), popsize=_POPULATION, maxiter=_GENERATIONS, tol=1e-4,
            rng=np.random.default_rng(seed), polish=False,
        )  # fmt: skip
        return self._found(found.x)

    def near(self, start: Design) -> Found:
        """Downhill from a design (Nelder and Mead 1965, coefficients of Gao and Han 2012)."""
        values = parameters_of(start, self.space, self.judge)
        origin = np.array([_place(values[name], span) for name, span in self.space.spans.items()])
        inward = np.diag(np.where(origin < 0.5, _STEP, -_STEP))
        found = minimize(
            self._cost, origin, method="Nelder-Mead", bounds=[(0.0, 1.0)] * origin.size,
            options={
                "maxfev": _EVALUATIONS, "initial_simplex": np.vstack([origin, origin + inward]), "adaptive": True,
                "xatol": 1e-3, "fatol": 1e-4,
            },
        )  # fmt: skip
        return self._found(found.x)

    def _cost(self, places: Array) -> float:
        verdict = self.judge.by_closed_form(self._design(places))
        return REFUSED * (1 + verdict.violation) if verdict.performance is None else self.score(verdict)

    def _design(self, places: Array) -> Design:
        spans = self.space.spans.items()
        parameters = {name: _value(float(place), span) for place, (name, span) in zip(places, spans, strict=True)}
        return self.change(design_from(parameters, self.space, self.judge))

    def _found(self, places: Array) -> Found:
        design = self._design(places)
        return Found(design, self.judge.by_closed_form(design), self._cost(places))


def _value(place: float, span: Span) -> float:
    """The value at a place between 0 and 1."""
    if span.log:
        return span.low * (span.high / span.low) ** place
    return span.low + (span.high - span.low) * place


def _place(value: float, span: Span) -> float:
    if span.log:
        return float(np.log(value / span.low) / np.log(span.high / span.low))
    return (value - span.low) / (span.high - span.low)
