"""Two magnets on either side of one armature in three dimensions: the plane limit, exact derivatives, exchange."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from msl_fem.actuator import Actuator, load_actuator
from msl_fem.errors import ActuatorError, InputError
from msl_fem.magnetics.field.pair_field import PairField, pair_magnet, pair_mesh
from msl_fem.magnetics.three_d.boxes import BoxModel, Racetrack, TwoRacetracks
from msl_fem.magnetics.three_d.coenergy_law import coenergy_curves
from msl_fem.magnetics.three_d.hexahedra import integration_points
from msl_fem.magnetics.three_d.pair_point import PairBoxes, SolidPairPoint, solve_solid_pair
from msl_fem.magnetics.three_d.readings import field_at
from msl_fem.magnetics.three_d.scalar_potential import PotentialSolution, solve_potential
from msl_fem.magnetics.three_d.tensor_grid import SizeNear
from msl_fem.materials.constants import MU_0
from msl_fem.materials.material import linear_iron

GEOMETRIES = Path(__file__).parents[2] / "geometries"
GAPS = 0.5e-3, 0.6e-3
CURRENTS = 3.0, -2.0


@pytest.fixture(scope="module")
def e1() -> Actuator:
    return load_actuator(GEOMETRIES / "e1.toml")


def flat_pair(e1: Actuator, currents: tuple[float, float], gaps: tuple[float, float] = GAPS) -> SolidPairPoint:
    return solve_solid_pair(e1, currents, gaps, accuracy="fast", ends=False)[0]


@pytest.fixture(scope="module")
def solved(e1: Actuator) -> tuple[SolidPairPoint, BoxModel, PotentialSolution]:
    return solve_solid_pair(e1, CURRENTS, GAPS, accuracy="fast", ends=False)


@pytest.fixture(scope="module")
def flat(solved: tuple[SolidPairPoint, BoxModel, PotentialSolution]) -> SolidPairPoint:
    return solved[0]


def test_one_layer_between_flux_lines_is_the_plane_pair(e1: Actuator, flat: SolidPairPoint) -> None:
    """Opposing currents on unequal gaps, on a coarse grid; all within 0.4 % at accuracy `normal`."""
    field = PairField(e1, pair_mesh(pair_magnet(e1), sum(GAPS) / 2, "fast"), gap_sum=sum(GAPS), order=2)
    solution = field.solve((GAPS[1] - GAPS[0]) / 2, *CURRENTS)
    plane = field.quantities(solution, CURRENTS)
    assert flat.net_force == pytest.approx(plane.force, rel=0.012)
    assert flat.flux_linkage == pytest.approx((plane.flux_linkage_1, plane.flux_linkage_2), rel=0.01)
    assert flat.coenergy == pytest.approx(plane.coenergy, rel=0.01)
    assert flat.mutual_inductance == pytest.approx(plane.mutual_inductance, rel=0.04)
    assert abs(flat.mutual_inductance / plane.mutual_inductance - 1) < flat.mutual_error
    assert flat.incremental_inductance[0] == pytest.approx(plane.incremental_inductance_1, rel=0.015)
    assert abs(flat.net_force - plane.force) < flat.net_force_error
    assert abs(flat.flux_linkage[0] - plane.flux_linkage_1) < flat.flux_error


def test_the_field_at_points_is_that_of_both_coils(solved: tuple[SolidPairPoint, BoxModel, PotentialSolution]) -> None:
    _, model, solution = solved
    grid = solution.problem.grid
    every = np.stack(grid.points(integration_points(grid.order)[0]), axis=-1)[::7].reshape(-1, 3)
    strength, flux, _ = field_at(model, solution, every)
    assert strength == pytest.approx(solution.state.strength[::7].reshape(-1, 3), rel=1e-9, abs=1e-6)
    assert flux == pytest.approx(solution.state.flux_density[::7].reshape(-1, 3), rel=1e-7, abs=1e-9)
    assert isinstance(model.coil, TwoRacetracks)
    for coil in (model.coil, model.coil.other):
        in_coil = coil.x[1] + coil.clearance + coil.width / 2, np.mean(coil.height), 0.0
        assert model.coil.has_turns(*(np.array([v]) for v in in_coil)).all()


def test_sides_may_change_their_places(e1: Actuator, flat: SolidPairPoint) -> None:
    other = flat_pair(e1, CURRENTS[::-1], GAPS[::-1])
    assert other.net_force == pytest.approx(-flat.net_force, rel=1e-6)
    assert other.flux_linkage == pytest.approx(flat.flux_linkage[::-1], rel=1e-6)
    assert other.mutual_inductance == pytest.approx(flat.mutual_inductance, rel=1e-5)


def test_flux_and_mutual_inductance_follow_the_other_current(e1: Actuator, flat: SolidPairPoint) -> None:
    step = 0.02
    up, down = (flat_pair(e1, (CURRENTS[0], CURRENTS[1] + s * step)) for s in (1, -1))
    by_other = (up.flux_linkage[0] - down.flux_linkage[0]) / (2 * step)
    assert by_other == pytest.approx(flat.mutual_inductance, rel=2e-3)
    assert (up.coenergy - down.coenergy) / (2 * step) == pytest.approx(flat.flux_linkage[1], rel=1e-4)


def loop(coil: Racetrack, away: float, height: float, n: int = 160) -> tuple[np.ndarray, np.ndarray]:
    """Middles and lengths along x, y, z of pieces of a turn about the coil's square, `away` from it."""
    half, angle = coil.x[1], np.linspace(0, np.pi / 2, n // 8 + 1)
    x = np.r_[np.linspace(-half, half, n // 8 + 1), half + away * np.sin(angle[1:])]
    z = np.r_[np.full(n // 8 + 1, half + away), half + away * np.cos(angle[1:])]
    quarter = np.column_stack([x, np.full(x.size, height), z])
    turn = np.array([[0, 0, 1], [0, 1, 0], [-1, 0, 0]])  # a quarter of a turn about y
    parts = [quarter]
    for _ in range(3):
        parts.append(parts[-1] @ turn.T)
    points = np.concatenate([part[:-1] for part in parts])
    steps = np.roll(points, -1, axis=0) - points
    return points + steps / 2, steps


def neumann(one: Racetrack, two: Racetrack) -> float:
    """Mutual inductance of two coils in air: Neumann's integral over filaments in Gauss points of both sections."""
    t, weight = np.polynomial.legendre.leggauss(3)

    def filaments(coil: Racetrack) -> list[tuple[float, np.ndarray, np.ndarray]]:
        return [
            (wr * wh / 4, *loop(coil, coil.clearance + coil.width * (1 + r) / 2, np.mean(coil.height) + h))
            for r, wr in zip(t, weight, strict=True)
            for h, wh in zip(np.ptp(coil.height) / 2 * t, weight, strict=True)
        ]

    total = 0.0
    for share, at, steps in filaments(one):
        for other, elsewhere, more in filaments(two):
            distance = np.linalg.norm(at[:, None] - elsewhere[None], axis=2)
            total += share * other * float(np.sum(steps @ more.T / distance))
    return MU_0 / (4 * np.pi) * one.turns * two.turns * total


def test_coils_in_air_have_the_mutual_inductance_of_neumann() -> None:
    one = Racetrack((-10e-3, 10e-3), (-10e-3, 10e-3), 2e-3, 6e-3, (3e-3, 15e-3), 100.0)
    two = replace(one, height=(-15e-3, -3e-3))
    far = 0.15
    near = (SizeNear(14e-3, 5e-3),)
    model = BoxModel(
        (),
        coenergy_curves([(linear_iron(1.0), 1.0)]),
        one,
        ((0.0, far), (-far, far), (0.0, far)),
        ((), (0.0, *two.height), ()),
        (near, (SizeNear(9e-3, 5e-3), SizeNear(-9e-3, 5e-3)), near),
    )
    problem, sources = PairBoxes(model, two, (6e-3, 6e-3), 0.0).sources(1.0)
    solution = solve_potential(problem, 1.0)
    mutual = model.copies * problem.integral(solution.state.flux_density[..., 1] * sources[1])
    assert mutual == pytest.approx(neumann(one, two), rel=0.01)


def test_what_cannot_be_a_pair_is_refused(e1: Actuator) -> None:
    with pytest.raises(ActuatorError, match="flat armature between"):
        solve_solid_pair(load_actuator(GEOMETRIES / "pot_core_holding.toml"), CURRENTS, GAPS)
    with pytest.raises(InputError, match="gap"):
        solve_solid_pair(e1, CURRENTS, (0.5e-3, -1e-3))
