"""A leaf as a beam of cubic Hermite elements (stiffness, frequencies, stretching), and the modes of a mover on leaves.

Euler-Bernoulli: the energy is E I/2 of the squared curvature; where the ends are held apart, E A L/2 of the squared
stretch (the ends' moving apart and half the mean square of the slope) comes on top. Without load along the leaf the
tension is one number, so that the axial displacement never enters (von Karman's beam; Awtar, Slocum and Sevincer 2007).

The mover's modes: in the plane of motion and leaves with the leaves as beams of their own mass (`plane_modes`), and all
six of the rigid mover with each leaf by the closed-form stiffness and mass of its moving end (`mover_modes`).
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve, eigh
from skfem import Basis, BilinearForm, ElementLineHermite, MeshLine
from skfem.helpers import d, dd, ddot, dot

from msl_fem.actuator import Leaf, Placement
from msl_fem.computing.arrays import Array
from msl_fem.errors import ComputationError, NotConverged

FREE = ()
SUPPORTED = ("w",)
GUIDED = ("slope",)
CLAMPED = ("w", "slope")
"""What an end holds: nothing, its displacement, its slope, both."""
TOLERANCE = 1e-8  # of Newton's step, over the displacement; the error is its square
MOST_STEPS = 50
MOTIONS = ("motion", "along_leaves", "sideways", "roll", "yaw", "pitch")
"""Displacements along the motion (x), the leaves (y) and their width (z); rotations about x, y and z."""
SHEAR_FACTOR = 5 / 6  # of a rectangle (Reissner; Timoshenko's beam)


@dataclass(frozen=True)
class Deflection:
    """A leaf whose guided end was moved.

    Attributes
    ----------
    force : N, across the leaf at the moved end
    tension : N, along it
    stress : Pa, the largest, at a clamp's surface
    iterations : of Newton
    """

    force: float
    tension: float
    stress: float
    iterations: int


@dataclass(frozen=True)
class PlaneMode:
    """A mode of mover and leaves in the plane of motion and leaves.

    Attributes
    ----------
    frequency : Hz
    shares : of the kinetic energy: "motion", "along_leaves", "pitch" of the mover, and "leaves"
    """

    frequency: float
    shares: Mapping[str, float]

    @property
    def name(self) -> str:
        """Where most of the energy is."""
        return max(self.shares, key=self.shares.__getitem__)


class LeafBeam:
    """A leaf in `elements` cubic elements, from its clamped end to its moving end; matrices (n_dof, n_dof)."""

    def __init__(self, leaf: Leaf, elements: int = 16) -> None:
        self.leaf = leaf
        mesh = MeshLine(np.linspace(0.0, leaf.length, elements + 1))
        self.basis = Basis(mesh, ElementLineHermite(), intorder=6)
        self.bending = leaf.bending_rigidity * _matrix(self.basis, lambda u, v, _: ddot(dd(u), dd(v)))
        self.mass = leaf.mass / leaf.length * _matrix(self.basis, lambda u, v, _: u * v)
        self.slopes = _matrix(self.basis, lambda u, v, _: dot(d(u), d(v)))
        w, slope = self.basis.nodal_dofs
        self.base = {"w": int(w[0]), "slope": int(slope[0])}
        self.tip = {"w": int(w[-1]), "slope": int(slope[-1])}

    def held(self, base: tuple[str, ...], tip: tuple[str, ...]) -> NDArray[np.int64]:
        """Indices of the degrees of freedom that the ends leave free."""
        fixed = [self.base[name] for name in base] + [self.tip[name] for name in tip]
        return np.setdiff1d(np.arange(self.bending.shape[0]), fixed)

    def tip_stiffness(self) -> Array:
        """(2, 2) force and moment at the moving end for its displacement and slope, the base clamped."""
        ends = np.array([self.tip["w"], self.tip["slope"]])
        inner = self.held(CLAMPED, CLAMPED)
        k = self.bending
        through = np.linalg.solve(k[inner][:, inner], k[inner][:, ends])
        return np.asarray(k[ends][:, ends] - k[ends][:, inner] @ through)

    def frequencies(self, base: tuple[str, ...] = CLAMPED, tip: tuple[str, ...] = CLAMPED) -> Array:
        """Natural frequencies in Hz, increasing, of the leaf alone between such ends."""
        free = self.held(base, tip)
        values = eigh(self.bending[np.ix_(free, free)], self.mass[np.ix_(free, free)], eigvals_only=True)
        return np.sqrt(np.maximum(values, 0.0)) / (2 * math.pi)

    def critical_compression(self, base: tuple[str, ...] = CLAMPED, tip: tuple[str, ...] = GUIDED) -> float:
        """The axial push in N at which the leaf gives way sideways."""
        free = self.held(base, tip)
        shares = eigh(self.slopes[np.ix_(free, free)], self.bending[np.ix_(free, free)], eigvals_only=True)
        return float(1 / shares[-1])

    def deflect(self, displacement: float, *, held_apart: bool = True, approach: float = 0.0) -> Deflection:
        """The leaf with its guided end moved by `displacement` in m across it.

        Parameters
        ----------
        held_apart : the ends cannot come nearer; otherwise the leaf is free to shorten and stays linear
        approach : m, by which the ends were brought nearer beforehand (misfit, heat)

        Raises
        ------
        InputError : a displacement beyond a tenth of the length
        ComputationError : the approach buckles the leaf: it gives way sideways between its ends or at the guided one
        """
        self.leaf.check_displacement(displacement)
        rigidity = self.leaf.axial_rigidity if held_apart else 0.0
        free = self.held(CLAMPED, CLAMPED)
        w = np.zeros(self.bending.shape[0])
        w[self.tip["w"]] = displacement
        scale = np.ones(w.size)
        scale[self.basis.nodal_dofs[1]] = self.leaf.length / 2
        for iteration in range(1, MOST_STEPS + 1):
            tension = float(rigidity / self.leaf.length * (w @ self.slopes @ w / 2 - approach))
            pull = self.slopes @ w
            residual = self.bending @ w + tension * pull
            tangent = self.bending + tension * self.slopes + rigidity / self.leaf.length * np.outer(pull, pull)
            self._check_upright(tension, tangent)
            step = cho_solve(cho_factor(tangent[np.ix_(free, free)]), residual[free])
            w[free] -= step
            if np.abs(step * scale[free]).max(initial=0.0) <= TOLERANCE * (abs(displacement) or self.leaf.thickness):
                return self._deflection(w, tension, iteration)
        raise NotConverged(
            f"the stretched leaf did not converge in {MOST_STEPS} steps at {displacement * 1e3:g} mm; make it thicker"
        )

    def _check_upright(self, tension: float, tangent: Array) -> None:
        """ComputationError where a push beyond Euler's load leaves no stable shape."""
        free = self.held(CLAMPED, GUIDED)
        if tension < 0 and np.linalg.eigvalsh(tangent[np.ix_(free, free)])[0] <= 0:
            raise ComputationError(
                f"the leaf buckles: it is pushed with {-tension:.4g} N, beyond Euler's "
                f"{self.critical_compression():.4g} N; reduce the misfit or make the leaf thicker"
            )

    def _deflection(self, w: Array, tension: float, iterations: int) -> Deflection:
        reaction = self.bending @ w + tension * (self.slopes @ w)
        moment = max(abs(float(reaction[self.base["slope"]])), abs(float(reaction[self.tip["slope"]])))
        section = self.leaf.width * self.leaf.thickness
        stress = 6 * moment / (section * self.leaf.thickness) + max(tension, 0.0) / section
        return Deflection(float(reaction[self.tip["w"]]), tension, stress, iterations)


