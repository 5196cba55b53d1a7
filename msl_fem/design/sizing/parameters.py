"""What a search varies: numbers of which nearly each choice is a sensible magnet, and the design that they give.

A search over plain lengths would spend most of its designs on iron that idles and windows far too large. Here the
closed equations turn the choice of how hard iron and copper work into lengths; the field then judges the lengths. It
begins with the E-core of textbook proportions.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace

from pydantic import ValidationError
from scipy.optimize import brentq

from msl_fem.design.sizing.closed_form import MagneticCircuit
from msl_fem.design.sizing.design import GRID, LEAST_COIL, Design, coil_size, on_grid, performance_constraints, wound
from msl_fem.design.sizing.evaluation import DesignEvaluator
from msl_fem.design.sizing.requirement import Requirement
from msl_fem.errors import RequirementError

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
WINDOW_ASPECT = 2.0
"""Height over width of the window, as E-laminations have it or more (3 in scrapless ones)."""
STACK_ASPECT = 1.0
"""Depth over width of the centre leg: a square has the shortest turns for its area."""
_STEP, _STEPS = 1.4, 40  # of the walk that brackets a root
_HEAT = ("current_density", "temperature_rise", "voltage")


@dataclass(frozen=True)
class ParameterSpan:
    """From where to where a parameter goes, and whether its logarithm is what is drawn evenly."""

    low: float
    high: float
    log: bool


@dataclass(frozen=True)
class SearchSpace:
    """The parameters of a search for one requirement; `current_density` (A/m2) is what a share of 1 means."""

    spans: dict[str, ParameterSpan]
    current_density: float

    def clipped(self, parameters: Mapping[str, float]) -> dict[str, float]:
        """The parameters, each held inside its span; a share that needs no search is left out."""
        return {name: min(max(parameters[name], span.low), span.high) for name, span in self.spans.items()}


def space_around(guess: Design, evaluator: DesignEvaluator) -> SearchSpace:
    """The search's parameters around a first guess."""
    requirement = evaluator.requirement
    low, high = (factor * guess.centre_leg_width for factor in CENTRE_LEG)
    if requirement.envelope.width is not None:
        low = min(low, LEAST_LEG * requirement.envelope.width)
    spans = {
        "centre_leg_width": ParameterSpan(low, high, True),
        "coil_aspect": ParameterSpan(*COIL_ASPECT, True),
        "flux_share": ParameterSpan(*FLUX_SHARE, False),
        "current_density_share": ParameterSpan(*CURRENT_DENSITY_SHARE, False),
    }
    spans |= {name: ParameterSpan(low, high, False) for name, (low, high) in SHARES.items()}
    if "force" in requirement.objectives:
        spans["force_share"] = ParameterSpan(*FORCE_SHARE, True)
    limit = requirement.heat.largest_current_density
    return SearchSpace(spans, 2 * _current_density(guess, evaluator) if limit is None else limit)


def design_from(parameters: Mapping[str, float], space: SearchSpace, evaluator: DesignEvaluator) -> Design:
    """The design that the parameters stand for, its dimensions on the grid of 10 um.

    The window is found by a fixed point: its leakage takes part in the magnetomotive force that its copper carries.
    """
    requirement = evaluator.requirement
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
        circuit = evaluator.circuit(design)
        area = circuit.point.ampere_turns / (density * requirement.winding.fill_factor)
        design = _with_coil(
            _balanced(design, circuit, parameters, evaluator), area, parameters["coil_aspect"], evaluator
        )
    return replace(
        design,
        **{
            name: on_grid(getattr(design, name))
            for name in ("outer_leg_width", "yoke_thickness", "armature_thickness", "window_width", "window_height")
        },
    )


def _with_coil(design: Design, area: float, aspect: float, evaluator: DesignEvaluator) -> Design:
    """The design with a coil of that area and aspect in its window."""
    winding = evaluator.requirement.winding
    width = math.sqrt(area / aspect)
    return replace(
        design,
        window_width=width + 2 * winding.leg_clearance,
        window_height=area / width + winding.face_clearance + winding.back_clearance,
    )


def _balanced(
    design: Design, circuit: MagneticCircuit, shares: Mapping[str, float], evaluator: DesignEvaluator
) -> Design:
    """The design with its iron as thick as the circuit's fluxes and the shares ask for."""
    even = even_thickness(design, circuit, evaluator)
    return replace(
        design,
        outer_leg_width=even["outer_leg_share"] * shares["outer_leg_share"],
        yoke_thickness=even["yoke_share"] * shares["yoke_share"],
        armature_thickness=even["armature_share"] * shares["armature_share"],
    )


