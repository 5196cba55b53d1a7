"""Figures of accuracy against signals whose errors are known."""

from types import SimpleNamespace

import numpy as np
import pytest

from msl_fem.comparison.accuracy import by_band, nrmse, octaves, over_variable
from msl_fem.comparison.models import refit_notes
from msl_fem.errors import InputError

RATE, N = 2000.0, 20_000
T = np.arange(N) / RATE


def test_nrmse_of_a_scaled_signal_is_the_scale_error() -> None:
    signal = np.sin(2 * np.pi * 5 * T)
    assert nrmse(signal, 0.9 * signal) == pytest.approx(0.1, rel=1e-3)
    assert nrmse(signal + 7, signal + 7) == 0.0
    assert np.isnan(nrmse(signal, np.full(N, np.nan)))


def test_bands_add_up_to_the_whole() -> None:
    """Parseval: for stationary noise the bands' squares sum to the residual's variance."""
    rng = np.random.default_rng(2)
    measured, error = rng.standard_normal(N), 0.1 * rng.standard_normal(N)
    bands = by_band(measured, measured - error, rate=RATE, edges=np.array([0, 50, 200, 600, 1001.0]))
    assert np.sum(bands.residual**2) == pytest.approx(np.var(error), rel=0.05)
    assert np.sum(bands.measured**2) == pytest.approx(np.var(measured), rel=0.05)
    assert bands.nrmse == pytest.approx(0.1, rel=0.12)


def test_an_error_stands_in_its_band_alone() -> None:
    measured = np.sin(2 * np.pi * 5.03 * T) + np.sin(2 * np.pi * 300.7 * T)
    error = 0.2 * np.sin(2 * np.pi * 300.7 * T)
    bands = by_band(measured, measured - error, rate=RATE, edges=np.array([2.0, 20, 150, 600]))
    assert bands.nrmse[2] == pytest.approx(0.2, rel=1e-3)
    assert bands.residual[0] < 1e-6 * bands.residual[2]


def test_octaves_reach_from_ten_periods_to_the_end() -> None:
    edges = octaves(4.0, 5000.0)
    assert edges[0] == 2.5
    assert edges[-1] == 5000.0
    assert (np.diff(np.log2(edges)) >= 1 - 1e-9).all()


def test_a_residual_over_its_cause() -> None:
    """A residual of v |v| has its sign in the bins' means and grows to the ends."""
    velocity = np.random.default_rng(3).uniform(-1, 1, 6000)
    spread = over_variable(velocity * np.abs(velocity), velocity, bins=10)
    assert spread.mean[0] < -0.7 < 0 < spread.mean[-1]
    assert spread.rms.argmin() in (4, 5)
    assert spread.count.sum() == 6000


def test_repeated_values_and_thin_bins() -> None:
    variable = np.r_[np.zeros(500), np.ones(3)]
    spread = over_variable(np.ones(503), variable, bins=5)
    assert spread.count.sum() == 503
    assert np.isfinite(spread.rms).sum() >= 1
    constant = over_variable(np.ones(20), np.full(20, 3.0))
    assert constant.rms == pytest.approx([1.0])


def test_refusals() -> None:
    with pytest.raises(InputError, match="never moves"):
        nrmse(np.ones(50), np.zeros(50))
    with pytest.raises(InputError, match="give equal lengths"):
        nrmse(np.arange(5.0), np.arange(6.0))
    with pytest.raises(InputError, match="give equally many"):
        over_variable(np.zeros(4), np.zeros(5))


def test_all_parameters_that_left_their_tolerances_stand_in_one_note() -> None:
    far = {"moving_mass": SimpleNamespace(tolerances=-9.94), "position_gain": SimpleNamespace(tolerances=16.8)}
    [note] = refit_notes(SimpleNamespace(fit=SimpleNamespace(converged=True), far=far))  # type: ignore[arg-type]
    assert "moving mass -9.9, position gain +16.8; more than these" in note
    assert refit_notes(SimpleNamespace(fit=SimpleNamespace(converged=True), far={})) == []  # type: ignore[arg-type]
