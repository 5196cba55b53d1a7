"""The field solver against closed forms, manufactured solutions and its own energy; it knows nothing of E-cores."""

import numpy as np
import pytest
from conftest import ROOT
from field_problems import cubic_iron, observed_order, structured_mesh
from scipy.optimize import brentq
from skfem import Basis, ElementTriP2, ElementTriP3

from msl_fem.actuator import load_actuator
from msl_fem.errors import NotConverged
from msl_fem.magnetics.field.magnet_field import MagnetField, field_of, magnet_mesh
from msl_fem.magnetics.section import Section
from msl_fem.magnetics.solver.magnetostatics import (
    FieldModel,
    FieldSolution,
    NewtonSettings,
    field_response,
    solve_field,
)
from msl_fem.magnetics.solver.postprocess import Probes, evaluate_field
from msl_fem.magnetics.solver.tangent import SparseTangent
from msl_fem.magnetics.triangles import TriangleMesh
from msl_fem.materials.constants import MU_0
from msl_fem.materials.material import AnalyticIron, linear_iron, load_iron


def per_unit_depth(model: FieldModel) -> Probes:
    """Probes without cuts for a model that is the whole section, 1 m deep."""
    section = Section((), (), (), {}, {}, depth=0.5, gap=model.mesh.gap)
    return Probes(model, section)


@pytest.fixture(scope="module")
def e1_field() -> MagnetField:
    return field_of(load_actuator(ROOT / "geometries" / "e1.toml"), 5e-4, accuracy="fast")


# --- closed forms -----------------------------------------------------------------------------------------------------


def yoked_window(turns: float, *, permeability: float = 1e9, order: int = 2) -> tuple[FieldModel, float, float]:
    """An air gap g x c that carries the winding itself, in an iron frame; its model, c and g.

    With infinite permeability Ampere's law over the gap gives B_y(x) = mu_0 N i (1 - x/c)/g, whatever y.
    """
    c, g, thick = 0.02, 1e-3, 0.005
    x = np.r_[np.linspace(0, c, 9), c + thick * np.array([0.5, 1.0])]
    y = np.r_[-thick, -thick / 2, np.linspace(0, g, 3), g + thick / 2, g + thick]
    mesh = structured_mesh(x, y, lambda u, v: "strip" if u < c and 0 < v < g else "iron", gap=g)
    iron = linear_iron(permeability)
    return FieldModel(mesh, {"iron": iron}, turns_density={"strip": turns / (c * g)}, order=order), c, g


@pytest.mark.parametrize("order", [2, 3])
@pytest.mark.parametrize("stretch", [1.0, 0.3, 2.5])
def test_gap_between_infinitely_permeable_faces(order, stretch):
    """lambda = mu_0 N^2 i c/(3 g), W' = i lambda/2, F = integral of B^2/(2 mu_0) = mu_0 (N i)^2 c/(6 g^2), 1 m deep."""
    turns, current = 100.0, 3.0
    model, c, g_mesh = yoked_window(turns, order=order)
    g = stretch * g_mesh
    got = evaluate_field(per_unit_depth(model), solve_field(model, current, g))
    inductance = MU_0 * turns**2 * c / (3 * g)
    force = MU_0 * (turns * current) ** 2 * c / (6 * g**2)
    assert got.flux_linkage == pytest.approx(inductance * current, rel=1e-6)
    assert got.coenergy == pytest.approx(inductance * current**2 / 2, rel=1e-6)
    assert got.force == pytest.approx(force, rel=1e-6)
    assert got.force_stress_tensor == pytest.approx(force, rel=1e-6)
    assert got.incremental_inductance == pytest.approx(inductance, rel=1e-6)
    assert got.force_current_slope == pytest.approx(2 * force / current, rel=1e-6)
    assert got.force_gap_slope == pytest.approx(-2 * force / g, rel=1e-6)


def test_finite_permeability_approaches_the_infinite_limit():
    """The iron's reluctance takes off a share that falls like 1/mu_r."""
    shortfall = []
    for mu_r in (1e4, 1e5, 1e6):
        model, c, g = yoked_window(100.0, permeability=mu_r)
        flux = evaluate_field(per_unit_depth(model), solve_field(model, 1.0, g)).flux_linkage
        shortfall.append(1 - flux / (MU_0 * 1e4 * c / (3 * g)))
    assert 5e-3 < shortfall[0] < 1e-2
    assert shortfall[1] / shortfall[0] == pytest.approx(0.1, rel=0.02)
    assert shortfall[2] / shortfall[1] == pytest.approx(0.1, rel=0.02)


