"""End stops: contact within the step, restitution, rest and release, and their file keys."""

import numpy as np
import pytest
from coupled_twin import changed
from effect_sets import effects, rig

from msl_fem.actuator import Actuator, parse_actuator
from msl_fem.errors import ActuatorError
from msl_fem.plant.excitation import Inputs
from msl_fem.plant.lane_block import LaneSettings
from msl_fem.plant.lane_run import run_lanes
from msl_fem.plant.plant import plant_parameters, surface_of
from msl_fem.plant.simulate import Options, simulate
from msl_fem.table.magnetic_table import MagneticTable

LOOSE = {"stiffness": "0 N/m", "damping": "0 N s/m", "end_stop": "1 mm"}


def bouncing(e: float, time: np.ndarray) -> np.ndarray:
    """A mass of 0.5 kg thrown with 5 N on a stop at 1 mm: parabolas between the impacts, the exact answer."""
    a, x, start, v, begin = 10.0, np.empty(time.size), 0.0, 0.0, 0.0
    for _ in range(60):
        flight = (-v + np.sqrt(v**2 + 2 * a * (1e-3 - start))) / a
        now = (time >= begin) & (time <= begin + flight)
        x[now] = start + v * (time[now] - begin) + a / 2 * (time[now] - begin) ** 2
        begin, start, v = begin + flight, 1e-3, -e * (v + a * flight)
    x[time > begin] = 1e-3
    return x


@pytest.mark.parametrize("e", [0.7, 0.3])
def test_a_mass_bounces_as_newton_says(e: float) -> None:
    """Impacts lie anywhere within the steps of 0.2 ms; where the mover rests in the end the last hops are left out."""
    run = simulate(
        rig(**LOOSE, end_stop_restitution=e),
        None,
        Inputs(np.full((400, 1), 5.0), 1e3),
        options=Options(substeps=5),  # type: ignore[arg-type]
    )
    assert run.position.max() <= 1e-3
    exact = bouncing(e, run.time)
    early = run.time < 0.045
    assert run.position[early] == pytest.approx(exact[early], abs=1e-10)
    assert run.position == pytest.approx(exact, abs=2e-6)
    assert (run.position[-50:] == 1e-3).all()
    assert run.audit.impact == pytest.approx(5.0 * 1e-3, rel=1e-9), "all the work of the force"
    assert abs(run.audit.imbalance) < 1e-9


def test_a_mover_leaves_its_stop_when_the_force_turns() -> None:
    push = np.r_[np.full(100, 5.0), np.full(40, -5.0)]
    run = simulate(rig(**LOOSE), None, Inputs(push[:, None], 1e3))
    assert run.position[60:100] == pytest.approx(1e-3)
    away = run.time[100:] - 0.1
    expected = np.where(1e-3 - 5.0 * away**2 > -1e-3, 1e-3 - 5.0 * away**2, -1e-3)
    assert run.position[100:] == pytest.approx(expected, abs=1e-9)
    assert run.position[-1] == -1e-3


def test_a_magnet_that_pulls_its_armature_in_holds_it_at_the_stop(servo: Actuator, table: MagneticTable) -> None:
    """Where the plain run ends for leaving its range, this one goes on; both gaps stay in the table, energy closes."""
    inputs = Inputs(np.vstack([np.tile([3.0, 0.5], (300, 1)), np.zeros((300, 2))]), 1e4)
    stopped = changed(servo, motion={"end_stop": 4.5e-4, "end_stop_restitution": 0.4})
    run = simulate(stopped, table, inputs)
    assert run.complete
    assert run.position[299] == 4.5e-4
    assert run.velocity[299] == 0.0
    assert run.position[-1] < 4e-4, "released by the spring when the currents have gone"
    assert run.audit.impact > 1e-3
    assert abs(run.audit.imbalance) < 1e-6


def test_a_second_mass_goes_on_at_the_impact(servo: Actuator) -> None:
    """With effects: the armature is thrown back, the load is not; the ledger knows it."""
    values = effects("structural_mode", mass_share=0.3, frequency=80.0)
    bench = rig(**LOOSE, end_stop_restitution=0.5)  # type: ignore[arg-type]
    run = simulate(bench, None, Inputs(np.full((300, 1), 5.0), 1e3), effects=values, options=Options(substeps=60))
    assert run.position.max() <= 1e-3
    assert run.audit.impact > 1e-4
    assert abs(run.audit.imbalance) < 1e-7
    assert run.position[-1] == pytest.approx(1e-3, abs=2e-5)


def test_lanes_that_meet_a_stop_are_run_alone(servo: Actuator, table: MagneticTable) -> None:
    stopped = changed(servo, motion={"end_stop": 4.5e-4, "end_stop_restitution": 0.4})
    inputs = Inputs(np.tile([3.0, 0.5], (100, 1)), 1e4)
    plants = [plant_parameters(stopped)._replace(mass=0.9 + 0.01 * k) for k in range(2)]
    run = run_lanes(surface_of(table), plants, inputs, substeps=10, settings=LaneSettings())
    alone = simulate(changed(stopped, motion={"moving_mass": 0.91}), table, inputs)
    assert (run.true_position[1] == alone.position).all()
    assert run.done.tolist() == [100, 100]


@pytest.mark.parametrize(
    ("motion", "complaint"),
    [
        ({"end_stop": "0.6 mm"}, "end_stop 600 µm must be below nominal_gap 600 µm"),
        ({"end_stop_restitution": 0.3}, "end_stop_restitution is stated without end_stop"),
        ({"end_stop": "0.5 mm", "end_stop_restitution": 1.5}, "end_stop_restitution"),
        ({"end_stop": 0.5}, "has no unit"),
    ],
)
def test_stops_that_cannot_be_are_refused(motion: dict[str, object], complaint: str) -> None:
    stated = {"moving_mass": "1 kg", "nominal_gap": "0.6 mm"} | motion
    with pytest.raises(ActuatorError, match=complaint):
        parse_actuator({"schema": 1, "name": "rig", "motion": stated})


def test_an_actuator_without_stops_keeps_its_digest(servo: Actuator) -> None:
    """Tables know their actuator by it."""
    assert "end_stop" not in servo.motion.model_dump()
    assert changed(servo, motion={"end_stop": 5e-4}).digest != servo.digest
