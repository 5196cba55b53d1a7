"""The trials of a design: margins against python-control, replay of currents, degradation, and the page of them."""

import dataclasses
from functools import cache

import control
import numpy as np
import pytest
from servo_controllers import TABLE, believed, rival, servo, servo_design, sine

from msl_fem.control import Examination, PlantUnderTest, examine_design, replay, run_closed_loop
from msl_fem.control.linear_loop import grid
from msl_fem.control.margins import margins
from msl_fem.control.spec_sheet import spec_sheet
from msl_fem.plant.effects import EffectValues
from msl_fem.report.control_page import control_page
from msl_fem.report.page import write_page


@cache
def examined() -> Examination:
    return examine_design(servo_design(), plant=believed())


def test_the_margins_are_those_of_python_control():
    law = servo_design().law
    f = grid(law.plant.period, 4000)
    plant, made = law.plant.sampled(), law.controller()
    period = law.plant.period
    loop = control.ss(plant.A, plant.B, plant.C, plant.D, period) * control.ss(
        made.A, -made.B[:, :1], made.C[:1], -made.D[:1, :1], period
    )  # fmt: skip
    up = control.stability_margins(loop)[0]
    transfer = control.frequency_response(loop, 2 * np.pi * f).complex.ravel()  # its crossings are roots: 0.05 Hz off
    crossing = np.argmin(np.abs(np.abs(transfer) - 1))
    phase = np.degrees(np.angle(-transfer[crossing]))
    found = margins(law.loop_transfer(f), f)
    assert found.gain_up == pytest.approx(up, rel=1e-3)
    assert found.phase == pytest.approx(phase, abs=0.2)
    assert found.gain_down == 0.0


def test_a_loop_around_an_unstable_pole_has_a_margin_downwards():
    """L = 2/(s - 1) is stable for gains above 1/2, lost at rest, where the curve meets its mirror image."""
    w = np.geomspace(1e-3, 1e3, 4000)
    transfer = 2 / (1j * w - 1)
    found = margins(np.concatenate([transfer[:1].conj(), transfer]), np.concatenate([[0.5e-3], w]) / (2 * np.pi))
    assert found.gain_up == np.inf
    assert found.gain_down == pytest.approx(0.5, rel=1e-3)
    assert found.phase == pytest.approx(60.0, abs=0.1)


def test_margins_on_the_margin():
    """With its gain raised by its margin the loop has a pole on the circle."""
    law = servo_design().law
    place = servo_design().frozen[16].at
    f = grid(law.plant.period, 4000)
    found = margins(law.loop_transfer(f, place), f)
    for factor in (found.gain_up, found.gain_down):
        assert law.spectral_radius(dataclasses.replace(place, gain=factor)) == pytest.approx(1.0, abs=2e-4)


def test_a_delay_of_the_margin_brings_the_loop_to_the_margin():
    """Closed form: L = K exp(-s tau)/s has the phase margin pi/2 at K rad/s, so a delay of pi/(2 K) is too much."""
    f = np.geomspace(0.1, 100.0, 3000)
    w = 2 * np.pi * f
    found = margins(20.0 / (1j * w), f)
    assert found.phase == pytest.approx(90.0, abs=0.1)
    assert found.delay == pytest.approx(np.pi / 40, rel=1e-4)
    late = margins(20.0 / (1j * w) * np.exp(-1j * w * 0.99 * found.delay), f)
    assert late.phase == pytest.approx(0.9, abs=0.05)
    assert late.gain_up == pytest.approx(1 / 0.99, rel=2e-3)


def test_a_replay_of_the_believed_plant_is_the_plant():
    run = run_closed_loop(servo_design(), sine(0.3e-3, 5.0, 1.0), plant=believed())
    found = replay(servo_design(), run)
    assert found.nrmse < 0.01
    assert np.corrcoef(found.force[50:], run.force[48:-2])[0, 1] > 0.98


def test_a_replay_tells_a_plant_that_is_not_the_believed_one():
    other = PlantUnderTest(servo(), TABLE, EffectValues({"gap_offset": {"offset": 18e-6}}))
    run = run_closed_loop(servo_design(), sine(0.3e-3, 5.0, 1.0), plant=other)
    assert replay(servo_design(), run).nrmse > 0.03


def test_the_trials_of_the_reference_actuator():
    found = examined()
    assert not any(isinstance(run, str) for run in found.runs.values())
    assert found.degradation.error.shape == (7, 7)
    low = found.degradation.error[2]
    assert (np.diff(low[:5]) > 0).all(), "up to 40 Hz"
    assert np.nanmax(low) < 0.005, "the reference is known ahead: fast sines too"
    endings = [ending for row in found.degradation.ending for ending in row]
    assert "kept" in endings
    assert set(endings) - {"kept"}
    nothing = np.array([[e in ("lost", "refused") for e in row] for row in found.degradation.ending])
    np.testing.assert_array_equal(np.isnan(found.degradation.error), nothing)
    assert found.integral_alone > 50 * found.runs["sine"].tracking_rms
    for x, s in found.sensitivity.items():
        p = next(p for p in found.design.frozen if p.position == x)
        assert s.max() == pytest.approx(p.peak_sensitivity, rel=1e-9)
        np.testing.assert_array_less(np.abs(s - found.complementary[x]), 1 + 1e-9)
    assert found.consistency is not None
    assert found.replays[0].nrmse < 0.02


def test_the_page_tells_the_trials(tmp_path):
    html = write_page(control_page(examined(), spec_sheet(examined().design)), tmp_path / "page.html").read_text()
    for words in ("Fig. 6", "Fig. 8", "Fig. 9", "Fig. 10", "Fig. 11", "ISO 14839-3", "Sensitivity over the range"):
        assert words in html
    rms = examined().runs["sine"].tracking_rms
    assert f"{rms * 1e9:.3g} nm" in html


def test_a_page_of_a_design_that_loses_a_reference_says_so(tmp_path):
    short = dataclasses.replace(
        rival("pid"), reach=(-0.1e-3, 0.1e-3)
    )  # its trials ask for what the reach does not hold
    found = examine_design(short, plant=believed())
    assert isinstance(found.runs["sine"], str)
    html = write_page(control_page(found, spec_sheet(found.design)), tmp_path / "page.html").read_text()
    assert "No run: the reference goes from" in html
    assert "no Kalman filter" in html
