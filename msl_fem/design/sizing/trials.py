"""The Optuna study of a requirement: opened or made, checked that it belongs, its trials written and read back."""

import contextlib
import datetime
import logging
import math
import time
import warnings
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, TypeVar

import optuna
from optuna.distributions import BaseDistribution, FloatDistribution
from optuna.trial import FrozenTrial, TrialState
from sqlalchemy import event
from sqlalchemy.engine import make_url
from sqlalchemy.exc import IntegrityError, OperationalError, SQLAlchemyError

from msl_fem.computing.arrays import Array
from msl_fem.design.sizing.design import Constraint, Design, total_violation
from msl_fem.design.sizing.evaluation import DesignEvaluation, DesignEvaluator, direction
from msl_fem.design.sizing.parameters import ParameterSpan, SearchSpace
from msl_fem.errors import ComputationError, InputError
from msl_fem.magnetics.kinds.kind import PlaneMagnet

FIRST_DESIGN = "first_design"
ASKED_FOR = "fixed_params"
"""Where Optuna keeps the parameters of a trial that was asked for before it began."""
VERDICT = "verdict"
"""Name of the user attribute of a judged trial; a trial without it was lost on the way."""
Answer = TypeVar("Answer")
PAUSES = (0.2, 0.5, 1.0, 2.0)
"""Seconds between attempts to begin what another process begins as well."""
PATIENCE = 60.0
"""Seconds that a process waits for another one's write to a sqlite file."""
ABANDONED = datetime.timedelta(minutes=10)
"""A trial that has been running for so long was lost with its process: a design is judged in a second."""
REQUIREMENT, SPACE, FIRST = "requirement_sha256", "space", "first_designs"


@dataclass(frozen=True)
class EvaluatedTrial:
    """A trial as the storage has it: `figures` in SI units, of the magnet that the field says it takes."""

    number: int
    parameters: dict[str, float]
    stage: str
    feasible: bool
    values: tuple[float, ...]
    figures: dict[str, Any]
    constraints: tuple[Constraint, ...]
    solves: int
    first_design: str | None = None
    """Its name, where the trial was put in front of the search."""

    @property
    def violation(self) -> float:
        return total_violation(self.constraints)


def evaluation_attribute(design: Design, evaluation: DesignEvaluation) -> dict[str, Any]:
    """The user attribute of a trial: one JSON value, so that it is one write."""
    return {
        "judged": evaluation.stage,
        "feasible": evaluation.feasible,
        "solves": evaluation.solves,
        "design": asdict(design),
        "figures": {} if evaluation.performance is None else figures(evaluation),
        "constraints": [asdict(c) for c in evaluation.constraints],
    }


def figures(evaluation: DesignEvaluation) -> dict[str, Any]:
    """The numbers of a design that scripts read, names with units."""
    found = evaluation.performance
    assert found is not None, "only what can be built has figures"
    numbers = {
        "mass_kg": found.masses.total,
        "moving_mass_kg": found.masses.armature,
        "loss_W": found.loss,
        "force_N": found.force,
        "inductance_H": found.inductance,
        "flux_density_T": found.flux_density,
        "section": found.section,
        "section_flux_densities_T": dict(found.flux_densities),
        "current_A": found.current,
        "turns": found.magnet.coil.turns,
        "resistance_ohm": found.resistance,
        "current_density_A_per_m2": found.current_density,
        "temperature_rise_K": found.temperature_rise,
        "slew_rate_N_per_s": found.slew_rate,
        "stack_depth_m": found.magnet.stack_depth if isinstance(found.magnet, PlaneMagnet) else None,
    }
    # the rise is infinite where no temperature balances the loss: JSON has no word for that
    return {k: None if isinstance(v, float) and not math.isfinite(v) else v for k, v in numbers.items()}


def evaluated_trial(trial: FrozenTrial) -> EvaluatedTrial:
    """A storage's trial that has a verdict."""
    stored = trial.user_attrs[VERDICT]
    values = trial.values if trial.state == TrialState.COMPLETE else None
    return EvaluatedTrial(
        number=trial.number,
        parameters=dict(trial.params),
        stage=stored["judged"],
        feasible=bool(stored["feasible"]) and values is not None,
        values=tuple(values or ()),
        figures=stored["figures"],
        constraints=tuple(Constraint(**fields) for fields in stored["constraints"]),
        solves=int(stored["solves"]),
        first_design=trial.user_attrs.get(FIRST_DESIGN),
    )


@contextlib.contextmanager
def quiet_optuna() -> Iterator[None]:
    """Without Optuna's log and warnings, which would stand between the progress bar's lines."""
    optuna.logging.set_verbosity(optuna.logging.CRITICAL)
    logging.getLogger("alembic").setLevel(logging.CRITICAL)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
        warnings.filterwarnings("ignore", "The constraint value is ignored")  # of a trial that is marked failed anew
        yield


