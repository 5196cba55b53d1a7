"""Equilibria, stability and the linear model near a point."""

import numpy as np
import pytest
from conftest import saturating_reluctance
from coupled_twin import changed
from scipy.optimize import brentq

from msl_fem.actuator import Actuator, parse_actuator
from msl_fem.errors import ComputationError, InputError
from msl_fem.plant import kernel
from msl_fem.plant.excitation import Inputs, excitation_inputs, parse_excitation
from msl_fem.plant.layout import N_INTEGRATED, initial_state
from msl_fem.plant.linearisation import linearise
from msl_fem.plant.open_loop import check_open_loop
from msl_fem.plant.operating_point import equilibria, resting_point, stability_limit
from msl_fem.plant.plant import plant_parameters, surface_of
from msl_fem.plant.simulate import Options, simulate
from msl_fem.table.magnetic_table import MagneticTable


def closed_form_limit() -> float:
    """The current at which k + 4 dF/dg = 0 at 0.6 mm: two sides of two magnets on 1.4e5 N/m."""

    def stiffness(i: float) -> float:
        return 1.4e5 + 4 * float(saturating_reluctance(np.array(i), np.array(6e-4))["force_gap_slope"])

    return float(brentq(stiffness, 0.1, 3.0))


def test_equal_currents_balance_in_the_middle_and_on_both_sides_of_it(servo: Actuator, table: MagneticTable) -> None:
    found = equilibria(servo, table, currents=(0.7, 0.7))
    assert [e.stable for e in found] == [False, True, False]
    left, middle, right = (e.position for e in found)
    assert middle == pytest.approx(0.0, abs=1e-12)
    assert right == pytest.approx(-left, rel=1e-9)
    above = equilibria(servo, table, currents=(1.0, 1.0))
    assert [e.stable for e in above] == [False]


@pytest.mark.parametrize("currents", [(0.7, 0.7), (0.55, 0.3), (0.0, 0.6)])
def test_forces_balance_at_every_equilibrium(
    servo: Actuator, table: MagneticTable, currents: tuple[float, float]
) -> None:
    loaded = changed(servo, motion={"constant_force": 7.0})
    found = equilibria(loaded, table, currents=currents)
    assert found
    for e in found:
        pulls = 2 * table.force(np.array(currents), 6e-4 + e.position * np.array([-1, 1]))
        assert pulls[0] - pulls[1] + 7.0 - 1.4e5 * e.position == pytest.approx(0.0, abs=1e-6)
        assert e.currents == currents


def test_a_spring_alone_rests_under_its_load(servo: Actuator, table: MagneticTable) -> None:
    (rest,) = equilibria(changed(servo, motion={"constant_force": 14.0}), table, currents=(0.0, 0.0))
    assert rest.position == pytest.approx(1e-4, rel=1e-9)
    assert rest.stiffness == pytest.approx(1.4e5, rel=1e-9)
    loose = changed(servo, motion={"stiffness": 0.0})
    with pytest.raises(InputError, match="every position is an equilibrium"):
        equilibria(loose, table, currents=(0.0, 0.0))


def test_two_equilibria_about_to_merge_are_both_found(servo: Actuator, table: MagneticTable) -> None:
    """At a force that nearly pulls the mover in, a stable and an unstable equilibrium are 0.1 um apart."""

    def pull(x: float) -> dict[str, np.ndarray]:
        return table.evaluate(0.8, 6e-4 - x)

    fold = float(brentq(lambda x: 1.4e5 + 2 * float(pull(x)["force_gap_slope"]), 0.0, 4e-4))
    load = 1.4e5 * fold - 2 * float(pull(fold)["force"])
    pair = equilibria(changed(servo, motion={"constant_force": load - 1e-6}), table, currents=(0.8, 0.0))[-2:]
    assert [e.stable for e in pair] == [True, False]
    assert pair[0].position < fold < pair[1].position
    assert pair[1].position - pair[0].position < 3e-7
    beyond = equilibria(changed(servo, motion={"constant_force": load + 1e-6}), table, currents=(0.8, 0.0))
    assert not any(abs(e.position - fold) < 1e-5 for e in beyond)


def test_a_slow_run_ends_at_the_resting_point(servo: Actuator, table: MagneticTable) -> None:
    damped = changed(servo, motion={"damping": 700.0})
    run = simulate(damped, table, Inputs(np.tile([0.55, 0.1], (3000, 1)), 1e4))
    assert run.position[-1] == pytest.approx(resting_point(damped, table, currents=(0.55, 0.1)).position, rel=1e-6)
    with pytest.raises(ComputationError, match=r"at 1.2 A and 0.1 A, from x = 0 mm, the mover is pulled to its end"):
        resting_point(damped, table, currents=(1.2, 0.1))
    with pytest.raises(ComputationError, match="the equilibrium is unstable"):
        resting_point(damped, table, currents=(1.0, 1.0))


