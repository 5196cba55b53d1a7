"""Magnets of one topology, on one mesh moved, in the space of one of them: a parent and its children.

A child's degrees of freedom are the parent's, so the parent's functions span the child's field as well; its own are the
linear regions in them, the gradients at the cubature's points, and these points' weights, which go with their elements'
size. Where full steps of Newton's tell that this is not enough, the child's states enter the space (Reduced basis for
parametrised domains: Hesthaven, Rozza and Stamm, Certified Reduced Basis Methods, 2016, ch. 5).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.magnetics.reduced.full_field import FullField
from msl_fem.magnetics.reduced.reduced_model import FieldPoints, ReducedModel, ReducedStates
from msl_fem.magnetics.reduced.reduction import (
    SAFETY,
    Reducer,
    Reduction,
    ReductionSettings,
    change_of_numbers,
)
from msl_fem.magnetics.reduced.space import Basis, quadrature_of
from msl_fem.materials.curves import Indices

ROUNDS = 3
"""Times at most that the space grows by what children lack."""


@dataclass(frozen=True, eq=False)
class Member:
    """A magnet of the family: its full field, and how far its points' coordinate is from the parent's."""

    full: FullField
    off: float = 0.0


@dataclass(frozen=True, eq=False)
class Child:
    """A member's reduced model, its states at some of the family's points, and by how much its cubature misses there.

    Attributes
    ----------
    chosen : (n,) which of the family's points
    missed : (n,) of force or flux linkage, of full scale
    """

    member: Member
    model: ReducedModel
    chosen: Indices
    states: ReducedStates
    missed: Array

    @property
    def converged(self) -> bool:
        return bool((self.states.steps > 0).all())

    def step_from(self, n: int) -> tuple[float, Array]:
        """What a full step of Newton's from the n-th point changes, of full scale, and the potential it leads to."""
        full, states = self.member.full, self.states
        potential = full.newton_steps(states.points, n, self.model.basis.vectors @ states.states[n])
        return change_of_numbers(full, states, n, potential), potential


class Family:
    """The parent's reduced model, and those of its children.

    Parameters
    ----------
    parent : its reduction at the points
    """

    def __init__(self, parent: Reduction) -> None:
        self.parent = parent
        model, sampled = parent.model, parent.model.sampled
        assert sampled is not None, "the parent has a cubature"
        self._sampled = sampled
        self._share = model.iron.weight / model.basis.quadrature.weight[sampled]

    @property
    def points(self) -> FieldPoints:
        return self.parent.states.points

    def child(self, member: Member, chosen: Indices) -> Child:
        """A member in the parent's space, at some of the family's points."""
        vectors, model = self.parent.model.basis.vectors, member.full.model
        own = Basis(model, quadrature_of(model), vectors)
        iron = own.some_iron(self._sampled, self._share * own.quadrature.weight[self._sampled])
        reduced = ReducedModel(own, member.full.sources, iron, self._sampled)
        at = self.points.only(chosen)
        points = FieldPoints(at.coordinate + member.off, at.currents)
        states = reduced.solve(points, self.parent.states.only(chosen).near(points).states)
        return Child(member, reduced, chosen, states, reduced.cubature_error(states, np.arange(len(points))))


def family_of(
    full: FullField,
    points: FieldPoints,
    settings: ReductionSettings,
    members: Sequence[Callable[[], Member]],
    checks: int,
) -> Family | None:
    """A family whose space holds for the parent at points (n,), and grows by what some members lack.

    None where no reduction holds for the parent. Whether it holds for another child is for that child's checks to tell.

    Parameters
    ----------
    members : make them, one at a time
    checks : of a member, full steps of Newton's: where the cubature misses most, and at points drawn
    """
    drawn = np.random.default_rng(0).integers(len(points), size=(len(members), checks - 1))
    reducer = Reducer(full, points, settings)
    reducer.draft()
    family = None
    for _ in range(ROUNDS):
        reduction = reducer.reduction()
        if reduction is None:
            break
        family, lacking = Family(reduction), False
        for make, others in zip(members, drawn, strict=True):
            child = family.child(make(), np.arange(len(points)))
            for n in {int(np.argmax(child.missed)), *others.tolist()} if child.converged else ():
                error, potential = child.step_from(n)
                if SAFETY * error > settings.tolerance:
                    reducer.take(n, potential, child.member.full)
                    lacking = True
        if not lacking:
            break
    return family
