"""Newton's iteration in a reduced space, point after point; what goes over the quadrature is compiled."""

from typing import NamedTuple

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.computing.compiled import compiled
from msl_fem.computing.splines import hermite_cubic
from msl_fem.materials.curves import NO_FIELD, Curves, Indices, magnetise_at

ACCEPTED = 1e-6  # relative energy norm of the last of Newton's steps, after which its square is left
SAME_WAY = 1e-9  # of a step of the currents
MOST_STEPS, MOST_TRIALS = 60, 30


class ReducedIron(NamedTuple):
    """Quadrature of the irons' energy in a reduced space of N functions.

    Attributes
    ----------
    gradients : (2 n_point, N) both derivatives of each function, point after point; their size is |B|
    weight : (n_point,) positive
    iron : (n_point,) which of the curves
    """

    gradients: Array
    weight: Array
    iron: Indices
    curves: Curves


@compiled
def assemble_iron(field: Array, iron: ReducedIron, force: Array, root: Array) -> None:
    """The iron's part of the gradient, G^T force, and of the tangent, root^T root; both (2 n_point, ...) are written.

    `field` (2 n_point,) is the state's gradient.

    With n = B/|B|, t across it: T = dH/dB n n^T + H/B t t^T, both positive, so that the tangent is a sum of squares.
    """
    curves = iron.curves
    for q in range(iron.weight.size):
        x, y = field[2 * q], field[2 * q + 1]
        b = np.sqrt(x * x + y * y)
        h, slope = magnetise_at(b, iron.iron[q], curves.start, curves.b, curves.h, curves.slope, curves.tail)
        nu = slope
        x_n, y_n = 1.0, 0.0
        if b > NO_FIELD:
            nu = h / b
            x_n, y_n = x / b, y / b
        w = iron.weight[q]
        force[2 * q], force[2 * q + 1] = w * nu * x, w * nu * y
        along, across = np.sqrt(w * slope), np.sqrt(w * nu)
        for j in range(root.shape[1]):
            g_x, g_y = iron.gradients[2 * q, j], iron.gradients[2 * q + 1, j]
            root[2 * q, j] = along * (x_n * g_x + y_n * g_y)
            root[2 * q + 1, j] = across * (x_n * g_y - y_n * g_x)


@compiled
def magnetise_field(field: Array, iron: ReducedIron) -> None:
    """Gradients (2 n_point, n) to weighted H = w H/|B| times them, in place."""
    curves = iron.curves
    for q in range(iron.weight.size):
        for n in range(field.shape[1]):
            x, y = field[2 * q, n], field[2 * q + 1, n]
            b = np.sqrt(x * x + y * y)
            h, slope = magnetise_at(b, iron.iron[q], curves.start, curves.b, curves.h, curves.slope, curves.tail)
            nu = h / b if b > NO_FIELD else slope
            field[2 * q, n], field[2 * q + 1, n] = iron.weight[q] * nu * x, iron.weight[q] * nu * y


def newton(c: Array, stiffness: Array, load: Array, iron: ReducedIron, force: Array, root: Array) -> tuple[Array, int]:
    """The tangent at the solution and the number of steps (0: not converged); c (N,) is start and answer.

    Minimises the convex c.K c/2 + iron energy - load.c as `solve_field` does, with a line search by the slope.
    """
    assemble_iron(iron.gradients @ c, iron, force, root)
    tangent = stiffness + root.T @ root
    gradient = stiffness @ c + iron.gradients.T @ force
    for n in range(MOST_STEPS):
        step = np.linalg.solve(tangent, load - gradient)
        descent = float(step @ (load - gradient))
        scale = max(c @ gradient, (c + step) @ load)
        if descent <= ACCEPTED**2 * scale or scale == 0.0:
            c += step
            return tangent, n + 1
        if not descent > 0:
            return tangent, 0
        # along the step the slope rises from -descent: its root is bracketed (Illinois), as in `solve_field`
        low, low_slope, high, high_slope, t = 0.0, -descent, 1.0, 0.0, 1.0
        trial = c + step
        for _ in range(MOST_TRIALS):
            trial = c + t * step
            assemble_iron(iron.gradients @ trial, iron, force, root)
            gradient = stiffness @ trial + iron.gradients.T @ force
            left = float(step @ (gradient - load))
            if abs(left) <= 0.5 * descent or (t == 1.0 and left < 0):
                break
            if left > 0:
                high, high_slope = t, left
                low_slope /= 2
            else:
                low, low_slope = t, left
                high_slope /= 2
            t = low - low_slope * (high - low) / (high_slope - low_slope)
        c[:] = trial
        tangent = stiffness + root.T @ root
    return tangent, 0


def states_along(
    place: Indices,
    coordinate: Array,
    currents: Array,
    stiffness: Array,
    slope: Array,
    sources: Array,
    iron: ReducedIron,
    start: Array | None,
) -> tuple[Array, Array, Array, Indices]:
    """States (n, N), dc/di (n, coil, N), dc/dq (n, N) and Newton's steps (n,) of points.

    Parameters
    ----------
    place : (n,) which of the coordinates
    coordinate : (n_q,) q
    currents : (n, coil)
    stiffness, slope : (n_q, N, N) of the linear regions, and its derivative with respect to q
    sources : (coil, N)
    start : (n, N) what is expected; None: each point begins at what the ones before lead to
    """  # fmt: skip
    n, n_coil, size = place.size, sources.shape[0], sources.shape[1]
    states, steps = np.zeros((n, size)), np.zeros(n, dtype=np.int64)
    by_current, by_coordinate = np.zeros((n, n_coil, size)), np.zeros((n, size))
    force, root = np.zeros(iron.gradients.shape[0]), np.zeros(iron.gradients.shape)
    for p in range(n):
        at = place[p]
        c = np.zeros(size)
        load = currents[p] @ sources
        if not load.any():
            pass  # no field, to the last bit
        elif start is not None:
            c += start[p]
        elif p > 0 and steps[p - 1] > 0:
            straight = p > 1 and place[p - 2] == place[p - 1] == at and steps[p - 2] > 0
            ratio = same_way(currents[p - 2], currents[p - 1], currents[p]) if straight else 0.0
            if ratio > 0.0:
                step = currents[p - 1] - currents[p - 2]
                slopes = step @ by_current[p - 2], step @ by_current[p - 1]
                c += hermite_cubic((states[p - 2], states[p - 1]), slopes, 1.0 + ratio)
            else:
                c += states[p - 1] + by_coordinate[p - 1] * (coordinate[at] - coordinate[place[p - 1]])
                c += (currents[p] - currents[p - 1]) @ by_current[p - 1]
        tangent, steps[p] = newton(c, stiffness[at], load, iron, force, root)
        if steps[p] == 0:
            c[:] = 0.0
            tangent, steps[p] = newton(c, stiffness[at], load, iron, force, root)
        states[p] = c
        right = np.column_stack([sources.T, -(slope[at] @ c)])
        answer = np.linalg.solve(tangent, right)
        by_current[p], by_coordinate[p] = answer[:, :-1].T, answer[:, -1]
    return states, by_current, by_coordinate, steps


def same_way(first: Array, second: Array, third: Array) -> float:
    """How many times the step from the first to the second currents (coil,) leads on to the third; 0 if it does not."""
    step, further = second - first, third - second
    size = float(step @ step)
    ratio = float(step @ further) / size if size > 0.0 else 0.0
    return ratio if ratio > 0.0 and np.allclose(further, ratio * step, rtol=0, atol=SAME_WAY * np.sqrt(size)) else 0.0
