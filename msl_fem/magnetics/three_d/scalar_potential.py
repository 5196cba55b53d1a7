"""Nonlinear magnetostatics by the reduced scalar potential: the field that makes the coenergy least.

H = T_0 - grad phi, where curl T_0 is the current density (e.g. Biro and Preis, IEEE Trans. Magn. 26, 1990). Of all phi
that of the field makes the coenergy, the integral of w*(|H|), least: its slope is the divergence of B. w* is convex, so
that this minimum is the only one and Newton's steps with a line search reach it. A boundary without condition is a
flux line. T_0 has a y component alone and is constant in the leg that the coil encloses: there it is the gradient of a
potential of the elements, and the small H of the iron is no difference of large numbers.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from msl_fem.computing.arrays import Array
from msl_fem.errors import NotConverged
from msl_fem.magnetics.three_d.coenergy_law import CoenergyCurves
from msl_fem.magnetics.three_d.hexahedra import (
    Elements,
    MatrixRows,
    curvature,
    divergence,
    elements_of,
    integration_points,
    matrix_rows,
    potential_gradient,
    respond_everywhere,
)
from msl_fem.magnetics.three_d.multigrid import HELD, conjugate_gradients, preconditioner, seven_points
from msl_fem.magnetics.three_d.tensor_grid import TensorGrid
from msl_fem.materials.constants import MU_0

MOST_STEPS = 60
FIRST_PERMEABILITY = 1000.0  # relative, of all iron where there is no start
COARSE, EXACT = 3e-2, 1e-7
"""How far a Newton step's linear system is solved, and that of a derivative."""
SLOPE_LEFT = 0.3  # of the coenergy along a step, where the search for its length ends
MOST_TRIALS = 15
Progress = Callable[[float], None]
"""Called with the last step's decrement over the coenergy."""


@dataclass(frozen=True, eq=False)
class PotentialProblem:
    """What is to be solved.

    Attributes
    ----------
    grid : the elements
    iron : (n_cell,) index of the iron, -1 in air
    curves : the irons
    source : (n_cell, n_point) T_0 in y at 1 A, in 1/m
    held : (n_node,) nodes where phi = 0
    polar : x is the radius and z the angle in rad about the axis r = 0; vectors are along r, y and the angle
    linear_steps : of conjugate gradients, appended by each linear system
    """

    grid: TensorGrid
    iron: NDArray[np.int64]
    curves: CoenergyCurves
    source: Array
    held: NDArray[np.bool_]
    polar: bool = False
    linear_steps: list[int] = field(default_factory=list)

    @cached_property
    def elements(self) -> Elements:
        return elements_of(self.grid)

    @cached_property
    def weights(self) -> Array:
        """m3 of the integration points, (n_cell, n_point)."""
        return self.grid.volumes[:, None] * self.elements.weights * (self.radius if self.polar else 1.0)

    @cached_property
    def radius(self) -> Array:
        """m, of the integration points about the axis, (n_cell, n_point)."""
        return self.grid.points(integration_points(self.grid.order)[0])[0]

    @cached_property
    def pattern(self) -> tuple[MatrixRows, NDArray[np.int32]]:
        """The matrices' rows and columns."""
        return matrix_rows(self.grid)

    def field_strength(self, potential: Array, current: float) -> Array:
        """H in A/m at the integration points, (n_cell, n_point, 3)."""
        strength = -potential_gradient(potential, self.elements)
        if self.polar:
            strength[..., 2] /= self.radius
        strength[..., 1] += current * self.source
        return strength

    def divergence(self, flux: Array) -> Array:
        """Minus the integral of B (n_cell, n_point, 3) times the gradient of each node's basis, (n_node,) Wb."""
        if self.polar:
            flux = flux * np.stack([self.radius, self.radius, np.ones_like(self.radius)], axis=-1)
        return divergence(flux, self.elements)

    def integral(self, values: Array) -> float:
        """Of values at the integration points, (n_cell, n_point), over what is solved."""
        return float(np.sum(self.weights * values))

    def solve_linear(self, tangent: Array, right: Array, *, drop: float) -> Array:
        """(n_node,) the potential that the curvature takes to the right side, 0 on held nodes.

        Raises
        ------
        InputError : pyamg is missing
        ComputationError : conjugate gradients did not converge
        """
        rows, columns = self.pattern
        if self.polar:
            r, one = self.radius, np.ones_like(self.radius)
            tangent = tangent * np.stack([r, r, 1 / r, r, one, one], axis=-1)
        matrix = csr_array((curvature(tangent, self.elements, rows), columns, rows.begin))
        diagonal = matrix.diagonal()
        matrix.setdiag(np.where(self.held, HELD * diagonal, diagonal))
        mean = np.einsum("cqk,q->ck", tangent[..., :3], self.elements.weights)
        condition = preconditioner(matrix, seven_points(self.grid, mean, self.held))
        answer = conjugate_gradients(matrix, np.where(self.held, 0.0, right), condition, drop=drop)
        self.linear_steps.append(answer.steps)
        return np.where(self.held, 0.0, answer.values)


