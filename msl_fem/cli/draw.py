"""The command `draw`: the dimensioned section of a magnet, before any field is solved."""

from pathlib import Path
from typing import Annotated

import typer

from msl_fem.actuator import load_actuator
from msl_fem.cli.options import ActuatorFile, Json, read_option
from msl_fem.cli.output import print_result
from msl_fem.export.dxf_section import dxf_text, write_dxf
from msl_fem.export.femm_section import femm_text, write_femm
from msl_fem.files.whole_file import check_target
from msl_fem.report.section_drawing import draw_section, save_drawing


def command(
    actuator: ActuatorFile,
    output: Annotated[
        Path, typer.Option("-o", "--output", help="File to write: .svg, .png, .pdf, .dxf for CAD or .fem for FEMM.")
    ] = Path("section.svg"),
    gap: Annotated[str | None, typer.Option(help='Gap to draw, like "0.5 mm"; else the nominal one.')] = None,
    json: Json = False,
) -> None:
    """The section of a magnet with its dimensions, irons and winding, before any solve."""
    it = load_actuator(actuator)
    check_target(output, apart_from=[actuator])
    at = None if gap is None else read_option("--gap", gap, "m")
    if output.suffix.lower() == ".dxf":
        write_dxf(dxf_text(it, at), output)
    elif output.suffix.lower() == ".fem":
        write_femm(femm_text(it, at), output)
    else:
        save_drawing(draw_section(it, at), output)
    measures = it.magnet_kind().measures(1e-3)
    fields = {"files": [str(output)], "dimensions": {f"{m.name}_m": round(m.length, 12) for m in measures}}
    print_result(fields, as_json=json, title=f"{it.name}: section {output}")
