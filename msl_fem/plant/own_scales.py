"""How large effects can be: multiples of the plant's own gap, travel, mass, force, current and sampling period.

The catalogue states bounds and usual scales of the reference servo; those of another plant go with the powers of its
quantities over the servo's: a magnet of 16 mm has offsets of millimetres, a voice coil friction of millinewtons.
"""

import math

from msl_fem.plant.effects.entry import Parameter, Quantity
from msl_fem.plant.plant import PlantParameters

GRAVITY = 9.81  # m/s^2
REFERENCE: dict[Quantity, float] = {
    "gap": 0.6e-3, "travel": 0.5e-3, "mass": 0.9, "force": 70.0, "current": 12.0, "period": 1e-4,
}  # fmt: skip
"""Of the reference servo (geometries/fast_tool_servo.toml) at 10 kHz, in SI units."""


def own_quantities(plant: PlantParameters, *, rate: float | None = None) -> dict[Quantity, float]:
    """A plant's quantities in SI units; where it states none (no gap, no limit of the current), the reference's.

    The force is that of the spring at the end of the travel, or the weight where that is more.
    """
    stated: dict[Quantity, float] = {
        "gap": plant.nominal_gap,
        "travel": plant.travel,
        "mass": plant.mass,
        "current": plant.current_limit,
        "period": 1.0 / rate if rate else math.inf,
    }
    known = {name: value if 0 < value < math.inf else REFERENCE[name] for name, value in stated.items()}
    return known | {"force": max(plant.stiffness * known["travel"], known["mass"] * GRAVITY)}


def over_reference(parameter: Parameter, quantities: dict[Quantity, float]) -> float:
    """A parameter's scale and bounds on a plant of these quantities, over those of the reference servo."""
    return math.prod((quantities[name] / REFERENCE[name]) ** power for name, power in parameter.of)
