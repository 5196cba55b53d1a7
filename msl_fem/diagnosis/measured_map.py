"""A static map as measured: its readings, their noise, which rows a fit counts, what the iron went through before."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from msl_fem.computing.arrays import Array
from msl_fem.diagnosis.noise import MISSTATED
from msl_fem.diagnosis.table_error import Visited
from msl_fem.diagnosis.unit_scatter import UnitScatter, without_scatter
from msl_fem.errors import InputError
from msl_fem.record import Record, StaticMap
from msl_fem.record.rig_file import UNKNOWN, cycled_current
from msl_fem.table.magnetic_table import MagneticTable

FORCE, FLUX, DENSITY = "force_N", "flux_linkage_Wb", "flux_density_T"
MARGIN = 4.0  # tolerances of the gap: rows nearer to the table's ends would leave it in a fit
MEDIAN_OF_NORMAL = 0.6745  # of the absolute value, over sigma
LEAST_NOISE = 1e-5  # of the largest value, where no noise is stated
FEWEST_REPEATS = 6
"""Repeats, less one a place, from which the noise is taken where none is stated."""
FEWEST_WINDOWS = 12
"""Of four neighbouring rows, from which a stated noise is doubted."""
SPREAD = 1.45
"""Standard deviation of a noise from n such windows, which share rows, over the noise / sqrt(n); simulated."""


class MeasuredPath(NamedTuple):
    """Gaps, currents and numbers of loops (n_point,) that a map's magnet went through; `rows` (n_row,) are measured."""

    gap: Array
    current: Array
    sequence: Array
    rows: NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class MeasuredMap:
    """A static map and its instruments' noise.

    Attributes
    ----------
    channels : name to (n_row,) measured; nan where a row lacks it
    sigmas : name to (n_row,) one sigma: of the channel, and of what the current's noise makes there
    counted : (n_row,) rows of the role `fit` that lie inside the table
    free : channels that are in proportion to the model's, with a factor that is not known
    scatter : what each of several magnets has of its own, which the channels are free of; None of one magnet
    louder : channel to how many times its stated noise the sigmas are, where neighbouring rows show that it is more
    """

    rows: StaticMap
    channels: dict[str, Array]
    sigmas: dict[str, Array]
    counted: NDArray[np.bool_]
    free: frozenset[str] = frozenset()
    scatter: UnitScatter | None = None
    louder: Mapping[str, float] = field(default_factory=dict)

    @property
    def notes(self) -> list[str]:
        """What is to be said of its noise."""
        return [
            f"the rows of {name} scatter {times:.2g} times as much about their neighbours as their stated noise; that "
            "is taken for the noise"
            for name, times in self.louder.items()
        ]

    @property
    def visited(self) -> Visited:
        return Visited.by(self.rows.current, self.rows.gap)

    def counts(self, name: str) -> NDArray[np.bool_]:
        """(n_row,) rows of a channel that a fit looks at."""
        return np.asarray(self.counted & np.isfinite(self.channels[name]))

    def factor(self, name: str, modelled: Array, *, zero: float = 0.0) -> float:
        """What a channel less its zero is over the model's (n_row,): 1, or that of least squares where it is free."""
        if name not in self.free:
            return 1.0
        at = self.counts(name)
        weighted, model = (self.channels[name][at] - zero) / self.sigmas[name][at], modelled[at] / self.sigmas[name][at]
        power = float(model @ model)
        return float(weighted @ model) / power if power > 0 else 1.0


def measured_map(record: Record, table: MagneticTable) -> MeasuredMap:
    """The static map of a record with its noise.

    Raises
    ------
    InputError : no row of the role fit lies inside the table, or the cycles before the rows leave it
    """
    static = record.static
    assert static is not None
    _refuse_cycles(static, table)
    motion = record.actuator.motion
    nominal_gap = float((motion.nominal_gap if motion else None) or 0.0)
    margin = MARGIN * record.tolerance.nominal_gap * nominal_gap
    inside = (static.gap > table.gap[0] + margin) & (static.gap < table.gap[-1] - margin)
    inside &= np.abs(static.current) < table.current[-1]
    single = {name: noise_of(record, name) for name in static.readings}
    rows = static.at(inside)
    counted = (rows.role == "fit") & knows_its_past(rows)
    if not counted.any():
        raise InputError("no row of static.csv lies inside the table; extend the sweep")
    magnet = table.evaluate(rows.current, rows.gap)
    modelled = {FORCE: magnet["force"], FLUX: magnet["flux_linkage"]}
    slopes = {FORCE: magnet["force_current_slope"], FLUX: magnet["incremental_inductance"]}
    sigmas: dict[str, Array] = {}
    louder: dict[str, float] = {}
    for name, sigma in single.items():
        stated = name in slopes and is_stated(record, name)
        by_current = slopes[name] * (record.noise.current or 0.0) if stated else 0.0
        sigmas[name] = np.hypot(sigma[inside], by_current * np.ones(rows.gap.size))
        if stated:
            times = _loudness(rows, rows.readings[name] / sigmas[name], modelled[name] / sigmas[name])
            sigmas[name] = times * sigmas[name]
            louder |= {name: times} if times > 1.0 else {}
    free = frozenset(rows.readings) if rows.scale == "free" else frozenset({DENSITY})
    rows, scatter = without_scatter(rows, sigmas, table=table, actuator=record.actuator)
    return MeasuredMap(rows, rows.readings, sigmas, counted, free, scatter, louder)


def is_stated(record: Record, name: str) -> bool:
    """Whether a reading's noise is stated, in static.csv or in rig.toml."""
    assert record.static is not None
    return name in record.static.sigma or bool(_of_instrument(record, name))


