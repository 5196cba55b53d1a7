"""Pages of the leaves, of the trade of the nominal gap, and of manufacturing tolerances."""

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from msl_fem.actuator import Actuator
from msl_fem.design.tolerances import Sensitivity, TableBand, ToleranceStudy
from msl_fem.files.quantity import format_quantity
from msl_fem.mechanics import SuspensionReport
from msl_fem.mechanics.flexure_beam import LeafBeam
from msl_fem.mechanics.gap_trade import GapTrade
from msl_fem.report.figures import BLUE, GREEN, GREY, ORANGE, RED, SERIES, dress, figure, line, logarithmic
from msl_fem.report.page import Grid, Page, Stage

N_DISPLACEMENT, N_BEAM = 61, 9


def flexure_force_figure(report: SuspensionReport) -> go.Figure:
    """Force over displacement: linear, with the cubic term, stretched beam in closed form and by finite elements."""
    made = figure(x="displacement in mm", y="force of all leaves in N")
    if report.full_range is None:
        return made
    flexure, leaf = report.flexure, report.flexure.leaf
    opposed = flexure.arrangement == "opposed"
    x = np.linspace(0.0, report.full_range.range, N_DISPLACEMENT)
    made.add_trace(line(x * 1e3, report.stiffness * x, name="12 E I / L³", colour=GREY, line={"dash": "dash"}))
    if opposed:
        cubic = report.stiffness * x + report.cubic_stiffness * x**3
        exact = [flexure.leaves * leaf.held_force(float(v)) for v in x]
        made.add_trace(line(x * 1e3, cubic, name="with the cubic term", colour=ORANGE))
        made.add_trace(line(x * 1e3, exact, name="stretched beam, closed form", colour=BLUE))
    few, beam = np.linspace(0.0, report.full_range.range, N_BEAM), LeafBeam(leaf)
    solved = [flexure.leaves * beam.deflect(float(v), held_apart=opposed).force for v in few]
    made.add_trace(
        line(few * 1e3, solved, name="finite elements", colour=RED, mode="markers", marker={"size": 7, "symbol": "x"})
    )
    return made


def mode_chart(report: SuspensionReport) -> go.Figure:
    """The mover's modes with the same leaves in one set and in two, on a logarithmic axis."""
    made = figure(x="frequency in Hz", y="")
    for modes, colour in zip(report.modes, (ORANGE, BLUE), strict=False):
        sets = "one set" if modes.sets == 1 else "two sets"
        made.add_trace(
            go.Scatter(
                x=[mode.frequency for mode in modes.rigid],
                y=[_words(mode.name) for mode in modes.rigid],
                name=sets,
                mode="markers",
                marker={"size": 9, "color": colour, "symbol": "circle"}
                if modes.sets == 2
                else {"size": 15, "color": colour, "symbol": "diamond"},  # larger: one may lie behind the other
            )
        )
    names = [_words(mode.name) for mode in report.modes[0].rigid] if report.modes else []
    for name, frequency, colour in (("leaf between clamps", report.leaf_mode, GREY), ("wanted", report.bandwidth, RED)):
        if frequency and names:  # a trace, not a line of the layout: those stand wrong on logarithmic axes
            made.add_trace(line([frequency] * len(names), names, name=name, colour=colour, line={"dash": "dot"}))
    logarithmic(made, [[mode.frequency for modes in report.modes for mode in modes.rigid]], along="x")
    return made


def gap_trade_figure(trade: GapTrade) -> go.Figure:
    """Range, bandwidth and current over the nominal gap, one below the other."""
    made = make_subplots(rows=3, cols=1, shared_xaxes=True, vertical_spacing=0.06)
    dress(made, height=640)
    gap = trade.nominal_gap * 1e3
    made.add_trace(line(gap, trade.range * 1e3, name="range ±", colour=BLUE), row=1, col=1)
    made.add_trace(line(gap, trade.bandwidth_full, name="bandwidth at full range", colour=RED), row=2, col=1)
    small = f"bandwidth at ± {format_quantity(trade.amplitude, 'm', digits=3)}"
    made.add_trace(line(gap, trade.bandwidth_fixed, name=small, colour=ORANGE), row=2, col=1)
    level, force = f"current for {trade.level:g} T", f"current for {trade.force:.3g} N"
    made.add_trace(line(gap, trade.level_current, name=level, colour=GREEN), row=3, col=1)
    made.add_trace(line(gap, trade.force_current, name=force, colour=GREY, line={"dash": "dash"}), row=3, col=1)
    for row, label in enumerate(("range in mm", "bandwidth in Hz", "side current in A"), start=1):
        made.update_yaxes(title={"text": label}, row=row, col=1)
    made.update_xaxes(title={"text": "nominal gap in mm"}, row=3, col=1)
    return made


