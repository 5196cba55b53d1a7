"""What a larger model must gain: minus twice the log likelihood plus a penalty for its coefficients."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from msl_fem.errors import InputError
from msl_fem.identification.evaluation import Evaluation

CriterionName = Literal["bic", "aicc"]


@dataclass(frozen=True)
class Criterion:
    """BIC (G. Schwarz, Ann. Statist. 6, 1978) or AICc (C. M. Hurvich and C.-L. Tsai, Biometrika 76, 1989)."""

    name: CriterionName = "bic"

    def __post_init__(self) -> None:
        if self.name not in ("bic", "aicc"):
            raise InputError(f"criterion {self.name!r}: give bic or aicc")

    def penalty(self, n_coefficients: int, n_equations: int) -> float:
        """What that many coefficients cost."""
        if self.name == "bic":
            return n_coefficients * float(np.log(n_equations))
        return 2.0 * n_coefficients * n_equations / max(n_equations - n_coefficients - 1, 1)

    def value(self, evaluation: Evaluation) -> float:
        """Minus twice the exact log likelihood of the one-step errors, less its constant, plus the penalty."""
        n = evaluation.n_equations
        deviance = n * float(np.log(evaluation.likelihood_cost / n))
        return deviance + self.penalty(evaluation.n_parameters, n)
