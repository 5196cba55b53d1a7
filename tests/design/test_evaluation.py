"""Designs judged: what cannot be built costs no field solution; what can be is what `solve` says it is."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from sizing_requirements import envelope, evaluator

from msl_fem.actuator import Actuator
from msl_fem.design.sizing import Design, DesignEvaluator
from msl_fem.design.sizing import evaluation as evaluation_module
from msl_fem.design.sizing.choice import sized_actuator
from msl_fem.design.sizing.design import SectionPoint, wound
from msl_fem.design.sizing.evaluation import NOT_BUILT, SOLVED
from msl_fem.design.sizing.masses import masses
from msl_fem.magnetics.field.magnet_field import solve

GOOD = Design(14e-3, 7e-3, 7e-3, 7e-3, 16e-3, 28e-3, 1.2, 150.0)


@pytest.fixture
def no_field(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*args: Any, **more: Any) -> None:
        raise AssertionError("a field was solved")

    monkeypatch.setattr(evaluation_module, "field_point", refuse)
    monkeypatch.setattr(evaluation_module, "stack_point", refuse)


@pytest.mark.usefixtures("no_field")
@pytest.mark.parametrize(
    ("design", "room", "name", "value"),
    [
        (replace(GOOD, window_width=1.5e-3), {}, "coil_width", -0.5e-3),
        (replace(GOOD, window_height=2e-3), {}, "coil_height", -1e-3),
        (replace(GOOD, window_width=-1e-3), {}, "coil_width", -3e-3),
        (GOOD, envelope("50 mm", "1 m", "1 m"), "envelope_width", 60e-3),
        (GOOD, envelope("1 m", "30 mm", "1 m"), "envelope_height", 42.5e-3),
        (GOOD, envelope("1 m", "1 m", "20 mm"), "envelope_depth", 30.01e-3),
        (replace(GOOD, pole_width=1e-6, return_width=1e-6), {}, "smallest_length", 1e-6),
        (replace(GOOD, pole_width=20.0), {}, "largest_length", 20.0),
    ],
)
def test_what_cannot_be_built_is_never_solved(design: Design, room: dict[str, Any], name: str, value: float) -> None:
    evaluation = evaluator(**room).by_field(design)
    assert evaluation.stage == NOT_BUILT
    assert not evaluation.feasible
    assert evaluation.solves == 0
    broken = {c.name: c for c in evaluation.constraints if not c.kept}
    assert broken[name].value == pytest.approx(value, rel=1e-6), "its size is recorded"
    assert evaluation.violation > 0


@pytest.mark.usefixtures("no_field")
def test_far_too_deep_a_stack_is_never_solved() -> None:
    """The closed equations alone refuse it: 150 N need a stack much deeper than 2 mm."""
    evaluation = evaluator(**envelope("1 m", "1 m", "32 mm")).by_field(GOOD)
    assert [c.name for c in evaluation.constraints if not c.kept] == ["envelope_depth"]
    assert evaluation.solves == 0


@pytest.mark.parametrize("ends", [False, None])
def test_a_design_is_what_solve_says(ends: bool | None) -> None:
    """The written magnet at the stated current: the wanted force, and the flux density that was aimed at."""
    it = replace(evaluator(), end_effects=ends)
    evaluation = it.by_field(GOOD, accuracy="normal")
    assert evaluation.stage == SOLVED
    assert evaluation.feasible, evaluation.constraints
    assert 1 <= evaluation.solves <= 5
    found = evaluation.performance
    assert found is not None
    written = sized_actuator(found, it.requirement, target=Path("x.toml"), end_effects=ends)
    assert written.end_effects == ("none" if ends is False else "section")
    point = solve(written, found.current, 0.5e-3, accuracy="normal")
    assert point.quantities.force == pytest.approx(found.force, rel=1e-6)
    assert 150.0 <= found.force < 150.0 * (1 + 1.4e-5 / found.magnet.stack_depth), (
        "a step of the grid; ends do not grow"
    )
    largest = max(section.mean for section in point.quantities.flux_density.values())
    assert largest == pytest.approx(found.flux_density, rel=1e-6)
    assert 1.2 * (1 - 1e-3) < found.flux_density <= 1.2
    assert point.quantities.incremental_inductance == pytest.approx(found.inductance, rel=1e-6)


def test_ends_take_a_part_of_the_force_so_that_the_stack_is_deeper() -> None:
    """150 N at 1.2 T and 0.5 mm take a third more of the stack; a design of a search is near the one of its field."""
    plane, ends = (replace(evaluator(), end_effects=wanted) for wanted in (False, None))
    flat, found = plane.by_field(GOOD).performance, ends.by_field(GOOD).performance
    assert flat is not None
    assert found is not None
    assert 1.25 < found.magnet.stack_depth / flat.magnet.stack_depth < 1.4
    point = solve(Actuator(schema=1, name="x", magnet=found.magnet), found.current, 0.5e-3, accuracy="fast")
    assert point.quantities.force == pytest.approx(found.force, rel=1e-3)
    assert plane.digest != ends.digest


def test_less_flux_density_is_more_iron_and_less_loss() -> None:
    it = evaluator()
    hard, soft = (it.by_field(replace(GOOD, flux_density=b)).performance for b in (1.2, 0.9))
    assert hard is not None
    assert soft is not None
    assert soft.magnet.stack_depth > 1.5 * hard.magnet.stack_depth
    assert soft.loss < hard.loss
    assert soft.masses.total > hard.masses.total
    assert soft.force == pytest.approx(hard.force, rel=2e-3)


def test_turns_are_the_fewest_that_the_supply_drives() -> None:
    it = evaluator(supply={"current": "3 A"})
    found = it.by_closed_form(GOOD).performance
    assert found is not None
    ampere_turns = it.circuit(GOOD).point.ampere_turns
    assert found.current <= 3.0 < ampere_turns / (found.magnet.coil.turns - 1)
    assert found.loss == pytest.approx(found.resistance * found.current**2)


def test_a_stated_wire_fixes_the_turns() -> None:
    it = evaluator(winding={"wire_diameter": "0.5 mm"}, supply={"current": "0.7 A"})
    evaluation = it.by_closed_form(GOOD)
    found = evaluation.performance
    assert found is not None
    coil = found.magnet.coil
    copper = coil.turns * 3.14159265 / 4 * 0.5e-3**2
    assert copper <= 0.5 * found.magnet.winding_space.area < copper + 2e-7
    assert coil.fill_factor == pytest.approx(copper / found.magnet.winding_space.area)
    assert [c.name for c in evaluation.constraints if not c.kept] == ["current"]


def test_slew_rate_is_what_the_voltage_drives() -> None:
    """dF/dt = dF/di (V - R i)/L, by hand."""
    it = evaluator(supply={"voltage": "20 V", "current": "5 A"}, sides={"count": 2, "magnets_per_side": 2})
    point = SectionPoint(1000.0, 5e3, 9.0, 2e-5, 1.2, "yoke")
    found = wound(GOOD, point, it.requirement, depth=30e-3)
    turns = 200
    assert found.magnet.coil.turns == turns
    wanted = 9.0 * 30e-3 * turns * (10.0 - found.resistance * 5.0) / (turns**2 * 2e-5 * 30e-3)
    assert found.slew_rate == pytest.approx(wanted)


@pytest.mark.parametrize(
    ("change", "name"),
    [
        ({"heat": {"current_density": "1 A/mm^2"}}, "current_density"),
        ({"heat": {"temperature_rise": "1 K"}}, "temperature_rise"),
        ({"supply": {"voltage": "0.1 V", "current": "2 A"}}, "voltage"),
        ({"force": {"minimum": "150 N", "gap": "0.5 mm", "slew_rate": "1e9 N/s"}}, "force_slew_rate"),
        ({"flux": {"limit": "1.1 T"}}, None),
    ],
)
def test_each_limit_is_a_constraint(change: dict[str, Any], name: str | None) -> None:
    """A flux limit is no constraint that a design breaks: the iron works at most that hard."""
    broken = [c.name for c in evaluator(**change).by_field(GOOD).constraints if not c.kept]
    assert broken == ([] if name is None else [name])


def test_masses_by_hand() -> None:
    it = evaluator(densities={"core": "7000 kg/m^3", "armature": "8000 kg/m^3", "copper": "9000 kg/m^3"})
    found = it.by_closed_form(GOOD).performance
    assert found is not None
    magnet, depth = found.magnet, found.magnet.stack_depth
    weighed = masses(magnet, it.requirement.densities)
    core = (60e-3 * 35e-3 - 2 * 16e-3 * 28e-3) * depth * 0.96 * 7000
    turn = 2 * (depth + 14e-3) + 2 * 3.14159265 * 8e-3
    assert weighed.core == pytest.approx(core)
    assert weighed.armature == pytest.approx(60e-3 * 7e-3 * depth * 0.96 * 8000)
    assert weighed.copper == pytest.approx(0.5 * 14e-3 * 25e-3 * turn * 9000)
    assert weighed.total == pytest.approx(weighed.core + weighed.armature + weighed.copper)


def test_a_judge_can_be_sent_elsewhere() -> None:
    import pickle

    it: DesignEvaluator = pickle.loads(pickle.dumps(evaluator()))
    assert it.by_closed_form(GOOD) == evaluator().by_closed_form(GOOD)
