"""Arguments that several commands share, and how their texts become numbers."""

from pathlib import Path
from typing import Annotated

import typer

from msl_fem.errors import QuantityError
from msl_fem.files.quantity import parse_quantities

ActuatorFile = Annotated[
    Path, typer.Argument(metavar="ACTUATOR", help="Actuator file (TOML), or an example: fast_tool_servo.")
]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout.")]
AccuracyLevel = Annotated[str, typer.Option("--accuracy", help="How fine the field is solved: fast, normal or fine.")]
TableFile = Annotated[Path | None, typer.Option("--table", help="Table of the magnet; without, it is computed.")]
Current = Annotated[str, typer.Option("--current", help='Coil current, like "5 A".')]
Gap = Annotated[str, typer.Option("--gap", help='Air gap, like "0.5 mm".')]
TemperatureRise = Annotated[
    str, typer.Option("--temperature-rise", help="Temperature rise of the winding over ambient that is allowed.")
]
Ambient = Annotated[str, typer.Option("--ambient", help='Ambient temperature, like "20 degC".')]
HeatDuty = Annotated[float, typer.Option("--duty", help="Share of each period in which the current flows.")]
HeatPeriod = Annotated[
    str | None,
    typer.Option("--period", help='Period of the duty cycle, like "10 s"; without, short beside all time constants.'),
]
ThermalResistance = Annotated[
    str | None,
    typer.Option(
        "--thermal-resistance", help='Thermal resistance from winding to ambient, like "2 K/W"; without, estimated.'
    ),
]
IronFrequency = Annotated[
    str | None, typer.Option("--frequency", help="Frequency of a sine whose iron loss counts in the thermal limit.")
]
Causes = Annotated[
    list[str] | None,
    typer.Option(
        "--effect",
        metavar="CAUSE",
        help='Repeatable: a law like "drag: force = -a*v*abs(v); a: 0..1 N s2/m2", a TOML file, an entry point.',
    ),
]
MapFile = Annotated[
    Path | None, typer.Option("--map", help="Operating map, of a magnet or a pair; without, from the table.")
]
Known = Annotated[
    str, typer.Option("--model", help="What the controller knows: table, an identified model (JSON), an extended one.")
]
DiagnosisFolder = Annotated[
    Path | None,
    typer.Option("--from", metavar="DIAGNOSIS|RECORD", help="Design on what a diagnosis says; a record is diagnosed."),
]
DesignName = Annotated[
    str, typer.Option("--design", help="Kind of controller: lqr, robust, scheduled, scheduled-rigid, biased or pid.")
]
Bandwidth = Annotated[
    str | None,
    typer.Option("--bandwidth", help='Bandwidth of the feedback, like "40 Hz"; without, one that suits the rig.'),
]
PeakSensitivity = Annotated[
    float | None, typer.Option("--peak-sensitivity", help="Bound on the peak of the sensitivity, max |S|, like 2.")
]
Feedforward = Annotated[
    bool,
    typer.Option(
        "--feedforward/--no-feedforward",
        help="Feedforward of the reference (two degrees of freedom), or the paper's integral action alone.",
    ),
]
Preview = Annotated[
    bool, typer.Option("--preview/--no-preview", help="The reference is known ahead of time, or only up to now.")
]
Bias = Annotated[str | None, typer.Option("--bias", help='Bias current of each side in the biased design, like "2 A".')]
GuardedRise = Annotated[
    str | None,
    typer.Option(
        "--temperature-rise", help='Temperature rise of the windings over ambient that the guard allows, like "80 K".'
    ),
]
GuardedAmbient = Annotated[
    str | None, typer.Option("--ambient", help='Ambient temperature that the guard believes, like "20 degC".')
]
Overlap = Annotated[str, typer.Option("--overlap", help="Force with which both sides pull at zero force.")]
OverlapOrAuto = Annotated[
    str,
    typer.Option(
        "--overlap",
        help="Force with which both sides pull at zero force; auto: what keeps the reference within the voltage limit.",
    ),
]
AUTO = "auto"
CurrentLoop = Annotated[
    str | None,
    typer.Option(help="Bandwidth of the current loop around a voltage drive; without, the most that there is."),
]
BeliefName = Annotated[
    str | None,
    typer.Option(
        "--belief", help="What is believed: as-designed: also what the drawing tells (usual); plain: the table alone."
    ),
]
PlainBelief = Annotated[
    str,
    typer.Option(
        "--belief", help="What is believed: plain: the table alone; as-designed: also what the drawing tells."
    ),
]
SectionEnds = Annotated[
    str | None,
    typer.Option(
        "--end-effects",
        metavar="none|section",
        help="Correct sections for the flux at the stack's ends; by default, where the kind has such ends and the file "
        "does not say none.",
    ),
]
DEFAULT_RISE, DEFAULT_AMBIENT = "80 K", "20 degC"
"""Of the thermal limit of `losses` and `map`, as they are written."""


def read_option(name: str, text: str, unit: str) -> float:
    """The SI value of an option's text; the error names the option."""
    return read_options(name, text, unit)[0] if "," not in text else _refuse_list(name, text)


def read_options(name: str, text: str, unit: str) -> list[float]:
    """The SI values of an option's list; the error names the option."""
    try:
        return parse_quantities(text, unit)
    except QuantityError as err:
        raise QuantityError(f"{name}: {err}") from err


def _refuse_list(name: str, text: str) -> float:
    raise QuantityError(f"{name}: {text!r} is a list; give one value")
