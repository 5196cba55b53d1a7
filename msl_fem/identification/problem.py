"""What is minimised: the runs, the orders, and what is believed of the coefficients beforehand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from msl_fem.identification.data import FloatArray
from msl_fem.identification.polynomials import ArmaxOrders


@dataclass(frozen=True, eq=False)
class Belief:
    """A Gaussian prior of the coefficients as further equations, weight @ coefficients = target, each with unit weight.

    `weight` has shape (n_believed, n_parameters) and is scaled so that the residual of a coefficient that is one
    standard deviation off is one standard deviation of the innovations: then it counts in the cost like an error.
    """

    weight: FloatArray
    target: FloatArray

    def residual(self, coefficients: FloatArray) -> FloatArray:
        """weight @ coefficients - target, shape (n_believed,)."""
        return self.weight @ coefficients - self.target


@dataclass(frozen=True, eq=False)
class Problem:
    """Signals of every run (SampledRun.signals), orders with nb and nk for each input, and a belief or none."""

    runs: Sequence[FloatArray]
    orders: ArmaxOrders
    belief: Belief | None = None
