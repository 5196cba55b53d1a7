"""Iron losses of a periodic operation: Bertotti's terms, the waveforms they need, and the sections of a magnet."""

from msl_fem.iron_loss.bertotti import EXCESS_OF_SINE, LossDensity, eddy_coefficient, loss_density, sinusoidal_loss
from msl_fem.iron_loss.fit import FittedRange, fit_losses
from msl_fem.iron_loss.operation import (
    IronLoss,
    IronLossModel,
    PeriodicOperation,
    SectionLoss,
    iron_loss,
    mean_period,
    sine_operation,
)
from msl_fem.iron_loss.section_flux import SectionFlux, iron_names, iron_volumes
from msl_fem.iron_loss.waveform import FluxWaveform, closed_loops

__all__ = [
    "EXCESS_OF_SINE",
    "FittedRange",
    "FluxWaveform",
    "IronLoss",
    "IronLossModel",
    "LossDensity",
    "PeriodicOperation",
    "SectionFlux",
    "SectionLoss",
    "closed_loops",
    "eddy_coefficient",
    "fit_losses",
    "iron_loss",
    "iron_names",
    "iron_volumes",
    "loss_density",
    "mean_period",
    "sine_operation",
    "sinusoidal_loss",
]