def test_the_stability_limit_is_where_the_magnets_use_up_the_spring(servo: Actuator, table: MagneticTable) -> None:
    limit = stability_limit(servo, table)
    assert limit == pytest.approx(closed_form_limit(), rel=2e-4)
    assert stability_limit(changed(servo, sides={"connection": "parallel"}), table) == pytest.approx(2 * limit)
    assert stability_limit(changed(servo, sides={"count": 1}), table) > 1.3 * limit
    assert stability_limit(changed(servo, motion={"stiffness": 0.0}), table) == 0.0
    assert stability_limit(changed(servo, motion={"stiffness": 1e9}), table) == np.inf


@pytest.mark.parametrize("kind", ["current", "voltage"])
def test_the_run_and_the_linear_model_know_the_limit_too(servo: Actuator, table: MagneticTable, kind: str) -> None:
    bench, limit = changed(servo, drive={"kind": kind, "bandwidth": None}), stability_limit(servo, table)
    for factor, stable in ((0.97, True), (1.03, False)):
        i = factor * limit
        assert linearise(bench, table, currents=(i, i)).is_stable == stable
        command = i * (2.0 if kind == "voltage" else 1.0)
        start = Options((i, i), position=1e-6, partial=True)
        run = simulate(bench, table, Inputs(np.full((20_000, 2), command), 1e4), options=start)
        assert run.complete == stable


@pytest.mark.parametrize("connection", ["series", "parallel"])
@pytest.mark.parametrize("drive", [{"kind": "current"}, {"kind": "voltage", "bandwidth": None}])
def test_the_linear_model_is_the_kernel_s_jacobian(
    servo: Actuator, table: MagneticTable, connection: str, drive: dict[str, object]
) -> None:
    bench = changed(servo, drive=drive, sides={"connection": connection}, position_sensor={"bandwidth": None})
    plant, surface = plant_parameters(bench), surface_of(table)
    point = np.array([0.9, 0.5, 8e-5, 0.0])
    rest = np.r_[plant.resistance * point[:2], 0.0] if drive["kind"] == "voltage" else np.r_[point[:2], 0.0]

    def rates(y: np.ndarray, u: np.ndarray) -> np.ndarray:
        state, dy = initial_state(plant, *y), np.zeros(N_INTEGRATED)
        assert kernel.rates_at(surface, plant, None, state, np.r_[u[:2], u[:2], u[2]], dy)
        return dy[:4].copy()

    linear = linearise(bench, table, currents=(0.9, 0.5), position=8e-5)
    assert linear.model.states == ("current_1", "current_2", "position", "velocity")
    for matrix, at, sizes in ((linear.model.A, 0, (1e-4, 1e-4, 1e-8, 1e-4)), (linear.model.B, 1, (1e-4, 1e-4, 1e-2))):
        for n, h in enumerate(sizes):
            ahead, behind = [point.copy(), rest.copy()], [point.copy(), rest.copy()]
            ahead[at][n] += h
            behind[at][n] -= h
            column = (rates(*ahead) - rates(*behind)) / (2 * h)
            assert matrix[:, n] == pytest.approx(
                column, rel=1e-5, abs=1e-6 * np.abs(matrix).max(initial=1e-9, axis=1).min()
            )
    assert linear.residual_force == pytest.approx(rates(point, rest)[3] * 0.9, rel=1e-9)


def test_signals_of_the_linear_model_by_drive(servo: Actuator, table: MagneticTable) -> None:
    """What is ideal has no state; without currents the mover swings at sqrt(k/m)."""
    whole = linearise(servo, table)
    assert whole.model.states == ("current_1", "current_2", "position", "velocity", "position_sensor")
    assert whole.model.inputs == ("command_1", "command_2", "disturbance")
    assert whole.natural_frequency == pytest.approx(np.sqrt(1.4e5 / 0.9) / (2 * np.pi), rel=1e-12)
    ideal = linearise(changed(servo, drive={"bandwidth": None}), table, currents=(0.5, 0.2))
    assert ideal.model.states == ("position", "velocity", "position_sensor")
    static = ideal.model.response(0.0)[0].real
    slope = 2 * table.evaluate(0.5, 6e-4)["force_current_slope"]
    assert static[0, 0] == pytest.approx(slope / ideal.stiffness, rel=1e-9)
    assert static[0, 2] == pytest.approx(1 / ideal.stiffness, rel=1e-9)
    assert static[2:].tolist() == [[1, 0, 0], [0, 1, 0]]
    lagging = linearise(changed(servo, drive={"kind": "voltage", "bandwidth": 500.0}), table, currents=(0.5, 0.2))
    assert lagging.model.states[:4] == ("output_1", "output_2", "current_1", "current_2")
    assert lagging.model.response(0.0)[0, 2, 0].real == pytest.approx(0.5, rel=1e-9)  # 1 A for 2 V
    rig = parse_actuator({
        "schema": 1, "name": "rig", "drive": {"kind": "force", "bandwidth": "20 Hz"},
        "motion": {"moving_mass": "0.5 kg", "stiffness": "2000 N/m", "damping": "8 N s/m"},
    })  # fmt: skip
    moved = linearise(rig, None).model
    assert moved.states == ("output_1", "position", "velocity")
    assert np.abs(moved.response([0.0, 20.0])[:, 0, 0]) == pytest.approx(
        [1 / 2000, np.sqrt(0.5) / abs(2000 - 0.5 * (40 * np.pi) ** 2 + 8j * 40 * np.pi)], rel=1e-9
    )


