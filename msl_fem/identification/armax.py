"""The MISO ARMAX model, its prediction-error estimate from one or several runs, and its JSON form.

L. Ljung, System Identification, 2nd ed., chs. 7 and 10; H. M. Gutierrez and P. I. Ro, IEEE Trans. Magn. 34(5), 1998,
eqs. (4)-(14). Data recorded under feedback are sound when there is an external excitation and a delay around the loop
(nk >= 1 or a delay in the controller): the one-step predictor uses past data only, and A is never stabilised.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.computing.blas_threads import one_blas_thread
from msl_fem.errors import ComputationError, InputError
from msl_fem.identification.data import RationalInputs, SampledRun, check_length, check_runs, rational_term
from msl_fem.identification.likelihood import EstimationProblem, covariance, evaluated_reflected
from msl_fem.identification.model import (
    ArmaxEstimate,
    ArmaxFreeRun,
    Convergence,
    predict,
    prediction_residuals,
    simulate_armax,
    transfer_matrix,
)
from msl_fem.identification.oscillator import (
    KnownMass,
    OscillatorPrior,
    PhysicalParameter,
    oscillator_belief,
    physical_parameters,
)
from msl_fem.identification.prediction_error import ArmaxOrders, Polynomials
from msl_fem.identification.regression import LaggedColumn, lagged_blocks, scaled_factor, triangular_factor
from msl_fem.identification.residual_tests import CorrelationTest, residual_tests
from msl_fem.identification.search import (
    EstimationSettings,
    FirstGuess,
    LikelihoodFit,
    excerpts,
    first_guesses,
    maximise_likelihood,
)
from msl_fem.identification.stored_model import check_stored

if TYPE_CHECKING:
    from control import TransferFunction

RANK_DEFICIENT = 1e11  # condition number of scaled columns beyond which the data's rounding decides
SAMPLES_PER_PARAMETER = 10
EXCERPT_SAMPLES = 40_000  # the first guess and the way to its minimum are sought on no more than this
NEARLY_COLLINEAR = 1e4  # condition number of the inputs from which the model says so
SCHEMA = 1


@dataclass(frozen=True, eq=False)
class ArmaxModel(ArmaxEstimate):
    """A(q) y = sum_k B_k(q) u_k + offset + C(q) e; the fields are those of `ArmaxEstimate`."""

    def simulate(self, run: SampledRun, *, initial: Literal["estimated", "measured"] = "estimated") -> ArmaxFreeRun:
        """Free run over a run's inputs; see `free_run.simulate`."""
        return simulate_armax(self, run, initial=initial)

    def predict(self, run: SampledRun, horizon: int = 1) -> Array:
        """Predictions `horizon` samples ahead; see `prediction.predict`."""
        return predict(self, run, horizon)

    def residuals(self, run: SampledRun) -> Array:
        """One-step prediction errors over a run; see `prediction.residuals`."""
        return prediction_residuals(self, run)

    def residual_tests(self, run: SampledRun, **settings: Any) -> tuple[CorrelationTest, ...]:
        """Whiteness and correlation with each input; see `residual_tests.residual_tests`."""
        return residual_tests(self, run, **settings)

    def physical_parameters(
        self, *, mass: KnownMass | None = None, gains: Mapping[str, float] | None = None
    ) -> dict[str, PhysicalParameter]:
        """Mass, damping, stiffness and force constants with intervals; see `physical.physical_parameters`."""
        return physical_parameters(self, mass=mass, gains=gains)

    def to_control(self, *, noise: bool = False) -> TransferFunction:
        """python-control's transfer functions from every input; see `python_control.transfer_matrix`."""
        return transfer_matrix(self, noise=noise)

    def to_json(self) -> dict[str, Any]:
        """The model as plain numbers, texts, lists; `parameters` holds each value with its standard error."""
        polynomials, rational = self.polynomials, self.rational
        values = zip(self.parameters.tolist(), self.standard_errors.tolist(), strict=True)
        return {
            "schema": SCHEMA,
            "kind": "armax",
            "orders": asdict(self.orders),
            "sampling_period_s": self.sampling_period,
            "inputs": list(self.input_names),
            "a": polynomials.a.tolist(),
            "b": [b.tolist() for b in polynomials.b],
            "c": polynomials.c.tolist(),
            "offset": polynomials.offset,
            "parameters": {
                name: {"value": value, "standard_error": error}
                for name, (value, error) in zip(self.parameter_names, values, strict=True)
            },
            "covariance": self.covariance.tolist(),
            "noise_variance": self.noise_variance,
            "condition_number": self.condition_number,
            "input_condition_number": self.input_condition_number,
            "samples": self.n_samples,
            "convergence": asdict(self.convergence),
            "rational": None
            if rational is None
            else {
                "terms": [str(term) for term in rational.terms],
                "nominal_gap_m": rational.nominal_gap,
                "delta_m": rational.delta,
                "plain": list(rational.plain),
            },
            "input_slopes": list(self.input_slopes),
            "notes": list(self.notes),
        }


