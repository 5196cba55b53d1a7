"""The identified model: plain polynomials with their uncertainty and the way they were found."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from msl_fem.identification.data import FloatArray
from msl_fem.identification.gauss_newton import Convergence
from msl_fem.identification.polynomials import ArmaxOrders, Polynomials
from msl_fem.identification.rational import RationalInputs


@dataclass(frozen=True, eq=False)
class ArmaxEstimate:
    """A(q) y = sum_k B_k(q) u_k + offset + C(q) e with covariance of its coefficients; `ArmaxModel` adds the methods.

    `covariance` has shape (n_names, n_names) in the order of `parameter_names`; the last is "delta" when a gap
    offset was estimated with the rational inputs. `noise_variance` is that of e, the one-step error, in the
    output's unit squared. `condition_number` is that of the Jacobian with scaled columns, `input_condition_number`
    that of the inputs' delayed samples. `input_slopes` holds the mean over the data of each input's derivative by the
    position, for rational inputs; empty otherwise. `notes` say in words what a reader should know before using it.
    """

    orders: ArmaxOrders
    polynomials: Polynomials
    input_names: tuple[str, ...]
    sampling_period: float
    parameter_names: tuple[str, ...]
    covariance: FloatArray
    noise_variance: float
    condition_number: float
    input_condition_number: float
    n_samples: int
    convergence: Convergence
    rational: RationalInputs | None = None
    input_slopes: tuple[float, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def parameters(self) -> FloatArray:
        """The coefficients in the order of `parameter_names`."""
        vector = self.polynomials.vector(self.orders)
        if len(self.parameter_names) == vector.size:
            return vector
        assert self.rational is not None
        return np.append(vector, self.rational.delta)

    @property
    def standard_errors(self) -> FloatArray:
        """One standard deviation of each coefficient, in the order of `parameter_names`."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def delta_standard_error(self) -> float | None:
        """Standard error of the gap offset in m; None when it was not estimated."""
        return float(self.standard_errors[-1]) if self.parameter_names[-1:] == ("delta",) else None
