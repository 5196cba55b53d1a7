"""The comparative model-accuracy report of a record, as numbers, and one sentence on which model is best."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from msl_fem.comparison.accuracy import (
    LEAD,
    LocatedResidual,
    ModelAccuracy,
    armax_accuracy,
    coupled_accuracy,
    locate_residual,
)
from msl_fem.comparison.models import (
    ANALYTIC,
    ARMAX,
    COUPLED,
    REFITTED,
    ComparedModels,
    OwnLoop,
    analytic_table,
    fitted_models,
    own_loop,
)
from msl_fem.computing.arrays import Array
from msl_fem.errors import ComputationError, InputError
from msl_fem.maps.pair_limits import PairMap
from msl_fem.plant.believed import PLAIN_BELIEF, Belief
from msl_fem.prediction import ModelHypothesis, RunData, open_loop_stable, run_data
from msl_fem.prediction.run_data import POSITION_COLUMN
from msl_fem.record import Record, Role, StaticMap
from msl_fem.table.magnetic_table import MagneticTable

Progress = Callable[[str, int, int], None]
MapQuantity = Literal["force_N", "flux_linkage_Wb"]
FEWEST_ROWS = 3  # of a static map that still say something
WORDS = {
    "free_run": "in free run",
    "closed_loop": "in closed loop",
    "ten_step": "ten samples ahead",
    "one_step": "one sample ahead",
}
LEVEL = 1.05  # two models whose errors are within this factor are level
WORSE, POWERFUL = 3.0, 1e-3  # of a band: errors to compare, share of the power that counts as excited


@dataclass(frozen=True, eq=False)
class StaticError:
    """A table against the rows of one role.

    Attributes
    ----------
    gap, current, measured, computed : (n_row,) rows inside the table
    outside : rows that lie outside it, and are not judged
    scale, scale_error : measured over computed by least squares, and its standard error
    """

    model: str
    role: Role
    quantity: MapQuantity
    gap: Array
    current: Array
    measured: Array
    computed: Array
    outside: int
    scale: float
    scale_error: float

    @property
    def error(self) -> Array:
        """(n_row,) measured less computed."""
        return self.measured - self.computed

    @property
    def of_full_scale(self) -> float:
        """RMS error over the largest measured value."""
        return float(np.sqrt(np.mean(self.error**2)) / np.abs(self.measured).max())

    def to_json(self) -> dict[str, Any]:
        """An entry of `static`."""
        return {
            "name": self.model,
            "role": self.role,
            "quantity": self.quantity,
            "rows": self.measured.size,
            "rows_outside": self.outside,
            "rms_error": float(np.sqrt(np.mean(self.error**2))),
            "mean_error": float(np.mean(self.error)),
            "error_of_full_scale": self.of_full_scale,
            "scale": self.scale,
            "scale_standard_error": self.scale_error,
            "gap_m": self.gap,
            "current_A": self.current,
            "error": self.error,
        }


@dataclass(frozen=True, eq=False)
class CompareSettings:
    """What a comparison takes beside the record: the table of its magnets, an extended model, a progress report, what
    the coupled model is believed to have beside the plain one, the map by which a loop's guard judged both sides."""

    table: MagneticTable | None = None
    extended: ModelHypothesis | None = None
    progress: Progress | None = None
    belief: Belief = PLAIN_BELIEF
    pair: PairMap | None = None


