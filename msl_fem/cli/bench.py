"""The command `bench`: a simulated record with something hidden in it, and the answer apart from it."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from msl_fem.actuator import Actuator, load_actuator
from msl_fem.bench import BenchOptions, ClosedLoop, parse_nuisances, parse_requests, sealed_record, usual_unit
from msl_fem.cli.options import ActuatorFile, Causes, Json, TableFile, read_option
from msl_fem.cli.output import print_result, progress_bar, write_json
from msl_fem.cli.simulate import usual_loop
from msl_fem.cli.stated_causes import read_causes
from msl_fem.cli.sweeping import table_for
from msl_fem.errors import InputError
from msl_fem.files.sole_run import sole_run
from msl_fem.files.whole_file import check_target
from msl_fem.plant.excitation import load_excitations
from msl_fem.plant.excitation_kinds import Excitation
from msl_fem.record import check_record_folder, write_record
from msl_fem.table.magnetic_table import MagneticTable

NOISES = ("coloured", "white", "none")


def command(
    actuator: ActuatorFile,
    output: Annotated[Path, typer.Option("-o", "--output", help="Record folder to write; must not be there.")],
    seed: Annotated[int, typer.Option(min=0, help="Seed of true parameters, noise, and the effect's own chance.")],
    excitation: Annotated[
        list[str] | None,
        typer.Option(help='Repeatable: like "multisine:...", or a TOML file with several; without, noise and a sweep.'),
    ] = None,
    hide: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=3%", help="Up to three: an effect and its size; none; outside[:NAME][=3%]; expression:NAME."
        ),
    ] = None,
    answer: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Sealed answer (JSON); without, beside the record folder.")
    ] = None,
    table: TableFile = None,
    rate: Annotated[str, typer.Option(help="Sampling rate of the record.")] = "10 kHz",
    static: Annotated[bool, typer.Option("--static", help="Add a quasi-static map of one magnet.")] = False,
    exact_size: Annotated[
        bool,
        typer.Option("--exact-size", help="Sizes as asked, even below six tolerances of a believed parameter."),
    ] = False,
    noise: Annotated[str, typer.Option(help="coloured, white or none.")] = "coloured",
    nuisance: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=SIZE", help="Repeatable: what instruments do, in tolerances, like all=1."),
    ] = None,
    stated_noise: Annotated[float, typer.Option(help="Noise that rig.toml states, over the true one.")] = 1.0,
    stated_hold: Annotated[str, typer.Option(help="How rig.toml says that inputs run: zero-order or linear.")] = (
        "zero-order"
    ),
    stated_bandwidth: Annotated[
        str | None, typer.Option(help="Bandwidth of the drive that rig.toml states; without, the true one.")
    ] = None,
    effect: Causes = None,
    json: Json = False,
) -> None:
    """The virtual bench: a record of a rig with true parameters of its own, and an effect hidden in it.

    The bench's equations are finer than the coupled model's and not the same; what was hidden stands in the answer
    alone. Sizes are RMS changes of the record over the RMS of a channel, the largest over its channels.
    """
    it = load_actuator(actuator)
    causes = read_causes(effect)
    requests = parse_requests(hide or [], causes)
    hidden = {request.effect.name for request in requests if request.effect}
    for one in causes:
        if one.effect not in hidden:
            raise InputError(f"--effect {one.name}: is not hidden; add --hide {one.effect}=3%")
    if noise not in NOISES:
        raise InputError(f"--noise '{noise}' is unknown; choose one of {', '.join(NOISES)}")
    sampling = read_option("--rate", rate, "Hz")
    if not sampling > 0:
        raise InputError(f'--rate {rate} is not allowed; it must be above 0 Hz, like "10 kHz"')
    excitations = _excitations(it, excitation or [])
    nuisances = parse_nuisances(nuisance or [])
    if not 0.1 <= stated_noise <= 10:
        raise InputError(f"--stated-noise {stated_noise:g} is not allowed; it must be 0.1 ... 10")
    if stated_hold not in ("zero-order", "linear"):
        raise InputError(f"--stated-hold '{stated_hold}' is unknown; choose zero-order or linear")
    hold: Literal["zero-order", "linear"] = "linear" if stated_hold == "linear" else "zero-order"
    bandwidth = None
    if stated_bandwidth is not None:
        bandwidth = read_option("--stated-bandwidth", stated_bandwidth, "Hz")
        if not bandwidth > 0:
            raise InputError(f'--stated-bandwidth {stated_bandwidth} is not allowed; above 0 Hz, like "10 MHz"')
    with sole_run(output):
        sealed = _answer_file(output, answer)
        magnet_table = table_for(it, table)
        options = BenchOptions(
            seed=seed,
            rate=sampling,
            excitations=excitations,
            static=static,
            exact=exact_size,
            noise=noise,
            loop=_loop(it, magnet_table, excitations, rate=sampling),
            nuisances=nuisances,
            stated_noise=stated_noise,
            stated_hold=hold,
            stated_bandwidth=bandwidth,
        )
        with progress_bar("bench") as progress:
            made = sealed_record(it, magnet_table, requests, options, progress=progress)
        write_record(made.record, output)
        write_json(made.answer, sealed)
    runs = {run.name: {"role": run.role, "samples": run.time.size} for run in made.record.runs}
    fields = {"record": str(output), "answer": str(sealed), "runs": runs}
    print_result(fields, as_json=json, title=f"{it.name}: record {output}")


def _answer_file(output: Path, answer: Path | None) -> Path:
    """Where the answer goes; InputError where something stands in the way or it would lie in the record."""
    if output.is_symlink() or (output.exists() and (not output.is_dir() or any(output.iterdir()))):
        raise InputError(f"{output}: is there already; choose another folder, or remove it")
    check_record_folder(output)
    sealed = answer if answer is not None else output.absolute().with_name(f"{output.absolute().name}.answer.json")
    if sealed.resolve().is_relative_to(output.resolve()):
        raise InputError(f"--answer {sealed}: lies in the record's folder, where all can read it; choose another place")
    check_target(sealed)
    return sealed


def _loop(
    actuator: Actuator, table: MagneticTable | None, excitations: tuple[Excitation, ...], *, rate: float
) -> ClosedLoop | None:
    """The controller that is believed in, where an excitation asks for one, its references checked."""
    closed = [one for one in excitations if one.loop == "closed"]
    if not closed:
        return None
    loop = usual_loop(actuator, table)
    for one in closed:
        loop.reference(one, rate=rate)
    return ClosedLoop(loop.controller, loop.section)


def _excitations(actuator: Actuator, texts: list[str]) -> tuple[Excitation, ...]:
    """All excitations; of several of which none has a stated role, the last one is held out."""
    if not texts:
        return ()
    unit = usual_unit(actuator)
    found = [one for text in texts for one in load_excitations(text, unit=unit)]
    if len(found) > 1 and not any("role" in one.model_fields_set for one in found):
        found[-1] = found[-1].model_copy(update={"role": "held-out"})
    return tuple(found)
