"""Symmetric matrices on one pattern against dense ones."""

import numpy as np
import pytest

from msl_fem.errors import NotConverged
from msl_fem.magnetics.solver.tangent import SparseTangent

N, FREE = 12, np.array([0, 1, 3, 4, 5, 8, 9, 11])


def random_pieces(rng: np.random.Generator) -> tuple[list[tuple[np.ndarray, np.ndarray]], list[np.ndarray], np.ndarray]:
    """Places and values of a diagonal piece and of one with repeated entries, and their dense sum over all unknowns."""
    diagonal = np.arange(N)
    rows, columns = rng.integers(0, N, (2, 10, 6))
    places = [(diagonal, diagonal), (np.minimum(rows, columns), np.maximum(rows, columns))]
    values = [rng.uniform(20, 30, N), rng.uniform(-1, 1, rows.shape)]
    dense = np.zeros((N, N))
    for (row, column), value in zip(places, values, strict=True):
        np.add.at(dense, (row, column), value)
    return places, values, dense + np.triu(dense, 1).T


def assembled(seed: int = 0) -> tuple[SparseTangent, np.ndarray, np.ndarray]:
    places, values, dense = random_pieces(np.random.default_rng(seed))
    tangent = SparseTangent(FREE, N, places)
    return tangent, tangent.gather(0, values[0]) + tangent.gather(1, values[1]), dense


def test_gathered_pieces_factors_and_products_are_those_of_the_dense_matrix():
    tangent, data, dense = assembled()
    tangent.factor(data)
    right = np.random.default_rng(7).standard_normal(N)
    wanted = np.zeros(N)
    wanted[FREE] = np.linalg.solve(dense[np.ix_(FREE, FREE)], right[FREE])
    assert tangent.substitute(right) == pytest.approx(wanted, rel=1e-12)
    back = tangent.product(data, wanted)
    assert back[FREE] == pytest.approx(right[FREE], rel=1e-12)
    assert not np.delete(back, FREE).any()


def test_factors_of_a_near_matrix_serve_with_refinement():
    """One refinement squares the relative difference of the two matrices."""
    tangent, data, dense = assembled()
    tangent.factor(data * 1.001)
    right = np.ones(N)
    wanted = np.linalg.solve(dense[np.ix_(FREE, FREE)], right[FREE])
    plain = np.abs(tangent.substitute(right)[FREE] / wanted - 1).max()
    refined = np.abs(tangent.refined_substitute(right, data)[FREE] / wanted - 1).max()
    assert plain == pytest.approx(1e-3, rel=1e-2)
    assert refined == pytest.approx(1e-6, rel=1e-2)


def test_a_copy_has_factors_of_its_own():
    tangent, data, _ = assembled()
    tangent.factor(data)
    other = tangent.unfactored()
    other.factor(2 * data)
    right = np.ones(N)
    assert tangent.substitute(right) == pytest.approx(2 * other.substitute(right), rel=1e-14)


def test_a_singular_matrix_is_said_and_the_next_one_is_solved():
    tangent, data, _ = assembled()
    with pytest.raises(NotConverged, match="singular"):
        tangent.factor(0 * data)
    tangent.factor(data)
    assert np.isfinite(tangent.substitute(np.ones(N))).all()


@pytest.mark.parametrize("n", [1, 2, 7, 60, 400])
def test_factors_of_many_patterns_are_those_of_the_dense_matrix(n):
    """Grids, trees and single unknowns: fronts of every size, several roots, children taken in or not; many rights."""
    rng = np.random.default_rng(n)
    for far in (0, 1, 5, n // 3):
        rows = np.repeat(np.arange(n), 3)
        columns = rows + rng.integers(0, far + 1, rows.size)
        rows, columns = rows[columns < n], columns[columns < n]
        places = [(np.arange(n), np.arange(n)), (rows, columns)]
        values = [rng.uniform(12, 13, n), rng.uniform(-1, 1, rows.size)]
        tangent = SparseTangent(np.arange(n), n, places)
        dense = np.diag(values[0])
        np.add.at(dense, (rows, columns), values[1])
        dense = dense + np.triu(dense, 1).T
        tangent.factor(tangent.gather(0, values[0]) + tangent.gather(1, values[1]))
        rights = rng.standard_normal((3, n))
        found = tangent.substitute(rights)
        assert found == pytest.approx(np.linalg.solve(dense, rights.T).T, rel=1e-10, abs=1e-12)
        assert tangent.substitute(rights[1]) == pytest.approx(found[1], rel=1e-14)


def test_a_matrix_that_is_not_definite_has_factors_too():
    """L D L^T without exchanges: pivots may be below 0."""
    tangent, data, dense = assembled()
    shifted = dense[np.ix_(FREE, FREE)] - 25 * np.eye(FREE.size)
    assert np.linalg.eigvalsh(shifted)[0] < 0 < np.linalg.eigvalsh(shifted)[-1]
    identity = tangent.gather(0, np.ones(N))
    tangent.factor(data - 25 * identity)
    right = np.ones(N)
    assert tangent.substitute(right)[FREE] == pytest.approx(np.linalg.solve(shifted, right[FREE]), rel=1e-9)
