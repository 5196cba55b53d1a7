"""With every effect off and the believed parameters, the bench is the coupled model by another integrator."""

import numpy as np
import pytest
from bench_rigs import DRIVES, RATE, VOLTAGE_SERVO, excitations, noise_commands, plain_rig

from msl_fem.bench.iron import side_coenergy
from msl_fem.bench.plant import (
    ENERGY_COPPER,
    ENERGY_DAMPER,
    ENERGY_ELECTRICAL,
    ENERGY_OUTSIDE,
    IM1,
    V,
    X,
)
from msl_fem.bench.rig import Rig, magnet_surface, true_rig
from msl_fem.bench.running import run_rig, stable_current
from msl_fem.bench.sealed import commands_of
from msl_fem.plant import Inputs, Options, simulate
from msl_fem.plant import stability_limit as coupled_limit

CHANNELS = ("current", "voltage", "flux_linkage", "position", "velocity")


@pytest.mark.parametrize("drive", ["current", "voltage", "force"])
def test_two_routes_to_one_run(drive: str) -> None:
    """Every channel within 1e-6 of its largest value; the coupled model with twice its usual steps."""
    actuator, table = DRIVES[drive]
    for excitation in excitations(drive):
        commands = commands_of(actuator, excitation, rate=RATE)
        commands = commands * np.minimum(np.arange(len(commands)) / 200, 1)[:, None]  # the voltage limit is a kink
        other = simulate(actuator, table, Inputs(commands, RATE), options=Options(substeps=20))
        run = run_rig(plain_rig(drive), commands, rate=RATE)
        for name in CHANNELS if drive != "force" else ("position", "velocity"):
            one, two = getattr(run, name), getattr(other, name)
            assert np.abs(one - two).max() <= 1e-6 * np.abs(two).max(), name
        sensed = other.measured_position
        assert np.abs(run.reading - sensed).max() <= 1e-6 * np.abs(sensed).max()


def test_parallel_magnets_and_one_side() -> None:
    for sides in ({"connection": "parallel"}, {"count": 1}):
        actuator = VOLTAGE_SERVO.model_copy(update={"sides": VOLTAGE_SERVO.sides.model_copy(update=sides)})
        table = DRIVES["voltage"][1]
        n = actuator.sides.count
        commands = 0.5 * noise_commands("voltage")[:1500, :n]
        other = simulate(actuator, table, Inputs(commands, RATE), options=Options(substeps=20))
        run = run_rig(true_rig(actuator, table), commands, rate=RATE)
        for name in CHANNELS:
            assert np.abs(getattr(run, name) - getattr(other, name)).max() <= 1e-6 * np.abs(getattr(other, name)).max()


def test_the_voltage_limit_acts() -> None:
    """A step of the command beyond what the limit can make: the same mean voltages as the coupled model's."""
    actuator, table = DRIVES["current"]
    commands = np.zeros((1000, 2))
    commands[100:] = (0.85, 0.84)
    other = simulate(actuator, table, Inputs(commands, RATE), options=Options(substeps=100))
    run = run_rig(plain_rig("current"), commands, rate=RATE, substeps=40)
    assert other.samples_at_voltage_limit.sum() > 0
    assert np.abs(run.voltage - other.voltage).max() <= 1e-3 * 80
    assert np.abs(run.position - other.position).max() <= 1e-5 * np.abs(other.position).max()


def stored(rig: Rig, y: np.ndarray) -> float:
    """Field energy i L - W' and mechanical energy of a plain rig's state, J."""
    energy = 0.5 * rig.plant.motion.mass * y[V] ** 2 + 0.5 * rig.plant.motion.stiffness * y[X] ** 2
    table = rig.table
    assert table is not None
    m = rig.plant.magnets
    for j in range(2):
        gap, current = m.nominal_gap - (1 - 2 * j) * y[X], y[IM1 + j]
        flux = m.per_side * float(table.flux_linkage(current, gap))
        energy += current * flux - side_coenergy(magnet_surface(table), m, current, gap)
    return float(energy)


@pytest.mark.parametrize("drive", ["current", "voltage"])
def test_the_plain_bench_creates_no_energy(drive: str) -> None:
    rig = plain_rig(drive)
    rig = rig.with_parts(motion=rig.plant.motion._replace(constant_force=0.0))
    y = run_rig(rig, noise_commands(drive), rate=RATE, substeps=10).end_state
    came = y[ENERGY_ELECTRICAL] + y[ENERGY_OUTSIDE]
    went = y[ENERGY_COPPER] + y[ENERGY_DAMPER] + stored(rig, y)
    assert came == pytest.approx(went, rel=1e-7)
    assert y[ENERGY_DAMPER] > 1e-6 * came


def test_the_integrator_is_of_order_five() -> None:
    """Error by halving in voltage drive, down to where the table's cells, joined with three derivatives, show."""
    commands = noise_commands("voltage", duration=0.2)
    ends = [run_rig(plain_rig("voltage"), commands, rate=2000.0, substeps=n).position for n in (1, 2, 4, 8)]
    steps = [np.abs(a - b).max() for a, b in zip(ends, ends[1:], strict=False)]
    orders = np.log2(np.array(steps[:-1]) / np.array(steps[1:]))
    assert orders == pytest.approx([5.0, 5.0], abs=0.15)


def test_stability_limit_is_that_of_the_coupled_model() -> None:
    actuator, table = DRIVES["current"]
    assert table is not None
    assert stable_current(plain_rig("current")) == pytest.approx(coupled_limit(actuator, table), rel=1e-4)
    assert stable_current(plain_rig("force")) == np.inf