def layered_field(current: float, g: float) -> dict[str, float]:
    """Flux linkage, coenergy and force per length and depth of plane layers, and B in the iron: Ampere's law in y."""
    t_iron, t_coil = LAYERS["iron"], LAYERS["coil"]
    iron = load_iron("analytic:e1")
    density = TURNS / t_coil

    def field_strength(y: np.ndarray, h_low: float) -> np.ndarray:
        """H_x falls from h_low by the current passed: dH_x/dy = -J_z."""
        return h_low - density * current * np.clip(y - t_iron - g, 0, t_coil)

    def iron_flux_density(h: float) -> float:
        return brentq(lambda b: float(iron.magnetise(np.array([b]))[0][0]) - h, 0, 20, xtol=1e-15)

    def total(h_low: float) -> float:
        """A at the top: the flux between the two boundaries must vanish."""
        b_iron = np.sign(h_low) * iron_flux_density(abs(h_low))
        coil = h_low * t_coil - density * current * t_coil**2 / 2
        return b_iron * t_iron + MU_0 * (h_low * g + coil)

    h_low = brentq(total, 0, abs(density * current * t_coil), xtol=1e-13)
    b_iron = iron_flux_density(h_low)
    a_coil = b_iron * t_iron + MU_0 * h_low * g  # A where the coil begins; there A = a + mu_0 (h s - n i s^2/2)
    linked = a_coil * t_coil + MU_0 * (h_low * t_coil**2 / 2 - density * current * t_coil**3 / 6)
    h_top = h_low - density * current * t_coil
    coil_energy = MU_0 * (h_low**3 - h_top**3) / (6 * density * current)
    energy = float(iron.energy_density(np.array(b_iron))) * t_iron + MU_0 * h_low**2 / 2 * g + coil_energy
    flux = density * linked
    return {"flux_linkage": flux, "coenergy": current * flux - energy, "force": -MU_0 * h_low**2 / 2, "iron": b_iron}


LAYERS, TURNS = {"iron": 2e-3, "coil": 2e-3}, 400.0


def test_plane_layers_the_unrolled_coaxial_cable():
    """Saturating iron, an air gap and a slab conductor between two flux lines A = 0, the field along the layers.

    The difference between a long and a longer stack leaves no end effect, and is exact in y alone. A field along the
    gap presses its faces apart: the force is negative.
    """
    g_mesh, g, current = 1e-3, 1.4e-3, 8000.0
    found = []
    for length in (0.06, 0.08):
        x = np.linspace(0, length, round(length / 2e-3) + 1)
        bottom, top = -LAYERS["iron"], g_mesh + LAYERS["coil"]
        y = np.unique(np.r_[np.linspace(bottom, 0, 5), np.linspace(0, g_mesh, 3), np.linspace(g_mesh, top, 5)])
        mesh = structured_mesh(x, y, lambda _, v: "iron" if v < 0 else "strip" if v < g_mesh else "coil", gap=g_mesh)
        model = FieldModel(
            mesh, {"iron": load_iron("analytic:e1")}, turns_density={"coil": TURNS / LAYERS["coil"]}, order=3
        )
        found.append(evaluate_field(per_unit_depth(model), solve_field(model, current, g)))
    wanted = layered_field(current, g)
    assert 1.6 < wanted.pop("iron") < 2.2, "the case is to be saturated"
    for name in wanted:
        difference = (getattr(found[1], name) - getattr(found[0], name)) / 0.02
        assert difference == pytest.approx(wanted[name], rel=1e-6), name
    stress = (found[1].force_stress_tensor - found[0].force_stress_tensor) / 0.02
    assert stress == pytest.approx(wanted["force"], rel=1e-6)


# --- order of convergence ---------------------------------------------------------------------------------------------


