"""Trials in flight when a search was killed: recognised as such, and gone on with as they were asked."""

import contextlib
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import optuna
from optuna.trial import TrialState
from sqlalchemy.engine import make_url
from sqlalchemy.exc import ArgumentError

from msl_fem.design.sizing.parameters import SearchSpace

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]


@dataclass
class Presence:
    """A search in the folder of a storage's file.

    Attributes
    ----------
    alone : no other search works there; False as well where that cannot be known: of a database server, or without
        locks of folders
    """

    alone: bool = False
    handle: int | None = None

    def let_others_in(self) -> None:
        """Others, who have waited since `at_work`, go on and see this one; before, its trials would seem lost."""
        if self.handle is not None:
            with contextlib.suppress(OSError):
                fcntl.flock(self.handle, fcntl.LOCK_SH)


@contextlib.contextmanager
def at_work(url: str) -> Iterator[Presence]:
    """A search in the folder of a storage's file: whoever is alone keeps others waiting until it lets them in."""
    folder = _folder(url)
    if folder is None or fcntl is None:
        yield Presence()
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        presence = Presence(_locked(handle), handle)
        if not presence.alone:
            presence.let_others_in()
        yield presence
    finally:
        os.close(handle)


def in_flight(study: "optuna.Study", space: SearchSpace) -> list["optuna.Trial"]:
    """The running trials, in order, with the parameters that they were given: what a trial draws depends on the seed,
    its number and what was finished before, so a search by one process ends as if it had not been killed."""
    trials = []
    for lost in study.get_trials(deepcopy=False, states=(TrialState.RUNNING,)):
        trial = optuna.Trial(study, lost._trial_id)
        for name, span in space.spans.items():
            trial.suggest_float(name, span.low, span.high, log=span.log)
        trials.append(trial)
    return trials


def _folder(url: str) -> Path | None:
    try:
        parsed = make_url(url)
    except ArgumentError:
        return None
    if parsed.get_backend_name() != "sqlite" or not parsed.database or parsed.database == ":memory:":
        return None
    folder = Path(parsed.database).parent
    return folder if folder.is_dir() else None


def _locked(handle: int) -> bool:
    """Whether the folder was locked by no one; now it is, by us alone."""
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True
