"""What a cubature of the irons has to sum: by points of the quadrature, what numbers and reduced forces are made of.

To first order a cubature changes a number by the reduced force's change times the number's adjoint (Becker and
Rannacher, Acta Numerica 10, 2001), which for force and flux linkage are the state's own slopes dc/dq and dc/di. These
sums are few and smooth over the points of a table; the reduced forces themselves, of which only the square of the error
counts then, need not be kept as well.
"""

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.magnetics.reduced.reduced_model import KnownStates
from msl_fem.magnetics.reduced.space import Basis
from msl_fem.materials.curves import NO_FIELD, magnetise_all


def number_integrands(basis: Basis, known: KnownStates, full_scale: Array) -> Array:
    """(m, n_point) densities of H.dB/dq and H.dB/di at states (n,).

    Parameters
    ----------
    full_scale : (1 + coil,) of force and flux linkages, which the densities are divided by
    """
    h_x, h_y = _field_strengths(basis, known.states)
    rows = []
    slopes = [known.by_coordinate, *known.by_current.transpose(1, 0, 2)]
    for slope, scale in zip(slopes, full_scale, strict=True):
        b_x, b_y = _flux_densities(basis, slope / scale)
        rows.append(h_x * b_x + h_y * b_y)
    return np.concatenate(rows)


def force_integrands(basis: Basis, states: Array) -> Array:
    """(m, n_point) densities of the reduced force of each state (n, N), over its size."""
    gradients = basis.gradients[::2].T, basis.gradients[1::2].T
    rows = []
    for h_x, h_y in zip(*_field_strengths(basis, states), strict=True):
        force = h_x * gradients[0] + h_y * gradients[1]
        rows.append(force / np.linalg.norm(force @ basis.quadrature.weight))
    return np.concatenate(rows)


def _flux_densities(basis: Basis, states: Array) -> tuple[Array, Array]:
    """Both derivatives (n, n_point) at all points of the irons."""
    return states @ basis.gradients[::2].T, states @ basis.gradients[1::2].T


def _field_strengths(basis: Basis, states: Array) -> tuple[Array, Array]:
    """H (n, n_point) along both."""
    every = basis.quadrature
    x, y = _flux_densities(basis, states)
    b = np.maximum(np.hypot(x, y), NO_FIELD)
    h, slope = np.empty_like(b), np.empty_like(b)
    magnetise_all(b.ravel(), np.tile(every.iron, len(b)), every.curves, h.ravel(), slope.ravel())
    reluctivity = h / b
    return reluctivity * x, reluctivity * y
