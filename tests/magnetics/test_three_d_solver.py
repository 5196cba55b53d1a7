"""The solver in three dimensions: curves and sheets, order, exact derivatives, closed forms, and what must fail."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import jnp_zeros, jv, jvp

from msl_fem.errors import ComputationError, NotConverged
from msl_fem.magnetics.three_d import multigrid, scalar_potential
from msl_fem.magnetics.three_d.boxes import Box, BoxModel, Racetrack
from msl_fem.magnetics.three_d.coenergy_law import CoenergyCurves, coenergy_curves, respond
from msl_fem.magnetics.three_d.forces import below, force_by_current, stress_on_plane, virtual_work
from msl_fem.magnetics.three_d.hexahedra import integration_points
from msl_fem.magnetics.three_d.scalar_potential import PotentialProblem, PotentialSolution, solve_potential
from msl_fem.magnetics.three_d.tensor_grid import SizeNear, TensorGrid, graded_planes
from msl_fem.materials.constants import MU_0
from msl_fem.materials.material import e1_iron, laminated, linear_iron, load_iron

NO_IRON = coenergy_curves([(linear_iron(1.0), 1.0)])


def answer(field: tuple[float, float, float], curves: CoenergyCurves) -> tuple[float, np.ndarray, np.ndarray]:
    flux, tangent = np.empty(3), np.empty(6)
    coenergy = respond(np.array(field), 0, curves, flux, tangent)
    return coenergy, flux, tangent


@pytest.mark.parametrize("iron", [e1_iron(), load_iron("m19"), linear_iron(1000.0)], ids=lambda iron: iron.name)
def test_the_curve_is_inverted_and_its_coenergy_belongs_to_it(iron) -> None:
    curves = coenergy_curves([(iron, 1.0)])
    for b in (0.0, 0.003, 0.7, 1.4, 1.9, 2.6):
        h, slope = (float(v) for v in iron.magnetise(b))
        coenergy, flux, tangent = answer((0.0, h, 0.0), curves)
        assert flux[1] == pytest.approx(b, rel=1e-6, abs=1e-12)
        assert tangent[1] == pytest.approx(1 / slope, rel=2e-3)
        assert coenergy == pytest.approx(h * b - float(iron.energy_density(b)), rel=1e-6, abs=1e-9)


@pytest.mark.parametrize("share", [1.0, 0.93])
def test_flux_density_and_tangent_are_derivatives_of_the_coenergy(share: float) -> None:
    curves = coenergy_curves([(load_iron("m19"), share)])
    names = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)]
    for field in ((40.0, -60.0, 30.0), (900.0, 200.0, -4e3), (2e5, 1e5, 3e5)):
        _, flux, tangent = answer(field, curves)
        step = 1e-4 * np.linalg.norm(field)
        for axis in range(3):
            up, down = (answer(tuple(np.array(field) + s * step * np.eye(3)[axis]), curves) for s in (1, -1))
            assert (up[0] - down[0]) / (2 * step) == pytest.approx(flux[axis], rel=1e-6, abs=1e-7)
            for k, pair in enumerate(names):
                if axis in pair:
                    other = pair[0] if pair[1] == axis else pair[1]
                    by = (up[1][other] - down[1][other]) / (2 * step)
                    assert by == pytest.approx(tangent[k], rel=1e-4, abs=1e-6 * tangent[:3].max())


def test_sheets_lie_parallel_in_their_plane_and_in_series_across() -> None:
    share, mu = 0.95, 800 * MU_0
    curves = coenergy_curves([(linear_iron(800.0), share)])
    _, flux, _ = answer((100.0, 0.0, 70.0), curves)
    assert flux[0] == pytest.approx(100 * (share * mu + (1 - share) * MU_0), rel=1e-9)
    assert flux[2] == pytest.approx(70 / (share / mu + (1 - share) / MU_0), rel=1e-9)
    iron = load_iron("m19")
    _, flux, _ = answer((300.0, 400.0, 0.0), coenergy_curves([(iron, share)]))
    assert float(laminated(iron, share).magnetise(np.linalg.norm(flux))[0]) == pytest.approx(500.0, rel=1e-3)


def cosine_problem(n: int, order: int) -> tuple[PotentialProblem, np.ndarray]:
    """T_0 = sin(pi y) cos(pi x) cos(pi z) in a cube of air; its phi = -cos cos cos/(3 pi)."""
    grid = TensorGrid((np.linspace(0, 1, n + 1),) * 3, order)
    x, y, z = grid.points(integration_points(order)[0])
    source = np.sin(np.pi * y) * np.cos(np.pi * x) * np.cos(np.pi * z)
    exact = np.stack(
        [
            -np.sin(np.pi * x) * np.cos(np.pi * y) * np.cos(np.pi * z),
            2 * source,
            -np.cos(np.pi * x) * np.cos(np.pi * y) * np.sin(np.pi * z),
        ],
        axis=-1,
    )
    exact /= 3
    held = np.zeros(grid.n_nodes, dtype=bool)
    held[0] = True
    return PotentialProblem(grid, np.full(n**3, -1), NO_IRON, source, held), exact


@pytest.mark.parametrize("order", [1, 2])
def test_the_field_converges_with_the_order_of_its_elements(order: int) -> None:
    errors = []
    for n in (4, 8):
        problem, exact = cosine_problem(n, order)
        solution = solve_potential(problem, 1.0, tolerance=1e-12)
        off = problem.integral(np.sum((solution.state.strength - exact) ** 2, axis=-1))
        errors.append(np.sqrt(off / problem.integral(np.sum(exact**2, axis=-1))))
    assert np.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.15)
    assert errors[1] < 0.12**order


def bessel_problem(n: int) -> tuple[PotentialProblem, np.ndarray]:
    """phi = J_2(k r) cos(2 angle) cos(pi y) in a quarter of a cylinder of air; J_2'(k) = 0: its side is a flux line."""
    grid = TensorGrid((np.linspace(0, 1, n + 1), np.linspace(0, 1, n + 1), np.linspace(0, np.pi / 2, n + 1)), 2)
    r, y, angle = grid.points(integration_points(2)[0])
    k = float(jnp_zeros(2, 1)[0])
    source = -(k**2 + np.pi**2) / np.pi * jv(2, k * r) * np.cos(2 * angle) * np.sin(np.pi * y)
    exact = np.stack(
        [
            -k * jvp(2, k * r) * np.cos(2 * angle) * np.cos(np.pi * y),
            source + np.pi * jv(2, k * r) * np.cos(2 * angle) * np.sin(np.pi * y),
            2 / r * jv(2, k * r) * np.sin(2 * angle) * np.cos(np.pi * y),
        ],
        axis=-1,
    )
    held = np.zeros(grid.n_nodes, dtype=bool)
    held[-1] = True
    return PotentialProblem(grid, np.full(n**3, -1), NO_IRON, source, held, polar=True), exact


