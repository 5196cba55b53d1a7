"""A measured map of two flux linkages over two currents: the coenergy nearest to it, and how far it is from one.

Flux linkages that are derivatives of a coenergy have d lambda_1/d i_2 = d lambda_2/d i_1, and their sum along a closed
path in the plane of the currents is 0 (Woodson and Melcher, Electromechanical Dynamics I, 1968, section 3.1). Those of
a measurement have not: noise, iron loss, a resistance that was taken off wrongly. The defect is stated here by cell and
as a whole, of the measured values themselves, before anything is fitted.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from msl_fem.computing.arrays import Array
from msl_fem.computing.splines import b_splines
from msl_fem.errors import InputError

DEGREE = 5
FEWEST = 6  # currents of either coil
SMOOTHING = np.logspace(-10, 2, 25)
"""Weights of the penalty that cross-validation chooses from, over the mean square of the flux linkages."""
MIRRORED = 1e-9  # of the largest flux linkage: what rounding leaves of an exact mirror symmetry


@dataclass(frozen=True, eq=False)
class CurrentMap:
    """The coenergy W'(i_1, i_2) fitted to both measured flux linkages, and what it leaves of them.

    Attributes
    ----------
    current_1, current_2 : (n_1,), (n_2,) A
    coefficients : of the quintic B-splines of `current_1` and `current_2`; W' is 0 at the currents nearest to 0
    residual_1, residual_2 : (n_1, n_2) Wb, measured less fitted
    circulation : (n_1 - 1, n_2 - 1) J, the integral of lambda . di around each cell of the measured map, trapezoids
    circulation_coarse : (n_1 - 2, n_2 - 2) J, around 2 by 2 cells by Simpson's rule, whose own error is far smaller
    defect : RMS of d lambda_1/d i_2 - d lambda_2/d i_1 over that of the two, by the circulation of cells
    defect_coarse : the same by Simpson's rule: what is left when most of the grid's error is gone
    smoothing : weight of the penalty
    notes : what the map says of itself, for people
    """

    current_1: Array
    current_2: Array
    coefficients: Array
    residual_1: Array
    residual_2: Array
    circulation: Array
    circulation_coarse: Array
    defect: float
    defect_coarse: float
    smoothing: float
    notes: tuple[str, ...]

    def evaluate(self, current_1: Array, current_2: Array, orders: tuple[int, int] = (0, 0)) -> Array:
        """(n,) derivatives of W' of these orders at the points: J, Wb (1, 0 and 0, 1) or H; InputError outside."""
        i, j = np.atleast_1d(np.asarray(current_1, dtype=float)), np.atleast_1d(np.asarray(current_2, dtype=float))
        for name, values, nodes in (("current_1", i, self.current_1), ("current_2", j, self.current_2)):
            outside = ~((values >= nodes[0]) & (values <= nodes[-1]))
            if outside.any():
                raise InputError(
                    f"{name} {values[outside][0]:g} A lies outside the map's {nodes[0]:g} ... {nodes[-1]:g} A; it is "
                    "not extrapolated"
                )
        along_1 = b_splines(_knots(self.current_1), DEGREE, i, orders[0])
        along_2 = b_splines(_knots(self.current_2), DEGREE, j, orders[1])
        return np.einsum("nb,nb->n", along_1 @ self.coefficients, along_2)

    def flux_linkages(self, current_1: Array, current_2: Array) -> tuple[Array, Array]:
        """Both in Wb, exactly reciprocal."""
        return self.evaluate(current_1, current_2, (1, 0)), self.evaluate(current_1, current_2, (0, 1))


def fit_current_map(current_1: Array, current_2: Array, flux_1: Array, flux_2: Array) -> CurrentMap:
    """The coenergy whose slopes are nearest to two measured flux linkages (n_1, n_2), in the least squares.

    Each flux linkage weighs by its own mean square; the roughness of third differences is penalised with the weight of
    the least generalised cross-validation score (Golub, Heath and Wahba, Technometrics 21 (1979) 215). What no
    coenergy can follow stays in the residuals, and the defect is stated of the measured values.

    Raises
    ------
    InputError : fewer than 6 currents of a coil, not increasing, values that are not finite, or other shapes
    """
    _check(current_1, current_2, flux_1, flux_2)
    bases = [[b_splines(_knots(nodes), DEGREE, nodes, order) for order in (0, 1)] for nodes in (current_1, current_2)]
    scales = [float(np.sqrt(np.mean(flux**2))) for flux in (flux_1, flux_2)]
    rows = [
        np.kron(bases[0][1], bases[1][0]) / scales[0],
        np.kron(bases[0][0], bases[1][1]) / scales[1],
    ]
    matrix = np.concatenate(rows)
    right = np.concatenate([flux_1.ravel() / scales[0], flux_2.ravel() / scales[1]])
    shape = bases[0][0].shape[1], bases[1][0].shape[1]
    coefficients, smoothing = _smoothed(matrix, right, shape)
    near = [int(np.argmin(np.abs(nodes))) for nodes in (current_1, current_2)]
    coefficients = coefficients - bases[0][0][near[0]] @ coefficients @ bases[1][0][near[1]]  # splines sum to 1
    fitted = [np.asarray(row @ coefficients.ravel()).reshape(flux_1.shape) for row in rows]
    cells, coarse = (
        _trapezoid_circulation(current_1, current_2, flux_1, flux_2),
        _simpson_circulation(current_1, current_2, flux_1, flux_2),
    )
    return CurrentMap(
        current_1=current_1,
        current_2=current_2,
        coefficients=coefficients,
        residual_1=flux_1 - scales[0] * fitted[0],
        residual_2=flux_2 - scales[1] * fitted[1],
        circulation=cells.sum,
        circulation_coarse=coarse.sum,
        defect=cells.share,
        defect_coarse=coarse.share,
        smoothing=smoothing,
        notes=tuple(_symmetry_notes(current_1, current_2, flux_1, flux_2)),
    )


