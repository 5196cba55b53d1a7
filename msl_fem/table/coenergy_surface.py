"""One smooth coenergy surface W'(i, g) through field solutions; flux and force are its derivatives.

The surface is the tensor product of quintic splines of class C3 (double knots at the nodes) that take, at every node,
the field's W', lambda = dW'/di, F = -dW'/dg and d2W'/(di dg). Because flux and force come from one function,
dF/di = -dlambda/dg holds to rounding and no closed path over the table yields energy.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.computing.compiled import compiled, for_few
from msl_fem.computing.splines import b_splines, spline_derivative

N = 6  # coefficients a direction of a cell: quintic
STATES = 6
"""Rows of an evaluation: W', lambda, F, dlambda/di, dF/di, dF/dg."""
FEW = 100  # points that Python evaluates sooner than it loads the compiler


@dataclass(frozen=True, eq=False)
class CoenergySurface:
    """Piecewise biquintic polynomials of the local coordinates (g - gap[m], |i| - current[n]).

    Attributes
    ----------
    gap : (n_gap,) nodes in m
    current : (n_current,) nodes in A, starting at 0; the surface is even in the current
    coefficients : (n_gap - 1, n_current - 1, 6, 6), powers of the gap first
    """

    gap: Array
    current: Array
    coefficients: Array

    def __call__(self, current: Array, gap: Array) -> Array:
        """(6, ...) values of W', lambda, F, dlambda/di, dF/di, dF/dg; nan outside the rectangle."""
        i, g = np.broadcast_arrays(np.asarray(current, dtype=float), np.asarray(gap, dtype=float))
        out = np.empty((STATES, i.size))
        # flattened is copied: of what `broadcast_arrays` gives, numba asks a flag whose reading numpy warns of
        evaluated = for_few(evaluate_many) if i.size <= FEW else evaluate_many
        evaluated(self.gap, self.current, self.coefficients, i.flatten(), g.flatten(), out)
        return out.reshape(STATES, *i.shape)


def fit_coenergy_surface(gap: Array, current: Array, nodes: dict[str, Array]) -> CoenergySurface:
    """The surface through the nodes' values.

    Parameters
    ----------
    gap, current : (n_gap,), (n_current,) increasing; current starts at 0
    nodes : arrays (n_gap, n_current) of `coenergy`, `flux_linkage`, `force`, `force_current_slope` (all four taken
        at every node), `incremental_inductance` and `force_gap_slope` (taken at the edges alone)
    """
    w, w_i = nodes["coenergy"], nodes["flux_linkage"]
    w_g, w_ig = -nodes["force"], -nodes["force_current_slope"]
    w_ii = nodes["incremental_inductance"][:, -1]
    w_gg = -nodes["force_gap_slope"][[0, -1], :]
    along_gap = hermite_spline(gap, symmetric_start=False)
    along_current = hermite_spline(current, symmetric_start=True)
    n_g, n_i = gap.size, current.size
    values_g, slopes_g = slice(0, n_g), slice(n_g, 2 * n_g)
    values_i, slopes_i = slice(0, n_i), slice(n_i, 2 * n_i)
    data = np.zeros((2 * n_g + 2, 2 * n_i + 2))  # rows: value, slope along g, two ends; columns alike along i
    data[values_g, values_i] = w
    data[values_g, slopes_i] = w_i
    data[slopes_g, values_i] = w_g
    data[slopes_g, slopes_i] = w_ig
    # At i = 0 the third derivative vanishes (W' is even); at the last current, d2W'/di2 and its slope along g.
    degree = min(5, n_g - 1)
    data[values_g, -1] = w_ii
    data[slopes_g, -1] = spline_derivative(gap, w_ii, gap, degree=degree)
    # At both ends of the gap, d2W'/dg2 along i: even in i, so spline it over -i ... i.
    both_signs = np.r_[-current[:0:-1], current]
    for row, edge, end in ((-2, w_gg[0], gap[:1]), (-1, w_gg[1], gap[-1:])):
        mirrored = np.r_[edge[:0:-1], edge]
        data[row, values_i] = edge
        data[row, slopes_i] = spline_derivative(both_signs, mirrored, current, degree=min(5, n_i - 1))
        data[row, -1] = spline_derivative(gap, w_ii, end, 2, degree=degree)[0] if n_g > 2 else 0.0
    taylor = np.einsum("mpr,rs,nqs->mnpq", along_gap.taylor, data, along_current.taylor, optimize=True)
    return CoenergySurface(gap, current, np.ascontiguousarray(taylor))


def hermite_spline(nodes: Array, *, symmetric_start: bool) -> "HermiteSpline":
    """The spline of these nodes; the last ones are kept, for tables come in families of the same nodes."""
    return _hermite_spline(nodes.astype(float).tobytes(), symmetric_start)


@lru_cache(maxsize=32)
def _hermite_spline(nodes: bytes, symmetric_start: bool) -> "HermiteSpline":
    return HermiteSpline(np.frombuffer(nodes), symmetric_start=symmetric_start)


