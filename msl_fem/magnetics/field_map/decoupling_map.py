"""Over the operating map: what of a side's flux links the other, and what treating the sides as independent misses."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from msl_fem.actuator import Actuator
from msl_fem.computing.arrays import Array
from msl_fem.computing.blas_threads import one_blas_thread
from msl_fem.computing.jobs import Executor, Progress, failures, run_jobs
from msl_fem.computing.row_cache import Arrays
from msl_fem.errors import ComputationError, InputError, NotConverged
from msl_fem.files.quantity import format_quantity
from msl_fem.magnetics.field.accuracy import Accuracy
from msl_fem.magnetics.field.end_effects import EndEffects
from msl_fem.magnetics.field.magnet_field import MagnetField, field_of
from msl_fem.magnetics.field.two_sided import TwoSidedField, TwoSidedStack, field_of_both
from msl_fem.magnetics.field.two_sided_section import TwoSidedPosition
from msl_fem.magnetics.field_map.level_map import FieldMapSettings, field_map
from msl_fem.maps import LEVELS
from msl_fem.maps.level_currents import checked_levels

SIGNS = (1.0, -1.0)
"""Of side 2's current: aiding, opposing."""
PAIRINGS = ("aiding", "opposing")
N_POSITION = 5
TOLERANCE = 0.01
"""Of the larger side's force, and of the flux linkage: below it the sides count as decoupled."""
_SMALLEST = 1e-9  # relative distance of two gaps that count as one
_SAFETY = 2.0  # of the force's error by one degree more, see `Discretisation`


@dataclass(frozen=True)
class PairRow:
    """Both gaps (m) and the currents (A) of each side, 0 first; nan for a level that is not reached.

    `check` names the pair that is solved with one polynomial degree more as well; None for no pair.
    """

    gaps: tuple[float, float]
    currents: tuple[tuple[float, ...], tuple[float, ...]]
    check: int | None = None

    @property
    def cost(self) -> int:
        """The number of pairs."""
        return 2 * len(self.currents[0]) * len(self.currents[1])


@dataclass(frozen=True)
class PairJob:
    """What a process needs: the actuator, the accuracy, the ends."""

    actuator: Actuator
    accuracy: Accuracy
    end_effects: EndEffects = None

    def solver(self) -> "PairSolver":
        """The solver of the job's positions."""
        return PairSolver(self)


class PairSolver:
    """Solves all pairs of a position; the meshes are its own."""

    def __init__(self, job: PairJob) -> None:
        self.job = job

    @one_blas_thread
    def solve(self, row: PairRow) -> Arrays:
        """Forces and flux linkages; `failed` says why there are none.

        `net_force` and `flux` (side) are (sign, n, n) over side 1's and side 2's current, `single_force` and
        `single_flux` (side, n) of one magnet without the other core; `checked` the same quantities of one pair with
        one degree more, see `_checked`.
        """
        actuator = self.job.actuator
        accuracy = self.job.accuracy
        try:
            ends = self.job.end_effects
            both = field_of_both(actuator, TwoSidedPosition(*row.gaps), accuracy=accuracy, end_effects=ends)
            singles = [field_of(actuator, gap, accuracy=accuracy, end_effects=ends) for gap in row.gaps]
            arrays = _pairs(both, row) | _singles(singles, row)
            if row.check is not None:
                finer = [single.refined() for single in singles]
                arrays["checked"] = _checked(both.refined(), finer, row, row.check)
        except NotConverged as err:
            return {"failed": np.array(str(err))}
        return arrays


def _pairs(field: TwoSidedField | TwoSidedStack, row: PairRow) -> Arrays:
    first, second = row.currents
    shape = (len(SIGNS), len(first), len(second))
    net = np.zeros(shape)
    flux = np.zeros((2, *shape))
    for s, sign in enumerate(SIGNS):
        for j, i_1 in enumerate(first):
            start = None
            for k, i_2 in enumerate(second):
                if s and (j == 0 or k == 0):  # a sign of one magnet alone changes nothing but that of its flux
                    net[s, j, k] = net[0, j, k]
                    flux[:, s, j, k] = flux[:, 0, j, k]
                    continue
                if not (j or k):
                    continue
                if np.isnan(i_1) or np.isnan(i_2):
                    net[s, j, k] = np.nan
                    flux[:, s, j, k] = np.nan
                    continue
                quantities, solution = field.solve(i_1, sign * i_2, start=start)
                start = solution.potential
                net[s, j, k] = quantities.net_force
                flux[:, s, j, k] = quantities.flux_linkage_1, sign * quantities.flux_linkage_2
    return {"net_force": net, "flux": flux}


