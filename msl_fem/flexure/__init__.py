"""Leaf flexures: materials, the closed forms of one leaf, where leaves stand."""

from msl_fem.flexure.leaf import GUIDED_MASS_SHARE, Leaf
from msl_fem.flexure.materials import FLEXURE_MATERIALS, SAFETY, FlexureMaterial, flexure_material
from msl_fem.flexure.placement import Placement, placed

__all__ = [
    "FLEXURE_MATERIALS",
    "GUIDED_MASS_SHARE",
    "SAFETY",
    "FlexureMaterial",
    "Leaf",
    "Placement",
    "flexure_material",
    "placed",
]
