"""A record of measured or simulated data: the rig as believed, its runs and its static map, frozen."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from msl_fem.actuator import Actuator
from msl_fem.computing.arrays import Array
from msl_fem.computing.laws import LawExpression
from msl_fem.errors import RecordError
from msl_fem.files.quantity import format_quantity
from msl_fem.files.shown import Shown, Tabular
from msl_fem.record.columns import UNITS
from msl_fem.record.linear_law import StatedLaw, law_of, linear_laws
from msl_fem.record.rig_file import (
    DEMAGNETISED,
    BeliefWord,
    GapZero,
    Mover,
    Noise,
    Origin,
    Role,
    RowOrder,
    Sampling,
    Scale,
    Scheduling,
    Tolerance,
)


def read_only(values: ArrayLike) -> Array:
    """A float64 copy that cannot be written to."""
    array = np.array(values, dtype=np.float64)
    array.setflags(write=False)
    return array


def _texts_or_numbers(values: ArrayLike) -> NDArray[Any]:
    array = np.array(values)
    array = array.astype(str if array.dtype.kind in "OUS" else np.float64)
    array.setflags(write=False)
    return array


@dataclass(frozen=True, eq=False, repr=False)
class Run(Tabular):
    """One dynamic run, sampled in equal steps.

    Attributes
    ----------
    name : of the run, the file's name without its ending
    excitation : in words, or as an excitation's SPEC
    role : "fit" or "held-out"
    columns : (n_sample,) each, by RECORDS' names with the SI unit in them; read-only; `time_s` is always there
    extra : columns of the file that the format does not know; kept, not used
    file_format : "csv" or "nc" (NetCDF)
    valid : column to (n_sample,) whether its readings count, where some do not; there the column holds a straight line
    mover : "free", "locked" (held where it was), "imposed" (moved by a hand or a machine that measures the force), or
        "absent": taken away
    """

    name: str
    excitation: str
    role: Role
    columns: Mapping[str, Array]
    extra: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    file_format: Literal["csv", "nc"] = "csv"
    valid: Mapping[str, NDArray[np.bool_]] = field(default_factory=dict)
    mover: Mover = "free"

    def __post_init__(self) -> None:
        frozen = {name: read_only(values) for name, values in self.columns.items()}
        if "time_s" not in frozen:
            raise RecordError(f"run {self.name}: column time_s is missing")
        extra = {name: _texts_or_numbers(values) for name, values in self.extra.items()}
        valid = {name: np.array(values, dtype=bool) for name, values in self.valid.items()}
        for name, values in {**frozen, **extra, **{f"valid_{name}": flags for name, flags in valid.items()}}.items():
            if values.shape != (frozen["time_s"].size,):
                raise RecordError(
                    f"run {self.name}: column {name} has the shape {values.shape}, "
                    f"time_s has {frozen['time_s'].shape}; give one value a sample"
                )
        object.__setattr__(self, "columns", frozen)
        object.__setattr__(self, "extra", extra)
        object.__setattr__(self, "valid", valid)

    def facts(self) -> dict[str, str]:
        """Name, length, excitation, role and columns."""
        return {
            "name": self.name,
            "samples": f"{self.time.size} in {format_quantity(float(np.ptp(self.time)), 's')}",
            "role": self.role,
            "excitation": self.excitation,
            "columns": ", ".join(self.columns),
        } | ({} if self.mover == "free" else {"mover": self.mover})

    def frame_columns(self) -> dict[str, NDArray[Any]]:
        """time_s, the other columns, which of their readings are valid, and what the format does not know."""
        masks = {f"valid_{name}": flags.astype(np.float64) for name, flags in self.valid.items()}
        return {"time_s": self.time, **self.columns, **masks, **self.extra}

    def __getitem__(self, column: str) -> Array:
        """The column (n_sample,); RecordError where the run has none of this name."""
        try:
            return self.columns[column]
        except KeyError:
            raise RecordError(f"run {self.name} has no column {column}; it has {', '.join(self.columns)}") from None

    def __contains__(self, column: object) -> bool:
        return column in self.columns

    @property
    def file(self) -> str:
        return f"{self.name}.{self.file_format}"

    @property
    def time(self) -> Array:
        """Instants of the samples in s, (n_sample,)."""
        return self.columns["time_s"]

    @property
    def sampling_period(self) -> float:
        """Mean step of the time in s."""
        return float((self.time[-1] - self.time[0]) / (self.time.size - 1))


MAP_READINGS = {"force_N": "force", "flux_linkage_Wb": "flux_linkage", "flux_density_T": "flux_density"}
"""Columns that a static map may have read, one of them at least, and its fields."""
_COLUMNS_OF_ROWS = (
    "gap", "current", "force", "flux_linkage", "flux_density", "role", "direction", "sequence", "unit",
)  # fmt: skip


@dataclass(frozen=True, eq=False, repr=False)
class StaticMap(Tabular):
    """Quasi-static rows of one magnet in the order of measurement, (n_row,) each.

    Attributes
    ----------
    gap, current : m, A
    force, flux_linkage : N, Wb; None where not measured, one of them is there
    flux_density : T at one place of the iron or the gap, in proportion to the flux linkage; None where not measured
    role : "fit" or "held-out", a row
    direction : "up" or "down", a row; None where not stated
    sequence : number of the loop that a row belongs to; None where there is one
    unit : name of the magnet that a row was taken of; None where there is one
    sigma : column to one sigma of each row, where a column of it states it
    gap_zero : whether the gaps are those of gauges, with a zero of their own, or of the mover of the runs
    order : "measured", or "unknown": then no row knows what came before
    before : what the iron had gone through: "demagnetised", "unknown", "cycled:+10 A"
    scale : "stated", or "free": the readings are in proportion to what their names say
    extra : columns that the format does not know
    """

    gap: Array
    current: Array
    force: Array | None
    flux_linkage: Array | None
    role: NDArray[np.str_]
    direction: NDArray[np.str_] | None = None
    sequence: Array | None = None
    extra: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    gap_zero: GapZero = "gauge"
    flux_density: Array | None = None
    unit: NDArray[np.str_] | None = None
    sigma: Mapping[str, Array] = field(default_factory=dict)
    order: RowOrder = "measured"
    before: str = DEMAGNETISED
    scale: Scale = "stated"

    @property
    def readings(self) -> dict[str, Array]:
        """What was measured, (n_row,) each, by its column."""
        columns = {name: getattr(self, field_name) for name, field_name in MAP_READINGS.items()}
        return {name: values for name, values in columns.items() if values is not None}

    def with_readings(self, readings: Mapping[str, Array]) -> "StaticMap":
        """The map with other readings (n_row,) in these columns."""
        changed: dict[str, Any] = {MAP_READINGS[name]: values for name, values in readings.items()}
        return replace(self, **changed)

    def at(self, kept: NDArray[np.bool_] | NDArray[np.intp]) -> "StaticMap":
        """Some of its rows, without further columns."""
        some: dict[str, Any] = {"sigma": {name: values[kept] for name, values in self.sigma.items()}, "extra": {}}
        for name in _COLUMNS_OF_ROWS:
            values = getattr(self, name)
            some[name] = None if values is None else values[kept]
        return replace(self, **some)

    def facts(self) -> dict[str, str]:
        """How many rows, their range and roles."""
        gap = f"{self.gap.min() * 1e3:.4g} ... {self.gap.max() * 1e3:.4g} mm"
        return {
            "rows": f"{self.gap.size}, {self.rows('held-out').size} of them held out",
            "gap": gap,
            "current": f"{self.current.min():.4g} ... {self.current.max():.4g} A",
            "measured": " and ".join(
                name[:-2].replace("_", " ") for name in ("force_N", "flux_linkage_Wb") if name in self.frame_columns()
            ),
        }

    def frame_columns(self) -> dict[str, NDArray[Any]]:
        """gap_m, current_A and all that was measured or stated, a row a measurement."""
        columns = {
            "gap_m": self.gap,
            "current_A": self.current,
            "force_N": self.force,
            "flux_linkage_Wb": self.flux_linkage,
            "role": self.role,
            "direction": self.direction,
            "sequence": self.sequence,
            "flux_density_T": self.flux_density,
            "unit": self.unit,
            **{f"sigma_{name}": values for name, values in self.sigma.items()},
            **self.extra,
        }
        return {name: values for name, values in columns.items() if values is not None}

    def rows(self, role: Role) -> NDArray[np.intp]:
        """Indices of the rows with this role, in order."""
        return np.flatnonzero(self.role == role)


@dataclass(frozen=True, eq=False, repr=False)
class Record(Shown):
    """The data of a rig and what is believed about it.

    Attributes
    ----------
    origin : "measured" or "simulated"
    actuator : with what rig.toml states in place of its own values
    sampling : None for a static-only rig
    noise, tolerance : one sigma
    controller : law and gains as rig.toml states them (texts with units), None where not known
    runs, static : the data; one of both is there
    causes : that the user states in [[effects.expression]] of rig.toml
    belief : what the model is believed to have beside the plain one, where rig.toml states it: "as-designed" (all that
        the drawing tells) or "plain"
    scheduling : columns beside the drive that change parameters of the rig
    warnings : what is odd about the data without being refused
    folder : where it was read from
    """

    origin: Origin
    actuator: Actuator
    sampling: Sampling | None = None
    noise: Noise = field(default_factory=Noise)
    tolerance: Tolerance = field(default_factory=Tolerance)
    controller: Mapping[str, Any] | None = None
    runs: tuple[Run, ...] = ()
    static: StaticMap | None = None
    warnings: tuple[str, ...] = ()
    causes: tuple[LawExpression, ...] = ()
    belief: BeliefWord | None = None
    scheduling: tuple[Scheduling, ...] = ()
    folder: Path | None = None

    def facts(self) -> dict[str, str]:
        """Whose data, how many runs of which roles, at which rate, and the instruments' noise."""
        facts = {"rig": self.actuator.name, "origin": self.origin}
        if self.runs:
            held_out = ", ".join(run.name for run in self.runs_of("held-out"))
            fitted = ", ".join(run.name for run in self.runs_of("fit"))
            facts |= {"to fit": fitted or "none", "held out": held_out or "none"}
        if self.sampling is not None:
            facts["rate"] = format_quantity(self.sampling.rate, "Hz")
        if self.static is not None:
            facts["static map"] = f"{self.static.gap.size} rows"
        stated = {q: getattr(self.noise, q) for q in UNITS if getattr(self.noise, q, None)}
        if stated:
            told = (f"{q.replace('_', ' ')} {format_quantity(sigma, UNITS[q])}" for q, sigma in stated.items())
            facts["noise"] = ", ".join(told)
        return facts | ({"warnings": f"{len(self.warnings)}"} if self.warnings else {})

    def runs_of(self, role: Role) -> tuple[Run, ...]:
        """The runs with this role, in the order of rig.toml."""
        return tuple(run for run in self.runs if run.role == role)

    def run(self, name: str) -> Run:
        """The run of this name; RecordError where there is none."""
        for run in self.runs:
            if run.name == name:
                return run
        raise RecordError(f"no run '{name}' in the record; it has {', '.join(r.name for r in self.runs)}")

    @property
    def free(self) -> "Record":
        """The record with those runs alone in which nothing but the drive moves the mover.

        Raises
        ------
        RecordError : there are runs, and none of them is such a one; parameters go with a second input
        """
        runs = tuple(run for run in self.runs if run.mover == "free")
        if self.runs and not runs:
            raise RecordError(
                f"the mover is {self.runs[0].mover} in all runs of {self.actuator.name}, and a free one is followed "
                "here; 'msl-fem diagnose' takes them"
            )
        if self.scheduling:
            raise RecordError(
                f"parameters of {self.actuator.name} go with {self.scheduling[0].column}, which only "
                "'msl-fem diagnose' takes; make a record of the runs at one value of it"
            )
        return replace(self, runs=runs)

    def law_of(self, run: str) -> StatedLaw | None:
        """The linear law that drove a run, as `[[controller.linear]]` states it; None where none is stated."""
        return law_of(linear_laws(self.controller), run)