def _singles(fields: list[MagnetField], row: PairRow) -> Arrays:
    force = np.zeros((2, len(row.currents[0])))
    flux = np.zeros((2, len(row.currents[0])))
    for side, (field, gap, currents) in enumerate(zip(fields, row.gaps, row.currents, strict=True)):
        start = None
        for n, current in enumerate(currents[1:], start=1):
            if np.isnan(current):
                force[side, n] = flux[side, n] = np.nan
                continue
            solution = field.solve(current, gap, start=start)
            start = solution.potential
            quantities = field.quantities(solution)
            force[side, n] = quantities.force
            flux[side, n] = quantities.flux_linkage
    return {"single_force": force, "single_flux": flux}


def _checked(field: TwoSidedField | TwoSidedStack, singles: list[MagnetField], row: PairRow, n: int) -> Array:
    """(5,) net force aiding, opposing, of side 1 alone in the same section, and of each single magnet."""
    i_1, i_2 = (currents[n] for currents in row.currents)
    forces = [field.solve(*pair)[0].net_force for pair in ((i_1, i_2), (i_1, -i_2), (i_1, 0.0))]
    alone = [
        single.quantities(single.solve(current, gap)).force
        for single, current, gap in zip(singles, (i_1, i_2), row.gaps, strict=True)
    ]
    return np.array([*forces, *alone])


@dataclass(frozen=True, eq=False)
class DecouplingMap:
    """How far the two sides of an actuator are from independent, over position and pairs of currents.

    The gaps are g_0 - x of side 1 and g_0 + x of side 2; negative positions follow by exchanging the sides. Currents
    are those that bring the levels in each side alone, so that a pair of levels is a point of the operating map.

    Attributes
    ----------
    position : (n_position,) m, from 0 on
    gap : (n_position, 2) m
    level : (n_level,) T, 0 first: no current
    current : (n_position, 2, n_level) A of each side's magnets; nan where the level is not reached
    linked_share : (n_position, 2, n_level) flux linkage of the other side, without current, over that of the side; nan
        at level 0
    force_error : (2, n_position, n_level, n_level) for aiding and opposing, over side 1's and side 2's level: net force
        of two single magnets (as tables have them) less that of both with their shared armature, over the larger side's
    superposition_error : the same, with single sides solved beside the other core without current
    flux_error : (2, 2, n_position, n_level, n_level) for aiding and opposing, by side: flux linkage of a single magnet
        less that together, over that together; nan where the side has no current
    uncertainty : of `force_error`, estimated by one polynomial degree more at the ends
    preferred : T, up to which level on both sides a pair is preferred
    polarity : how the actuator's sides meet, aiding or opposing
    tolerance : up to which errors count as decoupled
    """

    position: Array
    gap: Array
    level: Array
    current: Array
    linked_share: Array
    force_error: Array
    superposition_error: Array
    flux_error: Array
    uncertainty: float
    preferred: float
    polarity: str
    tolerance: float = TOLERANCE

    def both_preferred(self) -> NDArray[np.bool_]:
        """(n_level, n_level) which pairs lie in the preferred region on both sides."""
        low = self.level <= self.preferred * (1 + _SMALLEST)
        return np.asarray(low[:, None] & low[None, :])

    def one_side_on(self) -> NDArray[np.bool_]:
        """(n_level, n_level) which pairs have current on one side only: a differential drive without bias."""
        on = self.level > 0
        return np.asarray(on[:, None] != on[None, :])

    def findings(self) -> tuple[str, ...]:
        """Sentences: where in the preferred region the sides are decoupled and where they are not."""
        share = np.abs(self.linked_share[:, :, self.level <= self.preferred * (1 + _SMALLEST)])
        sentences = [f"at most {100 * np.nanmax(share):.2g} % of a side's flux linkage links the other side"]
        cases = [("one side on", 0, self.one_side_on())]
        cases += [(f"both on, {name}", s, ~self.one_side_on()) for s, name in enumerate(PAIRINGS)]
        for name, sign, pairs in cases:
            error = np.abs(np.where(pairs & self.both_preferred(), self.force_error[sign], np.nan))
            if np.isnan(error).all():
                continue
            p, j, k = np.unravel_index(int(np.nanargmax(error)), error.shape)
            sentences.append(
                f"{name}: independent sides miss at most {100 * error[p, j, k]:.2g} % of the larger force (at position "
                f"{format_quantity(self.position[p], 'm')}, {self.level[j]:g} T and {self.level[k]:g} T): "
                + (self._decoupled(error) if error[p, j, k] > self.tolerance else "decoupled")
            )
        return tuple(sentences)

    def _decoupled(self, error: Array) -> str:
        """Up to which level on both sides, and which position, an error (n_position, n, n) stays within tolerance."""
        within = []
        for n in range(1, self.level.size):
            largest = error[:, : n + 1, : n + 1]
            if np.isnan(largest).all() or not (self.level[n] <= self.preferred * (1 + _SMALLEST)):
                continue
            bad = (np.nan_to_num(largest) > self.tolerance).any(axis=(1, 2))
            reach = self.position[: int(np.argmax(bad))] if bad.any() else self.position
            if reach.size:
                where = f"up to {format_quantity(reach[-1], 'm')}" if reach[-1] > 0 else "in the middle"
                within.append(f"{where} with both at {self.level[n]:g} T or below")
        if not within:
            return f"not decoupled to {100 * self.tolerance:g} %"
        return f"decoupled to {100 * self.tolerance:g} % only " + ", ".join(within)

    def to_json(self) -> dict[str, Any]:
        """The JSON object: levels, positions, currents, shares and errors as lists, null where there is none."""
        return {
            "position_m": self.position.tolist(),
            "gap_m": self.gap.tolist(),
            "level_T": self.level.tolist(),
            "current_A": _lists(self.current),
            "linked_share": _lists(self.linked_share),
            "force_error": _by_pairing(self.force_error),
            "superposition_error": _by_pairing(self.superposition_error),
            "flux_error": _by_pairing(self.flux_error),
            "force_error_uncertainty": self.uncertainty,
            "preferred_level_T": self.preferred,
            "polarity": self.polarity,
            "tolerance": self.tolerance,
            "findings": list(self.findings()),
        }


