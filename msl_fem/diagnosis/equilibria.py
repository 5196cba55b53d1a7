"""Movers held at rest by a controller: what their runs say as a static measurement.

A mover at rest is a static measurement: its weight and spring say what the magnet pulls with.
Where a loop is unstable without its controller, the seconds in which the mover rests are worth most: the mean of
position and current then lie on the static map, with a force that is known. As rows beside those of flux linkage they
ask whether one coenergy has both, which is what a prediction of the current that holds a mover rests on.
"""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from msl_fem.computing.arrays import Array
from msl_fem.diagnosis.kind import without_those_of
from msl_fem.diagnosis.likelihood import Fit
from msl_fem.diagnosis.static_maps import MapAlone, map_alone
from msl_fem.diagnosis.unknowns import EffectUnknown
from msl_fem.diagnosis.variants import Variant
from msl_fem.plant import plant_parameters
from msl_fem.prediction import ModelHypothesis, noise_floor
from msl_fem.prediction.run_data import POSITION_COLUMN
from msl_fem.record import Record, Run, StaticMap

WINDOW = 1.0  # s; its second half is averaged
STILL = 2.5  # times the position's noise
FAITHFUL = 3.0  # a run rests at a few gaps: what is right there by chance errs elsewhere
OFFSET = Variant("force_offset", (EffectUnknown("force_offset", "force"),))
REVERSE = (
    "rest or lift off once more with the current reversed: the force of a flux that stays in the iron changes its sign "
    "with the current, that of a wrong gap, scale or weight does not; and weigh the mover under the coil at no current"
)


@dataclass(frozen=True, eq=False)
class StaticEquilibria:
    """Rests of runs, (n_rest,) each: gap m, a magnet's current A, its force N, role of the run."""

    gap: Array
    current: Array
    force: Array
    role: NDArray[np.str_]


def static_equilibria(record: Record) -> StaticEquilibria:
    """All rests of a record's runs: seconds of a constant reference in which the mover stands within its noise."""
    p = plant_parameters(record.actuator)
    gaps, currents, forces, roles = [], [], [], []
    for run in record.runs:
        for late in _still(record, run) if run.mover == "free" else []:
            position = float(run[POSITION_COLUMN][late].mean())
            gaps.append(p.nominal_gap - position)
            currents.append(p.current_share * float(run["current_1_A"][late].mean()))
            forces.append((p.stiffness * position - p.constant_force) / p.magnets)
            roles.append(run.role)
    return StaticEquilibria(np.array(gaps), np.array(currents), np.array(forces), np.array(roles, dtype=str))


def _still(record: Record, run: Run) -> list[slice]:
    """The second halves of the windows in which a run rests."""
    if "current_1_A" not in run:
        return []
    n, x = round(WINDOW / run.sampling_period), run[POSITION_COLUMN]
    limit = STILL * noise_floor(record, POSITION_COLUMN).sigma
    found = []
    for start in range(0, x.size - n + 1, n):
        late = slice(start + n // 2, start + n)
        reference = run["reference_m"][start : start + n] if "reference_m" in run else np.zeros(1)
        if np.ptp(reference) == 0 and x[late].std() < limit:
            found.append(late)
    return found


def with_equilibria(record: Record, found: StaticEquilibria) -> Record:
    """The record with its rests as rows of its static map, and no runs."""
    static = record.static
    n, m = found.gap.size, 0 if static is None else static.gap.size
    none = np.full(m, np.nan)

    def joined(own: Array | None, more: Array) -> Array:
        return np.concatenate([none if own is None else own, more])

    empty = StaticMap(none, none, None, None, none.astype(str)) if static is None else static
    rows = StaticMap(
        gap=joined(empty.gap, found.gap),
        current=joined(empty.current, found.current),
        force=joined(empty.force, found.force),
        flux_linkage=joined(empty.flux_linkage, np.full(n, np.nan)),
        role=np.concatenate([empty.role, found.role]),
        gap_zero="mover",
    )
    tolerance = record.tolerance
    if empty.force is None:  # weight and spring say it, no instrument
        tolerance = tolerance.model_copy(update={"force_zero": 0.0, "force_gain": 0.0})
    noise = record.noise
    if noise.force is None:
        noise = noise.model_copy(update={"force": _force_noise(record, found)})
    return replace(record, runs=(), sampling=None, static=rows, noise=noise, tolerance=tolerance)


def _force_noise(record: Record, found: StaticEquilibria) -> float:
    """N: the noise of the means of current and position, a force that grows as i^2/g^2 assumed."""
    share = WINDOW / 2 * (record.sampling.rate if record.sampling else 1.0)
    current = noise_floor(record, "current_1_A").sigma / np.abs(found.current).mean()
    gap = noise_floor(record, POSITION_COLUMN).sigma / found.gap.mean()
    return float(2 * np.abs(found.force).mean() * np.hypot(current, gap) / np.sqrt(share))


@dataclass(frozen=True, eq=False)
class MapWithEquilibria(MapAlone):
    """A static map, and beside its flux linkage the force at the equilibria of runs."""

    faithful: ClassVar[float] = FAITHFUL
    advice: ClassVar[str] = REVERSE

    def candidates(self, fit: Fit) -> list[Variant]:
        """What a static map can show, and a force beside the magnet's."""
        return [*super().candidates(fit), *without_those_of(fit, [OFFSET])]


def map_with_equilibria(record: Record, belief: ModelHypothesis, found: StaticEquilibria) -> MapWithEquilibria:
    """The equilibria of a record's runs beside its static map, made ready."""
    alone = map_alone(with_equilibria(record, found), belief)
    told = f"judged by the force at {found.gap.size} rests beside the flux linkage of the static map"
    return MapWithEquilibria(belief, alone.likelihood, alone.unknowns, (told, *alone.notes))


def told_by_equilibria(record: Record, belief: ModelHypothesis) -> MapWithEquilibria | None:
    """The equilibria of a record's runs made ready, where there is a static map beside them and some are held out."""
    if record.static is None or plant_parameters(record.actuator).sides != 1:
        return None
    found = static_equilibria(record)
    if not {"fit", "held-out"} <= set(found.role):
        return None
    return map_with_equilibria(record, belief, found)
