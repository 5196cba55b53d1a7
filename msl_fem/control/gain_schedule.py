"""Gains that follow the stiffness of the magnets that hold the mover, so over position and load alike.

A held pull F at a gap g takes 2 |F|/g from the suspension while the iron is not saturated (F = C i^2/g^2). A force that
pulls further out, or a load that is held, is the same to the loop: near it the plant has this stiffness less. The step
computes it from its own force and gap, low-passed, so that it does not become a feedback of its own (slow scheduling:
Rugh and Shamma, Automatica 36, 2000).
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.control.linear_loop import LinearLaw

BANDWIDTH = 20.0
"""Hz, of the low-passed stiffness."""


@dataclass(frozen=True, eq=False)
class GainSchedule:
    """Factors of a law's gains over the magnets' stiffness.

    Attributes
    ----------
    stiffness : (n_node,) N/m, increasing, at least two
    factors : (n_node, n_state + 3) of the state feedback, the integral and the filter's two gains; straight between
        nodes, held beyond
    """

    stiffness: Array
    factors: Array

    def law_at(self, law: LinearLaw, stiffness: float) -> LinearLaw:
        """The law with the gains of a stiffness; what its filter states of errors is that of the given law."""
        factor = np.array([np.interp(stiffness, self.stiffness, column) for column in self.factors.T])
        if np.all(factor == 1.0):
            return law
        gains = replace(law.gains, state=law.gains.state * factor[:-3], integral=float(law.gains.integral * factor[-3]))
        return replace(law, gains=gains, estimator=replace(law.estimator, gain=law.estimator.gain * factor[-2:]))

    def to_json(self) -> dict[str, Any]:
        """The JSON object of the nodes."""
        return {"stiffness_N_per_m": self.stiffness.tolist(), "factors": self.factors.tolist()}

    @property
    def moves(self) -> bool:
        """Whether any gain changes."""
        return bool(np.any(self.factors != 1.0))


def fixed_gains(law: LinearLaw) -> GainSchedule:
    """The schedule that changes nothing."""
    return GainSchedule(np.array([0.0, 1.0]), np.ones((2, law.gains.state.size + 3)))
