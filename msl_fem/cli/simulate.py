"""The command `simulate`: the coupled model alone, written as a record; and the loop that its runs may be closed by."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from msl_fem.actuator import Actuator
from msl_fem.cli.believed import belief_fields, model_with_belief
from msl_fem.cli.effects_told import effects_told
from msl_fem.cli.given_map import given_map
from msl_fem.cli.options import BeliefName, Causes, Json, TableFile, read_option
from msl_fem.cli.output import print_result, progress_bar, say
from msl_fem.cli.stated_causes import read_causes
from msl_fem.cli.sweeping import table_for
from msl_fem.control import design_model_as_believed
from msl_fem.control.closed_loop import checked_reference
from msl_fem.control.design import ControllerDesign
from msl_fem.control.lqr_design import lqr_design
from msl_fem.control.stepper import Stepper, stated
from msl_fem.errors import InputError
from msl_fem.files.sole_run import sole_run
from msl_fem.maps import Guard, OperatingMap, operating_map
from msl_fem.plant import NamedRun, Simulation, refused_unless_borne, simulation_record
from msl_fem.plant.effects import EffectValues, stated_causes
from msl_fem.plant.excitation import DRIVE_UNIT, Reference, load_excitations, reference
from msl_fem.plant.excitation_kinds import Excitation
from msl_fem.plant.extended_model import ExtendedModel, load_extended_model
from msl_fem.plant.sampled_plant import clock_of, simulate_closed
from msl_fem.plant.simulate import Options
from msl_fem.record import check_record_folder, write_record
from msl_fem.table.magnetic_table import MagneticTable


@dataclass(frozen=True, eq=False)
class UsualLoop:
    """The controller of `control` with its default wishes, designed from what is believed.

    Attributes
    ----------
    section : what rig.toml states of it
    """

    design: ControllerDesign
    controller: Stepper
    section: dict[str, Any]

    def reference(self, excitation: Excitation, *, rate: float) -> Reference:
        """The reference of an excitation at `rate` (Hz), which the controller can follow.

        Raises
        ------
        InputError : rates that do not fit; positions or forces outside the believed domain
        """
        wanted = reference(excitation, rate=rate)
        every, _ = clock_of(self.controller, rate=rate)
        at = slice(None, None, every)
        checked_reference(
            self.design,
            Reference(wanted.time[at], wanted.position[at], wanted.velocity[at], wanted.acceleration[at]),
        )
        return wanted


def usual_loop(
    actuator: Actuator,
    table: MagneticTable | None,
    regions: OperatingMap | None = None,
    believed: EffectValues | None = None,
) -> UsualLoop:
    """The loop that runs excitations with `loop=closed`; `regions` is the guard's map where it is not the table's own,
    `believed` what the controller knows beside the table.

    Raises
    ------
    InputError : the actuator has no magnet, no controller, or a drive that takes forces
    """
    if table is None or actuator.controller is None:
        raise InputError(
            f"{actuator.name} has no [magnet] or no [controller]; loop=closed needs both, leave it out for open loop"
        )
    if actuator.drive is None or actuator.drive.kind == "force":
        raise InputError(f'{actuator.name}: loop=closed commands currents; use drive.kind = "current" or "voltage"')
    made = regions if regions is not None else operating_map(table)
    design = lqr_design(design_model_as_believed(actuator, table, made, believed))
    section = stated(design)
    if regions is not None:
        del section["design"]  # another map: not to be made again from the record alone
    return UsualLoop(design, Stepper(design), section)


def command(
    actuator: Annotated[Path, typer.Argument(metavar="ACTUATOR", help="Actuator file, or an extended model (TOML).")],
    excitation: Annotated[
        list[str], typer.Option(help='Repeatable: like "sine:channel=1,...", a CSV file, or a TOML file of several.')
    ],
    output: Annotated[Path, typer.Option("-o", "--output", help="Record folder to write.")],
    table: TableFile = None,
    map_file: Annotated[
        Path | None, typer.Option("--map", help="Operating map (JSON); a run that leaves it is refused.")
    ] = None,
    rate: Annotated[str, typer.Option(help="Sampling rate of the record.")] = "10 kHz",
    seed: Annotated[int, typer.Option(min=0, help="Seed of the sensors' noise.")] = 1,
    locked: Annotated[bool, typer.Option("--locked", help="Hold the mover where it starts.")] = False,
    position: Annotated[
        str, typer.Option(help='Where the mover starts, towards side 1, like "0.2 mm" or "-0.5 mm".')
    ] = "0 mm",
    effect: Causes = None,
    belief: BeliefName = None,
    json: Json = False,
) -> None:
    """The coupled model under an excitation, written as a record.

    Commands are in A, V or N, by the drive. With --locked the mover is held: a voltage step then shows R and L. Where
    the actuator file states motion.end_stop, the mover may be pulled in: the run goes on at the stop.
    """
    model = load_extended_model(actuator)
    causes = read_causes(effect)
    it = model.actuator
    if it.drive is None:
        raise InputError(f'{it.name} has no [drive]; add one with kind = "current", "voltage" or "force"')
    unit = DRIVE_UNIT[it.drive.kind]
    excitations = [one for text in excitation for one in load_excitations(text, unit=unit)]
    sampling = read_option("--rate", rate, "Hz")
    start = Options(position=read_option("--position", position, "m"), locked=locked)
    if not sampling > 0:
        raise InputError(f'--rate {rate} is not allowed; it must be above 0 Hz, like "10 kHz"')
    with sole_run(output):
        check_record_folder(output)
        regions = None if map_file is None else given_map(map_file, it)
        guard = None if regions is None else Guard(regions)
        magnet_table = table_for(it, table)
        model, believed = model_with_belief(belief, model, magnet_table)
        model = replace(model, effects=stated_causes(causes, model.effects))
        generator = np.random.default_rng(seed)
        closed = any(one.loop == "closed" for one in excitations)
        loop = usual_loop(it, magnet_table, regions, believed.effects) if closed else None
        runs: list[NamedRun] = []
        with progress_bar("runs") as progress:
            for n, one in enumerate(excitations):
                progress(n, len(excitations))
                name = one.name.replace("-", "_") + (f"_{n + 1}" if len(excitations) > 1 else "")
                if one.loop == "closed":
                    _refuse_beside_loop(start)
                    assert loop is not None
                    runs.append(
                        _closed_loop(model, magnet_table, one, name, rate=sampling, loop=loop, generator=generator)
                    )
                else:
                    run = refused_unless_borne(
                        it, magnet_table, one, rate=sampling, effects=model.effects if model.effects.stated else None,
                        guard=guard, generator=generator, options=start,
                    )  # fmt: skip
                    words = f"{one.spec}; mover locked at {position}" if locked else one.spec
                    runs.append(NamedRun(name, words, one.role, run, locked=locked))
            progress(len(excitations), len(excitations))
        record = simulation_record(it, runs, controller=None if loop is None else loop.section)
        write_record(replace(record, belief=believed.name), output)
    for made in runs:
        if met := int(made.simulation.samples_at_voltage_limit.max()):
            say(f"note: {made.name}: the voltage limit was met in {met} samples, as where a command jumps at the start")
    fields = {
        "record": str(output),
        "effects": effects_told(model.effects, as_json=json),
        "runs": {
            run.name: {
                "samples": run.simulation.time.size,
                "position_rms_m": float(np.std(run.simulation.position)),
                "position_peak_m": float(np.abs(run.simulation.position).max()),
                "samples_at_current_limit": run.simulation.samples_at_current_limit,
                "samples_at_voltage_limit": run.simulation.samples_at_voltage_limit,
            }
            | _at_the_stop(it, run.simulation)
            for run in runs
        },
    }
    fields |= belief_fields(believed, as_json=json)
    print_result(fields, as_json=json, title=f"{it.name}: record {output}")


def _refuse_beside_loop(start: Options) -> None:
    if start.locked or start.position:
        raise InputError("loop=closed starts at its reference, free to move; leave out --locked and --position")


def _at_the_stop(actuator: Actuator, run: Simulation) -> dict[str, Any]:
    """Of a run with end stops: when the mover first touched one, how fast it came (a sample before), what was lost."""
    stop = actuator.motion.end_stop if actuator.motion is not None else None
    if stop is None:
        return {}
    away = np.flatnonzero(np.abs(run.position) < stop * (1 - 1e-9))
    first = int(away[0]) if away.size else run.time.size
    touching = first + np.flatnonzero(np.abs(run.position[first:]) >= stop * (1 - 1e-9))
    if not touching.size:
        return {"first_contact_s": None, "contact_speed_m_per_s": None, "impact_loss_J": float(run.audit.impact)}
    k = int(touching[0])
    return {
        "first_contact_s": float(run.time[k]),
        "contact_speed_m_per_s": float(abs(run.velocity[k - 1])),
        "impact_loss_J": float(run.audit.impact),
    }


def _closed_loop(
    model: ExtendedModel,
    table: MagneticTable | None,
    excitation: Excitation,
    name: str,
    *,
    rate: float,
    loop: UsualLoop,
    generator: np.random.Generator,
) -> NamedRun:
    """A run whose controller knows nothing of the model's effects."""
    wanted = loop.reference(excitation, rate=rate)
    effects = model.effects if model.effects.stated else None
    run = simulate_closed(model.actuator, table, wanted, loop.controller, effects=effects, generator=generator)
    return NamedRun(name, excitation.spec, excitation.role, run, wanted.position)