@pytest.mark.parametrize("channel", ["common", "independent"])
def test_a_small_signal_run_follows_the_linear_model(servo: Actuator, table: MagneticTable, channel: str) -> None:
    """The kernel against the sampled linear model about equal currents, by a small step of each input."""
    start = Options((0.5, 0.5), substeps=20)
    step = np.array([1e-4, 1e-4]) if channel == "common" else np.array([1e-4, -2e-4])
    run = simulate(servo, table, Inputs(np.tile(0.5 + step, (400, 1)), 1e4, 1e-3), options=start)
    linear = linearise(servo, table, currents=(0.5, 0.5)).model.sampled(1e-4)
    x, u, answers = np.zeros(5), np.r_[step, 1e-3], []
    for _ in range(400):
        answers.append(linear.C @ x + linear.D @ u)
        x = linear.A @ x + linear.B @ u
    got = np.column_stack([run.position, run.measured_position, run.current - 0.5])
    assert got == pytest.approx(np.array(answers), rel=2e-3, abs=1e-3 * np.abs(answers).max(axis=0).min())
    for n, scale in enumerate(np.abs(answers).max(axis=0)):
        assert np.abs(got[:, n] - np.array(answers)[:, n]).max() < 1e-3 * scale


def excited(servo: Actuator, spec: str, *, scale: float = 1.0) -> Inputs:
    inputs = excitation_inputs(servo, parse_excitation(spec), rate=1e4)
    return Inputs(scale * inputs.commands, 1e4)


def test_an_excitation_beyond_the_stable_region_is_refused_with_the_limit(
    servo: Actuator, table: MagneticTable
) -> None:
    both = "sine:channel=common,frequency=400 Hz,bias=0.7 A,amplitude=0.3 A,duration=0.3 s"
    rms = np.sqrt(0.7**2 + 0.3**2 / 2)
    limit = stability_limit(servo, table)
    assert check_open_loop(servo, table, excited(servo, both, scale=0.98 * limit / rms)) is None
    with pytest.raises(
        InputError, match=rf"stable up to {limit:.3g} A RMS on all sides at x = 0; scale the currents by 0\.9"
    ):
        check_open_loop(servo, table, excited(servo, both, scale=1.04 * limit / rms))


@pytest.mark.parametrize(
    ("spec", "bearable"),
    [
        ("sine:channel=differential,frequency=2 Hz,amplitude=1 A,duration=0.6 s", 0.65),
        ("sine:channel=1,frequency=2 Hz,bias=0.5 A,amplitude=0.5 A,duration=0.6 s", 0.7),
        ("sine:channel=2,frequency=2 Hz,bias=0.5 A,amplitude=0.5 A,duration=0.6 s", 0.7),
    ],
)
def test_a_slow_signal_is_judged_as_the_run_goes(
    servo: Actuator, table: MagneticTable, spec: str, bearable: float
) -> None:
    """The check and the run agree on the amplitude, to 5 %."""
    below, above = excited(servo, spec, scale=bearable), excited(servo, spec, scale=bearable + 0.05)
    check_open_loop(servo, table, below)
    assert simulate(servo, table, below).complete
    with pytest.raises(InputError, match="in closed loop"):
        check_open_loop(servo, table, above)
    with pytest.raises(ComputationError):
        simulate(servo, table, above)


@pytest.mark.parametrize("columns", [(0, 1), (1, 0)])
def test_one_side_alone_pulls_in_at_less_than_both(
    servo: Actuator, table: MagneticTable, columns: tuple[int, int]
) -> None:
    """0.75 A on both sides is borne, 0.72 A on one alone is not."""
    commands = np.full((1500, 2), 0.75)
    commands[:100] *= np.linspace(0, 1, 100)[:, None]
    check_open_loop(servo, table, Inputs(commands, 1e4))
    commands[750:] = [0.0, 0.72]
    with pytest.raises(InputError, match=r"0\.72 A"):
        check_open_loop(servo, table, Inputs(commands[:, columns], 1e4))


def test_a_voltage_is_judged_by_the_current_that_it_makes(servo: Actuator, table: MagneticTable) -> None:
    bench = changed(servo, drive={"kind": "voltage", "bandwidth": None})
    t = np.arange(2000) / 1e4
    slow = np.tile(2.2 * np.minimum(t / 0.05, 1.0)[:, None], 2)  # 1.1 A in the end
    fast = np.tile(20 * np.sin(2 * np.pi * 1000 * t)[:, None], 2)  # mostly across the inductance
    check_open_loop(bench, table, Inputs(fast, 1e4))
    with pytest.raises(InputError, match=r"1\.1 A RMS on side 1 and 1\.1 A on side 2"):
        check_open_loop(bench, table, Inputs(slow, 1e4))
