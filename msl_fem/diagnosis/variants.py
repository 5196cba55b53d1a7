"""The ways in which each effect of the catalogue can act: which of its parameters, around which shapes.

An effect with many parameters is tried with few of them at a time: each that is not needed would cost evidence. A shape
(a frequency, a time constant) starts at each point of a grid and is free from there.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from msl_fem.diagnosis.unknowns import EffectUnknown
from msl_fem.plant.effects import CATALOGUE, LAGGING, Parameter
from msl_fem.plant.plant import FORCE_DRIVE, PlantParameters, drive_lags

Array = NDArray[np.float64]

MOST_LINES = 3  # of a residual's spectrum that are tried as frequencies of a disturbance
MAINS = (50.0, 60.0)


@dataclass(frozen=True)
class Variant:
    """Parameters of one effect that are searched together: amounts, then shapes with their centres."""

    effect: str
    amounts: tuple[EffectUnknown, ...]
    shapes: tuple[EffectUnknown, ...] = ()

    @property
    def unknowns(self) -> tuple[EffectUnknown, ...]:
        return (*self.amounts, *self.shapes)

    @property
    def name(self) -> str:
        shapes = ", ".join(f"{s.name} near {s.centre:.3g}" for s in self.shapes)
        return f"{self.effect} ({', '.join(a.name for a in self.amounts)}{'; ' + shapes if shapes else ''})"


@dataclass(frozen=True)
class Scene:
    """What the grids of shapes need to know of a record: usual sizes and its own frequencies.

    Attributes
    ----------
    position, current, velocity : RMS of what varies, m, A, m/s
    own_frequency : Hz, of the mover on its spring, or where its spectrum is highest
    lines : Hz, the highest lines of the residual
    """

    position: float
    current: float
    velocity: float
    own_frequency: float
    lines: tuple[float, ...] = ()


def possible(plant: PlantParameters) -> tuple[str, ...]:
    """The effects that a plant can have at all."""
    has = {"magnets": plant.sides > 0, "two sides": plant.sides == 2, "drive lag": drive_lags(plant)}
    left = set() if plant.drive != FORCE_DRIVE or drive_lags(plant) else {"amplifier_bandwidth"}
    return tuple(e.name for e in CATALOGUE.values() if all(has[need] for need in e.needs) and e.name not in left)


def variants(effect: str, scene: Scene, plant: PlantParameters) -> list[Variant]:
    """All variants of an effect for a record."""
    entry = CATALOGUE[effect]
    sets = [s for s in entry.sets or (entry.amounts,) if _there(effect, s, plant)]
    shapes = [p for p in entry.parameters if p.shape]
    found = []
    for chosen in sets:
        own = [p for p in shapes if not p.belongs_to or p.belongs_to in chosen]
        for centres in product(*(_centres(p, scene) for p in own)):
            made = tuple(EffectUnknown(effect, p.name, c, p.width) for p, c in zip(own, centres, strict=True))
            found.append(Variant(effect, tuple(EffectUnknown(effect, name) for name in chosen), made))
    plain = [Variant(effect, (EffectUnknown(effect, p.name),)) for p in entry.parameters if p.alone]
    return found + plain


def _there(effect: str, names: Sequence[str], plant: PlantParameters) -> bool:
    """Whether a plant has what the parameters are about."""
    if any(name.endswith("_2") for name in names) and plant.sides < 2:
        return False
    if plant.sides == 0 and any(name.startswith("current") for name in names):
        return False
    if effect == "gap_offset" and "centring" in names and plant.sides < 2:
        return False
    if "bandwidth_error" in names and math.isinf(plant.bandwidth):
        return False
    return drive_lags(plant) or not any((effect, name) in LAGGING for name in names)


def _centres(shape: Parameter, scene: Scene) -> tuple[float, ...]:
    """The values of a shape at which a search starts."""
    if shape.over == "lines":
        return tuple(dict.fromkeys((*MAINS, *scene.lines[:MOST_LINES])))
    unit = float(getattr(scene, shape.over)) if shape.over else 1.0
    return tuple(unit * factor for factor in shape.tried)
