"""One coenergy surface W'(i, g) fitted to scattered forces and flux linkages together, smooth and regularised.

W' = W0 (1 + q). W0 is the coenergy of a reluctance with a smooth bend into saturation, a few numbers; q is a tensor
product of quintic B-splines in ln(g + b) and ln(1 + (i/s)^2), s the current of saturation, with a penalty on the second
differences of its coefficients (P-splines: Eilers and Marx, Statistical Science 11 (1996) 89-121). Flux linkage dW'/di
and force -dW'/dg are linear in the coefficients, so force and flux are fitted as one, and reciprocity holds by
construction. W' is even in the current and vanishes without it, as W0 does.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import comb

import numpy as np
from scipy.interpolate import BSpline
from scipy.linalg import cho_factor, cho_solve, solve_triangular
from scipy.optimize import least_squares, nnls

from msl_fem.computing.arrays import Array
from msl_fem.errors import ComputationError

DEGREE, ALONG_GAP, ALONG_CURRENT = 5, 6, 22
SMOOTHING = np.logspace(-4, 6, 41)
"""Weights of the penalty that cross-validation chooses from."""
COUNTED = 1.4
"""How often cross-validation counts a degree of freedom."""
RIDGE = 1e-4
"""Weight of the coefficients' size beside their second differences: what no measurement says is left to W0."""
NO_CURRENT = 1e-6
"""Of the largest current: less says nothing of the inductance."""
FLOOR = 0.05
"""The incremental inductance stays above this share of W0's."""
UNEQUAL_ROWS = (
    "no smooth surface can be fitted to the static map: its rows weigh too differently for the arithmetic; "
    "look for values far beyond the others, and at the noise stated for them"
)
Span = tuple[float, float, float]
Order = tuple[int, int]
"""Derivatives along the current and along the gap."""
ORDERS: dict[str, tuple[Order, float]] = {
    "coenergy": ((0, 0), 1.0),
    "flux_linkage": ((1, 0), 1.0),
    "force": ((0, 1), -1.0),
    "incremental_inductance": ((2, 0), 1.0),
    "force_current_slope": ((1, 1), -1.0),
    "force_gap_slope": ((0, 2), -1.0),
}


@dataclass(frozen=True, eq=False)
class Samples:
    """Measured values of one quantity, (n,) each: size of the current (A), gap (m), value and its sigma."""

    current: Array
    gap: Array
    value: Array
    sigma: Array


@dataclass(frozen=True)
class SaturatingReluctance:
    """W0 = L s (sqrt(s^2 + i^2) - s) + e i^2/2: inductance L = a/(g + b), which bends at the current s = c (g + d).

    A reluctance of gap and iron in series (Woodson and Melcher, Electromechanical Dynamics I, 1968, section 3.1) whose
    flux linkage saturates near a c, and e, the inductance of flux that does not depend on the gap (leakage across the
    window). The bend's form is a convenience; what data say against it goes into q.
    """

    a: float
    b: float
    c: float
    d: float
    e: float

    def derivatives(self, i: Array, g: Array) -> dict[Order, Array]:
        """W0 and its derivatives up to second order."""
        x = g + self.b
        s, c = self.c * (g + self.d), self.c
        r = np.sqrt(s**2 + i**2)
        bend = {
            (0, 0): s * i**2 / (r + s),
            (1, 0): s * i / r,
            (2, 0): s**3 / r**3,
            (0, 1): c * (i**2 / (r + s)) ** 2 / r,
            (1, 1): c * i**3 / r**3,
            (0, 2): c**2 * (3 * s / r - s**3 / r**3 - 2),
        }
        inductance = self.a / x, -self.a / x**2, 2 * self.a / x**3
        leakage = {(0, 0): self.e * i**2 / 2, (1, 0): self.e * i, (2, 0): self.e}
        derivatives = {}
        for p, m in bend:
            product = sum(comb(m, k) * inductance[k] * bend[p, m - k] for k in range(m + 1))
            derivatives[p, m] = leakage.get((p, m), 0.0) + product
        return derivatives


