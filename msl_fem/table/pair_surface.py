"""A smooth function of a position and two currents through its values and slopes; its derivatives are exact.

The tensor product of quintic splines of class C3 (double knots at the nodes), as `coenergy_surface` in one variable
more: what is one function has one mixed derivative, so d lambda_1/d i_2 = d lambda_2/d i_1 and dF/d i_k = d lambda_k/dx
hold to rounding.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.computing.compiled import compiled, for_few
from msl_fem.computing.quintic_cell import AT_NODE, N_CELL, ORDERS, PADDED, expand_cell
from msl_fem.computing.splines import spline_derivative
from msl_fem.errors import OutOfTable
from msl_fem.files.quantity import format_quantity
from msl_fem.table.coenergy_surface import cell_of, hermite_spline

FEW = 4  # points that Python evaluates sooner than it loads the compiler
DERIVATIVES = ("", "1", "2", "x", "11", "22", "12", "x1", "x2", "xx")
"""Rows of an evaluation: the value, then its derivatives along the position x and the currents 1 and 2."""
CORNERS = ("", "x", "1", "2", "x1", "x2", "12", "x12")
"""What the surface takes at every node."""
FEWEST_NODES = 3
Orders = tuple[int, int, int]


@dataclass(frozen=True, eq=False)
class PairSurface:
    """Piecewise triquintic polynomials of the local coordinates along position (m) and both currents (A).

    Attributes
    ----------
    position, current_1, current_2 : (n_x,), (n_1,), (n_2,) nodes
    hermite : (n_x, n_1, n_2, 27): derivatives of order 0, 1, 2 along the position, current 2 and current 1, the last
        the fastest; they determine the polynomial of each cell (`computing.quintic_cell`)
    """

    position: Array
    current_1: Array
    current_2: Array
    hermite: Array

    def __call__(self, position: Array, current_1: Array, current_2: Array) -> Array:
        """(10, ...) `DERIVATIVES`; nan outside the block of nodes."""
        points = np.broadcast_arrays(*(np.asarray(v, dtype=float) for v in (position, current_1, current_2)))
        x, i, j = (np.array(v).ravel() for v in points)
        out = np.empty((len(DERIVATIVES), x.size))
        evaluated = for_few(evaluate_many_pairs) if x.size <= FEW else evaluate_many_pairs
        evaluated(self.position, self.current_1, self.current_2, self.hermite, x, i, j, out)
        return out.reshape(len(DERIVATIVES), *points[0].shape)


def fit_pair_surface(position: Array, current_1: Array, current_2: Array, nodes: Mapping[str, Array]) -> PairSurface:
    """The surface through the nodes' values.

    Parameters
    ----------
    position, current_1, current_2 : (n_x,), (n_1,), (n_2,) increasing, 3 or more each
    nodes : arrays (n_x, n_1, n_2) of `CORNERS`: the value and its derivatives
    """
    axes = position, current_1, current_2
    data: dict[Orders, Array] = {_orders(name): nodes[name] for name in CORNERS}
    for axis, places in enumerate(axes):
        data = _stacked_along(axis, places, data)
    at_nodes = [_derivatives_at_nodes(places) for places in axes]
    hermite = np.einsum("apx,bqy,crz,xyz->pqracb", *at_nodes, data[0, 0, 0], optimize=True)
    return PairSurface(*axes, np.ascontiguousarray(hermite).reshape(*(places.size for places in axes), AT_NODE))


def _derivatives_at_nodes(places: Array) -> Array:
    """(3, n, 2 n + 2): value, slope and second derivative of a `hermite_spline` at its nodes, by what it takes."""
    n = places.size
    to_nodes = np.zeros((ORDERS, n, 2 * n + 2))
    to_nodes[0, :, :n] = to_nodes[1, :, n : 2 * n] = np.eye(n)
    to_nodes[2, :-1] = 2 * hermite_spline(places, symmetric_start=False).taylor[:, 2]
    to_nodes[2, -1, -1] = 1.0  # the condition at the end
    return to_nodes


def _orders(name: str) -> Orders:
    """How often a derivative is taken along position, current 1 and current 2."""
    return name.count("x"), name.count("1"), name.count("2")


def _stacked_along(axis: int, places: Array, data: dict[Orders, Array]) -> dict[Orders, Array]:
    """Along one axis: values, slopes, and the slopes' own derivative at both ends, of every array left."""
    left = {}
    for orders in product((0, 1), repeat=3):
        if orders[axis] or orders not in data:
            continue
        sloped = tuple(1 if k == axis else order for k, order in enumerate(orders))
        values = np.moveaxis(data[orders], axis, 0)
        slopes = np.moveaxis(data[sloped[0], sloped[1], sloped[2]], axis, 0)
        flat = slopes.reshape(places.size, -1)
        ends = spline_derivative(places, flat, places[[0, -1]], degree=min(5, places.size - 1))
        stacked = np.concatenate([values, slopes, ends.reshape(2, *slopes.shape[1:])])
        left[orders[0], orders[1], orders[2]] = np.moveaxis(stacked, 0, axis)
    return left


