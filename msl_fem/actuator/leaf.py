"""Leaf flexures in closed form: materials, where leaves stand at the mover, and one leaf.

A leaf is a thin strip, clamped at the frame, guided without rotation at the mover. The guided end moves by x across
the leaf; w(s) = x (3 s^2 - 2 s^3), s along the leaf from 0 to 1, is its shape. Where the guided end cannot come nearer
(leaves on opposite sides of a mover hold each other), the leaf must stretch: that is the cubic term of the force. Where
it is free to come nearer (leaves on one side), it does so by 3/5 x^2/L and the force stays linear (Awtar, Slocum and
Sevincer, J. Mech. Design 129 (2007) 625: the coefficients 12, 6/5 and 3/5).
"""

import math
from dataclasses import dataclass

from msl_fem.errors import InputError, MaterialError
from msl_fem.files.quantity import format_quantity

SAFETY = 1.5
"""Fatigue strength over allowed stress: room for the scatter of fatigue data and for the edges of a real leaf."""
LARGEST_DEFLECTION = 0.1  # of the length: slopes up to 0.15, whose squares the theory neglects against 1
SERIES_BELOW = 0.05  # of h, see `Leaf.tension`
CLAMPED_ROOT = 4.730040744862704  # first positive root of cosh z cos z = 1
GUIDED_MASS_SHARE = 13 / 35
"""Share of a leaf's mass that moves with its guided end: the integral of (3 s^2 - 2 s^3)^2 (Rayleigh 1877)."""


@dataclass(frozen=True)
class FlexureMaterial:
    """A sheet metal of flexures.

    Attributes
    ----------
    youngs_modulus, poisson_ratio, density : Pa, 1, kg/m3
    fatigue_strength : Pa, amplitude under reversed bending of a smooth specimen, at the cycles that `source` names
    source : where the numbers come from
    """

    name: str
    youngs_modulus: float
    poisson_ratio: float
    density: float
    fatigue_strength: float
    source: str

    @property
    def allowed_stress(self) -> float:
        """Pa, the fatigue strength over `SAFETY`."""
        return self.fatigue_strength / SAFETY

    @property
    def shear_modulus(self) -> float:
        """Pa, E / (2 (1 + nu))."""
        return self.youngs_modulus / (2 * (1 + self.poisson_ratio))


FLEXURE_MATERIALS = {
    material.name: material
    for material in (
        FlexureMaterial(
            "spring_steel",
            206e9,
            0.30,
            7850.0,
            600e6,
            "hardened and tempered carbon spring strip (C75S, EN 10132-4: tensile strength from 1200 MPa); endurance "
            "limit half the tensile strength (Budynas and Nisbett, Shigley's Mechanical Engineering Design, ch. 6)",
        ),
        FlexureMaterial(
            "beryllium_copper",
            131e9,
            0.30,
            8360.0,
            285e6,
            "C17200 strip, age-hardened: 131 GPa, 8.36 g/cm3; fatigue strength at 1e8 cycles of reversed bending "
            "285 MPa, the lower end of producers' data sheets",
        ),
        FlexureMaterial(
            "titanium_6al4v",
            113.8e9,
            0.342,
            4430.0,
            510e6,
            "Ti-6Al-4V, annealed (ASM Materials Properties Handbook: Titanium Alloys, 1994); unnotched fatigue "
            "strength at 1e7 cycles",
        ),
        FlexureMaterial(
            "aluminium_7075",
            71.7e9,
            0.33,
            2810.0,
            159e6,
            "7075-T6 (ASM Metals Handbook vol. 2, 1990); fatigue strength at 5e8 cycles of rotating bending; no "
            "endurance limit exists",
        ),
    )
}


def flexure_material(name: str) -> FlexureMaterial:
    """The material of that name; MaterialError, which lists those there are, where there is none."""
    if name not in FLEXURE_MATERIALS:
        raise MaterialError(f"unknown flexure material '{name}'; choose one of {', '.join(FLEXURE_MATERIALS)}")
    return FLEXURE_MATERIALS[name]


@dataclass(frozen=True)
class Placement:
    """Where a leaf meets the mover, from the mover's centre of mass, in m.

    Attributes
    ----------
    along : along the motion
    across : along the leaf, with its sign
    sideways : along the leaf's width
    side : +1 or -1, the direction in which the leaf leaves the mover
    """

    along: float
    across: float
    sideways: float
    side: int


def placed(
    planes: tuple[float, ...], *, per_side: int, sides: tuple[int, ...], reach: float, pitch: float
) -> tuple[Placement, ...]:
    """Leaves in planes across the motion: in each, on each side, so many side by side.

    Parameters
    ----------
    planes : places along the motion in m
    reach : from the axis of the motion to where leaves meet the mover
    pitch : between the middles of neighbouring leaves
    """
    return tuple(
        Placement(plane, side * reach, (k - (per_side - 1) / 2) * pitch, side)
        for plane in planes
        for side in sides
        for k in range(per_side)
    )


