"""Loops in the place of numpy's own assignments and products, for compiled functions."""

from typing import Any

import numpy as np

from msl_fem.computing import copied_rows

LOOPS: Any = copied_rows


def test_loops_give_what_numpy_gives() -> None:
    chance = np.random.default_rng(3)
    a, b, m, p = (chance.standard_normal(shape) for shape in ((3, 4), (3, 2), (3, 4), (4, 4)))
    x, y, target = chance.standard_normal(4), chance.standard_normal(2), np.empty(3)
    LOOPS.set_combined.py_func(target, a, x, b, y)
    np.testing.assert_allclose(target, a @ x + b @ y, rtol=1e-13)
    found = np.empty((3, 3))
    LOOPS.set_congruent.py_func(found, m, p, np.empty((3, 4)))
    np.testing.assert_allclose(found, m @ p @ m.T, rtol=1e-12, atol=1e-14)
    square, expected = p.copy(), p[:, :] @ p @ p.T
    LOOPS.set_congruent.py_func(square, p, square, np.empty((4, 4)))  # the target may be P
    np.testing.assert_allclose(square, expected, rtol=1e-12, atol=1e-13)
    LOOPS.copy_into.py_func(target, x[1:])
    assert target.tolist() == x[1:].tolist()
    once = x[1:].astype(np.float32)
    LOOPS.add_times.py_func(target, once, 0.5)
    np.testing.assert_allclose(target, 1.5 * x[1:], rtol=1e-6)
