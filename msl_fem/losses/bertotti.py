"""Bertotti's three loss terms of a sheet, for sinusoidal and for any periodic flux density."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from msl_fem.errors import InputError
from msl_fem.losses.flux_waveform import FluxWaveform
from msl_fem.materials.core_loss_data import LossCoefficients, Sheet

Array = NDArray[np.float64]
EXCESS_OF_SINE = 8.763363
"""(2 pi)^1.5 times the mean of |cos|^1.5: what <|dB/dt|^1.5> is for B = sin(2 pi t)."""


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
    f, b = np.asarray(frequency, dtype=float), np.asarray(flux_density, dtype=float)
    rho = coefficients.density
    eddy = 2 * math.pi**2 * (eddy_coefficient(sheet) or 0.0) * (f * b) ** 2
    return (
        rho * coefficients.hysteresis * f * b**coefficients.exponent,
        eddy,
        rho * coefficients.excess * (f * b) ** 1.5,
    )


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
