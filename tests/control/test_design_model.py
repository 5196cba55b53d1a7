"""What a controller may know beside the actuator file: effects, and identified rational terms."""

import dataclasses

import numpy as np
import pytest
from servo_controllers import TABLE, believed, rest, servo, servo_belief, servo_design, servo_map, sine

from msl_fem.control import (
    ControllerChoice,
    ForceTerm,
    IdentifiedPlant,
    PlantUnderTest,
    design_model_of_terms,
    design_model_with_effects,
    designed,
    innovation_consistency,
    lqr_design,
    reach_of,
    run_closed_loop,
)
from msl_fem.control.design_model import left_to_feedback, plant_with_effects, surface_with_effects
from msl_fem.control.inverse import magnet_force
from msl_fem.control.linear_plant import linear_plant
from msl_fem.control.rational_force import term_force
from msl_fem.errors import InputError
from msl_fem.plant import plant_parameters, static_map, surface_of
from msl_fem.plant.effects import EffectValues

KNOWN = EffectValues(
    {
        "gap_offset": {"offset": 15e-6, "centring": -10e-6},
        "fringing": {"growth": 80.0, "depth_error": 0.01, "turns_error": -0.02},
        "early_saturation": {"knee_shift": 0.1},
        "stiffness_nonlinearity": {"cubic": 9e10},
        "force_offset": {"force": 4.0},
        "amplifier_bandwidth": {"lag": 1e-4},
        "time_delay": {"command": 3e-4},
    }
)
HIDDEN = PlantUnderTest(servo(), TABLE, KNOWN)


def noise() -> np.random.Generator:
    return np.random.default_rng(1)


def test_the_surface_with_effects_is_that_of_the_coupled_model():
    """Forces at rest by the kernel's own path, gap offset apart."""
    effects = EffectValues({k: v for k, v in KNOWN.stated.items() if k in ("fringing", "early_saturation")})
    gap, current = (a.ravel() for a in np.meshgrid([0.1e-3, 0.37e-3, 0.9e-3], [0.4, 1.7, 6.0]))
    force, _ = static_map(surface_of(TABLE), plant_parameters(servo()), effects, gap=gap, current=current)
    made = surface_with_effects(TABLE, effects)
    ours = [magnet_force(made, i, g) for i, g in zip(current, gap, strict=True)]
    np.testing.assert_allclose(ours, force, rtol=2e-5)


def test_without_effects_the_surface_is_the_tables_own():
    made, plain = surface_with_effects(TABLE, EffectValues()), surface_of(TABLE)
    np.testing.assert_allclose(made.coefficients, plain.coefficients, rtol=1e-9, atol=1e-9 * plain.coefficients.max())


def test_knowing_the_effects_brings_the_tracking_back():
    told = lqr_design(design_model_with_effects(servo(), TABLE, servo_map(), KNOWN))
    track = sine(0.35e-3, 5.0, 1.0)
    knows, guesses = (run_closed_loop(d, track, plant=HIDDEN, generator=noise()) for d in (told, servo_design()))
    assert knows.tracking_rms < 0.002 * 0.35e-3
    assert guesses.tracking_rms > 3 * knows.tracking_rms


def test_innovations_tell_a_plant_that_is_not_the_believed_one():
    still = rest(1.5, 0.2e-3)
    right, wrong = (
        innovation_consistency(servo_design(), run_closed_loop(servo_design(), still, plant=plant, generator=noise()))
        for plant in (believed(), HIDDEN)
    )
    assert right.over_sensor == pytest.approx(1.0, abs=0.1)
    assert not right.more_than_noise
    assert wrong.more_than_noise
    assert not any(it.exceeded for it in (right, wrong))  # the filter allows for errors of the force


def test_lags_and_delays_go_into_the_linear_plant():
    plain = linear_plant(servo())
    slow = plant_with_effects(
        plain,
        EffectValues(
            {
                "amplifier_bandwidth": {"lag": 1e-4, "bandwidth_error": -0.5}, "eddy_currents": {"time_constant": 5e-5},
                "time_delay": {"command": 9e-4}, "squeeze_film": {"damping": 2.0},
            }
        ),
        sides=2,
    )  # fmt: skip
    assert slow.delay == plain.delay + 2
    assert 1 / slow.lag == pytest.approx(2 / plain.lag + 1e-4 + 5e-5 + 1e-4)
    assert slow.damping == plain.damping + 4.0
    assert plant_with_effects(plain, EffectValues(), sides=2) == plain


def test_a_plant_of_one_side_has_one_film():
    film = EffectValues({"squeeze_film": {"damping": 3.0}})
    one, two = servo(sides={"count": 1}), servo()
    assert design_model_with_effects(one, TABLE, servo_map(), film).plant.damping == 12.0 + 3.0
    assert design_model_with_effects(two, TABLE, servo_map(), film).plant.damping == 12.0 + 6.0


def test_what_no_design_can_use_is_named():
    effects = EffectValues(
        {
            "sensor_drift": {"rate": 1e-7}, "gap_offset": {"offset": 1e-5},
            "structural_mode": {"mass_share": 0.05, "frequency": 300.0},
        }
    )  # fmt: skip
    assert left_to_feedback(effects) == ("sensor_drift.rate", "structural_mode.mass_share")
    belief = design_model_with_effects(servo(), TABLE, servo_map(), effects)
    assert belief.domain()["known_but_left_to_feedback"] == ["sensor_drift.rate", "structural_mode.mass_share"]


