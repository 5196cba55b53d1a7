"""What a search varies: numbers of which nearly each choice is a sensible magnet, and the design that they give.

A search over plain lengths would spend most of its designs on iron that idles and windows far too large. Here the
closed equations turn the choice of how hard iron and copper work into lengths; the field then judges the lengths. It
begins with the magnet of textbook proportions.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace

from pydantic import ValidationError
from scipy.optimize import brentq

from msl_fem.design.sizing.closed_form import Factors, MagneticCircuit
from msl_fem.design.sizing.design import (
    GRID,
    LEAST_COIL,
    Design,
    coil_area,
    coil_size,
    on_grid,
    performance_constraints,
    wound,
)
from msl_fem.design.sizing.evaluation import DesignEvaluator
from msl_fem.design.sizing.requirement import Requirement
from msl_fem.errors import RequirementError
from msl_fem.materials.constants import MU_0

BEYOND = 1.15
"""Flux density and current density are drawn up to this multiple of their limits and held at the limit: the best
designs lie on it, and a search draws its bound itself with no more than chance."""
SHARES = {"return_width": "return_share", "yoke_thickness": "yoke_share", "armature_thickness": "armature_share"}
"""Length of a design to the parameter that chooses it."""
SHARE = (0.93, 1.2)
"""Thickness over that at which the part carries the wound pole's flux density by the closed equations."""
POLE = (0.4, 1.6)
"""Width of the wound pole, of the first guess's."""
LEAST_POLE = 0.15
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
_ROUNDS_REVOLVED = 5  # where the pole's diameter is found with it
_EVEN_ROUNDS = 4  # of a ring's width, whose area goes with more than the width
WINDOW_ASPECT = 2.0
"""Height over width of the window, as E-laminations have it or more (3 in scrapless ones)."""
STACK_ASPECT = 1.0
"""Depth over width of the wound pole: a square has the shortest turns for its area."""
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
    """The search's parameters around a first guess; a round pole's diameter is none, the force fixes it."""
    requirement = evaluator.requirement
    spans = {} if requirement.revolved else {"pole_width": _pole_span(guess, evaluator)}
    spans |= {
        "coil_aspect": ParameterSpan(*COIL_ASPECT, True),
        "flux_share": ParameterSpan(*FLUX_SHARE, False),
        "current_density_share": ParameterSpan(*CURRENT_DENSITY_SHARE, False),
    }
    spans |= {SHARES[length]: ParameterSpan(*SHARE, False) for _, length in requirement.sized.parts}
    if "force" in requirement.objectives:
        spans["force_share"] = ParameterSpan(*FORCE_SHARE, True)
    limit = requirement.heat.largest_current_density
    return SearchSpace(spans, 2 * _current_density(guess, evaluator) if limit is None else limit)


def _pole_span(guess: Design, evaluator: DesignEvaluator) -> ParameterSpan:
    low, high = (factor * guess.pole_width for factor in POLE)
    width = evaluator.requirement.envelope.width
    return ParameterSpan(low if width is None else min(low, LEAST_POLE * width), high, True)


def design_from(parameters: Mapping[str, float], space: SearchSpace, evaluator: DesignEvaluator) -> Design:
    """The design that the parameters stand for, its dimensions on the grid of 10 um.

    The window is found by a fixed point: its leakage takes part in the magnetomotive force that its copper carries. So
    is the diameter of a round pole, with which the force goes as its square.
    """
    requirement = evaluator.requirement
    density = space.current_density * min(parameters["current_density_share"], 1.0)
    design = _beginning(parameters, evaluator)
    for _ in range(_ROUNDS_REVOLVED if requirement.revolved else _ROUNDS):
        circuit = evaluator.circuit(design)
        area = circuit.point.ampere_turns / (density * requirement.winding.fill_factor)
        design = _balanced(design, circuit, parameters, evaluator)
        if requirement.revolved:
            design = _with_force(design, evaluator)
        design = _with_coil(design, area, parameters["coil_aspect"], evaluator)
    names = [f.name for f in fields(Design) if f.name not in ("flux_density", "force")]
    return replace(design, **{name: on_grid(getattr(design, name)) for name in names})


def _with_force(design: Design, evaluator: DesignEvaluator) -> Design:
    """All iron of a body of revolution thicker or thinner by what its force is short or too large."""
    factor = math.sqrt(design.force / evaluator.circuit(design).point.force)
    names = ("pole_width", "return_width", "yoke_thickness", "armature_thickness")
    return replace(design, **{name: factor * getattr(design, name) for name in names})


def _beginning(parameters: Mapping[str, float], evaluator: DesignEvaluator) -> Design:
    """Iron of about the same flux density all round, a window as wide and as high as the pole."""
    requirement = evaluator.requirement
    winding = requirement.winding
    flux_density = requirement.flux.limit * min(parameters["flux_share"], 1.0)
    force = requirement.force.minimum * parameters.get("force_share", 1.0)
    if requirement.revolved:  # of two equal faces, F = B^2 A/mu_0
        pole = math.sqrt(4 / math.pi * MU_0 * force) / flux_density
        back, plate = pole / 12, pole / 4
    else:
        pole = on_grid(parameters["pole_width"])
        back, plate = pole / 2, pole / 2
    return Design(
        pole, pole if requirement.sized.return_pole is None else back, plate, plate,
        requirement.sized.coils * (pole + 2 * winding.leg_clearance),
        pole + winding.face_clearance + winding.back_clearance,
        flux_density, force,
    )  # fmt: skip


