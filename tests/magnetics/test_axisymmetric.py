"""The axisymmetric field against closed forms and manufactured solutions."""

import numpy as np
import pytest
from field_problems import cubic_iron, observed_order, structured_mesh
from scipy.optimize import brentq
from skfem import Basis, ElementTriP2, ElementTriP3

from msl_fem.magnetics.section import Region, Section
from msl_fem.magnetics.solver.magnetostatics import FieldModel, field_response, solve_field
from msl_fem.magnetics.solver.mesh import MeshSize, triangulate
from msl_fem.magnetics.solver.postprocess import triangle_flux_density
from msl_fem.magnetics.triangles import TriangleMesh
from msl_fem.materials.constants import MU_0
from msl_fem.materials.material import AnalyticIron, linear_iron, load_iron

TURNS, CURRENT = 100.0, 3.0


# --- closed forms -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("order", [2, 3])
@pytest.mark.parametrize("bore", [0.0, 6e-3])
def test_solenoid_between_permeable_plates_is_infinitely_long(order, bore):
    """H_z = N i/l in the bore a, falling linearly to 0 over the winding a < r < b, as image plates add no end.

    L = mu_0 N^2/l pi (a^2 + 2 t (b/3 - t/4)), t = b - a, from the field's energy. With a bore A has a term in 1/r.
    """
    b, length, thick = 0.01, 0.02, 0.004
    r = np.r_[np.linspace(0, b, 6), b + thick]
    z = np.r_[-thick, np.linspace(0, length, 5), length + thick]

    def region(u: float, v: float) -> str:
        inside = u < b and 0 < v < length
        return ("coil" if u > bore else "air") if inside else "iron"

    mesh = structured_mesh(r, z, region, gap=1.0)
    density = {"coil": TURNS / ((b - bore) * length)}
    model = FieldModel(mesh, {"iron": linear_iron(1e9)}, turns_density=density, order=order, axisymmetric=True)
    solution = solve_field(model, CURRENT, 1.0)
    t = b - bore
    inductance = MU_0 * TURNS**2 / length * np.pi * (bore**2 + 2 * t * (b / 3 - t / 4))
    assert model.source @ solution.potential == pytest.approx(inductance * CURRENT, rel=1e-5)
    assert model.energy(solution.potential, 1.0) == pytest.approx(inductance * CURRENT**2 / 2, rel=1e-5)
    assert model.source @ field_response(model, solution).by_current == pytest.approx(inductance, rel=1e-5)
    if bore:
        b_r, b_z = triangle_flux_density(model, solution)[:, mesh.elements("air")]
        assert b_z == pytest.approx(np.full(b_z.size, MU_0 * TURNS * CURRENT / length), rel=2e-4)
        assert np.abs(b_r).max() < 1e-3 * b_z.max()


@pytest.mark.parametrize("stretch", [1.0, 0.4, 2.5])
def test_gap_wound_on_itself_in_a_pot(stretch):
    """H_z = N i/g (1 - r/c) across the gap g: L = mu_0 N^2 pi c^2/(6 g), and the faces attract by dW'/dg."""
    c, g_mesh, thick = 0.01, 1e-3, 0.004
    r = np.r_[np.linspace(0, c, 6), c + thick]
    z = np.r_[-thick, np.linspace(0, g_mesh, 3), g_mesh + thick]
    mesh = structured_mesh(r, z, lambda u, v: "strip" if u < c and 0 < v < g_mesh else "iron", gap=g_mesh)
    density = {"strip": TURNS / (c * g_mesh)}
    model = FieldModel(mesh, {"iron": linear_iron(1e9)}, turns_density=density, axisymmetric=True)
    g = stretch * g_mesh
    a = solve_field(model, CURRENT, g).potential
    inductance = MU_0 * TURNS**2 * np.pi * c**2 / (6 * g)
    assert model.source @ a == pytest.approx(inductance * CURRENT, rel=1e-6)
    force = float(a @ model.strip_products(a, g)[0]) / 2
    assert force == pytest.approx(inductance * CURRENT**2 / 2 / g, rel=1e-6)


def ball(sides: int, *, radius: float, edge: float) -> TriangleMesh:
    angle = np.linspace(-np.pi / 2, np.pi / 2, sides + 1)
    ring = tuple(zip(radius * np.cos(angle).round(15), radius * np.sin(angle), strict=True))
    air = Region("air", ((0.0, -edge), (edge, -edge), (edge, edge), (0.0, edge)))
    section = Section((air, Region("ball", ring)), (), (), {"ball": ("", 1.0)}, {}, depth=1.0, gap=radius)
    return triangulate(section, MeshSize(iron=0.2))


