"""Tables of made magnets from the nominal one's reduced field, against their fields in full."""

from dataclasses import replace

import numpy as np
import pytest
from small_magnets import HERE, job, nominal_of

from msl_fem.actuator import Actuator
from msl_fem.computing.row_cache import Arrays
from msl_fem.design.tolerances.made_tables import MadeTables, nodes_of
from msl_fem.design.tolerances.manufactured import NAMES, manufactured_field, tolerances_of
from msl_fem.design.tolerances.sensitivity import ManufacturedMagnet, ManufacturingSolver
from msl_fem.design.tolerances.study import by_children, direct_band, draw
from msl_fem.magnetics.reduced.family import Family, Member
from msl_fem.magnetics.reduced.full_field import FullField
from msl_fem.magnetics.solver.magnetostatics import FieldModel

GAP = 0.4e-3
NOMINAL = replace(nominal_of("fast_tool_servo", GAP), accuracy="fast")
JOB = job(NOMINAL, GAP, current=3.0, levels=(1.2, 1.5), sections=("centre_leg", "outer_leg"))


@pytest.fixture(scope="module")
def solver(servo: Actuator) -> ManufacturingSolver:
    """Of magnets within the default tolerances, by the reduced field."""
    return by_children(replace(JOB, tables=True), tolerances_of(servo)).solver()


def both_ways(solver: ManufacturingSolver, deviations: list[dict[str, float]]) -> tuple[list[Arrays], list[Arrays]]:
    """The answers for made magnets by the reduced field, where it holds, and in full."""
    rows = [ManufacturedMagnet(tuple(d.get(name, 0.0) for name in NAMES), False) for d in deviations]
    full = replace(solver.job, limits=None).solver()
    return [solver.solve(row) for row in rows], [full.solve(row) for row in rows]


def test_a_moved_model_is_that_of_the_moved_mesh() -> None:
    """Residual, tangent, source and energy, to the last bits."""
    field = manufactured_field(NOMINAL, {})
    section = field.section
    points = field.model.mesh.points * np.array([[1.01], [0.98]])
    moved = field.model.moved(points, section.turns_density)
    new = FieldModel(
        replace(field.model.mesh, points=points), field.irons, turns_density=section.turns_density, order=field.order
    )
    a = np.zeros(new.n_dof)
    a[new.free] = 1e-3 * np.random.default_rng(0).normal(size=new.free.size)
    for one, other in zip(moved.assemble(a, 3e-4), new.assemble(a, 3e-4), strict=True):
        assert one == pytest.approx(other, rel=1e-12, abs=1e-12 * np.abs(other).max())
    assert np.array_equal(moved.source, new.source)
    assert moved.energy(a, 3e-4) == pytest.approx(new.energy(a, 3e-4), rel=1e-12)


def test_made_tables_are_those_of_the_fields_in_full(solver: ManufacturingSolver, servo: Actuator) -> None:
    """Two routes, three magnets: force and flux linkage of full scale, the levels' currents, within what is stated."""
    drawn = draw(tolerances_of(servo), 3, 11)
    found, full = both_ways(solver, drawn)
    for reduced, exact in zip(found, full, strict=True):
        assert "table_error" in reduced
        assert "table_error" not in exact
        for name in ("table_force", "table_flux_linkage"):
            off = np.abs(reduced[name] - exact[name]).max() / exact[name].max()
            assert off < min(reduced["table_error"], 1.2e-4)
        assert reduced["current"] == pytest.approx(exact["current"], rel=1e-3)
        for name in ("force", "flux_linkage"):
            assert reduced[name] == pytest.approx(exact[name], rel=3e-4)
    assert np.std([row["table_force"][0, -1] for row in full]) > 5e-3 * full[0]["table_force"][0, -1], "they differ"


def test_a_magnet_that_its_parent_does_not_span_is_solved_in_full(solver: ManufacturingSolver) -> None:
    """A centre leg far narrower saturates elsewhere: no certificate, and the answer is the full field's."""
    far = {"centre_leg_width": -3.5e-3, "yoke_thickness": -2e-3, "bh_polarisation": -0.3}
    (found,), (full,) = both_ways(solver, [far])
    assert "table_error" not in found
    assert np.array_equal(found["table_force"], full["table_force"])


def test_a_childs_force_and_flux_are_derivatives_of_one_coenergy(solver: ManufacturingSolver) -> None:
    """dF/di = -dlambda/dg to rounding, in the child's space as in the parent's."""
    assert solver._tables is not None
    family: Family | None = solver._tables.family
    assert family is not None
    field = manufactured_field(NOMINAL, {"centre_leg_width": 8e-5, "stack_depth": 3e-4})
    child = family.child(Member(FullField(field.model, [field.model.source])), np.arange(len(family.points)))
    force_slope = child.states.energy_slope_by_current[:, 0]
    flux_slope = child.states.by_coordinate @ child.model.sources[0]
    assert force_slope == pytest.approx(-flux_slope, rel=1e-9, abs=1e-9 * np.abs(flux_slope).max())


def test_a_family_learns_where_its_parent_is_not_enough(servo: Actuator) -> None:
    """Wide limits: the states of the magnets it learns from enter the space, and others within then hold."""
    limits = {"centre_leg_width": 1e-3, "armature_thickness": 5e-4, "bh_polarisation": 0.05}
    known = manufactured_field(NOMINAL, {})

    def made(deviation):  # type: ignore[no-untyped-def]
        return manufactured_field(NOMINAL, deviation, known)

    nodes = nodes_of(known, [GAP], (1.2, 1.5), most=100.0, current=3.0)
    settings = {"most": 100.0, "point": (3.0, GAP), "tolerance": 2e-4}
    narrow = MadeTables(made, dict.fromkeys(limits, 0.0), nodes, **settings).family
    wide = MadeTables(made, limits, nodes, **settings).family
    assert narrow is not None
    assert wide is not None
    assert wide.parent.solutions > narrow.parent.solutions


def test_the_band_of_tables_holds_that_of_the_point(solver: ManufacturingSolver, servo: Actuator) -> None:
    """Which magnets lie just within the tolerance depends on last bits, and so on the processor; most of them do."""
    band = direct_band(solver.job, tolerances_of(servo), HERE, samples=20, seed=4)
    table = band.table
    assert table is not None
    assert 15 <= table.certified <= 20
    assert table.error_estimate < 5e-4
    low, high = (np.interp(3.0, table.current, side[0]) for side in table.force)
    assert (low, high) == pytest.approx(band.force, rel=2e-2)
    assert (table.flux_linkage[0] < table.flux_linkage[1]).all()
