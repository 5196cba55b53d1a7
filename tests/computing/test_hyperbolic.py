"""Hyperbolic functions of the kernel against NumPy's, near 0 too, and odd ones odd."""

import numpy as np
import pytest

from msl_fem.computing.lanes import hyperbolic_cosine, hyperbolic_sine, hyperbolic_tangent, inverse_hyperbolic_sine

AT = np.r_[0.0, 1e-300, 1e-12, np.geomspace(1e-6, 30.0, 300), 0.03 - 1e-9, 0.03 + 1e-9]


@pytest.mark.parametrize(
    ("function", "exact", "odd"),
    [
        (hyperbolic_sine, np.sinh, True),
        (hyperbolic_cosine, np.cosh, False),
        (hyperbolic_tangent, np.tanh, True),
        (inverse_hyperbolic_sine, np.arcsinh, True),
    ],
)
def test_relative_errors_are_of_rounding(function, exact, odd):
    found = np.array([function(float(a)) for a in AT])
    assert found == pytest.approx(exact(AT), rel=1e-14, abs=0.0)
    assert np.array_equal([function(-float(a)) for a in AT], -found if odd else found)
