"""The command `control`: designs the guarded controller and runs it."""

from dataclasses import replace
from json import loads as parse_json
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from msl_fem.actuator import Actuator
from msl_fem.cli.closing import control_closing
from msl_fem.cli.given_map import given_map
from msl_fem.cli.options import Causes, Json, TableFile, read_option
from msl_fem.cli.output import print_closing, print_result, progress_bar
from msl_fem.cli.stated_causes import read_causes
from msl_fem.cli.sweeping import table_for, table_of_model
from msl_fem.control import (
    ControllerChoice,
    DesignModel,
    ForceTerm,
    IdentifiedPlant,
    PlantUnderTest,
    check_stable_reach,
    closed_loop_record,
    design_model_of,
    design_model_of_terms,
    design_model_with_effects,
    designed,
    examine_design,
    run_closed_loop,
)
from msl_fem.control.stepper import stated
from msl_fem.errors import InputError
from msl_fem.files.schema import reason, small_text
from msl_fem.files.sole_run import sole_run
from msl_fem.files.whole_file import check_target
from msl_fem.identification import ArmaxModel, KnownMass, model_from_json, physical_parameters
from msl_fem.identification.data import rational_term
from msl_fem.maps import OperatingMap, operating_map
from msl_fem.plant.effects import EffectValues, stated_causes
from msl_fem.plant.excitation import load_excitations, reference
from msl_fem.plant.extended_model import ExtendedModel, load_extended_model
from msl_fem.record import check_record_folder, write_record
from msl_fem.report.control_page import control_page
from msl_fem.report.page import write_page
from msl_fem.table.magnetic_table import MagneticTable


def command(
    actuator: Annotated[Path, typer.Argument(metavar="ACTUATOR", help="Actuator file, or an extended model (TOML).")],
    reference_: Annotated[
        str, typer.Option("--reference", metavar="SPEC", help="What to follow.")
    ] = "sine:frequency=2 Hz,amplitude=0.4 mm,duration=2 s",
    table: TableFile = None,
    map_file: Annotated[Path | None, typer.Option("--map", help="Operating map; without, from the table.")] = None,
    model: Annotated[
        str,
        typer.Option(help="What the controller knows: table, an identified model (JSON), or an extended model (TOML)."),
    ] = "table",
    design: Annotated[str, typer.Option(help="lqr, robust, biased or pid.")] = "lqr",
    bandwidth: Annotated[str | None, typer.Option(help="Of the feedback.")] = None,
    peak_sensitivity: Annotated[float | None, typer.Option(help="Bound on max |S|.")] = None,
    feedforward: Annotated[bool, typer.Option(help="Two degrees of freedom, or the paper's integral alone.")] = True,
    preview: Annotated[bool, typer.Option(help="The reference is known ahead, or carried on from now.")] = True,
    bias: Annotated[str | None, typer.Option(help="Bias current of a side, of the biased design.")] = None,
    overlap: Annotated[str, typer.Option(help="Force with which both sides pull at zero force.")] = "0 N",
    output: Annotated[Path | None, typer.Option("-o", "--output", help="Record folder of the run.")] = None,
    report: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Page of the design's trials: the paper's figures, margins (HTML)."),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of the sensors' noise.")] = 1,
    effect: Causes = None,
    json: Json = False,
) -> None:
    """Design the guarded controller and run it.

    An extended model as ACTUATOR is a plant whose effects the controller does not know; as --model, one that it knows.
    The plant has the causes of --effect beside.
    """
    plant = load_extended_model(actuator)
    plant = replace(plant, effects=stated_causes(read_causes(effect), plant.effects))
    wanted = load_excitations(reference_, unit="m")
    if len(wanted) != 1:
        raise InputError(f"--reference names {len(wanted)} references; give one")
    if lacking := plant.actuator.lacking("magnet", "controller"):
        raise InputError(f"{plant.actuator.name} has no {lacking}; control needs [magnet] and [controller]")
    choice = ControllerChoice(
        design,
        None if bandwidth is None else read_option("--bandwidth", bandwidth, "Hz"),
        peak_sensitivity,
        feedforward,
        read_option("--overlap", overlap, "N"),
        None if bias is None else read_option("--bias", bias, "A"),
        preview,
    )
    with sole_run(output):
        if output is not None:
            check_record_folder(output)
        if report is not None:
            check_target(report)
        known = None if model == "table" else _known(Path(model))
        given = given_map(map_file, plant.actuator) if map_file is not None else None
        own = table_of_model(known.actuator, None) if isinstance(known, ExtendedModel) else None
        magnet_table = own if own is not None else table_for(plant.actuator, table)
        assert magnet_table is not None
        regions = given if given is not None else operating_map(magnet_table)
        known_model = _design_model(plant.actuator, known, magnet_table, regions)
        controller = designed(known_model, choice)
        track = reference(wanted[0], rate=1 / controller.law.plant.period)
        check_stable_reach(controller, track)
        true = known if isinstance(known, ExtendedModel) else plant
        acted_on = PlantUnderTest(true.actuator, magnet_table, _effects(true))
        run = run_closed_loop(controller, track, plant=acted_on, generator=np.random.default_rng(seed))
        if output is not None:
            wishes = {name: text for name, text in (("bandwidth", bandwidth), ("bias", bias)) if text is not None}
            section = stated(controller, **wishes)
            record = closed_loop_record(true.actuator, run, excitation=wanted[0].spec, controller=section)
            write_record(record, output)
        fields = {"design": controller.kind} | run.to_json() | controller.to_json()
        fields |= {"effects": list(true.effects.present)}
        if report is not None:
            with progress_bar("trials") as progress:
                trials = examine_design(controller, plant=acted_on, seed=seed, progress=progress)
            write_page(control_page(trials), report)
            fields |= {"report": str(report)}
    title = f"{plant.actuator.name}: {controller.kind} in closed loop on {wanted[0].spec}"
    print_result(fields, as_json=json, title=title)
    print_closing(control_closing(run, controller), as_json=json)


