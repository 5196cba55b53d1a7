"""A field in a reduced space: states at many points, and all numbers as derivatives of one reduced coenergy.

    W'(q, i) = max over c of  i.f c - c.K(q) c / 2 - sum of w_p w(|B_p(c)|)

Flux linkage is its derivative with respect to a current, that with respect to the coordinate q is -c.K' c / 2; second
derivatives follow by the state's own, dc/di and dc/dq, so that mixed ones agree to rounding.
"""

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, fields

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.computing.blas_threads import one_blas_thread
from msl_fem.magnetics.reduced.linear_systems import linear_products
from msl_fem.magnetics.reduced.online import ReducedProblem, StatesAt
from msl_fem.magnetics.reduced.reduced_iron import ReducedIron, magnetise_fields
from msl_fem.magnetics.reduced.space import Basis
from msl_fem.materials.curves import Indices


@dataclass(frozen=True, eq=False)
class FieldPoints:
    """Where a field is asked for: coordinate (n,) in m, currents (n, coil) in A."""

    coordinate: Array
    currents: Array

    def __len__(self) -> int:
        return self.coordinate.size

    def only(self, chosen: "Indices | Sequence[int]") -> "FieldPoints":
        return FieldPoints(self.coordinate[chosen], self.currents[chosen])

    def way(self) -> Indices:
        """An order in which neighbours follow each other: coordinate by coordinate, the first currents to and fro."""
        keys = [self.coordinate, *self.currents.T]
        ranks = [np.unique(key, return_inverse=True)[1] for key in keys]
        for n in range(1, len(ranks)):
            turned = sum(ranks[:n]) % 2 == 1
            ranks[n] = np.where(turned, -ranks[n], ranks[n])
        return np.asarray(np.lexsort(ranks[::-1]))

    def ways(self) -> list[Indices]:
        """The points of each coordinate, in an order in which neighbours follow each other, from the lower currents."""
        way = self.way()
        place = np.unique(self.coordinate, return_inverse=True)[1][way]
        size = np.linalg.norm(self.currents, axis=1)
        each = np.split(way, np.flatnonzero(np.diff(place)) + 1)
        return [one if size[one[0]] <= size[one[-1]] else one[::-1] for one in each]


@dataclass(frozen=True, eq=False)
class KnownStates:
    """States of a reduced space at n points.

    Attributes
    ----------
    states, by_current, by_coordinate : (n, N), (n, coil, N), (n, N) with the derivatives
    """

    points: FieldPoints
    states: Array
    by_current: Array
    by_coordinate: Array

    def near(self, points: FieldPoints) -> "KnownStates":
        """Expected at other points: along the slopes from the nearest of these, each axis over its span."""
        axes = [(self.points.coordinate, points.coordinate)]
        axes += list(zip(self.points.currents.T, points.currents.T, strict=True))
        away = sum(((there[:, None] - here) / (np.ptp(here) or 1.0)) ** 2 for here, there in axes)
        nearest = np.argmin(away, axis=1)
        further = (points.coordinate - self.points.coordinate[nearest])[:, None] * self.by_coordinate[nearest]
        rise = points.currents - self.points.currents[nearest]
        states = self.states[nearest] + further + np.einsum("nk,nkj->nj", rise, self.by_current[nearest])
        return KnownStates(points, states, self.by_current[nearest], self.by_coordinate[nearest])


@dataclass(frozen=True, eq=False)
class ReducedStates(KnownStates):
    """What `solve` gives, per unit depth in the plane: all of n points.

    Attributes
    ----------
    flux_linkage : (n, coil)
    coenergy, energy_slope : (n,) W', and dW/dq at a given potential, which is -dW'/dq
    inductance : (n, coil, coil) d2W'/di2
    energy_slope_by_current : (n, coil); energy_slope_by_coordinate : (n,)
    steps : (n,) Newton's, 0 where they did not converge
    """

    flux_linkage: Array
    coenergy: Array
    energy_slope: Array
    inductance: Array
    energy_slope_by_current: Array
    energy_slope_by_coordinate: Array
    steps: Indices

    def only(self, chosen: "Indices | Sequence[int]") -> "ReducedStates":
        """What was found at some of the points."""
        arrays = {f.name: getattr(self, f.name)[chosen] for f in fields(self) if f.name != "points"}
        return ReducedStates(self.points.only(chosen), **arrays)