@dataclass(frozen=True)
class Leaf:
    """A rectangular strip of constant thickness.

    Attributes
    ----------
    length, width, thickness : m, free of the clamps; it bends about its thickness
    """

    length: float
    width: float
    thickness: float
    material: FlexureMaterial

    @property
    def mass(self) -> float:
        """kg, of the free length."""
        return self.material.density * self.length * self.width * self.thickness

    @property
    def axial_rigidity(self) -> float:
        """E A in N; the sides are free, so that Poisson's contraction is not hindered."""
        return self.material.youngs_modulus * self.width * self.thickness

    @property
    def plate_factor(self) -> float:
        """How much stiffer than a narrow beam's E I the leaf's bending is: 1 ... 1/(1 - nu^2).

        A narrow strip curls across as it bends; a wide one between clamps cannot (cylindrical bending, Timoshenko and
        Woinowsky-Krieger, Theory of Plates and Shells, 1959, art. 1). The clamps hinder it over about a width, so the
        ratio r of width to length decides. The share r (r + a) / (r^2 + b r + c) of the way is a fit to Kirchhoff
        plates with clamped ends and free sides, solved with Morley elements: within 0.4 % in stiffness for
        r = 0.05 ... 2 and nu = 0.2 ... 0.35.
        """
        r = self.width / self.length
        nu = self.material.poisson_ratio
        a, b, c = 0.198, 0.355, 0.097
        share = r * (r + a) / (r * r + b * r + c)
        return 1 + share * nu**2 / (1 - nu**2)

    @property
    def bending_rigidity(self) -> float:
        """E I in N m2, with the plate factor, I = b t^3 / 12."""
        return self.plate_factor * self.material.youngs_modulus * self.width * self.thickness**3 / 12

    @property
    def stiffness(self) -> float:
        """N/m at small displacements: 12 E I / L^3."""
        return 12 * self.bending_rigidity / self.length**3

    @property
    def cubic_stiffness(self) -> float:
        """N/m3, where the ends are held apart: F = k x + k_3 x^3, k_3 = 18/25 E A / L^3, the first term of a series.

        The stretch 3/5 (x/L)^2 makes a tension T = 3/5 E A (x/L)^2, and a tension adds 6/5 T x / L to the force.
        """
        return 18 / 25 * self.axial_rigidity / self.length**3

    @property
    def first_frequency(self) -> float:
        """Hz, of the leaf itself between clamps: z^2 / (2 pi) sqrt(E I / (m L^3)), cosh z cos z = 1."""
        return CLAMPED_ROOT**2 / (2 * math.pi) * math.sqrt(self.bending_rigidity / (self.mass * self.length**3))

    @property
    def critical_compression(self) -> float:
        """N, the axial push at which the guided end gives way sideways: pi^2 E I / L^2 (Euler)."""
        return math.pi**2 * self.bending_rigidity / self.length**2

    def tension(self, displacement: float) -> float:
        """N, where the ends are held apart, of the exact solution of the stretched beam at a displacement in m.

        E I w'''' = T w'' with constant T (von Karman's beam). With h = sqrt(T L^2 / E I) / 2 the slope is
        c (1 - cosh(2 h (s - 1/2)) / cosh h), c = x / (L (1 - tanh(h)/h)), and T follows from the stretch, half the
        mean square of the slope: T = E A c^2 / 2 (1 - 3/2 tanh(h)/h + 1 / (2 cosh^2 h)).

        Raises
        ------
        InputError : a displacement beyond a tenth of the length, where slopes are not small
        """
        from scipy.optimize import brentq  # here, for its import takes longer than all the rest of an actuator

        self.check_displacement(displacement)
        if displacement == 0.0:
            return 0.0
        scale = 4 * self.bending_rigidity / self.length**2

        def excess(h: float) -> float:
            return self.axial_rigidity / 2 * (displacement / self.length) ** 2 * _stretch(h) - scale * h**2

        upper = 1.0
        while excess(upper) > 0:
            upper *= 2
        h = brentq(excess, 0.0, upper, xtol=1e-15, rtol=1e-14)
        return scale * h**2

    def held_force(self, displacement: float) -> float:
        """N at the guided end, ends held apart, of the exact solution of `tension`: F = T c."""
        tension = self.tension(displacement)
        h = math.sqrt(tension * self.length**2 / (4 * self.bending_rigidity))
        # T / (1 - tanh(h)/h) tends to 12 E I / L^2 where T does to 0
        return 4 * self.bending_rigidity / self.length**3 * displacement * _over_slope(h)

    def bending_stress(self, displacement: float) -> float:
        """Pa at the clamps, at small displacements: E' t/2 times the curvature 6 x / L^2."""
        modulus = self.plate_factor * self.material.youngs_modulus
        return 3 * modulus * self.thickness * abs(displacement) / self.length**2

    def membrane_stress(self, displacement: float) -> float:
        """Pa over the section, ends held apart, to first order: 3/5 E (x/L)^2."""
        return 0.6 * self.material.youngs_modulus * (displacement / self.length) ** 2

    def check_displacement(self, displacement: float) -> None:
        """InputError beyond a tenth of the length."""
        largest = LARGEST_DEFLECTION * self.length
        if not abs(displacement) <= largest:
            raise InputError(
                f"displacement {format_quantity(displacement, 'm')} is beyond {format_quantity(largest, 'm')}, a tenth "
                "of the leaf's length, up to which slopes are small; make the leaf longer"
            )


def _over_slope(h: float) -> float:
    """h^2 / (1 - tanh(h)/h), 3 at h = 0; by its series where the difference cancels."""
    if h < SERIES_BELOW:
        return 3 / (1 - 2 * h**2 / 5 + 17 * h**4 / 105)
    return h**2 / (1 - math.tanh(h) / h)


def _stretch(h: float) -> float:
    """(1 - 3/2 tanh(h)/h + 1/(2 cosh^2 h)) / (1 - tanh(h)/h)^2: mean square slope over (x/L)^2, 6/5 at h = 0."""
    if h < SERIES_BELOW:
        mean = 2 / 15 - 34 * h**2 / 315 + 62 * h**4 / 945
    else:
        mean = (1 - 1.5 * math.tanh(h) / h + 0.5 / math.cosh(min(h, 300.0)) ** 2) / h**4
    return mean * _over_slope(h) ** 2
