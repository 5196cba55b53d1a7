"""The command `experiments`: which causes instruments can tell apart, what to add, and the run that decides."""

from pathlib import Path
from typing import Annotated

import typer
from pydantic import BaseModel, Field, ValidationError

from msl_fem.actuator import Actuator, load_actuator
from msl_fem.cli.believed import stated_belief
from msl_fem.cli.options import Json, PlainBelief, TableFile, read_option
from msl_fem.cli.output import print_closing, print_columns, print_result, progress_bar
from msl_fem.cli.sweeping import table_for, table_of_model
from msl_fem.cli.told import DIAGNOSIS, told_by
from msl_fem.comparison.as_designed import as_designed
from msl_fem.diagnosis.planning.after import OpenQuestion, open_question
from msl_fem.diagnosis.planning.expected import USUAL, expected_causes
from msl_fem.diagnosis.planning.experiments import TIMES, USUAL_INSTRUMENTS, ExperimentPlan, RigToPlan
from msl_fem.errors import InputError
from msl_fem.files.schema import first_complaint, small_text
from msl_fem.plant.believed import AS_DESIGNED, PLAIN_BELIEF
from msl_fem.plant.excitation import DRIVE_UNIT, parse_excitation
from msl_fem.plant.excitation_kinds import Excitation
from msl_fem.prediction import ModelHypothesis
from msl_fem.record import Tolerance

SHOWN = 5  # runs of the menu
RATE = 10e3  # Hz, where nothing states one
FASTEST = 1e8  # Hz, of a record
LONGEST = 1_000_000  # samples of a usual run: a diagnosis states one of 0.4 s


class _Cause(BaseModel):
    effect: str
    indistinguishable_from: list[str] = []


class _Compared(BaseModel):
    channel: str = ""


class _UsualRun(BaseModel):
    excitation: str
    rate: Annotated[float, Field(gt=0, le=FASTEST, allow_inf_nan=False)]


class Said(BaseModel):
    """What a diagnosis.json says that a plan needs."""

    causes: list[_Cause] = []
    accuracy: list[_Compared] = []
    usual_run: _UsualRun | None = None


def command(
    source: Annotated[
        Path,
        typer.Argument(metavar="ACTUATOR|DIAGNOSIS", help="Actuator file, or folder of 'diagnose -o'."),
    ],
    suspects: Annotated[
        str | None, typer.Option(metavar="A,B,...", help="Causes by name; without, the drawn and the tolerated ones.")
    ] = None,
    instruments: Annotated[
        str | None,
        typer.Option(
            help="Instruments at hand, some of position, current, voltage, gauge-block, scales, ohmmeter, load-cell."
        ),
    ] = None,
    table: TableFile = None,
    rate: Annotated[
        str | None, typer.Option(help="Sampling rate of the runs.", show_default="10 kHz, or the diagnosed record's")
    ] = None,
    belief: PlainBelief = "plain",
    json: Json = False,
) -> None:
    """Which causes these instruments can tell apart, which instrument to add, and the run that decides.

    After a diagnosis the causes are what it named and what it could not tell from that, at the fitted size.
    """
    sampling = None if rate is None else read_option("--rate", rate, "Hz")
    if sampling is not None and not sampling > 0:
        raise InputError(f'--rate {rate} is not allowed; it must be above 0 Hz, like "10 kHz"')
    known = stated_belief(belief) == AS_DESIGNED
    of_folder = source.is_dir() or source.name == DIAGNOSIS
    question = (
        question_after(source, table, sampling) if of_folder else _before(source, table, sampling or RATE, known=known)
    )
    names = question.asked if suspects is None else tuple(name.strip() for name in suspects.split(","))
    if wrong := [name for name in names if name not in question.possible]:
        raise InputError(f"--suspects: '{wrong[0]}' is no cause here; there are {', '.join(question.possible)}")
    if len(set(names)) < 2:
        raise InputError("one cause alone has nothing to be told from; name at least two with --suspects")
    with_these = () if instruments is None else tuple(name.strip() for name in instruments.split(","))
    with progress_bar("runs of the menu") as progress:
        plan = question.plan(names, with_these, progress=progress)
    if json:
        print_result(plan.to_json(), as_json=True, title="")
    else:
        print_plan(plan, question.rig.actuator.name)