def manufactured_errors(order: int, n: int) -> tuple[float, float]:
    """L2 error of A and of grad A for A = a sin(pi x) sin(pi y) in a cubic iron on the unit square."""
    peak, knee, pi = 0.4, 1.0, np.pi
    iron = cubic_iron(knee=knee)
    nu = float(iron.magnetise(np.array([1e-9]))[0][0]) / 1e-9
    lines = np.linspace(0, 1, n + 1)
    model = FieldModel(
        structured_mesh(lines, lines, lambda u, v: "iron", gap=1.0), {"iron": iron}, turns_density={}, order=order
    )

    def exact(x, y):
        return peak * np.sin(pi * x) * np.sin(pi * y)

    def gradient(x, y):
        return peak * pi * np.stack([np.cos(pi * x) * np.sin(pi * y), np.sin(pi * x) * np.cos(pi * y)])

    def current_density(x, y):
        """-div(nu (1 + |grad A|^2/B_0^2) grad A)."""
        a_x, a_y = gradient(x, y)
        a_xx = a_yy = -(pi**2) * exact(x, y)
        a_xy = peak * pi**2 * np.cos(pi * x) * np.cos(pi * y)
        squared = a_x**2 + a_y**2
        along = 2 * (a_x * (a_xx * a_x + a_xy * a_y) + a_y * (a_xy * a_x + a_yy * a_y))
        return -nu * ((1 + squared / knee**2) * (a_xx + a_yy) + along / knee**2)

    element = {2: ElementTriP2, 3: ElementTriP3}[order]()
    basis = Basis(model.skfem_mesh, element, intorder=10)
    x, y = basis.global_coordinates()
    load = np.zeros(model.n_dof)
    for k in range(basis.Nbfun):
        np.add.at(load, basis.element_dofs[k], (current_density(x, y) * basis.basis[k][0] * basis.dx).sum(axis=1))
    model.source = load
    field = basis.interpolate(solve_field(model, 1.0, 1.0).potential)
    value = np.sqrt(np.sum((field - exact(x, y)) ** 2 * basis.dx))
    slope = np.sqrt(np.sum((field.grad - gradient(x, y)) ** 2 * basis.dx))
    return float(value), float(slope)


@pytest.mark.parametrize("order", [2, 3])
def test_order_of_convergence_in_a_nonlinear_iron(order):
    """Degree p: order p + 1 in L2 of A, p in the energy norm."""
    errors = np.array([manufactured_errors(order, n) for n in (8, 16)])
    assert observed_order(errors[:, 0]) == pytest.approx(order + 1, abs=0.15)
    assert observed_order(errors[:, 1]) == pytest.approx(order, abs=0.15)


# --- energy, gradient, tangent ----------------------------------------------------------------------------------------


def test_gradient_and_tangent_pass_taylor_tests(e1_field):
    """W(A + t v) - W - t W'v - t^2 vTv/2 falls like t^3, and W'(A + t v) - W' - t Tv like t^2."""
    model, gap = e1_field.model, 3e-4
    base = e1_field.solve(4.0, gap).potential
    direction = 0.4 * e1_field.solve(2.0, 5e-5).potential - 0.3 * e1_field.solve(9.0, 2e-3).potential
    direction[model.free] += 1e-7 * np.random.default_rng(3).standard_normal(model.free.size)
    gradient, data = model.assemble(base, gap)
    product = model.tangent.product(data, direction)
    energy, first, second = model.energy(base, gap), float(gradient @ direction), float(direction @ product)
    steps = np.array([0.04, 0.02])
    energies, gradients = [], []
    for t in steps:
        there = base + t * direction
        energies.append(abs(model.energy(there, gap) - energy - t * first - t**2 * second / 2))
        change = model.assemble(there, gap)[0] - gradient
        gradients.append(np.linalg.norm((change - t * product)[model.free]))
    assert observed_order(np.array(energies)) == pytest.approx(3, abs=0.15)
    assert observed_order(np.array(gradients)) == pytest.approx(2, abs=0.15)


def test_strip_products_are_derivatives_of_the_linear_product(e1_field):
    model = e1_field.model
    a = np.zeros(model.n_dof)
    a[model.free] = np.random.default_rng(0).standard_normal(model.free.size)
    gap, step = 4e-4, 1e-6
    first, second = (product[model.free] for product in model.strip_products(a, gap))
    ahead, behind = (model.linear_product(a, gap + s)[model.free] for s in (step, -step))
    assert np.abs((ahead - behind) / (2 * step) - first).max() < 1e-4 * np.abs(first).max()
    slopes = [model.strip_products(a, gap + s)[0][model.free] for s in (step, -step)]
    assert np.abs((slopes[0] - slopes[1]) / (2 * step) - second).max() < 1e-4 * np.abs(second).max()


