"""The masses of a magnet, by the densities of its materials."""

from dataclasses import dataclass

from msl_fem.design.sizing.requirement import Densities
from msl_fem.magnetics.kinds import MagnetKind
from msl_fem.materials.constants import COPPER_DENSITY

SILICON_STEEL_DENSITY = 7650.0
"""kg/m3, where nothing better is known: non-oriented sheet with about 3 % silicon (EN 10106, M270-35A)."""
IRON_DENSITIES = {
    # semi-processed grades by their old AISI names: 7.65 to 7.75 (ASTM A34, assumed densities by silicon content)
    "m15": 7650.0, "m19": 7650.0, "m19_pyleecan": 7650.0, "m19_29ga_pyleecan": 7650.0, "m27": 7650.0, "m36": 7700.0,
    "m45": 7750.0,
    # EN 10106, conventional densities
    "m235_35a_pyleecan": 7600.0, "m270_35a_pyleecan": 7650.0, "m400_50a_pyleecan": 7700.0, "m530_65a_pyleecan": 7700.0,
    # data sheets: plain carbon steels and iron 7870, AISI 430 7740, cobalt irons 8120
    "steel_1010": 7870.0, "steel_1020": 7870.0, "pure_iron": 7870.0, "stainless_430": 7740.0, "hiperco_50": 8120.0,
    "vanadium_permendur": 8120.0,
}  # fmt: skip
"""kg/m3 by the library's names."""


@dataclass(frozen=True)
class Masses:
    """kg of one magnet; `total` is all of it, `armature` is what moves."""

    core: float
    armature: float
    copper: float

    @property
    def total(self) -> float:
        return self.core + self.armature + self.copper


def masses(magnet: MagnetKind, densities: Densities) -> Masses:
    """The masses of a magnet: sheets fill the stack by the stacking factor, wire the coil by the fill factor.

    Insulation of sheets and wire, bobbin and screws are left out.
    """
    iron = magnet.iron
    section = magnet.section(magnet.half_width)
    volume = {"core": 0.0, "armature": 0.0}
    for part in section.parts:
        volume[part.region] += section.part_volume(part)
    return Masses(
        core=volume["core"] * (densities.core or iron_density(iron.core)),
        armature=volume["armature"] * (densities.armature or iron_density(iron.armature)),
        copper=magnet.copper_volume * (densities.copper or COPPER_DENSITY),
    )


def iron_density(name: str) -> float:
    """kg/m3 of an iron by its name; that of silicon steel where the name says nothing."""
    return IRON_DENSITIES.get(name, SILICON_STEEL_DENSITY)