def test_about_an_axis_the_field_converges_with_the_order_of_its_elements() -> None:
    errors = []
    for n in (4, 8):
        problem, exact = bessel_problem(n)
        solution = solve_potential(problem, 1.0, tolerance=1e-12)
        off = problem.integral(np.sum((solution.state.strength - exact) ** 2, axis=-1))
        errors.append(np.sqrt(off / problem.integral(np.sum(exact**2, axis=-1))))
    assert problem.integral(np.ones_like(problem.radius)) == pytest.approx(np.pi / 4)
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2, abs=0.15)
    assert errors[1] < 0.01


def test_a_racetrack_in_air_has_the_field_of_biot_and_savart() -> None:
    """At the coil's centre; the box is wide, and the air's faces are flux lines."""
    coil = Racetrack((-10e-3, 10e-3), (-10e-3, 10e-3), 2e-3, 6e-3, (0.0, 12e-3), 100.0)
    far = 0.12
    model = BoxModel(
        boxes=(),
        curves=NO_IRON,
        coil=coil,
        air=((0.0, far), (6e-3 - far, 6e-3 + far), (0.0, far)),
        breaks=((), (6e-3,), ()),
        near=((SizeNear(14e-3, 4e-3),), (SizeNear(6e-3, 4e-3),), (SizeNear(14e-3, 4e-3),)),
    )
    solution = solve_potential(model.problem(1.0), 3.0)
    grid = solution.problem.grid
    row = int(np.searchsorted(grid.planes[1], 6e-3)) * 2
    slope = np.diff(solution.potential.reshape(grid.nodes)[0, row - 1 : row + 2, 0]) / np.diff(
        grid.axis_nodes(1)[row - 1 : row + 2]
    )
    field = 3.0 * 100 / 12e-3 - slope.mean()
    assert field == pytest.approx(centre_field(coil, 3.0), rel=4e-3)


def centre_field(coil: Racetrack, current: float) -> float:
    """H_y in the middle of a square racetrack, by filaments: straight sides and arcs about the rectangle's corners."""
    half = coil.x[1]
    t, weight = np.polynomial.legendre.leggauss(12)
    total = 0.0
    for r, wr in zip(coil.clearance + coil.width * (t + 1) / 2, weight / 2, strict=True):
        for height, wh in zip((coil.height[1] - coil.height[0]) / 2 * t, weight / 2, strict=True):
            s = half * t
            away = np.sqrt(s**2 + (half + r) ** 2 + height**2)
            sides = 4 * np.sum(half * weight * (half + r) / away**3)
            angle = np.pi / 4 * (t + 1)
            x, z = half + r * np.cos(angle), half + r * np.sin(angle)
            turning = r * (x * np.cos(angle) + z * np.sin(angle))
            arcs = 4 * np.sum(np.pi / 4 * weight * turning / np.sqrt(x**2 + z**2 + height**2) ** 3)
            total += wr * wh * (sides + arcs)
    return current * coil.turns * total / (4 * np.pi)


