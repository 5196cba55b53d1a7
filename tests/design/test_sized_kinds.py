"""Sizing of kinds other than the E-core: closed equations near the field, verified designs, the same command."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from sizing_requirements import evaluator

from msl_fem.actuator import Actuator, load_actuator
from msl_fem.design.sizing import Design, closed_search
from msl_fem.design.sizing.closed_form import Factors
from msl_fem.design.sizing.design import grown
from msl_fem.design.sizing.evaluation import NOT_BUILT, SOLVED, TRIM
from msl_fem.design.sizing.parameters import design_from, parameters_of, space_around
from msl_fem.errors import RequirementError
from msl_fem.magnetics.field.magnet_field import solve

Run = Callable[..., "Outcome"]  # noqa: F821 - the fixture's type, tests/conftest.py
U_CORE = Design(13e-3, 13e-3, 13e-3, 13e-3, 20e-3, 22e-3, 1.2, 150.0)
POT = Design(20.5e-3, 2.4e-3, 5.1e-3, 5e-3, 11.5e-3, 23e-3, 1.2, 150.0)
KINDS = pytest.mark.parametrize(("kind", "design", "off"), [("u-core", U_CORE, 0.01), ("pot-core", POT, 0.06)])
REQUIREMENT = """
schema = 1
name = "{kind}"
objectives = ["mass"]
[magnet]
kind = "{kind}"
[force]
minimum = "150 N"
gap = "0.5 mm"
[heat]
current_density = "6 A/mm^2"
"""


@KINDS
def test_closed_equations_of_a_kind_are_near_its_field(kind: str, design: Design, off: float) -> None:
    """Force and magnetomotive force at 1.2 T; without fringes and leakage at least twice as far off."""
    it = evaluator(magnet={"kind": kind})
    errors = {}
    for name, factors in (("corrected", None), ("plain", Factors(fringing=False, leakage=False))):
        point = it.circuit(design, factors=factors).point
        field = it.point_by_field(design, point.ampere_turns).point
        errors[name] = [point.force / field.force - 1, point.ampere_turns / field.ampere_turns - 1]
    assert np.abs(errors["corrected"]).max() < off
    assert np.abs(errors["plain"]).max() > 2 * np.abs(errors["corrected"]).max()


@KINDS
def test_a_design_of_a_kind_is_what_solve_says(kind: str, design: Design, off: float) -> None:
    del off
    it = evaluator(magnet={"kind": kind})
    evaluation = it.by_field(design)
    assert evaluation.stage == SOLVED
    found = evaluation.performance
    assert found is not None
    assert found.magnet.turns % it.requirement.sized.coils == 0
    alone = Actuator.model_validate({"schema": 1, "name": "x", "magnet": found.magnet})
    quantities = solve(alone, found.current, 0.5e-3, accuracy="fast").quantities
    assert quantities.force == pytest.approx(found.force, rel=1e-3)
    assert quantities.incremental_inductance == pytest.approx(found.inductance, rel=1e-3)
    assert 150.0 <= found.force <= 150.0 * (1 + 2 * TRIM)
    assert max(part.mean for part in quantities.flux_density.values()) == pytest.approx(found.flux_density, rel=1e-3)
    assert found.flux_density <= 1.2
    assert found.masses.core == pytest.approx(7650 * iron_volume(found.magnet, "core"))


def iron_volume(magnet: object, region: str) -> float:
    """m3 by hand, with the stacking factor."""
    content = magnet.model_dump()  # type: ignore[attr-defined]
    height, yoke, window = (content[f"{name}"] for name in ("window_height", "yoke_thickness", "window_width"))
    assert region == "core"
    if content["kind"] == "u-core":
        leg = content["leg_width"]
        return float(0.96 * content["stack_depth"] * (2 * leg * height + (2 * leg + window) * yoke))
    post, ring = content["post_diameter"] / 2, content["ring_width"]
    outside = post + window + ring
    round_ = post**2 + outside**2 - (post + window) ** 2
    return float(0.96 * np.pi * (round_ * height + outside**2 * yoke))


@KINDS
def test_parameters_give_a_design_back(kind: str, design: Design, off: float) -> None:
    """What a search varies stands for a design: from it to the parameters and back within a share of a per cent."""
    del off
    it = evaluator(magnet={"kind": kind})
    space = space_around(design, it)
    centre = {name: np.sqrt(span.low * span.high) for name, span in space.spans.items()}
    first = design_from(centre, space, it)
    again = design_from(parameters_of(first, space, it), space, it)
    for name in ("pole_width", "yoke_thickness", "armature_thickness", "window_width", "window_height"):
        assert getattr(again, name) == pytest.approx(getattr(first, name), rel=1e-2), name
    assert it.circuit(first).point.force == pytest.approx(first.force, rel=0.02) or kind == "u-core"


def test_a_pot_that_outgrows_its_envelope_is_not_built() -> None:
    """The closed equations' pot is just inside; the one with the force by the field is not."""
    width = 2 * (POT.pole_width / 2 + POT.window_width + POT.return_width)
    thin = grown(POT, 0.9)
    it = evaluator(magnet={"kind": "pot-core"}, envelope={"width": f"{width - 1e-3} m"})
    evaluation = it.by_field(thin)
    assert evaluation.stage == NOT_BUILT
    assert [c.name for c in evaluation.constraints if not c.kept] == ["envelope_width"]
    assert evaluation.solves > 0, "the field was what asked for more iron"


def test_a_u_core_s_box_holds_its_outer_coil_sides() -> None:
    it = evaluator(magnet={"kind": "u-core"}, envelope={"width": "40 mm"})
    broken = {c.name: c.value for c in it.by_field(U_CORE).constraints if not c.kept}
    coil = U_CORE.window_width / 2 - 2e-3
    assert broken == {"envelope_width": pytest.approx(2 * (10e-3 + 13e-3 + 1e-3 + coil))}
    assert "coil_width" in {c.name for c in it.by_field(replace(U_CORE, window_width=4e-3)).constraints if not c.kept}


def test_a_kind_that_states_no_closed_equations_is_one_line() -> None:
    with pytest.raises(RequirementError, match="'plunger' cannot be sized; choose one of e-core, u-core, pot-core"):
        evaluator(magnet={"kind": "plunger"})


@pytest.mark.parametrize("kind", ["u-core", "pot-core"])
def test_size_makes_an_actuator_of_the_kind(
    msl_fem: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    """Few trials by the command: the written file solves to the stated force at fine accuracy, below the flux limit.

    They begin with a design that the closed equations have looked for shortly.
    """
    monkeypatch.setattr(closed_search, "_EVALUATIONS", 60)
    file, target = tmp_path / "r.toml", tmp_path / "g.toml"
    file.write_text(REQUIREMENT.format(kind=kind))
    said = msl_fem("size", str(file), "-o", str(target), "--trials", "2", "--workers", "1", "--json").json
    assert said["trials"] == 2
    assert said["field_solutions"] >= 2
    assert said["mass_kg"] <= said["first_guess"]["mass_kg"]
    assert all(constraint["margin"] >= -1e-9 * abs(constraint["limit"]) for constraint in said["constraints"])
    actuator = load_actuator(target)
    assert actuator.magnet is not None
    assert actuator.magnet.kind == kind
    point = solve(actuator, said["current_A"], 0.5e-3, accuracy="fine").quantities
    assert point.force == pytest.approx(said["force_N"], rel=1e-6)
    assert point.force >= 150.0
    assert max(section.mean for section in point.flux_density.values()) <= 1.2
    assert (said["stack_depth_m"] is None) == (kind == "pot-core")
