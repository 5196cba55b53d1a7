"""What manufacturing tolerances do: sensitivities of force, flux and map currents, and the map's band."""

from msl_fem.design.tolerances.manufactured import (
    NAMES,
    Nominal,
    Tolerance,
    made_field,
    made_magnet,
    moved_mesh,
    scaled_iron,
    tolerances_of,
)
from msl_fem.design.tolerances.sensitivity import Made, MadeJob, Questions, Running, Sensitivity, answers, sensitivities
from msl_fem.design.tolerances.study import (
    Band,
    Resources,
    StudySettings,
    ToleranceStudy,
    direct_band,
    draw,
    linearised_answers,
    linearised_band,
    tolerance_study,
)

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
