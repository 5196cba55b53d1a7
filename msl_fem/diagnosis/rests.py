"""A levitated mover at rest as a static measurement: its weight and spring say what the magnet pulls with.

Where a loop is unstable without its controller, the seconds in which the mover rests are worth most: the mean of
position and current then lie on the static map, with a force that is known. As rows beside those of flux linkage they
ask whether one coenergy has both, which is what a prediction of the current that holds a mover rests on.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from msl_fem.diagnosis.fit import Fit, Likelihood
from msl_fem.diagnosis.other_records import Kind
from msl_fem.diagnosis.static_maps import StaticLikelihood, candidates_of_map, of_map
from msl_fem.diagnosis.unknowns import EffectUnknown, Unknowns
from msl_fem.diagnosis.variants import Variant
from msl_fem.plant import plant_parameters
from msl_fem.prediction import ModelHypothesis, noise_floor
from msl_fem.prediction.run_data import POSITION_COLUMN
from msl_fem.record import Record, Run, StaticMap

Array = NDArray[np.float64]
WINDOW = 1.0  # s; its second half is averaged
STILL = 2.5  # times the position's noise
FAITHFUL = 3.0  # a run rests at a few gaps: what is right there by chance errs elsewhere
OFFSET = Variant("force_offset", (EffectUnknown("force_offset", "force"),))
NEXT = (
    "rest or lift off once more with the current reversed: the force of a flux that stays in the iron changes its sign "
    "with the current, that of a wrong gap, scale or weight does not; and weigh the mover under the coil at no current"
)


@dataclass(frozen=True, eq=False)
class Rests:
    """Rests of runs, (n_rest,) each: gap m, a magnet's current A, its force N, role of the run."""

    gap: Array
    current: Array
    force: Array
    role: NDArray[np.str_]


def rests(record: Record) -> Rests:
    """All rests of a record's runs: seconds of a constant reference in which the mover stands within its noise."""
    p = plant_parameters(record.actuator)
    rows = []
    for run in record.runs:
        for late in _still(record, run):
            x, current = float(run[POSITION_COLUMN][late].mean()), float(run["current_1_A"][late].mean())
            pull = (p.stiffness * x - p.constant_force) / p.magnets
            rows.append((p.nominal_gap - x, p.current_share * current, pull))
    roles = [run.role for run in record.runs for _ in _still(record, run)]
    columns = np.array(rows).reshape(-1, 3)
    return Rests(columns[:, 0], columns[:, 1], columns[:, 2], np.array(roles, dtype=str))


def _still(record: Record, run: Run) -> list[slice]:
    """The second halves of the windows in which a run rests."""
    if "current_1_A" not in run:
        return []
    n, x = round(WINDOW / run.sampling_period), run[POSITION_COLUMN]
    limit, found = STILL * noise_floor(record, POSITION_COLUMN).sigma, []
    for start in range(0, x.size - n + 1, n):
        late = slice(start + n // 2, start + n)
        wanted = run["reference_m"][start : start + n] if "reference_m" in run else np.zeros(1)
        if np.ptp(wanted) == 0 and x[late].std() < limit:
            found.append(late)
    return found


def with_rests(record: Record, found: Rests) -> Record:
    """The record with its rests as rows of its static map, and no runs."""
    static = record.static
    n, m = found.gap.size, 0 if static is None else static.gap.size
    none = np.full(m, np.nan)

    def joined(own: Array | None, more: Array) -> Array:
        return np.concatenate([none if own is None else own, more])

    empty = StaticMap(none, none, None, None, none.astype(str)) if static is None else static
    rows = StaticMap(
        gap=joined(empty.gap, found.gap), current=joined(empty.current, found.current),
        force=joined(empty.force, found.force), flux_linkage=joined(empty.flux_linkage, np.full(n, np.nan)),
        role=np.concatenate([empty.role, found.role]),
    )  # fmt: skip
    noise = record.noise
    if noise.force is None:
        noise = noise.model_copy(update={"force": _force_noise(record, found)})
    return replace(record, runs=(), sampling=None, static=rows, noise=noise)


def _force_noise(record: Record, found: Rests) -> float:
    """N: the noise of the means of current and position, a force that grows as i^2/g^2 assumed."""
    share = WINDOW / 2 * (record.sampling.rate if record.sampling else 1.0)
    current = noise_floor(record, "current_1_A").sigma / np.abs(found.current).mean()
    gap = noise_floor(record, POSITION_COLUMN).sigma / found.gap.mean()
    return float(2 * np.abs(found.force).mean() * np.hypot(current, gap) / np.sqrt(share))


def candidates_at_rest(likelihood: Likelihood, found: Fit) -> list[Variant]:
    """What a static map can show, and a force beside the magnet's."""
    have = {one.effect for one in found.unknowns.effects}
    return [*candidates_of_map(likelihood, found), *([] if "force_offset" in have else [OFFSET])]


def of_rests(record: Record, belief: ModelHypothesis, found: Rests) -> tuple[StaticLikelihood, Unknowns, Kind]:
    """What the diagnosis of the rests beside the static map needs."""
    likelihood, unknowns, kind = of_map(with_rests(record, found), belief)
    notes = (f"judged by the force at {found.gap.size} rests beside the flux linkage of the static map", *kind.notes)
    return (
        likelihood,
        unknowns,
        replace(kind, candidates=candidates_at_rest, notes=notes, next_experiment=NEXT, faithful=FAITHFUL),
    )