def _known(file: Path) -> ExtendedModel | ArmaxModel:
    """What a file tells the controller: TOML an extended model, JSON an identified one."""
    if file.suffix == ".toml":
        return load_extended_model(file)
    if file.suffix != ".json":
        raise InputError(f"--model {file}: give 'table', an identified model (.json) or an extended model (.toml)")
    try:
        content = parse_json(small_text(file))
    except OSError as err:
        raise InputError(
            f"--model {file}: cannot be read ({reason(err)}); give what 'msl-fem identify -o' wrote"
        ) from err
    except (ValueError, RecursionError) as err:
        raise InputError(f"--model {file}: no JSON ({err}); give what 'msl-fem identify -o' wrote") from err
    if not isinstance(content, dict):
        raise InputError(f"--model {file}: no identified model; give what 'msl-fem identify -o' wrote")
    return model_from_json(content)


def _effects(model: ExtendedModel) -> EffectValues | None:
    return model.effects if model.effects.stated else None


def _design_model(
    actuator: Actuator, known: ExtendedModel | ArmaxModel | None, table: MagneticTable, regions: OperatingMap
) -> DesignModel:
    if known is None:
        return design_model_of(actuator, table, regions)
    if isinstance(known, ArmaxModel):
        return design_model_of_terms(actuator, identified_plant(known, actuator), regions)
    return design_model_with_effects(known.actuator, table, regions, known.effects)


def identified_plant(model: ArmaxModel, actuator: Actuator) -> IdentifiedPlant:
    """Suspension and force terms of an identified model, its scale the actuator's moving mass.

    Raises
    ------
    InputError : a model without rational terms or of another order than a mass on a spring; another nominal gap
    """
    rational, motion = model.rational, actuator.motion
    if rational is None:
        raise InputError("the identified model has no rational terms; identify a record with currents of the sides")
    if motion is None or motion.nominal_gap is None:
        raise InputError(f"{actuator.name} has no motion.nominal_gap; an identified model's terms need it")
    found = physical_parameters(model, mass=KnownMass(motion.moving_mass))
    terms = []
    for text in map(str, rational.terms):
        term = rational_term(text)
        constant = found[f"force_constant[{text}]"].value
        terms.append(ForceTerm(term.side, term.current_power, term.gap_power, constant))
    offset = rational.nominal_gap - motion.nominal_gap
    return IdentifiedPlant(found["stiffness"].value, found["damping"].value, tuple(terms), rational.delta + offset)
