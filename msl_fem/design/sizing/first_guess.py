"""The first guess: an E-core by the closed equations and the textbook's proportions."""

from collections.abc import Callable
from dataclasses import fields, replace

from pydantic import ValidationError
from scipy.optimize import brentq

from msl_fem.design.sizing.design import GRID, LEAST_COIL, Design, on_grid
from msl_fem.design.sizing.judge import Judge
from msl_fem.design.sizing.performance import performance_constraints, wound
from msl_fem.design.sizing.requirement import Requirement
from msl_fem.errors import RequirementError

WINDOW_ASPECT = 2.0
"""Height over width of the window, as E-laminations have it or more (3 in scrapless ones)."""
STACK_ASPECT = 1.0
"""Depth over width of the centre leg: a square has the shortest turns for its area."""
_STEP, _STEPS = 1.4, 40  # of the walk that brackets a root
_HEAT = ("current_density", "temperature_rise", "voltage")


def first_guess(judge: Judge) -> Design:
    """The E-core of textbook proportions that meets the requirement by the closed equations.

    Outer legs, yoke and armature half as thick as the centre leg, a square centre leg, a window twice as high as wide;
    the iron at the flux limit. The window is as small as current density, temperature rise and voltage let it be, and
    the leg as wide as the force asks for: two roots, one in the other. The envelope is not looked at.

    Raises
    ------
    RequirementError : no size does
    """
    requirement = judge.requirement

    def excess_depth(width: float) -> float:
        design = _with_window(judge, width)
        return design.force / judge.circuit(design).point.force - STACK_ASPECT * width

    width = _root(excess_depth, requirement.force.gap, requirement)
    rough = _with_window(judge, width)
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


def _with_window(judge: Judge, width: float) -> Design:
    """The design of a leg's width with the smallest window that keeps what limits the heat and the voltage."""
    requirement = judge.requirement
    winding = requirement.winding
    least = 2 * winding.leg_clearance + LEAST_COIL
    least = max(least, (winding.face_clearance + winding.back_clearance + LEAST_COIL) / WINDOW_ASPECT) + 2e-5

    def excess(window: float) -> float:
        design = _design(requirement, width, window)
        found = wound(design, judge.circuit(design).point, requirement, depth=STACK_ASPECT * width)
        return max(c.violation for c in performance_constraints(found, requirement) if c.name in _HEAT)

    window = least if excess(least) <= 0 else _root(excess, least, requirement)
    return _design(requirement, width, window)


def _root(function: Callable[[float], float], start: float, requirement: Requirement) -> float:
    """The root of a function that falls from above 0, looked for from `start` on."""
    low, high = start, start * _STEP
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
