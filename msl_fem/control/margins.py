"""Gain, phase and delay margins of a loop from its open-loop transfer, and how errors of the transfer move them."""

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


@dataclass(frozen=True)
class PhaseCrossing:
    """Where L is real and negative: the factor of the gain that would bring it to -1.

    `spread` is the factor's standard deviation over that of Re L and Im L, where these err alike and apart.
    """

    frequency: float
    factor: float
    spread: float


@dataclass(frozen=True)
class GainCrossing:
    """Where |L| is 1: the angle in rad from -1, the delay in s that would take it off, and their spreads as above."""

    frequency: float
    angle: float
    delay: float
    angle_spread: float
    delay_spread: float


def margins(transfer: Complex, frequency: Array) -> Margins:
    """The margins of L (n_frequency,) along increasing frequencies (Hz), interpolated between them; S = 1/(1 + L)."""
    factors = [c.factor for c in phase_crossings(transfer, frequency)]
    gains = gain_crossings(transfer, frequency)
    return Margins(
        float(min((c for c in factors if c > 1), default=np.inf)),
        float(max((c for c in factors if c <= 1), default=0.0)),
        float(np.degrees(min((abs(c.angle) for c in gains), default=np.nan))),
        float(min((c.delay for c in gains), default=np.nan)),
    )


def phase_crossings(transfer: Complex, frequency: Array) -> list[PhaseCrossing]:
    """The crossings of the negative real axis: Im L = 0 moves with the error of Im L, and takes Re L along."""
    imag, real = transfer.imag, transfer.real
    found = []
    for n in np.flatnonzero(np.sign(imag[:-1]) * np.sign(imag[1:]) < 0):
        t = imag[n] / (imag[n] - imag[n + 1])
        at = real[n] + t * (real[n + 1] - real[n])
        if at < 0:
            slope = (real[n + 1] - real[n]) / (imag[n + 1] - imag[n])
            spread = float(np.hypot(1.0, slope)) / at**2
            found.append(PhaseCrossing(_between(frequency, n, t), -1.0 / at, spread))
    return found


def gain_crossings(transfer: Complex, frequency: Array) -> list[GainCrossing]:
    """The crossings of the unit circle: they move with the radial error of L, and take the angle along."""
    size = np.abs(transfer)
    found = []
    for n in np.flatnonzero((size[:-1] - 1) * (size[1:] - 1) < 0):
        t = (size[n] - 1) / (size[n] - size[n + 1])
        angle = float(np.angle(-(transfer[n] + t * (transfer[n + 1] - transfer[n]))))
        at = _between(frequency, n, t)
        whole = angle % (2 * np.pi)
        moved = (frequency[n + 1] - frequency[n]) / (size[n + 1] - size[n])
        turned = float(np.angle(transfer[n + 1] / transfer[n])) / (size[n + 1] - size[n])
        of_delay = np.hypot(1.0, turned - whole * moved / at) / (2 * np.pi * at)
        found.append(GainCrossing(at, angle, whole / (2 * np.pi * at), float(np.hypot(1.0, turned)), float(of_delay)))
    return found


def _between(frequency: Array, n: np.intp, share: float) -> float:
    return float(frequency[n] * (frequency[n + 1] / frequency[n]) ** share)
