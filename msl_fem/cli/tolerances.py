"""The command `tolerances`: what manufacturing tolerances do to force, flux linkage and map."""

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from msl_fem.actuator import load_actuator
from msl_fem.cli.options import AccuracyLevel, ActuatorFile, Json, SectionEnds, read_option, read_options
from msl_fem.cli.output import print_columns, print_result, progress_bar
from msl_fem.cli.sweeping import checked_accuracy, checked_end_effects, default_workers
from msl_fem.computing.jobs import Executor
from msl_fem.computing.row_cache import RowCache
from msl_fem.design.tolerances import NAMES, RowRun, ToleranceSettings, ToleranceStudy, tolerance_study
from msl_fem.design.tolerances.manufactured import LENGTHS
from msl_fem.design.tolerances.study import Band, TableBand
from msl_fem.errors import InputError
from msl_fem.files.whole_file import check_target
from msl_fem.report.design_pages import relative_limit, tolerance_page
from msl_fem.report.page import write_page


def command(
    actuator: ActuatorFile,
    tolerance: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=LIMIT",
            help='A limit in place of the usual one, like gap="20 um" or bh_polarisation=2%; repeatable.',
        ),
    ] = None,
    gaps: Annotated[str | None, typer.Option(help="Gaps of the map; without, five over the travel.")] = None,
    levels: Annotated[str, typer.Option(help="Flux densities in the iron whose currents are mapped.")] = "1.2,1.6 T",
    current: Annotated[str | None, typer.Option(help="Current at which force and flux are told; needs --gap.")] = None,
    gap: Annotated[str | None, typer.Option(help="Air gap at which force and flux are told; needs --current.")] = None,
    samples: Annotated[int, typer.Option(help="Magnets that the Monte Carlo study draws.")] = 2000,
    checks: Annotated[int, typer.Option(help="Samples solved directly, to check the linearised map.")] = 24,
    direct: Annotated[bool, typer.Option("--direct", help="Solve the fields of all samples.")] = False,
    tables: Annotated[
        bool, typer.Option("--tables", help="As --direct, with the band of the whole table of force and flux linkage.")
    ] = False,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the magnets that are drawn.")] = 1,
    accuracy: AccuracyLevel = "fast",
    end_effects: SectionEnds = None,
    workers: Annotated[int, typer.Option(min=0, max=256, help="Processes; 0: one a core.")] = 0,
    output: Annotated[Path | None, typer.Option("-o", "--output", help="HTML page with the figures.")] = None,
    resume: Annotated[bool, typer.Option(help="Take finished magnets of an interrupted run (needs -o).")] = False,
    json: Json = False,
) -> None:
    """Sensitivities by central differences on field solutions, and the band of the map by Monte Carlo.

    Limits are those given, else [tolerances] of the actuator file, else defaults with their sources.
    """
    it = load_actuator(actuator)
    if (current is None) != (gap is None):
        raise InputError("give both --current and --gap, or neither")
    if resume and output is None:
        raise InputError("--resume needs -o: finished magnets are kept beside the page")
    if output is not None:
        check_target(output, apart_from=[actuator])
    settings = ToleranceSettings(
        tolerances=dict(_limit(text) for text in tolerance or []),
        gaps=None if gaps is None else tuple(read_options("--gaps", gaps, "m")),
        levels=tuple(read_options("--levels", levels, "T")),
        point=None
        if current is None or gap is None
        else (read_option("--current", current, "A"), read_option("--gap", gap, "m")),
        samples=samples,
        checks=checks,
        direct=direct,
        tables=tables,
        seed=seed,
        accuracy=checked_accuracy(accuracy),
        end_effects=checked_end_effects(end_effects),
    )
    cache = RowCache(output.with_name(f".{output.name}.rows")) if output is not None else None
    if cache is not None:
        cache.check_writable()
    with progress_bar("made magnets") as progress:
        running = RowRun(Executor(workers or default_workers()), cache, resume, progress)
        study = tolerance_study(it, settings=settings, running=running)
    if output is not None:
        write_page(tolerance_page(it, study), output)
    if cache is not None:
        cache.clear()
    fields = tolerances_to_json(study) | ({"report": str(output)} if output else {})
    if json:
        print_result(fields, as_json=True, title="")
        return
    _print_tables(study, it.name)