@dataclass(frozen=True, eq=False)
class Comparison:
    """All models against all runs and the static map; `data` are the runs as the models took them."""

    record: Record
    data: tuple[RunData, ...]
    models: ComparedModels
    accuracies: tuple[ModelAccuracy, ...]
    residuals: tuple[LocatedResidual, ...]
    static: tuple[StaticError, ...]
    verdict: str

    def noise_floor(self) -> list[dict[str, Any]]:
        """Noise by run and channel, in the channel's unit and over its standard deviation, and where it comes from."""
        rows = []
        for run in self.data:
            for name, floor in run.noise.items():
                row = {
                    "run": run.name,
                    "role": run.role,
                    "channel": name,
                    "sigma": floor.sigma,
                    "nrmse": _relative_noise(run, name),
                    "source": floor.source,
                }
                rows.append(row)
        return rows

    def to_json(self) -> dict[str, Any]:
        """The content of compare.json."""
        refit = self.models.refit
        parameters = {}
        for name, p in refit.parameters.items() if refit is not None else ():
            parameters[name] = {
                "believed": p.believed,
                "fitted": p.value,
                "ci95": [p.low, p.high],
                "tolerances": p.tolerances,
            }
        process_noise = {}
        for model in self.models.coupled:
            noise = model.noise
            process_noise[model.name] = {"velocity_m_per_s": noise.velocity, "current_A": noise.current}
        return {
            "schema": 1,
            "verdict": self.verdict,
            "models": [accuracy.to_json() for accuracy in self.accuracies],
            "noise_floor": self.noise_floor(),
            "parameters": parameters,
            "refit_by": refit.by if refit else None,
            "process_noise": process_noise,
            "static": [error.to_json() for error in self.static],
            "residuals": [residual.to_json() for residual in self.residuals],
            "notes": [*self.record.warnings, *self.models.notes],
        }


def _relative_noise(run: RunData, channel: str) -> float:
    """Noise of a channel over its standard deviation."""
    return run.noise[channel].sigma / float(run.measured[channel][LEAD:].std())


def compare(record: Record, settings: CompareSettings | None = None) -> Comparison:
    """The models of a record, fitted on its `fit` runs, against all of its runs and its static map.

    Raises
    ------
    InputError : the record lacks what the coupled model needs, or its magnets' table is missing
    ComputationError : a model's equations cannot be solved
    """
    settings = settings or CompareSettings()
    record = record.free
    table = settings.table
    if record.actuator.magnet is not None and table is None:
        raise InputError(f"{record.actuator.name} has magnets and there is no table; make one with 'msl-fem table'")
    data = tuple(run_data(record, run) for run in record.runs)
    steps = _Steps(settings.progress, 7 + len(data))
    models = ComparedModels((), None, None, ())
    accuracies: list[ModelAccuracy] = []
    if data:
        believed = ModelHypothesis.of(record.actuator, table, settings.belief)
        models = fitted_models(record, data, believed, settings.extended, steps.next)
        loop, models = _loop(record, believed, models, settings.pair)
        for run, inputs in zip(record.runs, data, strict=True):
            steps.next(inputs.name)
            law = None if loop is None else loop.beside(run, inputs)
            for model in models.coupled:
                accuracies += coupled_accuracy(model, inputs, law)
            if models.armax is not None:
                stable = open_loop_stable(believed, inputs)
                looped = law is not None
                accuracies.append(armax_accuracy(models.armax, record, run, inputs, stable=stable, looped=looped))
    located = [locate_residual(record, record.run(accuracy.run), accuracy) for accuracy in accuracies]
    residuals = [residual for residual in located if residual is not None]
    static = _static(record, table)
    floor = {run.name: _relative_noise(run, POSITION_COLUMN) for run in data if run.role == "held-out"}
    steps.done()
    verdict = comparison_verdict(accuracies, residuals, floor, static)
    return Comparison(record, data, models, tuple(accuracies), tuple(residuals), tuple(static), verdict)


def _loop(
    record: Record, believed: ModelHypothesis, models: ComparedModels, pair: PairMap | None
) -> tuple[OwnLoop | None, ComparedModels]:
    """The loop of a design of ours, and the models with a note where it cannot be made again."""
    try:
        return own_loop(record, believed.table, believed.effects, pair), models
    except (InputError, ComputationError) as err:
        return None, replace(models, notes=(*models.notes, f"closed loop: left out, {err}"))


