"""What any effect brings by chance on this very record: surrogates of the record without effects.

At the most probable model without effects the slopes of the log likelihood over all amounts are normal with zero mean
and the Gauss-Newton matrix G of the amounts (`linear_model`) as their covariance: the score statistic (Cox and
Hinkley, Theoretical Statistics, 1974, sec. 9.3). Drawn from that, all variants of all effects get their gains as on the
record itself, and the largest of them is what a clean record of this rig, this excitation and these tolerances brings.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from msl_fem.computing.arrays import Array
from msl_fem.diagnosis.unknowns import CAUCHY

SURROGATES = 200
SEED = 20261121
LEAST = 1e-30  # of a diagonal: an amount that shows nothing
ROUNDING = 1e-9  # of a diagonal: amounts that act alike
QUANTILES = (0.5, 0.9, 0.95, 0.99)
_WEAK = (2.0, 0.02)  # curvature of the prior near nothing, and far out


@dataclass(frozen=True, eq=False)
class NullDistribution:
    """The largest gains (n_surrogate,) of surrogates, nats."""

    gains: Array = field(default_factory=lambda: np.zeros(0))

    def p_value(self, gain: float) -> float:
        """Share of surrogates that reach a gain, this record counted as one of them."""
        return float((1 + np.sum(self.gains >= gain)) / (1 + self.gains.size))

    def quantile(self, share: float) -> float:
        """The gain that this share of surrogates stays below; minus infinity without any."""
        return float(np.quantile(self.gains, share)) if self.gains.size else -np.inf

    @property
    def quantiles(self) -> Mapping[str, float]:
        """By their names in diagnosis.json: "0.5" and so on."""
        return {f"{share:g}": self.quantile(share) for share in QUANTILES}


@dataclass(frozen=True)
class AmountPlaces:
    """Where the amounts of a variant stand, and which of them are one-sided."""

    places: tuple[int, ...]
    one_sided: tuple[bool, ...]


def null_distribution(own: Array, variants: Sequence[AmountPlaces]) -> NullDistribution:
    """The largest gain of any variant in each of `SURROGATES` surrogates; `own` is G of all amounts."""
    if not variants:
        return NullDistribution()
    size = np.sqrt(np.maximum(np.diag(own), LEAST))  # amounts differ by many powers of ten
    values, vectors = np.linalg.eigh(own / size[:, None] / size)
    chance = np.random.default_rng(SEED)
    normal = chance.standard_normal((SURROGATES, own.shape[0]))
    slopes = size * ((normal * np.sqrt(np.maximum(values, 0.0))) @ vectors.T)
    return NullDistribution(np.max([_gains(own, slopes, variant) for variant in variants], axis=0))


def _gains(own: Array, slopes: Array, variant: AmountPlaces) -> Array:
    """(n_surrogate,) gains of a variant, as `linear_model` has them at the densities of the fit."""
    at = np.array(variant.places)
    g, b = own[np.ix_(at, at)], slopes[:, at]
    one_sided = np.array(variant.one_sided)
    best = np.zeros(len(b))
    for weak in _WEAK:
        a = _bounded(g + np.diag(weak + ROUNDING * np.diag(g)), b, one_sided)
        made = np.sum(b * a, axis=1) - np.einsum("na,ab,nb->n", a, g, a) / 2 - np.log1p(a**2).sum(axis=1)
        best = np.maximum(best, made)
    return best + CAUCHY * at.size - float(np.linalg.slogdet(g + 2 * np.eye(at.size))[1]) / 2


def _bounded(g: Array, b: Array, one_sided: NDArray[np.bool_]) -> Array:
    """The best points (n_surrogate, n_amount), one-sided numbers that would be below 0 left out together."""
    made, kept = np.linalg.solve(g, b.T).T, np.ones(b.shape, dtype=bool)
    for _ in range(b.shape[1]):
        below = one_sided & (made < 0)
        again = np.flatnonzero(below.any(axis=1))
        if not again.size:
            break
        kept[again] &= ~below[again]
        made[again] = 0.0
        for pattern in np.unique(kept[again], axis=0):
            rows = again[np.all(kept[again] == pattern, axis=1)]
            if pattern.any():
                part = np.linalg.solve(g[np.ix_(pattern, pattern)], b[rows][:, pattern].T).T
                made[np.ix_(rows, pattern)] = part
    return np.where(one_sided & (made < 0), 0.0, made)
