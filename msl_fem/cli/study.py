"""The command `study`: the whole chain, its files, and one report."""

from pathlib import Path
from typing import Annotated, Any

import typer

from msl_fem.actuator import Actuator, load_actuator
from msl_fem.cli.options import AccuracyLevel, ActuatorFile, Json
from msl_fem.cli.output import print_line, print_result, say, stages_bar, write_json
from msl_fem.cli.sweeping import checked_accuracy, default_workers
from msl_fem.computing.row_cache import RowCache
from msl_fem.errors import InputError
from msl_fem.files.sole_run import sole_run
from msl_fem.files.whole_file import check_target
from msl_fem.maps import write_map
from msl_fem.record import check_record_folder, write_record
from msl_fem.report.page import write_page
from msl_fem.report.study_page import headline_numbers, study_page
from msl_fem.study import StudySettings, run_study
from msl_fem.table.magnetic_table import write_table


def command(
    actuator: ActuatorFile,
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder of the results.")] = Path("study"),
    accuracy: AccuracyLevel = "normal",
    workers: Annotated[int, typer.Option(min=0, max=256, help="Processes; 0: one a core.")] = 0,
    resume: Annotated[bool, typer.Option(help="Take finished rows of an interrupted table.")] = False,
    json: Json = False,
) -> None:
    """Tables, map, coupled model, simulated record, ARMAX, closed loop, one report.

    Of two runs on one folder at once the second is refused, as with all commands that write several files.
    """
    it = load_actuator(actuator)
    if output.exists() and not output.is_dir():
        raise InputError(f"{output} is a file; name a folder with -o")
    settings = StudySettings(checked_accuracy(accuracy), workers or default_workers(), output / ".rows", resume)
    with sole_run(output):
        _study(it, settings, output=output, json=json)


def _study(it: Actuator, settings: StudySettings, *, output: Path, json: bool) -> None:
    for name in ("table.nc", "map.json", "armax.json", "report.html", "study.json"):
        check_target(output / name)
    check_record_folder(output / "record")
    cache = RowCache(output / ".rows")

    def keep(name: str, result: Any) -> None:
        if name == "table":
            write_table(result, output / "table.nc")
            cache.clear()
        elif name == "map":
            write_map(result, output / "map.json")
        elif name == "record":
            write_record(result, output / "record")
        elif name == "model":
            write_json(result.model.to_json(), output / "armax.json")

    with stages_bar() as progress:
        done = run_study(it, settings=settings, progress=progress, keep=keep)
        page = study_page(done)
        report = write_page(page, output / "report.html")
    files = {"report": str(report), "table": str(output / "table.nc"), "map": str(output / "map.json")}
    more = {"record": str(output / "record"), "model": str(output / "armax.json")}
    fields = {**files, **more, "seconds": done.seconds, **headline_numbers(done)}
    write_json(fields, output / "study.json")
    if json:
        print_result(fields, as_json=True, title="")
        return
    for note in page.notes:
        say(f"note: {note}")
    print_result({label: value for value, label in page.headline}, as_json=False, title=f"{it.name}: study in {output}")
    print_line(f"report: {report}")
