"""What may deviate in a made magnet, by how much, and on what grounds."""

from collections.abc import Mapping
from dataclasses import dataclass

from msl_fem.actuator import Actuator, ECore
from msl_fem.errors import InputError
from msl_fem.files.quantity import format_quantity

LENGTHS = ("centre_leg_width", "outer_leg_width", "yoke_thickness", "armature_thickness", "stack_depth")
NAMES = ("gap", *LENGTHS, "stacking_factor", "bh_polarisation", "bh_field_strength")
RELATIVE = ("bh_polarisation", "bh_field_strength")
ISO_2768_FINE = ((3e-3, 0.05e-3), (6e-3, 0.05e-3), (30e-3, 0.1e-3), (120e-3, 0.15e-3), (400e-3, 0.2e-3), (1.0, 0.3e-3))
"""Lengths up to (m) and their limits (m): ISO 2768-1, class f."""
GAP_LIMIT, SHEET, STACKING_LIMIT, POLARISATION_LIMIT, FIELD_LIMIT = 20e-6, 0.36e-3, 0.01, 0.02, 0.1
SOURCES = {
    "gap": "faces ground and set by shims: one grade IT7 of ISO 286-1 at 18 ... 30 mm, 21 um, rounded",
    **dict.fromkeys(LENGTHS[:-1], "ISO 2768-1, class f, by the length"),
    "stack_depth": "one sheet more or less, 0.36 mm (29 gauge, 0.014 in)",
    "stacking_factor": "chosen: 0.95 ... 0.97 is what coated sheets of 0.35 mm reach; 0 for solid iron",
    "bh_polarisation": "chosen: typical polarisations of producers lie about 2 % above the minima of EN 10106",
    "bh_field_strength": "chosen: batches and cutting stress change the permeability by this much and more",
}


@dataclass(frozen=True)
class Tolerance:
    """A quantity's nominal value, its limit plus and minus, both in `unit`, and the limit's source.

    The nominal value of the B-H curve's two factors is 1. The gap's is that of the point it is judged at: None.
    """

    name: str
    nominal: float | None
    limit: float
    unit: str
    source: str


def tolerances_of(actuator: Actuator, *, stated: Mapping[str, float] | None = None) -> tuple[Tolerance, ...]:
    """The tolerances of an actuator's E-core: those given, else those of its [tolerances], else defaults.

    Raises
    ------
    InputError : an unknown name, or a limit beyond half of the nominal value
    """
    magnet = actuator.e_core()
    given = dict(stated or {})
    unknown = [name for name in given if name not in NAMES]
    if unknown:
        raise InputError(f"tolerance '{unknown[0]}' is unknown; choose from {', '.join(NAMES)}")
    found = []
    for name in NAMES:
        in_file = getattr(actuator.tolerances, name) if actuator.tolerances is not None else None
        default, source = _default(magnet, name), SOURCES[name]
        if name in given:
            limit, source = given[name], "given"
        elif in_file is not None:
            limit, source = in_file, actuator.sources.get(f"tolerances.{name}", "[tolerances] of the actuator file")
        else:
            limit = default
        nominal, unit = _nominal(magnet, name), "m" if name == "gap" or name in LENGTHS else ""
        _check(name, limit, nominal, unit)
        found.append(Tolerance(name, nominal, limit, unit, source))
    return tuple(found)


def _default(magnet: ECore, name: str) -> float:
    if name == "gap":
        return GAP_LIMIT
    if name == "stack_depth":
        return SHEET
    if name in LENGTHS:
        length = float(getattr(magnet, name))
        return next((limit for up_to, limit in ISO_2768_FINE if length <= up_to), 0.5e-3)
    if name == "stacking_factor":
        return STACKING_LIMIT if _nominal(magnet, name) != 1.0 else 0.0
    return POLARISATION_LIMIT if name == "bh_polarisation" else FIELD_LIMIT


def _nominal(magnet: ECore, name: str) -> float | None:
    if name in LENGTHS:
        return float(getattr(magnet, name))
    if name == "stacking_factor":
        return max(magnet.iron.core_stacking, magnet.iron.armature_stacking)
    return None if name == "gap" else 1.0


def _check(name: str, limit: float, nominal: float | None, unit: str) -> None:
    most = 0.5 * nominal if nominal is not None else float("inf")
    if name == "stacking_factor" and nominal is not None:
        most = 1.0 - nominal
    if not 0 <= limit <= most * (1 + 1e-9):
        raise InputError(
            f"tolerance {name} = {format_quantity(limit, unit)} is not allowed; it must be "
            f"0 ... {format_quantity(most, unit)}"
        )
