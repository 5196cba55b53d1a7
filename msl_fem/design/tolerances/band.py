"""The band of a map under random deviations: Monte Carlo on the linearised map or on field solutions."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.computing.jobs import Arrays
from msl_fem.design.tolerances.deviation import Tolerance
from msl_fem.design.tolerances.rows import MadeJob, Running, answers
from msl_fem.design.tolerances.sensitivity import Sensitivity

PERCENTILES = (5.0, 95.0)
MOST_MISSING = 0.05  # of the samples in which a level is not reached: the upper percentile is then unknown


@dataclass(frozen=True, eq=False)
class Band:
    """Percentiles over the samples.

    Attributes
    ----------
    low, high : (n_level, n_gap) A, 5 and 95 % of the levels' currents; nan where too many samples miss the level
    force, flux_linkage : (low, high) at the point
    method : "direct" (field solutions) or "linearised"
    samples, seed : of the Monte Carlo
    checked : made magnets solved directly to check the linearised ones, 0 where all are
    linearisation_error : the largest difference of a current, linearised against solved, over the nominal one
    band_error : the largest of the same over half the band's width there
    """

    low: Array
    high: Array
    force: tuple[float, float]
    flux_linkage: tuple[float, float]
    method: str
    samples: int
    seed: int
    checked: int = 0
    linearisation_error: float = 0.0
    band_error: float = 0.0


def draw(tolerances: Sequence[Tolerance], samples: int, seed: int) -> list[dict[str, float]]:
    """Independent deviations, uniform between their limits.

    Where only limits are known, all values between them are equally likely (GUM, JCGM 100:2008, 4.3.7).
    """
    limits = np.array([t.limit for t in tolerances])
    uniform = np.random.default_rng(seed).uniform(-1.0, 1.0, (samples, limits.size)) * limits
    return [{t.name: float(d) for t, d in zip(tolerances, row, strict=True)} for row in uniform]


def direct_band(job: MadeJob, tolerances: Sequence[Tolerance], running: Running, *, samples: int, seed: int) -> Band:
    """The band of field solutions of every sample; raises ComputationError."""
    rows = answers(job, draw(tolerances, samples, seed), running)
    stacked = {name: np.stack([row[name] for row in rows]) for name in ("current", "force", "flux_linkage")}
    return _band(stacked, "direct", samples=samples, seed=seed)


def linearised_answers(
    nominal: Arrays, found: Sequence[Sensitivity], deviations: Sequence[dict[str, float]], *, gap: float
) -> Arrays:
    """Answers of made magnets, stacked, each section's current linear in the deviations; `gap` is the point's."""
    off = np.array([[d[s.tolerance.name] for s in found] for d in deviations])  # (sample, tolerance)
    slopes = np.stack([s.current_slope for s in found])
    at = {
        name: np.array([getattr(s, name) * nominal[name] / (s.tolerance.nominal or gap) for s in found])
        for name in ("force", "flux_linkage")
    }
    linear: Arrays = {name: nominal[name] + off @ slope for name, slope in at.items()}
    of_section = nominal["section_current"] + np.tensordot(off, slopes, axes=1)
    return linear | {"current": governing(of_section, axis=1)}


def governing(section_current: Array, *, axis: int) -> Array:
    """The smallest current of any section; nan where no section reaches the level."""
    least = np.where(np.isnan(section_current), np.inf, section_current).min(axis=axis)
    return np.where(np.isfinite(least), least, np.nan)


def linearised_band(
    nominal: Arrays,
    found: Sequence[Sensitivity],
    *,
    gap: float,
    samples: int,
    seed: int,
) -> Band:
    """The band of the linearised map."""
    deviations = draw([s.tolerance for s in found], samples, seed)
    return _band(linearised_answers(nominal, found, deviations, gap=gap), "linearised", samples=samples, seed=seed)


def _band(stacked: Arrays, method: str, *, samples: int, seed: int) -> Band:
    current = stacked["current"]
    missing = np.isnan(current).mean(axis=0)
    filled = np.where(np.isnan(current), np.inf, current)
    low, high = np.percentile(filled, PERCENTILES, axis=0, method="inverted_cdf")
    high = np.where(missing > MOST_MISSING, np.nan, high)
    low = np.where(np.isfinite(low), low, np.nan)
    force, flux = (tuple(map(float, np.percentile(stacked[name], PERCENTILES))) for name in ("force", "flux_linkage"))
    return Band(low, high, (force[0], force[1]), (flux[0], flux[1]), method, samples, seed)
