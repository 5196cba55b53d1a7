"""A table of loops that were measured at one gap: flux linkage over the current alone, without a force."""

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.errors import InputError
from msl_fem.record.loop_law import HysteresisLoopLaw, fit_loops
from msl_fem.record.record import StaticMap
from msl_fem.table.magnetic_table import MagneticTable

CURRENTS = 121
SPREAD = 0.5
"""Share of the gap that the table reaches to either side; nothing in it depends on the gap."""
FEWEST_LOOP_ROWS = 20
FARTHEST = 4.0
"""Times the loops' largest flux linkage: farther the table's currents do not lead."""
REACH = 1.3
"""Largest current of the table over that of the rows: a sensor's error must not lead out of it."""


def is_at_one_gap(static: StaticMap) -> bool:
    """Whether all rows have one gap and a flux linkage: loops of a core, whatever its gap."""
    return static.flux_linkage is not None and float(np.ptp(static.gap)) == 0.0


def law_of_loops(static: StaticMap) -> HysteresisLoopLaw:
    """The law of the rows with the role fit, each sequence a path that began demagnetised.

    Raises
    ------
    InputError : more than one gap, no flux linkage, or too few rows
    """
    if not is_at_one_gap(static) or static.flux_linkage is None:
        raise InputError("the rows have more than one gap, or no flux_linkage_Wb; a table of loops is at one gap")
    fitted = static.rows("fit")
    sequence = np.zeros(fitted.size) if static.sequence is None else static.sequence[fitted]
    current, flux = static.current[fitted], static.flux_linkage[fitted]
    widest = int(np.sum(sequence == sequence[np.argmax(np.abs(current))])) if fitted.size else 0
    if widest < FEWEST_LOOP_ROWS:
        raise InputError(f"the widest loop has {widest} rows, at least {FEWEST_LOOP_ROWS} are needed")
    return fit_loops([(current[sequence == n], flux[sequence == n]) for n in np.unique(sequence)])


def table_of_loops(static: StaticMap, law: HysteresisLoopLaw | None = None) -> MagneticTable:
    """The table whose flux linkage is that of the reversible curve of the loops' law, odd in the current.

    Its coenergy has a closed form. Its force is 0 and it is the same at every gap, so hysteresis, saturation and the
    current's sensor are what it can be diagnosed for. `law` is that of `law_of_loops`, where it is known; raises as
    that does.
    """
    law = law or law_of_loops(static)
    at = np.linspace(0.0, REACH * float(np.abs(static.current).max()), CURRENTS)
    rows = _curve(at, law)
    gap = float(static.gap[0]) or 1e-6
    gaps = gap * np.array([1 - SPREAD, 1.0, 1 + SPREAD])
    none = np.zeros((3, at.size))
    every = {name: np.tile(values, (3, 1)) for name, values in rows.items()}
    every |= {name: none for name in ("force", "force_current_slope", "force_gap_slope")}
    return MagneticTable(gaps, at, every, provenance={"made_of": "loops at one gap"})


def told_of(law: HysteresisLoopLaw) -> dict[str, object]:
    """What is said of a law: how it remembers, and how well it holds loop by loop."""
    return {
        "coercive_current_A": law.coercive_current,
        "reversal_flux_Wb": law.reversal_flux,
        "spacing": law.spacing,
        "fall": law.fall,
        "widening": law.widening,
        "sequence_error": list(law.sequence_error),
        "energy_error": list(law.energy_error),
    }


def _curve(current: Array, law: HysteresisLoopLaw) -> dict[str, Array]:
    """Coenergy, flux linkage and incremental inductance (n_current,) of a law's reversible curve.

    By bisection: the current rises with the flux, and is beyond the largest within a few times the loops' own.
    """
    low, high = np.zeros(current.size), np.full(current.size, FARTHEST * law.largest_flux)
    for _ in range(80):
        middle = 0.5 * (low + high)
        above = law.reversible(middle)[0] > current
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    flux = 0.5 * (low + high)
    taken, slope, energy = law.reversible(flux)
    return {"coenergy": flux * taken - energy, "flux_linkage": flux, "incremental_inductance": 1.0 / slope}
