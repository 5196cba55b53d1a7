"""The three terms: closed forms, how they scale, what is refused, fits of measured losses."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from fit_core_loss import FittedRange, fit_losses, refit
from sheets_and_waveforms import m19, sine, triangle

from msl_fem.errors import InputError, MaterialError
from msl_fem.losses import FluxWaveform, loss_density, sinusoidal_loss
from msl_fem.materials.core_loss_data import LossPoints, loss_sheets, read_loss_points, sheet_of
from msl_fem.materials.material import LIBRARY

POUND = 0.45359237


def terms(wave: FluxWaveform) -> np.ndarray:
    found = loss_density(m19(), wave)
    assert found.hysteresis is not None
    assert found.eddy is not None
    assert found.excess is not None
    return np.array([found.hysteresis, found.eddy, found.excess])


@pytest.mark.parametrize(("peak", "frequency"), [(1.5, 60.0), (0.3, 10.0), (1.0, 900.0)])
def test_a_sine_has_the_closed_form(peak: float, frequency: float) -> None:
    """k_h f B^a + pi^2 sigma d^2 f^2 B^2/6 + k_ex (f B)^1.5, written out here."""
    sheet = m19()
    c = sheet.coefficients
    assert c is not None
    assert sheet.thickness is not None
    assert sheet.conductivity is not None
    found = terms(sine(peak, frequency))
    assert found[0] == pytest.approx(c.density * c.hysteresis * frequency * peak**c.exponent, rel=1e-12)
    eddy = np.pi**2 * sheet.conductivity * sheet.thickness**2 * frequency**2 * peak**2 / 6
    assert found[1] == pytest.approx(eddy, rel=1e-12)
    assert found[2] == pytest.approx(c.density * c.excess * (frequency * peak) ** 1.5, rel=1e-6)
    assert found == pytest.approx(sinusoidal_loss(c, sheet, frequency, peak), rel=1e-6)


def test_a_triangle_has_8_over_pi_squared_of_the_sines_eddy_loss() -> None:
    assert terms(triangle(1.0, 50.0, samples=4096))[1] == pytest.approx(
        8 / np.pi**2 * terms(sine(1.0, 50.0))[1], rel=1e-3
    )


def test_scaling_with_rate_and_bias() -> None:
    """Twice as fast: 2, 4 and 2^1.5 times the loss; a bias changes nothing; twice over in one period neither."""
    t = np.arange(512) / 512
    b = 0.6 * np.sin(2 * np.pi * t) + 0.2 * np.sin(2 * np.pi * 5 * t)
    once = terms(FluxWaveform(b, 40.0))
    assert terms(FluxWaveform(b, 80.0)) / once == pytest.approx([2, 4, 2**1.5], rel=1e-9)
    assert terms(FluxWaveform(b + 0.5, 40.0)) == pytest.approx(once, rel=1e-9)
    assert terms(FluxWaveform(np.tile(b, 2), 20.0))[1:] == pytest.approx(once[1:], rel=1e-9)


def test_minor_loops_cost_extra() -> None:
    t = np.arange(512) / 512
    plain = 0.8 * np.sin(2 * np.pi * t)
    rippled = plain + 0.1 * np.sin(2 * np.pi * 15 * t)
    loops = FluxWaveform(rippled, 50.0).loop_swings
    c = m19().coefficients
    assert c is not None
    assert loops.size > 1
    major = c.density * c.hysteresis * 50.0 * (loops[-1] / 2) ** c.exponent
    assert major < terms(FluxWaveform(rippled, 50.0))[0] < 1.5 * major


def test_beyond_the_measured_losses() -> None:
    with pytest.raises(InputError, match="1200 Hz is above the 1000 Hz"):
        terms(sine(0.5, 1200.0))
    with pytest.raises(InputError, match=r"swings by 1\.8 T"):
        terms(sine(1.8, 50.0))


def test_an_iron_without_data_has_no_loss_rather_than_none() -> None:
    """Unavailable, and said so; the eddy-current term where thickness and conductivity are known."""
    for iron in ("m27", "m400_50a_pyleecan"):
        sheet = sheet_of(iron)
        found = loss_density(sheet, sine(1.0, 50.0))
        assert found.total is None
        assert found.hysteresis is None
        assert found.eddy is not None
        assert found.eddy > 0
        assert "no loss data with a source" in sheet.reason
    for iron in ("linear:1000", "analytic:e1", "steel_1010", "stainless_430", "mine.csv"):
        assert loss_density(sheet_of(iron), sine(1.0, 50.0)).eddy is None
        assert sheet_of(iron).reason
    assert "0.36 mm, 0.47 mm" in sheet_of("m36").reason  # measured, but not at the library's 0.635 mm
    assert sheet_of("m36", thickness=0.47e-3).coefficients is not None


def test_the_sheet_chosen() -> None:
    assert sheet_of("m19").thickness == 0.635e-3
    assert sheet_of("m19", thickness=0.35e-3).thickness == 0.3556e-3
    assert sheet_of("m19", thickness=0.5e-3).coefficients is None
    with pytest.raises(MaterialError, match=r"must be 0\.01 \.\.\. 50 mm"):
        sheet_of("m19", thickness=0.36)


@pytest.mark.parametrize("name", sorted(loss_sheets()))
def test_stored_coefficients_are_those_of_the_stored_data(name: str) -> None:
    entry = loss_sheets()[name]
    found = refit(name)
    for key, value in entry["coefficients"].items():
        assert getattr(found, key) == pytest.approx(value, rel=1e-4), key
    assert found.rms_error < 0.09
    points = read_loss_points(LIBRARY / entry["data"])
    used = points.frequency <= entry["fitted_up_to_Hz"]
    sheet = sheet_of(entry["irons"][0], thickness=entry["thickness_m"])
    assert sheet.coefficients is not None
    fitted = sum(sinusoidal_loss(sheet.coefficients, sheet, points.frequency[used], points.flux_density[used]))
    error = fitted / sheet.coefficients.density / points.loss[used] - 1
    assert np.abs(error).max() == pytest.approx(sheet.coefficients.largest_error, rel=1e-3)


def test_the_data_are_below_the_grades_limit() -> None:
    """ASTM A677: 36F155 (M-19, 29 gauge) loses at most 1.55 W/lb, 64F208 (24 gauge) 2.08 W/lb at 1.5 T and 60 Hz."""
    for name, limit in (("m19_29ga", 1.55), ("m19_24ga", 2.08)):
        points = read_loss_points(LIBRARY / loss_sheets()[name]["data"])
        (at,) = np.flatnonzero((points.frequency == 60) & (points.flux_density == 1.5))
        assert 0.85 * limit < points.loss[at] * POUND < limit


def test_a_fit_finds_the_coefficients_of_made_losses() -> None:
    """And one point ten times too large does not move them far."""
    sheet = m19()
    assert sheet.coefficients is not None
    truth = replace(sheet.coefficients, hysteresis=0.025, exponent=1.7, excess=8e-4)
    f, b = (a.ravel() for a in np.meshgrid([10.0, 50.0, 200.0, 800.0], [0.2, 0.5, 1.0, 1.5]))
    loss = sum(sinusoidal_loss(truth, sheet, f, b)) / truth.density
    found = fit_losses(LossPoints(f, b, loss), sheet, FittedRange(1000.0, truth.density, "made"))
    assert (found.hysteresis, found.exponent, found.excess) == pytest.approx((0.025, 1.7, 8e-4), rel=1e-5)
    assert found.largest_error < 1e-6
    loss[5] *= 2
    found = fit_losses(LossPoints(f, b, loss), sheet, FittedRange(1000.0, truth.density, "made"))
    assert (found.hysteresis, found.exponent) == pytest.approx((0.025, 1.7), rel=0.15)


def test_too_few_points_for_a_fit(tmp_path: Path) -> None:
    few = tmp_path / "few.csv"
    few.write_text("frequency_Hz,B_T,loss_W_per_kg\n50,1,2\n100,1,5\n")
    with pytest.raises(MaterialError, match=r"2 loss points .* are too few"):
        fit_losses(read_loss_points(few), m19(), FittedRange(1000.0, 7650.0, "made"))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("f,B,p\n50,1,2\n", "first line must name the columns"),
        ("frequency_Hz,B_T,loss_W_per_kg\n50,1,-2\n", "line 2: expected 3 positive numbers"),
        ("frequency_Hz,B_T,loss_W_per_kg\n50,1\n", "line 2: expected 3 positive numbers"),
        ("frequency_Hz,B_T,loss_W_per_kg\n50,1,nan\n", "line 2: expected 3 positive numbers"),
        ("", "first line must name the columns"),
    ],
)
def test_loss_files_that_are_none(text: str, said: str, tmp_path: Path) -> None:
    path = tmp_path / "loss.csv"
    path.write_text(text)
    with pytest.raises(MaterialError, match=said):
        read_loss_points(path)
    with pytest.raises(MaterialError, match="cannot be read"):
        read_loss_points(tmp_path / "none.csv")
