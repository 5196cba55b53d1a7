"""One leaf's closed forms against integrals of its shape, each other, and Kirchhoff plates."""

import math
from dataclasses import replace

import numpy as np
import pytest
from skfem import Basis, BilinearForm, ElementTriMorley, MeshTri, condense, solve
from skfem.helpers import dd, ddot, trace

from msl_fem.actuator import FLEXURE_MATERIALS, GUIDED_MASS_SHARE, SAFETY, Leaf, flexure_material
from msl_fem.errors import InputError, MaterialError

STEEL = flexure_material("spring_steel")
LEAF = Leaf(54e-3, 25e-3, 1e-3, STEEL)
NODE, WEIGHT = np.polynomial.legendre.leggauss(8)
S, DS = (NODE + 1) / 2, WEIGHT / 2  # along the leaf, 0 ... 1
SHAPE, SLOPE, CURVATURE = 3 * S**2 - 2 * S**3, 6 * S - 6 * S**2, 6 - 12 * S


def test_stiffness_mass_share_and_cubic_term_are_integrals_of_the_guided_shape() -> None:
    assert LEAF.stiffness == pytest.approx(LEAF.bending_rigidity / LEAF.length**3 * float(DS @ CURVATURE**2), rel=1e-13)
    assert float(DS @ SHAPE**2) == pytest.approx(GUIDED_MASS_SHARE, rel=1e-13)
    # stretch x^2/(2 L) times the mean square slope, energy E A L/2 of its square's share of L: F = dU/dx
    mean_square = float(DS @ SLOPE**2)
    quartic = LEAF.axial_rigidity / (2 * LEAF.length**3) * (mean_square / 2) ** 2
    assert LEAF.cubic_stiffness == pytest.approx(4 * quartic, rel=1e-13)


def test_bending_stress_is_that_of_the_clamps_curvature() -> None:
    x, thick = 1e-4, LEAF.thickness
    moment = LEAF.bending_rigidity * 6 * x / LEAF.length**2
    assert LEAF.bending_stress(x) == pytest.approx(6 * moment / (LEAF.width * thick**2), rel=1e-13)
    assert LEAF.bending_stress(-x) == LEAF.bending_stress(x)


def kirchhoff_factor(ratio: float, poisson: float, n: int) -> float:
    """Stiffness of a clamped-guided Kirchhoff plate with free sides over that of a narrow beam, Morley elements."""
    mesh = MeshTri.init_tensor(np.linspace(0, ratio, max(2, round(n * ratio)) + 1), np.linspace(0, 1, n + 1))
    basis = Basis(mesh, ElementTriMorley())

    @BilinearForm
    def bending(u, v, _):  # type: ignore[no-untyped-def]
        both = ddot(dd(u), dd(v))
        return ((1 - poisson) * both + poisson * trace(dd(u)) * trace(dd(v))) / (1 - poisson**2)

    stiffness = bending.assemble(basis)
    ends = basis.get_dofs(lambda x: (x[1] < 1e-9) | (x[1] > 1 - 1e-9)).all()
    moved = basis.zeros()
    moved[basis.get_dofs(lambda x: x[1] > 1 - 1e-9).nodal["u"]] = 1.0
    w = solve(*condense(stiffness, x=moved, D=ends))
    return float(w @ stiffness @ w) / (12 * ratio)


@pytest.mark.parametrize(("ratio", "poisson"), [(0.1, 0.3), (0.46, 0.3), (0.46, 0.342), (1.0, 0.3)])
def test_the_plate_factor_is_a_kirchhoff_plates(ratio: float, poisson: float) -> None:
    """Two meshes and Richardson's extrapolation (energy of second order); narrow beam and wide plate are the limits."""
    coarse, fine = (kirchhoff_factor(ratio, poisson, n) for n in (24, 48))
    leaf = Leaf(1.0, ratio, 1e-3, replace(STEEL, poisson_ratio=poisson))
    assert leaf.plate_factor == pytest.approx((4 * fine - coarse) / 3, rel=2.5e-3)
    assert 1 < leaf.plate_factor < 1 / (1 - poisson**2)


def test_the_plate_factors_limits() -> None:
    assert Leaf(1.0, 1e-6, 1e-7, STEEL).plate_factor == pytest.approx(1.0, abs=1e-6)
    assert Leaf(1.0, 1e4, 1e-3, STEEL).plate_factor == pytest.approx(1 / (1 - 0.3**2), rel=1e-5)


def test_the_exact_force_starts_as_its_series_and_falls_behind_it() -> None:
    """F = k x + k_3 x^3 (1 - O((x/t)^2)): the remainder falls with the fifth power."""
    remainder = []
    for x in (1e-4, 2e-4):
        series = LEAF.stiffness * x + LEAF.cubic_stiffness * x**3
        remainder.append(series - LEAF.held_force(x))
    assert remainder[0] > 0
    assert math.log2(remainder[1] / remainder[0]) == pytest.approx(5, abs=0.15)
    assert LEAF.tension(1e-6) == pytest.approx(0.6 * LEAF.axial_rigidity * (1e-6 / LEAF.length) ** 2, rel=1e-5)
    assert LEAF.held_force(0.0) == 0.0
    assert LEAF.held_force(-2e-3) == -LEAF.held_force(2e-3)


def test_the_exact_force_is_smooth_and_ends_as_a_strings() -> None:
    """No jump where its series takes over; far beyond, T x/L with T = E A x^2/(2 L^2)."""
    x = np.linspace(1e-5, 3e-4, 4001)
    force = np.array([LEAF.held_force(float(v)) for v in x])
    assert np.abs(np.diff(force, 3)).max() < 2e-9 * force[-1]
    thin = Leaf(54e-3, 25e-3, 1e-6, STEEL)
    string = thin.axial_rigidity / 2 * (5e-3 / thin.length) ** 3
    assert thin.held_force(5e-3) == pytest.approx(string, rel=2e-3)


def test_large_displacements_are_refused() -> None:
    LEAF.check_displacement(5.39e-3)
    with pytest.raises(InputError, match=r"displacement 5\.5 mm is beyond 5\.4 mm"):
        LEAF.held_force(5.5e-3)


def test_materials() -> None:
    assert set(FLEXURE_MATERIALS) == {"spring_steel", "beryllium_copper", "titanium_6al4v", "aluminium_7075"}
    for material in FLEXURE_MATERIALS.values():
        assert 5e10 < material.youngs_modulus < 2.5e11
        assert 0.25 < material.poisson_ratio < 0.4
        assert 2e3 < material.density < 9e3
        assert material.allowed_stress == pytest.approx(material.fatigue_strength / SAFETY)
        assert len(material.source) > 20
    with pytest.raises(MaterialError, match=r"unknown flexure material 'tin'; choose one of spring_steel"):
        flexure_material("tin")