def noise_of(record: Record, name: str) -> Array:
    """One sigma of a reading (n_row,): of its own column, the instrument, repeats or neighbours, in this order."""
    static = record.static
    assert static is not None
    if name in static.sigma:
        return static.sigma[name]
    values = static.readings[name]
    single = _of_instrument(record, name) or _of_repeats(static, values) or _roughness(static, values)
    return np.full(values.size, single)


def _of_instrument(record: Record, name: str) -> float:
    return float({FORCE: record.noise.force, FLUX: record.noise.flux_linkage}.get(name) or 0.0)


def _of_repeats(static: StaticMap, values: Array) -> float:
    """One sigma of readings taken again at the same place, by the same magnet in the same direction; 0 of too few."""
    there = np.isfinite(values)
    words = [_places(names, values.size) for names in (static.direction, static.unit)]
    labels = [static.gap, static.current, *words]
    rows, read = np.column_stack(labels)[there], values[there]
    _, place, count = np.unique(rows, axis=0, return_inverse=True, return_counts=True)
    free = int(np.sum(count - 1))
    if free < FEWEST_REPEATS:
        return 0.0
    mean = np.bincount(place.ravel(), read) / count
    return float(np.sqrt(np.sum((read - mean[place.ravel()]) ** 2) / free))


def _roughness(static: StaticMap, values: Array) -> float:
    """One sigma of what neighbours in the order of gap and current do not share: third differences over sqrt(20)."""
    ordered = values[np.lexsort((static.current, static.gap))]
    return float(max(_of_third_differences(np.diff(ordered, 3)), LEAST_NOISE * np.abs(values).max()))


def _of_third_differences(third: Array) -> float:
    """One sigma of what makes them, whose variance is a twentieth of theirs."""
    return float(np.median(np.abs(third)) / MEDIAN_OF_NORMAL / np.sqrt(20.0))


def _loudness(static: StaticMap, measured: Array, modelled: Array) -> float:
    """How many times its stated noise a reading is, 1 to `MISSTATED`, by third differences along each sweep of what is
    measured less what is modelled, (n_row,) over that noise; a scale of the model is fitted. What two standard
    errors of so few windows make is none.
    """
    if static.gap.size < FEWEST_WINDOWS:
        return 1.0
    windows = [np.lib.stride_tricks.sliding_window_view(values, 4) for values in (static.gap, static.current)]
    along = [np.all(np.diff(own) > 0, axis=1) | np.all(np.diff(own) < 0, axis=1) for own in windows]
    still = [np.ptp(own, axis=1) == 0 for own in windows]
    third = np.diff(np.stack([measured, modelled]), 3)
    kept = ((along[0] & still[1]) | (along[1] & still[0])) & np.isfinite(third).all(axis=0)
    if np.count_nonzero(kept) < FEWEST_WINDOWS:
        return 1.0
    own, model = third[:, kept]
    own = own - model * (own @ model) / max(float(model @ model), np.finfo(float).tiny)
    sigma = _of_third_differences(own)
    by_chance = 1.0 + 2.0 * SPREAD / np.sqrt(own.size)
    return min(sigma, MISSTATED) if sigma > by_chance else 1.0


def _refuse_cycles(static: StaticMap, table: MagneticTable) -> None:
    """InputError where the cycles before the rows leave the table."""
    cycled = cycled_current(static.before)
    if cycled is not None and abs(cycled) >= table.current[-1]:
        raise InputError(
            f"static.before: cycles of {abs(cycled):g} A leave the table, which ends at {table.current[-1]:g} A; extend"
            " the sweep"
        )


def _numbers(static: StaticMap) -> Array:
    """(n_row,) number of each row's loop, of each magnet; of rows in an unknown order each is a loop of its own."""
    count = static.gap.size
    if static.order == "unknown":
        return np.arange(count, dtype=float)
    stated = _places(static.sequence, count)
    return _places(static.unit, count) * (1.0 + stated.max(initial=0.0)) + stated


def _places(names: NDArray[Any] | None, count: int) -> Array:
    """(count,) place of each name among the different ones; zeros where there are none."""
    if names is None:
        return np.zeros(count)
    return np.unique(names, return_inverse=True)[1].astype(np.float64)


def knows_its_past(static: StaticMap) -> NDArray[np.bool_]:
    """(n_row,) rows that know what the iron went through: of an unknown history, those behind each loop's largest
    current, which wipes out what was before (Madelung's rules)."""
    known = np.ones(static.gap.size, dtype=bool)
    if static.before != UNKNOWN or static.order == "unknown":
        return known
    numbers = _numbers(static)
    for number in np.unique(numbers):
        at = np.flatnonzero(numbers == number)
        known[at[: int(np.argmax(np.abs(static.current[at])))]] = False
    return known


def path_of(static: StaticMap) -> MeasuredPath:
    """The rows as the magnet went through them, with the cycles before each loop: to the last current, to its
    negative and back, at the loop's first gap."""
    cycled, order = cycled_current(static.before), np.argsort(_places(static.unit, static.gap.size), kind="stable")
    gap, current, numbers = static.gap[order], static.current[order], _numbers(static)[order]
    measured, row = np.ones(order.size, dtype=bool), np.empty(order.size, dtype=np.intp)
    if cycled is not None and static.order == "measured":
        first = np.flatnonzero(np.concatenate([[True], np.diff(numbers) != 0]))
        before = np.repeat(first, 3)
        current = np.insert(current, before, np.tile([cycled, -cycled, cycled], first.size))
        measured = np.insert(measured, before, False)
        gap, numbers = np.insert(gap, before, gap[before]), np.insert(numbers, before, numbers[before])
    row[order] = np.flatnonzero(measured)
    return MeasuredPath(gap, current, numbers, row)