def _check(current_1: Array, current_2: Array, flux_1: Array, flux_2: Array) -> None:
    for name, nodes in (("current_1", current_1), ("current_2", current_2)):
        if nodes.ndim != 1 or nodes.size < FEWEST or not (np.diff(nodes) > 0).all():
            raise InputError(f"{name} must be {FEWEST} or more increasing currents; it has {nodes.size}")
    for name, flux in (("flux_linkage_1", flux_1), ("flux_linkage_2", flux_2)):
        if flux.shape != (current_1.size, current_2.size) or not np.isfinite(flux).all():
            raise InputError(
                f"{name} must be finite, of shape {(current_1.size, current_2.size)}; it has {flux.shape}: a map needs "
                "every pair of the currents once"
            )


def _knots(nodes: Array) -> Array:
    """Of quintic splines with a knot at every inner node but two."""
    return np.r_[np.full(DEGREE + 1, nodes[0]), nodes[2:-2], np.full(DEGREE + 1, nodes[-1])]


def _smoothed(matrix: Array, right: Array, shape: tuple[int, int]) -> tuple[Array, float]:
    """The coefficients (n_1, n_2) and the smoothing that cross-validation chooses."""
    rough = [np.diff(np.eye(n), 3, axis=0) for n in shape]
    penalty = np.kron(rough[0].T @ rough[0], np.eye(shape[1])) + np.kron(np.eye(shape[0]), rough[1].T @ rough[1])
    normal = matrix.T @ matrix
    constant = np.full((normal.shape[0],) * 2, 1.0 / normal.shape[0])  # W' is known up to a constant alone
    level = float(np.trace(normal)) / normal.shape[0]
    best, chosen, smallest = None, float(SMOOTHING[0]), np.inf
    for weight in SMOOTHING:
        factor = cho_factor(normal + level * (weight * penalty + constant))
        coefficients = cho_solve(factor, matrix.T @ right)
        free = 1 - (np.trace(cho_solve(factor, normal))) / right.size
        score = float(np.mean((right - matrix @ coefficients) ** 2)) / free**2 if free > 0 else np.inf
        if score < smallest:
            best, chosen, smallest = coefficients, float(weight), score
    if best is None:
        raise InputError("no smooth coenergy can be fitted: the map has fewer values than its splines have freedom")
    return best.reshape(shape), chosen


@dataclass(frozen=True, eq=False)
class _Circulation:
    """Integrals of lambda . di around cells (J), and their RMS over that of what their two halves have in common."""

    sum: Array
    share: float


def _trapezoid_circulation(i: Array, j: Array, flux_1: Array, flux_2: Array) -> _Circulation:
    """Around each cell, trapezoids along its edges."""
    width, height = np.diff(i)[:, None], np.diff(j)[None, :]
    along_1 = (flux_1[1:] + flux_1[:-1]) / 2 * width  # (n_1 - 1, n_2)
    along_2 = (flux_2[:, 1:] + flux_2[:, :-1]) / 2 * height
    return _compared(np.diff(along_1, axis=1), np.diff(along_2, axis=0), width * height)


def _simpson_circulation(i: Array, j: Array, flux_1: Array, flux_2: Array) -> _Circulation:
    """Around each 2 by 2 cells, Simpson's rule along their edges (its form for unequal steps)."""
    along_1 = _simpson(i, flux_1)
    along_2 = _simpson(j, flux_2.T).T
    area = (i[2:] - i[:-2])[:, None] * (j[2:] - j[:-2])[None, :]
    return _compared(along_1[:, 2:] - along_1[:, :-2], along_2[2:] - along_2[:-2], area)


def _simpson(x: Array, y: Array) -> Array:
    """(n - 2, ...) integrals of the parabolas through three neighbours."""
    h, k = (x[1:-1] - x[:-2])[:, None], (x[2:] - x[1:-1])[:, None]
    total = h + k
    return total / 6 * ((2 - k / h) * y[:-2] + total**2 / (h * k) * y[1:-1] + (2 - h / k) * y[2:])


def _compared(by_2: Array, by_1: Array, area: Array) -> _Circulation:
    """Of the mean slopes of the cells: d lambda_1/d i_2 and d lambda_2/d i_1 times the area."""
    one, two = by_2 / area, by_1 / area
    common = np.sqrt((np.mean(one**2) + np.mean(two**2)) / 2)
    return _Circulation(by_1 - by_2, float(np.sqrt(np.mean((one - two) ** 2)) / common))


def _symmetry_notes(i: Array, j: Array, flux_1: Array, flux_2: Array) -> list[str]:
    """A line where half of the map is the mirror image of the other half to the last digit."""
    notes = []
    for axis, name, nodes, even, odd in ((1, "current_2", j, flux_1, flux_2), (0, "current_1", i, flux_2, flux_1)):
        if not np.allclose(nodes, -nodes[::-1], atol=1e-12 * np.abs(nodes).max()):
            continue
        apart = [np.abs(even - np.flip(even, axis)).max(), np.abs(odd + np.flip(odd, axis)).max()]
        if max(apart) <= MIRRORED * max(np.abs(flux_1).max(), np.abs(flux_2).max()):
            notes.append(
                f"the map is its own mirror image in {name} to the last digit: only half of it was measured, or it was "
                "made symmetric; the difference of both halves is no estimate of the noise"
            )
    return notes
