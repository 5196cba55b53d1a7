"""What a search varies: numbers of which nearly each choice is a sensible magnet, and the design that they give.

A search over plain lengths would spend most of its designs on iron that idles and windows far too large. Here the
closed equations turn the choice of how hard iron and copper work into lengths; the field then judges the lengths.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

from msl_fem.design.sizing.closed_form import Circuit
from msl_fem.design.sizing.design import Design, coil_size, on_grid
from msl_fem.design.sizing.judge import Judge

BEYOND = 1.15
"""Flux density and current density are drawn up to this multiple of their limits and held at the limit: the best
designs lie on it, and a search draws its bound itself with no more than chance."""
SHARES = {"outer_leg_share": (0.93, 1.2), "yoke_share": (0.93, 1.2), "armature_share": (0.93, 1.2)}
"""Thickness over that at which the part carries the centre leg's flux density by the closed equations."""
CENTRE_LEG = (0.4, 1.6)
"""Width of the centre leg, of the first guess's."""
LEAST_LEG = 0.15
"""Of the envelope's width, where that is smaller."""
COIL_ASPECT = (0.3, 5.0)
"""Height over width of the coil."""
FLUX_SHARE = (0.55, BEYOND)
"""Of the flux limit: less flux density for a given force is more iron and less copper loss."""
CURRENT_DENSITY_SHARE = (0.25, BEYOND)
"""Of the limit, or of twice the first guess's current density where only the temperature is limited."""
FORCE_SHARE = (1.0, 2.0)
"""Of the wanted force, where force is an objective."""
_ROUNDS = 3  # of the window's fixed point


@dataclass(frozen=True)
class Span:
    """From where to where a parameter goes, and whether its logarithm is what is drawn evenly."""

    low: float
    high: float
    log: bool


@dataclass(frozen=True)
class Space:
    """The parameters of a search for one requirement; `current_density` (A/m2) is what a share of 1 means."""

    spans: dict[str, Span]
    current_density: float

    def clipped(self, parameters: Mapping[str, float]) -> dict[str, float]:
        """The parameters, each held inside its span; a share that needs no search is left out."""
        return {name: min(max(parameters[name], span.low), span.high) for name, span in self.spans.items()}


def space_around(guess: Design, judge: Judge) -> Space:
    """The search's parameters around a first guess."""
    requirement = judge.requirement
    low, high = (factor * guess.centre_leg_width for factor in CENTRE_LEG)
    if requirement.envelope.width is not None:
        low = min(low, LEAST_LEG * requirement.envelope.width)
    spans = {
        "centre_leg_width": Span(low, high, True),
        "coil_aspect": Span(*COIL_ASPECT, True),
        "flux_share": Span(*FLUX_SHARE, False),
        "current_density_share": Span(*CURRENT_DENSITY_SHARE, False),
    }
    spans |= {name: Span(low, high, False) for name, (low, high) in SHARES.items()}
    if "force" in requirement.objectives:
        spans["force_share"] = Span(*FORCE_SHARE, True)
    limit = requirement.heat.largest_current_density
    return Space(spans, 2 * _current_density(guess, judge) if limit is None else limit)


def design_from(parameters: Mapping[str, float], space: Space, judge: Judge) -> Design:
    """The design that the parameters stand for, its dimensions on the grid of 10 um.

    The window is found by a fixed point: its leakage takes part in the magnetomotive force that its copper carries.
    """
    requirement = judge.requirement
    centre = on_grid(parameters["centre_leg_width"])
    density = space.current_density * min(parameters["current_density_share"], 1.0)
    winding = requirement.winding
    design = Design(
        centre, centre / 2, centre / 2, centre / 2,
        centre + 2 * winding.leg_clearance, centre + winding.face_clearance + winding.back_clearance,
        requirement.flux.limit * min(parameters["flux_share"], 1.0),
        requirement.force.minimum * parameters.get("force_share", 1.0),
    )  # fmt: skip
    for _ in range(_ROUNDS):
        circuit = judge.circuit(design)
        area = circuit.point.ampere_turns / (density * requirement.winding.fill_factor)
        design = _with_coil(_balanced(design, circuit, parameters, judge), area, parameters["coil_aspect"], judge)
    return replace(
        design,
        **{
            name: on_grid(getattr(design, name))
            for name in ("outer_leg_width", "yoke_thickness", "armature_thickness", "window_width", "window_height")
        },
    )


def _with_coil(design: Design, area: float, aspect: float, judge: Judge) -> Design:
    """The design with a coil of that area and aspect in its window."""
    winding = judge.requirement.winding
    width = math.sqrt(area / aspect)
    return replace(
        design,
        window_width=width + 2 * winding.leg_clearance,
        window_height=area / width + winding.face_clearance + winding.back_clearance,
    )


def _balanced(design: Design, circuit: Circuit, shares: Mapping[str, float], judge: Judge) -> Design:
    """The design with its iron as thick as the circuit's fluxes and the shares ask for."""
    even = even_thickness(design, circuit, judge)
    return replace(
        design,
        outer_leg_width=even["outer_leg_share"] * shares["outer_leg_share"],
        yoke_thickness=even["yoke_share"] * shares["yoke_share"],
        armature_thickness=even["armature_share"] * shares["armature_share"],
    )


def even_thickness(design: Design, circuit: Circuit, judge: Judge) -> dict[str, float]:
    """The thicknesses in m at which outer leg, yoke and armature carry the centre leg's flux density."""
    flux, iron = circuit.flux, judge.requirement.iron
    width = design.centre_leg_width / 2 / flux["centre_leg"]
    return {
        "outer_leg_share": width * flux["outer_leg"],
        "yoke_share": width * flux["yoke"],
        "armature_share": width * flux["armature"] * iron.core_stacking / iron.armature_stacking,
    }


def parameters_of(design: Design, space: Space, judge: Judge) -> dict[str, float]:
    """The parameters that give a design, to rounding, held inside the space."""
    even = even_thickness(design, judge.circuit(design), judge)
    width, height = coil_size(design, judge.requirement)
    return space.clipped(
        {
            "centre_leg_width": design.centre_leg_width,
            "coil_aspect": height / width,
            "flux_share": design.flux_density / judge.requirement.flux.limit,
            "current_density_share": _current_density(design, judge) / space.current_density,
            "outer_leg_share": design.outer_leg_width / even["outer_leg_share"],
            "yoke_share": design.yoke_thickness / even["yoke_share"],
            "armature_share": design.armature_thickness / even["armature_share"],
            "force_share": design.force / judge.requirement.force.minimum,
        }
    )


def _current_density(design: Design, judge: Judge) -> float:
    width, height = coil_size(design, judge.requirement)
    return judge.circuit(design).point.ampere_turns / (judge.requirement.winding.fill_factor * width * height)
