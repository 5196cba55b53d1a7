"""The six modes of a rigid mover on leaves, each leaf by the closed-form stiffness and mass of its moving end."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh

from msl_fem.actuator import Leaf, Placement

Array = NDArray[np.float64]
MOTIONS = ("motion", "along_leaves", "sideways", "roll", "yaw", "pitch")
"""Displacements along the motion (x), the leaves (y) and their width (z); rotations about x, y and z."""
SHEAR_FACTOR = 5 / 6  # of a rectangle (Reissner; Timoshenko's beam)


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
    stiffness, mass = np.zeros((6, 6)), np.zeros((6, 6))
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
    x, y, z, s = place.along, place.across, place.sideways, place.side
    return np.array(
        [
            [1, 0, 0, 0, z, -y],
            [0, 0, 0, 0, 0, s],
            [0, 0, 1, y, -x, 0],
            [0, 0, 0, -s, 0, 0],
            [0, 1, 0, -z, 0, x],
            [0, 0, 0, 0, 1, 0],
        ],
        dtype=float,
    )


def _end_matrices(leaf: Leaf) -> tuple[Array, Array]:
    """(6, 6) stiffness and mass of a leaf's moving end, in the order of `_carried`."""
    length, width, thickness, g = leaf.length, leaf.width, leaf.thickness, leaf.material.shear_modulus
    wide = leaf.material.youngs_modulus * thickness * width**3 / 12
    shear = 12 * wide / (SHEAR_FACTOR * g * width * thickness * length**2)
    torsion = g * width * thickness**3 / 3 * (1 - 0.63 * thickness / width)
    polar = leaf.mass * (width**2 + thickness**2) / 12
    stiffness, mass = np.zeros((6, 6)), np.zeros((6, 6))
    for first, rigidity, phi in ((0, leaf.bending_rigidity, 0.0), (2, wide, shear)):
        block = slice(first, first + 2)
        stiffness[block, block] = (
            rigidity / ((1 + phi) * length**3) * np.array([[12, -6 * length], [-6 * length, (4 + phi) * length**2]])
        )
        mass[block, block] = leaf.mass / 420 * np.array([[156, -22 * length], [-22 * length, 4 * length**2]])
    stiffness[4, 4], mass[4, 4] = leaf.axial_rigidity / length, leaf.mass / 3
    stiffness[5, 5], mass[5, 5] = torsion / length, polar / 3
    return stiffness, mass
