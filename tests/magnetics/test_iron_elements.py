"""Element vectors and matrices from reference tables against the plain sums over quadrature points."""

import numpy as np
import pytest
from field_problems import cubic_iron, structured_mesh
from skfem import Basis

from msl_fem.magnetics.solver.iron_elements import IronElements
from msl_fem.magnetics.solver.magnetostatics import ELEMENTS, FieldModel
from msl_fem.materials.material import load_iron

LINES = np.array([0.3, 0.5, 0.9, 1.0])


def crooked_model(order: int, *, axisymmetric: bool) -> FieldModel:
    """An iron of triangles of which no two are alike, off the axis."""
    mesh = structured_mesh(LINES, LINES, lambda x, y: "iron", gap=1.0)
    x, y = mesh.points
    mesh.points[:] = x + 0.1 * np.sin(3 * y), y + 0.1 * x**2
    return FieldModel(mesh, {"iron": cubic_iron()}, turns_density={}, order=order, axisymmetric=axisymmetric)


def terms_of(part: IronElements, potential: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The gradient of all unknowns, and each element's matrix (element, pair), added to a gradient and values of 0."""
    gradient, data = np.zeros(potential.size), np.zeros(part.pairs[0].size)
    part.add_terms(potential, np.arange(data.size, dtype=np.int32).reshape(part.pairs[0].shape), gradient, data)
    return gradient, data.reshape(part.pairs[0].shape)


@pytest.mark.parametrize("axisymmetric", [False, True])
@pytest.mark.parametrize("order", [2, 3, 4])
def test_vectors_and_matrices_are_the_plain_quadrature(order, axisymmetric):
    """The gradient of w(|B|) summed over points, and its second derivative nu I + (dH/dB - nu) n n^T."""
    model = crooked_model(order, axisymmetric=axisymmetric)
    part = model.irons["iron"]
    potential = 0.3 * np.random.default_rng(1).standard_normal(model.n_dof)
    basis = Basis(model.skfem_mesh, ELEMENTS[order](), intorder=2 * order)
    gradient = np.stack([basis.basis[k][0].grad for k in range(basis.Nbfun)])  # (local, 2, element, point)
    weight = basis.dx
    if axisymmetric:
        r = basis.global_coordinates()[0]
        gradient[:, 0] += np.stack([np.asarray(basis.basis[k][0]) for k in range(basis.Nbfun)]) / r
        weight = 2 * np.pi * r * weight
    flux_density = np.einsum("ae,acep->cep", potential[basis.element_dofs], gradient)
    size = np.hypot(*flux_density)
    h, slope = part.iron.magnetise(size)
    nu, unit = h / size, flux_density / size
    tensor = nu * np.eye(2)[:, :, None, None] + (slope - nu) * unit[:, None] * unit
    vectors = np.einsum("acep,cep,ep->ae", gradient, nu * flux_density, weight)
    wanted_vector = np.bincount(basis.element_dofs.ravel(), vectors.ravel())
    wanted = np.einsum("acep,cdep,bdep,ep->eab", gradient, tensor, gradient, weight, optimize=True)

    vector, matrix = terms_of(part, potential)
    assert np.abs(part.flux_density(potential)[0] - flux_density).max() < 1e-12 * size.max()
    assert np.abs(vector - wanted_vector).max() < 1e-12 * np.abs(wanted_vector).max()
    upper = np.triu_indices(basis.Nbfun)
    assert np.abs(matrix - wanted[:, upper[0], upper[1]]).max() < 1e-12 * np.abs(wanted).max()
    assert (part.dofs == basis.element_dofs.T).all()
    assert (part.pairs[0] == basis.element_dofs[upper[0]].T).all()
    assert (part.pairs[1] == basis.element_dofs[upper[1]].T).all()


def test_terms_are_added_where_they_belong():
    """To what is there, each entry at its place; an entry that belongs nowhere is left out."""
    part = crooked_model(2, axisymmetric=False).irons["iron"]
    potential = 0.3 * np.random.default_rng(4).standard_normal(part.dofs.max() + 1)
    vector, matrix = terms_of(part, potential)
    places = np.random.default_rng(5).integers(-1, 7, matrix.shape).astype(np.int32)
    gradient, data = np.ones(potential.size), np.ones(7)
    part.add_terms(potential, places, gradient, data)
    assert gradient == pytest.approx(1 + vector, rel=1e-12)
    wanted = [1 + matrix[places == k].sum() for k in range(7)]
    assert data == pytest.approx(wanted, rel=1e-12)


def test_next_to_no_field_the_iron_is_linear():
    """Down to nothing: vectors stay proportional to the potential, and the matrices are their slope."""
    part = crooked_model(2, axisymmetric=False).irons["iron"]
    direction = np.random.default_rng(2).standard_normal(part.dofs.max() + 1)
    vector, matrix = terms_of(part, 1e-8 * direction)
    for size in (1e-11, 1e-14, 1e-20):
        smaller, same = terms_of(part, size * direction)
        assert smaller / size == pytest.approx(vector / 1e-8, rel=1e-6, abs=1e-9 * np.abs(vector).max() / 1e-8)
        assert same == pytest.approx(matrix, rel=1e-6, abs=1e-9 * np.abs(matrix).max())
    none, initial = terms_of(part, 0 * direction)
    assert not none.any()
    assert initial == pytest.approx(matrix, rel=1e-6, abs=1e-9 * np.abs(matrix).max())


def test_another_iron_on_the_same_elements_is_its_own():
    """Nothing of the first iron's curve stays; the vector is the slope of the energy, beyond the last point as well."""
    part = crooked_model(2, axisymmetric=False).irons["iron"]
    potential = 0.1 * np.random.default_rng(3).standard_normal(part.dofs.max() + 1)
    for name in ("m19", "steel_1010"):
        part = part.with_iron(load_iron(name))
        b = part.flux_density(potential)[1]
        assert b.min() < part.iron.tail_from < b.max()
        step = 1e-6 * potential
        after, before = part.energies(np.stack([potential + step, potential - step]))
        change = after - before
        vector, _ = terms_of(part, potential)
        assert change / 2 == pytest.approx(float(vector @ step), rel=1e-7)