@pytest.mark.parametrize("order", [2, 3])
def test_stretched_strip_equals_a_mesh_with_moved_nodes(order):
    """Scaling the strip's two stiffness parts is the same as assembling on moved nodes."""
    magnet = load_actuator(ROOT / "geometries" / "e1.toml").magnet
    mesh = magnet_mesh(magnet, 5e-4, "fast")
    moved = TriangleMesh(mesh.at_gap(2e-4), mesh.triangles, mesh.region, mesh.names, 2e-4)
    by_stretch, by_nodes = (MagnetField(magnet, m, folder=ROOT, order=order) for m in (mesh, moved))
    one, two = (f.quantities(f.solve(4.0, 2e-4)) for f in (by_stretch, by_nodes))
    for name in ("force", "force_stress_tensor", "flux_linkage", "coenergy", "force_gap_slope"):
        assert getattr(one, name) == pytest.approx(getattr(two, name), rel=1e-9), name
    for cut, value in one.flux_density.items():
        assert value.mean == pytest.approx(two.flux_density[cut].mean, rel=1e-9)


# --- derivatives of the coenergy --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("quantity", "derivative", "sign", "along"),
    [
        ("coenergy", "flux_linkage", 1, "current"),
        ("coenergy", "force", -1, "gap"),
        ("flux_linkage", "incremental_inductance", 1, "current"),
        ("flux_linkage", "force_current_slope", -1, "gap"),
        ("force", "force_current_slope", 1, "current"),
        ("force", "force_gap_slope", 1, "gap"),
    ],
)
def test_derivatives_of_the_discrete_coenergy(e1_field, quantity, derivative, sign, along):
    """Each against central differences of re-solved fields, at the order of the differences."""
    current, gap = 3.3, 3.5e-4

    def solved(step: float) -> float:
        i, g = (current + step, gap) if along == "current" else (current, gap + step * 1e-5)
        return float(getattr(e1_field.quantities(e1_field.solve(i, g)), quantity))

    here = e1_field.quantities(e1_field.solve(current, gap))
    unit = 1.0 if along == "current" else 1e-5
    steps = np.array([0.4, 0.2, 0.1]) * (1 if along == "current" else 10)
    slopes = np.array([(solved(s) - solved(-s)) / (2 * s * unit) for s in steps])
    errors = np.abs(slopes - sign * getattr(here, derivative))
    assert observed_order(errors) == pytest.approx(2, abs=0.25)
    assert errors[-1] < 2e-2 * abs(getattr(here, derivative))


def test_force_slope_is_reciprocal_on_the_discrete_solution(e1_field):
    """dF/di == -dlambda/dgap of the discrete field, by independent back-substitutions."""
    for current, gap in ((0.7, 2e-4), (5.0, 5e-4), (12.0, 1e-4)):
        solution = e1_field.solve(current, gap)
        by_gap = field_response(e1_field.model, solution).by_gap
        flux_slope = e1_field.probes.scale * float(e1_field.model.source @ by_gap)
        force_slope = e1_field.quantities(solution).force_current_slope
        assert force_slope == pytest.approx(-flux_slope, rel=1e-9)


# --- Newton -----------------------------------------------------------------------------------------------------------


def distance_left(field: MagnetField, solution: FieldSolution) -> float:
    """Energy norm of the step that one more full Newton iteration would take, relative to that of the field."""
    model, potential = field.model, solution.potential
    gradient, data = model.assemble(potential, solution.gap)
    model.tangent.factor(data)
    residual = gradient - solution.current * model.source
    return float(residual @ model.tangent.substitute(residual) / (potential @ gradient)) ** 0.5


def test_no_current_no_field(e1_field):
    solution = e1_field.solve(0.0, 5e-4)
    got = e1_field.quantities(solution)
    assert not solution.potential.any()
    assert (got.force, got.flux_linkage, got.coenergy, got.force_current_slope) == (0, 0, 0, 0)
    assert 0 < got.incremental_inductance < 0.1


@pytest.mark.parametrize("current", [1e-6, 6.0, 60.0, 6000.0])
def test_newton_converges_from_nothing_far_beyond_saturation(e1_field, current):
    """60 A is ten times the current of 1.6 T at this gap."""
    solution = e1_field.solve(current, 5e-4)
    assert len(solution.trail) < 20
    assert distance_left(e1_field, solution) < NewtonSettings().tolerance


