"""Two sides with one armature: the coupled model on the table of a pair, by closed forms, two routes and energy."""

from dataclasses import replace

import numpy as np
import pytest
from coupled_twin import MUTUAL as M
from coupled_twin import changed, linear_table, shared_coenergy
from coupled_twin import kernel_run as run
from effect_sets import ALL_EFFECTS, rough
from scipy.integrate import solve_ivp

from msl_fem.actuator import Actuator
from msl_fem.computing.arrays import Array
from msl_fem.errors import InputError, OutOfTable
from msl_fem.plant import kernel, layout
from msl_fem.plant.effects import EffectValues
from msl_fem.plant.excitation import Inputs
from msl_fem.plant.lane_block import LaneSettings
from msl_fem.plant.lane_run import run_lanes
from msl_fem.plant.linearisation import linearise
from msl_fem.plant.operating_point import equilibria, net_force
from msl_fem.plant.plant import plant_parameters, surface_of
from msl_fem.plant.simulate import Options, simulate
from msl_fem.table.magnetic_table import MagneticTable

FLUX = layout.OUT_FLUX_1
DRIVES = [{"bandwidth": None}, {"bandwidth": 1e3}, {"bandwidth": 2e4}, {"kind": "voltage", "bandwidth": None}]
NAMES = ["ideal", "loop", "fast loop", "voltage"]


@pytest.fixture(scope="module")
def pair(table: MagneticTable) -> MagneticTable:
    return replace(table, shared=shared_coenergy("curved"))


@pytest.mark.parametrize("drive", DRIVES, ids=NAMES)
def test_a_constant_mutual_inductance_is_that_of_the_plain_model(
    servo: Actuator, table: MagneticTable, drive: dict[str, object]
) -> None:
    bench, inputs = changed(servo, drive=drive | {"voltage_limit": None}), rough(100)
    plant = plant_parameters(bench)
    by_number = run(bench, table, inputs, mutual=plant.polarity * plant.magnets * M)
    by_table = run(bench, replace(table, shared=shared_coenergy("constant")), inputs)
    largest = np.abs(by_number[0]).max(axis=0)
    assert (np.abs(by_table[0] - by_number[0]).max(axis=0) <= 1e-10 * largest).all()
    alone = run(bench, table, inputs)[0]
    assert (np.abs(by_number[0] - alone).max(axis=0)[[FLUX, FLUX + 1]] > 1e-3 * largest[[FLUX, FLUX + 1]]).all()


def two_circuits(actuator: Actuator, table: MagneticTable, inputs: Inputs) -> Array:
    """Both currents of a voltage drive and the position at the samples, from the equations alone, by DOP853."""
    p = plant_parameters(actuator)
    assert table.shared is not None
    shared = table.shared

    def rates(_: float, y: Array, volts: Array) -> Array:
        i, x, v = y[:2], y[2], y[3]
        own = [table.evaluate(i[0], p.nominal_gap - x), table.evaluate(i[1], p.nominal_gap + x)]
        both = {name: float(value) for name, value in shared.evaluate(x, i[0], p.polarity * i[1]).items()}
        mutual = p.polarity * both["12"]
        inductance = np.array([[both["11"], mutual], [mutual, both["22"]]])
        inductance += np.diag([float(magnet["incremental_inductance"]) for magnet in own])
        pull = np.array(
            [both["x1"] + own[0]["force_current_slope"], p.polarity * both["x2"] - own[1]["force_current_slope"]]
        )
        slope = np.linalg.solve(p.magnets * inductance, volts - p.resistance * i - p.magnets * pull * v)
        force = p.magnets * float(own[0]["force"] - own[1]["force"] + both["x"])
        return np.array([*slope, v, (force - p.damping * v - p.stiffness * x) / p.mass])

    y, rows = np.zeros(4), []
    for volts in inputs.commands:
        rows.append(y[:3])
        y = solve_ivp(rates, (0.0, 1 / inputs.rate), y, "DOP853", args=(volts,), rtol=1e-11, atol=1e-13).y[:, -1]
    return np.array(rows)


