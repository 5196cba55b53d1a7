"""The commands `flexure` and `gap-trade`: leaves that carry the mover, and what a larger nominal gap buys."""

from pathlib import Path
from typing import Annotated, Any

import typer

from msl_fem.actuator import load_actuator
from msl_fem.cli.options import ActuatorFile, Json, TableFile, read_option
from msl_fem.cli.output import print_columns, print_result, say
from msl_fem.cli.sweeping import table_for
from msl_fem.errors import InputError
from msl_fem.files.whole_file import check_target
from msl_fem.mechanics import SuspensionReport, assess_flexure
from msl_fem.mechanics.gap_trade import TradeSettings, gap_trade
from msl_fem.report.design_pages import flexure_page, gap_trade_page
from msl_fem.report.page import write_page


def flexure(
    actuator: ActuatorFile,
    bandwidth: Annotated[
        str | None, typer.Option(help='Bandwidth that is wanted below the first mode, like "50 Hz".')
    ] = None,
    output: Annotated[Path | None, typer.Option("-o", "--output", help="HTML page with the figures.")] = None,
    json: Json = False,
) -> None:
    """Stiffness, hardening, stress at full range and modes of the leaves in [motion.flexure]."""
    it = load_actuator(actuator)
    wanted = None if bandwidth is None else read_option("--bandwidth", bandwidth, "Hz")
    if output is not None:
        check_target(output, apart_from=[actuator])
    report = assess_flexure(it, bandwidth=wanted)
    if output is not None:
        write_page(flexure_page(it, report), output)
    for note in report.notes:
        say(f"note: {note}")
    fields = flexure_to_json(report) | ({"report": str(output)} if output else {})
    if json:
        print_result(fields, as_json=True, title="")
        return
    modes = fields.pop("modes")
    print_result(fields, as_json=False, title=f"{it.name}: {report.flexure.leaves} leaves")
    for found in modes:
        columns = {
            "mode": [row["mode"].replace("_", " ") for row in found["mover"]],
            "frequency in Hz": [f"{row['frequency_Hz']:.1f}" for row in found["mover"]],
        }
        print_columns(columns, title=f"the mover's modes, the same leaves in {found['sets']} set(s)")


def flexure_to_json(report: SuspensionReport) -> dict[str, Any]:
    """The fields of the JSON."""
    leaf, full = report.flexure.leaf, report.full_range
    fields: dict[str, Any] = {
        "material": leaf.material.name,
        "leaves": report.flexure.leaves,
        "stiffness_N_per_m": report.stiffness,
        "stiffness_beam_N_per_m": report.stiffness_beam,
        "stiffness_used_N_per_m": report.stiffness_used,
        "plate_factor": leaf.plate_factor,
        "cubic_stiffness_N_per_m3": report.cubic_stiffness,
        "first_mode_Hz": report.first_mode,
        "leaf_mode_Hz": report.leaf_mode,
        "bandwidth_Hz": report.bandwidth,
        "first_mode_ok": report.first_mode_ok,
        "allowed_stress_Pa": report.allowed_stress,
        "stress_ok": report.stress_ok,
        "full_range": None,
        "modes": [
            {
                "sets": modes.sets,
                "above_first_Hz": list(modes.above_first),
                "mover": [{"mode": m.name, "frequency_Hz": m.frequency} for m in modes.rigid],
                "plane": [{"mode": m.name, "frequency_Hz": m.frequency} for m in modes.plane],
            }
            for modes in report.modes
        ],
        "notes": list(report.notes),
    }
    if full is not None:
        fields["full_range"] = {
            "range_m": full.range,
            "force_linear_N": full.force_linear,
            "force_cubic_N": full.force_cubic,
            "force_exact_N": full.force_exact,
            "force_beam_N": full.force_beam,
            "stress_bending_Pa": full.stress_bending,
            "stress_membrane_Pa": full.stress_membrane,
            "stress_beam_Pa": full.stress_beam,
            "stress_Pa": full.stress,
        }
    return fields


def trade_gap(
    actuator: ActuatorFile,
    table: TableFile = None,
    level: Annotated[str, typer.Option(help="Flux density in the iron that bounds the current.")] = "1.2 T",
    clearance: Annotated[str | None, typer.Option(help="Gap left at the end of the travel.")] = None,
    amplitude: Annotated[
        str | None, typer.Option(help='Amplitude of motion at which the bandwidth is told, like "0.1 mm".')
    ] = None,
    force: Annotated[str | None, typer.Option(help='Force whose current is told at each gap, like "50 N".')] = None,
    output: Annotated[Path | None, typer.Option("-o", "--output", help="HTML page with the figure.")] = None,
    json: Json = False,
) -> None:
    """What a larger nominal gap buys and costs: range against bandwidth against current."""
    it = load_actuator(actuator)
    settings = TradeSettings(
        level=read_option("--level", level, "T"),
        clearance=None if clearance is None else read_option("--clearance", clearance, "m"),
        amplitude=None if amplitude is None else read_option("--amplitude", amplitude, "m"),
        force=None if force is None else read_option("--force", force, "N"),
    )
    if output is not None:
        check_target(output, apart_from=[actuator, *([] if table is None else [table])])
    known = table_for(it, table)
    if known is None:
        raise InputError(f"{it.name} has no magnet, whose gap could be traded")
    trade = gap_trade(it, known, settings=settings)
    if output is not None:
        write_page(gap_trade_page(it, trade), output)
    fields = {
        "nominal_gap_m": trade.nominal_gap,
        "range_m": trade.range,
        "bandwidth_full_range_Hz": trade.bandwidth_full,
        "bandwidth_fixed_amplitude_Hz": trade.bandwidth_fixed,
        "level_current_A": trade.level_current,
        "force_current_A": trade.force_current,
        "level_T": trade.level,
        "clearance_m": trade.clearance,
        "amplitude_m": trade.amplitude,
        "force_N": trade.force,
        "largest_nominal_gap_m": trade.gap_limit,
    } | ({"report": str(output)} if output else {})
    if json:
        print_result(fields, as_json=True, title="")
        return
    columns = {
        "nominal gap in mm": [f"{v * 1e3:.3f}" for v in trade.nominal_gap],
        "range in mm": [f"{v * 1e3:.3f}" for v in trade.range],
        "full range, Hz": [f"{v:.0f}" for v in trade.bandwidth_full],
        f"{trade.amplitude * 1e3:.3g} mm, Hz": [f"{v:.0f}" if v == v else "-" for v in trade.bandwidth_fixed],
        f"{trade.level:g} T in A": [f"{v:.3f}" for v in trade.level_current],
        f"{trade.force:.3g} N in A": [f"{v:.3f}" if v == v else "-" for v in trade.force_current],
    }
    print_columns(columns, title=f"{it.name}: trade of the nominal gap, {trade.clearance * 1e3:.3g} mm clearance")
