"""What a cubature of the irons has to sum: by points of the quadrature, what numbers and reduced forces are made of.

To first order a cubature changes a number by the reduced force's change times the number's adjoint (Becker and
Rannacher, Acta Numerica 10, 2001), which for force and flux linkage are the state's own slopes dc/dq and dc/di. These
sums are few and smooth over the points of a table; the reduced forces themselves, of which only the square of the error
counts then, need not be kept as well.
"""

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.computing.compiled import compiled
from msl_fem.magnetics.reduced.reduced_iron import magnetise_fields
from msl_fem.magnetics.reduced.reduced_model import KnownStates
from msl_fem.magnetics.reduced.space import Basis


def number_integrands(basis: Basis, known: KnownStates, full_scale: Array) -> Array:
    """(m, n_point) densities of H.dB/dq and H.dB/di at states (n,).

    Parameters
    ----------
    full_scale : (1 + coil,) of force and flux linkages, which the densities are divided by
    """
    h = _field_strengths(basis, known.states)
    slopes = [known.by_coordinate, *known.by_current.transpose(1, 0, 2)]
    rows = []
    for slope, scale in zip(slopes, full_scale, strict=True):
        rows.append(_densities(h, (slope / scale) @ basis.gradients.T).T)
    return np.concatenate(rows)


def force_integrands(basis: Basis, states: Array) -> Array:
    """(m, n_point) densities of the reduced force of each state (n, N), over its size."""
    rows = []
    for h in _field_strengths(basis, states):
        force = _force_densities(h, basis.gradients)
        force /= np.linalg.norm(basis.quadrature.weight @ force)
        rows.append(force.T)
    return np.concatenate(rows)


@compiled
def _densities(h: Array, along: Array) -> Array:
    """(n_point, n) of H . dB, both (n, 2 n_point)."""
    density = np.empty((h.shape[1] // 2, h.shape[0]))
    for q in range(density.shape[0]):
        for k in range(density.shape[1]):
            density[q, k] = h[k, 2 * q] * along[k, 2 * q] + h[k, 2 * q + 1] * along[k, 2 * q + 1]
    return density


@compiled
def _force_densities(h: Array, gradients: Array) -> Array:
    """(n_point, N) of H (2 n_point,) . the gradients (2 n_point, N)."""
    density = np.empty((h.size // 2, gradients.shape[1]))
    for q in range(density.shape[0]):
        x, y, own = gradients[2 * q], gradients[2 * q + 1], density[q]
        for j in range(np.uint64(own.size)):
            own[j] = h[2 * q] * x[j] + h[2 * q + 1] * y[j]
    return density


def _field_strengths(basis: Basis, states: Array) -> Array:
    """(n, 2 n_point) of H at all points of the irons, point after point."""
    field = states @ basis.gradients.T
    one = np.ones(basis.quadrature.weight.size)
    magnetise_fields(field, basis.whole_iron()._replace(weight=one), np.empty((0, 0)))
    return np.asarray(field)