def test_it_equals_its_own_equations_by_an_adaptive_integrator(servo: Actuator, pair: MagneticTable) -> None:
    """Once more with the fourth order of the step seen: half of it errs by a sixteenth."""
    bench = changed(servo, drive={"kind": "voltage", "bandwidth": None})
    rough_inputs = rough(40)
    inputs = Inputs(2.0 * rough_inputs.commands[:, :2], rough_inputs.rate)
    exact = two_circuits(bench, pair, inputs)
    columns = [layout.OUT_I1, layout.OUT_I2, layout.OUT_X]
    largest = np.abs(exact).max(axis=0)
    error = [np.abs(run(bench, pair, inputs, None, n)[0][:, columns] - exact).max(axis=0) / largest for n in (1, 2, 20)]
    assert (error[2] < 1e-9).all()
    assert (error[0][:2] / error[1][:2] > 8).all()


@pytest.mark.parametrize("drive", DRIVES, ids=NAMES)
def test_energy_is_kept_and_flux_follows_the_voltage(
    servo: Actuator, pair: MagneticTable, drive: dict[str, object]
) -> None:
    bench, inputs = changed(servo, drive=drive | {"voltage_limit": None}), rough(200)
    steps = 20 if drive["bandwidth"] == 2e4 else 60  # with more of them that loop would be integrated
    out, imbalance, plant = run(bench, pair, inputs, None, steps)
    assert abs(imbalance) < 1e-9
    current, flux = out[:, layout.OUT_I1 : layout.OUT_I1 + 2], out[:, FLUX : FLUX + 2]
    if drive["bandwidth"] == 1e3 or "kind" in drive:
        mean = (current[1:] + current[:-1]) / 2
        induced = out[:-1, layout.OUT_VOLTAGE_1 : layout.OUT_VOLTAGE_1 + 2] - np.diff(flux, axis=0) * inputs.rate
        assert induced == pytest.approx(plant.resistance * mean, abs=0.2 * np.abs(np.diff(current, axis=0)).max())


def test_energy_is_kept_with_every_effect(servo: Actuator, pair: MagneticTable) -> None:
    assert abs(run(servo, pair, rough(60), ALL_EFFECTS, 160)[1]) < 1e-6


def test_lanes_change_no_bit_and_neutral_effects_nothing(servo: Actuator, pair: MagneticTable) -> None:
    inputs = rough(60)
    out, _, plant = run(servo, pair, inputs, steps=5)
    neutral = run(servo, pair, inputs, EffectValues(), steps=5)[0]
    plants = [plant, plant._replace(mass=1.1 * plant.mass)]
    lanes = run_lanes(surface_of(pair), plants, inputs, substeps=5, settings=LaneSettings())
    for column in (layout.OUT_X, layout.OUT_I1, layout.OUT_I2, FLUX, layout.OUT_VOLTAGE_1):
        assert np.allclose(out[:, column], neutral[:, column], rtol=1e-9, atol=1e-20)
        assert np.array_equal(out[:, column], lanes.rows(0)[:, column])


def test_lanes_with_effects_change_no_bit(servo: Actuator, pair: MagneticTable) -> None:
    inputs = rough(30)
    out, _, plant = run(servo, pair, inputs, ALL_EFFECTS, 5)
    rows = np.array([ALL_EFFECTS.vector(), EffectValues().vector()])
    lanes = run_lanes(surface_of(pair), [plant, plant], inputs, substeps=5, settings=LaneSettings(effects=rows))
    for column in (layout.OUT_X, layout.OUT_I1, FLUX, layout.OUT_VOLTAGE_1):
        assert np.array_equal(out[:, column], lanes.rows(0)[:, column])


