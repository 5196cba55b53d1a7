"""The physics of each mechanical effect, where its answer is known."""

import numpy as np
import pytest
from coupled_twin import changed
from effect_sets import effects, rig
from scipy.linalg import expm

from msl_fem.actuator import Actuator
from msl_fem.plant import kernel
from msl_fem.plant.effects import EffectValues, MoverMotion, needed_force, values_of
from msl_fem.plant.excitation import Inputs
from msl_fem.plant.layout import N_INTEGRATED, V, initial_state
from msl_fem.plant.plant import plant_parameters, surface_of
from msl_fem.plant.preparation import effect_coefficients, start_effects
from msl_fem.plant.simulate import Options, simulate
from msl_fem.table.magnetic_table import MagneticTable

FINE = Options(substeps=64)


def held_steps(a: np.ndarray, b: np.ndarray, forces: np.ndarray, period: float) -> np.ndarray:
    """States (n, n_state) of y' = a y + b f from rest, f held over each period: the exact answer."""
    n = b.size
    big = expm(period * np.block([[a, b[:, None]], [np.zeros((1, n + 1))]]))
    states = np.zeros((forces.size, n))
    for k in range(forces.size - 1):
        states[k + 1] = big[:n, :n] @ states[k] + big[:n, n] * forces[k]
    return states


def test_a_second_mass_is_a_second_mass() -> None:
    """0.45 kg on the spring carry 0.05 kg on a spring of 60 Hz: states x, x', q, q' in closed form; two readings."""
    mass, k, c, share, w, zeta = 0.5, 2000.0, 8.0, 0.1, 2 * np.pi * 60.0, 0.03
    link = share / (1 - share)
    top = np.array([-k / (0.9 * mass), -c / (0.9 * mass), link * w**2, link * 2 * zeta * w])
    a = np.array([[0, 1, 0, 0], top, [0, 0, 0, 1], -top - [0, 0, w**2, 2 * zeta * w]])
    b = np.array([0, 1, 0, -1]) / (0.9 * mass)
    forces = 10 * np.random.default_rng(1).standard_normal(400)
    exact = held_steps(a, b, forces, 1e-3)
    for reading in (0.0, 1.0):
        values = effects("structural_mode", mass_share=share, frequency=60.0, damping_ratio=zeta, load_reading=reading)
        run = simulate(rig(), None, Inputs(forces[:, None], 1e3), effects=values, options=FINE)
        assert run.position == pytest.approx(exact[:, 0], abs=1e-9 * np.abs(exact[:, 0]).max())
        seen = exact[:, 0] + reading * exact[:, 2]
        assert run.measured_position == pytest.approx(seen, abs=1e-9 * np.abs(seen).max())
        assert run.audit.internal > 0
        assert abs(run.audit.imbalance) < 1e-9


def test_a_flexure_creeps_and_recovers() -> None:
    """The standard linear solid under a force that comes and goes: m x'' + c x' + k x + r k (x - y), tau y' = x - y."""
    m, k, c, r, tau = 0.5, 2000.0, 80.0, 0.2, 0.3
    a = np.array([[0, 1, 0], [-k * (1 + r) / m, -c / m, k * r / m], [1 / tau, 0, -1 / tau]])
    forces = np.where(np.arange(3000) < 1500, 6.0, 0.0)
    exact = held_steps(a, np.array([0, 1 / m, 0]), forces, 1e-3)
    values = effects("flexure_relaxation", strength=r, time_constant=tau)
    run = simulate(rig(damping="80 N s/m"), None, Inputs(forces[:, None], 1e3), effects=values, options=FINE)
    assert run.position == pytest.approx(exact[:, 0], abs=1e-9 * 3e-3)
    assert run.position[150] == pytest.approx(6.0 / (k * (1 + r)), rel=0.1), "stiff in the beginning"
    assert run.position[1499] == pytest.approx(6.0 / k, rel=0.01), "relaxed in the end"
    assert 2e-5 < run.position[1700] < 6e-4, "and behind the force it returns slowly"
    assert run.position[2999] == pytest.approx(0.0, abs=1e-5)
    assert run.audit.internal > 0


