"""The half order of solid iron is `eddy_currents` of a long diffusion time, beside a change of the inductance.

Zhu, Knospe, Maslen, IEEE Trans. Magnetics 41(4), 2005, 1248-1258: the reluctance of a solid core grows as sqrt(s).
"""

import numpy as np
import pytest

from msl_fem.plant import plant_parameters
from msl_fem.plant.effects import EffectValues, kernel_coefficients
from msl_fem.plant.effects.magnetic import EDDY, EDDY_MODE, EDDY_RATE, N_EDDY

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
