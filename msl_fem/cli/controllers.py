"""The options of a controller's design, for `control` and `export`, and the design that they ask for."""

from dataclasses import dataclass
from json import loads as parse_json
from pathlib import Path
from typing import Annotated

import typer

from msl_fem.actuator import Actuator
from msl_fem.cli.options import read_option
from msl_fem.control import (
    ControllerChoice,
    ControllerDesign,
    DesignModel,
    ForceTerm,
    IdentifiedPlant,
    design_model_of,
    design_model_of_terms,
    design_model_with_effects,
    designed,
)
from msl_fem.errors import InputError
from msl_fem.files.schema import reason, small_text
from msl_fem.identification import ArmaxModel, KnownMass, model_from_json, physical_parameters
from msl_fem.identification.data import rational_term
from msl_fem.maps import OperatingMap
from msl_fem.plant.extended_model import ExtendedModel, load_extended_model
from msl_fem.table.magnetic_table import MagneticTable

MapFile = Annotated[Path | None, typer.Option("--map", help="Operating map; without, from the table.")]
Known = Annotated[
    str, typer.Option("--model", help="What the controller knows: table, an identified model (JSON), an extended one.")
]
DesignName = Annotated[str, typer.Option("--design", help="lqr, robust, biased or pid.")]
Bandwidth = Annotated[str | None, typer.Option("--bandwidth", help="Of the feedback.")]
PeakSensitivity = Annotated[float | None, typer.Option("--peak-sensitivity", help="Bound on max |S|.")]
Feedforward = Annotated[
    bool, typer.Option("--feedforward/--no-feedforward", help="Two degrees of freedom, or the paper's integral alone.")
]
Preview = Annotated[
    bool, typer.Option("--preview/--no-preview", help="The reference is known ahead, or carried on from now.")
]
Bias = Annotated[str | None, typer.Option("--bias", help="Of the biased design, a side.")]
Overlap = Annotated[str, typer.Option("--overlap", help="Force with which both sides pull at zero force.")]


@dataclass(frozen=True)
class DesignOptions:
    """What the command line asks of a design, as it was written."""

    model: str = "table"
    design: str = "lqr"
    bandwidth: str | None = None
    peak_sensitivity: float | None = None
    feedforward: bool = True
    preview: bool = True
    bias: str | None = None
    overlap: str = "0 N"

    @property
    def stated(self) -> list[str]:
        """The options that differ from their defaults, as they are written."""
        usual = DesignOptions()
        names = [name for name in self.__dataclass_fields__ if getattr(self, name) != getattr(usual, name)]
        return [f"--{'no-' if getattr(self, name) is False else ''}{name.replace('_', '-')}" for name in names]

    def choice(self) -> ControllerChoice:
        """The choice in SI units; InputError for a wrong unit, with the option's name."""
        return ControllerChoice(
            kind=self.design,
            bandwidth=None if self.bandwidth is None else read_option("--bandwidth", self.bandwidth, "Hz"),
            peak_sensitivity=self.peak_sensitivity,
            feedforward=self.feedforward,
            overlap=read_option("--overlap", self.overlap, "N"),
            bias=None if self.bias is None else read_option("--bias", self.bias, "A"),
            preview=self.preview,
        )

    def known(self) -> ExtendedModel | ArmaxModel | None:
        """What `--model` tells the controller; None: table and actuator file."""
        return None if self.model == "table" else known_model(Path(self.model))


def design_of(
    options: DesignOptions, believed: ExtendedModel | ArmaxModel | None, actuator: Actuator, table: MagneticTable,
    regions: OperatingMap,
) -> ControllerDesign:  # fmt: skip
    """The design that options ask for, of what is believed (None: the actuator's file and the table)."""
    return designed(_design_model(actuator, believed, table, regions), options.choice())


def known_model(file: Path) -> ExtendedModel | ArmaxModel:
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