class HermiteSpline:
    """The map from (values, slopes, one condition at each end) to Taylor coefficients in every cell.

    `taylor` has shape (n - 1, 6, 2 n + 2). The spline is quintic, C3, and takes value and slope at each node; the end
    conditions are the second derivative, or at a symmetric start the third (zero for an even function).
    """

    def __init__(self, nodes: Array, *, symmetric_start: bool) -> None:
        n = nodes.size
        scale = nodes[-1] - nodes[0]
        x = (nodes - nodes[0]) / scale
        knots = np.r_[np.full(6, x[0]), np.repeat(x[1:-1], 2), np.full(6, x[-1])]
        start = 3 if symmetric_start else 2
        conditions = ((x, 0), (x, 1), (x[:1], start), (x[-1:], 2))
        collocation = np.concatenate([b_splines(knots, 5, at, order) for at, order in conditions])
        units = np.r_[np.ones(n), np.full(n, scale), scale**start, scale**2]
        to_basis = np.linalg.solve(collocation, np.diag(units))
        factorial = [1.0, 1.0, 2.0, 6.0, 24.0, 120.0]
        terms = [b_splines(knots, 5, x[:-1], k) @ to_basis / (factorial[k] * scale**k) for k in range(N)]
        self.taylor = np.stack(terms, axis=1)
        self.taylor.flags.writeable = False


@compiled
def evaluate(gap, current, coefficients, i, g, out):  # type: ignore[no-untyped-def]
    """W', lambda, F, dlambda/di, dF/di, dF/dg at (i, g) into out (6,); False, and nan, outside the rectangle."""
    size = abs(i)
    if not (gap[0] <= g <= gap[-1] and size <= current[-1]):
        for row in range(6):
            out[row] = np.nan
        return False
    m, n = cell_of(gap, g), cell_of(current, size)
    y, x = g - gap[m], size - current[n]
    # Horner along i for value, first and second derivative of each power of g, then along g
    w = w_g = w_gg = w_i = w_ig = w_ii = 0.0
    for p in range(N - 1, -1, -1):
        a = b = c = 0.0
        for q in range(N - 1, -1, -1):
            c = c * x + b
            b = b * x + a
            a = a * x + coefficients[m, n, p, q]
        w_gg = w_gg * y + w_g
        w_g = w_g * y + w
        w = w * y + a
        w_ig = w_ig * y + w_i
        w_i = w_i * y + b
        w_ii = w_ii * y + 2.0 * c
    sign = -1.0 if i < 0 else 1.0
    out[0] = w
    out[1] = sign * w_i
    out[2] = -w_g
    out[3] = w_ii
    out[4] = -sign * w_ig
    out[5] = -2.0 * w_gg
    return True


@compiled
def evaluate_slopes(gap, current, coefficients, i, g):  # type: ignore[no-untyped-def]
    """(inside, F, dlambda/di, dF/di) at (i, g): what the equations of motion need, cheaper than `evaluate`."""
    size = abs(i)
    if not (gap[0] <= g <= gap[-1] and size <= current[-1]):
        return False, np.nan, np.nan, np.nan
    m, n = cell_of(gap, g), cell_of(current, size)
    y, x = g - gap[m], size - current[n]
    w = w_g = w_i = w_ig = w_ii = 0.0
    for p in range(N - 1, -1, -1):
        c0, c1, c2 = coefficients[m, n, p, 0], coefficients[m, n, p, 1], coefficients[m, n, p, 2]
        c3, c4, c5 = coefficients[m, n, p, 3], coefficients[m, n, p, 4], coefficients[m, n, p, 5]
        a = c0 + x * (c1 + x * (c2 + x * (c3 + x * (c4 + x * c5))))
        b = c1 + x * (2.0 * c2 + x * (3.0 * c3 + x * (4.0 * c4 + x * 5.0 * c5)))
        c = 2.0 * c2 + x * (6.0 * c3 + x * (12.0 * c4 + x * 20.0 * c5))
        w_g = w_g * y + w
        w = w * y + a
        w_ig = w_ig * y + w_i
        w_i = w_i * y + b
        w_ii = w_ii * y + c
    return True, -w_g, w_ii, -w_ig if i >= 0 else w_ig


@compiled
def cell_of(nodes, x):  # type: ignore[no-untyped-def]
    """The index m with nodes[m] <= x <= nodes[m + 1], by bisection."""
    low, high = 0, nodes.size - 1
    while high - low > 1:
        middle = (low + high) // 2
        if nodes[middle] <= x:
            low = middle
        else:
            high = middle
    return low


@compiled
def evaluate_many(gap, current, coefficients, i, g, out):  # type: ignore[no-untyped-def]
    """`evaluate` for arrays i, g (n,) into out (6, n)."""
    for k in range(i.size):
        evaluate(gap, current, coefficients, i[k], g[k], out[:, k])
