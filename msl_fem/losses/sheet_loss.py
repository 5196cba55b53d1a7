"""The loss density of a sheet in a periodic flux density: rates of change, closed loops, Bertotti's three terms."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from msl_fem.computing.arrays import Array
from msl_fem.errors import InputError
from msl_fem.materials.core_loss_data import LossCoefficients, Sheet

FEWEST, MOST = 32, 1_000_000  # samples a period
FINER = 8  # times as many samples for the mean of |dB/dt|^1.5, whose integrand has kinks
RESOLVED = 0.05  # largest difference of the two routes to <(dB/dt)^2>; white noise has 0.4, a jump more
STILL = 1e-9  # T: a swing that is rounding, not flux
JUMP = 4.0  # the step that closes the period, at most so many times the largest one within
EXCESS_OF_SINE = 8.763363
"""(2 pi)^1.5 times the mean of |cos|^1.5: what <|dB/dt|^1.5> is for B = sin(2 pi t)."""


@dataclass(frozen=True, eq=False)
class FluxWaveform:
    """One period of a flux density, sampled in equal steps from its beginning; the end is not repeated.

    Attributes
    ----------
    flux_density : (n_sample,) T
    frequency : of the period in Hz

    Raises
    ------
    InputError : too few samples, values that are not finite, a period that does not close, a wave that is not resolved
    """

    flux_density: Array
    frequency: float

    def __post_init__(self) -> None:
        b = np.array(self.flux_density, dtype=float)
        b.setflags(write=False)
        object.__setattr__(self, "flux_density", b)
        _check(b, self.frequency)
        if self.resolution_error > RESOLVED:
            raise InputError(
                f"the waveform is not resolved by {b.size} samples a period: two routes to the mean of (dB/dt)^2 "
                f"differ by {self.resolution_error:.0%}, allowed is {RESOLVED:.0%}; "
                "sample faster, or filter the noise out"
            )

    @cached_property
    def harmonics(self) -> Array:
        """(n_sample//2 + 1,) T: peak values of the Fourier series; the first is the mean."""
        b = self.flux_density
        peak = np.abs(np.fft.rfft(b)) * 2 / b.size
        peak[0] /= 2
        if b.size % 2 == 0:
            peak[-1] /= 2
        return np.asarray(peak)

    @cached_property
    def mean_square_rate(self) -> float:
        """<(dB/dt)^2> in T2/s2 by the Fourier series, 2 pi^2 sum (k f B_k)^2."""
        k = np.arange(self.harmonics.size)
        return float(2 * np.pi**2 * self.frequency**2 * np.sum((k * self.harmonics) ** 2))

    @cached_property
    def mean_square_rate_by_time(self) -> float:
        """<(dB/dt)^2> in T2/s2 by the second route: the time integral over straight lines between the samples."""
        step = np.diff(self.flux_density, append=self.flux_density[0])
        return float(self.flux_density.size * self.frequency**2 * np.sum(step**2))

    @property
    def resolution_error(self) -> float:
        """How far the two routes to <(dB/dt)^2> are apart, relative to the Fourier series'; 0 for what stands still."""
        if np.ptp(self.flux_density) < STILL:
            return 0.0
        return abs(self.mean_square_rate_by_time / self.mean_square_rate - 1)

    @cached_property
    def mean_rate_to_3_2(self) -> float:
        """<|dB/dt|^1.5> in (T/s)^1.5, from the Fourier series' derivative on a finer grid."""
        b = self.flux_density
        spectrum = np.fft.rfft(b)
        spectrum = spectrum * (2j * np.pi * self.frequency * np.arange(spectrum.size))
        if b.size % 2 == 0:
            spectrum[-1] = 0.0  # the highest of an even number has no phase
        rate = np.fft.irfft(spectrum, FINER * b.size) * FINER
        return float(np.mean(np.abs(rate) ** 1.5))

    @cached_property
    def loop_swings(self) -> Array:
        """(n_loop,) T: the full swing of each closed hysteresis loop of a period, see `closed_loops`."""
        return closed_loops(self.flux_density)


def _check(b: Array, frequency: float) -> None:
    if not (np.isfinite(frequency) and frequency > 0):
        raise InputError(f"a frequency of {frequency:g} Hz is not allowed; it must be above 0")
    if b.ndim != 1 or not FEWEST <= b.size <= MOST:
        raise InputError(f"a period of shape {b.shape} is not allowed; give {FEWEST} ... {MOST} samples in one row")
    if not np.isfinite(b).all():
        raise InputError(f"sample {int(np.argmin(np.isfinite(b)))} of the waveform is not a number")
    steps = np.abs(np.diff(b))
    closing = abs(b[0] - b[-1])
    if closing > max(JUMP * steps.max(), STILL):
        raise InputError(
            f"the waveform is not periodic: from its last sample back to its first it jumps by {closing:.3g} T, within "
            f"it steps by {steps.max():.3g} T at most; give whole periods, without repeating the first sample"
        )


def closed_loops(flux_density: ArrayLike) -> Array:
    """(n_loop,) the swings (max - min) of the closed loops that one period makes, largest last.

    Rainflow counting by three points, from the period's largest value on (ASTM E1049, 5.4.5): there every loop closes,
    minor ones with their own swing and the major one from the period's largest to its smallest value.
    """
    b = np.asarray(flux_density, dtype=float)
    b = np.roll(b, -int(np.argmax(b)))
    b = np.append(b, b[0])
    rising = np.diff(b[np.concatenate(([True], np.diff(b) != 0))])  # without repeats, so that each step has a sign
    if rising.size == 0:
        return np.zeros(0)
    values = np.concatenate(([b[0]], b[0] + np.cumsum(rising)))
    turns = np.concatenate(([True], np.diff(np.sign(rising)) != 0, [True]))
    stack: list[float] = []
    swings: list[float] = []
    for value in values[turns].tolist():
        stack.append(value)
        while len(stack) >= 4:
            before, inner, after = (abs(stack[n] - stack[n - 1]) for n in (-3, -2, -1))
            if inner > before or inner > after:
                break
            swings.append(inner)
            del stack[-3:-1]
    return np.array([*sorted(swings), float(b.max() - b.min())])


@dataclass(frozen=True)
class LossDensity:
    """Losses in W/m3 of the iron; None where no measured losses are known (hysteresis, excess) or no sheet (eddy)."""

    hysteresis: float | None
    eddy: float | None
    excess: float | None

    @property
    def total(self) -> float | None:
        """The sum; None where a term is."""
        terms = (self.hysteresis, self.eddy, self.excess)
        return None if None in terms else sum(t for t in terms if t is not None)


def eddy_coefficient(sheet: Sheet) -> float | None:
    """sigma d^2/12 in W s2/(m3 T2): the loss density is this times <(dB/dt)^2>; None where the sheet is not known.

    For sheets thin against the skin depth and flux in their plane (Bertotti, Hysteresis in Magnetism, 1998, eq. 12.9).
    """
    if sheet.thickness is None or sheet.conductivity is None:
        return None
    return sheet.conductivity * sheet.thickness**2 / 12


def sinusoidal_loss(
    coefficients: LossCoefficients, sheet: Sheet, frequency: ArrayLike, flux_density: ArrayLike
) -> tuple[Array, Array, Array]:
    """Hysteresis, eddy-current and excess loss in W/m3 for B = flux_density sin(2 pi frequency t).

    k_h f B^a + pi^2 sigma d^2 f^2 B^2/6 + k_ex (f B)^1.5 (Bertotti, IEEE Trans. Magn. 24, 1988), times the density
    where the coefficients are per kg.
    """
    f = np.asarray(frequency, dtype=float)
    b = np.asarray(flux_density, dtype=float)
    rho = coefficients.density
    hysteresis = rho * coefficients.hysteresis * f * b**coefficients.exponent
    eddy = 2 * math.pi**2 * (eddy_coefficient(sheet) or 0.0) * (f * b) ** 2
    return hysteresis, eddy, rho * coefficients.excess * (f * b) ** 1.5


def loss_density(sheet: Sheet, waveform: FluxWaveform) -> LossDensity:
    """The mean loss density of a periodic flux density in a sheet.

    Hysteresis: each closed loop that rainflow counting finds, major or minor, costs k_h (swing/2)^a once a period.
    That is the wiping-out of Preisach's model (Brokate, Dressler and Krejci, Eur. J. Mech. A 15, 1996) and the same
    splitting as in the improved generalised Steinmetz equation (Venkatachalam et al., COMPEL 2002). A loop about a bias
    costs as much as one about zero: measured ones cost more.
    Eddy currents: sigma d^2/12 <(dB/dt)^2>. Excess: k_ex/8.763 <|dB/dt|^1.5> (Fiorillo and Novikov, IEEE Trans. Magn.
    26, 1990). For a sine all three are those of `sinusoidal_loss`.

    Raises
    ------
    InputError : a frequency or a swing beyond the measured losses
    """
    k = eddy_coefficient(sheet)
    eddy = None if k is None else k * waveform.mean_square_rate
    c = sheet.coefficients
    if c is None:
        return LossDensity(None, eddy, None)
    _refuse_beyond_data(sheet.iron, c, waveform)
    per_period = float(np.sum(c.hysteresis * (waveform.loop_swings / 2) ** c.exponent))
    return LossDensity(
        hysteresis=c.density * waveform.frequency * per_period,
        eddy=eddy,
        excess=c.density * c.excess / EXCESS_OF_SINE * waveform.mean_rate_to_3_2,
    )


def _refuse_beyond_data(iron: str, c: LossCoefficients, waveform: FluxWaveform) -> None:
    if waveform.frequency > c.frequency_max:
        raise InputError(
            f"{waveform.frequency:g} Hz is above the {c.frequency_max:g} Hz up to which the losses of '{iron}' are "
            "known (the flux leaves the middle of the sheet there); give a lower frequency or a thinner sheet (--sheet)"
        )
    half = float(waveform.loop_swings.max(initial=0.0)) / 2
    if half > c.flux_density_max:
        raise InputError(
            f"the flux density swings by {half:.3g} T to either side, the losses of '{iron}' are known up to "
            f"{c.flux_density_max:g} T; give a smaller current"
        )
