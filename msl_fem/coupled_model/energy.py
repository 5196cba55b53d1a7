"""The energy ledger of a run: what came in is what was lost and what is stored."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from msl_fem.coupled_model.plant import PlantParameters, Surface
from msl_fem.coupled_model.side import side_flux
from msl_fem.coupled_model.state import (
    ENERGY_COPPER,
    ENERGY_DAMPING,
    ENERGY_ELECTRICAL,
    ENERGY_EXTERNAL,
    I1,
    V,
    X,
)

Array = NDArray[np.float64]


@dataclass(frozen=True)
class EnergyAudit:
    """Energies of a run in J, from its start to its end.

    electrical + external = copper + damping + field + mechanical, up to the integrator's error: the integrals on the
    left and the losses run along with the state, the rest is a difference of states. So the imbalance measures the
    error of the fixed step, and that the table creates no energy.

    Attributes
    ----------
    electrical : integral of v i over all sides
    external : work of the disturbance, the constant force and a force drive
    copper, damping : losses
    field : change of lambda i - W' over all magnets
    mechanical : change of m x'^2/2 + k x^2/2
    """

    electrical: float
    external: float
    copper: float
    damping: float
    field: float
    mechanical: float

    @property
    def imbalance(self) -> float:
        """What is missing, over the largest of the terms; 0 for a run in which nothing happens."""
        missing = self.electrical + self.external - self.copper - self.damping - self.field - self.mechanical
        terms = (self.electrical, self.external, self.copper, self.damping, self.field, self.mechanical)
        largest = max(abs(term) for term in terms)
        return missing / largest if largest > 0 else 0.0


def energy_audit(surface: Surface, parameters: PlantParameters, *, start: Array, end: Array) -> EnergyAudit:
    """The ledger between two states (N_STATE,) of one run, `start` before its first command."""
    electrical, copper, damping, external = (
        float(end[n] - start[n]) for n in (ENERGY_ELECTRICAL, ENERGY_COPPER, ENERGY_DAMPING, ENERGY_EXTERNAL)
    )
    field = _field(surface, parameters, end) - _field(surface, parameters, start)
    mechanical = _mechanical(parameters, end) - _mechanical(parameters, start)
    return EnergyAudit(electrical, external, copper, damping, field, mechanical)


def _field(surface: Surface, parameters: PlantParameters, state: Array) -> float:
    energy = 0.0
    for j in range(parameters.sides):
        gap = parameters.nominal_gap - (1 - 2 * j) * state[X]
        energy += float(side_flux(surface, parameters, float(state[I1 + j]), float(gap), np.empty(6))[2])
    return energy


def _mechanical(parameters: PlantParameters, state: Array) -> float:
    return float(0.5 * parameters.mass * state[V] ** 2 + 0.5 * parameters.stiffness * state[X] ** 2)