def _with_coil(design: Design, area: float, aspect: float, evaluator: DesignEvaluator) -> Design:
    """The design with coils of that area together and that aspect in its window."""
    winding = evaluator.requirement.winding
    coils = evaluator.requirement.sized.coils
    width = math.sqrt(area / coils / aspect)
    return replace(
        design,
        window_width=coils * (width + 2 * winding.leg_clearance),
        window_height=area / coils / width + winding.face_clearance + winding.back_clearance,
    )


def _balanced(
    design: Design, circuit: MagneticCircuit, shares: Mapping[str, float], evaluator: DesignEvaluator
) -> Design:
    """The design with its iron as thick as the circuit's fluxes and the shares ask for."""
    even = even_thickness(design, circuit, evaluator)
    return replace(design, **{name: value * shares[SHARES[name]] for name, value in even.items()})


def even_thickness(design: Design, circuit: MagneticCircuit, evaluator: DesignEvaluator) -> dict[str, float]:
    """By length of the design the thickness in m at which its part carries the wound pole's flux density.

    Where a part's area is proportional to the length; else the next step of a fixed point towards it.
    """
    load = {name: circuit.flux[name] / circuit.areas[name] for name in circuit.flux}
    return {
        length: getattr(design, length) * load[part] / load[circuit.pole]
        for part, length in evaluator.requirement.sized.parts
    }


def parameters_of(design: Design, space: SearchSpace, evaluator: DesignEvaluator) -> dict[str, float]:
    """The parameters that give a design, to rounding, held inside the space."""
    even = even_thickness(design, evaluator.circuit(design), evaluator)
    width, height = coil_size(design, evaluator.requirement)
    return space.clipped(
        {
            "pole_width": design.pole_width,
            "coil_aspect": height / width,
            "flux_share": design.flux_density / evaluator.requirement.flux.limit,
            "current_density_share": _current_density(design, evaluator) / space.current_density,
            **{SHARES[name]: getattr(design, name) / value for name, value in even.items()},
            "force_share": design.force / evaluator.requirement.force.minimum,
        }
    )


def _current_density(design: Design, evaluator: DesignEvaluator) -> float:
    requirement = evaluator.requirement
    copper = requirement.winding.fill_factor * coil_area(design, requirement)
    return evaluator.circuit(design).point.ampere_turns / copper


def textbook_guess(evaluator: DesignEvaluator) -> Design:
    """The magnet of textbook proportions that meets the requirement by the closed equations.

    All iron carries the same flux density but for leakage (outer legs, yoke and armature of an E-core are half as thick
    as its centre leg), at the flux limit; a square pole in a plane section; a window twice as high as wide. The window
    is as small as current density, temperature rise and voltage let it be, and the pole as wide as the force asks for:
    two roots, one in the other. The envelope is not looked at.

    Raises
    ------
    RequirementError : no size does
    """
    requirement = evaluator.requirement

    def excess_force(width: float) -> float:
        design, depth = _with_window(evaluator, width), _depth(requirement, width)
        return design.force / evaluator.circuit(design, depth=depth).point.force - depth

    width = _root(excess_force, requirement.force.gap, requirement)
    rough = _with_window(evaluator, width)
    lengths = [f.name for f in fields(Design) if f.name not in ("flux_density", "force")]
    # the window's to the next multiple, so that rounding does not make the coil too small
    return replace(
        rough, **{name: on_grid(getattr(rough, name) + (GRID / 2 if "window" in name else 0.0)) for name in lengths}
    )


def _depth(requirement: Requirement, width: float) -> float:
    """Of the stack in m; 1 where there is none."""
    return 1.0 if requirement.revolved else STACK_ASPECT * width


def _with_iron(evaluator: DesignEvaluator, width: float, window: float) -> Design:
    """The design of a pole's and a window's width whose iron carries the same flux density without leakage."""
    requirement = evaluator.requirement
    half = width / 2
    design = Design(
        width, width if requirement.sized.return_pole is None else half, half, half, window,
        WINDOW_ASPECT * window / requirement.sized.coils, requirement.flux.limit, requirement.force.minimum,
    )  # fmt: skip
    for _ in range(_EVEN_ROUNDS if requirement.revolved else 1):
        circuit = evaluator.circuit(design, factors=Factors(leakage=False))
        design = replace(design, **even_thickness(design, circuit, evaluator))
    return design


def _with_window(evaluator: DesignEvaluator, width: float) -> Design:
    """The design of a pole's width with the smallest window that keeps what limits the heat and the voltage."""
    requirement = evaluator.requirement
    winding = requirement.winding
    least = 2 * winding.leg_clearance + LEAST_COIL
    least = max(least, (winding.face_clearance + winding.back_clearance + LEAST_COIL) / WINDOW_ASPECT) + 2e-5
    least *= requirement.sized.coils

    def excess(window: float) -> float:
        design = _with_iron(evaluator, width, window)
        depth = _depth(requirement, width)
        point = evaluator.circuit(design, depth=depth).point
        found = wound(design, point, requirement, depth=depth)
        return max(c.violation for c in performance_constraints(found, requirement) if c.name in _HEAT)

    window = least if excess(least) <= 0 else _root(excess, least, requirement)
    return _with_iron(evaluator, width, window)


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
        f"{requirement.name}: no {requirement.magnet.kind} of textbook proportions gives "
        f"{requirement.force.minimum:g} N within its limits of heat and voltage; look at the units in "
        "[force], [supply] and [heat]"
    )
