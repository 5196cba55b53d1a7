"""The models that a comparison sets side by side, fitted on `fit` runs where they have something to fit, and the loop
that drove a run, made again where one of our own designs did.

The analytic model is the textbook's magnet, a linear magnetic circuit of two gaps and iron:

    lambda = N^2 i/R(g),  W' = N^2 i^2/(2 R),  F = N^2 i^2 R'/(2 R^2),
    R = l/(mu_0 mu_r A_c) + g/(mu_0 A_c) + g/(mu_0 2 A_o)

Roters, Electromagnetic Devices (1941), ch. IV; Gutierrez and Ro, IEEE Trans. Magn. 34(5), 1998, with equal areas.
No fringes, no leakage, no saturation: what people use before a field solution.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from msl_fem.actuator import Actuator, ECore, MagnetKind
from msl_fem.computing.arrays import Array
from msl_fem.control.design import ControllerChoice, ControllerDesign
from msl_fem.control.design_model import design_model_as_believed
from msl_fem.control.designs import designed
from msl_fem.control.stepper import Stepper
from msl_fem.errors import ComputationError, InputError
from msl_fem.files.schema import In
from msl_fem.identification import ArmaxModel, identify
from msl_fem.maps import operating_map
from msl_fem.maps.pair_limits import PairMap
from msl_fem.materials.constants import MU_0
from msl_fem.materials.material import AnalyticIron, Iron, laminated, load_iron
from msl_fem.plant.effects import EffectValues
from msl_fem.plant.excitation import parse_excitation, reference
from msl_fem.plant.sampled_plant import clock_of
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

ANALYTIC, COUPLED, REFITTED, EXTENDED, ARMAX = "analytic", "coupled", "coupled, re-fitted", "extended", "armax"
SAME = 1e-6  # of the largest gain: what a search may differ by on another machine
STRAIGHT = 1.2
"""T: up to here the source paper takes the B-H curve as straight, and here its slope from 0 gives mu_r."""
SMALL = 0.1  # of a table's largest current, where its flux linkage is taken as that of unsaturated iron


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
    """The textbook's magnetic circuit on the table's grid: of the magnet's dimensions where its kind states them, else
    as the table is at small currents."""
    magnet = actuator.magnet
    if isinstance(magnet, MagnetKind) and magnet.circuit is not None:
        iron, folder = magnet.iron, actuator.folder
        core = laminated(load_iron(iron.core, folder=folder), iron.core_stacking)
        armature = laminated(load_iron(iron.armature, folder=folder), iron.armature_stacking)
        circuit = circuit_of(magnet, core, armature)
    else:
        circuit = circuit_fitted(table)
    return reluctance_table(circuit, table.gap, table.current)


@dataclass(frozen=True)
class LinearCircuit:
    """Inductance L = scale/(g + offset): scale in H m, offset in m (the iron as a length of air)."""

    scale: float
    offset: float


def _e_core_circuit(magnet: ECore, core: Iron | AnalyticIron, armature: Iron | AnalyticIron) -> LinearCircuit:
    """The magnetic circuit of an E-core; the irons as laminated, so that areas are those of the stack.

    One path: centre leg, yoke, outer leg, back through the armature; each part with the area that its flux has.
    """
    centre = magnet.centre_leg_width * magnet.stack_depth
    outer = 2 * magnet.outer_leg_width * magnet.stack_depth
    gap_per_metre = 1 / centre + 1 / outer
    across = magnet.centre_leg_width / 2 + magnet.window_width + magnet.outer_leg_width / 2
    leg = magnet.window_height + magnet.yoke_thickness / 2
    iron = leg / centre + leg / outer + across / (2 * magnet.yoke_thickness * magnet.stack_depth)
    plate = (across + magnet.armature_thickness) / (2 * magnet.armature_thickness * magnet.stack_depth)
    offset = (iron / _mu_r(core) + plate / _mu_r(armature)) / gap_per_metre
    return LinearCircuit(MU_0 * magnet.coil.turns**2 / gap_per_metre, offset)


def circuit_of(magnet: MagnetKind, core: Iron | AnalyticIron, armature: Iron | AnalyticIron) -> LinearCircuit:
    """The circuit of faces and iron parts that a kind states; the irons as laminated.

    Raises
    ------
    InputError : the kind states none
    """
    if isinstance(magnet, ECore):
        return _e_core_circuit(magnet, core, armature)
    circuit = magnet.circuit
    if circuit is None:
        raise InputError("this kind of magnet states no magnetic circuit; compare with the one fitted to its table")
    gap_per_metre = sum(1 / face.area for face in circuit.faces)
    permeability = {"core": _mu_r(core), "armature": _mu_r(armature)}
    iron = sum(part.length / part.area / permeability[part.region] for part in circuit.parts)
    return LinearCircuit(MU_0 * magnet.turns**2 / gap_per_metre, iron / gap_per_metre)


def circuit_fitted(table: MagneticTable) -> LinearCircuit:
    """The circuit that a table follows at small currents: least squares of 1/L, weighted to equal relative errors."""
    inductance = np.asarray(table.flux_linkage(SMALL * table.current[-1], table.gap)) / (SMALL * table.current[-1])
    design = np.column_stack([table.gap, np.ones(table.gap.size)]) * inductance[:, None]
    slope, intercept = np.linalg.lstsq(design, np.ones(table.gap.size), rcond=None)[0]
    return LinearCircuit(1 / slope, intercept / slope)


def reluctance_table(circuit: LinearCircuit, gap: ArrayLike, current: ArrayLike) -> MagneticTable:
    """The table of a linear circuit at nodes (n_gap,) in m and (n_current,) in A, the first of them 0; exact."""
    g, i = np.array(gap, dtype=float), np.array(current, dtype=float)
    inductance = circuit.scale / (g + circuit.offset)
    slope, curvature = -inductance / (g + circuit.offset), 2 * inductance / (g + circuit.offset) ** 2
    return MagneticTable(
        gap=g,
        current=i,
        nodes={
            "coenergy": np.outer(inductance, i**2) / 2,
            "flux_linkage": np.outer(inductance, i),
            "force": np.outer(-slope, i**2) / 2,
            "incremental_inductance": np.outer(inductance, np.ones_like(i)),
            "force_current_slope": np.outer(-slope, i),
            "force_gap_slope": np.outer(-curvature, i**2) / 2,
        },
        provenance={"solver": "none: linear magnetic circuit without fringes, leakage and saturation"},
    )


def _mu_r(iron: Iron | AnalyticIron) -> float:
    """Relative permeability of the chord from 0 to STRAIGHT."""
    field_strength, _ = iron.magnetise(np.array([STRAIGHT]))
    return float(STRAIGHT / (MU_0 * field_strength[0]))


def fitted_models(
    record: Record,
    runs: tuple[RunData, ...],
    believed: ModelHypothesis,
    extended: ModelHypothesis | None,
    tell: Callable[[str], None],
) -> ComparedModels:
    """The models of a record: what is fitted sees runs with the role `fit` alone; `tell` hears what comes
    next, `believed` is the coupled model."""
    fit = [run for run in runs if run.role == "fit"]
    table = believed.table
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
    moved = [f"{name.replace('_', ' ')} {fitted.tolerances:+.1f}" for name, fitted in refit.far.items()]
    if moved:
        notes.append(
            f"{REFITTED}: left what was believed by so many tolerances: {', '.join(moved)}; more than these parameters "
            "is wrong, or their tolerances are too small"
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
        followed = simulated.rows(_reference(run, data), period=1 / data.rate)
        measured = run["position_m"]
        injected = run["injection_m"] if "injection_m" in run else np.zeros(measured.size)
        commands = np.zeros(2)

        def answer(k: int, reading: float) -> Array:
            if k == 0:
                simulated.start()
                recorded.start()
            of_simulated = simulated.command(followed[k], reading + injected[k])
            change = of_simulated - recorded.command(followed[k], float(measured[k] + injected[k]))
            commands[: change.size] = change
            return commands

        return CallableLaw(answer, every, delay)


def own_loop(
    record: Record, table: MagneticTable | None, effects: EffectValues | None = None, pair: PairMap | None = None
) -> OwnLoop | None:
    """The loop of a record whose `[controller]` states a `design`, made for a plant with these effects or without them;
    None where it states none, or commands no currents. Its guard judges both currents together where the map of the
    pair is given.

    Raises
    ------
    InputError : a design or a wish that is none; what is made again has other gains than those stated
    """
    stated = record.controller or {}
    drive = record.actuator.drive
    if "design" not in stated or table is None or drive is None or drive.kind != "current":
        return None
    regions = operating_map(table) if pair is None else operating_map(table, levels=pair.levels.tolist())
    other = ""
    for believed in (effects,) if effects is None else (effects, None):
        model = design_model_as_believed(record.actuator, table, regions, believed, pair)
        design = designed(model, _choice(stated))
        other = _other_gain(design, stated)
        if not other:
            return OwnLoop(design)
    raise InputError(
        f"controller.{other}: the design '{stated['design']}' made again from actuator and table has other gains; it "
        "was made for another belief, map or wish"
    )


def _other_gain(design: ControllerDesign, stated: Mapping[str, Any]) -> str:
    """The first gain in which a design differs from the one stated; empty where none does."""
    gains = {"gain": design.law.gains.state, "filter_gain": design.law.estimator.gain}
    others = (n for n, value in gains.items() if n in stated and not _alike(np.asarray(stated[n]), value))
    return next(others, "")


def _choice(stated: Mapping[str, Any]) -> ControllerChoice:
    """The wishes of `[controller]`; InputError for a wrong unit."""
    wishes: dict[str, float | None] = {"bandwidth": None, "overlap": 0.0, "bias": None}
    for name, unit in (("bandwidth", "Hz"), ("overlap", "N"), ("bias", "A")):
        if name in stated:
            try:
                wishes[name] = In(unit).read(stated[name])
            except ValueError as err:
                raise InputError(f"controller.{name}: {err}") from err
    sensitivity = stated.get("peak_sensitivity")
    return ControllerChoice(
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
