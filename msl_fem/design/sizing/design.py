"""A design: the free dimensions of an E-core's section, how hard its iron works, and what it pulls."""

from dataclasses import dataclass
from typing import Any

from msl_fem.actuator import Coil, ECore
from msl_fem.design.sizing.constraints import Constraint, at_least, at_most
from msl_fem.design.sizing.requirement import Requirement

GRID = 1e-5
"""m; dimensions are multiples of it."""
LEAST_COIL = 5e-4
"""m; a narrower or lower coil is not wound."""


@dataclass(frozen=True)
class Design:
    """What a search varies. The stack's depth and the turns are no free choice: they follow from the field.

    In the plane a field does not know its depth: at a given magnetomotive force the flux densities stay and the force
    grows with the depth. So the magnetomotive force is that which brings `flux_density`, and the depth that which
    gives `force`: the current that gives the force brings just this flux density.

    Attributes
    ----------
    centre_leg_width ... window_height : m
    flux_density : T in the iron, mean over the most loaded section, at `force`
    force : N of one magnet at the wanted gap
    """

    centre_leg_width: float
    outer_leg_width: float
    yoke_thickness: float
    armature_thickness: float
    window_width: float
    window_height: float
    flux_density: float
    force: float

    @property
    def half_width(self) -> float:
        return self.centre_leg_width / 2 + self.window_width + self.outer_leg_width


def on_grid(length: float) -> float:
    """The nearest multiple of the grid, as a number that prints short."""
    return round(round(length / GRID) * GRID, 9)


def coil_size(design: Design, requirement: Requirement) -> tuple[float, float]:
    """Width and height in m of the coil that fills the window but for its clearances; negative without room."""
    winding = requirement.winding
    return (
        round(design.window_width - 2 * winding.leg_clearance, 9),
        round(design.window_height - winding.face_clearance - winding.back_clearance, 9),
    )


def building_constraints(design: Design, requirement: Requirement) -> tuple[Constraint, ...]:
    """What must hold before a field can be solved: a coil in its window, and a section inside the envelope."""
    width, height = coil_size(design, requirement)
    envelope = requirement.envelope
    found = [at_least("coil_width", width, LEAST_COIL, "m"), at_least("coil_height", height, LEAST_COIL, "m")]
    if envelope.width is not None:
        found.append(at_most("envelope_width", 2 * design.half_width, envelope.width, "m"))
    if envelope.height is not None:
        total = requirement.force.gap + design.armature_thickness + design.window_height + design.yoke_thickness
        found.append(at_most("envelope_height", total, envelope.height, "m"))
    if envelope.depth is not None:  # the end turns alone
        found.append(at_most("envelope_depth", overall_depth(design, requirement, GRID), envelope.depth, "m"))
    return tuple(found)


def section_lengths(design: Design, requirement: Requirement) -> tuple[float, ...]:
    """The lengths in m that an actuator file states of the section; a clearance may be 0."""
    winding = requirement.winding
    return (
        design.centre_leg_width, design.outer_leg_width, design.yoke_thickness, design.armature_thickness,
        design.window_width, design.window_height, *coil_size(design, requirement),
        winding.leg_clearance, winding.face_clearance,
    )  # fmt: skip


def overall_depth(design: Design, requirement: Requirement, depth: float) -> float:
    """Stack and end turns in m."""
    return depth + 2 * (requirement.winding.leg_clearance + coil_size(design, requirement)[0])


def magnet_of(
    design: Design, requirement: Requirement, *, depth: float, turns: int, fill: float | None = None
) -> ECore:
    """The magnet as an actuator file states it.

    Raises
    ------
    ValueError : proportions that no section may have
    """
    content = _content(design, requirement) | {"stack_depth": depth}
    fill = requirement.winding.fill_factor if fill is None else fill
    return ECore(**content, coil=Coil(**_coil(design, requirement), turns=turns, fill_factor=fill))


def plain_magnet(design: Design, requirement: Requirement) -> ECore:
    """The magnet with one turn and a depth of its half width, unchecked: the closed equations take thousands."""
    content = _content(design, requirement) | {"stack_depth": design.half_width}
    fill = requirement.winding.fill_factor
    coil = Coil.model_construct(**_coil(design, requirement), turns=1, fill_factor=fill)
    return ECore.model_construct(**content, coil=coil)


def _content(design: Design, requirement: Requirement) -> dict[str, Any]:
    return {
        "kind": "e-core",
        "centre_leg_width": design.centre_leg_width,
        "outer_leg_width": design.outer_leg_width,
        "window_width": design.window_width,
        "window_height": design.window_height,
        "yoke_thickness": design.yoke_thickness,
        "armature_thickness": design.armature_thickness,
        "iron": requirement.iron,
    }


def _coil(design: Design, requirement: Requirement) -> dict[str, Any]:
    width, height = coil_size(design, requirement)
    winding = requirement.winding
    return {
        "width": width,
        "height": height,
        "leg_clearance": winding.leg_clearance,
        "face_clearance": winding.face_clearance,
    }
