"""Computed tables against a static map: error over current and gap, in force and flux linkage."""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from msl_fem.record import Role, StaticMap
from msl_fem.table.magnetic_table import MagneticTable

Array = NDArray[np.float64]
Quantity = Literal["force_N", "flux_linkage_Wb"]
FEWEST = 3


@dataclass(frozen=True, eq=False)
class StaticError:
    """A table against the rows of one role.

    Attributes
    ----------
    gap, current, measured, computed : (n_row,) rows inside the table
    outside : rows that lie outside it, and are not judged
    scale, scale_error : measured over computed by least squares, and its standard error
    """

    model: str
    role: Role
    quantity: Quantity
    gap: Array
    current: Array
    measured: Array
    computed: Array
    outside: int
    scale: float
    scale_error: float

    @property
    def error(self) -> Array:
        """(n_row,) measured less computed."""
        return self.measured - self.computed

    @property
    def of_full_scale(self) -> float:
        """RMS error over the largest measured value."""
        return float(np.sqrt(np.mean(self.error**2)) / np.abs(self.measured).max())

    def fields(self) -> dict[str, Any]:
        """The JSON fields of an entry of `static`."""
        return {
            "name": self.model, "role": self.role, "quantity": self.quantity, "rows": self.measured.size,
            "rows_outside": self.outside, "rms_error": float(np.sqrt(np.mean(self.error**2))),
            "mean_error": float(np.mean(self.error)), "error_of_full_scale": self.of_full_scale,
            "scale": self.scale, "scale_standard_error": self.scale_error,
            "gap_m": self.gap, "current_A": self.current, "error": self.error,
        }  # fmt: skip


def static_errors(name: str, table: MagneticTable, static: StaticMap) -> list[StaticError]:
    """The table against all rows of the map, role by role, quantity by quantity."""
    found = []
    inside = (
        (static.gap >= table.gap[0]) & (static.gap <= table.gap[-1]) & (np.abs(static.current) <= table.current[-1])
    )
    roles: tuple[Role, ...] = ("fit", "held-out")
    quantities: tuple[tuple[Quantity, Array | None], ...] = (
        ("force_N", static.force),
        ("flux_linkage_Wb", static.flux_linkage),
    )
    for role in roles:
        rows = static.rows(role)
        kept = rows[inside[rows]]
        if kept.size < FEWEST:
            continue
        values = table.evaluate(static.current[kept], static.gap[kept])
        for quantity, column in quantities:
            if column is None:
                continue
            computed = np.asarray(values[quantity.rsplit("_", 1)[0]])
            scale, error = _scale(column[kept], computed)
            found.append(
                StaticError(
                    name,
                    role,
                    quantity,
                    static.gap[kept],
                    static.current[kept],
                    column[kept],
                    computed,
                    int(rows.size - kept.size),
                    scale,
                    error,
                )
            )
    return found


def _scale(measured: Array, computed: Array) -> tuple[float, float]:
    power = float(computed @ computed)
    scale = float(measured @ computed) / power
    spread = float(np.sum((measured - scale * computed) ** 2)) / (measured.size - 1)
    return scale, float(np.sqrt(spread / power))