@dataclass(frozen=True, eq=False)
class CoenergyFit:
    """The fitted surface.

    Attributes
    ----------
    base : W0
    span : smallest gap, largest gap (m) and largest current (A) of the data
    coefficients : of q, (n_spline,)
    covariance : of the coefficients, given the penalty (Wahba, J. R. Statist. Soc. B 45 (1983) 133-150)
    smoothing : weight of the penalty, chosen by generalised cross-validation
    raised : whether cross-validation alone would have chosen less
    """

    base: SaturatingReluctance
    span: Span
    coefficients: Array
    covariance: Array
    smoothing: float
    raised: bool

    def __call__(self, quantity: str, current: Array, gap: Array) -> tuple[Array, Array]:
        """The quantity (of `ORDERS`) and its sigma at |current| and gap, (n,) each."""
        order, sign = ORDERS[quantity]
        plain, design = _design(self.base, self.span, order, current, gap)
        variance = np.einsum("nk,nk->n", design @ self.covariance, design)
        return sign * (plain + design @ self.coefficients), np.sqrt(np.maximum(variance, 0.0))


def fit_base(samples: Mapping[str, Samples]) -> SaturatingReluctance:
    """The reluctance W0 nearest to the samples; raises ComputationError where none comes near."""
    current = max(float(s.current.max()) for s in samples.values())
    gap = float(np.median(np.concatenate([s.gap for s in samples.values()])))
    inductance = _first_inductance(samples)
    leaks = "flux_linkage" in samples  # force knows nothing of it
    weight = {}
    for name, s in samples.items():
        weight[name] = 1 / np.maximum(s.sigma, 0.01 * np.abs(s.value).max())

    def reluctance(logarithms: Array) -> SaturatingReluctance:
        a, b, c, d, e = (float(v) for v in np.exp(logarithms))
        return SaturatingReluctance(a, b, c, d, e if leaks else 0.0)

    def residuals(logarithms: Array) -> Array:
        base = reluctance(logarithms)
        errors = []
        for name, s in samples.items():
            order, sign = ORDERS[name]
            value = sign * base.derivatives(s.current, s.gap)[order]
            errors.append((value - s.value) * weight[name])
        return np.concatenate(errors)

    fits = []
    reach = np.array([5.0, 3.0, 5.0, 3.0, 3.0])
    for bend in (0.3, 1.0, 4.0):
        knee = 0.5 * bend * current
        start = np.log([inductance * 1.1 * gap, 0.1 * gap, knee / gap, 0.1 * gap, 0.05 * inductance])
        fits.append(least_squares(residuals, start, bounds=(start - reach, start + reach)))
    best = min(fits, key=lambda fit: float(fit.cost))
    scale = sum(float(np.sum((s.value * weight[name]) ** 2)) for name, s in samples.items())
    if not 2 * best.cost < 0.25 * scale:
        raise ComputationError(
            "the measurements are not those of a reluctance magnet: no force ~ i^2/(g + b)^2 with saturation comes "
            "near them; check units (gap_m, current_A, force_N, flux_linkage_Wb), and signs: force is attractive "
            "positive, flux linkage has the sign of the current"
        )
    return reluctance(best.x)


