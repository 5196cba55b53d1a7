"""From a record on disk to an identified model: which channels, which terms, which runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from msl_fem.errors import InputError
from msl_fem.identification.armax import fit_armax
from msl_fem.identification.data import SampledRun
from msl_fem.identification.fit_figures import RunFit, fit_figures
from msl_fem.identification.gap_offset import DeltaSearch, identify_rational
from msl_fem.identification.model import ArmaxModel
from msl_fem.identification.polynomials import ArmaxOrders
from msl_fem.identification.prior import OscillatorPrior
from msl_fem.identification.rational import RationalInputs, rational_term
from msl_fem.identification.residual_tests import CorrelationTest, residual_tests
from msl_fem.record import Record, Run

FORCE = "force"
POSITION = "position"


@dataclass(frozen=True)
class ModelChoice:
    """What is identified.

    Attributes
    ----------
    orders : of ARMAX; without, na = nb = nc = 2, nk = 1 (a mass on a spring under a held force, noise on its position),
        and a constant for a rig with no magnets, whose friction and drive offset have no other place
    terms : texts such as "i1^2/g1^2"; without, i^2/g^2 of every side, the magnets' law below saturation
    delta : whether the gap offset of the terms is estimated
    """

    orders: ArmaxOrders | None = None
    terms: tuple[str, ...] = ()
    delta: bool = True


@dataclass(frozen=True, eq=False)
class Identification:
    """An ARMAX model of a record, its fit on every run, and tests of its residuals on the first run that was fitted."""

    model: ArmaxModel
    fits: tuple[RunFit, ...]
    roles: tuple[str, ...]
    residual_tests: tuple[CorrelationTest, ...]

    def fields(self) -> dict[str, Any]:
        """The JSON fields of `identify`."""
        model = self.model
        values = zip(model.parameter_names, model.parameters, model.standard_errors, strict=True)
        return {
            "parameters": {name: {"value": float(v), "standard_error": float(s)} for name, v, s in values},
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
            "notes": list(model.notes),
        }


def identify(record: Record, *, choice: ModelChoice | None = None) -> Identification:
    """The ARMAX model identified on the record's `fit` runs and judged on all of them.

    Raises
    ------
    InputError : no run to fit, no channel that drives the position, terms or orders that the data cannot bear
    """
    choice = choice or ModelChoice()
    fitted = record.runs_of("fit")
    if not fitted:
        raise InputError("the record has no run with role fit; mark one in rig.toml")
    runs = {run.name: sampled_run(record, run) for run in record.runs}
    data = [runs[run.name] for run in fitted]
    model = _magnetic(record, data, choice) if record.actuator.magnet is not None else _mechanical(record, data, choice)
    return Identification(
        model=model,
        fits=fit_figures(model, list(runs.values())),
        roles=tuple(run.role for run in record.runs),
        residual_tests=residual_tests(model, data[0]),
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


def _magnetic(record: Record, runs: Sequence[SampledRun], choice: ModelChoice) -> ArmaxModel:
    motion = record.actuator.motion
    if motion is None or motion.nominal_gap is None:
        raise InputError(f"{record.actuator.name} states no motion.nominal_gap, which the rational terms need")
    sides = [name[1] for name in runs[0].inputs if name.startswith("i")]
    texts = choice.terms or tuple(f"i{side}^2/g{side}^2" for side in sides)
    plain = tuple(name for name in runs[0].inputs if name == FORCE)
    rational = RationalInputs(tuple(map(rational_term, texts)), motion.nominal_gap, plain=plain)
    prior = OscillatorPrior(motion.moving_mass, motion.damping, motion.stiffness)
    orders = choice.orders or ArmaxOrders(2, 2, 2, 1)
    search = DeltaSearch() if choice.delta else None
    return identify_rational(runs, orders, rational=rational, prior=prior, search=search)


def _mechanical(record: Record, runs: Sequence[SampledRun], choice: ModelChoice) -> ArmaxModel:
    motion = record.actuator.motion
    prior = OscillatorPrior(motion.moving_mass, motion.damping, motion.stiffness, {FORCE: 1.0}) if motion else None
    return fit_armax(runs, choice.orders or ArmaxOrders(2, 2, 2, 1, offset=True), prior=prior)