def _by_pairing(errors: Array) -> dict[str, list[Any]]:
    return {name: _lists(error) for name, error in zip(PAIRINGS, errors, strict=True)}


def _lists(values: Array) -> list[Any]:
    return [_lists(row) if row.ndim else (float(row) if np.isfinite(row) else None) for row in values]


def decoupling_map(
    actuator: Actuator,
    *,
    levels: Sequence[float] = LEVELS,
    positions: Sequence[float] | None = None,
    settings: FieldMapSettings | None = None,
    progress: Progress | None = None,
) -> DecouplingMap:
    """How far an actuator's sides are decoupled, over position and pairs of currents.

    Parameters
    ----------
    levels : T, increasing, whose currents (criterion `mean`) make the pairs, with half the first one and none
    positions : m, from 0 on; by default 5 to the end of the range
    settings : accuracy, workers and end effects
    progress : called with the numbers of finished and of all positions

    Raises
    ------
    InputError : an actuator without two sides, nominal gap or range; positions outside the range
    ComputationError : a field solution failed
    """
    settings = settings or FieldMapSettings()
    wanted = checked_levels(levels)
    nominal, position = decoupling_positions(actuator, positions)
    gap = np.stack([nominal - position, nominal + position], axis=1)
    level = np.r_[0.0, wanted[0] / 2, wanted]
    current = _currents(actuator, gap, level, settings)
    last = int(np.flatnonzero(level == wanted[0])[0])
    rows = [
        PairRow(
            (float(gap[p, 0]), float(gap[p, 1])),
            (tuple(current[p, 0].tolist()), tuple(current[p, 1].tolist())),
            last if p in (0, position.size - 1) and np.isfinite(current[p, :, last]).all() else None,
        )
        for p in range(position.size)
    ]
    job = PairJob(actuator, settings.accuracy, settings.end_effects)
    solved = run_jobs(job, rows, executor=Executor(settings.workers), progress=progress)
    failed = failures(solved)
    if failed:
        raise ComputationError(f"both sides at {len(failed)} of {len(rows)} positions: {failed[0]}")
    uncertainties = [_uncertainty(pair, row.check) for pair, row in zip(solved, rows, strict=True) if row.check]
    sides = actuator.sides
    return DecouplingMap(
        position=position,
        gap=gap,
        level=level,
        current=current,
        linked_share=np.stack([_linked_share(pair) for pair in solved]),
        force_error=np.stack([_force_error(pair, pair["single_force"]) for pair in solved], axis=1),
        superposition_error=np.stack([_force_error(pair, _beside_dead_core(pair)) for pair in solved], axis=1),
        flux_error=np.stack([_flux_error(pair) for pair in solved], axis=2),
        uncertainty=max(uncertainties, default=0.0),
        preferred=float(wanted[0]),
        polarity=sides.polarity if sides is not None else PAIRINGS[1],
    )