BALLS = {
    "mu_r = 5": (linear_iron(5.0), 0.5),
    "mu_r = 1000": (linear_iron(1000.0), 0.5),
    "saturating": (load_iron("analytic:e1"), 1.1),
}


@pytest.mark.parametrize(("iron", "applied"), BALLS.values(), ids=BALLS.keys())
def test_iron_ball_in_a_uniform_field(iron: AnalyticIron, applied: float):
    """Uniform inside, B + 2 mu_0 H(B) = 3 B_0 for any curve, 3 mu_r B_0/(mu_r + 2) if linear; a dipole outside.

    The outer boundary holds the exact A; what is left is that the ball is a polygon.
    """

    def balance(b: float) -> float:
        return b + 2 * MU_0 * float(iron.magnetise(np.array([b]))[0][0]) - 3 * applied

    inside = brentq(balance, 0, 3 * applied, xtol=1e-14)
    radius, edge = 0.01, 0.03
    model = FieldModel(ball(32, radius=radius, edge=edge), {"ball": iron}, turns_density={}, axisymmetric=True)
    r, z = model.basis.doflocs
    distance = np.maximum(np.hypot(r, z), radius)
    exact = r / 2 * (applied + (inside - applied) * (radius / distance) ** 3)
    solution = solve_field(model, 1.0, radius, start=np.where(np.isin(np.arange(r.size), model.free), 0.0, exact))
    elements = model.mesh.elements("ball")
    _, b_z = triangle_flux_density(model, solution)[:, elements]
    weight = (model.basis.dx * model.basis.global_coordinates()[0])[elements].sum(axis=1)
    assert float(b_z @ weight / weight.sum()) == pytest.approx(inside, rel=3e-4)
    assert np.abs(solution.potential - exact).max() < 3e-3 * exact.max()


# --- order of convergence ---------------------------------------------------------------------------------------------


def manufactured_errors(order: int) -> tuple[np.ndarray, np.ndarray]:
    """Errors of B in the mean and on the axis for A = r p(r/c) sin(pi z/c) in saturating iron, p(1) = 0."""
    c = 0.05
    in_mean, on_axis = [], []
    for n in (4, 8, 16):
        lines = np.linspace(0, c, n + 1)
        mesh = structured_mesh(lines, lines, lambda u, v: "iron", gap=1.0)
        model = FieldModel(mesh, {"iron": cubic_iron()}, turns_density={}, order=order, axisymmetric=True)
        basis = Basis(model.skfem_mesh, {2: ElementTriP2, 3: ElementTriP3}[order](), intorder=2 * order + 4)
        r, z = basis.global_coordinates()
        q, phase = r / c, np.pi * z / c
        p, slope = 1 - q**2 + q**3 / 2 - q**5 / 2, -2 * q + 1.5 * q**2 - 2.5 * q**4
        exact = np.stack([(2 * p + q * slope) * np.sin(phase), r * p * np.pi / c * np.cos(phase)])  # B_z, -B_r
        size = np.hypot(*exact)
        field_strength = exact * cubic_iron().magnetise(size)[0] / size
        load = np.zeros(model.n_dof)
        for k in range(basis.Nbfun):
            shape = basis.basis[k][0]
            curl = np.stack([shape.grad[0] + np.asarray(shape) / r, shape.grad[1]])
            np.add.at(
                load, basis.element_dofs[k], (2 * np.pi * r * basis.dx * (curl * field_strength).sum(0)).sum(axis=1)
            )
        model.source = load
        a = basis.interpolate(solve_field(model, 1.0, 1.0).potential)
        error = np.stack([a.grad[0] + np.asarray(a) / r, a.grad[1]]) - exact
        weight = basis.dx * r
        in_mean.append(np.sqrt(((error**2).sum(0) * weight).sum() / (size**2 * weight).sum()))
        touching = mesh.points[0, mesh.triangles].min(axis=0) == 0
        on_axis.append(np.abs(error[:, touching]).max())
    return np.array(in_mean), np.array(on_axis)


@pytest.mark.parametrize("order", [2, 3])
def test_order_of_convergence_in_the_mean_and_on_the_axis(order):
    in_mean, on_axis = manufactured_errors(order)
    assert observed_order(in_mean) == pytest.approx(order, abs=0.15)
    assert observed_order(on_axis) > order - 0.15