def plane_modes(
    leaf: Leaf, placements: Sequence[Placement], *, mass: float, inertia: float, elements: int = 8
) -> tuple[PlaneMode, ...]:
    """Modes, by increasing frequency, of a rigid mover on leaves in the plane that motion and leaves span.

    Every leaf is a beam with its own mass; along its length it is a rod of one element.

    Parameters
    ----------
    mass, inertia : of the mover in kg, and in kg m2 about the axis across the plane through its centre of mass
    """
    beam = LeafBeam(leaf, elements)
    inner = beam.held(CLAMPED, CLAMPED)
    rigid = 3  # motion, along the leaves, pitch
    size = rigid + inner.size * len(placements)
    stiffness = np.zeros((size, size))
    inertias = np.zeros((size, size))
    inertias[0, 0] = inertias[1, 1] = mass
    inertias[2, 2] = inertia
    for k, place in enumerate(placements):
        carried = np.zeros((beam.bending.shape[0], size))  # the leaf's degrees of freedom, from those of the whole
        carried[inner, rigid + k * inner.size + np.arange(inner.size)] = 1.0
        carried[beam.tip["w"], [0, 2]] = 1.0, -place.across
        carried[beam.tip["slope"], 2] = place.side
        stiffness += carried.T @ beam.bending @ carried
        inertias += carried.T @ beam.mass @ carried
        along = np.zeros(size)
        along[[1, 2]] = 1.0, place.along
        stiffness += leaf.axial_rigidity / leaf.length * np.outer(along, along)
        inertias += leaf.mass / 3 * np.outer(along, along)
    values, shapes = eigh(stiffness, inertias)
    return tuple(
        PlaneMode(math.sqrt(max(value, 0.0)) / (2 * math.pi), _energy_shares(shape, inertias, rigid))
        for value, shape in zip(values, shapes.T, strict=True)
    )


