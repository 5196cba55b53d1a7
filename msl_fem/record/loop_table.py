"""A table of loops that were measured at one gap: flux linkage over the current alone, without a force."""

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from msl_fem.computing.arrays import Array
from msl_fem.errors import InputError
from msl_fem.record.record import StaticMap
from msl_fem.table.magnetic_table import MagneticTable

CURRENTS = 121
SCALES = np.geomspace(1 / 30, 3.0, 14)
"""Of the saturating parts of a curve, over the largest current; the least is four steps of the table."""
SPREAD = 0.5
"""Share of the gap that the table reaches to either side; nothing in it depends on the gap."""
FEWEST_LOOP_ROWS = 20
LEAST = 1e-3
"""Share of the flux linkage that does not saturate at least: a table's inductance is above 0."""
REACH = 1.3
"""Largest current of the table over that of the rows: a sensor's error must not lead out of it."""


def is_at_one_gap(static: StaticMap) -> bool:
    """Whether all rows have one gap and a flux linkage: loops of a core, whatever its gap."""
    return static.flux_linkage is not None and float(np.ptp(static.gap)) == 0.0


def table_of_loops(static: StaticMap) -> MagneticTable:
    """The table whose flux linkage is the mean of rising and falling branch of the widest loop, odd in the current.

    The curve is a sum of c_k tanh(i/s_k) with c_k >= 0 at fixed s_k, by non-negative least squares of all rows of the
    loop: smooth and rising, with the coenergy in closed form. Its force is 0 and it is the same at every gap, so
    hysteresis, saturation and the current's sensor are what it can be diagnosed for.

    Raises
    ------
    InputError : more than one gap, no flux linkage, or too few rows
    """
    if not is_at_one_gap(static) or static.flux_linkage is None:
        raise InputError("the rows have more than one gap, or no flux_linkage_Wb; a table of loops is at one gap")
    fitted = static.rows("fit")
    current, flux = np.abs(static.current[fitted]), static.flux_linkage[fitted] * np.sign(static.current[fitted])
    wide = _of_the_widest(static, fitted)
    if wide.sum() < FEWEST_LOOP_ROWS:
        raise InputError(f"the widest loop has {wide.sum()} rows, at least {FEWEST_LOOP_ROWS} are needed")
    at = np.linspace(0.0, REACH * float(np.abs(static.current).max()), CURRENTS)
    scales = SCALES * float(current[wide].max())
    amounts, _ = nnls(np.tanh(current[wide, None] / scales), flux[wide])
    amounts = np.maximum(amounts, LEAST * amounts.sum() * (SCALES[-1] == SCALES))
    rows = _curve(at, amounts, scales)
    gap = float(static.gap[0]) or 1e-6
    gaps = gap * np.array([1 - SPREAD, 1.0, 1 + SPREAD])
    none = np.zeros((3, at.size))
    every = {name: np.tile(values, (3, 1)) for name, values in rows.items()}
    every |= {name: none for name in ("force", "force_current_slope", "force_gap_slope")}
    return MagneticTable(gaps, at, every, provenance={"made_of": "loops at one gap"})


def _curve(current: Array, amounts: Array, scales: Array) -> dict[str, Array]:
    """Coenergy, flux linkage and incremental inductance (n_current,)."""
    x = current[:, None] / scales
    log_cosh = x + np.log1p(np.exp(-2 * x)) - np.log(2.0)
    return {
        "coenergy": log_cosh @ (amounts * scales),
        "flux_linkage": np.tanh(x) @ amounts,
        "incremental_inductance": (1 - np.tanh(x) ** 2) @ (amounts / scales),
    }


def _of_the_widest(static: StaticMap, fitted: NDArray[np.intp]) -> NDArray[np.bool_]:
    """(n_fitted,) rows of the sequence whose current reaches farthest; all rows without sequences."""
    if static.sequence is None:
        return np.ones(fitted.size, dtype=bool)
    sequence = static.sequence[fitted]
    widest = sequence[np.argmax(np.abs(static.current[fitted]))]
    return np.asarray(sequence == widest)
