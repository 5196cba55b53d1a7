"""The command `loop`: how robust a loop is, measured on its own data."""

from pathlib import Path
from typing import Annotated

import typer

from msl_fem.cli.closing import loop_closing
from msl_fem.cli.options import Json
from msl_fem.cli.output import print_closing, print_columns, print_result, say
from msl_fem.control.measured_loop import MeasuredLoop, measured_loops, text_of
from msl_fem.files.whole_file import check_target
from msl_fem.record import load_record
from msl_fem.report.loop_page import loop_page
from msl_fem.report.page import write_page


def command(
    record: Annotated[Path, typer.Argument(metavar="RECORD", help="Record folder; runs need a column injection_m.")],
    report: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Page with the measured sensitivity (HTML).")
    ] = None,
    json: Json = False,
) -> None:
    """Sensitivity and margins of a loop that runs, from a test signal on its position reading, with 95 % intervals.

    The zone is that of ISO 14839-3 for the largest sensitivity; no model of plant or controller is used.
    """
    if report is not None:
        check_target(report)
    measured = load_record(record)
    for warning in measured.warnings:
        say(f"note: {warning}")
    loops = measured_loops(measured)
    if report is not None:
        write_page(loop_page(loops, measured, str(record)), report)
    if json:
        fields = loops[0].to_json() | {"runs": [loop.to_json() for loop in loops]}
        print_result(fields | ({} if report is None else {"report": str(report)}), as_json=True, title="")
        return
    print_columns(_table(loops), title=f"the loop of {record}: largest sensitivity and margins, with 95 % intervals")
    print_closing(loop_closing(loops[0]), as_json=False)


def _table(loops: tuple[MeasuredLoop, ...]) -> dict[str, list[str]]:
    """A column of figures for each run."""
    rows = ["position", "peak sensitivity", "at", "zone", "gain margin up", "gain margin down", "phase margin", "delay"]
    return {"run": rows} | {loop.run: _figures(loop) for loop in loops}


def _figures(loop: MeasuredLoop) -> list[str]:
    return [
        f"{loop.position * 1e3:.3f} mm",
        text_of(loop.peak, ""),
        f"{loop.peak_at:.0f} Hz",
        loop.zone,
        text_of(loop.gain_up, ""),
        text_of(loop.gain_down, ""),
        text_of(loop.phase, "deg"),
        text_of(loop.delay, "s"),
    ]
