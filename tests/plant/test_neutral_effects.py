"""The plain model is the extended one at neutral values, and every parameter goes smoothly through them."""

import numpy as np
import pytest
from coupled_twin import changed
from effect_sets import ALL_EFFECTS, effects, rig, rough

from msl_fem.actuator import Actuator
from msl_fem.errors import InputError
from msl_fem.plant.effects import CATALOGUE, EffectValues
from msl_fem.plant.excitation import Inputs
from msl_fem.plant.lane_block import LaneSettings
from msl_fem.plant.lane_run import run_lanes
from msl_fem.plant.plant import plant_parameters, surface_of
from msl_fem.plant.simulate import Options, Simulation, simulate
from msl_fem.table.magnetic_table import MagneticTable

CHANNELS = (
    "voltage", "force", "current", "flux_linkage", "position", "velocity", "measured_position", "measured_current",
    "samples_at_current_limit", "samples_at_voltage_limit",
)  # fmt: skip


def assert_equal(one: Simulation, two: Simulation) -> None:
    """To the last bit."""
    for channel in CHANNELS:
        assert np.array_equal(getattr(one, channel), getattr(two, channel)), channel
    for term in ("electrical", "external", "copper", "damping"):
        assert getattr(one.audit, term) == getattr(two.audit, term)


@pytest.mark.parametrize(
    "drive",
    [
        {"kind": "current"},
        {"kind": "current", "voltage_limit": 2.0},
        {"kind": "current", "bandwidth": None},
        {"kind": "voltage", "bandwidth": None},
        {"kind": "voltage", "bandwidth": 2000.0},
    ],
    ids=["current", "at its voltage limit", "ideal current", "ideal voltage", "voltage"],
)
@pytest.mark.parametrize("sides", [{"count": 2}, {"count": 1}, {"count": 2, "connection": "parallel"}])
def test_neutral_effects_change_no_bit(
    servo: Actuator, table: MagneticTable, drive: dict[str, object], sides: dict[str, object]
) -> None:
    bench = changed(servo, drive=drive, sides=sides, motion={"constant_force": 2.0})
    inputs = rough(80, sides=int(str(sides["count"])))
    one, two = (simulate(bench, table, inputs, effects=e) for e in (None, EffectValues()))
    assert one.position.std() > 1e-7
    if "voltage_limit" in drive:
        assert one.samples_at_voltage_limit.any()
    assert_equal(one, two)


@pytest.mark.parametrize("bandwidth", [{}, {"bandwidth": 300.0}])
def test_neutral_effects_change_no_bit_of_a_mechanical_rig(bandwidth: dict[str, float]) -> None:
    inputs = Inputs(10 * np.random.default_rng(1).standard_normal((100, 1)), 1e3)
    bench = changed(rig(), drive=bandwidth)
    assert_equal(simulate(bench, None, inputs), simulate(bench, None, inputs, effects=EffectValues()))


PARAMETERS = [(e.name, p.name) for e in CATALOGUE.values() for p in e.parameters if not p.shape]


@pytest.mark.parametrize(("effect", "parameter"), PARAMETERS, ids=[f"{e}.{p}" for e, p in PARAMETERS])
def test_a_parameter_goes_smoothly_through_its_neutral_value(
    servo: Actuator, table: MagneticTable, effect: str, parameter: str
) -> None:
    """The readings have a first derivative there: h and 2 h change them by once and twice the same, up to O(h^2).

    On both sides, where the bounds allow. Steps of 1e-4 and 2e-4 of the scale, more for what 12 ms hardly show: 2 % of
    the change is left to curvature, kinks (slew limit, stops) and rounding.
    """
    fraction = {"jerk": 1e3, "rise_per_joule": 1.0}.get(parameter, 1e-4)
    bounds, scale = CATALOGUE[effect].parameter(parameter).bounds, CATALOGUE[effect].parameter(parameter).scale
    steps = [h * fraction * scale for h in ((0, 1, 2) if bounds[0] == 0 else (0, 1, 2, -1))]
    plant, surface, inputs = plant_parameters(servo), surface_of(table), rough(120)
    vectors = np.array([effects(effect, **{parameter: h}).vector() for h in steps])
    run = run_lanes(surface, [plant] * len(steps), inputs, substeps=10, settings=LaneSettings(effects=vectors))
    readings = {"position": run.position, "current": run.current, "voltage": run.voltage}
    changes = {name: values[1:] - values[0] for name, values in readings.items()}
    noise = {name: 1e-13 * np.abs(values).max() for name, values in readings.items()}
    telling = [name for name in readings if np.abs(changes[name][0]).max() > 100 * noise[name]]
    assert telling, "the parameter does nothing"
    for name in telling:
        once, twice = changes[name][0], changes[name][1]
        assert np.abs(twice - 2 * once).max() < 0.02 * np.abs(twice).max() + noise[name], name
        if len(steps) > 3:
            assert np.abs(changes[name][2] + once).max() < 0.02 * np.abs(once).max() + noise[name], name


def test_what_a_plant_cannot_have_is_refused(servo: Actuator, table: MagneticTable) -> None:
    inputs = rough(20)
    ideal = changed(servo, drive={"bandwidth": None})
    one = changed(servo, sides={"count": 1})
    with pytest.raises(
        InputError, match=r"eddy_currents needs a drive whose current cannot jump; state drive\.bandwidth"
    ):
        simulate(ideal, table, inputs, effects=effects("eddy_currents", time_constant=1e-4))
    with pytest.raises(InputError, match=r"time_delay\.command needs a drive"):
        simulate(ideal, table, inputs, effects=effects("time_delay", command=1e-4))
    with pytest.raises(InputError, match="cross_coupling needs two sides"):
        simulate(one, table, rough(20, sides=1), effects=effects("cross_coupling", share=0.01))
    with pytest.raises(InputError, match="squeeze_film needs magnets"):
        simulate(rig(), None, Inputs(np.zeros(9), 1e3), effects=effects("squeeze_film", damping=1.0))
    with pytest.raises(
        InputError, match=r"0\.002 s are 20 samples, the coupled model delays a command by less than 16"
    ):
        simulate(servo, table, inputs, effects=effects("time_delay", command=2e-3))


def test_the_ledger_closes_with_every_effect(servo: Actuator, table: MagneticTable) -> None:
    """Electrical input and outside work = all losses + change of field and mechanical energy, to 1e-6."""
    run = simulate(servo, table, rough(2000), effects=ALL_EFFECTS, options=Options(substeps=80))
    audit = run.audit
    for loss in ("copper", "damping", "eddy_currents", "hysteresis", "friction", "internal"):
        assert getattr(audit, loss) > 1e-7, loss
    assert audit.impact == 0.0
    assert abs(audit.imbalance) < 1e-6
    assert abs(run.audit.electrical) > 0.1
