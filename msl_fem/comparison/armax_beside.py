"""What of a cause's change in the position an identified ARMAX makes up for."""

from collections.abc import Sequence

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.errors import ComputationError, InputError
from msl_fem.identification import ArmaxModel, identify
from msl_fem.identification.record_model import sampled_run
from msl_fem.prediction.run_data import POSITION_COLUMN
from msl_fem.record import Record

FINEST = 0.1
"""Of the position's noise: a smaller change is none that a model of the position could follow."""


class ArmaxBeside:
    """ARMAX identified on records with and without a cause, judged in free run on the held-out runs."""

    def __init__(self, noisy: Record) -> None:
        self.noisy = noisy
        self.missed = self._missed(noisy)

    def absorbed(self, other: Record) -> float | None:
        """The share of the position's change that it follows; None where the position hardly changes, or there is no
        such model.

        Models are identified on both records, whose noise is the same; what ARMAX misses in both alike is not the
        cause's.
        """
        noise = self.noisy.noise.position or 0.0
        change = _rms([self._positions(other) - self._positions(self.noisy)])
        if self.missed is None or change < FINEST * noise or not change:
            return None
        missed = self._missed(other)
        if missed is None:
            return 0.0
        return float(max(0.0, 1 - _rms([missed - self.missed]) / change))

    def _missed(self, record: Record) -> Array | None:
        """(n_sample,) of the held-out positions, measured less followed in free run; None where it cannot be had."""
        try:
            model: ArmaxModel = identify(record).model
            runs = [sampled_run(record, run) for run in record.runs_of("held-out")]
            left = [run.output - model.simulate(run).output for run in runs]
        except (InputError, ComputationError, np.linalg.LinAlgError):
            return None
        missed = np.concatenate(left)
        return missed if np.isfinite(missed).all() else None

    def _positions(self, record: Record) -> Array:
        return np.concatenate([run[POSITION_COLUMN] for run in record.runs_of("held-out")])


def _rms(parts: Sequence[Array]) -> float:
    return float(np.sqrt(np.mean(np.concatenate(parts) ** 2)))
