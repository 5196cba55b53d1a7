"""Figures of losses and of the thermal limit; records in, plotly figures out."""

import numpy as np
import plotly.graph_objects as go

from msl_fem.errors import MaterialError
from msl_fem.losses import IronLoss, ThermalCurve, sinusoidal_loss
from msl_fem.losses.copper_loss import CopperLoss
from msl_fem.materials.core_loss_data import LossPoints, Sheet
from msl_fem.report.style import BLUE, GREEN, GREY, ORANGE, SERIES, SKY, figure, line, logarithmic

TERMS = (("hysteresis", BLUE), ("eddy", ORANGE), ("excess", GREEN))


def losses_by_section(iron: IronLoss, copper: CopperLoss) -> go.Figure:
    """Stacked bars: each section's hysteresis, eddy-current and excess loss, the coil's copper loss beside them.

    A section whose loss is not known has no bar but the words "not known" in its place.
    """
    made = figure(x="", y="loss of one magnet in W")
    names = [s.section.replace("_", " ") for s in iron.sections]
    for term, colour in TERMS:
        values = [getattr(s.density, term) for s in iron.sections]
        watts = [None if v is None else v * s.volume for v, s in zip(values, iron.sections, strict=True)]
        made.add_trace(go.Bar(x=names, y=watts, name=term, marker_color=colour))
    made.add_trace(go.Bar(x=["coil"], y=[copper.loss], name="copper", marker_color=SKY))
    for name, section in zip(names, iron.sections, strict=True):
        if section.loss is None:
            made.add_annotation(x=name, y=section.eddy_loss or 0.0, text="not known", showarrow=False, yshift=10)
    made.update_layout(barmode="stack")
    return made


def add_thermal_limit(made: go.Figure, curve: ThermalCurve) -> go.Figure:
    """The figure of the operating regions with the winding's limit as further lines (RMS over gap in mm)."""
    gap, limit = curve.gap * 1e3, curve.copper_only.limit
    what = f"continuous, {limit.temperature_rise:g} K"
    made.add_trace(line(gap, curve.continuous, name=what, colour=GREY, line={"dash": "dash"}))
    if limit.cycle.duty < 1:
        name = f"for {limit.cycle.duty:.0%} of the time"
        made.add_trace(line(gap, curve.on_phase, name=name, colour=GREY, line={"dash": "dot"}))
    return made


def measured_and_fitted_losses(points: LossPoints, sheet: Sheet) -> go.Figure:
    """Measured specific losses of a sheet over flux density, a colour a frequency, and the fit as lines.

    Raises
    ------
    MaterialError : the sheet has no coefficients
    """
    c = sheet.coefficients
    if c is None:
        raise MaterialError(sheet.reason)
    made = figure(x="peak flux density in T", y="specific loss in W/kg")
    used = [f for f in np.unique(points.frequency) if f <= c.frequency_max]
    shown = used[:: max(1, -(-len(used) // len(SERIES)))]
    b = np.geomspace(c.flux_density_min, c.flux_density_max, 60)
    for f, colour in zip(shown, SERIES, strict=False):
        row = points.frequency == f
        fitted = sum(sinusoidal_loss(c, sheet, f, b)) / c.density
        made.add_trace(line(b, fitted, name=f"{f:g} Hz", colour=colour))
        made.add_trace(
            line(
                points.flux_density[row], points.loss[row], name=f"{f:g} Hz, measured", colour=colour, mode="markers",
                showlegend=False,
            )
        )  # fmt: skip
    logarithmic(made, [b], along="x")
    logarithmic(made, [points.loss], along="y")
    return made
