"""The models that a comparison sets side by side, fitted on `fit` runs where they have something to fit."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from msl_fem.actuator import Actuator, ECore
from msl_fem.errors import ComputationError, InputError
from msl_fem.identification import ArmaxModel, identify
from msl_fem.materials.material import laminated, load_iron
from msl_fem.prediction import (
    ModelHypothesis,
    ProcessNoise,
    RecordFit,
    RunData,
    fit_record,
    kernel_plant,
    tuned_process_noise,
)
from msl_fem.record import Record
from msl_fem.table.magnetic_table import MagneticTable
from msl_fem.table.reluctance_table import circuit_fitted, circuit_of, reluctance_table

ANALYTIC, COUPLED, REFITTED, EXTENDED, ARMAX = "analytic", "coupled", "coupled, re-fitted", "extended", "armax"
Progress = Callable[[str], None]


@dataclass(frozen=True, eq=False)
class CoupledModel:
    """A coupled model with the process noise that its predictor takes, tuned on the `fit` runs."""

    name: str
    belief: ModelHypothesis
    noise: ProcessNoise


@dataclass(frozen=True, eq=False)
class ComparedModels:
    """All models of a comparison; `notes` say why one is missing, and what a reader should know of the others."""

    coupled: tuple[CoupledModel, ...]
    armax: ArmaxModel | None
    refit: RecordFit | None
    notes: tuple[str, ...]


def analytic_table(actuator: Actuator, table: MagneticTable) -> MagneticTable:
    """The textbook's magnetic circuit on the table's grid: of an E-core's dimensions, else as the table is at small
    currents."""
    if isinstance(actuator.magnet, ECore):
        iron, folder = actuator.magnet.iron, actuator.folder
        core = laminated(load_iron(iron.core, folder=folder), iron.core_stacking)
        armature = laminated(load_iron(iron.armature, folder=folder), iron.armature_stacking)
        circuit = circuit_of(actuator.magnet, core, armature)
    else:
        circuit = circuit_fitted(table)
    return reluctance_table(circuit, table.gap, table.current)


def fitted_models(
    record: Record, runs: tuple[RunData, ...], table: MagneticTable | None, extended: ModelHypothesis | None,
    progress: Progress,
) -> ComparedModels:  # fmt: skip
    """The models of a record: what is fitted sees runs with the role `fit` alone."""
    fit = [run for run in runs if run.role == "fit"]
    believed = ModelHypothesis(record.actuator, table)
    beliefs: list[tuple[str, ModelHypothesis]] = []
    notes: list[str] = []
    if table is not None:
        beliefs.append((ANALYTIC, ModelHypothesis(record.actuator, analytic_table(record.actuator, table))))
    beliefs.append((COUPLED, believed))
    refit = None
    progress("re-fit")
    try:
        refit = fit_record(believed, fit, record.tolerance)
        beliefs.append((REFITTED, refit.belief))
        notes += refit_notes(refit)
    except (InputError, ComputationError) as err:
        notes.append(f"{REFITTED}: left out, {err}")
    if extended is not None:
        beliefs.append((EXTENDED, extended))
    coupled = []
    for name, belief in beliefs:
        progress(name)
        plant = kernel_plant(belief, rate=fit[0].rate, ideal_current=fit[0].ideal_current)
        coupled.append(CoupledModel(name, belief, tuned_process_noise(plant, fit)))
    progress(ARMAX)
    armax = None
    try:
        armax = identify(record).model
        notes += [f"{ARMAX}: {note}" for note in armax.notes]
    except (InputError, ComputationError, np.linalg.LinAlgError) as err:
        notes.append(f"{ARMAX}: left out, {err}")
    return ComparedModels(tuple(coupled), armax, refit, tuple(notes))


def refit_notes(refit: RecordFit) -> list[str]:
    """What a reader should know of a fit: no end, parameters that left their tolerances."""
    notes = []
    if not refit.fit.converged:
        notes.append(f"{REFITTED}: the fit ended without convergence ({refit.fit.reason})")
    for name, found in refit.far.items():
        notes.append(
            f"{REFITTED}: {name} moved by {found.tolerances:+.1f} of its tolerances to {found.value:.5g}: more than "
            "these parameters is wrong, or the tolerance is too small"
        )
    return notes
