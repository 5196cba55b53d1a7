"""How force, flux linkage and the currents of the levels depend on each dimension and property: central differences."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.computing.jobs import Arrays
from msl_fem.design.tolerances.deviation import Tolerance
from msl_fem.design.tolerances.rows import MadeJob, Running, answers

STEP = 0.01  # of the nominal value (of the smallest gap for the gap); halved once
QUANTITIES = ("force", "flux_linkage", "section_current")


@dataclass(frozen=True, eq=False)
class Sensitivity:
    """Derivatives with respect to one quantity, central differences with the smaller of two steps.

    Attributes
    ----------
    force, flux_linkage : elasticities d ln Q / d ln p at the point
    current_slope : (n_section, n_level, n_gap) A per unit of the quantity (m, or 1 for pure numbers)
    current : (n_section, n_level, n_gap) elasticities d ln i / d ln p of each section; for the gap, at each gap
    step : the smaller step, in the quantity's unit
    step_error : the largest change of any of these elasticities from twice the step to this one
    """

    tolerance: Tolerance
    force: float
    flux_linkage: float
    current_slope: Array
    current: Array
    step: float
    step_error: float


def sensitivities(
    job: MadeJob, tolerances: Sequence[Tolerance], running: Running
) -> tuple[Arrays, tuple[Sensitivity, ...]]:
    """The nominal magnet's answers, and one sensitivity for each tolerance.

    A stacking factor of 1 cannot rise: its differences are one-sided, of second order.

    Raises
    ------
    ComputationError : a field did not converge
    """
    steps = [_step(job, t) for t in tolerances]
    shares = [_shares(t) for t in tolerances]
    asked: list[dict[str, float]] = [{}]
    for tolerance, step, share in zip(tolerances, steps, shares, strict=True):
        asked += [{tolerance.name: factor * step} for factor in share]
    nominal, *rest = answers(job, asked, running, by_section=True)
    found, start = [], 0
    for tolerance, step, share in zip(tolerances, steps, shares, strict=True):
        rows = rest[start : start + len(share)]
        start += len(share)
        found.append(_from_rows(job, tolerance, step, nominal=nominal, rows=rows))
    return nominal, tuple(found)


def _step(job: MadeJob, tolerance: Tolerance) -> float:
    return STEP * (min(job.questions.gaps) if tolerance.nominal is None else tolerance.nominal)


def _shares(tolerance: Tolerance) -> tuple[float, ...]:
    """Multiples of the step: for the differences with it, then with its half."""
    if _one_sided(tolerance):
        return (-1.0, -2.0, -0.5, -1.0)
    return (1.0, -1.0, 0.5, -0.5)


def _one_sided(tolerance: Tolerance) -> bool:
    return tolerance.name == "stacking_factor" and tolerance.nominal is not None and tolerance.nominal > 1 - STEP


def _from_rows(
    job: MadeJob, tolerance: Tolerance, step: float, *, nominal: Arrays, rows: Sequence[Arrays]
) -> Sensitivity:
    coarse, fine = (
        {name: _slope(tolerance, name, h, nominal=nominal, pair=pair) for name in QUANTITIES}
        for h, pair in ((step, rows[:2]), (step / 2, rows[2:]))
    )
    point = np.array(job.questions.point_gap)
    at = {"force": point, "flux_linkage": point, "section_current": np.array(job.questions.gaps)}
    scale = {
        name: (at[name] if tolerance.nominal is None else np.array(tolerance.nominal)) / nominal[name]
        for name in QUANTITIES
    }
    changes = [np.abs((coarse[name] - fine[name]) * scale[name]) for name in QUANTITIES]
    return Sensitivity(
        tolerance=tolerance,
        force=float(fine["force"] * scale["force"]),
        flux_linkage=float(fine["flux_linkage"] * scale["flux_linkage"]),
        current_slope=np.asarray(fine["section_current"]),
        current=np.asarray(fine["section_current"] * scale["section_current"]),
        step=step / 2,
        step_error=float(max(np.nanmax(change) if np.isfinite(change).any() else 0.0 for change in changes)),
    )


def _slope(tolerance: Tolerance, name: str, h: float, *, nominal: Arrays, pair: Sequence[Arrays]) -> Array:
    first, second = (row[name] for row in pair)
    if _one_sided(tolerance):  # at -h and -2 h
        return np.asarray((3 * nominal[name] - 4 * first + second) / (2 * h))
    return np.asarray((first - second) / (2 * h))
