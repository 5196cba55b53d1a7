"""Gain, phase and delay margins of a loop from its open-loop transfer."""

from dataclasses import dataclass

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.control.linear_loop import Complex


@dataclass(frozen=True)
class Margins:
    """How far a stable loop is from instability (Franklin, Powell, Emami-Naeini, Feedback Control, 7th ed., sec. 6.4).

    Attributes
    ----------
    gain_up, gain_down : factors of the loop's gain, above and below 1; inf and 0 where there is none
    phase : degrees that the phase may fall or rise; nan where the gain never is 1
    delay : s that the command may come later; nan where the gain never is 1
    """

    gain_up: float
    gain_down: float
    phase: float
    delay: float


def margins(transfer: Complex, frequency: Array) -> Margins:
    """The margins of L (n_frequency,) along increasing frequencies (Hz), interpolated between them; S = 1/(1 + L)."""
    imag = transfer.imag
    real = transfer.real
    size = np.abs(transfer)
    crossings = []
    for n in np.flatnonzero(np.sign(imag[:-1]) * np.sign(imag[1:]) < 0):
        t = imag[n] / (imag[n] - imag[n + 1])
        at = real[n] + t * (real[n + 1] - real[n])
        if at < 0:
            crossings.append(-1.0 / at)
    up = [c for c in crossings if c > 1]
    down = [c for c in crossings if c <= 1]
    angles, delays = [], []
    for n in np.flatnonzero((size[:-1] - 1) * (size[1:] - 1) < 0):
        t = (size[n] - 1) / (size[n] - size[n + 1])
        between = transfer[n] + t * (transfer[n + 1] - transfer[n])
        ahead = float(np.angle(-between))
        angles.append(abs(np.degrees(ahead)))
        at = frequency[n] * (frequency[n + 1] / frequency[n]) ** t
        delays.append(ahead % (2 * np.pi) / (2 * np.pi * at))
    return Margins(
        float(min(up, default=np.inf)),
        float(max(down, default=0.0)),
        float(min(angles, default=np.nan)),
        float(min(delays, default=np.nan)),
    )
