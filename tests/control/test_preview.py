"""The reference a lead ahead: exact for smooth references, jumps come with their sample; what the loop makes of it."""

import dataclasses

import numpy as np
import pytest
from servo_controllers import RATE, believed, servo_belief, servo_design, sine

from msl_fem.control import ControllerChoice, closed_loop_response, designed, run_closed_loop
from msl_fem.control.design import without_preview
from msl_fem.control.preview import carried_on, known_ahead
from msl_fem.control.stepper import reference_rows
from msl_fem.plant.excitation import parse_excitation, reference

PERIOD = 1 / RATE


def sines(time: np.ndarray, frequency: float) -> np.ndarray:
    w = 2 * np.pi * frequency
    return np.stack([np.sin(w * time), w * np.cos(w * time), -(w**2) * np.sin(w * time)], axis=1)


def error_between_samples(period: float) -> float:
    time = np.arange(0.0, 0.1, period)
    lead = 1.9 * period
    ahead = known_ahead(sines(time, 40.0), period=period, lead=lead)
    return float(np.abs(ahead - sines(time + lead, 40.0))[:-3, 0].max())


def test_between_samples_the_error_falls_with_the_sixth_power_of_the_period() -> None:
    errors = [error_between_samples(period) for period in (2e-3, 1e-3)]
    assert errors[0] < 1e-2
    assert np.log2(errors[0] / errors[1]) == pytest.approx(6, abs=0.4)


@pytest.mark.parametrize("lead", [0.0, 0.3 * PERIOD, PERIOD, 1.9 * PERIOD, 3 * PERIOD])
def test_all_three_are_those_of_the_later_instant(lead: float) -> None:
    time = np.arange(200) * PERIOD
    wanted = sines(time + lead, 60.0)
    ahead = known_ahead(sines(time, 60.0), period=PERIOD, lead=lead)
    assert ahead[:-4] == pytest.approx(wanted[:-4], abs=2e-5 * np.abs(wanted).max(axis=0).max())
    assert np.isfinite(ahead).all()


def test_a_jump_comes_with_its_sample_and_makes_no_acceleration() -> None:
    stepped = np.zeros((20, 3))
    stepped[10:, 0] = 1e-4
    ahead = known_ahead(stepped, period=PERIOD, lead=1.9 * PERIOD)
    assert (ahead[:, 1:] == 0).all()
    assert (ahead[:9, 0] == 0).all()
    assert (ahead[9:, 0] == 1e-4).all()


def test_a_kink_of_a_ramp_makes_no_acceleration() -> None:
    ramp = reference(parse_excitation("ramp:frequency=5 Hz,amplitude=0.1 mm,duration=0.4 s", unit="m"), rate=RATE)
    samples = np.stack([ramp.position, ramp.velocity, ramp.acceleration], axis=1)
    ahead = known_ahead(samples, period=PERIOD, lead=1.9 * PERIOD)
    assert np.abs(ahead[:, 2]).max() < 1e-6 * np.ptp(ramp.velocity) / PERIOD


def test_without_preview_the_step_takes_what_the_acceleration_carries_on() -> None:
    design = without_preview(servo_design())
    samples = sines(np.arange(5) * PERIOD, 20.0)
    rows = reference_rows(design, samples, period=PERIOD)
    assert rows == pytest.approx(np.hstack([samples, carried_on(samples, design.parameters.lead)]))
    r, v, a = samples[3]
    lead = design.law.plant.lead
    assert rows[3, 3:] == pytest.approx([r + lead * v + lead**2 / 2 * a, v + lead * a, a])


def test_the_response_has_no_peak_where_the_reference_is_known_ahead() -> None:
    """By the linear law, and by sines through the loop up to where the amplifier's voltage is enough."""
    f = np.geomspace(2.0, 200.0, 60)
    gain = 20 * np.log10(np.abs(servo_design().law.reference_response(f)))
    assert np.abs(gain).max() < 0.5
    causal = dataclasses.replace(servo_design().law, preview=False)
    assert 20 * np.log10(np.abs(causal.reference_response(f))).max() > 5
    through = closed_loop_response(servo_design(), plant=believed(), frequencies=[60.0, 100.0, 150.0], amplitude=1e-4)
    assert np.abs(through.gain).max() < 0.5
    assert np.abs(through.response - through.predicted)[:2].max() < 0.01


def test_a_fast_sine_is_tracked_ten_times_better() -> None:
    errors = []
    for preview in (True, False):
        design = designed(servo_belief(), ControllerChoice(preview=preview)) if not preview else servo_design()
        run = run_closed_loop(design, sine(1e-4, 60.0, 0.6), plant=believed())
        late = run.time > 0.3
        errors.append(np.sqrt(np.mean((run.position - run.reference)[late] ** 2)) / 1e-4)
    assert errors[0] < 0.003
    assert errors[1] > 10 * errors[0]