def fit_coenergy(
    samples: Mapping[str, Samples],
    base: SaturatingReluctance,
    *,
    keep_positive: tuple[Array, Array],
    least_smoothing: float = 0.0,
) -> CoenergyFit:
    """The surface fitted to the samples of `force` and `flux_linkage`, each weighted by its sigma.

    The weight of the penalty is that of the least generalised cross-validation score (Golub, Heath and Wahba,
    Technometrics 21 (1979) 215-223), with degrees of freedom counted 1.4 times, as correlated misfit asks (Gu,
    Smoothing Spline ANOVA Models, 2002, section 3.2), and not below `least_smoothing`. Where the incremental inductance
    would fall below `FLOOR` times W0's at the points `keep_positive` (current, gap), the nearest coefficients that hold
    it there are taken (least distance programming: Lawson and Hanson, Solving Least Squares Problems, 1974, ch. 23).
    """
    gaps = np.concatenate([s.gap for s in samples.values()])
    highest = max(float(s.current.max()) for s in samples.values())
    span = float(gaps.min()), float(gaps.max()), highest
    rows, targets = [], []
    for name, s in samples.items():
        order, sign = ORDERS[name]
        plain, design = _design(base, span, order, s.current, s.gap)
        rows.append(sign * design / s.sigma[:, None])
        targets.append((s.value - sign * plain) / s.sigma)
    matrix = np.concatenate(rows)
    right = np.concatenate(targets)
    normal = matrix.T @ matrix
    penalty = _penalty()
    scores = [_score(matrix, right, normal, normal + weight * penalty) for weight in SMOOTHING]
    usable = [k for k, score in enumerate(scores) if not np.isnan(score)]
    if not usable:
        raise ComputationError(UNEQUAL_ROWS)
    chosen = float(SMOOTHING[min(usable, key=lambda k: scores[k])])
    smoothing = max(chosen, least_smoothing)
    stiff = normal + smoothing * penalty
    factor = _factor(stiff)
    if factor is None:  # the score's matrix was sound, that of a larger smoothing is not
        raise ComputationError(UNEQUAL_ROWS)
    coefficients = cho_solve(factor, matrix.T @ right)
    plain, design = _design(base, span, (2, 0), *keep_positive)
    coefficients = _nearest_above(coefficients, stiff, design / plain[:, None], FLOOR - 1.0)
    covariance = cho_solve(factor, np.eye(len(stiff)))
    return CoenergyFit(base, span, coefficients, covariance, smoothing, smoothing > chosen)


def _first_inductance(samples: Mapping[str, Samples]) -> float:
    """A first value of the inductance in mid-gap, from the smaller currents."""
    s = samples["flux_linkage"] if "flux_linkage" in samples else samples["force"]
    low = (s.current > NO_CURRENT * s.current.max()) & (s.current <= np.median(s.current))
    if "flux_linkage" in samples:
        inductance = s.value[low] / s.current[low]
    else:  # F = i^2 L/(2 (g + b))
        inductance = 2 * s.value[low] * s.gap[low] / s.current[low] ** 2
    return max(float(np.median(inductance)), 1e-9)


def _design(base: SaturatingReluctance, span: Span, order: Order, i: Array, g: Array) -> tuple[Array, Array]:
    """A derivative of W0 (n,) and those of W0 times each spline (n, n_spline), by Leibniz' rule."""
    plain = base.derivatives(i, g)
    splines = _spline_derivatives(base, span, i, g, highest=order)
    p, m = order
    design = sum(
        (comb(p, j) * comb(m, k) * plain[p - j, m - k])[:, None] * splines[j, k]
        for j in range(p + 1)
        for k in range(m + 1)
    )
    return plain[order], np.asarray(design)


def _spline_derivatives(
    base: SaturatingReluctance, span: Span, i: Array, g: Array, *, highest: Order
) -> dict[Order, Array]:
    """The splines of (x, y), (n, n_spline), and their derivatives along i and g up to the highest, by the chain rule.

    x = ln(g + b) and y = ln(1 + (i/s)^2)/2, s = c (g + d), each scaled to 0 ... 1: saturation stands at the same y for
    every gap, and y is even and smooth in i.
    """
    b = base.b
    s, c = base.c * (g + base.d), base.c
    low, length = np.log(span[0] + b), np.log((span[1] + b) / (span[0] + b))
    x = (np.log(g + b) - low) / length
    x_g = 1 / (g + b) / length
    x_gg = -1 / (g + b) ** 2 / length
    least = c * (span[0] + base.d)
    height = 0.5 * np.log1p((span[2] / least) ** 2)
    r2 = s**2 + i**2
    y = 0.5 * np.log1p((i / s) ** 2) / height
    y_i = i / r2 / height
    y_ii = (s**2 - i**2) / r2**2 / height
    # y = (ln r2)/2 - ln s, of which s depends on the gap
    y_g = c * (s / r2 - 1 / s) / height
    y_ig = -2 * c * i * s / r2**2 / height
    y_gg = c**2 * ((i**2 - s**2) / r2**2 + 1 / s**2) / height
    along_x, along_y = _splines(x, ALONG_GAP), _splines(y, ALONG_CURRENT)

    f, f_x, f_y, f_xx, f_xy, f_yy = (0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2)
    terms: dict[Order, list[tuple[Array, Order]]] = {
        (0, 0): [(np.ones_like(y), f)],
        (1, 0): [(y_i, f_y)],
        (0, 1): [(x_g, f_x), (y_g, f_y)],
        (2, 0): [(y_i**2, f_yy), (y_ii, f_y)],
        (1, 1): [(x_g * y_i, f_xy), (y_g * y_i, f_yy), (y_ig, f_y)],
        (0, 2): [(x_g**2, f_xx), (2 * x_g * y_g, f_xy), (y_g**2, f_yy), (x_gg, f_x), (y_gg, f_y)],
    }

    def product(factor: Array, m: int, n: int) -> Array:
        return (factor[:, None] * along_x[m])[:, :, None] * along_y[n][:, None, :]

    def summed(parts: list[tuple[Array, Order]]) -> Array:
        return np.asarray(sum(product(factor, *of) for factor, of in parts)).reshape(i.size, -1)

    p, m = highest
    return {order: summed(parts) for order, parts in terms.items() if order[0] <= p and order[1] <= m}


