"""What manufacturing tolerances do: sensitivities of force, flux and map currents, and the map's band."""

from msl_fem.design.tolerances.band import Band, direct_band, draw, linearised_answers, linearised_band
from msl_fem.design.tolerances.deviation import NAMES, Tolerance, tolerances_of
from msl_fem.design.tolerances.made_magnet import Nominal, made_field, made_magnet, moved_mesh, scaled_iron
from msl_fem.design.tolerances.rows import Made, MadeJob, Questions, Running, answers
from msl_fem.design.tolerances.sensitivity import Sensitivity, sensitivities
from msl_fem.design.tolerances.study import Resources, StudySettings, ToleranceStudy, tolerance_study

__all__ = [
    "NAMES",
    "Band",
    "Made",
    "MadeJob",
    "Nominal",
    "Questions",
    "Resources",
    "Running",
    "Sensitivity",
    "StudySettings",
    "Tolerance",
    "ToleranceStudy",
    "answers",
    "direct_band",
    "draw",
    "linearised_answers",
    "linearised_band",
    "made_field",
    "made_magnet",
    "moved_mesh",
    "scaled_iron",
    "sensitivities",
    "tolerance_study",
    "tolerances_of",
]
