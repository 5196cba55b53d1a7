"""From a record on disk to an identified model: which channels, which terms, which runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Literal

import numpy as np

from msl_fem.errors import InputError
from msl_fem.identification.armax import ArmaxModel, fit_armax
from msl_fem.identification.box_jenkins import BoxJenkinsOrders, fit_box_jenkins
from msl_fem.identification.data import RationalInputs, RationalTerm, SampledRun, rational_term
from msl_fem.identification.gap_offset import DeltaSearch, identify_rational
from msl_fem.identification.likelihood import CriterionName, InformationCriterion
from msl_fem.identification.model import FitFigures, fit_figures
from msl_fem.identification.oscillator import KnownMass, OscillatorPrior, OscillatorTolerance, PhysicalParameter
from msl_fem.identification.prediction_error import ArmaxOrders
from msl_fem.identification.residual_tests import CorrelationTest, feedback_note, feedback_tests, residual_tests
from msl_fem.identification.selection import OrderLimits, TermSearch, candidate_terms, select_orders, select_terms
from msl_fem.record import Record, Run

Structure = Literal["armax", "output-error", "box-jenkins"]
FORCE = "force"
POSITION = "position"


@dataclass(frozen=True)
class ModelChoice:
    """What is identified.

    Attributes
    ----------
    orders : of ARMAX; without, na = nb = nc = 2, nk = 1 (a mass on a spring under a held force, noise on its position),
        and a constant for a rig with no magnets, whose friction and drive offset have no other place; "auto": by
        `criterion`
    terms : texts such as "i1^2/g1^2"; without, i^2/g^2 of every side, the magnets' law below saturation
    select_terms : choose among `terms` (without: i^p/g^q, p = 1, 2, 3, q = 0 ... 3) by `criterion`
    delta : whether the gap offset of the terms is estimated
    prior : whether the believed mass, damping and stiffness count with the record's tolerances, not only as a start
    criterion : "bic" or "aicc"
    structure : "armax", or with its inputs, orders and gap offset "output-error" (white noise on the position) or
        "box-jenkins", whose noise has nc coefficients of C and as many of D; both need a stable plant
    """

    orders: ArmaxOrders | Literal["auto"] | None = None
    terms: tuple[str, ...] = ()
    select_terms: bool = False
    delta: bool = True
    prior: bool = False
    criterion: CriterionName = "bic"
    structure: Structure = "armax"


@dataclass(frozen=True, eq=False)
class Selection:
    """What a search tried: candidates in words with the criterion's values."""

    of: str
    criterion: str
    tried: tuple[tuple[str, float], ...]

    def to_json(self) -> dict[str, Any]:
        """The JSON fields; a candidate that could not be identified has no value."""
        return {"of": self.of, "criterion": self.criterion, "tried": [{"name": n, "value": v} for n, v in self.tried]}


