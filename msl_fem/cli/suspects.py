"""The command `suspects`: which causes are likely before anything is measured, and what each would do."""

from collections.abc import Sequence
from typing import Annotated

import typer

from msl_fem.actuator import load_actuator
from msl_fem.cli.believed import stated_belief
from msl_fem.cli.options import ActuatorFile, Json, PlainBelief, TableFile, read_option
from msl_fem.cli.output import print_closing, print_columns, print_result, progress_bar, say
from msl_fem.cli.sweeping import table_for
from msl_fem.diagnosis.planning.ranking import Suspect, SuspectRanking, SuspectSettings, suspects
from msl_fem.errors import InputError
from msl_fem.files.quantity import format_quantity
from msl_fem.plant.believed import AS_DESIGNED
from msl_fem.plant.excitation import DRIVE_UNIT, load_excitations
from msl_fem.report.diagnosis_words import channel_name


def command(
    actuator: ActuatorFile,
    table: TableFile = None,
    excitation: Annotated[
        list[str] | None,
        typer.Option(help="Repeatable: runs to judge by; without, noise and a swept sine."),
    ] = None,
    rate: Annotated[str, typer.Option(help="Sampling rate of the runs.")] = "10 kHz",
    belief: PlainBelief = "plain",
    json: Json = False,
) -> None:
    """Which causes are likely before anything is measured, ranked by what each changes in a free run.

    Sizes are what the drawing tells, what the tolerances and the iron's data leave open, or what is usual. Of each
    change it says what a re-fit of the believed parameters and an ARMAX make up for, and which instrument shows the
    rest.
    """
    it = load_actuator(actuator)
    known = stated_belief(belief) == AS_DESIGNED
    if it.drive is None:
        raise InputError(f'{it.name} has no [drive]; add one with kind = "current", "voltage" or "force"')
    unit = DRIVE_UNIT[it.drive.kind]
    given = tuple(one for text in excitation or () for one in load_excitations(text, unit=unit))
    sampling = read_option("--rate", rate, "Hz")
    if not sampling > 0:
        raise InputError(f'--rate {rate} is not allowed; it must be above 0 Hz, like "10 kHz"')
    settings = SuspectSettings(known, given, sampling)
    magnet_table = table_for(it, table)
    with progress_bar("causes") as progress:
        found = suspects(it, magnet_table, settings, progress=progress)
    for reason in found.left_out:
        say(f"note: left out: {reason}")
    if json:
        print_result(found.to_json(), as_json=True, title="")
        return
    print_ranking(found, it.name)


def print_ranking(found: SuspectRanking, name: str) -> None:
    """The ranking for people."""
    rows = found.suspects
    columns = {
        "cause": [one.cause.effect.replace("_", " ") for one in rows],
        "size": [_size(one) for one in rows],
        "changes": [_percent(one.change) for one in rows],
        "in": [channel_name(one.channel) for one in rows],
        "re-fit takes": [_percent(one.absorbed_by_refit) for one in rows],
        "ARMAX takes": [_percent(one.absorbed_by_armax) for one in rows],
        "shown by": [one.shown_by for one in rows],
    }
    print_columns(columns, title=f"{name}: causes by what they change")
    for excitation in found.excitations:
        say(f"judged by {excitation}")
    print_closing(_closing(found), as_json=False)


def _closing(found: SuspectRanking) -> tuple[str, str, str]:
    """The first suspects, how sure their sizes are, and what to do about them."""
    likely = [one for one in found.suspects if one.noncentrality >= 1.0][:3]
    names = ", ".join(f"{one.cause.effect.replace('_', ' ')} ({_percent(one.change)})" for one in likely)
    return (
        f"What it means: a free run is changed most by {names or 'nothing that an instrument shows'}.",
        f"How sure: {_sources(likely)}a change goes with its size as long as it is small.",
        "What to do: measure what the last column says, or mend the cause; msl-fem diagnose names what a record shows.",
    )


def _sources(likely: Sequence[Suspect]) -> str:
    """Where the sizes of these suspects come from; those of one source together."""
    by_source: dict[str, list[str]] = {}
    for one in likely:
        by_source.setdefault(one.cause.source, []).append(one.cause.effect.replace("_", " "))
    return "".join(f"size of {' and '.join(names)}: {source}; " for source, names in by_source.items())


def _size(one: Suspect) -> str:
    cause = one.cause
    text = format_quantity(cause.size, cause.unit, digits=3) if cause.unit else f"{cause.size:.2g}"
    return f"{cause.leading.replace('_', ' ')} {text}"


def _percent(share: float | None) -> str:
    """A share for people; "-" where there is none."""
    if share is None:
        return "-"
    return f"{100 * share:.0f} %" if share > 0.0995 else f"{100 * share:.2g} %"