GAP = (0.0, 1e-3)


def small_magnet(gap: float = 1e-3) -> BoxModel:
    """A bar in a coil over a plate, in four planes of elements: all that derivatives need."""
    coil = Racetrack((-5e-3, 5e-3), (-5e-3, 5e-3), 1e-3, 4e-3, (gap + 2e-3, gap + 10e-3), 600.0)
    irons = coenergy_curves([(load_iron("m19"), 0.95), (load_iron("pure_iron"), 1.0)])
    return BoxModel(
        boxes=(
            Box(1, (0.0, 8e-3), (-4e-3, 0.0), (0.0, 8e-3)),
            Box(0, (0.0, 5e-3), (gap, gap + 12e-3), (0.0, 5e-3)),
        ),
        curves=irons,
        coil=coil,
        air=((0.0, 30e-3), (-20e-3, gap + 30e-3), (0.0, 30e-3)),
        breaks=((), (0.0, gap), ()),
        near=((SizeNear(5e-3, 2e-3),), (SizeNear(0.0, 1e-3),), (SizeNear(5e-3, 2e-3),)),
    )


def with_gap(problem: PotentialProblem, gap: float) -> PotentialProblem:
    """The same elements where the strip is stretched and all above it is shifted."""
    x, y, z = problem.grid.planes
    moved = np.where(y < GAP[1] - 1e-9, np.maximum(y, 0) * gap / GAP[1] + np.minimum(y, 0), y + gap - GAP[1])
    return replace(problem, grid=TensorGrid((x, moved, z), problem.grid.order))


@pytest.fixture(scope="module")
def problem() -> PotentialProblem:
    return small_magnet().problem(0.6)


@pytest.fixture(scope="module")
def solution(problem: PotentialProblem) -> PotentialSolution:
    return solve_potential(problem, 6.0, tolerance=1e-15)


def test_force_is_the_exact_derivative_of_the_coenergy(problem, solution) -> None:
    step = 1e-6
    start = solution.potential
    up, down = (
        solve_potential(with_gap(problem, GAP[1] + s * step), 6.0, start=start, tolerance=1e-15).coenergy
        for s in (1, -1)
    )
    force = virtual_work(solution, below(problem.grid, GAP))
    assert solution.state.flux_density.max() > 1.5, "the point is saturated"
    assert -(up - down) / (2 * step) == pytest.approx(force, rel=2e-6)


def test_flux_linkage_inductance_and_the_force_follow_the_current(problem, solution) -> None:
    step = 1e-3
    weight = below(problem.grid, GAP)
    up, down = (solve_potential(problem, 6.0 + s * step, start=solution.potential, tolerance=1e-15) for s in (1, -1))

    def linkage(at: PotentialSolution) -> float:
        return problem.integral(at.state.flux_density[..., 1] * problem.source)

    assert (up.coenergy - down.coenergy) / (2 * step) == pytest.approx(linkage(solution), rel=1e-6)
    change = solution.by_current
    inductance = problem.integral(
        np.sum(scalar_potential.apply_tangent(solution.state.tangent, change) * change, axis=-1)
    )
    assert (linkage(up) - linkage(down)) / (2 * step) == pytest.approx(inductance, rel=1e-5)
    slope = (virtual_work(up, weight) - virtual_work(down, weight)) / (2 * step)
    assert slope == pytest.approx(force_by_current(solution, weight), rel=1e-5)


def test_the_stress_on_a_plane_in_the_gap_agrees_with_virtual_work(problem, solution) -> None:
    force = virtual_work(solution, below(problem.grid, GAP))
    assert stress_on_plane(solution, GAP) == pytest.approx(force, rel=0.05)


def test_no_current_no_field(problem) -> None:
    solution = solve_potential(problem, 0.0)
    assert solution.coenergy == 0.0
    assert not solution.state.flux_density.any()


def test_an_iteration_that_does_not_converge_says_so(problem, monkeypatch) -> None:
    monkeypatch.setattr(scalar_potential, "MOST_STEPS", 2)
    with pytest.raises(NotConverged, match="did not converge in 2 steps"):
        solve_potential(problem, 6.0)
    monkeypatch.setattr(multigrid, "MOST_STEPS", 1)
    with pytest.raises(ComputationError, match="conjugate gradients did not converge in 1 steps"):
        solve_potential(problem, 6.0)


def test_planes_are_dense_where_they_must_be() -> None:
    planes = graded_planes([0.0, 1.0, 1.0 + 1e-14, 4.0], [SizeNear(1.0, 0.05)], growth=0.5)
    sizes = np.diff(planes)
    assert planes[0] == 0.0
    assert planes[-1] == 4.0
    assert 1.0 in planes
    near = int(np.argmin(np.abs(planes - 1.0)))
    assert sizes[near] == pytest.approx(0.05, rel=0.5)
    assert sizes.min() > 0.02
    assert sizes.max() == sizes[-1] > 0.5