def test_a_spectrum_of_relaxation_times_is_told_by_a_second_branch_a_decade_slower() -> None:
    """A generalised Maxwell model of two branches, by its matrix exponential; what they lose is in the audit."""
    m, k, c, tau, (r, s) = 0.5, 2000.0, 80.0, 0.02, (0.2, 0.1)
    a = np.array(
        [
            [0, 1, 0, 0],
            [-k * (1 + r + s) / m, -c / m, k * r / m, k * s / m],
            [1 / tau, 0, -1 / tau, 0],
            [0.1 / tau, 0, 0, -0.1 / tau],
        ]
    )
    forces = np.where(np.arange(1500) < 750, 6.0, 0.0)
    exact = held_steps(a, np.array([0, 1 / m, 0, 0]), forces, 1e-3)
    for fast, slow in ((r, s), (0.0, s)):
        values = effects("flexure_relaxation", strength=fast, slow_strength=slow, time_constant=tau)
        run = simulate(rig(damping="80 N s/m"), None, Inputs(forces[:, None], 1e3), effects=values, options=FINE)
        near = np.abs(run.position - exact[:, 0]).max()
        assert bool(near < 1e-9 * 3e-3) is (fast > 0)
        assert run.audit.internal > 0
        assert abs(run.audit.imbalance) < 1e-9


def test_what_relaxes_beside_a_mover_without_a_spring_is_told_over_one_of_twenty_hertz() -> None:
    """As cables and hoses do: the standard linear solid alone, by its matrix exponential."""
    r, tau, bench = 0.3, 0.05, changed(rig(damping="80 N s/m"), motion={"stiffness": 0.0})
    m, c = plant_parameters(bench).mass, 80.0
    relaxing = r * m * (2 * np.pi * 20.0) ** 2
    a = np.array([[0, 1, 0], [-relaxing / m, -c / m, relaxing / m], [1 / tau, 0, -1 / tau]])
    forces = np.where(np.arange(400) < 100, 6.0, -2.0)
    exact = held_steps(a, np.array([0, 1 / m, 0]), forces, 1e-3)
    values = effects("flexure_relaxation", strength=r, time_constant=tau)
    run = simulate(bench, None, Inputs(forces[:, None], 1e3), effects=values, options=FINE)
    free = simulate(bench, None, Inputs(forces[:, None], 1e3), options=FINE)
    n = min(len(run.position), len(free.position), 150)
    assert run.position[:n] == pytest.approx(exact[:n, 0], abs=1e-9 * 3e-3)
    assert free.position[60] > 1.2 * run.position[60] > 0


def test_a_cubic_spring_holds_its_force() -> None:
    bench = rig(damping="60 N s/m")
    values = effects("stiffness_nonlinearity", cubic=4e8, quadratic=2e5)
    run = simulate(bench, None, Inputs(np.full((2000, 1), 6.0), 1e3), effects=values)
    x = run.position[-1]
    assert 2000 * x + 2e5 * x**2 + 4e8 * x**3 == pytest.approx(6.0, rel=1e-6)
    assert 4e8 * x**3 > 0.5


def test_a_force_offset_is_a_constant_force() -> None:
    inputs = Inputs(np.random.default_rng(2).standard_normal((200, 1)), 1e3)
    one = simulate(rig(), None, inputs, effects=effects("force_offset", force=1.5))
    two = simulate(changed(rig(), motion={"constant_force": 1.5}), None, inputs)
    assert one.position == pytest.approx(two.position, rel=1e-13)
    assert one.audit.external == pytest.approx(two.audit.external, rel=1e-12)


def test_friction_sticks_below_its_force_and_slides_above() -> None:
    """Without a spring: below 2 N the mover stays where the stops hold it, above it goes and does not come back."""
    loose = rig(stiffness="0 N/m", damping="40 N s/m")
    values = effects("coulomb_friction", force=2.0, presliding=1e-5)
    push = np.r_[np.linspace(0, 1.9, 1000), np.full(500, 1.9), np.full(500, 2.5), np.zeros(1500)]
    run = simulate(loose, None, Inputs(push[:, None], 1e3), effects=values)
    stuck = run.position[1000:1500]
    assert np.ptp(stuck) < 1e-2 * 1e-5
    assert 0 < stuck[0] < 1e-5
    assert run.position[1999] > 1e-3
    assert np.ptp(run.position[2500:]) < 1e-7
    assert run.position[-1] == pytest.approx(run.position[1999:].max(), abs=1.5e-5), "only the elastic part returns"
    assert run.audit.friction > 0.9 * 2.0 * run.position[-1]


def test_friction_takes_four_forces_over_the_stiffness_from_every_cycle() -> None:
    """Free oscillation with dry friction: the amplitude falls by 4 F/k a period, whatever its size."""
    free = rig(damping="0 N s/m")
    values = effects("coulomb_friction", force=0.05, presliding=1e-7)
    run = simulate(
        free, None, Inputs(np.zeros((2000, 1)), 1e4), effects=values, options=Options(position=2e-3, substeps=40)
    )
    x = run.position
    peaks = x[1:-1][(x[1:-1] > x[:-2]) & (x[1:-1] >= x[2:])]
    assert -np.diff(np.r_[2e-3, peaks]) == pytest.approx(4 * 0.05 / 2000, rel=0.02)
    assert abs(run.audit.imbalance) < 1e-6