@dataclass(frozen=True, eq=False)
class Identification:
    """An ARMAX model of a record, its fit on every run, and tests of its residuals on the first run that was fitted.

    `physical` holds mass, damping, stiffness and force constants where the model has them; `notes` the model's notes
    and those on the record.
    """

    model: ArmaxModel
    fits: tuple[FitFigures, ...]
    roles: tuple[str, ...]
    residual_tests: tuple[CorrelationTest, ...]
    physical: Mapping[str, PhysicalParameter] = field(default_factory=dict)
    selections: tuple[Selection, ...] = ()
    notes: tuple[str, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """The JSON fields of `identify`."""
        model = self.model
        values = zip(model.parameter_names, model.parameters, model.standard_errors, strict=True)
        return {
            "orders": asdict(model.orders),
            "parameters": {name: {"value": float(v), "standard_error": float(s)} for name, v, s in values},
            "physical_parameters": {
                name: {"value": p.value, "standard_error": p.standard_error, "ci95": list(p.interval), "unit": p.unit}
                for name, p in self.physical.items()
            },
            "fit_percent": {
                fit.run: {"role": role, "one_step": fit.one_step, "free_run": fit.free_run}
                | ({"free_run_ended": fit.reason, "at_sample": fit.diverged_at} if fit.free_run is None else {})
                for fit, role in zip(self.fits, self.roles, strict=True)
            },
            "residual_tests": [
                {"name": t.name, "inside_band": t.inside_band, "statistic": t.statistic, "p_value": t.p_value}
                for t in self.residual_tests
            ],
            "noise_standard_deviation": model.noise_variance**0.5,
            "input_condition_number": model.input_condition_number,
            "converged": model.convergence.converged,
            "selection": [selection.to_json() for selection in self.selections],
            "notes": list(self.notes),
        }


def identify(record: Record, *, choice: ModelChoice | None = None) -> Identification:
    """The ARMAX model identified on the record's `fit` runs and judged on all of them.

    Raises
    ------
    InputError : no run to fit, no channel that drives the position, terms or orders that the data cannot bear
    """
    choice = choice or ModelChoice()
    record = record.free
    fitted = record.runs_of("fit")
    if not fitted:
        raise InputError("the record has no run with role fit; mark one in rig.toml")
    runs = {run.name: sampled_run(record, run) for run in record.runs}
    data = [runs[run.name] for run in fitted]
    magnetic = record.actuator.magnet is not None
    model, selections = _magnetic(record, data, choice) if magnetic else _mechanical(record, data, choice)
    if choice.structure != "armax":
        model = _with_structure(model, data, choice)
    known = record.controller is not None or any("reference_m" in run.columns for run in fitted)
    feedback = feedback_note(feedback_tests(model, data[0], list(data[0].inputs)), known=known)
    physical, refusal = _physical(record, model)
    return Identification(
        model=model,
        fits=fit_figures(model, list(runs.values())),
        roles=tuple(run.role for run in record.runs),
        residual_tests=residual_tests(model, data[0]),
        physical=physical,
        selections=selections,
        notes=(*model.notes, *(note for note in (feedback, refusal) if note is not None)),
    )


def sampled_run(record: Record, run: Run) -> SampledRun:
    """A run of a record as identification takes it: position out; currents i1, i2 and an external force in.

    Raises
    ------
    InputError : the run has none of these inputs, or no position
    """
    names = {"i1": "current_1_A", "i2": "current_2_A", FORCE: "force_N"}
    inputs = {name: run[column] for name, column in names.items() if column in run.columns}
    if "position_m" not in run.columns or not inputs:
        raise InputError(
            f"run {run.name} has the columns {', '.join(run.columns)}; ARMAX needs position_m and at least one of "
            f"{', '.join(names.values())}"
        )
    return SampledRun(run["position_m"], inputs, run.sampling_period, name=run.name, output_name=POSITION)


def _magnetic(
    record: Record, runs: Sequence[SampledRun], choice: ModelChoice
) -> tuple[ArmaxModel, tuple[Selection, ...]]:
    motion = record.actuator.motion
    if motion is None or motion.nominal_gap is None:
        raise InputError(f"{record.actuator.name} states no motion.nominal_gap, which the rational terms need")
    sides = [int(name[1]) for name in runs[0].inputs if name.startswith("i")]
    if not sides:
        raise InputError(f"run {runs[0].name} has no coil current, which a magnet's rational terms need")
    law = tuple(RationalTerm(side, 2, 2) for side in sides)
    terms = tuple(map(rational_term, choice.terms)) or law
    plain = tuple(name for name in runs[0].inputs if name == FORCE)
    rational = RationalInputs(law if choice.select_terms else terms, motion.nominal_gap, plain=plain)
    prior = _prior(record, choice, {})
    selections = []
    search = DeltaSearch() if choice.delta else None
    criterion = InformationCriterion(choice.criterion)
    orders = choice.orders or ArmaxOrders(2, 2, 2, 1)
    if choice.select_terms:
        candidates = terms if choice.terms else candidate_terms(sides)
        held = ArmaxOrders(2, 2, 2, 1) if orders == "auto" else orders
        guess = None if prior is None else replace(prior, tolerance=None)
        found = select_terms(runs, TermSearch((), held, criterion, search, guess, candidates), rational=rational)
        rational = found.rational
        named = tuple((", ".join(names), value) for names, value in found.tried)
        selections.append(Selection("terms", found.criterion, named))
    if orders == "auto":
        orders, selection = _orders([rational.evaluated(run) for run in runs], choice, ArmaxOrders(2, 2, 2, 1), prior)
        selections.append(selection)
    return identify_rational(runs, orders, rational=rational, prior=prior, search=search), tuple(selections)


def _with_structure(armax: ArmaxModel, runs: Sequence[SampledRun], choice: ModelChoice) -> ArmaxModel:
    """The output-error or Box-Jenkins model with the inputs and orders of an ARMAX model, multiplied out."""
    if choice.prior:
        raise InputError(f"the prior counts in ARMAX only: leave --prior out, or --structure {choice.structure}")
    largest = float(np.max(np.abs(np.roots(armax.polynomials.a)), initial=0.0))
    if largest > 1.0:
        raise InputError(
            f"the ARMAX model has a pole of size {largest:.6g}: {choice.structure} needs a stable plant; use ARMAX"
        )
    orders, rational = armax.orders, armax.rational
    noise = orders.nc if choice.structure == "box-jenkins" else 0
    inputs = runs if rational is None else [rational.evaluated(run) for run in runs]
    tied_orders = BoxJenkinsOrders(orders.na, orders.nb, noise, noise, orders.nk, orders.offset)
    return replace(fit_box_jenkins(inputs, tied_orders).armax, rational=rational, input_slopes=armax.input_slopes)


def _mechanical(
    record: Record, runs: Sequence[SampledRun], choice: ModelChoice
) -> tuple[ArmaxModel, tuple[Selection, ...]]:
    if choice.terms or choice.select_terms:
        raise InputError(f"{record.actuator.name} has no magnet, so there are no rational terms: leave --terms out")
    prior = _prior(record, choice, {FORCE: 1.0} if FORCE in runs[0].inputs else {})
    orders = choice.orders or ArmaxOrders(2, 2, 2, 1, offset=True)
    if orders == "auto":
        orders, selection = _orders(runs, choice, ArmaxOrders(2, 2, 2, 1, offset=True), prior)
        return fit_armax(runs, orders, prior=_fitting(prior, orders)), (selection,)
    return fit_armax(runs, orders, prior=prior), ()


def _orders(
    runs: Sequence[SampledRun], choice: ModelChoice, start: ArmaxOrders, prior: OscillatorPrior | None
) -> tuple[ArmaxOrders, Selection]:
    """The orders by the criterion; with a prior that counts, na stays 2, where mass and stiffness have a meaning."""
    limits = OrderLimits(na=2) if choice.prior else OrderLimits()
    guess = None if prior is None else replace(prior, tolerance=None, force_gains={})
    selection = select_orders(
        runs, start=start, criterion=InformationCriterion(choice.criterion), limits=limits, prior=guess
    )
    named = tuple((f"na={o.na}, nb={o.nb}, nc={o.nc}, nk={o.nk}", value) for o, value in selection.tried)
    return selection.orders, Selection("orders", selection.criterion, named)


def _prior(record: Record, choice: ModelChoice, gains: Mapping[str, float]) -> OscillatorPrior | None:
    motion = record.actuator.motion
    if motion is None:
        if choice.prior:
            raise InputError(f"{record.actuator.name} has no [motion], so there is no prior: leave --prior out")
        return None
    believed = record.tolerance
    tolerance = (
        OscillatorTolerance(believed.moving_mass, believed.damping, believed.stiffness) if choice.prior else None
    )
    return OscillatorPrior(motion.moving_mass, motion.damping, motion.stiffness, gains, tolerance)


def _fitting(prior: OscillatorPrior | None, orders: ArmaxOrders) -> OscillatorPrior | None:
    """The prior where orders that were searched for have room for it; a gain needs delays 1 and 2."""
    if prior is None or orders.na < 2:
        return None
    roomy = orders.nk == 1 and isinstance(orders.nb, int) and orders.nb >= 2
    return prior if roomy else replace(prior, force_gains={})


def _physical(record: Record, model: ArmaxModel) -> tuple[dict[str, PhysicalParameter], str | None]:
    """Physical parameters on the scale of a measured force, else of the believed mass; or why there are none."""
    motion = record.actuator.motion
    gains = {FORCE: 1.0} if FORCE in model.input_names else {}
    mass = None if motion is None else KnownMass(motion.moving_mass, record.tolerance.moving_mass)
    try:
        return model.physical_parameters(mass=mass, gains=gains), None
    except InputError as err:
        return {}, f"no physical parameters: {err}"
