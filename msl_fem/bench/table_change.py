"""Tables with a changed coenergy, by a smooth factor or an average over gaps: force and flux stay its derivatives."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import legendre

from msl_fem.bench.plant import Array
from msl_fem.errors import InputError
from msl_fem.table.magnetic_table import NODES, MagneticTable

ERROR_TERMS = tuple((a, b) for a in range(5) for b in range(5) if 0 < a + b <= 4)
"""Degrees over current and gap of the terms of a table's error; the constant is the magnetic scale's."""
FINER = 4


@dataclass(frozen=True, eq=False)
class Factor:
    """A factor of the coenergy on a table's nodes with its partial derivatives, (n_gap, n_current) or numbers."""

    value: Array
    over_current: Array | float = 0.0
    over_gap: Array | float = 0.0
    over_current_twice: Array | float = 0.0
    over_both: Array | float = 0.0
    over_gap_twice: Array | float = 0.0


def multiplied(table: MagneticTable, factor: Factor) -> MagneticTable:
    """The table whose coenergy is the factor times the given one's, by the product rule at every node."""
    w, w_i, w_g = table.nodes["coenergy"], table.nodes["flux_linkage"], -table.nodes["force"]
    w_ii, w_ig = table.nodes["incremental_inductance"], -table.nodes["force_current_slope"]
    w_gg = -table.nodes["force_gap_slope"]
    p, p_i, p_g = factor.value, factor.over_current, factor.over_gap
    nodes = {
        "coenergy": w * p,
        "flux_linkage": w_i * p + w * p_i,
        "force": -(w_g * p + w * p_g),
        "incremental_inductance": w_ii * p + 2 * w_i * p_i + w * factor.over_current_twice,
        "force_current_slope": -(w_ig * p + w_i * p_g + w_g * p_i + w * factor.over_both),
        "force_gap_slope": -(w_gg * p + 2 * w_g * p_g + w * factor.over_gap_twice),
    }
    return MagneticTable(table.gap, table.current, nodes)


def averaged(table: MagneticTable, shifts: Sequence[float], weights: Sequence[float]) -> MagneticTable:
    """The mean over magnets (or strips of one) at the same current whose gaps differ by `shifts` (m) from the table's.

    Its gaps are those between which every shifted gap lies in the table, `FINER` times as many: between its nodes the
    mean of the table's pieces is no single piece.

    Raises
    ------
    InputError : the shifts leave less than half of the table's gaps
    """
    low, high = table.gap[0] - min(shifts), table.gap[-1] - max(shifts)
    if not low < table.gap[0] + 0.5 * (table.gap[-1] - table.gap[0]) < high:
        raise InputError(f"gaps that differ by {max(shifts) - min(shifts):.3g} m do not fit the table's range")
    gap = np.geomspace(low, high, FINER * table.gap.size)
    nodes = dict.fromkeys(NODES, np.zeros((gap.size, table.current.size)))
    for shift, weight in zip(shifts, weights, strict=True):
        at = np.clip(gap[:, None] + shift, table.gap[0], table.gap[-1])  # a rounding beyond the edge
        part = table.evaluate(table.current[None, :], at)
        nodes = {name: nodes[name] + weight * part[name] for name in NODES}
    return MagneticTable(gap, table.current, nodes)


def error_factor(table: MagneticTable, coefficients: Array) -> Factor:
    """1 + sum of coefficients (n_term,) times the terms P_a(u) P_b(z) on the table's nodes.

    u runs from -1 to 1 as i^2/(i^2 + i_s^2), i_s a sixth of the largest current, and z as the logarithm of the gap:
    smooth, even in the current, and as fine at small currents and gaps as the field's own changes are.
    """
    i, g = table.current, table.gap
    s2 = (i[-1] / 6) ** 2
    top = i[-1] ** 2 / (i[-1] ** 2 + s2)
    u = 2 * i**2 / (i**2 + s2) / top - 1
    u_i = 4 * i * s2 / (i**2 + s2) ** 2 / top
    u_ii = 4 * s2 * (s2 - 3 * i**2) / (i**2 + s2) ** 3 / top
    span = np.log(g[-1] / g[0])
    z, z_g, z_gg = 2 * np.log(g / g[0]) / span - 1, 2 / (span * g), -2 / (span * g**2)
    parts = np.zeros((6, g.size, i.size))
    for c, (a, b) in zip(coefficients, ERROR_TERMS, strict=True):
        p, p_u, p_uu = _legendre(a, u)
        q, q_z, q_zz = _legendre(b, z)
        along = (p, p_u * u_i, p_uu * u_i**2 + p_u * u_ii)
        across = (q, q_z * z_g, q_zz * z_g**2 + q_z * z_gg)
        for n, (m, k) in enumerate(((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))):
            parts[n] += c * np.outer(across[k], along[m])
    return Factor(1 + parts[0], *parts[1:])


def _legendre(degree: int, x: Array) -> tuple[Array, Array, Array]:
    """P(x), P'(x), P''(x) of a degree."""
    series = np.zeros(degree + 1)
    series[degree] = 1.0
    return tuple(legendre.legval(x, legendre.legder(series, n)) for n in range(3))  # type: ignore[return-value]


def term_errors(table: MagneticTable) -> tuple[Array, Array]:
    """(force, flux): mean squares over the nodes of the relative error that each term (n_term,) makes by itself."""
    inside = np.s_[:, 1:]
    force: list[float] = []
    flux: list[float] = []
    for n in range(len(ERROR_TERMS)):
        unit = np.zeros(len(ERROR_TERMS))
        unit[n] = 1.0
        changed = multiplied(table, error_factor(table, unit)).nodes
        for name, found in (("force", force), ("flux_linkage", flux)):
            relative = changed[name][inside] / table.nodes[name][inside] - 1
            found.append(float(np.mean(relative**2)))
    return np.array(force), np.array(flux)
