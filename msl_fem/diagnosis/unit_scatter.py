"""Scatter between nominally equal magnets of one static map: what each has of its own is taken out before causes that
they share are looked for.

A unit differs from the mean of all by its gap and by the size of its flux paths: F + F_g gap_u + F scale_u, and so the
flux linkage. Both numbers of each unit are those of weighted least squares against the believed table; the units' mean
is left where it is, for a common cause makes it. Manufacture foretells the scatter by its limits, between which all
values are equally likely (GUM, JCGM 100:2008, 4.3.7): sigma = limit / sqrt(3). An unsaturated magnet's force and flux
linkage grow with the stack's depth, and with half of the share by which either leg is wider (docs/tolerances.md).
"""

from dataclasses import dataclass

import numpy as np

from msl_fem.actuator import Actuator, MagnetKind
from msl_fem.computing.arrays import Array
from msl_fem.errors import InputError
from msl_fem.record import StaticMap
from msl_fem.table.magnetic_table import MagneticTable

FEWEST_OF_A_UNIT = 4
SHARES = {"stack_depth": 1.0, "centre_leg_width": 0.5, "outer_leg_width": 0.5}
"""d ln F of a length, in an unsaturated magnet with a small gap."""
_QUANTITIES = {
    "force_N": ("force", "force_gap_slope", 1.0),
    "flux_linkage_Wb": ("flux_linkage", "force_current_slope", -1.0),
    "flux_density_T": ("flux_linkage", "force_current_slope", -1.0),
}
"""Reading to the table's quantity, its slope over the gap and that one's sign: d lambda/dg = -dF/di by reciprocity."""


@dataclass(frozen=True, eq=False)
class UnitScatter:
    """What each unit has of its own, and what manufacture foretells.

    Attributes
    ----------
    units : names
    gap : (n_unit,) m by which a unit's gap is wider than the mean of all
    scale : (n_unit,) by which its force and flux linkage are larger, relative
    foretold_gap, foretold_scale : one sigma by the manufacturing limits; None where the drawing is not known
    """

    units: tuple[str, ...]
    gap: Array
    scale: Array
    foretold_gap: float | None
    foretold_scale: float | None

    @property
    def told(self) -> str:
        """The scatter in words, as one sigma between units."""
        gap, scale = (float(np.std(values, ddof=1)) for values in (self.gap, self.scale))
        text = f"{len(self.units)} units scatter by {1e6 * gap:.3g} um of gap and {100 * scale:.2g} % of size"
        if self.foretold_gap is None or self.foretold_scale is None:
            return f"{text} (one sigma); their drawing foretells nothing"
        return (
            f"{text} (one sigma); manufacturing limits foretell {1e6 * self.foretold_gap:.3g} um and "
            f"{100 * self.foretold_scale:.2g} %"
        )


def without_scatter(
    static: StaticMap, sigmas: dict[str, Array], *, table: MagneticTable, actuator: Actuator
) -> tuple[StaticMap, UnitScatter | None]:
    """The map with each unit's own gap and size taken out; as it is, and None, where there is one unit.

    Parameters
    ----------
    static : rows inside the table
    sigmas : reading to (n_row,) one sigma

    Raises
    ------
    InputError : a unit has too few rows
    """
    units = () if static.unit is None else tuple(dict.fromkeys(static.unit.tolist()))
    if len(units) < 2:
        return static, None
    columns = {name: _columns(static, name, table) for name in static.readings}
    own = np.array([_of_unit(static, sigmas, columns, unit) for unit in units])
    own -= own.mean(axis=0)
    place = np.array([units.index(unit) for unit in static.unit.tolist()])  # type: ignore[union-attr]
    cleaned = {
        name: values - np.einsum("rj,rj->r", columns[name], own[place]) for name, values in static.readings.items()
    }
    return static.with_readings(cleaned), UnitScatter(units, own[:, 0], own[:, 1], *foretold(actuator))


def _columns(static: StaticMap, name: str, table: MagneticTable) -> Array:
    """(n_row, 2) what a reading gains by 1 m of gap and by a size of twice, in the reading's own scale."""
    quantity, slope, sign = _QUANTITIES[name]
    magnet = table.evaluate(static.current, static.gap)
    values, modelled = static.readings[name], magnet[quantity]
    there = np.isfinite(values)
    of_unit = name == "flux_density_T" or static.scale == "free"
    power = float(modelled[there] @ modelled[there])
    factor = float(values[there] @ modelled[there]) / power if of_unit and power > 0 else 1.0
    return factor * np.column_stack([sign * magnet[slope], modelled])


def _of_unit(static: StaticMap, sigmas: dict[str, Array], columns: dict[str, Array], unit: str) -> Array:
    """(gap, scale) of a unit against the table."""
    rows, right = [], []
    for name, values in static.readings.items():
        at = np.flatnonzero((static.unit == unit) & np.isfinite(values))
        weight = 1.0 / sigmas[name][at]
        rows.append(columns[name][at] * weight[:, None])
        right.append((values[at] - columns[name][at, 1]) * weight)
    matrix = np.vstack(rows)
    if len(matrix) < FEWEST_OF_A_UNIT:
        raise InputError(
            f"static.csv: unit {unit} has {len(matrix)} readings inside the table, at least {FEWEST_OF_A_UNIT} are "
            "needed; measure more of it, or leave it out"
        )
    size = np.linalg.norm(matrix, axis=0)
    size[size == 0] = 1.0
    found, *_ = np.linalg.lstsq(matrix / size, np.concatenate(right), rcond=1e-6)
    return np.asarray(found / size, dtype=np.float64)


def foretold(actuator: Actuator) -> tuple[float | None, float | None]:
    """One sigma of gap (m) and size (relative) by the manufacturing limits; None without a drawing."""
    if not isinstance(actuator.magnet, MagnetKind):
        return None, None
    from msl_fem.design.tolerances.manufactured import tolerances_of  # with the field solver, which nothing else needs

    limits = {t.name: t for t in tolerances_of(actuator)}
    shares = [
        share * limits[name].limit / nominal
        for name, share in SHARES.items()
        if name in limits and (nominal := limits[name].nominal)
    ]
    return limits["gap"].limit / np.sqrt(3.0), float(np.sqrt(np.sum(np.square(shares)) / 3.0))