def even_thickness(design: Design, circuit: MagneticCircuit, evaluator: DesignEvaluator) -> dict[str, float]:
    """The thicknesses in m at which outer leg, yoke and armature carry the centre leg's flux density."""
    flux = circuit.flux
    iron = evaluator.requirement.iron
    width = design.centre_leg_width / 2 / flux["centre_leg"]
    return {
        "outer_leg_share": width * flux["outer_leg"],
        "yoke_share": width * flux["yoke"],
        "armature_share": width * flux["armature"] * iron.core_stacking / iron.armature_stacking,
    }


def parameters_of(design: Design, space: SearchSpace, evaluator: DesignEvaluator) -> dict[str, float]:
    """The parameters that give a design, to rounding, held inside the space."""
    even = even_thickness(design, evaluator.circuit(design), evaluator)
    width, height = coil_size(design, evaluator.requirement)
    return space.clipped(
        {
            "centre_leg_width": design.centre_leg_width,
            "coil_aspect": height / width,
            "flux_share": design.flux_density / evaluator.requirement.flux.limit,
            "current_density_share": _current_density(design, evaluator) / space.current_density,
            "outer_leg_share": design.outer_leg_width / even["outer_leg_share"],
            "yoke_share": design.yoke_thickness / even["yoke_share"],
            "armature_share": design.armature_thickness / even["armature_share"],
            "force_share": design.force / evaluator.requirement.force.minimum,
        }
    )


def _current_density(design: Design, evaluator: DesignEvaluator) -> float:
    width, height = coil_size(design, evaluator.requirement)
    return evaluator.circuit(design).point.ampere_turns / (evaluator.requirement.winding.fill_factor * width * height)


def textbook_guess(evaluator: DesignEvaluator) -> Design:
    """The E-core of textbook proportions that meets the requirement by the closed equations.

    Outer legs, yoke and armature half as thick as the centre leg, a square centre leg, a window twice as high as wide;
    the iron at the flux limit. The window is as small as current density, temperature rise and voltage let it be, and
    the leg as wide as the force asks for: two roots, one in the other. The envelope is not looked at.

    Raises
    ------
    RequirementError : no size does
    """
    requirement = evaluator.requirement

    def excess_depth(width: float) -> float:
        design = _with_window(evaluator, width)
        return design.force / evaluator.circuit(design).point.force - STACK_ASPECT * width

    width = _root(excess_depth, requirement.force.gap, requirement)
    rough = _with_window(evaluator, width)
    lengths = [f.name for f in fields(Design) if f.name not in ("flux_density", "force")]
    # the window's to the next multiple, so that rounding does not make the coil too small
    return replace(
        rough, **{name: on_grid(getattr(rough, name) + (GRID / 2 if "window" in name else 0.0)) for name in lengths}
    )


def _design(requirement: Requirement, width: float, window: float) -> Design:
    half = width / 2
    return Design(
        width, half, half, half, window, WINDOW_ASPECT * window, requirement.flux.limit, requirement.force.minimum
    )


def _with_window(evaluator: DesignEvaluator, width: float) -> Design:
    """The design of a leg's width with the smallest window that keeps what limits the heat and the voltage."""
    requirement = evaluator.requirement
    winding = requirement.winding
    least = 2 * winding.leg_clearance + LEAST_COIL
    least = max(least, (winding.face_clearance + winding.back_clearance + LEAST_COIL) / WINDOW_ASPECT) + 2e-5

    def excess(window: float) -> float:
        design = _design(requirement, width, window)
        found = wound(design, evaluator.circuit(design).point, requirement, depth=STACK_ASPECT * width)
        return max(c.violation for c in performance_constraints(found, requirement) if c.name in _HEAT)

    window = least if excess(least) <= 0 else _root(excess, least, requirement)
    return _design(requirement, width, window)


def _root(function: Callable[[float], float], start: float, requirement: Requirement) -> float:
    """The root of a function that falls from above 0, looked for from `start` on."""
    low = start
    high = start * _STEP
    for _ in range(_STEPS):
        try:
            if function(high) <= 0:
                return float(brentq(function, low, high, rtol=1e-6))
            low = high
        except ValidationError:  # proportions that no section may have
            low = high if low == start else low
        high *= _STEP
    raise RequirementError(
        f"{requirement.name}: no E-core of textbook proportions gives {requirement.force.minimum:g} N within its "
        "limits of heat and voltage; look at the units in [force], [supply] and [heat]"
    )
