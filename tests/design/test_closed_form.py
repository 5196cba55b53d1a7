"""The design equations against the textbook's uniform gap, their corrections against fields."""

import math
from dataclasses import replace

import numpy as np
import pytest
from sizing_requirements import evaluator, requirement

from msl_fem.design.sizing import Design, DesignEvaluator
from msl_fem.design.sizing.closed_form import Factors, gap_permeance, unloaded, window_leakage
from msl_fem.design.sizing.design import plain_magnet
from msl_fem.design.sizing.parameters import STACK_ASPECT, WINDOW_ASPECT, textbook_guess
from msl_fem.magnetics.kinds.kind import LeakageWindow
from msl_fem.materials.constants import MU_0

PLAIN = Factors(fringing=False, leakage=False)
IDEAL = {"iron": {"core": "linear:1e12", "armature": "linear:1e12"}}
EVEN = Design(10e-3, 5e-3, 5e-3, 5e-3, 10e-3, 20e-3, 1.2, 150.0)


def test_uniform_gap_is_maxwells_force() -> None:
    """B^2 A/(2 mu_0) over both pole faces, and N i = 2 B g/mu_0, with ideal iron, no fringe, no leakage."""
    it = evaluator(**IDEAL)
    point = it.circuit(EVEN, factors=PLAIN).point
    gap = it.requirement.force.gap
    assert point.force == pytest.approx(1.2**2 * (10e-3 + 2 * 5e-3) / (2 * MU_0), rel=1e-9)
    assert point.ampere_turns == pytest.approx(2 * 1.2 * gap / MU_0, rel=1e-9)
    assert point.inductance == pytest.approx(MU_0 * 10e-3 / (2 * gap), rel=1e-9)
    assert point.force_slope == pytest.approx(2 * point.force / point.ampere_turns)


def test_gutierrez_and_ro_s_flux_with_iron() -> None:
    """Phi = N i/(l/(mu_0 mu_r A) + 2 g/(mu_0 A)), the paper's form, for legs, yoke and armature of one area."""
    it, mu_r = evaluator(iron={"core": "linear:2000", "armature": "linear:2000"}), 2000
    circuit = it.circuit(EVEN, factors=PLAIN)
    length = 2 * (20e-3 + 2.5e-3) + 2 * (10e-3 + 2.5e-3 + 2.5e-3)  # two legs; yoke and armature
    flux = circuit.point.ampere_turns / ((length / mu_r + 2 * it.requirement.force.gap) / (MU_0 * 10e-3))
    assert flux == pytest.approx(1.2 * 10e-3, rel=1e-9)


def test_stacking_factor_dilutes_the_gap_s_flux() -> None:
    """The level is that in the sheets: the gap carries the stacking factor of it, the force its square."""
    ideal = IDEAL["iron"]
    thin = evaluator(iron={**ideal, "stacking_factor": 0.9}).circuit(EVEN, factors=PLAIN).point
    solid = evaluator(**IDEAL).circuit(EVEN, factors=PLAIN).point
    assert thin.force / solid.force == pytest.approx(0.81, rel=1e-9)


@pytest.mark.parametrize("fringing", [False, True])
def test_slope_of_the_permeance_is_its_derivative(fringing: bool) -> None:
    circuit, gap, step = plain_magnet(EVEN, evaluator().requirement).circuit, 0.5e-3, 1e-8
    assert circuit is not None
    up, down = (gap_permeance(circuit, gap + s, fringing=fringing).value for s in (step, -step))
    assert gap_permeance(circuit, gap, fringing=fringing).slope == pytest.approx((up - down) / (2 * step), rel=1e-6)


def test_window_leakage_is_the_integral_of_its_density() -> None:
    """Piece by piece exact, against a fine midpoint rule."""
    window = LeakageWindow(2.0, 4e-3, 20e-3, 2e-3, 17e-3)
    width = window.width
    y = (np.arange(200_000) + 0.5) / 200_000 * window.height
    force = np.clip((window.face_clearance + window.coil_height - y) / window.coil_height, 0, 1)
    density = window.breadth * force * np.minimum(1, math.pi * y / (2 * width)) / width
    step = window.height / y.size
    wanted = density[y < window.height / 2].sum(), density.sum(), (density * force).sum()
    assert window_leakage(window) == pytest.approx([v * step for v in wanted], rel=1e-6)


@pytest.mark.parametrize("gap", ["0.2 mm", "0.5 mm", "1 mm"])
@pytest.mark.parametrize(("end_effects", "error"), [(False, 0.07), (None, 0.15)])
def test_corrections_bring_the_equations_near_the_field(gap: str, end_effects: bool | None, error: float) -> None:
    """Depth and loss at 1.2 T: with fringes and leakage within 7 %, without them further off.

    Of the stack's ends the equations have those of the gap, so that less is left of them than without.
    """
    it = DesignEvaluator(requirement(force={"minimum": "150 N", "gap": gap}), end_effects)
    design = replace(EVEN, window_width=12e-3, yoke_thickness=5.3e-3)
    field = it.by_field(design).performance
    assert field is not None
    errors = {}
    for name, factors in (("corrected", None), ("plane", Factors()), ("plain", PLAIN)):
        by_hand = it.by_closed_form(design, factors=factors).performance
        assert by_hand is not None
        errors[name] = [by_hand.magnet.stack_depth / field.magnet.stack_depth - 1, by_hand.loss / field.loss - 1]
    worst = {name: np.abs(values).max() for name, values in errors.items()}
    assert worst["corrected"] < error
    assert worst["plain"] > 2 * worst["corrected"]
    if end_effects is None:
        assert worst["corrected"] < 0.7 * worst["plane"]


def test_first_guess_meets_the_requirement_by_the_equations() -> None:
    it = evaluator()
    guess = textbook_guess(it)
    evaluation = it.by_closed_form(guess)
    assert evaluation.violation < 1e-4, "but for rounding"
    found = evaluation.performance
    assert found is not None
    assert guess.return_width == pytest.approx(guess.pole_width / 2, abs=1e-5)
    assert guess.window_height == pytest.approx(WINDOW_ASPECT * guess.window_width, abs=3e-5)
    assert found.magnet.stack_depth == pytest.approx(STACK_ASPECT * guess.pole_width, rel=5e-3)
    assert found.current_density == pytest.approx(6e6, rel=5e-3), "the window is no larger than the heat asks for"


def test_forces_go_with_the_depth_and_nothing_else_does() -> None:
    it = evaluator()
    requirement = it.requirement
    once, tenfold = (
        unloaded(circuit, requirement.iron, gap=0.5e-3).loaded(it.irons, 1.2).point
        for circuit in (plain_magnet(EVEN, requirement, depth=depth).circuit for depth in (0.1, 1.0))
        if circuit is not None
    )
    assert tenfold.ampere_turns == pytest.approx(once.ampere_turns, rel=1e-12)
    assert [tenfold.force, tenfold.inductance] == pytest.approx([10 * once.force, 10 * once.inductance], rel=1e-12)
