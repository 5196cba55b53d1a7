"""One made magnet a row: currents of the levels over the gap, force and flux at a point; in processes, kept on disk."""

import time
from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.computing.blas_threads import one_blas_thread
from msl_fem.computing.jobs import Arrays, Executor, Progress, RowCache, run_jobs
from msl_fem.design.tolerances.deviation import NAMES
from msl_fem.design.tolerances.made_magnet import Nominal, made_field
from msl_fem.errors import ComputationError, NotConverged
from msl_fem.magnetics.field_map.level_roots import Climb
from msl_fem.magnetics.field_map.readings import reader_of
from msl_fem.magnetics.kinds.e_core import MagnetField
from msl_fem.magnetics.sweep.rows import field_key
from msl_fem.maps.level_currents import Criterion

METHOD_VERSION = 1
"""Raised when a change of the code changes the answers: kept rows of another version are not used."""


@dataclass(frozen=True)
class Questions:
    """What is asked of every made magnet: currents (A, up to `most`) of levels (T) at gaps (m); force, flux at a point.

    A deviation of the gap adds to all of these gaps. `sections` are those of which one governs; where a deviation makes
    another one govern, the map's current has a kink, and that of each section by itself has none.
    """

    gaps: tuple[float, ...]
    levels: tuple[float, ...]
    sections: tuple[str, ...]
    most: float
    point_current: float
    point_gap: float


@dataclass(frozen=True)
class Made:
    """A made magnet: deviations in the order of `NAMES`; whether each section is asked for by itself."""

    deviation: tuple[float, ...]
    by_section: bool

    @property
    def cost(self) -> int:
        """About the number of section currents."""
        return 2 if self.by_section else 1


@dataclass(frozen=True)
class MadeJob:
    """What a process needs to answer for made magnets."""

    nominal: Nominal
    questions: Questions

    def solver(self) -> "MadeSolver":
        """What answers the questions about magnets as made, in a process of its own if need be."""
        return MadeSolver(self)

    @cached_property
    def key(self) -> str:
        """What determines the answers, as a name."""
        return field_key(made_field(self.nominal, {}), questions=self.questions, method=METHOD_VERSION)


class MadeSolver:
    """Answers for one made magnet after the other."""

    def __init__(self, job: MadeJob) -> None:
        self.job = job

    @one_blas_thread
    def solve(self, row: Made) -> Arrays:
        """force N, flux_linkage Wb and currents in A, nan where a level is not reached.

        Currents are `current` (n_level, n_gap) of the section that governs, or with `by_section` those of each,
        `section_current` (n_section, n_level, n_gap). Raises ComputationError, which names the magnet.
        """
        started = time.process_time()
        asked = self.job.questions
        deviation = dict(zip(NAMES, row.deviation, strict=True))
        off = deviation["gap"]
        try:
            field = made_field(self.job.nominal, deviation)
            if row.by_section:
                per_section = [self._currents(field, only(field, name), off) for name in asked.sections]
                found = {"section_current": np.stack(per_section)}
            else:
                found = {"current": self._currents(field, field, off)}
            at = field.quantities(field.solve(asked.point_current, asked.point_gap + off))
        except (NotConverged, ComputationError, ValueError) as err:
            raise ComputationError(
                f"the magnet with {_told(row)} failed: {err}; make the tolerances smaller, or leave out the level or "
                "gap; finished magnets are kept for --resume"
            ) from err
        return found | {
            "force": np.array(at.force),
            "flux_linkage": np.array(at.flux_linkage),
            "cpu_seconds": np.array(time.process_time() - started),
        }

    def _currents(self, field: MagnetField, read_on: MagnetField, off: float) -> Array:
        """(n_level, n_gap) A; the field is read where the probes of `read_on` are."""
        asked, reader = self.job.questions, reader_of(read_on, Criterion("mean"))
        columns = []
        for gap in asked.gaps:
            climb = Climb(field, reader, gap + off)
            columns.append([climb.root(level, asked.most).current for level in asked.levels])
        return np.array(columns).T


def only(field: MagnetField, section: str) -> MagnetField:
    """The same field, probed on one section."""
    view = copy(field)
    view.probes = copy(field.probes)
    view.probes.cuts = {section: field.probes.cuts[section]}
    return view


@dataclass(frozen=True)
class Running:
    """How rows are solved: by what, the folder of finished rows (None keeps none), whether they are taken from it."""

    executor: Executor
    cache: RowCache | None = None
    resume: bool = False
    progress: Progress | None = None


def answers(
    job: MadeJob, deviations: Sequence[dict[str, float]], running: Running, *, by_section: bool = False
) -> list[Arrays]:
    """The answers for made magnets, in order; each is kept as soon as it is there.

    Raises
    ------
    ComputationError : a field did not converge, or a process died; what is finished is kept
    """
    return run_jobs(
        job,
        [Made(tuple(float(d.get(name, 0.0)) for name in NAMES), by_section) for d in deviations],
        executor=running.executor,
        cache=running.cache,
        key=job.key if running.cache is not None else "",
        resume=running.resume,
        progress=running.progress,
    )


def _told(row: Made) -> str:
    return (
        ", ".join(f"{name} off by {d:.3g}" for name, d in zip(NAMES, row.deviation, strict=True) if d) or "no deviation"
    )
