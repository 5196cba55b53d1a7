"""The command `control`: designs the guarded controller and runs it."""

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from msl_fem.actuator import Actuator, load_actuator
from msl_fem.cli.options import ActuatorFile, Json, TableFile, read_option
from msl_fem.cli.output import print_result
from msl_fem.cli.sweeping import table_for
from msl_fem.control import (
    ClosedLoopRun,
    ControllerDesign,
    TruePlant,
    closed_loop_record,
    design_controller,
    run_closed_loop,
)
from msl_fem.coupled_model.excitation import load_excitations, reference
from msl_fem.errors import InputError
from msl_fem.operating_map import OperatingMap, operating_map, read_map
from msl_fem.record import check_record_folder, write_record
from msl_fem.table import MagneticTable


def command(
    actuator: ActuatorFile,
    reference_: Annotated[
        str, typer.Option("--reference", metavar="SPEC", help="What to follow.")
    ] = "sine:frequency=2 Hz,amplitude=0.4 mm,duration=2 s",
    table: TableFile = None,
    map_file: Annotated[Path | None, typer.Option("--map", help="Operating map; without, from the table.")] = None,
    model: Annotated[str, typer.Option(help="table: the input transformation's model.")] = "table",
    design: Annotated[str, typer.Option(help="lqr")] = "lqr",
    bandwidth: Annotated[str | None, typer.Option(help="Of the feedback.")] = None,
    peak_sensitivity: Annotated[float | None, typer.Option(help="Bound on max |S|.")] = None,
    feedforward: Annotated[bool, typer.Option(help="Two degrees of freedom, or the paper's integral alone.")] = True,
    output: Annotated[Path | None, typer.Option("-o", "--output", help="Record folder of the run.")] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of the sensor's noise.")] = 1,
    json: Json = False,
) -> None:
    """Design the guarded controller and run it on the believed plant."""
    if model != "table" or design != "lqr":
        raise InputError(f"--model {model} --design {design} is not available; use --model table --design lqr")
    it = load_actuator(actuator)
    wanted = load_excitations(reference_, unit="m")
    if len(wanted) != 1:
        raise InputError(f"--reference names {len(wanted)} references; give one")
    if it.magnet is None or it.controller is None:
        raise InputError(f"{it.name} has no [magnet] or no [controller]; control needs both")
    if output is not None:
        check_record_folder(output)
    given = read_map(map_file) if map_file is not None else None
    magnet_table = table_for(it, table)
    assert magnet_table is not None
    regions = given if given is not None else operating_map(magnet_table)
    made = _design(it, magnet_table, regions, bandwidth, peak_sensitivity, feedforward)
    generator = np.random.default_rng(seed)
    run = run_closed_loop(
        made,
        reference(wanted[0], rate=it.controller.rate),
        plant=TruePlant(it, magnet_table),
        generator=generator,
    )
    fields = control_fields(made, run)
    if output is not None:
        write_record(closed_loop_record(it, run, excitation=wanted[0].spec, generator=generator), output)
    print_result(fields, as_json=json, title=f"{it.name}: closed loop on {wanted[0].spec}")


def _design(
    actuator: Actuator,
    table: MagneticTable,
    regions: OperatingMap,
    bandwidth: str | None,
    peak_sensitivity: float | None,
    feedforward: bool,
) -> ControllerDesign:
    wishes: dict[str, float] = {}
    if bandwidth is not None:
        wishes["bandwidth"] = read_option("--bandwidth", bandwidth, "Hz")
    if peak_sensitivity is not None:
        wishes["peak_sensitivity"] = peak_sensitivity
    return design_controller(actuator, table, regions, feedforward=feedforward, **wishes)


def control_fields(design: ControllerDesign, run: ClosedLoopRun) -> dict[str, Any]:
    """The JSON fields of `control`."""
    return {
        "tracking_rms_m": run.tracking_rms,
        "peak_current_A": run.peak_current,
        "copper_loss_W": run.copper_loss,
        "guard_violations": run.guard_violations,
        "guard_regions": run.region_counts,
        "force_limited": run.force_limited,
        "bandwidth_Hz": design.bandwidth,
        "feedback_bandwidth_Hz": design.feedback_bandwidth,
        "flat_band_Hz": design.flat_band,
        "peak_sensitivity": design.peak_sensitivity,
        "reach_m": list(design.reach),
    }
