"""Gains that follow the magnets' stiffness: the peak over the range, the step's own gains, load as position."""

from importlib import import_module

import numpy as np
import pytest
from servo_controllers import RATE, TABLE, believed, plain, rival, servo, servo_belief, servo_design, sine

from msl_fem.control import (
    ControllerDesign,
    PlantUnderTest,
    Wish,
    closed_loop_record,
    measured_loops,
    run_closed_loop,
)
from msl_fem.control.controller import pull_stiffness
from msl_fem.control.injection import held_under_test
from msl_fem.control.robust_design import FAMILY, HOPELESS, family_at, family_grid, family_peaks
from msl_fem.control.scheduled_design import scheduled_design
from msl_fem.control.spec_sheet import spec_sheet
from msl_fem.control.unseen_plants import on_unseen_plants
from msl_fem.errors import InputError
from msl_fem.plant.effects import EffectValues
from msl_fem.plant.excitation import parse_excitation


def test_the_peak_stays_low_to_four_fifths_of_the_travel_and_above_the_bound() -> None:
    fixed = {round(p.position * 1e6): p.peak_sensitivity for p in servo_design().frozen}
    for p in rival("scheduled-rigid").frozen:
        x = round(p.position * 1e6)
        assert p.bound <= p.peak_sensitivity <= fixed[x] * (1 + 1e-9)
        if abs(x) <= 400:
            assert p.peak_sensitivity <= 2.2
    assert rival("scheduled-rigid").frozen[-1].peak_sensitivity < 0.8 * fixed[500]


def test_disturbances_are_borne_as_by_the_fixed_gains_in_the_middle_and_larger_ones_outside() -> None:
    ours, fixed = spec_sheet(rival("scheduled-rigid")), spec_sheet(servo_design())
    assert ours.least_stiffness == pytest.approx(fixed.least_stiffness)
    assert ours.largest_disturbance > 1.3 * fixed.largest_disturbance


def test_the_step_has_the_gains_of_its_place() -> None:
    """By another route: the running loop's sensitivity is measured where fixed gains would have a larger one."""
    spec = "multisine:start=20 Hz,stop=600 Hz,amplitude=0.2 um,bias=0.45 mm,duration=4 s,periods=1"
    held = held_under_test(parse_excitation(spec, unit="m"), rate=RATE)
    design = rival("scheduled-rigid")
    plant = PlantUnderTest(servo(position_sensor={"bandwidth": None}), TABLE)
    run = run_closed_loop(
        design, held.reference, plant=plant, generator=np.random.default_rng(2), injection=held.signal
    )
    measured = measured_loops(closed_loop_record(servo(), run, excitation=spec, injection=held.signal))[0]
    at = next(p for p in design.frozen if p.position == pytest.approx(0.45e-3))
    fixed = next(p for p in servo_design().frozen if p.position == pytest.approx(0.45e-3))
    assert measured.peak.interval[0] < at.peak_sensitivity < measured.peak.interval[1]
    assert measured.peak.interval[1] < 0.9 * fixed.peak_sensitivity


def test_a_load_moves_the_gains_as_a_position_does() -> None:
    design = rival("scheduled-rigid")
    far = design.law_at(0.4e-3)
    held = design.suspension * 0.4e-3
    stiffness = pull_stiffness(held, 0.4e-3, 0.6e-3)
    assert stiffness == pytest.approx(2 * held / 0.2e-3)
    loaded = design.law_at(0.0, push=-stiffness * 0.6e-3 / 2)
    assert loaded.gains.state == pytest.approx(far.gains.state)
    assert loaded.estimator.gain == pytest.approx(far.estimator.gain)
    assert far.gains.integral < 0.8 * design.law.gains.integral


def test_a_pull_takes_stiffness_from_the_side_that_pulls() -> None:
    assert pull_stiffness(10.0, 0.1e-3, 0.6e-3) == pytest.approx(20.0 / 0.5e-3)
    assert pull_stiffness(-10.0, 0.1e-3, 0.6e-3) == pytest.approx(20.0 / 0.7e-3)
    assert pull_stiffness(10.0, 0.6e-3, 0.6e-3) == pytest.approx(20.0 / 0.03e-3)


def test_tracking_is_that_of_the_fixed_gains() -> None:
    errors = [
        run_closed_loop(d, sine(0.4e-3, 2.0, 1.0), plant=believed()) for d in (rival("scheduled-rigid"), servo_design())
    ]
    assert errors[0].tracking_rms == pytest.approx(errors[1].tracking_rms, rel=0.3)
    assert errors[0].guard_violations == 0


def test_a_family_with_a_second_mass_is_borne_where_the_rigid_schedule_loses_it() -> None:
    """At frozen positions by poles and peaks; moving, with a larger mass than the family's."""
    design, rigid = rival("scheduled"), rival("scheduled-rigid")
    f = family_grid(FAMILY, 1 / RATE, 120)

    def worst(of: ControllerDesign, x: float) -> float:
        law, at = of.law_at(x), servo_belief().place(x)
        return max(family_peaks(law, at, law.feedback(f, at), family_at(law.plant, FAMILY, at, f)))

    for x in (0.0, 0.1e-3, 0.2e-3):
        assert worst(design, x) < 4.5
        assert worst(rigid, x) > HOPELESS
    assert design.peak_sensitivity < 2.05
    assert design.feedback_bandwidth > 59.0
    effects = EffectValues({"structural_mode": {"mass_share": 0.083, "frequency": 400.0}})
    plant = PlantUnderTest(servo(), TABLE, effects)
    moving = on_unseen_plants(design, sine(0.2e-3, 5.0, 0.4), lambda _: plant, n=1)
    assert moving.error[0] < 0.02
    assert moving.violations.sum() == 0


def test_a_wish_that_no_law_keeps_for_the_family_names_the_way_out(monkeypatch) -> None:
    for module in ("robust_design", "scheduled_design"):
        monkeypatch.setattr(import_module(f"msl_fem.control.{module}"), "_EVALUATIONS", 3)
    with pytest.raises(InputError, match="scheduled-rigid where the mover has no second mass"):
        scheduled_design(servo_belief(), Wish(150.0, 1.3))


def test_other_designs_have_fixed_gains() -> None:
    assert not servo_design().schedule.moves
    assert servo_design().law_at(0.45e-3) is servo_design().law
    assert plain(servo_design()).law_to_json()["law"]["schedule"] is None
    assert rival("scheduled-rigid").law_to_json()["law"]["schedule"]["stiffness_N_per_m"][0] == 0.0