@dataclass(frozen=True, eq=False)
class MagneticState:
    """The field and what the irons answer, at the integration points.

    Attributes
    ----------
    strength, flux_density : (n_cell, n_point, 3) H in A/m and B in T
    tangent : (n_cell, n_point, 6) dB/dH in H/m: xx, yy, zz, xy, xz, yz
    coenergy_density : (n_cell, n_point) J/m3
    """

    strength: Array
    flux_density: Array
    tangent: Array
    coenergy_density: Array


@dataclass(frozen=True, eq=False)
class PotentialSolution:
    """A solved problem.

    Attributes
    ----------
    potential : (n_node,) A
    trail : each Newton step's decrement over the coenergy
    """

    problem: PotentialProblem
    current: float
    potential: Array
    state: MagneticState
    trail: tuple[float, ...]

    @property
    def coenergy(self) -> float:
        """J, of the part that is solved."""
        return self.problem.integral(self.state.coenergy_density)

    @cached_property
    def by_current(self) -> Array:
        """dH/di at the integration points, (n_cell, n_point, 3) 1/m; raises as `solve_linear`."""
        problem, tangent = self.problem, self.state.tangent
        source = np.zeros_like(self.state.strength)
        source[..., 1] = problem.source
        right = -problem.divergence(apply_tangent(tangent, source))
        return problem.field_strength(problem.solve_linear(tangent, right, drop=EXACT), 1.0)


def apply_tangent(tangent: Array, change: Array) -> Array:
    """dB (..., 3) of a change of H (..., 3)."""
    xx, yy, zz, xy, xz, yz = np.moveaxis(tangent, -1, 0)
    x, y, z = np.moveaxis(change, -1, 0)
    return np.stack([xx * x + xy * y + xz * z, xy * x + yy * y + yz * z, xz * x + yz * y + zz * z], axis=-1)


def solve_potential(
    problem: PotentialProblem,
    current: float,
    *,
    start: Array | None = None,
    tolerance: float = 1e-9,
    progress: Progress | None = None,
) -> PotentialSolution:
    """Newton's iteration from a potential (n_node,), or from iron of a permeability of 1000.

    It ends after a step that was to lower the coenergy by less than `tolerance` of it.

    Raises
    ------
    InputError : pyamg is missing
    NotConverged : not in 60 steps
    ComputationError : conjugate gradients did not converge
    """
    potential = _linear_start(problem, current) if start is None else start
    state = _state_at(problem, problem.field_strength(potential, current))
    trail: list[float] = []
    for _ in range(MOST_STEPS):
        slope = problem.divergence(state.flux_density)
        step = problem.solve_linear(state.tangent, -slope, drop=COARSE)
        coenergy = problem.integral(state.coenergy_density)
        trail.append(abs(float(slope @ step)) / coenergy if coenergy else 0.0)
        length, state = _along_step(problem, state, problem.field_strength(step, 0.0))
        potential = potential + length * step
        if progress is not None:
            progress(trail[-1])
        if trail[-1] <= tolerance:
            return PotentialSolution(problem, current, potential, state, tuple(trail))
    trace = ", ".join(f"{value:.1e}" for value in trail[-5:])
    raise NotConverged(f"the field in three dimensions did not converge in {MOST_STEPS} steps; decrements ..., {trace}")


def _state_at(problem: PotentialProblem, strength: Array) -> MagneticState:
    coenergy, flux, tangent = respond_everywhere(strength, problem.iron, problem.curves)
    return MagneticState(strength, flux, tangent, coenergy)


def _linear_start(problem: PotentialProblem, current: float) -> Array:
    permeability = MU_0 * np.where(problem.iron >= 0, FIRST_PERMEABILITY, 1.0)
    tangent = np.zeros((*problem.source.shape, 6))
    tangent[..., :3] = permeability[:, None, None]
    strength = problem.field_strength(np.zeros(problem.grid.n_nodes), current)
    slope = problem.divergence(permeability[:, None, None] * strength)
    return problem.solve_linear(tangent, -slope, drop=1e-3)


def _along_step(problem: PotentialProblem, state: MagneticState, change: Array) -> tuple[float, MagneticState]:
    """The length of a step, and the state there: where the coenergy's slope along it has fallen to a third or less.

    The slope rises along the step; secants within what brackets its root.
    """

    def slope(at: MagneticState) -> float:
        return problem.integral(np.einsum("cqk,cqk->cq", at.flux_density, change))

    first = slope(state)
    low, at_low, high, at_high = 0.0, first, np.inf, 0.0
    length = 1.0
    for _ in range(MOST_TRIALS):
        tried = _state_at(problem, state.strength + length * change)
        now = slope(tried)
        if abs(now) <= SLOPE_LEFT * abs(first):
            break
        if now < 0:
            low, at_low = length, now
        else:
            high, at_high = length, now
        share = at_low / (at_low - at_high) if high < np.inf else 0.0
        length = low + (high - low) * min(max(share, 0.1), 0.9) if high < np.inf else 2 * length
    return length, tried
