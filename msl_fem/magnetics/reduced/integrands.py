"""What a cubature of the irons has to sum: by points of the quadrature, what numbers and reduced forces are made of.

To first order a cubature changes a number by the reduced force's change times the number's adjoint (Becker and
Rannacher, Acta Numerica 10, 2001), which for force and flux linkage are the state's own slopes dc/dq and dc/di. These
sums are few and smooth over the points of a table; the reduced forces themselves, of which only the square of the error
counts then, need not be kept as well.
"""

import numpy as np

from msl_fem.computing.arrays import Array
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
    rows = []
    slopes = [known.by_coordinate, *known.by_current.transpose(1, 0, 2)]
    for slope, scale in zip(slopes, full_scale, strict=True):
        density = h * ((slope / scale) @ basis.gradients.T)
        rows.append(density[:, ::2] + density[:, 1::2])
    return np.concatenate(rows)


def force_integrands(basis: Basis, states: Array) -> Array:
    """(m, n_point) densities of the reduced force of each state (n, N), over its size."""
    x, y = basis.gradients[::2].T, basis.gradients[1::2].T
    rows = []
    for h in _field_strengths(basis, states):
        force = h[::2] * x + h[1::2] * y
        rows.append(force / np.linalg.norm(force @ basis.quadrature.weight))
    return np.concatenate(rows)


def _field_strengths(basis: Basis, states: Array) -> Array:
    """(n, 2 n_point) of H at all points of the irons, point after point."""
    field = states @ basis.gradients.T
    one = np.ones(basis.quadrature.weight.size)
    magnetise_fields(field, basis.whole_iron()._replace(weight=one), np.empty((0, 0)))
    return np.asarray(field)
