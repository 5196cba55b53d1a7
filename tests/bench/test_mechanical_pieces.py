"""Friction, film, flexure and attached mass against closed forms and slow twins."""

import numpy as np
import pytest
from bench_rigs import RATE, SERVO, plain_rig
from scipy.integrate import solve_ivp
from scipy.sparse import diags, eye, kron
from scipy.sparse.linalg import spsolve

from msl_fem.bench.catalogue import branches
from msl_fem.bench.equations import film_numbers, finite_length, friction_force, plate_damping, stretch_force
from msl_fem.bench.plant import Attached, FlexureLaw, Friction
from msl_fem.bench.running import run_rig

LUGRE = Friction(coulomb=1.0, breakaway=1.5, stribeck_velocity=1e-3, bristle_stiffness=1e6, bristle_damping=300.0)


def test_lugre_slides_with_coulomb_and_stribeck() -> None:
    """At constant speed the force is F_c + (F_s - F_c) exp(-(v/v_s)^2), against the motion."""
    for speed in (-0.1, -5e-4, 2e-4, 0.05):
        level = 1.0 + 0.5 * np.exp(-((speed / 1e-3) ** 2))
        force, rate = friction_force(LUGRE, speed, np.sign(speed) * level / 1e6)
        assert rate == pytest.approx(0.0, abs=1e-12)
        assert force == pytest.approx(np.sign(speed) * level)


def test_lugre_breaks_away_at_its_force() -> None:
    """A slow ramp of force: the mover holds to micrometres below the break-away force and runs off above it."""
    rig = plain_rig("force")
    free = rig.with_parts(friction=LUGRE, motion=rig.plant.motion._replace(stiffness=0.0, damping=0.0, travel=np.inf))
    force = np.linspace(0.0, 1.6, 5000)
    run = run_rig(free, force[:, None], rate=RATE, substeps=20)
    gone = float(force[np.argmax(np.abs(run.position) > 2e-5)])
    assert 1.3 < gone < 1.6
    slow = force < 1.2  # quasi-static: z' = v (1 - s0 z/F_s) and z = F/s0, so x = -F_s/s0 ln(1 - F/F_s)
    assert run.position[slow] == pytest.approx(-1.5e-6 * np.log(1 - force[slow] / 1.5), abs=3e-8)


def pressure_damping(width: float, length: float, gap: float, viscosity: float, n: int) -> float:
    """Reynolds' equation by finite differences: laplace(p) = -12 eta v/g^3, p = 0 at the edges; F/v."""
    x, y = width / n, length / n
    second = diags([1.0, -2.0, 1.0], [-1, 0, 1], shape=(n - 1, n - 1))
    laplace = kron(second, eye(n - 1)) / x**2 + kron(eye(n - 1), second) / y**2
    p = spsolve(laplace.tocsc(), np.full((n - 1) ** 2, -12 * viscosity / gap**3))
    return float(p.sum() * x * y)


@pytest.mark.parametrize(("width", "length"), [(0.01, 0.01), (0.005, 0.02), (0.02, 0.005)])
def test_film_solves_reynolds(width: float, length: float) -> None:
    found = plate_damping(width, length, gap=6e-4, viscosity=1e-3)
    coarse, fine = (pressure_damping(width, length, 6e-4, 1e-3, n) for n in (40, 80))
    assert found == pytest.approx(fine + (fine - coarse) / 3, rel=1e-4)


def test_film_of_a_long_plate() -> None:
    """F = eta l w^3 v/g^3 for an endless plate, and 0.4217 of it for a square (Hays)."""
    assert finite_length(1e-3, 10.0) == pytest.approx(1.0, abs=1e-3)
    assert plate_damping(0.01, 1e3, gap=1e-3, viscosity=2e-3) == pytest.approx(2e-3 * 1e3 * 1e-6 / 1e-9, rel=1e-4)
    assert finite_length(0.01, 0.01) == pytest.approx(0.4217, abs=1e-4)


def test_film_numbers_say_when_the_formula_holds() -> None:
    damping = 2 * 3 * plate_damping(0.005, 0.02, gap=6e-4)
    numbers = film_numbers(SERVO, damping, gap=6e-4, velocity=0.05, frequency=2000.0)
    assert 1.81e-6 < numbers["viscosity"] < 1.81e-4
    assert numbers["squeeze_number"] < 1e-3
    assert numbers["peak_pressure"] < 1e-3
    thick = film_numbers(SERVO, 1e5 * damping, gap=6e-4, velocity=0.05, frequency=2000.0)
    assert thick["squeeze_number"] > 1


def test_leaves_stretch_with_the_cube() -> None:
    f = FlexureLaw(2e5, 5e-3, 0, np.zeros(8), np.zeros(8))
    for x in (1e-4, -3e-4):
        exact = 2e5 * x * (1 - 1 / np.sqrt(1 + (x / 5e-3) ** 2))
        assert stretch_force(f, x) == pytest.approx(exact, rel=1e-9)
        assert stretch_force(f, x) == pytest.approx(2e5 * x**3 / (2 * 25e-6), rel=4e-3)


def test_relaxation_and_attached_mass_meet_an_adaptive_integrator() -> None:
    """The mechanical rig with a Maxwell branch, a cushion on it and an attached part, by DOP853 from the equations."""
    rig = plain_rig("force")
    m = rig.plant.motion
    part = Attached(0.2, 2 * np.pi * 250, 0.01)
    flexure = branches(rig.plant.flexure, np.array([3e4]), np.array([0.03]))._replace(cushion=2e9)
    commands = np.repeat([4.0, -2.0, 0.0, 3.0], 100)[:, None]
    run = run_rig(rig.with_parts(attached=part, flexure=flexure), commands, rate=RATE)

    def rate(_t: float, y: np.ndarray, push: float) -> list[float]:
        x, v, x2, v2, b = y
        inner = part.share * m.mass * (part.frequency**2 * (x2 - x) + 2 * 0.01 * part.frequency * (v2 - v))
        force = push - m.damping * v - m.stiffness * x - 3e4 * (x - b) - 2e9 * (x - b) * abs(x - b) + inner
        return [v, force / (0.8 * m.mass), v2, -inner / (0.2 * m.mass), (x - b) / 0.03]

    y, found = np.zeros(5), []
    for push in commands[:, 0]:
        found.append(y[0])
        y = solve_ivp(rate, (0, 1 / RATE), y, method="DOP853", rtol=1e-10, atol=1e-16, args=(push,)).y[:, -1]
    assert run.position == pytest.approx(np.array(found), abs=1e-7 * np.abs(run.position).max())