def _energy_shares(shape: Array, mass: Array, rigid: int) -> dict[str, float]:
    energy = shape * (mass @ shape)
    names = ("motion", "along_leaves", "pitch")
    shares = {name: float(energy[n] / energy.sum()) for n, name in enumerate(names)}
    return shares | {"leaves": float(energy[rigid:].sum() / energy.sum())}


def _matrix(basis: Basis, form: object) -> Array:
    return np.asarray(BilinearForm(form).assemble(basis).toarray())


@dataclass(frozen=True)
class Mover:
    """A rigid body: mass in kg, moments of inertia in kg m2 about x, y, z; None holds that rotation."""

    mass: float
    roll_inertia: float | None
    yaw_inertia: float | None
    pitch_inertia: float | None


@dataclass(frozen=True)
class Mode:
    """A mode: frequency in Hz and, by name of `MOTIONS`, the share of the kinetic energy."""

    frequency: float
    shares: Mapping[str, float]

    @property
    def name(self) -> str:
        """The motion that carries most of the energy."""
        return max(self.shares, key=self.shares.__getitem__)


def mover_modes(leaf: Leaf, placements: Sequence[Placement], mover: Mover) -> tuple[Mode, ...]:
    """The mover's modes by increasing frequency, without the rotations that it holds.

    A leaf's moving end has the stiffness of a clamped beam (bending across with the plate factor; across its width with
    shear, Timoshenko and Gere, Mechanics of Materials; torsion of a thin strip with free warping, Saint-Venant;
    tension), and its consistent mass (Przemieniecki, Theory of Matrix Structural Analysis, 1968): 13/35 of the leaf
    along the motion. It is good well below the leaf's own first frequency.
    """
    stiffness = np.zeros((6, 6))
    mass = np.zeros((6, 6))
    k_end, m_end = _end_matrices(leaf)
    for place in placements:
        carried = _carried(place)
        stiffness += carried.T @ k_end @ carried
        mass += carried.T @ m_end @ carried
    inertias = (mover.roll_inertia, mover.yaw_inertia, mover.pitch_inertia)
    mass += np.diag([mover.mass] * 3 + [inertia or 0.0 for inertia in inertias])
    free = [0, 1, 2, *(3 + n for n, inertia in enumerate(inertias) if inertia is not None)]
    inner = np.ix_(free, free)
    values, shapes = eigh(stiffness[inner], mass[inner])
    modes = []
    for value, shape in zip(values, shapes.T, strict=True):
        energy = shape * (mass[inner] @ shape)
        shares = {MOTIONS[n]: float(share) for n, share in zip(free, energy / energy.sum(), strict=True)}
        modes.append(Mode(math.sqrt(max(value, 0.0)) / (2 * math.pi), shares))
    return tuple(modes)


def _carried(place: Placement) -> Array:
    """(6, 6) the end's motions (across, slope across, sideways, slope sideways, along, twist) from the mover's.

    A point at r moves by u + theta x r; slopes are along the leaf, from its clamp to the mover.
    """
    x = place.along
    y = place.across
    z = place.sideways
    s = place.side
    rows = [[1, 0, 0, 0, z, -y], [0, 0, 0, 0, 0, s], [0, 0, 1, y, -x, 0], [0, 0, 0, -s, 0, 0], [0, 1, 0, -z, 0, x]]
    return np.array([*rows, [0, 0, 0, 0, 1, 0]], dtype=float)


def _end_matrices(leaf: Leaf) -> tuple[Array, Array]:
    """(6, 6) stiffness and mass of a leaf's moving end, in the order of `_carried`."""
    length = leaf.length
    width = leaf.width
    thickness = leaf.thickness
    g = leaf.material.shear_modulus
    wide = leaf.material.youngs_modulus * thickness * width**3 / 12
    shear = 12 * wide / (SHEAR_FACTOR * g * width * thickness * length**2)
    torsion = g * width * thickness**3 / 3 * (1 - 0.63 * thickness / width)
    polar = leaf.mass * (width**2 + thickness**2) / 12
    stiffness = np.zeros((6, 6))
    mass = np.zeros((6, 6))
    for first, rigidity, phi in ((0, leaf.bending_rigidity, 0.0), (2, wide, shear)):
        block = slice(first, first + 2)
        shape = np.array([[12, -6 * length], [-6 * length, (4 + phi) * length**2]])
        stiffness[block, block] = rigidity / ((1 + phi) * length**3) * shape
        mass[block, block] = leaf.mass / 420 * np.array([[156, -22 * length], [-22 * length, 4 * length**2]])
    stiffness[4, 4] = leaf.axial_rigidity / length
    stiffness[5, 5] = torsion / length
    mass[4, 4] = leaf.mass / 3
    mass[5, 5] = polar / 3
    return stiffness, mass