@dataclass(frozen=True, eq=False)
class SharedCoenergy:
    """What a shared armature adds to the coenergies of two magnets: D(x, i_1, i_2) of `pair_table`.

    Attributes
    ----------
    surface : D in J over the armature's position towards side 1 (m) and both currents (A), whose equal signs aid
    gap_sum : both gaps together, m
    """

    surface: PairSurface
    gap_sum: float

    @property
    def block(self) -> str:
        """The range, for messages."""
        s = self.surface
        currents = (f"current_{k} {i[0]:g} ... {i[-1]:g} A" for k, i in ((1, s.current_1), (2, s.current_2)))
        return f"position {s.position[0] * 1e3:.4g} ... {s.position[-1] * 1e3:.4g} mm, {', '.join(currents)}"

    def evaluate(self, position: Array, current_1: Array, current_2: Array) -> dict[str, Array]:
        """D and its slopes by the names of `DERIVATIVES`, broadcast together; OutOfTable outside the block."""
        points = np.broadcast_arrays(*(np.asarray(v, dtype=float) for v in (position, current_1, current_2)))
        values = self.surface(*points)
        if np.isnan(values).any():
            self._complain(points)
        return dict(zip(DERIVATIVES, values, strict=True))

    def _complain(self, points: Sequence[Array]) -> None:
        names = (("position", "m"), ("current_1", "A"), ("current_2", "A"))
        axes = self.surface.position, self.surface.current_1, self.surface.current_2
        for (name, unit), nodes, values in zip(names, axes, points, strict=True):
            outside = ~((values >= nodes[0]) & (values <= nodes[-1]))
            if outside.any():
                raise OutOfTable(
                    f"{name} {format_quantity(float(values[outside].flat[0]), unit)} lies outside the table's block: "
                    f"{self.block}; extend the sweep or clip the request"
                )


@compiled
def evaluate_cell(cell, y, u, v, across, along, out):  # type: ignore[no-untyped-def]
    """The `DERIVATIVES` at local coordinates into out (10,), by scratch across (3, 36), along (6, 6)."""
    for p in range(6):
        for q in range(6):  # along current 2: value, first and half the second derivative
            a = b = c = 0.0
            for r in range(5, -1, -1):
                c = c * v + b
                b = b * v + a
                a = a * v + cell[(6 * p + r) * PADDED + q]
            across[0, 6 * q + p] = a
            across[1, 6 * q + p] = b
            across[2, 6 * q + p] = c
    for p in range(6):  # along current 1
        a = b = c = 0.0
        a_2 = b_2 = a_22 = 0.0
        for q in range(5, -1, -1):
            k = 6 * q + p
            c = c * u + b
            b = b * u + a
            a = a * u + across[0, k]
            b_2 = b_2 * u + a_2
            a_2 = a_2 * u + across[1, k]
            a_22 = a_22 * u + across[2, k]
        along[0, p] = a
        along[1, p] = b
        along[2, p] = a_2
        along[3, p] = 2.0 * c
        along[4, p] = 2.0 * a_22
        along[5, p] = b_2
    w = w_x = w_xx = w_1 = w_1x = w_2 = w_2x = w_11 = w_22 = w_12 = 0.0
    for p in range(5, -1, -1):
        w_xx = w_xx * y + w_x
        w_x = w_x * y + w
        w = w * y + along[0, p]
        w_1x = w_1x * y + w_1
        w_1 = w_1 * y + along[1, p]
        w_2x = w_2x * y + w_2
        w_2 = w_2 * y + along[2, p]
        w_11 = w_11 * y + along[3, p]
        w_22 = w_22 * y + along[4, p]
        w_12 = w_12 * y + along[5, p]
    out[0] = w
    out[1] = w_1
    out[2] = w_2
    out[3] = w_x
    out[4] = w_11
    out[5] = w_22
    out[6] = w_12
    out[7] = w_1x
    out[8] = w_2x
    out[9] = 2.0 * w_xx


@compiled
def cell_at(position, current_1, current_2, x, i, j):  # type: ignore[no-untyped-def]
    """The nodes (k, m, n) at which the cell of a point begins; (-1, -1, -1) outside the nodes, or for no number."""
    inside = position[0] <= x <= position[-1]
    inside = inside and current_1[0] <= i <= current_1[-1] and current_2[0] <= j <= current_2[-1]
    if not inside:
        return -1, -1, -1
    return cell_of(position, x), cell_of(current_1, i), cell_of(current_2, j)


@compiled
def evaluate_pair(position, current_1, current_2, hermite, x, i, j, cell, across, along, out):  # type: ignore[no-untyped-def]
    """The `DERIVATIVES` at a point into out (10,), by scratch cell (N_CELL,), across (3, 36), along (6, 6); False
    outside the nodes."""
    k, m, n = cell_at(position, current_1, current_2, x, i, j)
    if k < 0:
        return False
    expand_cell(position, current_1, current_2, hermite, k, m, n, cell)
    evaluate_cell(cell, x - position[k], i - current_1[m], j - current_2[n], across, along, out)
    return True


@compiled
def evaluate_many_pairs(position, current_1, current_2, hermite, x, i, j, out):  # type: ignore[no-untyped-def]
    """The `DERIVATIVES` at points x, i, j (n,) into out (10, n); nan outside the nodes. A cell is expanded once for the
    points in it that follow one another."""
    across, along, cell = np.empty((3, 36)), np.empty((6, 6)), np.zeros(N_CELL)
    last = (-1, -1, -1)
    for r in range(x.size):
        at = cell_at(position, current_1, current_2, x[r], i[r], j[r])
        k, m, n = at
        if k < 0:
            out[:, r] = np.nan
            continue
        if at != last:
            expand_cell(position, current_1, current_2, hermite, k, m, n, cell)
            last = at
        y, u, v = x[r] - position[k], i[r] - current_1[m], j[r] - current_2[n]
        evaluate_cell(cell, y, u, v, across, along, out[:, r])
