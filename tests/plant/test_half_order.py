"""The half order of solid iron is `eddy_currents` of a long diffusion time, beside a change of the inductance.

Zhu, Knospe, Maslen, IEEE Trans. Magnetics 41(4), 2005, 1248-1258: the reluctance of a solid core grows as sqrt(s).
"""

import numpy as np
import pytest

from msl_fem.plant import plant_parameters
from msl_fem.plant.effects import EffectValues, kernel_coefficients
from msl_fem.plant.effects.magnetic import EDDY, EDDY_MODE, EDDY_POLES, EDDY_RATE, N_EDDY

INDUCTANCE, TAU = 0.02, 1e-3


def current_over_flux(servo, diffusion: float, s: np.ndarray) -> np.ndarray:
    """What the kernel's modes take from a coil, A/Wb, by its coefficients."""
    values = EffectValues({"eddy_currents": {"time_constant": TAU, "diffusion_time": diffusion}})
    plant = plant_parameters(servo)
    e = kernel_coefficients(plant, values.vector(), inductance=INDUCTANCE, step=1e-6, n_step=100)
    rows = zip(e[EDDY_MODE : EDDY_MODE + N_EDDY], e[EDDY_RATE : EDDY_RATE + N_EDDY], strict=True)
    return e[EDDY] * s + sum(mode * s / (s + rate) for mode, rate in rows)


def misses_half_order(servo, diffusion: float) -> tuple[float, float]:
    """RMS and largest relative distance of sqrt(s) from the modes and a constant, 5 Hz to 5 kHz."""
    s = 2j * np.pi * np.geomspace(5, 5000, 200)
    half = np.sqrt(s)
    columns = np.column_stack([current_over_flux(servo, diffusion, s) / half, 1 / half])
    both = np.concatenate([columns.real, columns.imag])
    fitted = np.linalg.lstsq(both, np.concatenate([np.ones(s.size), np.zeros(s.size)]), rcond=None)[0]
    error = np.abs(columns @ fitted - 1)
    return float(np.sqrt(np.mean(error**2))), float(error.max())


def test_three_decades_of_half_order(servo) -> None:
    rms, largest = misses_half_order(servo, 0.3)
    assert rms < 0.005
    assert largest < 0.025
    assert misses_half_order(servo, 0.01)[0] > 0.1  # sheets of 2 mm are no solid iron


def test_the_modes_are_diffusion(servo) -> None:
    """(3 tau/(T L_0)) (q coth q - 1), q^2 = s T, within 0.5 %."""
    s = 2j * np.pi * np.geomspace(1, 3000, 40)
    q = np.sqrt(0.3 * s)
    exact = 3 * TAU / (0.3 * INDUCTANCE) * (q / np.tanh(q) - 1)
    assert np.abs(current_over_flux(servo, 0.3, s) / exact - 1).max() == pytest.approx(0.0, abs=5e-3)


def test_over_the_diffusion_time_nothing_jumps(servo) -> None:
    """Where a mode becomes faster than the step, up to half of the sampling rate; next to T = 0 a shorted winding."""
    step = 2e-5
    plant = plant_parameters(servo)

    def taken(diffusion: float, s: np.ndarray) -> np.ndarray:
        values = EffectValues({"eddy_currents": {"time_constant": TAU, "diffusion_time": diffusion}})
        e = kernel_coefficients(plant, values.vector(), inductance=INDUCTANCE, step=step, n_step=5)
        rows = zip(e[EDDY_MODE : EDDY_MODE + N_EDDY], e[EDDY_RATE : EDDY_RATE + N_EDDY], strict=True)
        return e[EDDY] * s + sum(mode * s / (s + rate) for mode, rate in rows)

    s = 2j * np.pi * np.geomspace(1, 5000, 40)
    for pole in EDDY_POLES:
        before, behind = (taken(step * pole * (1 + by), s) for by in (-1e-6, 1e-6))
        assert np.abs(behind / before - 1).max() < 1e-5
    assert np.abs(taken(1e-9, s) / (TAU / INDUCTANCE * s) - 1).max() < 1e-3
    assert max(taken(step * EDDY_POLES[0], s).imag) < 0.9 * max(taken(1e-9, s).imag)