def check_excitation(runs: Sequence[Array], orders: ArmaxOrders, names: Sequence[str]) -> float:
    """Condition number of the inputs' delayed samples, columns scaled; InputError that names the dependent inputs.

    With the offset, its column of ones counts as an input.
    """
    columns: list[LaggedColumn] = []
    owners: list[str] = []
    for row, (name, lags) in enumerate(zip(names, orders.input_lags, strict=True), start=1):
        columns += [(row, lag) for lag in lags]
        owners += [name] * len(lags)
    if orders.offset:
        columns.append((len(names) + 1, 0))
        owners.append("offset")
    condition, weights = _null_direction(runs, columns, orders)
    if condition < RANK_DEFICIENT:
        return condition
    involved = _involved(weights, owners)
    if len(involved) == 1:
        raise InputError(
            f"input {involved[0]!r} does not excite as many coefficients as its order asks for "
            f"(condition number {condition:.2g} of its delayed samples): lower nb or excite with a richer signal"
        )
    raise InputError(
        f"the inputs {', '.join(map(repr, involved))} are linearly dependent (condition number {condition:.2g} "
        "of their delayed samples): leave one out, add them into one, or excite them independently"
    )


def check_feedback(runs: Sequence[Array], orders: ArmaxOrders, names: Sequence[str]) -> None:
    """Nothing; raises InputError when past outputs determine an input: feedback without external excitation."""
    if orders.na == 0:
        return
    for row, (name, lags) in enumerate(zip(names, orders.input_lags, strict=True), start=1):
        columns = [(0, lag) for lag in range(1, orders.na + 1)] + [(row, lags[0])]
        condition, weights = _null_direction(runs, columns, orders)
        if condition >= RANK_DEFICIENT and weights[-1] > 0.1 * weights.max():
            raise InputError(
                f"input {name!r} is a linear function of past outputs (condition number {condition:.2g}): "
                "under feedback the plant is seen only through an external excitation; add one"
            )


def _null_direction(runs: Sequence[Array], columns: list[LaggedColumn], orders: ArmaxOrders) -> tuple[float, Array]:
    """Condition number of the scaled columns and the sizes of each in the least excited combination."""
    # The target column is a copy of the first one: only the decomposition of the others is looked at.
    with_target = [*columns, columns[0]]
    first = replace(orders, nc=0).longest_lag
    blocks = (block for signals in runs for block in lagged_blocks(signals, with_target, first=first))
    factor = scaled_factor(triangular_factor(blocks, len(with_target)))
    return factor.condition_number, np.abs(factor.right[-1])


def _involved(weights: Array, owners: Sequence[str]) -> list[str]:
    """Owners with a notable part in a combination, in order and once each."""
    limit = 0.1 * weights.max()
    return list(dict.fromkeys(name for name, weight in zip(owners, weights, strict=True) if weight > limit))


@one_blas_thread
def fit_armax(
    runs: Sequence[SampledRun],
    orders: ArmaxOrders,
    *,
    prior: OscillatorPrior | None = None,
    settings: EstimationSettings | None = None,
) -> ArmaxModel:
    """The ARMAX model with the smallest sum of squared one-step prediction errors over all runs.

    The search begins at the cheapest of the starts (long ARX; with `prior` also the believed oscillator) and, if it
    does not converge there, goes on to the next. A prior with a tolerance then counts as further data, weighed by the
    noise that was found without it. InputError for data or orders that cannot be identified;
    ComputationError if no start has a finite cost. `convergence` says how the search ended.
    """
    check_runs(runs)
    names = tuple(runs[0].inputs)
    orders = orders.for_inputs(len(names))
    _check_size(runs, orders)
    signals = [run.signals for run in runs]
    condition = check_excitation(signals, orders, names)
    check_feedback(signals, orders, names)
    settings = settings or EstimationSettings()
    period = runs[0].sampling_period
    problem = EstimationProblem(signals, orders)
    part = EstimationProblem(excerpts(signals, EXCERPT_SAMPLES, longest_lag=orders.longest_lag), orders)
    starts = first_guesses(part.runs, orders, prior, sampling_period=period, names=names)
    best = best_search(part, starts=starts, settings=settings)
    if part.runs is not signals:
        start = FirstGuess(f"{best.convergence.start} on an excerpt", best.evaluation.polynomials)
        best = best_search(problem, starts=[start, *starts], settings=settings)
    if prior is not None and prior.tolerance is not None:
        variance = best.evaluation.noise_variance
        belief = oscillator_belief(prior, orders, names=names, sampling_period=period, noise_variance=variance)
        problem = replace(problem, belief=belief)
        start = FirstGuess(f"{best.convergence.start}, without the prior's weight", best.evaluation.polynomials)
        best = best_search(problem, starts=[start, *starts], settings=settings)
    return estimated_model(problem, best, names=names, sampling_period=period, input_condition_number=condition)


