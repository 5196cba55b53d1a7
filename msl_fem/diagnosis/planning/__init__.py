"""Before anything is measured: which causes are likely, what each would do, and which run tells them apart."""

from msl_fem.diagnosis.planning.expected import ExpectedCause, expected_causes
from msl_fem.diagnosis.planning.planned_runs import PlannedRuns, standard_excitations
from msl_fem.diagnosis.planning.ranking import Suspect, suspects

__all__ = ["ExpectedCause", "PlannedRuns", "Suspect", "expected_causes", "standard_excitations", "suspects"]
