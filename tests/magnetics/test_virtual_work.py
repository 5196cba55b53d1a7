"""Force and torque on a moving body: the exact derivative of the discrete energy, and Maxwell's stress around it."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import ROOT

from msl_fem.actuator import load_actuator
from msl_fem.errors import InputError
from msl_fem.magnetics.field.magnet_field import field_of
from msl_fem.magnetics.field.two_sided import TwoSidedField
from msl_fem.magnetics.field.two_sided_section import TwoSidedPosition
from msl_fem.magnetics.solver.magnetostatics import FieldModel, solve_field
from msl_fem.magnetics.solver.virtual_work import MovingBody, displacement_share
from msl_fem.magnetics.triangles import boundary_points, hat_gradients

E1 = load_actuator(ROOT / "geometries" / "e1.toml")
AIR = ("air", "strip", "window")


@pytest.fixture(scope="module")
def tilted():
    """A full section without symmetry, its model driven by both coils, and the field."""
    field = TwoSidedField(E1, TwoSidedPosition(4e-4, 6e-4, 5e-3), accuracy="fast")
    densities = {"coil_1+": 6e6, "coil_1-": -6e6, "coil_2+": -3e6, "coil_2-": 3e6}
    model = field.model.with_turns(densities)
    return field, model, solve_field(model, 1.0, model.mesh.gap), densities


def velocity(kind: str, field: TwoSidedField) -> np.ndarray:
    x, y = field.model.mesh.points - np.array(field.plan.centre)[:, None]
    one, zero = np.ones_like(x), np.zeros_like(x)
    return {"x": np.stack([one, zero]), "y": np.stack([zero, one]), "torque": np.stack([-y, x])}[kind]


def moved(field: TwoSidedField, kind: str, step: float, densities: dict[str, float]) -> FieldModel:
    """The same irons and turns with the armature moved by a step and the air's mesh following."""
    mesh = field.model.mesh
    points = mesh.points + step * field.body.share * velocity(kind, field)
    irons = {name: part.iron for name, part in field.model.irons.items()}
    return FieldModel(replace(mesh, points=points), irons, turns_density=densities, order=field.model.order)


@pytest.mark.parametrize(("current", "gap"), [(2.0, 5e-4), (12.0, 1e-4), (5.0, 1e-3)])
def test_both_routes_agree_with_the_strip(current, gap):
    """The strip's force is exact too, with another displacement: they differ by the discretisation alone."""
    field = field_of(E1, gap)
    solution = field.solve(current, gap)
    body = MovingBody(field.model, ("armature",), air=AIR, symmetry="x=0")
    depth = 2 * E1.magnet.stack_depth
    want = field.quantities(solution).force
    assert depth * body.force(solution.potential).y == pytest.approx(want, rel=3e-4)
    assert depth * body.force_stress_tensor(solution.potential).y == pytest.approx(want, rel=1e-3)


@pytest.mark.parametrize(("kind", "step"), [("x", 2e-8), ("y", 2e-8), ("torque", 1e-6)])
def test_force_is_the_derivative_of_the_discrete_energy(tilted, kind, step):
    """F = -dW/ds with the nodal potentials held, to the finite difference's own error."""
    field, model, solution, densities = tilted
    a = solution.potential
    high, low = (moved(field, kind, s, densities).energy(a, model.mesh.gap) for s in (step, -step))
    got = getattr(field.body.force(a), kind)
    assert got == pytest.approx(-(high - low) / (2 * step), rel=1e-6)


def test_force_is_the_slope_of_the_coenergy_of_solved_fields(tilted):
    """F = dW'/ds at constant current, fields solved again on either side."""
    field, _, solution, densities = tilted
    coenergy = []
    step = 1e-6
    for s in (step, -step):
        there = moved(field, "y", s, densities)
        a = solve_field(there, 1.0, there.mesh.gap).potential
        coenergy.append(float(there.source @ a) - there.energy(a, there.mesh.gap))
    assert field.body.force(solution.potential).y == pytest.approx((coenergy[0] - coenergy[1]) / (2 * step), rel=1e-4)


def test_stress_tensor_gives_force_and_torque(tilted):
    field, _, solution, _ = tilted
    work, stress = field.body.force(solution.potential), field.body.force_stress_tensor(solution.potential)
    assert stress.y == pytest.approx(work.y, rel=3e-3)
    assert stress.x == pytest.approx(work.x, abs=3e-3 * abs(work.y))
    assert stress.torque == pytest.approx(work.torque, rel=2e-2)


def test_displacement_falls_from_the_body_to_what_stands_still(tilted):
    field = tilted[0]
    mesh, share = field.model.mesh, field.body.share
    assert set(share[mesh.triangles[:, mesh.elements("armature")]].ravel()) == {1.0}
    assert set(share[mesh.triangles[:, mesh.elements("core_1", "core_2", "coil_1+", "coil_2-")]].ravel()) == {0.0}
    assert share.min() > -1e-12
    assert share.max() < 1 + 1e-12
    assert set(share[boundary_points(mesh)]) == {0.0}
    in_gap = share[np.unique(mesh.triangles[:, mesh.elements("gap")])]
    assert np.count_nonzero((in_gap > 0.05) & (in_gap < 0.95)) > 20


def test_air_slides_along_the_symmetry_line():
    """Between armature and core on x = 0 the share is neither 0 nor 1; without the symmetry the line holds it."""
    mesh = field_of(E1, 5e-4, accuracy="fast").model.mesh
    share = displacement_share(mesh, ("armature",), air=AIR, symmetry="x=0")
    below = (mesh.points[0] == 0) & (mesh.points[1] < -7e-3) & (mesh.points[1] > -49e-3)
    assert np.all((share[below] > 0) & (share[below] < 1))
    with pytest.raises(InputError, match="touches what stands still"):
        displacement_share(mesh, ("armature",), air=AIR)


def test_hat_gradients_reproduce_a_linear_function(tilted):
    mesh = tilted[1].mesh
    values = (3 * mesh.points[0] - 2 * mesh.points[1])[mesh.triangles]
    slope = np.einsum("ce,cje->je", values, hat_gradients(mesh))
    np.testing.assert_allclose(slope, np.array([[3.0], [-2.0]]) * np.ones(slope.shape[1]), rtol=1e-6)


def test_a_body_without_air_around_is_refused(tilted):
    mesh = tilted[1].mesh
    with pytest.raises(InputError, match=r"armature \+ gap touches what stands still, at x = "):
        displacement_share(mesh, ("armature", "gap"), air=("air", "window"))
    with pytest.raises(InputError, match="no region plunger; its regions are air, gap"):
        displacement_share(mesh, ("plunger",), air=("air", "gap", "window"))
