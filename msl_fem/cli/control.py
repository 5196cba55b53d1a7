"""The command `control`: designs the guarded controller and runs it."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from msl_fem.actuator import Actuator
from msl_fem.cli.believed import belief_fields, model_with_belief, stated_belief
from msl_fem.cli.closing import control_closing
from msl_fem.cli.controller_maps import Maps, maps_for
from msl_fem.cli.controllers import DesignOptions, design_of_model, model_of, with_asked_overlap
from msl_fem.cli.currents_commanded import currents_commanded
from msl_fem.cli.effects_told import effects_told
from msl_fem.cli.foretold import design_of_belief, improvement_on
from msl_fem.cli.learning import Draws, check_learning, learned_reference
from msl_fem.cli.options import (
    AUTO,
    Bandwidth,
    BeliefName,
    Bias,
    Causes,
    CurrentLoop,
    DesignName,
    DiagnosisFolder,
    Feedforward,
    GuardedAmbient,
    GuardedRise,
    Json,
    Known,
    MapFile,
    OverlapOrAuto,
    PeakSensitivity,
    Preview,
    TableFile,
    ThermalResistance,
)
from msl_fem.cli.output import print_closing, print_result, progress_bar, say
from msl_fem.cli.stated_causes import read_causes
from msl_fem.cli.sweeping import table_for, table_of_model
from msl_fem.cli.told import Told
from msl_fem.computing.arrays import Array
from msl_fem.computing.laws import LawExpression
from msl_fem.control import (
    ClosedLoopRun,
    ControllerDesign,
    PlantUnderTest,
    check_stable_reach,
    closed_loop_record,
    examine_design,
    run_closed_loop,
)
from msl_fem.control.asked_voltage import AskedVoltage
from msl_fem.control.injection import held_under_test
from msl_fem.control.spec_sheet import SpecSheet, spec_sheet
from msl_fem.control.stepper import stated
from msl_fem.control.unseen_plants import SUSPECTS, UnseenPlants, on_unseen_plants, suspected_plant
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
from msl_fem.record import Record, check_record_folder, write_record
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
    overlap: OverlapOrAuto = AUTO,
    temperature_rise: GuardedRise = None,
    ambient: GuardedAmbient = None,
    thermal_resistance: ThermalResistance = None,
    unseen: Annotated[
        int, typer.Option(min=0, metavar="N", help="Plants beside the believed one to judge the loop on; 0: none.")
    ] = 20,
    learn: Annotated[
        int, typer.Option(min=0, metavar="N", help="Trials in which a reference that repeats is learned; 0: none.")
    ] = 0,
    output: Annotated[Path | None, typer.Option("-o", "--output", help="Record folder of the run.")] = None,
    header: Annotated[
        Path | None, typer.Option("--c", metavar="FILE", help="The controller as C99 header, as 'export' writes it.")
    ] = None,
    report: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Page of the design's trials: the paper's figures, margins (HTML)."),
    ] = None,
    current_loop: CurrentLoop = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the sensors' noise.")] = 1,
    effect: Causes = None,
    belief: BeliefName = None,
    json: Json = False,
) -> None:
    """Design the guarded controller and run it.

    Controller and plant are as the drawing tells. An extended model as ACTUATOR is a plant whose effects the controller
    does not know; as --model, one that it knows.
    With --from the controller knows what a diagnosis says, a record is diagnosed first; it is judged on plants that the
    diagnosis leaves possible, beside the controller of the belief.
    About the amplifier of a voltage drive a current loop is taken (--current-loop).
    With --learn a reference that repeats is corrected from trial to trial; the table of it goes into the header.
    The plant has the causes of --effect beside. With --inject the run holds a position, and 'msl-fem loop' measures it.
    """
    options = DesignOptions(
        model, design, bandwidth, peak_sensitivity, feedforward, preview, bias, overlap, current_loop, temperature_rise,
        ambient, thermal_resistance,
    )  # fmt: skip
    options.thermal_limit()
    options.choice()  # a wrong unit is told before anything is computed
    if actuator is None and diagnosis is None:
        raise InputError("ACTUATOR is missing; give an actuator file, or --from a diagnosis or a record")
    for file in (report, header):
        if file is not None:
            check_target(file)
    told = options.told(diagnosis, table)
    plant = told.model if actuator is None and told is not None else load_extended_model(Path(str(actuator)))
    plant = currents_commanded(plant, current_loop)
    causes = read_causes(effect)
    wanted = _followed(reference_, inject)
    if lacking := plant.actuator.lacking("magnet", "controller"):
        raise InputError(f"{plant.actuator.name} has no {lacking}; control needs [magnet] and [controller]")
    with sole_run(output):
        if output is not None:
            check_record_folder(output)
        task = _task(wanted, plant.actuator, injected=inject is not None)
        if learn:
            check_learning(task.track, injected=inject is not None)
        loop = _designed(
            options, plant, told, task, files=(table, map_file), belief=belief, causes=causes, itself=actuator is None
        )
        check_stable_reach(loop.controller, task.track)
        run = run_closed_loop(
            loop.controller, task.track, plant=loop.acted_on, generator=np.random.default_rng(seed),
            injection=task.signal,
        )  # fmt: skip
        if output is not None:
            write_record(_record(loop, run, task, bandwidth=bandwidth, bias=bias), output)
        sheet = _sheet(loop, run, task, told, unseen=unseen, files=(table, map_file))
        fields = _fields(loop, run, sheet, as_json=json)
        learned = None
        if learn:
            draws = _draws(loop.acted_on, told)
            learned, fields["learning"] = learned_reference(
                loop.controller, task.track, loop.acted_on, draws, trials=learn, unseen=unseen, seed=seed
            )
        if header is not None:
            write_controller(ControllerSource(loop.controller, loop.maps.one_side, learned), header)
            fields |= {"c": str(header)}
        if report is not None:
            with progress_bar("trials") as progress:
                trials = examine_design(loop.controller, plant=loop.acted_on, seed=seed, progress=progress)
            write_page(control_page(trials, sheet), report)
            fields |= {"report": str(report)}
    title = f"{plant.actuator.name}: {loop.controller.kind} in closed loop on {wanted.spec}"
    print_result(fields, as_json=json, title=title)
    held = fields["loop"].get("held_share")
    print_closing(control_closing(run, loop.controller, asked=loop.asked, held_share=held), as_json=json)


@dataclass(frozen=True, eq=False)
class _Loop:
    """A designed controller by the options as its reference settled them, the maps it is guarded by, what the reference
    asks of the coils, and what it acts on.

    `own_table` says that what it knows brings a table of its own.
    """

    options: DesignOptions
    controller: ControllerDesign
    asked: AskedVoltage
    maps: Maps
    table: MagneticTable
    true: ExtendedModel
    believed: Belief
    own_table: bool

    @property
    def acted_on(self) -> PlantUnderTest:
        return PlantUnderTest(self.true.actuator, self.table, _effects(self.true))


def _designed(
    options: DesignOptions, plant: ExtendedModel, told: Told | None, task: "_Task", *,
    files: tuple[Path | None, Path | None], belief: str | None, causes: tuple[LawExpression, ...], itself: bool,
) -> _Loop:  # fmt: skip
    """The controller for what is known; `files` are table and map, `itself` says that no plant was named beside."""
    known = options.known() if told is None else told.model
    own = table_of_model(known.actuator, None) if isinstance(known, ExtendedModel) else None
    table = own if own is not None else table_for(plant.actuator, files[0])
    assert table is not None
    knows_all = isinstance(known, ExtendedModel) and (told is None or itself)
    plant, believed = _as_believed(belief, plant, table, itself=not knows_all)
    plant = replace(plant, effects=stated_causes(causes, plant.effects))
    maps = maps_for(plant.actuator, table, map_file=files[1], table_file=files[0])
    model = model_of(known, plant.actuator, table, maps, belief=believed)
    options, asked = with_asked_overlap(options, model, task.track)
    controller = design_of_model(options, model)
    true = known if knows_all and isinstance(known, ExtendedModel) else plant
    return _Loop(options, controller, asked, maps, table, true, believed, own is not None)


@dataclass(frozen=True, eq=False)
class _Task:
    """What a loop is to follow, and the test signal on its reading, (n_sample,) m, where there is one."""

    wanted: Excitation
    track: Reference
    signal: Array | None


def _task(wanted: Excitation, actuator: Actuator, *, injected: bool) -> _Task:
    """The reference at the loop's rate, or the position held under a test signal."""
    assert actuator.controller is not None
    rate = actuator.controller.rate
    held = held_under_test(wanted, rate=rate) if injected else None
    track = reference(wanted, rate=rate) if held is None else held.reference
    return _Task(wanted, track, None if held is None else held.signal)


