"""The command `self-sensing`: how well a coil tells the gap, over the preferred region."""

from typing import Annotated

import numpy as np
import typer

from msl_fem.cli.believed import belief_fields, model_with_belief
from msl_fem.cli.given_map import given_map
from msl_fem.cli.options import ActuatorFile, BeliefName, Causes, Json, MapFile, TableFile, read_option
from msl_fem.cli.output import print_closing, print_columns, print_result, say
from msl_fem.cli.stated_causes import read_causes
from msl_fem.cli.sweeping import table_for
from msl_fem.control.self_sensing import WITHIN, Carrier, SelfSensing, self_sensing
from msl_fem.errors import InputError
from msl_fem.files.quantity import format_quantity
from msl_fem.maps import Guard, operating_map
from msl_fem.plant.effects import stated_causes
from msl_fem.plant.extended_model import load_extended_model

_TITLE = "least error of the gap/error of the observer in um, at shares of the guard's first current limit"


def command(
    actuator: ActuatorFile,
    table: TableFile = None,
    map_file: MapFile = None,
    amplitude: Annotated[
        str, typer.Option(help="Amplitude of the sine of voltage that is added to the coil's.")
    ] = "5 V",
    frequency: Annotated[str, typer.Option(help="Frequency of this sine.")] = "1 kHz",
    rate: Annotated[str, typer.Option(help="Readings of the current a second.")] = "50 kHz",
    window: Annotated[str, typer.Option(help="Time after which the estimate is judged.")] = "10 ms",
    voltage_noise: Annotated[str, typer.Option(help="One sigma, of what is known of a sample's voltage.")] = "50 mV",
    gap_spread: Annotated[str, typer.Option(help="One sigma of what is known of the gap before.")] = "50 um",
    runs: Annotated[int, typer.Option(min=2, max=1000, help="Runs at each of 36 points.")] = 20,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the noise.")] = 1,
    effect: Causes = None,
    belief: BeliefName = None,
    json: Json = False,
) -> None:
    """How well the coil of side 1 tells its gap, by an observer on the table, beside the least possible error.

    The mover is held at points of the preferred region. The plant is as the drawing tells and has the causes of
    --effect beside; of all these the observer knows leakage inductance and depth alone, so what others do is seen.
    """
    carrier = Carrier(
        amplitude=read_option("--amplitude", amplitude, "V"),
        frequency=read_option("--frequency", frequency, "Hz"),
        rate=read_option("--rate", rate, "Hz"),
        window=read_option("--window", window, "s"),
        voltage_noise=read_option("--voltage-noise", voltage_noise, "V"),
        gap_spread=read_option("--gap-spread", gap_spread, "m"),
    )
    causes = read_causes(effect)
    model = load_extended_model(actuator)
    it = model.actuator
    if it.magnet is None:
        raise InputError(f"{it.name} has no [magnet]; self-sensing needs one")
    magnet_table = table_for(it, table)
    assert magnet_table is not None
    plant, believed = model_with_belief(belief, model, magnet_table)
    guard = Guard(given_map(map_file, it) if map_file is not None else operating_map(magnet_table))
    effects = stated_causes(causes, plant.effects)
    found = self_sensing(
        it, magnet_table, guard, carrier=carrier, runs=runs, seed=seed, effects=effects, known=plant.effects
    )
    for note in found.notes:
        say(f"note: {note}")
    if json:
        print_result(found.to_json() | belief_fields(believed, as_json=True), as_json=True, title="")
        return
    print_columns(_table(found), title=f"{it.name}: {_TITLE}")
    print_closing(_closing(found), as_json=False)


def _table(found: SelfSensing) -> dict[str, list[str]]:
    """A row a gap; a column for each share of the current up to the guard's first limit."""
    columns = {"gap": [f"{g * 1e3:.3g} mm" for g in found.gap]}
    for m, share in enumerate(found.current[0] / found.current[0, -1]):
        both = zip(found.bound[:, m] * 1e6, found.error[:, m] * 1e6, strict=True)
        columns[f"{100 * share:.0f} %"] = [f"{one:.1f}/{other:.1f}" for one, other in both]
    return columns


def _closing(found: SelfSensing) -> tuple[str, str, str]:
    """How much of the region is sensed, how sure that is, and the way on."""
    typical = format_quantity(float(np.median(found.error)), "m", digits=3)
    if found.share >= 0.6:
        way = "take the observer (control.position_observer) as a second sensor, off where the error is large"
    else:
        way = "state what the observer lacks, raise the amplitude or the window, or keep the position sensor"
    return (
        f"What it means: over {100 * found.share:.0f} % of the preferred region the gap is told within {WITHIN:g} "
        f"times the least possible error; the error is {typical} in the middle of all points.",
        f"How sure: {found.runs} runs at {found.bound.size} points, all simulated; a held mover.",
        f"What to do: {way}.",
    )
