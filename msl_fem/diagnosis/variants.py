"""The ways in which each effect of the catalogue can act: which of its parameters, around which shapes.

An effect with many parameters is tried with few of them at a time: each that is not needed would cost evidence. A shape
(a frequency, a time constant) starts at each point of a grid and is free from there.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from msl_fem.diagnosis.unknowns import EffectUnknown
from msl_fem.plant.coefficients import drive_lags
from msl_fem.plant.effects import CATALOGUE
from msl_fem.plant.extended import LAGGING
from msl_fem.plant.plant import FORCE_DRIVE, PlantParameters

Array = NDArray[np.float64]

SUBSETS: dict[str, tuple[tuple[str, ...], ...]] = {
    "gap_offset": (("offset",), ("centring",)),
    "early_saturation": (("knee_shift",), ("low_field_current", "knee_excess"), ("knee_excess",)),
    "fringing": (("growth",), ("depth_error",), ("turns_error",), ("growth", "depth_error")),
    "coil_heating": (("rise_per_joule",), ("rise_per_joule", "initial_rise")),
    "amplifier_bandwidth": (("lag",), ("slew_time",), ("bandwidth_error",), ("lag", "slew_time")),
    "current_sensor_error": (
        ("gain_1", "gain_2"), ("offset_1", "offset_2"), ("gain_1", "gain_2", "offset_1", "offset_2"), ("gain_1",),
        ("gain_2",), ("offset_1",), ("offset_2",), ("gain_1", "offset_1"), ("gain_2", "offset_2"),
    ),
    "stiffness_nonlinearity": (("cubic",), ("quadratic",), ("cubic", "quadratic")),
    "structural_mode": (("mass_share",), ("mass_share", "load_reading")),
    "position_sensor_nonlinearity": (("quadratic",), ("cubic",), ("gain_error",), ("quadratic", "cubic"),
                                     ("gain_error", "quadratic", "cubic")),
    "time_delay": (("command",), ("position",), ("current",), ("position", "current")),
    "periodic_disturbance": (("force_cosine", "force_sine"), ("position_cosine", "position_sine"),
                             ("current_cosine", "current_sine")),
    "sensor_drift": (("rate",), ("offset", "rate"), ("offset", "rate", "acceleration"),
                     ("offset", "rate", "acceleration", "jerk")),
}  # fmt: skip
"""Parameters tried together; effects that are not here have one set, all that are no shapes."""
RELATIVE = {
    ("structural_mode", "frequency"): tuple(1.6 * 1.18**n for n in range(17)),  # a resonance is narrow
    ("support_compliance", "frequency"): (4.0, 10.0, 25.0),
}
"""Frequencies tried, over the mover's own."""
ABSOLUTE = {
    ("structural_mode", "damping_ratio"): (0.015,),
    ("support_compliance", "damping_ratio"): (0.1,),
    ("flexure_relaxation", "time_constant"): (0.004, 0.03, 0.2),
    ("coil_heating", "cooling_rate"): (0.2, 1.5),
    ("coil_heating", "core_rate"): (0.03,),
    ("coulomb_friction", "stribeck_rise"): (0.2,),
    ("eddy_currents", "diffusion_time"): (1e-3, 1e-2, 1e-1, 1.0),
    ("position_sensor_lag", "delay_share"): (0.3,),
    ("amplifier_bandwidth", "delay_share"): (0.3,),
    ("early_saturation", "low_field_width"): (0.1,),
}
SHAPE_WIDTH = {"damping_ratio": 1.0, "time_constant": 0.8, "cooling_rate": 1.5, "core_rate": 1.5, "presliding": 1.0,
               "reversal_current": 1.0, "stribeck_rise": 1.0, "stribeck_velocity": 1.0,
               "diffusion_time": 1.0, "delay_share": 0.8, "low_field_width": 1.0}  # fmt: skip
FREQUENCY_WIDTH = 0.15
WITHOUT_SHAPE = {
    ("coil_heating", "initial_rise"), ("eddy_currents", "time_constant"), ("position_sensor_lag", "lag"),
    ("amplifier_bandwidth", "lag"),
}  # fmt: skip
"""Single amounts that act without their effect's shapes too."""
OF_ONE = {("amplifier_bandwidth", "delay_share"): "lag", ("early_saturation", "low_field_width"): "low_field_current"}
"""Shapes that belong to one of their effect's amounts."""
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
    names = tuple(p.name for p in entry.parameters if not p.shape)
    sets = [s for s in SUBSETS.get(effect, (names,)) if _there(effect, s, plant)]
    shapes = [p.name for p in entry.parameters if p.shape]
    found = []
    for chosen in sets:
        own = [name for name in shapes if OF_ONE.get((effect, name), chosen[0]) in chosen]
        for centres in _grid(effect, own, scene):
            made = tuple(
                EffectUnknown(effect, name, centre, SHAPE_WIDTH.get(name, FREQUENCY_WIDTH))
                for name, centre in zip(own, centres, strict=True)
            )
            found.append(Variant(effect, tuple(EffectUnknown(effect, name) for name in chosen), made))
    plain = [Variant(effect, (EffectUnknown(effect, name),)) for name in names if (effect, name) in WITHOUT_SHAPE]
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


def _grid(effect: str, shapes: Sequence[str], scene: Scene) -> list[tuple[float, ...]]:
    """Centres of the shapes: all combinations of the values tried for each."""
    tried: list[tuple[float, ...]] = []
    for name in shapes:
        if effect == "periodic_disturbance":
            tried.append(tuple(dict.fromkeys((*MAINS, *scene.lines[:MOST_LINES]))))
        elif (effect, name) in RELATIVE:
            tried.append(tuple(scene.own_frequency * factor for factor in RELATIVE[effect, name]))
        elif (effect, name) in ABSOLUTE:
            tried.append(ABSOLUTE[effect, name])
        elif name == "reversal_current":
            tried.append(tuple(scene.current * factor for factor in (0.3, 1.0, 3.0)))
        elif name == "presliding":
            tried.append(tuple(scene.position * factor for factor in (0.03, 0.2)))
        elif name == "stribeck_velocity":
            tried.append((0.15 * scene.velocity,))
    combined: list[tuple[float, ...]] = [()]
    for values in tried:
        combined = [(*c, v) for c in combined for v in values]
    return combined
