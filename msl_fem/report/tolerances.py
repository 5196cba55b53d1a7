"""Figures and page of a tolerance study: what each tolerance does, and the band of the map."""

import numpy as np
import plotly.graph_objects as go

from msl_fem.actuator import Actuator
from msl_fem.design.tolerances import Sensitivity, ToleranceStudy
from msl_fem.files.quantity import format_quantity
from msl_fem.report.page import Grid, Page, Stage
from msl_fem.report.style import BLUE, GREEN, ORANGE, RED, figure, line

FILLS = ("rgba(0,158,115,0.25)", "rgba(213,94,0,0.25)", "rgba(0,114,178,0.25)")


def map_band(study: ToleranceStudy) -> go.Figure:
    """The levels' currents over the gap, nominal, with the band of 5 to 95 % of made magnets."""
    made = figure(x="air gap in mm", y="coil current in A")
    gap = study.gap * 1e3
    for k, (level, colour) in enumerate(zip(study.levels, (GREEN, RED, BLUE), strict=False)):
        low, high = study.band.low[k], study.band.high[k]
        known = np.isfinite(low) & np.isfinite(high)
        x, y = np.r_[gap[known], gap[known][::-1]], np.r_[low[known], high[known][::-1]]
        name = f"{level:g} T, 5 ... 95 %"
        made.add_trace(go.Scatter(x=x, y=y, fill="toself", fillcolor=FILLS[k], mode="none", name=name))
        made.add_trace(line(gap, study.current[k], name=f"{level:g} T, as drawn", colour=colour))
    return made


def tolerance_effects(study: ToleranceStudy) -> go.Figure:
    """What each tolerance at its limit does to force, flux linkage and the first level's current, in per cent."""
    made = figure(x="change at the tolerance's limit in %", y="")
    at = int(np.argmin(np.abs(study.gap - study.point[1])))
    section = int(study.governing_section[0, at])
    names = [s.tolerance.name.replace("_", " ") for s in study.sensitivities]
    quantities = (
        ("force", BLUE, [s.force for s in study.sensitivities]),
        ("flux linkage", ORANGE, [s.flux_linkage for s in study.sensitivities]),
        (f"current for {study.levels[0]:g} T", GREEN, [s.current[section, 0, at] for s in study.sensitivities]),
    )
    for name, colour, elasticities in quantities:
        shares = [relative_limit(s, study.point[1]) for s in study.sensitivities]
        values = [100 * abs(e * share) for e, share in zip(elasticities, shares, strict=True)]
        made.add_trace(go.Bar(x=values, y=names, name=name, orientation="h", marker={"color": colour}))
    made.update_layout(barmode="group", height=520, margin={"l": 150})
    return made


def relative_limit(sensitivity: Sensitivity, gap: float) -> float:
    """A tolerance's limit over its nominal value; for the gap over that of the point."""
    return sensitivity.tolerance.limit / (sensitivity.tolerance.nominal or gap)


def tolerance_page(actuator: Actuator, study: ToleranceStudy) -> Page:
    """The page of a tolerance study."""
    band, (current, gap) = study.band, study.point
    at = int(np.argmin(np.abs(study.gap - gap)))
    nominal = float(study.current[0, at])
    low, high = 100 * (band.low[0, at] / nominal - 1), 100 * (band.high[0, at] / nominal - 1)
    strongest = max(study.sensitivities, key=lambda s: abs(s.force) * relative_limit(s, gap))
    checked = (
        f"{band.samples} samples, all by field solutions"
        if band.method == "direct"
        else f"{band.samples} samples of the linearised map; of {band.checked} solved directly none is off by more "
        f"than {100 * band.linearisation_error:.2g} % of the current or {100 * band.band_error:.2g} % of half the band"
    )
    return Page(
        title=f"{actuator.name}: manufacturing tolerances",
        subtitle=f"Force and flux linkage at {current:.3g} A and {gap * 1e3:.3g} mm",
        headline=(
            (f"{low:+.1f} ... {high:+.1f} %", f"current for {study.levels[0]:g} T at {study.gap[at] * 1e3:.2g} mm"),
            (f"{band.force[0]:.4g} ... {band.force[1]:.4g} N", "force, 5 ... 95 %"),
        ),
        stages=(
            Stage(
                "The map as made", "Nine magnets in ten lie in the band.", (("Monte Carlo", checked),), map_band(study)
            ),
            Stage(
                "What each tolerance does",
                f"The force depends most on the {strongest.tolerance.name.replace('_', ' ')}.",
                (),
                plot=tolerance_effects(study),
                table=_limits(study),
            ),
        ),
        provenance=(("actuator", f"{actuator.name}, SHA-256 {actuator.digest[:16]}"), ("seed", str(band.seed))),
    )


def _limits(study: ToleranceStudy) -> Grid:
    """Each tolerance with its limit, what it does to the force at its limit, and where it comes from."""
    rows = []
    for s in study.sensitivities:
        limit, unit = s.tolerance.limit, s.tolerance.unit
        size = format_quantity(limit, unit) if unit else f"{limit:g}"
        change = abs(100 * s.force * relative_limit(s, study.point[1]))
        rows.append((s.tolerance.name.replace("_", " "), f"± {size}", f"{change:.2f}", s.tolerance.source))
    return Grid(("tolerance", "limit", "change of the force, %", "source"), rows)
