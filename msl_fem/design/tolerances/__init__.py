"""What manufacturing tolerances do: sensitivities of force, flux and map currents, and the map's band."""

from msl_fem.design.tolerances.manufactured import (
    NAMES,
    ManufacturingTolerance,
    manufactured_field,
    manufactured_magnet,
    moved_mesh,
    scaled_iron,
    tolerances_of,
)
from msl_fem.design.tolerances.sensitivity import (
    ManufacturedMagnet,
    ManufacturingJob,
    Questions,
    RowRun,
    Sensitivity,
    answers,
    sensitivities,
)
from msl_fem.design.tolerances.study import (
    Band,
    StudyResources,
    ToleranceSettings,
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
    "ManufacturedMagnet",
    "ManufacturingJob",
    "ManufacturingTolerance",
    "Questions",
    "RowRun",
    "Sensitivity",
    "StudyResources",
    "ToleranceSettings",
    "ToleranceStudy",
    "answers",
    "direct_band",
    "draw",
    "linearised_answers",
    "linearised_band",
    "manufactured_field",
    "manufactured_magnet",
    "moved_mesh",
    "scaled_iron",
    "sensitivities",
    "tolerance_study",
    "tolerances_of",
]