def _record(loop: _Loop, run: ClosedLoopRun, task: _Task, **wishes: str | None) -> Record:
    """The run as a record that states its controller with the user's wishes."""
    section = stated(loop.controller, **{name: text for name, text in wishes.items() if text is not None})
    record = closed_loop_record(
        loop.true.actuator, run, excitation=task.wanted.spec, controller=section, injection=task.signal
    )
    return replace(record, belief=loop.believed.name)


def _sheet(
    loop: _Loop, run: ClosedLoopRun, task: _Task, told: Told | None, *, unseen: int,
    files: tuple[Path | None, Path | None],
) -> SpecSheet:  # fmt: skip
    """The loop's sheet: on its plant, on others, and after a diagnosis beside the controller of the belief."""
    draws = _draws(loop.acted_on, told)
    judged = unseen > 0 and task.signal is None
    others = _on_others(loop.controller, task.track, draws, n=unseen) if judged else None
    over = None
    if others is not None and told is not None:
        before = design_of_belief(loop.options, told, loop.table, own=loop.own_table, files=files)
        over = improvement_on(before, others, task.track, draws.draw)
    return spec_sheet(loop.controller, run=run, unseen=others, over_belief=over)


def _fields(loop: _Loop, run: ClosedLoopRun, sheet: SpecSheet, *, as_json: bool) -> dict[str, Any]:
    """What the command prints of a loop and its run."""
    promised = sheet.to_json()
    if not as_json:
        del promised["positions"]  # a row each: of a terminal they would take all
    fields = {"design": loop.controller.kind} | run.to_json() | loop.controller.to_json()
    fields |= {"asked_voltage": loop.asked.to_json()}
    fields |= {"effects": effects_told(loop.true.effects, as_json=as_json)}
    return fields | belief_fields(loop.believed, as_json=as_json) | {"loop": promised}


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


def _draws(plant: PlantUnderTest, told: Told | None) -> Draws:
    """Plants within the tolerances, with the suspects; after a diagnosis those that it leaves possible."""
    if told is None:
        return Draws(lambda generator: suspected_plant(plant, generator), SUSPECTS)
    fitted = PlantUnderTest(told.model.actuator, plant.table, _effects(told.model))
    posterior = told.posterior
    return Draws(lambda generator: posterior.draw(fitted, generator), ())


def _on_others(controller: ControllerDesign, track: Reference, draws: Draws, *, n: int) -> UnseenPlants | None:
    """The loop on plants that it was not designed for; None where there are none."""
    try:
        with progress_bar("unseen plants") as progress:
            return on_unseen_plants(controller, track, draws.draw, n=n, suspects=draws.suspects, progress=progress)
    except InputError as err:
        say(f"note: the loop is judged on no plants beside the believed one: {err}")
        return None


def _effects(model: ExtendedModel) -> EffectValues | None:
    return model.effects if model.effects.stated else None