class _Steps:
    """Counts finished work for a progress report."""

    def __init__(self, tell: Progress | None, total: int) -> None:
        self.tell = tell or (lambda *_: None)
        self.total = total
        self.n = 0

    def next(self, what: str) -> None:
        self.tell(what, self.n, self.total)
        self.n = min(self.n + 1, self.total)

    def done(self) -> None:
        self.tell("done", self.total, self.total)


def _static(record: Record, table: MagneticTable | None) -> list[StaticError]:
    if record.static is None or table is None:
        return []
    analytic = analytic_table(record.actuator, table)
    return static_errors(ANALYTIC, analytic, record.static) + static_errors(COUPLED, table, record.static)


def static_errors(name: str, table: MagneticTable, static: StaticMap) -> list[StaticError]:
    """The table against all rows of the map, role by role, quantity by quantity."""
    in_gaps = (static.gap >= table.gap[0]) & (static.gap <= table.gap[-1])
    inside = in_gaps & (np.abs(static.current) <= table.current[-1])
    roles: tuple[Role, ...] = ("fit", "held-out")
    quantities: tuple[tuple[MapQuantity, Array | None], ...] = (
        ("force_N", static.force),
        ("flux_linkage_Wb", static.flux_linkage),
    )
    errors = []
    for role in roles:
        rows = static.rows(role)
        kept = rows[inside[rows]]
        if kept.size < FEWEST_ROWS:
            continue
        values = table.evaluate(static.current[kept], static.gap[kept])
        for quantity, column in quantities:
            if column is None:
                continue
            computed = np.asarray(values[quantity.rpartition("_")[0]])
            scale, scale_error = _scale(column[kept], computed)
            error = StaticError(
                model=name,
                role=role,
                quantity=quantity,
                gap=static.gap[kept],
                current=static.current[kept],
                measured=column[kept],
                computed=computed,
                outside=int(rows.size - kept.size),
                scale=scale,
                scale_error=scale_error,
            )
            errors.append(error)
    return errors


def _scale(measured: Array, computed: Array) -> tuple[float, float]:
    power = float(computed @ computed)
    scale = float(measured @ computed) / power
    spread = float(np.sum((measured - scale * computed) ** 2)) / (measured.size - 1)
    return scale, float(np.sqrt(spread / power))


def score(accuracies: Sequence[ModelAccuracy], model: str, kind: str) -> float | None:
    """RMS over the held-out runs of a model's position NRMSE; None where one is missing."""
    held_out = [a for a in accuracies if a.role == "held-out" and a.channel == POSITION_COLUMN]
    values = [accuracy.nrmse[kind] for accuracy in held_out if accuracy.model == model]
    known = [value for value in values if value is not None]
    if not known or len(known) < len(values):
        return None
    return float(np.sqrt(np.mean([value**2 for value in known])))


def judging_kind(accuracies: Sequence[ModelAccuracy]) -> str | None:
    """The hardest prediction that two models at least bear on all held-out runs, or one where there is one alone."""
    names = {accuracy.model for accuracy in accuracies}
    for fewest in (min(2, len(names)), 1):
        for kind in WORDS:
            if sum(score(accuracies, name, kind) is not None for name in names) >= fewest:
                return kind
    return None


