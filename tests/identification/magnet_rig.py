"""A mass between two magnets with exactly rational forces, integrated finely; the position is read with noise."""

import numpy as np
from numba import njit
from scipy.signal import butter, sosfilt

from msl_fem.identification import SampledRun

MASS, DAMPING, STIFFNESS = 0.9, 12.0, 1.4e5
NOMINAL_GAP, DELTA = 0.6e-3, 40e-6
STRENGTH = (2.2e-5, 1.8e-5)  # N m^2/A^2, force = strength i^2/(g + delta)^2
SAMPLING_PERIOD = 1e-4


@njit(cache=True)
def _motion(i1, i2, force, substeps):
    x = np.zeros(i1.size)
    position, velocity = 0.0, 0.0
    h = SAMPLING_PERIOD / substeps
    for t in range(i1.size):
        x[t] = position
        for _ in range(substeps):
            kx, kv = np.zeros(4), np.zeros(4)
            for stage in range(4):
                if stage == 0:
                    p, v = position, velocity
                elif stage == 3:
                    p, v = position + h * kx[2], velocity + h * kv[2]
                else:
                    p, v = position + 0.5 * h * kx[stage - 1], velocity + 0.5 * h * kv[stage - 1]
                g1, g2 = NOMINAL_GAP - p + DELTA, NOMINAL_GAP + p + DELTA
                pull = STRENGTH[0] * (i1[t] / g1) ** 2 - STRENGTH[1] * (i2[t] / g2) ** 2 + force[t]
                kx[stage], kv[stage] = v, (pull - STIFFNESS * p - DAMPING * v) / MASS
            position += h * (kx[0] + 2 * kx[1] + 2 * kx[2] + kx[3]) / 6
            velocity += h * (kv[0] + 2 * kv[1] + 2 * kv[2] + kv[3]) / 6
    return x


def band_limited(n_samples, rng, *, bandwidth=200.0):
    sos = butter(4, bandwidth, fs=1 / SAMPLING_PERIOD, output="sos")
    noise = sosfilt(sos, rng.standard_normal(n_samples + 2000))[2000:]
    return noise / noise.std()


def magnet_run(n_samples, rng, *, noise=50e-9, bias=0.3, amplitude=0.03, name="noise", frequency=None):
    """Currents with a bias and band-limited noise (or a sine of `frequency` Hz on side 1 against side 2)."""
    if frequency is None:
        i1, i2 = (bias + amplitude * band_limited(n_samples, rng) for _ in range(2))
    else:
        wave = amplitude * np.sin(2 * np.pi * frequency * SAMPLING_PERIOD * np.arange(n_samples))
        i1, i2 = bias + wave, bias - wave
    x = _motion(i1, i2, np.zeros(n_samples), 4)
    return SampledRun(
        x + noise * rng.standard_normal(n_samples), {"i1": i1, "i2": i2}, SAMPLING_PERIOD, name=name, output_name="x"
    )
