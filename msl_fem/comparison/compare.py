"""The comparative model-accuracy report of a record, as numbers."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from msl_fem.comparison.judged import LEAD, ModelAccuracy, armax_accuracy, coupled_accuracy
from msl_fem.comparison.models import ANALYTIC, COUPLED, ComparedModels, analytic_table, fitted_models
from msl_fem.comparison.own_loop import OwnLoop, own_loop
from msl_fem.comparison.residuals import LocatedResidual, locate_residual
from msl_fem.comparison.static_map import StaticError, static_errors
from msl_fem.comparison.verdict import comparison_verdict
from msl_fem.errors import ComputationError, InputError
from msl_fem.prediction import ModelHypothesis, RunData, open_loop_stable, run_data
from msl_fem.prediction.run_data import POSITION_COLUMN
from msl_fem.record import Record
from msl_fem.table.magnetic_table import MagneticTable

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True, eq=False)
class CompareSettings:
    """What a comparison takes beside the record: the table of its magnets, an extended model, a progress report."""

    table: MagneticTable | None = None
    extended: ModelHypothesis | None = None
    progress: Progress | None = None


@dataclass(frozen=True, eq=False)
class Comparison:
    """All models against all runs and the static map; `data` are the runs as the models took them."""

    record: Record
    data: tuple[RunData, ...]
    models: ComparedModels
    judged: tuple[ModelAccuracy, ...]
    residuals: tuple[LocatedResidual, ...]
    static: tuple[StaticError, ...]
    verdict: str

    def noise_floor(self) -> list[dict[str, Any]]:
        """Noise by run and channel, in the channel's unit and over its standard deviation, and where it comes from."""
        return [
            {
                "run": run.name,
                "role": run.role,
                "channel": name,
                "sigma": floor.sigma,
                "nrmse": floor.sigma / float(run.measured[name][LEAD:].std()),
                "source": floor.source,
            }
            for run in self.data
            for name, floor in run.noise.items()
        ]

    def fields(self) -> dict[str, Any]:
        """The content of compare.json."""
        refit = self.models.refit
        parameters = {}
        if refit is not None:
            parameters = {
                name: {
                    "believed": p.believed,
                    "fitted": p.value,
                    "ci95": [p.low, p.high],
                    "tolerances": p.tolerances,
                }
                for name, p in refit.parameters.items()
            }
        return {
            "schema": 1,
            "verdict": self.verdict,
            "models": [j.fields() for j in self.judged],
            "noise_floor": self.noise_floor(),
            "parameters": parameters,
            "refit_by": refit.by if refit else None,
            "process_noise": {
                m.name: {"velocity_m_per_s": m.noise.velocity, "current_A": m.noise.current}
                for m in self.models.coupled
            },
            "static": [s.fields() for s in self.static],
            "residuals": [r.fields() for r in self.residuals],
            "notes": [*self.record.warnings, *self.models.notes],
        }


def compare(record: Record, settings: CompareSettings | None = None) -> Comparison:
    """The models of a record, fitted on its `fit` runs, against all of its runs and its static map.

    Raises
    ------
    InputError : the record lacks what the coupled model needs, or its magnets' table is missing
    ComputationError : a model's equations cannot be solved
    """
    settings = settings or CompareSettings()
    table = settings.table
    if record.actuator.magnet is not None and table is None:
        raise InputError(f"{record.actuator.name} has magnets and there is no table; make one with 'msl-fem table'")
    data = tuple(run_data(record, run) for run in record.runs)
    steps = _Steps(settings.progress, 7 + len(data))
    models = ComparedModels((), None, None, ())
    judged: list[ModelAccuracy] = []
    if data:
        models = fitted_models(record, data, table, settings.extended, steps.next)
        loop, models = _loop(record, table, models)
        for run, its in zip(record.runs, data, strict=True):
            steps.next(its.name)
            asked = None if loop is None else loop.beside(run, its)
            for model in models.coupled:
                judged += coupled_accuracy(model, its, asked)
            if models.armax is not None:
                stable = open_loop_stable(ModelHypothesis(record.actuator, table), its)
                judged += armax_accuracy(models.armax, record, run, its, stable=stable, looped=asked is not None)
    where = [r for j in judged if (r := locate_residual(record, record.run(j.run), j)) is not None]
    static = _static(record, table)
    floor = {
        run.name: run.noise[POSITION_COLUMN].sigma / float(run.measured[POSITION_COLUMN][LEAD:].std())
        for run in data
        if run.role == "held-out"
    }
    steps.done()
    said = comparison_verdict(judged, where, floor, static)
    return Comparison(record, data, models, tuple(judged), tuple(where), tuple(static), said)


def _loop(record: Record, table: MagneticTable | None, models: ComparedModels) -> tuple[OwnLoop | None, ComparedModels]:
    """The loop that a design of ours drove, and the models with a note where it cannot be made again."""
    try:
        return own_loop(record, table), models
    except (InputError, ComputationError) as err:
        return None, replace(models, notes=(*models.notes, f"closed loop: left out, {err}"))


def _static(record: Record, table: MagneticTable | None) -> list[StaticError]:
    if record.static is None or table is None:
        return []
    found = static_errors(ANALYTIC, analytic_table(record.actuator, table), record.static)
    return found + static_errors(COUPLED, table, record.static)


class _Steps:
    """Counts finished work for a progress report."""

    def __init__(self, tell: Progress | None, total: int) -> None:
        self.tell, self.total, self.n = tell or (lambda *_: None), total, 0

    def next(self, what: str) -> None:
        self.tell(what, self.n, self.total)
        self.n = min(self.n + 1, self.total)

    def done(self) -> None:
        self.tell("done", self.total, self.total)
