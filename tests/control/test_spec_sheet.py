"""The sheet of a loop's figures: against the law's own, against runs, and where there is nothing to promise."""

import dataclasses

import numpy as np
import pytest
from servo_controllers import believed, plain, rest, servo_design, sine

from msl_fem.control import closed_loop_response, run_closed_loop
from msl_fem.control.design import without_preview
from msl_fem.control.held_input import with_delay
from msl_fem.control.inverse import force_limits
from msl_fem.control.spec_sheet import SpecSheet, spec_sheet
from msl_fem.errors import ComputationError, InputError


def test_the_peak_of_the_reference_is_seen_and_where() -> None:
    known = spec_sheet(servo_design()).to_json()
    assert known["reference_peak_dB"] < 0.1
    assert known["band_3dB_Hz"] > known["band_1dB_Hz"] > 300
    assert known["reference_known_ahead"]
    carried = spec_sheet(without_preview(servo_design())).to_json()
    assert carried["reference_peak_dB"] == pytest.approx(6.2, abs=0.2)
    assert 200 < carried["reference_peak_Hz"] < 400
    assert carried["band_1dB_Hz"] < 70
    assert not carried["reference_known_ahead"]


def test_the_bands_are_those_of_sines_through_the_loop() -> None:
    sheet = spec_sheet(plain(servo_design()))
    f = [0.8 * sheet.flat_band, 0.99 * sheet.wide_band, 1.03 * sheet.wide_band]
    gain = closed_loop_response(sheet.design, plant=believed(), frequencies=f).gain
    assert abs(gain[0]) < 1.0
    assert abs(gain[1]) < 3.2
    assert abs(gain[2]) > 2.8


def test_margins_are_the_worst_of_the_working_positions() -> None:
    sheet = spec_sheet(servo_design())
    fields = sheet.to_json()
    working = [p for p in fields["positions"] if abs(p["position_m"]) <= 0.8001 * sheet.design.reach[1]]
    assert 0 < len(working) < len(fields["positions"])
    assert fields["worst_peak_sensitivity"] == max(p["peak_sensitivity"] for p in working)
    assert abs(fields["worst_peak_sensitivity_at_m"]) == pytest.approx(0.4e-3, rel=0.02)
    assert fields["delay_margin_s"] == min(p["delay_margin_s"] for p in working)
    assert fields["worst_peak_sensitivity"] > fields["peak_sensitivity"]


def test_a_loop_later_than_its_delay_margin_is_lost() -> None:
    """Whole samples more: below the margin the poles stay inside the circle, above they do not."""
    law = servo_design().law
    samples = spec_sheet(servo_design()).margins[10].delay / law.plant.period
    assert 0.5 < samples < 3
    plant = law.plant.sampled()
    moving = dataclasses.replace(plant, states=(), inputs=(), outputs=())
    radius = [law.spectral_radius(plant=with_delay(moving, more)) for more in (int(samples), int(samples) + 1)]
    assert radius[0] < 1 < radius[1]


def lost_at(sheet: SpecSheet, position: float, share: float) -> bool:
    """Whether the plant is lost under a share of the largest disturbance, either way."""
    track = rest(0.4, position)
    rising = share * sheet.largest_disturbance * np.clip((track.time - 0.1) / 0.2, 0, 1)
    try:
        for push in (rising, -rising):
            run = run_closed_loop(sheet.design, track, plant=believed(), disturbance=push)
            assert run.guard_violations + run.force_limited == 0
    except ComputationError:
        return True
    return False


def test_the_largest_disturbance_is_borne_everywhere_and_a_larger_one_is_not() -> None:
    """To the end of zone C; where the gap is small the loop is lost before the magnets have given all."""
    sheet = spec_sheet(servo_design())
    end = 0.8 * sheet.design.reach[1]
    assert not lost_at(sheet, end, 1.0)
    assert not lost_at(sheet, 0.0, 1.0)
    assert lost_at(sheet, end, 5.2)
    highest = force_limits(sheet.design.parameters.inverse, np.array([end]))[1, 0]
    assert sheet.largest_disturbance < highest - sheet.design.suspension * end


def test_a_slow_disturbance_moves_the_mover_by_the_least_stiffness() -> None:
    sheet = spec_sheet(servo_design())
    t = np.arange(2500) / 2500.0
    push = 2.0 * np.sin(2 * np.pi * sheet.least_stiffness_at * t)
    run = run_closed_loop(sheet.design, rest(1.0), plant=believed(), disturbance=push)
    late = run.position[t > 0.5]
    assert 2.0 / np.abs(late).max() == pytest.approx(sheet.least_stiffness, rel=0.15)


def test_figures_of_a_run_stand_on_the_sheet() -> None:
    run = run_closed_loop(servo_design(), sine(0.3e-3, 5.0, 0.4), plant=believed())
    fields = spec_sheet(servo_design(), run=run).to_json()
    assert fields["copper_loss_W"] == run.copper_loss
    assert fields["guard_share"] == 0.0
    assert "unseen" not in fields


def test_a_loop_that_is_unstable_in_the_middle_has_no_sheet() -> None:
    lost = dataclasses.replace(servo_design(), peak_sensitivity=np.inf)
    with pytest.raises(InputError, match="unstable in the middle"):
        spec_sheet(lost)