@pytest.mark.parametrize("current", [0.0, 3.0, 60.0])
def test_newton_finds_the_one_solution_from_far_away(e1_field, current):
    known = e1_field.solve(current, 5e-4).potential
    far = -30 * e1_field.solve(60.0, 5e-4).potential
    rough = np.zeros_like(far)
    rough[e1_field.model.free] = np.random.default_rng(5).standard_normal(e1_field.model.free.size)
    for start in (far, rough):
        found = e1_field.solve(current, 5e-4, start=start).potential
        assert np.abs(found - known).max() <= 1e-6 * max(np.abs(known).max(), 1e-6)


@pytest.mark.parametrize("iron", ["m19", "m45", "steel_1010", "vanadium_permendur"])
def test_newton_converges_on_measured_curves(iron, servo):
    magnet = servo.magnet
    magnet = magnet.model_copy(update={"iron": magnet.iron.model_copy(update={"core": iron, "armature": iron})})
    field = MagnetField(magnet, magnet_mesh(magnet, 2e-4, "fast"), folder=ROOT, order=2)
    for current in (0.3, 60.0):
        solution = field.solve(current, 2e-4)
        # the stopping rule foresees the next step from the last two; a curve with kinks in dH/dB can beat it a little
        assert distance_left(field, solution) < 10 * NewtonSettings().tolerance


@pytest.mark.parametrize("tolerance", [1e-4, 1e-7])
def test_kept_factors_lead_to_the_same_field_with_fewer_of_them(e1_field, servo, tolerance, monkeypatch):
    """From starts near and far, with a smooth curve and one of points: no further away than the tolerance says."""
    measured = MagnetField(servo.magnet, magnet_mesh(servo.magnet, 5e-4, "fast"), folder=ROOT, order=2)
    factored: list[int] = []
    factor = SparseTangent.factor

    def counted(tangent: SparseTangent, data: np.ndarray) -> None:
        factored.append(1)
        factor(tangent, data)

    monkeypatch.setattr(SparseTangent, "factor", counted)
    for field in (e1_field, measured):
        known = field.solve(8.0, 5e-4).potential
        for start in (1.01 * known, 0.7 * known, -3 * known, None):
            counts = []
            for kept in (0, 4):
                factored.clear()
                settings = NewtonSettings(tolerance, kept=kept)
                solution = solve_field(field.model, 8.0, 5e-4, start=start, settings=settings)
                counts.append(len(factored))
                assert distance_left(field, solution) < 10 * tolerance
            assert counts[1] <= counts[0]
    assert counts[1] < counts[0]


def test_too_few_iterations_are_said_with_the_trail(e1_field):
    with pytest.raises(NotConverged, match=r"8 A and gap 0\.5 mm.*1 Newton steps.*relative steps \d") as caught:
        solve_field(e1_field.model, 8.0, 5e-4, settings=NewtonSettings(iterations=1))
    assert "B-H curve" in str(caught.value)


def test_what_is_not_a_number_never_passes_for_a_solution(e1_field):
    start = np.full(e1_field.model.n_dof, np.nan)
    with pytest.raises(NotConverged, match="nan"):
        e1_field.solve(3.0, 5e-4, start=start)


def test_negative_current_mirrors_the_field(e1_field):
    plus, minus = (e1_field.quantities(e1_field.solve(i, 5e-4)) for i in (7.0, -7.0))
    assert minus.force == pytest.approx(plus.force, rel=1e-10)
    assert minus.flux_linkage == pytest.approx(-plus.flux_linkage, rel=1e-10)
    assert minus.coenergy == pytest.approx(plus.coenergy, rel=1e-10)
    assert minus.force_current_slope == pytest.approx(-plus.force_current_slope, rel=1e-8)


PERFECT = AnalyticIron(
    name="perfect",
    law=lambda b: (np.zeros_like(b), np.zeros_like(b)),
    energy_law=np.zeros_like,
    source="test",
)


def test_singular_tangent_is_not_converged(e1_field):
    """An iron without field strength has no unique field; the solver says so, and is none the worse for it."""
    model = FieldModel(
        e1_field.model.mesh,
        {"core": linear_iron(1000.0), "armature": PERFECT},
        turns_density=e1_field.section.turns_density,
    )
    with pytest.raises(NotConverged, match="B-H curve"):
        solve_field(model, 3.0, 5e-4)
    model.irons["armature"].iron = linear_iron(1000.0)
    assert len(solve_field(model, 3.0, 5e-4).trail) <= 2
