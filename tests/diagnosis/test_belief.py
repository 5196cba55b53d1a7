"""What is believed of effects before anything is measured: its place in fits, its prior, and what may be named."""

from dataclasses import replace

import numpy as np
import pytest
from diagnosed import SERVO, TABLE

from msl_fem.diagnosis.decision import known_within
from msl_fem.diagnosis.unknowns import EffectUnknown, Unknowns, fixed_of
from msl_fem.plant.believed import PLAIN_BELIEF, Belief, BelievedValue
from msl_fem.plant.effects import PARAMETER_INDEX
from msl_fem.plant.plant import plant_parameters
from msl_fem.prediction import ModelHypothesis, free_parameters, kernel_plant
from msl_fem.prediction.hypothesis import believed_value, unit_of_believed
from msl_fem.record import Tolerance
from msl_fem.report.belief_stage import belief_stage, drawn_otherwise

CUBIC, FILM = ("stiffness_nonlinearity", "cubic"), ("squeeze_film", "damping")
BELIEF = Belief(
    "as-designed",
    (
        BelievedValue(*CUBIC, 1e11, 1e10, "leaves"),
        BelievedValue(*FILM, 0.003, 0.0006, "faces"),
        BelievedValue("mutual_inductance", "share", -0.023, 0.001, "field of both sides"),
        BelievedValue("coil_heating", "rise_per_joule", 1e-4, 3e-5, "copper"),
        BelievedValue("coil_heating", "cooling_rate", 0.005, 0.0015, "copper"),
    ),
)
MODEL = ModelHypothesis.of(SERVO, TABLE, BELIEF)


def test_a_sigma_is_the_tolerance_of_a_believed_parameter() -> None:
    """Amounts of effects stand beside mass and stiffness, relative; shapes are taken as they are."""
    free = free_parameters(MODEL, Tolerance())
    assert free["stiffness_nonlinearity.cubic"] == pytest.approx(0.1)
    assert free["mutual_inductance.share"] == pytest.approx(1 / 23)
    assert "coil_heating.cooling_rate" not in free
    assert free.keys() - MODEL.known.keys() == free_parameters(ModelHypothesis(SERVO, TABLE), Tolerance()).keys()
    assert believed_value(MODEL, "stiffness_nonlinearity.cubic") == 1e11
    assert unit_of_believed("stiffness_nonlinearity.cubic") == "N/m^3"
    assert unit_of_believed("moving_mass") == "kg"


def test_a_factor_of_a_fit_changes_the_believed_effect() -> None:
    """In the kernel's plant of a re-fit, and in the vector of a diagnosis, by 1 + sigma z."""
    refitted = kernel_plant(MODEL, rate=1e4, factors={"stiffness_nonlinearity.cubic": 1.2}).readings
    assert refitted[PARAMETER_INDEX[CUBIC]] == pytest.approx(1.2e11)
    assert refitted[PARAMETER_INDEX[FILM]] == 0.003
    unknowns = Unknowns((("moving_mass", 0.005), ("stiffness_nonlinearity.cubic", 0.1)), 0, (), fixed=fixed_of(MODEL))
    assert not unknowns.plain
    vector = unknowns.effect_vector(np.array([3.0, -2.0]))
    assert vector[PARAMETER_INDEX[CUBIC]] == pytest.approx(0.8e11)
    assert vector[PARAMETER_INDEX["coil_heating", "cooling_rate"]] == 0.005
    assert np.count_nonzero(unknowns.effect_vector(np.zeros(2))) >= 5


def test_an_effect_is_tried_about_what_is_believed_of_it() -> None:
    """z = 0 is the believed value; a film may vanish and no more; with its factor both add."""
    film = EffectUnknown(*FILM, believed=0.003)
    assert float(film.value(np.array(0.0))) == 0.003
    low, high = film.bounds
    assert float(film.value(np.array(low))) == pytest.approx(0.0, abs=1e-15)
    assert high == np.inf
    assert film.z_of(film.value(np.array(0.7))) == pytest.approx(0.7)
    unknowns = Unknowns((("squeeze_film.damping", 0.2),), 0, (), (film,), fixed_of(MODEL))
    vector = unknowns.effect_vector(np.array([1.0, 0.5]))
    assert vector[PARAMETER_INDEX[FILM]] == pytest.approx(0.003 * 1.2 + 0.5 * 10 * 1.0, rel=0.2)
    plain = EffectUnknown(*FILM)
    assert plain.base == 0.0
    assert plain.bounds == (0.0, np.inf)


def test_what_the_drawing_knows_bounds_what_is_named() -> None:
    """The larger one of the instrument's tolerance and of the drawing's sigma counts, or the effect stands apart."""
    sigmas = {"mutual_inductance": 0.003, "mutual_inductance.share": 1 / 23, "stiffness_nonlinearity.cubic": 0.1}
    mutual = EffectUnknown("mutual_inductance", "share", believed=-0.023)
    assert known_within(sigmas, mutual) == pytest.approx(0.003)
    assert known_within({**sigmas, "mutual_inductance": 0.0005}, mutual) == pytest.approx(0.001)
    assert known_within(sigmas, EffectUnknown(*CUBIC, believed=1e11)) == pytest.approx(1e10)
    assert known_within({}, EffectUnknown(*CUBIC)) is None


def test_a_plain_belief_changes_nothing() -> None:
    model = ModelHypothesis.of(SERVO, TABLE, PLAIN_BELIEF)
    assert model.effects is None
    assert fixed_of(model) == ()
    assert kernel_plant(model, rate=1e4).effects is None
    assert plant_parameters(SERVO).mutual == 0.0


def test_the_report_holds_what_was_found_against_the_drawing() -> None:
    """A film of 50 N s/m is told to be impossible here; the believed one is not."""
    [told] = drawn_otherwise(BELIEF, {FILM: 50.0, CUBIC: 1.05e11})
    assert "squeeze_film.damping: the drawing tells 3 mN s/m" in told
    stage = belief_stage(BELIEF, {FILM: 50.0})
    assert told in stage.sentence
    assert len(stage.table.rows) == 5
    assert "--belief plain" in belief_stage(replace(BELIEF, name="plain")).sentence
