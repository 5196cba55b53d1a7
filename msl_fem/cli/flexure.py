"""The command `flexure`: whether the leaves of an actuator do what it needs."""

from pathlib import Path
from typing import Annotated, Any

import typer

from msl_fem.actuator import load_actuator
from msl_fem.cli.options import ActuatorFile, Json, read_option
from msl_fem.cli.output import print_columns, print_result, say
from msl_fem.files.whole_file import check_target
from msl_fem.mechanics import SuspensionReport, assess_flexure
from msl_fem.report.mechanics import flexure_page
from msl_fem.report.page import write_page


def command(
    actuator: ActuatorFile,
    bandwidth: Annotated[str | None, typer.Option(help='Wanted below the first mode, like "50 Hz".')] = None,
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
    fields = flexure_fields(report) | ({"report": str(output)} if output else {})
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


def flexure_fields(report: SuspensionReport) -> dict[str, Any]:
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
