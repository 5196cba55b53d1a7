"""The variables of the exported FMU: one list from which the model description and the C source are written."""

import math
from dataclasses import dataclass
from typing import Literal

from msl_fem.computing.laws.units import BASES, parse_unit
from msl_fem.plant import PlantParameters
from msl_fem.plant.effects import CATALOGUE, LAGGING, PARAMETER_INDEX, EffectValues
from msl_fem.plant.effects.expressions import DECLARED
from msl_fem.plant.plant import CURRENT_DRIVE, FORCE_DRIVE, VOLTAGE_DRIVE

Causality = Literal["parameter", "input", "output"]
REAL, INTEGER, BOOLEAN = "Real", "Integer", "Boolean"
COMMAND_UNIT = {CURRENT_DRIVE: "A", VOLTAGE_DRIVE: "V", FORCE_DRIVE: "N"}


@dataclass(frozen=True)
class Variable:
    """One variable.

    Attributes
    ----------
    name : in the model description; the C source knows it as V_ and the name in capitals
    causality : what it is to the model's user
    unit : one of `UNITS`, or empty for a number
    start : None for outputs
    said : description
    kind : REAL, INTEGER or BOOLEAN
    """

    name: str
    causality: Causality
    unit: str
    start: float | bool | None
    said: str
    kind: str = REAL

    @property
    def variability(self) -> str:
        """What the standard calls it: inputs are held over a step, counts change at its end."""
        if self.causality == "parameter":
            return "fixed"
        return "continuous" if self.kind == REAL else "discrete"


UNITS: dict[str, dict[str, int]] = {
    "s": {"s": 1},
    "Hz": {"s": -1},
    "kg": {"kg": 1},
    "m": {"m": 1},
    "m/s": {"m": 1, "s": -1},
    "N": {"kg": 1, "m": 1, "s": -2},
    "N/m": {"kg": 1, "s": -2},
    "N.s/m": {"kg": 1, "s": -1},
    "A": {"A": 1},
    "V": {"kg": 1, "m": 2, "s": -3, "A": -1},
    "Ohm": {"kg": 1, "m": 2, "s": -3, "A": -2},
    "Wb": {"kg": 1, "m": 2, "s": -2, "A": -1},
    "J": {"kg": 1, "m": 2, "s": -2},
    "1/A2": {"A": -2},
    "1/J": {"kg": -1, "m": -2, "s": 2},
    "N/m2": {"kg": 1, "m": -1, "s": -2},
    "N/m3": {"kg": 1, "m": -2, "s": -2},
    "m/N": {"kg": -1, "s": 2},
    "m/A": {"m": 1, "A": -1},
    "m/s2": {"m": 1, "s": -2},
    "m/s3": {"m": 1, "s": -3},
    "1/m": {"m": -1},
    "1/m2": {"m": -2},
    "m2": {"m": 2},
    "1/s": {"s": -1},
}
"""Units by their exponents of SI's base units."""
_EFFECT_UNITS = {
    "A^-2": "1/A2", "J^-1": "1/J", "N s/m": "N.s/m", "N/m^2": "N/m2", "N/m^3": "N/m3", "m/s^2": "m/s2",
    "m/s^3": "m/s3", "m^-1": "1/m", "m^-2": "1/m2", "m^2": "m2", "s^-1": "1/s",
}  # fmt: skip


@dataclass(frozen=True)
class EffectVariable:
    """A parameter of an effect among the variables.

    Attributes
    ----------
    index : in the vector of all parameters
    low, high : what is allowed
    lags : it needs a drive whose current cannot jump
    """

    variable: Variable
    index: int
    low: float
    high: float
    lags: bool

    @property
    def name(self) -> str:
        return self.variable.name


def variables(
    plant: PlantParameters, *, largest_step: float, effects: EffectValues | None = None
) -> tuple[Variable, ...]:
    """All variables for a plant, quantities of the sides in pairs, side 1 first; its own numbers are the start values.

    Where a parameter may be missing (a bandwidth, a limit), 0 stands for none. With `effects` the parameters of all
    effects that the plant can have are among them.
    """
    channels = channel_count(plant)
    known = [] if effects is None else [v.variable for v in effect_variables(plant, effects)]
    outputs = _outputs(plant, channels, with_effects=effects is not None)
    return (*_parameters(plant, largest_step), *known, *_starts(plant), *_inputs(plant, channels), *outputs)


def effect_variables(plant: PlantParameters, effects: EffectValues) -> list[EffectVariable]:
    """The parameters of all effects that a plant of that build can have, `effects` their start values."""
    has = {"magnets": plant.sides > 0, "two sides": plant.sides == 2, "drive lag": True}
    own = {one.effect for one in DECLARED.values()}
    found = []
    for n, (name, parameter_name) in enumerate(PARAMETER_INDEX):
        effect = CATALOGUE[name]
        if not all(has[need] for need in effect.needs):
            continue
        parameter = effect.parameter(parameter_name)
        unit = _EFFECT_UNITS.get(parameter.unit, parameter.unit)
        if name in own:
            unit = unit_of_law(parameter.unit)
        value = effects.get(name, parameter_name)
        said = f"{effect.sentence}: {parameter.meaning}".replace('"', "'")
        variable = Variable(f"{name}_{parameter_name}".replace(":", "_"), "parameter", unit, value, said)
        lags = not parameter.shape and ("drive lag" in effect.needs or (name, parameter_name) in LAGGING)
        found.append(EffectVariable(variable, n, *parameter.allowed, lags))
    return found