def _splines(u: Array, count: int) -> list[Array]:
    """The splines (n, count) at u in 0 ... 1 and their two derivatives."""
    knots = np.r_[np.zeros(DEGREE), np.linspace(0, 1, count - DEGREE + 1), np.ones(DEGREE)]
    basis = BSpline(knots, np.eye(count), DEGREE)
    u = np.clip(u, 0.0, 1.0)  # of rounding alone: points outside the data's rectangle do not come here
    return [basis(u, order) for order in range(3)]


def _penalty() -> Array:
    """Second differences of the coefficients along both directions, and a little of their size."""
    along_gap, along_current = _second_differences(ALONG_GAP), _second_differences(ALONG_CURRENT)
    return (
        np.kron(along_gap, np.eye(ALONG_CURRENT))
        + np.kron(np.eye(ALONG_GAP), along_current)
        + RIDGE * np.eye(ALONG_GAP * ALONG_CURRENT)
    )


def _second_differences(count: int) -> Array:
    """The square of the second differences of so many coefficients, of a function of 0 ... 1."""
    bend: Array = np.diff(np.eye(count), 2, axis=0)
    return bend.T @ bend


def _score(matrix: Array, right: Array, normal: Array, stiff: Array) -> float:
    """Generalised cross-validation: mean square residual over the squared share of free degrees.

    Nan where rounding leaves the normal equations indefinite: too little smoothing for these rows.
    """
    factor = _factor(stiff)
    if factor is None:
        return np.nan
    residual = right - matrix @ cho_solve(factor, matrix.T @ right)
    free = 1 - COUNTED * np.trace(cho_solve(factor, normal)) / right.size
    return float(np.mean(residual**2) / free**2) if free > 0 else np.inf


def _factor(stiff: Array) -> tuple[Array, bool] | None:
    """Cholesky's factor; None where rounding alone would decide whether there is one: the least eigenvalue, each
    unknown in its own unit, is that of so many roundings or less."""
    own = np.sqrt(np.diag(stiff))
    if not (np.isfinite(stiff).all() and (own > 0).all()):
        return None
    values = np.linalg.eigvalsh(stiff / own[:, None] / own)
    sound = values[0] > own.size * np.finfo(float).eps * values[-1]
    return cho_factor(stiff) if sound else None


def _nearest_above(best: Array, stiff: Array, constraint: Array, floor: float) -> Array:
    """The x with constraint @ x >= floor that is nearest to `best` in the norm of `stiff`; ComputationError where none
    is within the arithmetic."""
    missing = floor - constraint @ best
    if (missing <= 0).all():
        return best
    upper = np.linalg.cholesky(stiff).T
    turned = solve_triangular(upper, constraint.T, trans="T").T
    both = np.vstack([turned.T, missing])
    target = np.r_[np.zeros(best.size), 1.0]
    weights, _ = nnls(both, target, maxiter=50 * both.shape[1])
    residual = both @ weights - target
    if not residual[-1] < 0:  # by rounding: no surface above the floor is anywhere near
        raise ComputationError(
            "no surface whose inductance is positive comes near the static map: force and flux linkage contradict each "
            "other; look at their units and signs, and at the noise stated for them"
        )
    moved: Array = best + solve_triangular(upper, -residual[:-1] / residual[-1])
    return moved