def best_search(
    problem: EstimationProblem, *, starts: Sequence[FirstGuess], settings: EstimationSettings
) -> LikelihoodFit:
    """The search from the cheapest start; if that one does not converge, the lowest end of all that were tried."""
    evaluations = [(start.name, evaluated_reflected(problem, start.polynomials)) for start in starts]
    usable = sorted(
        (pair for pair in evaluations if np.isfinite(pair[1].objective)), key=lambda pair: pair[1].objective
    )
    if not usable:
        raise ComputationError(
            f"no start ({', '.join(start.name for start in starts)}) has a finite prediction error: "
            "check the scaling of the data, lower the orders, or give a prior"
        )
    results: list[LikelihoodFit] = []
    for name, evaluation in usable:
        results.append(maximise_likelihood(problem, start=evaluation, name=name, settings=settings))
        if results[-1].convergence.converged:
            break
    return min(results, key=lambda result: result.evaluation.objective)


def estimated_model(
    problem: EstimationProblem,
    fit: LikelihoodFit,
    *,
    names: tuple[str, ...],
    sampling_period: float,
    input_condition_number: float,
) -> ArmaxModel:
    """The search's result as a model with covariance."""
    evaluation, orders = fit.evaluation, problem.orders
    notes = []
    if input_condition_number > NEARLY_COLLINEAR:
        notes.append(
            f"the inputs are nearly collinear (condition number {input_condition_number:.2g}): their separate "
            "coefficients are uncertain, their sum is not; a larger motion separates them"
        )
    if not fit.convergence.converged:
        notes.append(f"the search did not converge: {fit.convergence.reason}")
    if fit.factor.kept.min() == 0.0:
        notes.append("some coefficients cannot be told apart from these data: their standard errors mean nothing")
    return ArmaxModel(
        orders=orders,
        polynomials=evaluation.polynomials,
        input_names=names,
        sampling_period=sampling_period,
        parameter_names=orders.parameter_names(names),
        covariance=covariance(problem, evaluation),
        noise_variance=evaluation.noise_variance,
        condition_number=fit.factor.condition_number,
        input_condition_number=input_condition_number,
        n_samples=evaluation.n_equations,
        convergence=fit.convergence,
        notes=tuple(notes),
    )


def _check_size(runs: Sequence[SampledRun], orders: ArmaxOrders) -> None:
    needed = SAMPLES_PER_PARAMETER * (orders.n_parameters + orders.nc * len(runs))
    check_length(runs, samples_needed=needed, longest_lag=orders.longest_lag)


def model_from_json(document: Mapping[str, Any]) -> ArmaxModel:
    """The model that `ArmaxModel.to_json` wrote; InputError that names what is missing or not understood."""
    if document.get("kind") != "armax" or document.get("schema") != SCHEMA:
        raise InputError(
            f"kind {document.get('kind')!r}, schema {document.get('schema')!r}: expected an 'armax' model of schema "
            f"{SCHEMA}; identify it anew"
        )
    try:
        model = _model(document)
        check_stored(model)
        return model
    except KeyError as error:
        raise InputError(f"the model lacks the field {error.args[0]!r}: identify it anew") from error
    except (TypeError, ValueError, OverflowError, AttributeError) as error:
        raise InputError(f"the model holds a field of the wrong kind ({error}): identify it anew") from error


def _model(document: Mapping[str, Any]) -> ArmaxModel:
    orders = document["orders"]
    trail = document["convergence"]
    rational = document["rational"]
    return ArmaxModel(
        orders=ArmaxOrders(
            orders["na"], tuple(orders["nb"]), orders["nc"], tuple(orders["nk"]), orders["offset"]
        ).for_inputs(len(document["inputs"])),
        polynomials=Polynomials(
            np.array(document["a"], dtype=float),
            tuple(np.array(b, dtype=float) for b in document["b"]),
            np.array(document["c"], dtype=float),
            float(document["offset"]),
        ),
        input_names=tuple(document["inputs"]),
        sampling_period=float(document["sampling_period_s"]),
        parameter_names=tuple(document["parameters"]),
        covariance=np.array(document["covariance"], dtype=float),
        noise_variance=float(document["noise_variance"]),
        condition_number=float(document["condition_number"]),
        input_condition_number=float(document["input_condition_number"]),
        n_samples=int(document["samples"]),
        convergence=Convergence(
            trail["converged"], trail["reason"], trail["start"], tuple(trail["costs"]), tuple(trail["step_lengths"])
        ),
        rational=None
        if rational is None
        else RationalInputs(
            tuple(rational_term(text) for text in rational["terms"]),
            float(rational["nominal_gap_m"]),
            float(rational["delta_m"]),
            tuple(rational["plain"]),
        ),
        input_slopes=tuple(map(float, document.get("input_slopes", ()))),
        notes=tuple(document["notes"]),
    )
