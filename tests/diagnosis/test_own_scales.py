"""Scales and bounds of the effects go with the plant: the servo's are the catalogue's, a large magnet has its own."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from msl_fem.actuator import Actuator, load_actuator
from msl_fem.diagnosis.fit import fit
from msl_fem.diagnosis.static_maps import map_alone
from msl_fem.diagnosis.unknowns import EffectUnknown
from msl_fem.diagnosis.variants import RecordFeatures, variants
from msl_fem.plant.effects import CATALOGUE, EffectValues
from msl_fem.plant.own_scales import REFERENCE, over_reference, own_quantities
from msl_fem.plant.plant import plant_parameters
from msl_fem.prediction import ModelHypothesis
from msl_fem.record import Noise, Record, StaticMap
from msl_fem.table.magnetic_table import MagneticTable

ROOT = Path(__file__).parent.parent.parent
FEATURES = RecordFeatures(position=1e-4, current=1.0, velocity=1e-2, own_frequency=20.0, rate=1e4)


def changed(actuator: Actuator, **sections: dict[str, object]) -> Actuator:
    """The actuator with keys of its sections replaced."""
    update = {name: getattr(actuator, name).model_copy(update=keys) for name, keys in sections.items()}
    return actuator.model_copy(update=update)


def large_magnet() -> tuple[Actuator, MagneticTable]:
    """A magnet of 16 mm gap whose flux saturates: W' = L(g) s^2 (sqrt(1 + (i/s)^2) - 1), L = a/(g + b)."""
    gap, current, s = np.geomspace(4e-3, 40e-3, 24), np.linspace(0.0, 60.0, 13), 80.0
    i, g = np.meshgrid(current, gap)
    ind, root = 8e-4 / (g + 1e-3), np.sqrt(1 + (i / s) ** 2)
    ind_g, ind_gg, bent = -ind / (g + 1e-3), 2 * ind / (g + 1e-3) ** 2, s**2 * (root - 1)
    nodes = {
        "coenergy": ind * bent, "flux_linkage": ind * i / root, "force": -ind_g * bent,
        "incremental_inductance": ind / root**3, "force_current_slope": -ind_g * i / root,
        "force_gap_slope": -ind_gg * bent,
    }  # fmt: skip
    servo = load_actuator(ROOT / "geometries" / "fast_tool_servo.toml")
    actuator = changed(
        servo,
        sides={"count": 1, "magnets_per_side": 1},
        motion={"moving_mass": 40.0, "nominal_gap": 16e-3, "range": 12e-3, "constant_force": -392.0, "stiffness": 0.0},
        drive={"bandwidth": 200.0, "current_limit": 60.0, "coil_resistance": 0.5},
    )
    return actuator, MagneticTable(gap, current, nodes)


def test_the_servos_scales_are_the_catalogues(servo: Actuator) -> None:
    """To the last digits; its bound of the gap's offset was half the gap and is nine tenths: a factor of 1.8."""
    own = own_quantities(plant_parameters(servo), rate=1e4)
    assert own == pytest.approx(REFERENCE, rel=1e-12)
    for effect in CATALOGUE.values():
        for parameter in effect.parameters:
            assert over_reference(parameter, own) == pytest.approx(1.0, rel=1e-12)
    assert CATALOGUE["gap_offset"].parameter("offset").bounds[1] == pytest.approx(0.9 * 0.6e-3)


def test_every_amount_with_a_dimension_says_what_it_goes_with() -> None:
    for effect in CATALOGUE.values():
        for name in effect.amounts:
            parameter = effect.parameter(name)
            assert bool(parameter.of) == bool(parameter.unit), (effect.name, name)