def open_storage(url: str) -> "optuna.storages.BaseStorage":
    """The storage at a URL as Optuna takes it: "sqlite:///file.sqlite3", "mysql://...", "postgresql://...".

    Raises
    ------
    InputError : no storage answers there
    """
    try:
        arguments = {"connect_args": {"timeout": PATIENCE}} if url.startswith("sqlite") else {}
        storage = begun_by_one(lambda: optuna.storages.RDBStorage(url, engine_kwargs=arguments))
        if url.startswith("sqlite"):
            event.listen(storage.engine, "connect", _write_ahead)
            storage.engine.dispose()  # the connections it already has did not hear that
        return storage
    except (SQLAlchemyError, ImportError, ValueError, OSError, RuntimeError, optuna.exceptions.OptunaError) as err:
        raise InputError(
            f"storage '{shown(url)}' cannot be reached ({_reason(err)}); give an Optuna storage URL, like "
            "sqlite:///trials.sqlite3, or leave --storage out"
        ) from err


def begun_by_one(begin: Callable[[], Answer]) -> Answer:
    """What `begin` answers; it is called again where another process began the same at the same moment.

    Of two that make the same tables, study or attribute, the database refuses one, which then finds them made.
    """
    for pause in PAUSES:
        try:
            return begin()
        except (IntegrityError, OperationalError, optuna.exceptions.StorageInternalError) as err:
            if not any(word in str(err) for word in ("UNIQUE", "uplicate", "already exists", "locked")):
                raise
            time.sleep(pause)
    return begin()


def _write_ahead(connection: Any, _: Any) -> None:
    """A write-ahead log: a commit does not wait for the disk, and a file stays whole whenever a process or power ends.

    A dozen commits a trial, each waiting, would cost as much as its field; what may be lost with the power is a trial.
    """
    connection.execute("PRAGMA journal_mode=WAL")
    connection.execute("PRAGMA synchronous=NORMAL")


def new_file(url: str) -> bool:
    """Whether opening the storage would make a file."""
    try:
        parts = make_url(url)
    except SQLAlchemyError:
        return False
    return parts.get_backend_name() == "sqlite" and parts.database is not None and not Path(parts.database).exists()


def _reason(err: BaseException) -> str:
    """The innermost complaint's first line."""
    while err.__cause__ is not None:
        err = err.__cause__
    original = getattr(err, "orig", None) or err
    return (str(original).strip().splitlines() or [type(err).__name__])[0]


def shown(url: str) -> str:
    """The URL as it may stand in a message: without its password."""
    try:
        return make_url(url).render_as_string(hide_password=True)
    except SQLAlchemyError:
        return url


@contextlib.contextmanager
def only_our_content(url: str) -> Iterator[None]:
    """A storage whose content no search wrote is one clear error: a file from elsewhere can hold anything."""
    try:
        yield
    except InputError:
        raise
    except Exception as err:  # Optuna and its database raise errors of many kinds on rows that are missing or odd
        raise _not_ours(url, err) from err


def _not_ours(url: str, err: Exception) -> InputError:
    return InputError(
        f"the storage '{shown(url)}' holds what no search wrote ({type(err).__name__}: {_reason(err)}); give "
        "another --storage, or remove the old file"
    )


def unbeaten(costs: Array) -> list[int]:
    """Rows of costs (n, n_objective) that no other row beats: by being at most as large in all and less in one."""
    return [k for k, c in enumerate(costs) if not ((costs <= c).all(axis=1) & (costs < c).any(axis=1)).any()]


def check_content(study: "optuna.Study", evaluator: DesignEvaluator) -> None:
    """Reads all of a study that a search will read; any exception where a part is missing or of another kind.

    Raises
    ------
    ValueError : directions that are not those of the objectives, a trial whose parameters or values are not the study's
    """
    if len(study.directions) != len(evaluator.requirement.objectives):
        raise ValueError(f"the study has {len(study.directions)} directions")
    space = stored_space(study)
    trials = study.get_trials(deepcopy=False)
    if space is not None and FIRST not in study.user_attrs:
        raise ValueError("the designs that the search begins with are missing")
    for name, parameters in study.user_attrs.get(FIRST, {}).items():
        _check_numbers(f"first design {name}", parameters.values())
    for trial in trials:
        if not isinstance(trial.number, int):
            raise ValueError(f"a trial has the number {trial.number!r}")
        if trial.state == TrialState.COMPLETE:
            _check_numbers(f"trial {trial.number}", trial.values, len(study.directions))
        if space is not None and trial.state.is_finished() and VERDICT in trial.user_attrs:
            _check_numbers(f"trial {trial.number}", [trial.params[name] for name in space.spans])
        dict(trial.system_attrs.get(ASKED_FOR, {}))
        _begun_long_ago(trial)
    for evaluated in evaluated_trials(study):
        _check_numbers(f"constraints of trial {evaluated.number}", [c.violation for c in evaluated.constraints])
        dict(evaluated.figures)
    count_evaluated(study)


