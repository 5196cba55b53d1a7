"""The command `control`: designs the guarded controller and runs it."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from msl_fem.cli.believed import belief_fields, model_with_belief, stated_belief
from msl_fem.cli.closing import control_closing
from msl_fem.cli.controller_maps import maps_for
from msl_fem.cli.controllers import DesignOptions, design_of
from msl_fem.cli.effects_told import effects_told
from msl_fem.cli.foretold import design_of_belief, improvement_on
from msl_fem.cli.options import (
    Bandwidth,
    BeliefName,
    Bias,
    Causes,
    DesignName,
    DiagnosisFolder,
    Feedforward,
    Json,
    Known,
    MapFile,
    Overlap,
    PeakSensitivity,
    Preview,
    TableFile,
)
from msl_fem.cli.output import print_closing, print_result, progress_bar, say
from msl_fem.cli.stated_causes import read_causes
from msl_fem.cli.sweeping import table_for, table_of_model
from msl_fem.cli.told import Told
from msl_fem.control import (
    ControllerDesign,
    PlantUnderTest,
    check_stable_reach,
    closed_loop_record,
    examine_design,
    run_closed_loop,
)
from msl_fem.control.injection import held_under_test
from msl_fem.control.spec_sheet import spec_sheet
from msl_fem.control.stepper import stated
from msl_fem.control.unseen_plants import SUSPECTS, DrawPlant, UnseenPlants, on_unseen_plants, suspected_plant
from msl_fem.errors import InputError
from msl_fem.export.c_controller import ControllerSource
from msl_fem.export.c_controller import write as write_controller
from msl_fem.files.sole_run import sole_run
from msl_fem.files.whole_file import check_target
from msl_fem.plant.believed import AS_DESIGNED, PLAIN_BELIEF, Belief
from msl_fem.plant.effects import EffectValues, stated_causes
from msl_fem.plant.excitation import Reference, load_excitations, reference
from msl_fem.plant.excitation_kinds import Excitation
from msl_fem.plant.extended_model import ExtendedModel, load_extended_model
from msl_fem.record import check_record_folder, write_record
from msl_fem.report.control_page import control_page
from msl_fem.report.page import write_page
from msl_fem.table.magnetic_table import MagneticTable

_REFERENCE = "sine:frequency=2 Hz,amplitude=0.4 mm,duration=2 s"


def command(
    actuator: Annotated[
        Path | None,
        typer.Argument(metavar="[ACTUATOR]", help="Actuator file, or an extended model (TOML); with --from optional."),
    ] = None,
    reference_: Annotated[
        str | None,
        typer.Option("--reference", metavar="SPEC", help="What to follow; without, a sine of 0.4 mm, 2 Hz."),
    ] = None,
    inject: Annotated[
        str | None,
        typer.Option(metavar="SPEC", help="Test signal on the reading, in m, while its bias is held; for 'loop'."),
    ] = None,
    table: TableFile = None,
    map_file: MapFile = None,
    model: Known = "table",
    diagnosis: DiagnosisFolder = None,
    design: DesignName = "lqr",
    bandwidth: Bandwidth = None,
    peak_sensitivity: PeakSensitivity = None,
    feedforward: Feedforward = True,
    preview: Preview = True,
    bias: Bias = None,
    overlap: Overlap = "0 N",
    unseen: Annotated[
        int, typer.Option(min=0, metavar="N", help="Plants beside the believed one to judge the loop on; 0: none.")
    ] = 20,
    output: Annotated[Path | None, typer.Option("-o", "--output", help="Record folder of the run.")] = None,
    header: Annotated[
        Path | None, typer.Option("--c", metavar="FILE", help="The controller as C99 header, as 'export' writes it.")
    ] = None,
    report: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Page of the design's trials: the paper's figures, margins (HTML)."),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of the sensors' noise.")] = 1,
    effect: Causes = None,
    belief: BeliefName = None,
    json: Json = False,
) -> None:
    """Design the guarded controller and run it.

    Controller and plant are as the drawing tells. An extended model as ACTUATOR is a plant whose effects the controller
    does not know; as --model, one that it knows.
    With --from the controller knows what a diagnosis says, a record is diagnosed first; it is judged on plants that the
    diagnosis leaves possible, beside the controller of the belief.
    The plant has the causes of --effect beside. With --inject the run holds a position, and 'msl-fem loop' measures it.
    """
    options = DesignOptions(model, design, bandwidth, peak_sensitivity, feedforward, preview, bias, overlap)
    options.choice()  # a wrong unit is told before anything is computed
    if actuator is None and diagnosis is None:
        raise InputError("ACTUATOR is missing; give an actuator file, or --from a diagnosis or a record")
    for file in (report, header):
        if file is not None:
            check_target(file)
    told = options.told(diagnosis, table)
    plant = told.model if actuator is None and told is not None else load_extended_model(Path(str(actuator)))
    causes = read_causes(effect)
    wanted = _followed(reference_, inject)
    if lacking := plant.actuator.lacking("magnet", "controller"):
        raise InputError(f"{plant.actuator.name} has no {lacking}; control needs [magnet] and [controller]")
    with sole_run(output):
        if output is not None:
            check_record_folder(output)
        known = options.known() if told is None else told.model
        own = table_of_model(known.actuator, None) if isinstance(known, ExtendedModel) else None
        magnet_table = own if own is not None else table_for(plant.actuator, table)
        assert magnet_table is not None
        knows_all = isinstance(known, ExtendedModel) and (told is None or actuator is None)
        plant, believed = _as_believed(belief, plant, magnet_table, itself=not knows_all)
        plant = replace(plant, effects=stated_causes(causes, plant.effects))
        maps = maps_for(plant.actuator, magnet_table, map_file=map_file, table_file=table)
        controller = design_of(options, known, plant.actuator, magnet_table, maps, belief=believed)
        rate = 1 / controller.law.plant.period
        held = None if inject is None else held_under_test(wanted, rate=rate)
        track = reference(wanted, rate=rate) if held is None else held.reference
        signal = None if held is None else held.signal
        check_stable_reach(controller, track)
        true = known if knows_all and isinstance(known, ExtendedModel) else plant
        acted_on = PlantUnderTest(true.actuator, magnet_table, _effects(true))
        run = run_closed_loop(
            controller, track, plant=acted_on, generator=np.random.default_rng(seed), injection=signal
        )
        if output is not None:
            wishes = {name: text for name, text in (("bandwidth", bandwidth), ("bias", bias)) if text is not None}
            section = stated(controller, **wishes)
            record = closed_loop_record(
                true.actuator, run, excitation=wanted.spec, controller=section, injection=signal
            )
            write_record(replace(record, belief=believed.name), output)
        fields = {"design": controller.kind} | run.to_json() | controller.to_json()
        fields |= {"effects": effects_told(true.effects, as_json=json)} | belief_fields(believed, as_json=json)
        draws = _draws(acted_on, told)
        others = _on_others(controller, track, draws, n=unseen) if unseen and held is None else None
        over = None
        if others is not None and told is not None:
            before = design_of_belief(options, told, magnet_table, own=own is not None, files=(table, map_file))
            over = improvement_on(before, others, track, draws.draw)
        sheet = spec_sheet(controller, run=run, unseen=others, over_belief=over)
        promised = sheet.to_json()
        if not json:
            del promised["positions"]  # a row each: of a terminal they would take all
        fields |= {"loop": promised}
        if header is not None:
            write_controller(ControllerSource(controller, maps.one_side), header)
            fields |= {"c": str(header)}
        if report is not None:
            with progress_bar("trials") as progress:
                trials = examine_design(controller, plant=acted_on, seed=seed, progress=progress)
            write_page(control_page(trials, sheet), report)
            fields |= {"report": str(report)}
    title = f"{plant.actuator.name}: {controller.kind} in closed loop on {wanted.spec}"
    print_result(fields, as_json=json, title=title)
    print_closing(control_closing(run, controller), as_json=json)


def _as_believed(
    name: str | None, plant: ExtendedModel, table: MagneticTable, *, itself: bool
) -> tuple[ExtendedModel, Belief]:
    """(the plant with what is believed of it, the belief); where the plant is not `itself` but what --model or --from
    tell, it is as they tell."""
    if itself:
        return model_with_belief(name, plant, table)
    if name is not None and stated_belief(name) == AS_DESIGNED:
        raise InputError(f"--belief {AS_DESIGNED}: the plant is the extended model here; leave the option out")
    return plant, PLAIN_BELIEF


def _followed(reference_: str | None, inject: str | None) -> Excitation:
    """The reference, or the test signal."""
    if reference_ is not None and inject is not None:
        raise InputError("--inject holds the position that its bias says; leave --reference out")
    spec, option = (reference_ or _REFERENCE, "--reference") if inject is None else (inject, "--inject")
    found = load_excitations(spec, unit="m")
    if len(found) != 1:
        raise InputError(f"{option} names {len(found)} excitations; give one")
    return found[0]


@dataclass(frozen=True)
class _Draws:
    """How plants beside the believed one are drawn, and what they have beside their tolerances."""

    draw: DrawPlant
    suspects: tuple[str, ...]


def _draws(plant: PlantUnderTest, told: Told | None) -> _Draws:
    """Plants within the tolerances, with the suspects; after a diagnosis those that it leaves possible."""
    if told is None:
        return _Draws(lambda generator: suspected_plant(plant, generator), SUSPECTS)
    fitted = PlantUnderTest(told.model.actuator, plant.table, _effects(told.model))
    posterior = told.posterior
    return _Draws(lambda generator: posterior.draw(fitted, generator), ())


def _on_others(controller: ControllerDesign, track: Reference, draws: _Draws, *, n: int) -> UnseenPlants | None:
    """The loop on plants that it was not designed for; None where there are none."""
    try:
        with progress_bar("unseen plants") as progress:
            return on_unseen_plants(controller, track, draws.draw, n=n, suspects=draws.suspects, progress=progress)
    except InputError as err:
        say(f"note: the loop is judged on no plants beside the believed one: {err}")
        return None


def _effects(model: ExtendedModel) -> EffectValues | None:
    return model.effects if model.effects.stated else None
