"""The controller asked sample by sample is the one of the compiled loop; what a record states of it."""

import numpy as np
import pytest
from servo_controllers import RATE, TABLE, believed, servo, servo_design

from msl_fem.control import run_closed_loop
from msl_fem.control.stepper import Stepper, stated
from msl_fem.plant.excitation import parse_excitation, reference
from msl_fem.plant.sampled_plant import simulate_closed

WANTED = reference(parse_excitation("sine:frequency=20 Hz,amplitude=0.1 mm,duration=0.1 s,loop=closed"), rate=RATE)


def test_asked_by_hand_or_compiled_the_loop_is_one() -> None:
    """The compiled loop integrates the plant with larger steps: some nanometres of a tenth of a millimetre."""
    compiled_run = run_closed_loop(servo_design(), WANTED, plant=believed())
    stepper = Stepper(servo_design())
    run = simulate_closed(servo(), TABLE, WANTED, stepper)
    assert np.abs(run.position - compiled_run.position).max() < 5e-8
    assert run.command == pytest.approx(compiled_run.acting, abs=2e-3)
    again = simulate_closed(servo(), TABLE, WANTED, stepper)
    assert (again.position == run.position).all(), "every run begins anew"


def test_what_a_record_states() -> None:
    design = servo_design()
    section = stated(design)
    assert (section["rate"], section["delay_samples"], section["design"]) == ("2500 Hz", 1, "lqr")
    assert section["gain"] == design.law.gains.state.tolist()
    assert Stepper(design).rate == RATE
    assert Stepper(design).delay_samples == 1