def unit_of_law(text: str) -> str:
    """A unit of a user's law as FMI may name it: one of `UNITS` of its dimension, else its base units by dots."""
    exponents = unit_exponents(text)
    known = [name for name, own in UNITS.items() if own == exponents]
    return known[0] if known else ".".join(f"{base}{power}" for base, power in exponents.items())


def unit_exponents(text: str) -> dict[str, int]:
    """Exponents of SI's base units; of a name that `unit_of_law` made too."""
    dimension = parse_unit(text.replace(".", " ")).dimension
    return {base: int(power) for base, power in zip(BASES, dimension.exponents, strict=True) if power}


def channel_count(plant: PlantParameters) -> int:
    """How many commands the drive takes."""
    return 1 if plant.drive == FORCE_DRIVE else plant.sides


def _parameters(plant: PlantParameters, largest_step: float) -> list[Variable]:
    def parameter(name: str, unit: str, start: float, said: str) -> Variable:
        return Variable(name, "parameter", unit, start if math.isfinite(start) else 0.0, said)

    end_stop = plant.end_stop
    hertz = 2 * math.pi
    found = [
        parameter("moving_mass", "kg", plant.mass, "moving mass"),
        parameter("stiffness", "N/m", plant.stiffness, "stiffness of the suspension"),
        parameter("damping", "N.s/m", plant.damping, "damping of the suspension"),
        parameter("constant_force", "N", plant.constant_force, "constant force along +x"),
        parameter("travel", "m", plant.travel, "travel to either side; 0: none is given"),
        parameter(
            "end_stop_restitution",
            "",
            end_stop.restitution if end_stop else 0.0,
            "velocity after an impact over that before",
        ),
        parameter("drive_bandwidth", "Hz", plant.bandwidth / hertz, "-3 dB bandwidth of the drive; 0: ideal"),
        parameter("position_sensor_bandwidth", "Hz", plant.sensor_bandwidth / hertz, "-3 dB; 0: ideal"),
        parameter("largest_step", "s", largest_step, "a communication step is cut into equal steps up to this one"),
        Variable(
            "end_stop",
            "parameter",
            "",
            end_stop is not None,
            "true: the mover is thrown back at its travel; false: leaving the travel is an error",
            BOOLEAN,
        ),
    ]
    if plant.sides:
        found += [
            parameter("nominal_gap", "m", plant.nominal_gap, "gap of the sides at x = 0"),
            parameter("resistance", "Ohm", plant.resistance, "resistance of a side, all its magnets together"),
            parameter("voltage_limit", "V", plant.voltage_limit, "of a side; 0: none"),
            parameter("current_limit", "A", plant.current_limit, "of a side; 0: none"),
        ]
    return found


def _starts(plant: PlantParameters) -> list[Variable]:
    found = [
        Variable("position_start", "parameter", "m", 0.0, "position at the start"),
        Variable("velocity_start", "parameter", "m/s", 0.0, "velocity at the start"),
    ]
    return found + [
        Variable(f"current_{j + 1}_start", "parameter", "A", 0.0, f"current of side {j + 1} at the start")
        for j in range(plant.sides)
    ]


def _inputs(plant: PlantParameters, channels: int) -> list[Variable]:
    unit = COMMAND_UNIT[plant.drive]
    what = {"A": "wanted current of side {}", "V": "wanted voltage of side {}", "N": "wanted force"}[unit]
    said = what + ", held over a communication step and clipped at the drive's limit as an amplifier does"
    found = [Variable(f"command_{j + 1}", "input", unit, 0.0, said.format(j + 1)) for j in range(channels)]
    return [*found, Variable("disturbance", "input", "N", 0.0, "force on the mass along +x, held over a step")]


def _outputs(plant: PlantParameters, channels: int, *, with_effects: bool) -> list[Variable]:
    def output(name: str, unit: str, said: str, kind: str = REAL) -> Variable:
        return Variable(name, "output", unit, None, said, kind)

    found = [
        output("position", "m", "position x of the mover, positive towards side 1"),
        output("velocity", "m/s", "velocity of the mover"),
        output("position_measured", "m", "position behind the sensor's bandwidth, before noise and resolution"),
    ]
    per_side = [
        ("current", "A", "current of side {}"),
        ("voltage", "V", "voltage of side {}, mean over the last communication step"),
        ("flux_linkage", "Wb", "flux linkage of side {}"),
        ("force", "N", "force of side {}'s magnets on the mover, attractive positive"),
        ("gap", "m", "gap of side {}"),
    ]
    if with_effects:
        per_side.append(("current_measured", "A", "current of side {} as its sensor gives it, before noise"))
    for name, unit, said in per_side:
        found += [output(f"{name}_{j + 1}", unit, said.format(j + 1)) for j in range(plant.sides)]
    if plant.drive == FORCE_DRIVE:
        found.append(output("drive_force", "N", "force of the drive, mean over the last communication step"))
    found += [
        output("energy_electrical", "J", "electrical input since the start"),
        output("energy_copper", "J", "copper loss since the start"),
        output("energy_damping", "J", "loss in the damping since the start"),
        output("energy_external", "J", "work of disturbance, constant force and force drive since the start"),
        output("energy_impact", "J", "loss at the end stops since the start"),
    ]
    found.append(output("steps_done", "", "communication steps since the start", INTEGER))
    counts = [("current", "side {}'s current limit"), ("voltage", "side {}'s voltage limit")]
    for name, said in counts:
        found += [
            output(
                f"steps_at_{name}_limit_{j + 1}",
                "",
                f"communication steps that met {said.format(j + 1)}",
                INTEGER,
            )
            for j in range(plant.sides)
        ]
    return found