def _check_numbers(what: str, values: Iterable[float], count: int | None = None) -> None:
    listed = list(values)
    if not all(isinstance(v, float | int) and math.isfinite(v) for v in listed) or count not in (None, len(listed)):
        raise ValueError(f"{what} has the values {listed}")


@contextlib.contextmanager
def storage_trouble(url: str) -> Iterator[None]:
    """A storage that fails in the block is one clear error: finished trials are in it."""
    try:
        yield
    except (SQLAlchemyError, optuna.exceptions.OptunaError) as err:
        raise ComputationError(
            f"the storage '{shown(url)}' failed on the way ({_reason(err)}); judged designs are kept: run the same "
            "command again"
        ) from err
    except LookupError as err:
        if type(err) is not LookupError:  # an odd row that only a new trial's number brought to light is a plain one
            raise
        raise _not_ours(url, err) from err


def open_study(storage: "optuna.storages.BaseStorage", evaluator: DesignEvaluator) -> "optuna.Study":
    """The requirement's study in a storage, under the requirement's name; made where it is not there yet.

    Raises
    ------
    InputError : a study of that name belongs to another requirement, or to other end effects
    """
    requirement, belongs = evaluator.requirement, evaluator.digest
    directions: list[Any] = [direction(objective) for objective in requirement.objectives]
    study = optuna.create_study(
        storage=storage,
        study_name=requirement.name,
        directions=directions,
        load_if_exists=True,
    )
    empty = not study.get_trials(deepcopy=False)
    known = study.user_attrs.get(REQUIREMENT)  # read last: who puts trials has stated it before
    if known is None and empty:
        study.set_user_attr(REQUIREMENT, belongs)
        study.set_metric_names(list(requirement.objectives))
    elif known != belongs:
        raise InputError(
            f"the storage holds a study '{requirement.name}' of another requirement or of other end effects; rename "
            "the requirement, give another --storage, or remove the old file"
        )
    return study


def stored_space(study: "optuna.Study") -> SearchSpace | None:
    """The space that the study was begun with, None at its beginning."""
    stored = study.user_attrs.get(SPACE)
    if stored is None:
        return None
    return SearchSpace(
        {name: ParameterSpan(*span) for name, span in stored["spans"].items()}, stored["current_density"]
    )


def store_space(study: "optuna.Study", space: SearchSpace) -> None:
    """Keep the space, so that a resumed search goes on in it."""
    spans = {name: [span.low, span.high, span.log] for name, span in space.spans.items()}
    study.set_user_attr(SPACE, {"spans": spans, "current_density": space.current_density})


def distributions(space: SearchSpace) -> dict[str, BaseDistribution]:
    """The space as Optuna has it."""
    return {name: FloatDistribution(s.low, s.high, log=s.log) for name, s in space.spans.items()}


def evaluated_trials(study: "optuna.Study") -> list[EvaluatedTrial]:
    """The trials that came to a verdict, in order of number."""
    trials = study.get_trials(deepcopy=False, states=(TrialState.COMPLETE, TrialState.PRUNED))
    return [evaluated_trial(trial) for trial in trials if VERDICT in trial.user_attrs]


def count_evaluated(study: "optuna.Study") -> int:
    """The number of trials that came to a verdict, or to a field that failed."""
    trials = study.get_trials(deepcopy=False, states=(TrialState.COMPLETE, TrialState.PRUNED, TrialState.FAIL))
    return sum(VERDICT in trial.user_attrs for trial in trials)


def enqueue_first(study: "optuna.Study", designs: dict[str, dict[str, float]]) -> None:
    """Put designs by name before all others, unless they were judged, wait or run; lost ones are put again."""
    alive = {
        trial.user_attrs.get(FIRST_DESIGN)
        for trial in study.get_trials(deepcopy=False)
        if VERDICT in trial.user_attrs or trial.state in (TrialState.WAITING, TrialState.RUNNING)
    }
    for name, parameters in designs.items():
        if name not in alive:
            study.enqueue_trial(parameters, user_attrs={FIRST_DESIGN: name})


def asked(study: "optuna.Study", ranges: dict[str, BaseDistribution]) -> "optuna.Trial":
    """The next trial. One that waited may be finished by another search before this one has taken it: then the one
    after it; each refusal is of another trial that is finished."""
    while True:
        try:
            return study.ask(ranges)
        except optuna.exceptions.UpdateFinishedTrialError:
            continue


def clear_abandoned(study: "optuna.Study") -> None:
    """Mark trials failed whose process was lost long ago."""
    for trial in study.get_trials(deepcopy=False, states=(TrialState.RUNNING,)):
        if _begun_long_ago(trial):
            study.tell(trial.number, state=TrialState.FAIL, skip_if_finished=True)


def _begun_long_ago(trial: FrozenTrial) -> bool:
    return trial.datetime_start is None or datetime.datetime.now() - trial.datetime_start >= ABANDONED