class ReducedModel:
    """A basis, the linear regions in it, and a quadrature of the irons.

    Parameters
    ----------
    basis : of the space
    sources : (n_dof,) of each coil
    iron : the quadrature
    sampled : which of the whole quadrature's points it has, where not all or others
    """

    def __init__(
        self, basis: Basis, sources: Sequence[Array], iron: ReducedIron, sampled: "Indices | None" = None
    ) -> None:
        self.basis, self.iron, self.sampled = basis, iron, sampled
        self.sources = np.stack([basis.vectors.T @ source for source in sources])
        self.linear = basis.linear_parts()

    def without_last(self, count: int) -> "ReducedModel":
        """The model in the space without its last functions."""
        basis, kept = self.basis, self.basis.size - count
        fewer = Basis(basis.model, basis.quadrature, basis.vectors[:, :kept])
        other = copy(self)
        other.basis, other.sources = fewer, np.ascontiguousarray(self.sources[:, :kept])
        other.iron = self.iron._replace(gradients=np.ascontiguousarray(self.iron.gradients[:, :kept]))
        other.linear = self.linear.first(fewer)
        return other

    @one_blas_thread
    def solve(self, points: FieldPoints, start: "Array | None" = None) -> ReducedStates:
        """The states and numbers at points; `start` (n, N) where something is expected."""
        coordinate, place = np.unique(points.coordinate, return_inverse=True)
        stiffness, slope, bend = (np.stack(part) for part in zip(*map(self.linear.at, coordinate), strict=True))
        problem = ReducedProblem(place, coordinate, points.currents, stiffness, slope, self.sources, self.iron)
        found = StatesAt(problem)
        if start is None:
            found.go(points.ways())
        else:
            found.seek(np.arange(len(points)), start)
        states, by_current, by_coordinate = found.states, found.by_current, found.by_coordinate
        held, first, second = (linear_products(part, place, states[:, None])[:, 0] for part in (stiffness, slope, bend))
        flux = states @ self.sources.T
        energy = 0.5 * (held * states).sum(axis=1) + self._iron_energy(states)
        return ReducedStates(
            points,
            states,
            by_current,
            by_coordinate,
            flux,
            (points.currents * flux).sum(axis=1) - energy,
            0.5 * (first * states).sum(axis=1),
            np.einsum("nkj,lj->nkl", by_current, self.sources),
            np.einsum("nj,nkj->nk", first, by_current),
            (second * states).sum(axis=1) / 2 + (first * by_coordinate).sum(axis=1),
            found.steps,
        )

    def cubature_error(self, states: ReducedStates, chosen: Indices) -> Array:
        """(len(chosen),) what force and flux linkage change by, of full scale, with the whole quadrature.

        To first order: the reduced force's change times the adjoints, which are dc/dq and dc/di.
        """
        c = states.states[chosen]
        change = -_iron_force(self.iron, c) + _iron_force(self.basis.whole_iron(), c)
        force = np.abs(np.einsum("nj,nj->n", states.by_coordinate[chosen], change)) / np.abs(states.energy_slope).max()
        flux = np.abs(np.einsum("nkj,nj->nk", states.by_current[chosen], change))
        return np.maximum(force, (flux / np.abs(states.flux_linkage).max(axis=0)).max(axis=1))

    def _iron_energy(self, states: Array) -> Array:
        """(n,) energy of the irons."""
        x, y = (self.iron.gradients[k::2] @ states.T for k in (0, 1))
        b = np.sqrt(x**2 + y**2)
        total = np.zeros(states.shape[0])
        for k, part in enumerate(self.basis.model.irons.values()):
            own = self.iron.iron == k
            total += self.iron.weight[own] @ part.iron.energy_density(b[own])
        return total


def _iron_force(iron: ReducedIron, states: Array) -> Array:
    """(n, N) the iron's reduced force at states (n, N)."""
    field = states @ iron.gradients.T
    magnetise_fields(field, iron, np.empty((0, 0)))
    return np.asarray(field @ iron.gradients)
