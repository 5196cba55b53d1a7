"""A sized magnet as an actuator file that the other commands take."""

import math
import os
from pathlib import Path

from msl_fem.actuator import Actuator, Drive, IronSpec, Motion
from msl_fem.design.sizing.performance import Performance
from msl_fem.design.sizing.requirement import Requirement
from msl_fem.files.schema import document
from msl_fem.files.toml_text import toml_text
from msl_fem.files.whole_file import whole_file

NATURAL_FREQUENCY = 60.0
"""Hz of the mover on its suspension where no stiffness is stated: about the reference actuator's."""
DAMPING_RATIO = 0.02
"""Where no damping is stated: flexures and air."""


def sized_actuator(found: Performance, requirement: Requirement, *, target: Path) -> Actuator:
    """The actuator around a sized magnet; the requirement's defaults fill what it does not state.

    `target` is the file that it is meant for: names of B-H files are made relative to it.
    """
    motion, supply = requirement.motion, requirement.supply
    mass = motion.payload + requirement.sides.magnets_per_side * found.masses.armature
    stiffness = motion.stiffness
    if stiffness is None:
        stiffness = _three_digits(mass * (2 * math.pi * NATURAL_FREQUENCY) ** 2)
    damping = motion.damping
    if damping is None:
        damping = _three_digits(2 * DAMPING_RATIO * math.sqrt(stiffness * mass))
    return Actuator(
        schema=1,
        name=requirement.name,
        magnet=found.magnet.model_copy(update={"iron": _iron(requirement, target)}),
        sides=requirement.sides,
        motion=Motion(
            moving_mass=float(f"{mass:.4g}"),
            stiffness=stiffness,
            damping=damping,
            nominal_gap=requirement.nominal_gap,
            range=requirement.range,
            constant_force=motion.constant_force,
        ),
        drive=Drive(
            kind="current", bandwidth=supply.bandwidth, voltage_limit=supply.voltage, current_limit=supply.current
        ),
        position_sensor=requirement.position_sensor,
        current_sensor=requirement.current_sensor,
        controller=requirement.controller,
        sources=_sources(found, requirement),
        file=target,
    )


def write_sized_actuator(actuator: Actuator, path: Path) -> None:
    """The actuator file, whole or not at all; InputError where it cannot be written."""
    with whole_file(path) as partial:
        partial.write_text(toml_text(document(actuator)), encoding="utf-8")


def _three_digits(value: float) -> float:
    return float(f"{value:.3g}")


def _iron(requirement: Requirement, target: Path) -> IronSpec:
    """The irons, their files named relative to the actuator file's folder."""

    def moved(name: str) -> str:
        if not name.endswith(".csv") or Path(name).is_absolute():
            return name
        return Path(os.path.relpath(requirement.folder / name, target.parent)).as_posix()

    iron = requirement.iron
    return iron.model_copy(update={"core": moved(iron.core), "armature": moved(iron.armature)})


def _sources(found: Performance, requirement: Requirement) -> dict[str, str]:
    wanted = f"{requirement.force.minimum:g} N at {requirement.force.gap * 1e3:g} mm below {requirement.flux.limit:g} T"
    armatures = requirement.sides.magnets_per_side
    said = {
        "magnet": f"sized by 'msl-fem size' from the requirement '{requirement.name}' ({wanted}): a magnet has "
        f"{found.force:.5g} N at {found.current:.5g} A with {found.flux_density:.4g} T in the "
        f"{found.section.replace('_', ' ')}",
        "motion.moving_mass": f"payload {requirement.motion.payload:g} kg and {armatures} armature(s) of "
        f"{found.masses.armature:.4g} kg",
    }
    if requirement.motion.stiffness is None:
        said["motion.stiffness"] = f"chosen: {NATURAL_FREQUENCY:g} Hz with the moving mass"
    if requirement.motion.damping is None:
        said["motion.damping"] = f"chosen: damping ratio {DAMPING_RATIO:g}"
    said["drive"] = "the requirement's supply; resistance from the winding"
    return said