def decoupling_positions(actuator: Actuator, asked: Sequence[float] | None = None) -> tuple[float, Array]:
    """The nominal gap and the positions, in m; raises InputError as `decoupling_map`."""
    motion = actuator.motion
    sides = actuator.sides
    if sides is None or sides.count != 2 or motion is None or motion.nominal_gap is None:
        raise InputError(
            f"{actuator.name} has no two sides that share an armature; decoupling needs [sides] count = 2 and "
            "motion.nominal_gap"
        )
    if asked is None:
        if motion.range is None:
            raise InputError(f"{actuator.name} states no motion.range; give positions")
        return motion.nominal_gap, np.linspace(0.0, motion.range, N_POSITION)
    position = np.asarray(asked, dtype=float)
    if position.size == 0 or not ((position >= 0) & (position < motion.nominal_gap)).all():
        raise InputError(
            f"positions must be between 0 and the nominal gap, {format_quantity(motion.nominal_gap, 'm')}; these are "
            f"{position.tolist()} m"
        )
    return motion.nominal_gap, np.unique(position)


def _currents(actuator: Actuator, gap: Array, level: Array, settings: FieldMapSettings) -> Array:
    """(n_position, 2, n_level) A that bring each level in a side alone."""
    gaps = np.unique(gap.round(12))
    needed = gaps if gaps.size > 1 else np.r_[gaps, 1.1 * gaps]
    without_cache = replace(settings, cache=None, resume=False)
    one_side = field_map(actuator, needed, levels=level[1:].tolist(), settings=without_cache)
    place = np.searchsorted(gaps, gap.round(12))
    by_level = np.concatenate([np.zeros((1, one_side.gap.size)), one_side.current])
    return np.moveaxis(by_level[:, place], 0, -1)


def _linked_share(arrays: Arrays) -> Array:
    flux = arrays["flux"][:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.stack([flux[1, :, 0] / flux[0, :, 0], flux[0, 0, :] / flux[1, 0, :]])


def _beside_dead_core(arrays: Arrays) -> Array:
    """(2, n) force of each side towards itself with the other core there and its coil without current."""
    net = arrays["net_force"][0]
    return np.stack([net[:, 0], -net[0, :]])


def _force_error(arrays: Arrays, single: Array) -> Array:
    """(2, n, n) net force of independent sides less that together, over the larger side's; nan without currents."""
    first = single[0][:, None]
    second = single[1][None, :]
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray((first - second - arrays["net_force"]) / np.maximum(np.abs(first), np.abs(second)))


def _flux_error(arrays: Arrays) -> Array:
    """(2 pairings, 2 sides, n, n) flux linkage of a single magnet less that together, over that together."""
    single = arrays["single_flux"]
    expected = np.stack(np.broadcast_arrays(single[0][:, None], single[1][None, :]))
    flux = arrays["flux"].transpose(1, 0, 2, 3)  # (pairing, side, n, n)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(expected > 0, (expected - flux) / flux, np.nan)


def _uncertainty(arrays: Arrays, n: int | None) -> float:
    """How much one degree more moves the force errors of one pair, times a safety."""
    aiding, opposing, alone, *single = arrays["checked"]
    net = arrays["net_force"]
    force = arrays["single_force"]
    pairs = [
        ((single[0] - single[1] - aiding), (force[0, n] - force[1, n] - net[0, n, n])),
        ((single[0] - single[1] - opposing), (force[0, n] - force[1, n] - net[1, n, n])),
        ((single[0] - alone), (force[0, n] - net[0, n, 0])),
    ]
    return _SAFETY * max(abs(fine - coarse) for fine, coarse in pairs) / float(max(single))