def flexure_page(actuator: Actuator, report: SuspensionReport) -> Page:
    """The page of a flexure's report."""
    leaf, flexure, full = report.flexure.leaf, report.flexure, report.full_range
    material, widest = leaf.material, 1 / (1 - leaf.material.poisson_ratio**2)
    numbers = [
        ("stiffness, closed form", format_quantity(report.stiffness, "N/m")),
        ("stiffness, finite elements", format_quantity(report.stiffness_beam, "N/m")),
        ("plate factor on E I", f"{leaf.plate_factor:.4f} (narrow beam 1, wide plate {widest:.4f})"),
        ("stress allowed", f"{report.allowed_stress / 1e6:.0f} MPa, {material.source}"),
    ]
    if full is not None:
        numbers += [
            ("stress at full range", f"{full.stress / 1e6:.1f} MPa"),
            ("force at full range", f"{full.force_beam:.4g} N, linear {full.force_linear:.4g} N"),
        ]
    sentence = (
        "No range is stated."
        if full is None
        else f"At full range the leaves push back {100 * (full.force_exact / full.force_linear - 1):.1f} % more than "
        f"a linear spring and reach {full.stress / report.allowed_stress:.0%} of the allowed stress."
    )
    above = {modes.sets: modes.above_first for modes in report.modes}
    modes_said = "Second and third mode lie " + "; ".join(
        " and ".join(f"{f:.0f} Hz" for f in found)
        + f" above the first with the leaves in {'one set' if sets == 1 else 'two sets'}"
        for sets, found in above.items()
    ) + "."  # fmt: skip
    return Page(
        title=f"{actuator.name}: flexure",
        subtitle=f"{flexure.leaves} leaves of {material.name}, "
        f"{leaf.length * 1e3:g} x {leaf.width * 1e3:g} x {leaf.thickness * 1e3:g} mm, {flexure.arrangement}",
        headline=(
            (format_quantity(report.stiffness_used, "N/m"), "stiffness used"),
            (f"{report.first_mode:.1f} Hz", "first mode"),
            ("-" if full is None else f"{full.stress / 1e6:.0f} MPa", "largest stress"),
        ),
        stages=(
            Stage("Force over displacement", sentence, tuple(numbers), plot=flexure_force_figure(report)),
            Stage("Modes", modes_said, _mode_numbers(report), mode_chart(report), table=_mode_table(report)),
        ),
        provenance=(("actuator", f"{actuator.name}, SHA-256 {actuator.digest[:16]}"),),
        notes=report.notes,
    )


def _mode_numbers(report: SuspensionReport) -> tuple[tuple[str, str], ...]:
    numbers = [("first mode", f"{report.first_mode:.1f} Hz"), ("leaf between clamps", f"{report.leaf_mode:.0f} Hz")]
    if report.bandwidth:
        numbers.append(("bandwidth wanted", f"{report.bandwidth:g} Hz"))
    return tuple(numbers)


def _mode_table(report: SuspensionReport) -> Grid:
    """Frequencies of the mover's modes, a column for each arrangement of the leaves."""
    found = [{mode.name: mode.frequency for mode in modes.rigid} for modes in report.modes]
    columns = ["one set" if modes.sets == 1 else "two sets" for modes in report.modes]
    rows = [(_words(name), *(f"{column[name]:.1f}" for column in found)) for name in (found[0] if found else {})]
    return Grid(("mode", *(f"{name}, Hz" for name in columns)), rows)


def gap_trade_page(actuator: Actuator, trade: GapTrade) -> Page:
    """The page of the nominal gap's trade."""
    first, last = 0, trade.nominal_gap.size - 1
    sentence = (
        f"From {trade.nominal_gap[first] * 1e3:.2f} to {trade.nominal_gap[last] * 1e3:.2f} mm of nominal gap the range "
        f"grows to ± {trade.range[last] * 1e3:.2f} mm, the bandwidth at full range falls from "
        f"{trade.bandwidth_full[first]:.0f} to {trade.bandwidth_full[last]:.0f} Hz, and {trade.level:g} T take "
        f"{trade.level_current[last] / trade.level_current[first]:.1f} times the current."
    )
    numbers = (
        ("clearance at the end of the travel", format_quantity(trade.clearance, "m")),
        ("current limit", f"{trade.level:g} T in the iron, or the drive's"),
        ("largest nominal gap that the table covers", format_quantity(trade.gap_limit, "m")),
        ("bandwidth", "a sine whose force is there at every phase; voltage and loop rate are not asked"),
    )
    return Page(
        title=f"{actuator.name}: nominal gap",
        subtitle="Range against bandwidth against current; all else stays",
        headline=(),
        stages=(Stage("The trade", sentence, numbers, plot=gap_trade_figure(trade)),),
        provenance=(("actuator", f"{actuator.name}, SHA-256 {actuator.digest[:16]}"),),
    )


def _words(name: str) -> str:
    return name.replace("_", " ")


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


def table_bands(study: ToleranceStudy, table: TableBand) -> go.Figure:
    """Force over current at each gap of the study: the band of 5 to 95 % of made magnets."""
    made = figure(x="coil current in A", y="force in N")
    for k, gap in enumerate(study.gap):
        low, high = table.force[:, k]
        x, y = np.r_[table.current, table.current[::-1]], np.r_[low, high[::-1]]
        colour = SERIES[k % len(SERIES)]
        outline = {"color": colour, "width": 1}
        name = f"{1e3 * gap:.3g} mm"
        made.add_trace(go.Scatter(x=x, y=y, fill="toself", mode="lines", line=outline, opacity=0.7, name=name))
    return made


def _table_stage(study: ToleranceStudy, table: TableBand) -> Stage:
    """The band of the whole table, and how wide it is where it is widest."""
    low, high = table.force[:, :, -1]
    wide = int(np.argmax((high - low) / (high + low)))
    half = 100 * float((high[wide] - low[wide]) / (high[wide] + low[wide]))
    sentence = (
        f"Force of nine made magnets in ten, over current and gap; at {table.current[-1]:.3g} A and "
        f"{1e3 * study.gap[wide]:.3g} mm it is the widest, ± {half:.2g} %."
    )
    certified = f"{table.certified} of {study.band.samples}, errors up to {table.error_estimate:.1e} of full scale"
    return Stage("The table as made", sentence, (("certified reduced fields", certified),), table_bands(study, table))


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
    made.update_layout(barmode="group", height=520)
    made.update_yaxes(autorange="reversed", automargin=True)
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
        else f"{band.samples} samples of the linearised map, none of them solved directly"
        if not band.checked
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
            *(() if band.table is None else (_table_stage(study, band.table),)),
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