def comparison_verdict(
    accuracies: Sequence[ModelAccuracy],
    residuals: Sequence[LocatedResidual],
    floor: Mapping[str, float],
    static: Sequence[StaticError],
) -> str:
    """The sentence on which model is best on held-out runs; `floor` holds the position's noise over its standard
    deviation by held-out run."""
    kind = judging_kind(accuracies)
    if kind is None or not floor:
        return _static_verdict(static) if static else "No model could be judged on a held-out run."
    names = list(dict.fromkeys(accuracy.model for accuracy in accuracies))
    scores = {name: value for name in names if (value := score(accuracies, name, kind)) is not None}
    best = min(scores, key=lambda name: scores[name])
    limit = float(np.sqrt(np.mean(np.square(list(floor.values())))))
    level = [name for name in scores if name != best and scores[name] <= LEVEL * scores[best]]
    also = f" (level with {' and '.join(level)})" if level else ""
    parts = [
        f"On held-out runs '{best}' is best {WORDS[kind]}{also}: position NRMSE {scores[best]:.3g}, "
        f"{scores[best] / limit:.3g} times the noise floor"
    ]
    if COUPLED in scores and REFITTED in scores:
        gain = scores[COUPLED] / scores[REFITTED]
        gains = f"gains a factor of {gain:.3g}" if gain > LEVEL else "gains nothing"
        parts.append(f"the re-fit {gains} over the model as believed ({scores[COUPLED]:.3g})")
    if ARMAX in scores and COUPLED in scores:
        parts.append(_armax_clause(scores, residuals))
    missing = [name for name in names if name not in scores]
    if missing:
        parts.append(f"{' and '.join(missing)} could not be judged {WORDS[kind]}")
    return "; ".join(parts) + "."


def _armax_clause(scores: Mapping[str, float], residuals: Sequence[LocatedResidual]) -> str:
    ratio = scores[COUPLED] / scores[ARMAX]
    if ratio > LEVEL:
        text = f"the coupled model as believed loses to ARMAX ({scores[ARMAX]:.3g}) by a factor of {ratio:.3g}"
    elif ratio < 1 / LEVEL:
        text = f"ARMAX ({scores[ARMAX]:.3g}) loses to the coupled model as believed by a factor of {1 / ratio:.3g}"
    else:
        text = f"ARMAX ({scores[ARMAX]:.3g}) and the coupled model as believed are level"
    outside = armax_outside_its_band(residuals)
    return f"{text}, and fails outside its band, {outside}" if outside else text


def armax_outside_its_band(residuals: Sequence[LocatedResidual]) -> str:
    """The held-out band that the fit runs hardly excited and where ARMAX errs most, in words; none: an empty text."""
    own = [residual for residual in residuals if residual.accuracy.model == ARMAX]
    excited: dict[float, float] = {}
    for residual in own:
        if residual.accuracy.role == "fit":
            for low, share in zip(residual.bands.edges[:-1], _power_share(residual), strict=True):
                excited[float(low)] = max(excited.get(float(low), 0.0), float(np.nan_to_num(share)))
    if not excited:
        return ""
    inside: list[float] = []
    outside: list[tuple[float, float, float]] = []
    for residual in own:
        if residual.accuracy.role != "held-out":
            continue
        bands = residual.bands
        for n, share in enumerate(_power_share(residual)):
            error, low, high = float(bands.nrmse[n]), float(bands.edges[n]), float(bands.edges[n + 1])
            if not np.isfinite(error) or not share > POWERFUL:
                continue
            if excited.get(low, 0.0) > POWERFUL:
                inside.append(error)
            else:
                outside.append((error, low, high))
    if not outside or not inside:
        return ""
    worst, low, high = max(outside)
    typical = float(np.median(inside))
    if worst < WORSE * typical:
        return ""
    return f"{low:.3g} ... {high:.3g} Hz: NRMSE {worst:.2g} there, {typical:.2g} in its band"


def _power_share(residual: LocatedResidual) -> Array:
    """(n_band,) of the measured channel's power."""
    power = residual.bands.measured**2
    return np.asarray(power / np.nansum(power))


def _static_verdict(static: Sequence[StaticError]) -> str:
    errors = [error for error in static if error.role == "held-out"] or list(static)
    where = "held-out rows" if errors[0].role == "held-out" else "the rows of the map, all of which are marked fit,"
    best = min(errors, key=lambda error: error.of_full_scale)
    quantity = best.quantity.rpartition("_")[0].replace("_", " ")
    return (
        f"On {where} the table of '{best.model}' is best: {quantity} off by "
        f"{100 * best.of_full_scale:.2g} % of full scale (RMS), measured over computed {best.scale:.4g}."
    )
