"""What a diagnosis.json says of how well a plant is known, in the form in which a design reads it."""

from typing import Annotated

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from msl_fem.computing.arrays import Array
from msl_fem.files.schema import LARGEST

ROUNDED = 1e-3
"""By which the entries of a correlation matrix may differ from those of one: files round them."""
Number = Annotated[float, Field(ge=-LARGEST, le=LARGEST, allow_inf_nan=False)]


Ends = Annotated[list[Number | None], Field(min_length=2, max_length=2)]
"""Of an interval; None: open. Of values below zero earlier versions wrote the ends the other way round."""


class _Stated(BaseModel):
    model_config = ConfigDict(strict=True)  # a text is no number


class Fitted(_Stated):
    """A believed parameter as it was fitted."""

    fitted: Number
    ci95: Ends


class Amount(_Stated):
    """A parameter of a cause."""

    ci95: Ends


class NamedCause(_Stated):
    """A cause with its parameters."""

    effect: str
    parameters: dict[str, Amount]


class Correlated(_Stated):
    """Correlations of the errors of named numbers."""

    names: list[str]
    matrix: list[list[Number]]

    def checked(self) -> Array:
        """The matrix (n, n); ValueError where it is no correlation of these names."""
        n = len(self.names)
        if len(self.matrix) != n or any(len(row) != n for row in self.matrix):
            raise ValueError(f"correlation.matrix: is not {n} rows of {n} numbers, as there are {n} names")
        matrix = np.array(self.matrix, dtype=float).reshape(n, n)
        own, both = np.abs(np.diag(matrix) - 1), np.abs(matrix - matrix.T)
        if n and (max(own.max(), both.max()) > ROUNDED or np.linalg.eigvalsh(matrix)[0] < -ROUNDED * n):
            raise ValueError("correlation.matrix: is no correlation; it is symmetric, 1 on its diagonal, nowhere below")
        return matrix


class StatedPosterior(_Stated):
    """The entries of diagnosis.json that a posterior is made of."""

    parameters: dict[str, Fitted]
    causes: list[NamedCause]
    correlation: Correlated | None = None
