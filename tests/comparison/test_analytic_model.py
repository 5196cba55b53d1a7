"""The textbook's circuit: Maxwell's pull, its own derivatives, and how far a field solution is from it."""

import numpy as np
import pytest
from conftest import ROOT

from msl_fem.actuator import load_actuator
from msl_fem.comparison.models import LinearCircuit, circuit_fitted, circuit_of, reluctance_table
from msl_fem.magnetics.field.magnet_field import solve
from msl_fem.materials.constants import MU_0
from msl_fem.materials.material import laminated, linear_iron, load_iron
from msl_fem.table.magnetic_table import read_table

GAP, CURRENT = np.geomspace(0.1e-3, 1e-3, 25), np.linspace(0, 5, 6)


@pytest.fixture(scope="module")
def magnet():
    return load_actuator(ROOT / "geometries" / "e1.toml").magnet


def test_with_ideal_iron_it_is_maxwells_pull(magnet) -> None:
    """F = B^2 (A_c + 2 A_o)/(2 mu_0) with the same B in both gaps, where A_c = 2 A_o."""
    ideal = linear_iron(1e9)
    table = reluctance_table(circuit_of(magnet, ideal, ideal), GAP, CURRENT)
    area = magnet.centre_leg_width * magnet.stack_depth
    b = MU_0 * magnet.coil.turns * 3.0 / (2 * 0.4e-3)
    assert float(table.force(3.0, 0.4e-3)) == pytest.approx(b**2 * 2 * area / (2 * MU_0), rel=1e-4)
    assert float(table.flux_linkage(3.0, 0.4e-3)) == pytest.approx(magnet.coil.turns * b * area, rel=1e-4)


def test_iron_of_finite_permeability_is_a_longer_gap(magnet) -> None:
    """Halving mu_r doubles the offset; core and armature add up."""
    offset = [
        circuit_of(magnet, linear_iron(m), linear_iron(a)).offset for m, a in ((1e3, 1e3), (500, 500), (1e3, 1e9))
    ]
    assert offset[1] == pytest.approx(2 * offset[0], rel=1e-6)
    assert 0.5 * offset[0] < offset[2] < offset[0]


def test_its_nodes_are_derivatives_of_its_coenergy() -> None:
    table = reluctance_table(LinearCircuit(1.2e-5, 2e-5), GAP, CURRENT)
    step = 1e-6 * GAP[12]
    ahead, behind = (float(table.evaluate(3.3, GAP[12] + s)["coenergy"]) for s in (step, -step))
    assert float(table.force(3.3, GAP[12])) == pytest.approx((behind - ahead) / (2 * step), rel=1e-5)
    assert float(table.evaluate(3.3, GAP[12])["force_gap_slope"]) < 0


def test_a_fit_finds_the_circuit_again() -> None:
    true = LinearCircuit(1.2e-5, 2e-5)
    found = circuit_fitted(reluctance_table(true, GAP, CURRENT))
    assert (found.scale, found.offset) == pytest.approx((true.scale, true.offset), rel=1e-5)


def test_a_field_solution_is_above_it_by_fringe_and_leakage(magnet) -> None:
    """At 1 A the iron is straight: more flux linkage by leakage, and a force within some percent."""
    actuator = load_actuator(ROOT / "geometries" / "e1.toml")
    iron = laminated(load_iron("analytic:e1"), 1.0)
    table = reluctance_table(circuit_of(magnet, iron, iron), GAP, CURRENT)
    fresh = solve(actuator, 1.0, 0.5e-3).quantities
    assert 1.02 < fresh.flux_linkage / float(table.flux_linkage(1.0, 0.5e-3)) < 1.45
    assert 0.9 < fresh.force / float(table.force(1.0, 0.5e-3)) < 1.2


def test_the_reference_actuators_table_is_near_its_circuit_at_small_currents() -> None:
    actuator = load_actuator(ROOT / "geometries" / "fast_tool_servo.toml")
    magnet, table = actuator.magnet, read_table(ROOT / "lookup_tables" / "fast_tool_servo.nc")
    core = laminated(load_iron(magnet.iron.core), magnet.iron.core_stacking)
    small, gap = 0.5, 0.3e-3
    for circuit, off in ((circuit_of(magnet, core, core), 0.25), (circuit_fitted(table), 0.1)):
        simple = reluctance_table(circuit, table.gap, table.current)
        assert float(simple.flux_linkage(small, gap)) == pytest.approx(float(table.flux_linkage(small, gap)), rel=off)
