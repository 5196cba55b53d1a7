"""The command `compare`: how accurate each model is on a record, as a report and as numbers."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from msl_fem.cli.believed import belief_about, stated_belief
from msl_fem.cli.controller_maps import maps_for
from msl_fem.cli.options import BeliefName, Json, TableFile
from msl_fem.cli.output import print_columns, print_result, progress_bar, say, write_json
from msl_fem.cli.sweeping import table_for, table_of_model
from msl_fem.comparison import CompareSettings, Comparison, compare
from msl_fem.files.sole_run import sole_run
from msl_fem.files.whole_file import check_target
from msl_fem.maps.pair_limits import PairMap
from msl_fem.plant.extended_model import ExtendedModel, load_extended_model
from msl_fem.prediction import ModelHypothesis
from msl_fem.record import Record, load_record
from msl_fem.report.comparison_page import comparison_page
from msl_fem.report.page import write_page
from msl_fem.table.magnetic_table import MagneticTable

KINDS = {
    "nrmse_one_step": "1 step", "nrmse_ten_step": "10 steps", "nrmse_closed_loop": "closed", "nrmse_free_run": "free",
}  # fmt: skip


def command(
    record: Annotated[Path, typer.Argument(metavar="RECORD", help="Record folder.")],
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="DIR", help="Folder of compare.json and report.html.")
    ] = None,
    extended: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Extended model; without, extended_model.toml of the record, if it is there."
        ),
    ] = None,
    table: TableFile = None,
    belief: BeliefName = None,
    json: Json = False,
) -> None:
    """Analytic, coupled, re-fitted, extended and ARMAX models against the record's runs and its static map."""
    it = load_record(record)
    it = it if belief is None else replace(it, belief=stated_belief(belief))
    beside = record / "extended_model.toml"
    file = extended if extended is not None else beside if beside.is_file() else None
    model = load_extended_model(file) if file is not None else None
    with sole_run(output):
        _compare(it, model, output=output, table=table, json=json)


def _compare(it: Record, model: ExtendedModel | None, *, output: Path | None, table: Path | None, json: bool) -> None:
    if output is not None:
        for name in ("compare.json", "report.html"):
            check_target(output / name)
    for warning in it.warnings:
        say(f"note: {warning}")
    magnet_table = table_for(it.actuator, table)
    believed = belief_about(it, magnet_table)
    of_model = None
    if model is not None:
        of_model = ModelHypothesis(model.actuator, table_of_model(model.actuator, magnet_table), model.effects)
    with progress_bar("models and runs") as progress:
        settings = CompareSettings(
            table=magnet_table,
            extended=of_model,
            progress=lambda _, done, total: progress(done, total),
            belief=believed,
            pair=_map_of_both(it, magnet_table, table),
        )
        found = compare(it, settings)
    fields = found.to_json() | {"belief": believed.to_json()}
    if output is not None:
        output.mkdir(parents=True, exist_ok=True)
        write_json(fields, output / "compare.json")
        write_page(comparison_page(found), output / "report.html")
        fields |= {"report": str(output / "report.html")}
    if json:
        print_result(fields, as_json=True, title="")
    else:
        _print(found, output)


def _map_of_both(it: Record, magnet: MagneticTable | None, file: Path | None) -> PairMap | None:
    """What the guard of a loop of ours judged both sides by: the map of the table, where that is a pair's."""
    if magnet is None or magnet.shared is None or "design" not in (it.controller or {}):
        return None
    return maps_for(it.actuator, magnet, map_file=None, table_file=file).pair


def _print(found: Comparison, output: Path | None) -> None:
    rows = [accuracy.to_json() for accuracy in found.accuracies]
    if rows:
        columns = {
            "model": [str(row["name"]) for row in rows],
            "run": [f"{row['run']}{' *' if row['role'] == 'held-out' else ''}" for row in rows],
            "channel": [str(row["channel"]).rpartition("_")[0] for row in rows],
        }
        columns |= {title: [_figure(row[name]) for row in rows] for name, title in KINDS.items()}
        floors = {(f["run"], f["channel"]): f["nrmse"] for f in found.noise_floor()}
        columns["noise"] = [_figure(floors[row["run"], row["channel"]]) for row in rows]
        print_columns(columns, title=f"{found.verdict} NRMSE; * held-out:")
        for reason in dict.fromkeys(f"{r['name']}, {r['run']}: {r['reason']}" for r in rows if r["reason"]):
            say(f"note: {reason}")
    else:
        static = [error.to_json() for error in found.static]
        print_columns(
            {
                "table": [str(s["name"]) for s in static],
                "role": [str(s["role"]) for s in static],
                "quantity": [str(s["quantity"]) for s in static],
                "error of full scale": [_figure(s["error_of_full_scale"]) for s in static],
                "scale": [f"{s['scale']:.5g}" for s in static],
            },
            title=found.verdict,
        )
    for note in found.models.notes:
        say(f"note: {note}")
    if output is not None:
        say(f"report: {output / 'report.html'}")


def _figure(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}"
