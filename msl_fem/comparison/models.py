"""The models that a comparison sets side by side, fitted on `fit` runs where they have something to fit, and the loop
that drove a run, made again where one of our own designs did."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from msl_fem.actuator import Actuator, ECore
from msl_fem.computing.arrays import Array
from msl_fem.control.belief import belief_of
from msl_fem.control.design import ControllerDesign
from msl_fem.control.designs import Choice, designed
from msl_fem.control.stepper import Stepper
from msl_fem.errors import ComputationError, InputError
from msl_fem.files.schema import In
from msl_fem.identification import ArmaxModel, identify
from msl_fem.maps import operating_map
from msl_fem.materials.material import laminated, load_iron
from msl_fem.plant.closed_run import clock_of
from msl_fem.plant.excitation import parse_excitation, reference
from msl_fem.prediction import (
    CallableLaw,
    ModelHypothesis,
    ProcessNoise,
    RecordFit,
    RunData,
    fit_record,
    kernel_plant,
    tuned_process_noise,
)
from msl_fem.record import Record, Run
from msl_fem.table.magnetic_table import MagneticTable
from msl_fem.table.reluctance_table import circuit_fitted, circuit_of, reluctance_table

ANALYTIC, COUPLED, REFITTED, EXTENDED, ARMAX = "analytic", "coupled", "coupled, re-fitted", "extended", "armax"
SAME = 1e-6  # of the largest gain: what a search may differ by on another machine


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
    record: Record,
    runs: tuple[RunData, ...],
    table: MagneticTable | None,
    extended: ModelHypothesis | None,
    tell: Callable[[str], None],
) -> ComparedModels:
    """The models of a record: what is fitted sees runs with the role `fit` alone; `tell` hears what comes next."""
    fit = [run for run in runs if run.role == "fit"]
    believed = ModelHypothesis(record.actuator, table)
    beliefs: dict[str, ModelHypothesis] = {}
    notes: list[str] = []
    if table is not None:
        beliefs[ANALYTIC] = ModelHypothesis(record.actuator, analytic_table(record.actuator, table))
    beliefs[COUPLED] = believed
    refit = None
    tell("re-fit")
    try:
        refit = fit_record(believed, fit, record.tolerance)
        beliefs[REFITTED] = refit.belief
        notes += refit_notes(refit)
    except (InputError, ComputationError) as err:
        notes.append(f"{REFITTED}: left out, {err}")
    if extended is not None:
        beliefs[EXTENDED] = extended
    coupled = []
    for name, belief in beliefs.items():
        tell(name)
        plant = kernel_plant(belief, rate=fit[0].rate, ideal_current=fit[0].ideal_current)
        coupled.append(CoupledModel(name, belief, tuned_process_noise(plant, fit)))
    tell(ARMAX)
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
    for name, fitted in refit.far.items():
        notes.append(
            f"{REFITTED}: {name} moved by {fitted.tolerances:+.1f} of its tolerances to {fitted.value:.5g}: more than "
            "these parameters is wrong, or the tolerance is too small"
        )
    return notes


@dataclass(frozen=True, eq=False)
class OwnLoop:
    """The design that a record states; `beside` makes of it what a run's simulation asks."""

    design: ControllerDesign

    def beside(self, run: Run, data: RunData) -> CallableLaw | None:
        """The answer of the controller to the simulated reading, less its answer to the recorded one; None without a
        reference."""
        if "reference_m" not in run:
            return None
        simulated, recorded = Stepper(self.design), Stepper(self.design)
        every, delay = clock_of(simulated, rate=data.rate)
        followed, measured = _reference(run, data), run["position_m"]
        commands = np.zeros(2)

        def answer(k: int, reading: float) -> Array:
            if k == 0:
                simulated.start()
                recorded.start()
            of_simulated = simulated.command(followed[k], reading)
            change = of_simulated - recorded.command(followed[k], float(measured[k]))
            commands[: change.size] = change
            return commands

        return CallableLaw(answer, every, delay)


def own_loop(record: Record, table: MagneticTable | None) -> OwnLoop | None:
    """The loop of a record whose `[controller]` states a `design`; None where it states none.

    Raises
    ------
    InputError : a design or a wish that is none; what is made again has other gains than those stated
    """
    stated = record.controller or {}
    if "design" not in stated or table is None:
        return None
    belief = belief_of(record.actuator, table, operating_map(table))
    design = designed(belief, _choice(stated))
    gains = {"gain": design.law.gains.state, "filter_gain": design.law.estimator.gain}
    for name, value in gains.items():
        if name in stated and not _alike(np.asarray(stated[name]), value):
            raise InputError(
                f"controller.{name}: the design '{stated['design']}' made again from actuator and table has other "
                "gains; it was made for another belief, map or wish"
            )
    return OwnLoop(design)


def _choice(stated: Mapping[str, Any]) -> Choice:
    """The wishes of `[controller]`; InputError for a wrong unit."""
    wishes: dict[str, float | None] = {"bandwidth": None, "overlap": 0.0, "bias": None}
    for name, unit in (("bandwidth", "Hz"), ("overlap", "N"), ("bias", "A")):
        if name in stated:
            try:
                wishes[name] = In(unit).read(stated[name])
            except ValueError as err:
                raise InputError(f"controller.{name}: {err}") from err
    sensitivity = stated.get("peak_sensitivity")
    return Choice(
        str(stated["design"]),
        wishes["bandwidth"],
        None if sensitivity is None else float(sensitivity),
        bool(stated.get("feedforward", True)),
        wishes["overlap"] or 0.0,
        wishes["bias"],
    )


def _alike(stated: Array, made_again: Array) -> bool:
    if stated.shape != made_again.shape:
        return False
    return bool(np.abs(stated - made_again).max() <= SAME * np.abs(made_again).max())


def _reference(run: Run, data: RunData) -> Array:
    """(n_sample, 3) of the reference: exact where the excitation says it, else by differences of the column."""
    column = run["reference_m"]
    try:
        stated = reference(parse_excitation(run.excitation), rate=data.rate)
        if stated.position.size == column.size and np.abs(stated.position - column).max() <= 1e-8 * np.ptp(column):
            return np.column_stack([stated.position, stated.velocity, stated.acceleration])
    except InputError:
        pass
    slope = np.gradient(column) * data.rate
    return np.column_stack([column, slope, np.gradient(slope) * data.rate])