def _limit(text: str) -> tuple[str, float]:
    name, _, value = (part.strip() for part in text.partition("="))
    if name not in NAMES:
        raise InputError(f"--tolerance '{text}': write NAME=LIMIT, with a name of {', '.join(NAMES)}")
    return name, read_option(f"--tolerance {name}", value, "m" if name == "gap" or name in LENGTHS else "")


def tolerances_to_json(study: ToleranceStudy) -> dict[str, Any]:
    """The fields of the JSON."""
    band = study.band
    return {
        "point": {"current_A": study.point[0], "gap_m": study.point[1]},
        "force_N": study.nominal["force"],
        "flux_linkage_Wb": study.nominal["flux_linkage"],
        "levels_T": study.levels,
        "gap_m": study.gap,
        "current_A": study.current,
        "sections": list(study.sections),
        "sensitivities": [
            {
                "name": s.tolerance.name,
                "nominal": s.tolerance.nominal,
                "tolerance": s.tolerance.limit,
                "unit": s.tolerance.unit,
                "source": s.tolerance.source,
                "force": s.force,
                "flux_linkage": s.flux_linkage,
                "current": {name: values for name, values in zip(study.sections, s.current, strict=True)},
                "step": s.step,
                "step_error": s.step_error,
            }
            for s in study.sensitivities
        ],
        "band": {
            "low_A": band.low,
            "high_A": band.high,
            "force_N": list(band.force),
            "flux_linkage_Wb": list(band.flux_linkage),
            "method": band.method,
            "samples": band.samples,
            "seed": band.seed,
            "checked": band.checked,
            "linearisation_error": band.linearisation_error,
            "band_error": band.band_error,
            **_table_to_json(band),
        },
    }


def _table_to_json(band: Band) -> dict[str, Any]:
    """The field `table` of the band, where whole tables were asked for."""
    table = band.table
    if table is None:
        return {}
    force, flux = (dict(zip(("low", "high"), values, strict=True)) for values in (table.force, table.flux_linkage))
    return {
        "table": {
            "current_A": table.current,
            "force_N": force,
            "flux_linkage_Wb": flux,
            "certified": table.certified,
            "error_estimate": table.error_estimate,
        }
    }


def _print_tables(study: ToleranceStudy, name: str) -> None:
    at = int(np.argmin(np.abs(study.gap - study.point[1])))
    found = study.sensitivities
    columns = {
        "quantity": [s.tolerance.name.replace("_", " ") for s in found],
        "± in %": [f"{100 * relative_limit(s, study.point[1]):.2f}" for s in found],
        "dlnF/dlnp": [f"{s.force:+.3f}" for s in found],
        "dlnλ/dlnp": [f"{s.flux_linkage:+.3f}" for s in found],
    }
    for k, section in enumerate(study.sections):
        title = f"dlni/dlnp, {section.replace('_', ' ')}"
        columns[title] = [f"{s.current[k, 0, at]:+.3f}" for s in found]
    columns["step error"] = [f"{s.step_error:.1e}" for s in found]
    at_gap = f"currents i for {study.levels[0]:g} T at {study.gap[at] * 1e3:.3g} mm"
    point = f"{study.point[0]:.3g} A, {study.point[1] * 1e3:.3g} mm"
    print_columns(columns, title=f"{name}: sensitivities at {point}; {at_gap}")
    bands = {"gap in mm": [f"{g * 1e3:.4g}" for g in study.gap]}
    for k, level in enumerate(study.levels):
        bands[f"{level:g} T in A"] = [f"{i:.3f}" for i in study.current[k]]
        bands[f"{level:g} T, 5 ... 95 %"] = [
            f"{a:.3f} ... {b:.3f}" for a, b in zip(study.band.low[k], study.band.high[k], strict=True)
        ]
    print_columns(bands, title=f"the map's band, {study.band.samples} samples, {study.band.method}")
    if study.band.table is not None:
        _print_table_band(study, study.band.table)


def _print_table_band(study: ToleranceStudy, table: TableBand) -> None:
    """The force's band at every second current of the table."""
    columns = {"gap in mm": [f"{g * 1e3:.4g}" for g in study.gap]}
    for k in range(1, table.current.size, 2):
        low, high = table.force[:, :, k]
        columns[f"{table.current[k]:.3g} A"] = [f"{a:.4g} ... {b:.4g}" for a, b in zip(low, high, strict=True)]
    told = f"{table.certified} by a certified reduced field (errors up to {table.error_estimate:.1e} of full scale)"
    print_columns(columns, title=f"force in N, 5 ... 95 % of {study.band.samples} samples, {told}")
