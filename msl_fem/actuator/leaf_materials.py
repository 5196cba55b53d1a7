"""Materials of leaf flexures: elasticity, density, and the stress that a flexure may see for ever."""

from dataclasses import dataclass

from msl_fem.errors import MaterialError

SAFETY = 1.5
"""Fatigue strength over allowed stress: room for the scatter of fatigue data and for the edges of a real leaf."""


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