@pytest.mark.parametrize(
    ("effect", "name", "least", "most"),
    [
        ("gap_offset", "offset", 12e-3, 16e-3),
        ("current_sensor_error", "offset_1", 9.0, 11.0),
        ("coulomb_friction", "force", 5e3, 7e3),
        ("sensor_drift", "offset", 20e-3, 30e-3),
        ("position_sensor_nonlinearity", "quadratic", 150.0, 250.0),
    ],
)
def test_a_large_magnet_has_large_bounds(effect: str, name: str, least: float, most: float) -> None:
    plant = plant_parameters(large_magnet()[0])
    unknowns = [u for v in variants(effect, FEATURES, plant) for u in v.unknowns if u.name == name]
    assert unknowns
    for unknown in unknowns:
        assert least < float(unknown.value(np.array(1e9))) < most
        assert unknown.value(np.array(unknown.z_of(0.5 * least))) == pytest.approx(0.5 * least)


def test_the_coil_of_a_mover_of_twenty_grams_warms_by_kelvins_a_millijoule() -> None:
    """0.39 %/K over 0.5 mJ/K; a bound of the servo's, 1/J, left heating for another cause."""
    actuator, _ = large_magnet()
    plant = plant_parameters(changed(actuator, motion={"moving_mass": 0.02}))
    unknowns = [u for v in variants("coil_heating", FEATURES, plant) for u in v.unknowns if u.name == "rise_per_joule"]
    assert unknowns
    assert all(u.value(np.array(u.z_of(7.9))) == pytest.approx(7.9) for u in unknowns)


@pytest.mark.parametrize("scale", [0.01, 1.0, 30.0, 1e3])
def test_what_a_search_can_find_a_model_can_state(scale: float) -> None:
    """Of every amount, however large or small its plant: a tilt of a magnet of 16 mm went beyond what may be stated."""
    for effect in CATALOGUE.values():
        for name in effect.amounts:
            powers = effect.parameter(name).of
            for size in (scale ** sum(power for _, power in powers), 1 / scale):
                unknown = EffectUnknown(effect.name, name, size=size)
                for z in (-1e9, 1e9):
                    EffectValues({effect.name: {name: float(unknown.value(np.array(z)))}})
    tilt = EffectUnknown("armature_tilt", "gap_variance", size=(16 / 0.6) ** 2)
    assert float(tilt.value(np.array(1e9))) == pytest.approx(1e-8 * (16 / 0.6) ** 2)


def test_an_offset_of_eight_millimetres_is_fitted() -> None:
    """Of a magnet of 16 mm, from its static map; with the scale of the servo the fit ends at the servo's bound."""
    actuator, table = large_magnet()
    grid = np.meshgrid(np.linspace(6e-3, 28e-3, 9), np.linspace(5.0, 50.0, 8), indexing="ij")
    gap, current = (values.ravel() for values in grid)
    rng = np.random.default_rng(3)
    force = table.force(current, gap + 8e-3) + 4.0 * rng.standard_normal(gap.size)
    flux = table.evaluate(current, gap + 8e-3)["flux_linkage"] + 1e-3 * rng.standard_normal(gap.size)
    static = StaticMap(gap, current, force, flux, np.full(gap.size, "fit"))
    record = Record("simulated", actuator, noise=Noise(force=4.0, flux_linkage=1e-3), static=static)
    rows = map_alone(record, ModelHypothesis(actuator, table))
    own = over_reference(CATALOGUE["gap_offset"].parameter("offset"), own_quantities(plant_parameters(actuator)))
    ends = {}
    for size in (1.0, own):
        unknowns = replace(rows.unknowns, effects=(EffectUnknown("gap_offset", "offset", size=size),))
        found = fit(rows.likelihood, unknowns, np.zeros(unknowns.size))
        ends[size] = float(unknowns.effects[0].value(found.z[-1]))
        assert (max(rows.likelihood.excess(found).values()) < 1.1) == (size == own)
    assert ends[1.0] == pytest.approx(0.54e-3)
    assert ends[own] == pytest.approx(8e-3, rel=0.005)
    assert EffectValues({"gap_offset": {"offset": 8e-3}}).get("gap_offset", "offset") == 8e-3
