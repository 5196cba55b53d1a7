"""Where residuals live: over current, gap, velocity, time and amplitude, and by band of frequency."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_filter

from msl_fem.comparison.accuracy import Bands, Spread, by_band, over_variable
from msl_fem.comparison.judged import LEAD, ModelAccuracy
from msl_fem.record import Record, Run

Array = NDArray[np.float64]
SLOPE_SAMPLES = 15  # of the parabola that gives the velocity


@dataclass(frozen=True, eq=False)
class LocatedResidual:
    """Where one model's residual on one channel of one run lives; `kind` says of which prediction."""

    judged: ModelAccuracy
    kind: str
    over: Mapping[str, Spread]
    bands: Bands

    def fields(self) -> dict[str, Any]:
        j = self.judged
        over = {
            name: {"edges": s.edges, "rms": s.rms, "mean": s.mean, "count": s.count} for name, s in self.over.items()
        }
        bands = {
            "edges_Hz": self.bands.edges, "measured": self.bands.measured, "residual": self.bands.residual,
            "nrmse": self.bands.nrmse,
        }  # fmt: skip
        return {
            "name": j.model, "run": j.run, "role": j.role, "channel": j.channel, "prediction": self.kind,
            "over": over, "by_band": bands,
        }  # fmt: skip


def residual_variables(record: Record, run: Run) -> dict[str, Array]:
    """What a residual may depend on, by name with unit, (n_sample,) each."""
    x = run["position_m"]
    rate = 1.0 / run.sampling_period
    found = {}
    for j in (1, 2):
        for column in (f"current_{j}_A", f"command_{j}_A"):
            if column in run:
                found[f"current_{j}_A"] = run[column]
                break
    motion = record.actuator.motion
    if motion is not None and motion.nominal_gap is not None and record.actuator.magnet is not None:
        found["gap_1_m"] = motion.nominal_gap - x
    else:
        found["position_m"] = x
    found["velocity_m_per_s"] = savgol_filter(x, SLOPE_SAMPLES, 2, deriv=1) * rate
    found["amplitude_m"] = np.abs(x - x.mean())
    found["time_s"] = run.time
    return found


def locate_residual(record: Record, run: Run, judged: ModelAccuracy) -> LocatedResidual | None:
    """Of the hardest prediction that the model bears; None where it bears none."""
    kind = judged.best_known
    if kind is None:
        return None
    error = judged.residual(kind)
    good = np.isfinite(error)  # of a voltage, the last sample is not
    over = {name: over_variable(error[good], v[LEAD:][good]) for name, v in residual_variables(record, run).items()}
    measured, model = judged.measured[LEAD:][good], judged.modelled[kind][LEAD:][good]
    return LocatedResidual(judged, kind, over, by_band(measured, model, rate=1.0 / run.sampling_period))
