"""The catalogue of effects and values of it."""

import numpy as np
import pytest

from msl_fem.errors import InputError
from msl_fem.files.quantity import parse_quantity
from msl_fem.files.toml_text import quantity_text
from msl_fem.plant.effects import (
    CATALOGUE,
    PARAMETER_INDEX,
    EffectValues,
    find_effect,
    find_parameter,
    from_vector,
    neutral_vector,
)

NAMES = [
    "gap_offset",
    "early_saturation",
    "fringing",
    "magnetic_hysteresis",
    "eddy_currents",
    "cross_coupling",
    "armature_tilt",
    "leakage_inductance",
    "mutual_inductance",
    "remanent_flux",
    "coil_heating",
    "amplifier_bandwidth",
    "drive_limit",
    "current_sensor_error",
    "thermal_history",
    "stiffness_nonlinearity",
    "coulomb_friction",
    "squeeze_film",
    "structural_mode",
    "flexure_relaxation",
    "force_offset",
    "support_compliance",
    "position_sensor_nonlinearity",
    "position_sensor_lag",
    "position_sensor_crosstalk",
    "time_delay",
    "periodic_disturbance",
    "sensor_drift",
]
PARAMETERS = [(e.name, p) for e in CATALOGUE.values() for p in e.parameters]


def test_the_names_are_those_of_the_file_formats_in_their_order() -> None:
    assert list(CATALOGUE) == NAMES
    assert {e.group for e in CATALOGUE.values()} == {"magnetic", "electrical", "mechanical", "sensing and timing"}


@pytest.mark.parametrize("name", CATALOGUE)
def test_an_entry_says_what_it_must(name: str) -> None:
    effect = CATALOGUE[name]
    assert effect.sentence
    assert effect.equation
    assert effect.source
    assert any(not p.shape for p in effect.parameters), "something must switch it on"
    assert len({p.name for p in effect.parameters}) == len(effect.parameters)


@pytest.mark.parametrize(("effect", "parameter"), PARAMETERS, ids=[f"{e}.{p.name}" for e, p in PARAMETERS])
def test_a_parameter_is_consistent(effect: str, parameter) -> None:
    low, high = parameter.bounds
    assert low <= parameter.neutral <= high
    assert parameter.scale > 0
    assert low <= parameter.neutral + parameter.scale <= high
    if not parameter.shape:
        assert parameter.neutral == 0.0, "neutral is zero, so that a file need not state it"
    text = quantity_text(parameter.scale, parameter.unit)
    assert parse_quantity(text, parameter.unit) == pytest.approx(parameter.scale, rel=1e-15)


def test_values_go_through_a_vector_and_back() -> None:
    values = EffectValues({"eddy_currents": {"time_constant": 1e-4}, "coulomb_friction": {"force": 0.2}})
    vector = values.vector()
    assert vector.shape == (len(PARAMETER_INDEX),)
    assert vector[PARAMETER_INDEX["coulomb_friction", "presliding"]] == 1e-6
    assert from_vector(vector) == values
    assert values.present == ("eddy_currents", "coulomb_friction")
    assert from_vector(neutral_vector()).stated == {}


def test_a_shape_alone_makes_no_effect() -> None:
    assert EffectValues({"structural_mode": {"frequency": 900.0}}).present == ()


@pytest.mark.parametrize(
    ("stated", "complaint"),
    [
        ({"eddy": {}}, "'eddy' is no effect of the catalogue; there are gap_offset, "),
        ({"eddy_currents": {"tau": 1.0}}, "'tau' is no parameter of eddy_currents; there are time_constant"),
        ({"eddy_currents": {"time_constant": -1e-4}}, r"-0\.0001 s is not allowed; it must be 0 \.\.\. 0\.05 s"),
        ({"fringing": {"growth": float("nan")}}, "growth: nan m.-1 is not allowed"),
    ],
)
def test_values_that_cannot_be_are_refused(stated: dict, complaint: str) -> None:
    with pytest.raises(InputError, match=complaint):
        EffectValues(stated)


def test_what_is_not_there_is_not_found() -> None:
    assert find_parameter("fringing", "growth").unit == "m^-1"
    with pytest.raises(InputError, match="no effect"):
        find_effect("gravity")
    with pytest.raises(InputError, match=f"has {len(PARAMETER_INDEX)} entries"):
        from_vector(np.zeros(3))
