"""How the errors of a fit's numbers go together: what a record tells of a sum and not of its parts is lost without."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.diagnosis.likelihood import Fit

_DIGITS = 5


@dataclass(frozen=True, eq=False)
class Correlation:
    """The correlations of fitted numbers.

    Attributes
    ----------
    names : believed parameters by their names, those of causes as "effect.parameter"
    matrix : (n, n), symmetric, its diagonal 1
    """

    names: tuple[str, ...]
    matrix: Array

    def to_json(self) -> dict[str, Any]:
        """The entry `correlation` in diagnosis.json."""
        return {"names": list(self.names), "matrix": np.round(self.matrix, _DIGITS).tolist()}


def correlation_of(found: Fit) -> Correlation:
    """The correlations at a fit's end, of the inverse of J'J and the prior's curvature (Gauss and Newton's)."""
    unknowns = found.unknowns
    rows = [*range(len(unknowns.believed)), *range(unknowns.n_nuisance, unknowns.size)]
    covariance = np.linalg.inv(found.precision)[np.ix_(rows, rows)]
    error = np.sqrt(np.diag(covariance))
    names = [name for name, _ in unknowns.believed] + [f"{one.effect}.{one.name}" for one in unknowns.effects]
    return Correlation(tuple(names), covariance / np.outer(error, error))