def _before(source: Path, table: Path | None, rate: float, *, known: bool) -> OpenQuestion:
    """The question before anything is measured."""
    actuator = load_actuator(source)
    magnet_table = table_for(actuator, table)
    drawn = as_designed(actuator, magnet_table)
    model = ModelHypothesis.of(actuator, magnet_table, drawn if known else PLAIN_BELIEF)
    every = expected_causes(actuator, drawn, tolerance=Tolerance(), rate=rate, known=known)
    asked = tuple(one.effect for one in every if one.source != USUAL)
    return OpenQuestion(RigToPlan(model, rate), asked, {one.effect: one for one in every}, USUAL_INSTRUMENTS)


def question_after(folder: Path, table: Path | None, rate: float | None) -> OpenQuestion:
    """The question that a diagnosis leaves open: its first cause with rivals, about the model without it.

    Raises
    ------
    InputError : as `told_by`; no cause of the diagnosis has rivals
    """
    folder = folder.parent if folder.name == DIAGNOSIS else folder
    model = told_by(folder).model
    said = said_by(folder / DIAGNOSIS)
    named = [(one.effect, one.indistinguishable_from) for one in said.causes]
    channels = [one.channel for one in said.accuracy]
    magnet_table = table_of_model(model.actuator, None) or table_for(model.actuator, table)
    extended = ModelHypothesis(model.actuator, magnet_table, model.effects)
    sampling, usual = said_usual_run(said, model.actuator)
    question = open_question(
        extended, named, channels, tolerance=Tolerance(), rate=rate or sampling or RATE, usual=usual
    )
    if question is None:
        raise InputError(f"{folder}: no cause of its diagnosis has another one beside it; there is nothing to decide")
    return question


def said_by(file: Path) -> Said:
    """What a plan needs of a diagnosis.

    Raises
    ------
    InputError : an entry of the file is no such thing
    """
    try:
        return Said.model_validate_json(small_text(file))
    except ValidationError as err:
        raise InputError(f"{file}: {first_complaint(err)}; diagnose the record again") from err


def said_usual_run(said: Said, actuator: Actuator) -> tuple[float | None, Excitation | None]:
    """The rate and the usual run of the record, where its diagnosis says them.

    Raises
    ------
    InputError : it is no excitation, or one that takes too long to plan by
    """
    stated = said.usual_run
    if stated is None or actuator.drive is None:
        return None, None
    usual = parse_excitation(stated.excitation, unit=DRIVE_UNIT[actuator.drive.kind])
    if usual.duration * stated.rate > LONGEST:
        raise InputError(
            f"usual_run: {usual.duration * stated.rate:.0f} samples are too many to plan by; at most {LONGEST} are "
            "taken, diagnose the record again"
        )
    return stated.rate, usual


def print_plan(plan: ExperimentPlan, name: str) -> None:
    """The plan for people."""
    said = {", ".join(group).replace("_", " "): "told from all others" for group in plan.groups if len(group) == 1}
    said |= {", ".join(group).replace("_", " "): "not told apart" for group in plan.groups if len(group) > 1}
    said |= {cause.replace("_", " "): "not seen" for cause in plan.unseen}
    print_columns({"causes": list(said), "": list(said.values())}, title=f"{name}: {', '.join(plan.instruments)}")
    runs = plan.runs[:SHOWN]
    columns = {
        "run": [run.words for run in runs],
        "causes seen": [str(len(run.seen)) for run in runs],
        "pairs told apart": [f"{run.decided} of {run.decided + len(run.undecided)}" for run in runs],
    }
    print_columns(columns, title="Runs that decide, best first")
    print_closing(_closing(plan), as_json=False)


def _closing(plan: ExperimentPlan) -> tuple[str, str, str]:
    """What can be told, how sure, and what to do."""
    single = sum(len(group) == 1 for group in plan.groups)
    total = sum(map(len, plan.groups)) + len(plan.unseen)
    added = f"add {plan.instrument_to_add}: it tells {len(plan.helped)} more; " if plan.instrument_to_add else ""
    best = f'simulate --excitation "{plan.runs[0].excitation}"' if plan.runs else "no run of the menu is borne"
    locked = " --locked" if plan.runs and plan.runs[0].locked else ""
    left = " nor ".join(" from ".join(pair).replace("_", " ") for pair in plan.together)
    still = f"; no run at this size, made {TIMES} times, tells {left}" if left else ""
    return (
        f"What it means: the usual run tells {single} of {total} causes from all; {len(plan.unseen)} are not seen.",
        "How sure: a cause counts as told at a noncentrality that decides 95 of 100 records, at its expected size.",
        f"What to do: {added}{best}{locked}{still}.",
    )