def test_a_small_cycle_of_friction_is_a_closed_loop_at_any_speed() -> None:
    """Slow cycles of force below the limit: the position repeats, lags, and does so at a quarter of the speed."""
    bench = rig(damping="5 N s/m")
    values = effects("coulomb_friction", force=2.0, presliding=1e-3)
    found = []
    for rate in (400.0, 100.0):
        push = 1.5 * np.sin(2 * np.pi * np.arange(3000) / 1000)
        found.append(simulate(bench, None, Inputs(push[:, None], rate), effects=values).position)
    assert found[0][2000:] == pytest.approx(found[0][1000:2000], abs=1e-8)
    assert found[0][2000] < -1e-5, "remanence, in metres"
    assert found[0][2000:] == pytest.approx(found[1][2000:], abs=1e-2 * found[0].max())


def test_an_air_film_damps_with_the_cube_of_its_closeness(servo: Actuator, table: MagneticTable) -> None:
    plant, surface = plant_parameters(servo), surface_of(table)
    e = effect_coefficients(plant, surface, effects("squeeze_film", damping=3.0), step=1e-5, n_step=10)
    for x in (0.0, 3e-4):
        slopes = []
        for v in (0.0, 0.1):
            state, dy = initial_state(plant, 0.0, 0.0, x, v), np.zeros(N_INTEGRATED)
            start_effects(surface, plant, e, state)
            assert kernel.rates_at(surface, plant, e, state, np.zeros(5), dy)
            slopes.append(plant.mass * dy[V])
        closeness = (6e-4 / (6e-4 - x)) ** 3 + (6e-4 / (6e-4 + x)) ** 3
        assert (slopes[0] - slopes[1]) / 0.1 == pytest.approx(12.0 + 3.0 * closeness, rel=1e-9)


def test_a_base_that_gives_way_brings_the_magnets_nearer(servo: Actuator, table: MagneticTable) -> None:
    """At rest: n F(g_0 - (x - b)) - n F(g_0 + (x - b)) = k x with b = -kappa times that force."""
    soft = changed(servo, motion={"damping": 600.0}, position_sensor={"bandwidth": None})
    values = effects("support_compliance", compliance=2e-8, damping_ratio=0.7)
    currents = (0.6, 0.2)
    run = simulate(soft, table, Inputs(np.tile(currents, (4000, 1)), 1e4), effects=values)
    x = run.position[-1]
    b = -2e-8 * 1.4e5 * x
    force = 2 * table.force(0.6, 6e-4 - (x - b)) - 2 * table.force(0.2, 6e-4 + (x - b))
    assert force == pytest.approx(1.4e5 * x, rel=1e-6)
    assert run.flux_linkage[-1, 0] == pytest.approx(2 * table.flux_linkage(0.6, 6e-4 - (x - b)), rel=1e-8)
    assert run.measured_position[-1] == x, "the sensor stands on the ground"
    assert abs(b) > 1e-7
    assert abs(run.audit.imbalance) < 1e-6
    plain = simulate(soft, table, Inputs(np.tile(currents, (4000, 1)), 1e4)).position[-1]
    assert abs(x / plain - 1) > 1e-3


@pytest.mark.parametrize("names", [("force_cosine", "force_sine"), ("third_cosine", "third_sine")])
def test_a_periodic_force_moves_a_free_mass(names: tuple[str, str]) -> None:
    """m x'' = a cos w t + b sin w t from rest: x = (a (1 - cos w t) + b (w t - sin w t))/(m w^2); of a third harmonic
    w is three times as much."""
    free = rig(stiffness="0 N/m", damping="0 N s/m")
    values = EffectValues({"periodic_disturbance": {names[0]: 2.0, names[1]: 1.0, "frequency": 37.0}})
    run = simulate(free, None, Inputs(np.zeros((1000, 1)), 1e3), effects=values, options=FINE)
    w = 2 * np.pi * 37.0 * (3 if names[0] == "third_cosine" else 1)
    exact = (2.0 * (1 - np.cos(w * run.time)) + w * run.time - np.sin(w * run.time)) / (0.5 * w**2)
    assert run.position == pytest.approx(exact, rel=1e-8, abs=1e-13)


def test_a_periodic_force_is_what_a_mover_needs_less() -> None:
    time = np.linspace(0.0, 0.1, 7)
    motion = MoverMotion(time, *np.zeros((4, 7)))
    values = values_of(EffectValues({"periodic_disturbance": {"third_cosine": 2.0, "third_sine": 1.0}}).vector())
    w = 2 * np.pi * 150.0
    needed = needed_force(plant_parameters(rig()), values, motion)
    assert needed == pytest.approx(-(2.0 * np.cos(w * time) + np.sin(w * time)), abs=1e-12)