def test_force_and_its_slopes_at_a_point_are_those_of_the_kernel(servo: Actuator, pair: MagneticTable) -> None:
    """The linear model against differences of the kernel's rates: voltage drive, so that inductances count."""
    bench = changed(servo, drive={"kind": "voltage", "bandwidth": None})
    plant, surface = plant_parameters(bench), surface_of(pair)
    point = np.array([1.1, 0.6, 7e-5, 0.0])

    def rates(y: Array) -> Array:
        state, slopes = layout.initial_state(plant, *y), np.zeros(layout.N_INTEGRATED)
        inputs = np.zeros(layout.N_INPUT)
        inputs[2:4] = plant.resistance * point[:2]
        assert kernel.rates_at(surface, plant, None, state, inputs, slopes)
        return slopes[:4]

    model = linearise(bench, pair, currents=(1.1, 0.6), position=7e-5).model
    order = [list(model.states).index(name) for name in ("current_1", "current_2", "position", "velocity")]
    step = np.array([1e-4, 1e-4, 1e-8, 1e-4])
    for k in range(4):
        away = np.where(np.arange(4) == k, step, 0.0)
        by_difference = (rates(point + away) - rates(point - away)) / (2 * step[k])
        exact = model.A[order, :][:, order][:, k]
        assert by_difference[2:] == pytest.approx(exact[2:], rel=1e-5, abs=1e-6)
        if k != 2:  # the circuits' slopes over the position also turn with the voltage that is left
            assert by_difference[:2] == pytest.approx(exact[:2], rel=1e-5, abs=1e-4)
    force = float(net_force(plant, pair, currents=(1.1, 0.6), position=np.array(7e-5))[0])
    assert rates(point)[3] == pytest.approx(force / plant.mass, rel=1e-12)


def test_an_equilibrium_stays_where_it_is(servo: Actuator, pair: MagneticTable, table: MagneticTable) -> None:
    rest = equilibria(servo, pair, currents=(0.9, 0.4))[0]
    assert rest.position != pytest.approx(equilibria(servo, table, currents=(0.9, 0.4))[0].position, rel=1e-3)
    inputs = Inputs(np.tile([0.9, 0.4], (50, 1)), 1e4)
    held = simulate(servo, pair, inputs, options=Options(currents=(0.9, 0.4), position=rest.position))
    assert held.position == pytest.approx(np.full(50, rest.position), rel=1e-9)


def test_a_table_of_another_pair_is_refused(servo: Actuator, pair: MagneticTable) -> None:
    inputs = Inputs(np.zeros((5, 2)), 1e4)
    with pytest.raises(InputError, match="one armature, the actuator has 1 side"):
        simulate(changed(servo, sides={"count": 1}), pair, inputs)
    with pytest.raises(InputError, match=r"gaps are 1.2 mm together, the actuator's\s+are 1.4 mm"):
        simulate(changed(servo, motion={"nominal_gap": 7e-4}), pair, inputs)
    shared = shared_coenergy("curved")
    short = replace(shared, surface=replace(shared.surface, current_2=shared.surface.current_2 / 20))
    with pytest.raises(OutOfTable, match="current_2 -900 mA lies outside the table's block"):
        simulate(servo, replace(pair, shared=short), inputs, options=Options(currents=(0.5, 0.9)))


def test_a_pair_of_straight_magnets_has_a_closed_form(servo: Actuator) -> None:
    """Without saturation the sum and the difference of the currents have their own time constants."""
    bench = changed(servo, motion={"moving_mass": 1e16}, drive={"kind": "voltage", "bandwidth": None})
    own, plant = 2 * 1.08e-5 / 6.3e-4, plant_parameters(bench)
    inputs = Inputs(np.full((100, 2), [10.0, 4.0]), 1e3)
    out = run(bench, replace(linear_table(), shared=shared_coenergy("constant")), inputs)[0]
    both = out[:, layout.OUT_I1 : layout.OUT_I1 + 2]
    for sign, volts in ((1, 14.0), (-1, 6.0)):
        inductance = own + sign * plant.polarity * plant.magnets * M
        exact = volts / 2 * (1 - np.exp(-inputs.time * 2 / inductance))
        assert both[:, 0] + sign * both[:, 1] == pytest.approx(exact, rel=1e-8, abs=1e-12)
