"""The identified model with what can be asked of it: free run, predictions, tests, other tools' objects."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from msl_fem.identification.data import FloatArray, SampledRun
from msl_fem.identification.free_run import FreeRun, simulate
from msl_fem.identification.model import ArmaxEstimate
from msl_fem.identification.physical import Believed, PhysicalParameter, physical_parameters
from msl_fem.identification.prediction import predict, residuals
from msl_fem.identification.python_control import transfer_matrix
from msl_fem.identification.residual_tests import CorrelationTest, residual_tests

if TYPE_CHECKING:
    from control import TransferFunction


@dataclass(frozen=True, eq=False)
class ArmaxModel(ArmaxEstimate):
    """A(q) y = sum_k B_k(q) u_k + offset + C(q) e; the fields are those of `ArmaxEstimate`."""

    def simulate(self, run: SampledRun, *, initial: Literal["estimated", "measured"] = "estimated") -> FreeRun:
        """Free run over a run's inputs; see `free_run.simulate`."""
        return simulate(self, run, initial=initial)

    def predict(self, run: SampledRun, horizon: int = 1) -> FloatArray:
        """Predictions `horizon` samples ahead; see `prediction.predict`."""
        return predict(self, run, horizon)

    def residuals(self, run: SampledRun) -> FloatArray:
        """One-step prediction errors over a run; see `prediction.residuals`."""
        return residuals(self, run)

    def residual_tests(self, run: SampledRun, **settings: Any) -> tuple[CorrelationTest, ...]:
        """Whiteness and correlation with each input; see `residual_tests.residual_tests`."""
        return residual_tests(self, run, **settings)

    def physical_parameters(
        self, *, mass: Believed | None = None, gains: Mapping[str, float] | None = None
    ) -> dict[str, PhysicalParameter]:
        """Mass, damping, stiffness and force constants with intervals; see `physical.physical_parameters`."""
        return physical_parameters(self, mass=mass, gains=gains)

    def to_control(self, *, noise: bool = False) -> TransferFunction:
        """python-control's transfer functions from every input; see `python_control.transfer_matrix`."""
        return transfer_matrix(self, noise=noise)