def test_a_believed_centring_shifts_what_each_side_is_inverted_at():
    belief = design_model_with_effects(servo(), TABLE, servo_map(), EffectValues({"gap_offset": {"centring": 2e-5}}))
    assert (belief.inverse.gap_1, belief.inverse.gap_2) == (pytest.approx(0.62e-3), pytest.approx(0.58e-3))


def test_a_believed_force_moves_the_middle_that_is_held():
    belief = design_model_with_effects(servo(), TABLE, servo_map(), EffectValues({"force_offset": {"force": 10.0}}))
    assert belief.holding_force(0.0) == -10.0
    run = run_closed_loop(
        lqr_design(belief),
        rest(0.4),
        plant=PlantUnderTest(servo(), TABLE, EffectValues({"force_offset": {"force": 10.0}})),
    )
    assert abs(run.position[-1]) < 0.05e-6


# i^2/(g + delta)^2 with the constant that the closed-form magnet has at small currents, two magnets a side
CONSTANT = 2 * float(TABLE.force(0.2, 0.6e-3)) / 0.2**2 * (0.6e-3 + 1e-5) ** 2
SQUARES = (ForceTerm(1, 2, 2, CONSTANT), ForceTerm(2, 2, 2, -CONSTANT))
IDENTIFIED = IdentifiedPlant(1.4e5, 12.0, SQUARES, 1e-5)


def test_the_surface_of_terms_is_the_terms():
    terms = (
        *SQUARES,
        ForceTerm(1, 3, 1, 4e-2),
        ForceTerm(1, 1, 1, 1e-4),
        ForceTerm(1, 2, 0, 0.05),
        ForceTerm(2, 4, 3, -1e-12),
    )
    belief = design_model_of_terms(servo(), dataclasses.replace(IDENTIFIED, terms=terms), servo_map())
    for side, surface in ((1, belief.inverse.surface_1), (2, belief.inverse.surface_2)):
        for gap in (0.06e-3, 0.3e-3, 1.1e-3):
            for current in (0.3, 1.0, 5.0):
                wanted = float(term_force(terms, 1e-5, side, np.array(current), np.array(gap)))
                assert 2 * magnet_force(surface, current, gap) == pytest.approx(wanted, rel=1e-4)


def test_the_sides_of_identified_terms_may_differ():
    uneven = (ForceTerm(1, 2, 2, CONSTANT), ForceTerm(2, 2, 2, -2 * CONSTANT))
    inverse = design_model_of_terms(servo(), dataclasses.replace(IDENTIFIED, terms=uneven), servo_map()).inverse
    one, two = (magnet_force(s, 1.0, 0.5e-3) for s in (inverse.surface_1, inverse.surface_2))
    assert two == pytest.approx(2 * one, rel=1e-9)


def test_terms_for_parallel_coils_are_those_of_the_sides_current():
    parallel = servo(sides={"connection": "parallel"}, drive={"current_limit": 24.0, "voltage_limit": 40.0})
    inverse = design_model_of_terms(parallel, IDENTIFIED, servo_map()).inverse
    side = float(term_force(SQUARES, 1e-5, 1, np.array(1.0), np.array(0.5e-3)))
    assert 2 * magnet_force(inverse.surface_1, 0.5, 0.5e-3) == pytest.approx(side, rel=1e-6)


def test_the_inverse_of_terms_ends_where_their_force_stops_growing():
    """F = a i^2 - b i^4 has its largest value at i^2 = a/(2 b), here at 3 A at any gap."""
    bent = tuple(
        ForceTerm(t.side, p, 2, c) for t in SQUARES for p, c in ((2, t.coefficient), (4, -t.coefficient / 18.0))
    )
    belief = design_model_of_terms(servo(), dataclasses.replace(IDENTIFIED, terms=bent), servo_map())
    assert belief.domain()["magnet_current_A"][1] == pytest.approx(3.0, abs=0.05)
    assert belief.domain()["source"] == "rational terms"


def test_the_loop_runs_on_identified_terms():
    made = designed(design_model_of_terms(servo(), IDENTIFIED, servo_map()), ControllerChoice("lqr"))
    run = run_closed_loop(made, sine(0.3e-3, 2.0, 1.0), plant=believed(), generator=noise())
    assert run.tracking_rms < 0.02 * 0.3e-3
    assert run.guard_violations == 0


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"terms": SQUARES[:1]}, "no term of side 2"),
        ({"terms": (SQUARES[0], ForceTerm(2, 2, 2, CONSTANT))}, "force of side 2 does not grow"),
        ({"delta": -6e-5}, "closes the map's smallest gap"),
    ],
)
def test_terms_without_an_inverse_are_refused(changes, said):
    with pytest.raises(InputError, match=said):
        design_model_of_terms(servo(), dataclasses.replace(IDENTIFIED, **changes), servo_map())


def test_the_reach_counts_the_believed_suspension():
    soft = dataclasses.replace(IDENTIFIED, stiffness=1e4)
    weak = servo(drive={"current_limit": 0.5})
    ends = [reach_of(design_model_of_terms(weak, it, servo_map()))[1] for it in (soft, IDENTIFIED)]
    assert ends[0] > ends[1]
    assert reach_of(servo_belief())[1] == 0.5e-3


def test_too_short_a_run_has_no_consistency():
    run = run_closed_loop(servo_design(), rest(0.25), plant=believed(), generator=noise())
    with pytest.raises(InputError, match="too few"):
        innovation_consistency(servo_design(), run)
