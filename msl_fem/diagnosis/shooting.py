"""Where runs are cut into stretches: tried with the model as it is known.

A run is followed as a whole where the model bears it and an error of the start does not grow towards its end. Else it
begins with stretches as long as the growth of such an error allows, where the model bears them all, or with short ones;
neighbours are joined as long as the model, and what it may be off by, stay near the record from a start that suits both
of them.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from msl_fem.computing.arrays import Array
from msl_fem.computing.lanes import LANES
from msl_fem.diagnosis.problem import FitProblem, Points, follows_from_before, lanes, missed
from msl_fem.diagnosis.start_refinement import StartRefinement
from msl_fem.diagnosis.stretches import Stretches, moved
from msl_fem.diagnosis.unknowns import Unknowns
from msl_fem.prediction import KernelPlant, RunData
from msl_fem.prediction.free_run import read_current
from msl_fem.prediction.run_data import POSITION_COLUMN
from msl_fem.record.columns import Channel

SHORTEST = 16  # samples of a stretch
PARTS = 4  # of a stretch, over which a model that is not fitted yet is nearly linear
GENTLE = 3.0  # times that a start's error may grow from the first quarter to the last, and be no growth
MOST_GROWTH = 50.0
MOST_LOG = 100.0  # of a growth, to which it is told
HOPELESS = 2.0  # times `MOST_GROWTH`, above which at a first guess no other start is looked for
REACH = 0.05  # of the nominal gap: how far from the record a model that lets errors grow is still linear
CURRENT_REACH = 0.3  # of the RMS current
STEP = 1e-4  # of the starts, in units of their prior
REFINED = 6  # Gauss-Newton steps of the starts, at most
LONG = 15  # of them, where a model is judged that is not fitted
SHORT = 2  # of them, next to starts to which a fit has come
MARGIN = 0.5  # of a start's position, in units of its prior, within which a stretch has to stay inside
TINY = 1e-300  # rate of a growth that is none
LOOKED_AT = 9  # samples of the parabola that gives the first guess of a start


@dataclass(frozen=True, eq=False)
class ModelSpread:
    """A model and what it may be off by: a point of the unknowns, and moves of one sigma, (n_move, unknowns.size)."""

    unknowns: Unknowns
    z: Array
    moves: Array

    @classmethod
    def of_tolerances(cls, unknowns: Unknowns) -> "ModelSpread":
        """As believed."""
        n = len(unknowns.believed) + unknowns.n_table
        return cls(unknowns, np.zeros(unknowns.size), np.eye(unknowns.size)[:n])

    @property
    def rows(self) -> Array:
        return self.z + self.moves


class Shooting:
    """The cutting of one run of a problem at a model."""

    def __init__(self, problem: FitProblem, run: int, spread: ModelSpread, *, substeps: int) -> None:
        self.problem, self.run, self.spread, self.substeps = problem, run, spread, substeps
        self.data, self.plant = problem.runs[run], problem.plant
        self.sigmas = problem.start_unit(run)
        self.names = problem.channels(run)
        self._seen: dict[bytes, NDArray[np.bool_]] = {}

    def chosen(self, known: Stretches | None = None, *, with_moves: bool = False) -> Stretches | None:
        """The stretches; None where the run is followed as a whole. Those do not count in which the model leaves its
        table or range, or `with_moves` one that is off by a sigma. `known` ones of a model near by are where it begins
        if the model bears them."""
        whole = self._tried(guessed(self.plant, self.data, np.zeros(1, dtype=np.intp), self.sigmas.size))
        if not self._hopeless(whole)[0] and self._borne(whole)[0]:
            return None
        cut = self._begun(known, [self._grown_by(most, whole) for most in (MOST_GROWTH, GENTLE)])
        open_ = np.ones(cut.begins.size, dtype=bool)
        while (pairs := _pairs(open_)).size:
            behind = pairs + 1
            keep = np.delete(np.arange(cut.begins.size), behind)
            joined = self._tried(replace(cut, begins=cut.begins[keep], starts=cut.starts[keep]))
            at = np.searchsorted(keep, pairs)
            if np.all(self._hopeless(joined)[at]):
                break
            cut, open_ = _after(cut, joined, keep, pairs[self._borne(joined)[at]])
        cut = self.refined(cut)
        inside = self._seen.get(_key(cut)) if with_moves else None
        if inside is None:
            inside = self._inside(cut, self.spread.rows if with_moves else self.spread.rows[:0])
        return replace(cut, outside=~inside)

    def _begun(self, known: Stretches | None, lengths: Sequence[int]) -> Stretches:
        """Known stretches if the model bears them all; else those of the first of these lengths of which it does; else
        the shortest."""
        if known is not None:
            cut = self.refined(known)
            if np.all(self._borne(cut) | (False if known.outside is None else known.outside)):
                return replace(cut, outside=None)
        for length in dict.fromkeys((*lengths, SHORTEST)):
            begins = np.arange(0, max(len(self.data.commands) - SHORTEST // 2, 1), length)
            cut = self.refined(guessed(self.plant, self.data, begins, self.sigmas.size))
            if length == SHORTEST or np.all(self._borne(cut)):
                break
        return cut

    def _grown_by(self, most: float, whole: Stretches) -> int:
        """Samples of the longest stretches, of twice the shortest's any times, over which an error grows so many times
        at most, at the rate at which it grows over a whole run."""
        [rate] = self._rates(whole)
        longest = max(len(self.data.commands), SHORTEST)
        length = np.clip(np.log(most) / max(rate, TINY), SHORTEST, longest)
        return SHORTEST * 2 ** int(np.log2(length / SHORTEST))

    def split(self, cut: Stretches) -> Stretches:
        """Stretches cut in `PARTS` each."""
        return self.refined(self._split(cut, PARTS))

    def _split(self, cut: Stretches, parts: int) -> Stretches:
        """Stretches cut in so many parts each, with starts as guessed."""
        lengths = np.diff([*cut.begins, len(self.data.commands)])
        counts = np.clip(lengths // SHORTEST, 1, parts)
        each = zip(cut.begins, lengths, counts, strict=True)
        begins = np.concatenate([b + n * np.arange(k) // k for b, n, k in each])
        made = guessed(self.plant, self.data, begins, self.sigmas.size)
        return made if cut.outside is None else replace(made, outside=np.repeat(cut.outside, counts))

    def _from_shorter(self, cut: Stretches) -> Stretches:
        """Stretches with starts that leave least, from those of their parts, each twice as long as the one before."""
        found = self.refined(self._split(cut, PARTS), LONG)
        for longer in (self._split(cut, PARTS // 2), cut):
            at = np.minimum(np.searchsorted(found.begins, longer.begins), found.begins.size - 1)
            known = found.begins[at] == longer.begins
            starts = np.where(known[:, None], found.starts[at], longer.starts)
            found = self.refined(replace(longer, starts=starts), LONG)
        return found

    def _between_margins(self, cut: Stretches) -> tuple[Array, Array, NDArray[np.bool_]]:
        """(residuals over the noise (n_channel, n_sample), slopes of the starts, (n_stretch,) whether the model stays
        in table and range over each, from starts to both sides too), all in one block of lanes."""
        n = self.sigmas.size
        aside = np.eye(n)[:1] * MARGIN
        moves = np.concatenate([np.zeros((1, n)), STEP * np.eye(n), aside, -aside]) * self.sigmas
        starts = np.array([moved(cut.starts, move) for move in moves])
        over = self._residuals(np.tile(self.spread.z, (len(starts), 1)), replace(cut, starts=starts))
        inside = _all(_finite(over[:, [0, n + 1, n + 2]]), cut)
        return over[:, 0], _slopes(over[:, : n + 1]), inside

    def _inside(self, cut: Stretches, rows: Array) -> NDArray[np.bool_]:
        """(n_stretch,) whether the model stays in table and range over each, from starts to both sides too, and models
        (n_row, unknowns.size). Next to the end of a table a start cannot go where it suits best."""
        aside = np.eye(self.sigmas.size)[:1] * MARGIN * self.sigmas
        around = np.array([moved(cut.starts, by * aside) for by in (0.0, 1.0, -1.0)])
        tried = [(np.tile(self.spread.z, (3, 1)), around)]
        tried += [(part, np.tile(cut.starts, (len(part), 1, 1))) for part in self._at_once(rows)]
        inside = np.ones(cut.begins.size, dtype=bool)
        for models, starts in tried:
            over = self._residuals(models, replace(cut, starts=starts))
            inside &= _all(_finite(over), cut)
        return inside

    def _at_once(self, rows: Array) -> list[Array]:
        """Models in parts, as many as all threads simulate at the same time."""
        count = LANES * self.problem.threads
        return [rows[at : at + count] for at in range(0, len(rows), count)]

    def refined(self, cut: Stretches, steps: int = REFINED) -> Stretches:
        """The stretches with starts that leave least, and the slopes there; where a stretch fails it stays.

        A stretch whose step does not lead down goes back and takes half of it.
        """
        return self._refined_together([self._refinement(cut)], steps)[0]

    def _tried(self, cut: Stretches) -> Stretches:
        """The same of stretches that the model may not bear: those over which errors grow too much are left alone."""
        return self._refined_together([self._refinement(cut, self._hopeless)], REFINED)[0]

    def _refinement(
        self, cut: Stretches, hopeless: Callable[[Stretches], NDArray[np.bool_]] | None = None
    ) -> StartRefinement:
        return StartRefinement(cut, self.sigmas, by_themselves=not self.follows_from_before, hopeless=hopeless)

    def _hopeless(self, cut: Stretches) -> NDArray[np.bool_]:
        """(n_stretch,) over which errors grow too much for any start to be looked for."""
        return self._growth(cut) > HOPELESS * MOST_GROWTH

    @cached_property
    def follows_from_before(self) -> bool:
        """Whether a stretch follows from what those before have done to the model."""
        whole = guessed(self.plant, self.data, np.zeros(1, dtype=np.intp), self.sigmas.size)
        points = self._points(self.spread.z[None])
        return follows_from_before(self.problem, points, self.run, substeps=self.substeps, own=whole)

    def _refined_together(
        self, every: Sequence[StartRefinement], steps: int, *, rivals: bool = False
    ) -> list[Stretches]:
        """The stretches of each, refined, all of them cut alike: lanes that one of them leaves idle serve another. Of
        `rivals`, of which the best of each stretch is wanted, what falls far behind there after some steps stays."""
        for n in range(steps + 1):
            going = [one for one in every if not one.settled]
            if not going:
                break
            near_by, far = ([one for one in going if one.near_by is near] for near in (True, False))
            for one, base in zip(near_by, self._bases([one.cut for one in near_by]), strict=True):
                one.take(base, None)
            for one, (base, slopes) in zip(far, self._simulated([one.cut for one in far]), strict=True):
                one.take(base, slopes)
            mixed = [one for one in going if one.mixed]
            for one, base in zip(mixed, self._bases([one.best for one in mixed]), strict=True):
                one.mix(base)
            if rivals and n >= REFINED // 2:
                least = np.min([one.least for one in every], axis=0)
                for one in going:
                    one.give_up(least)
            if n < steps:
                for one in going:
                    one.move()
        return [one.best for one in every]

    def followed(self, cut: Stretches) -> dict[str, Array]:
        """Channel to (n_sample,) measured less simulated, SI units, from starts that suit the model: the better ones
        of those reached from the stretches' own and from what was measured, or, where stretches follow from those
        before, those reached from shorter ones; nan where none is borne."""
        if self.follows_from_before:
            return self.missed(self._from_shorter(cut))
        anew = guessed(self.plant, self.data, cut.begins, self.sigmas.size)
        every = [self._refinement(each) for each in (cut, anew)]
        self._refined_together(every, LONG, rivals=True)
        return self.missed(every[0].or_better(every[1]))

    def _bases(self, cuts: Sequence[Stretches]) -> list[Array]:
        """Residuals over the noise (n_channel, n_sample) of each, cut alike."""
        if not cuts:
            return []
        starts = np.array([cut.starts for cut in cuts])
        over = self._residuals(np.tile(self.spread.z, (len(cuts), 1)), replace(cuts[0], starts=starts))
        return list(np.moveaxis(over, 1, 0))

    def _simulated(self, cuts: Sequence[Stretches]) -> list[tuple[Array, Array]]:
        """(residuals over the noise (n_channel, n_sample), slopes of the starts, nothing where there are none) of each,
        cut alike."""
        if not cuts:
            return []
        n = self.sigmas.size
        moves = np.concatenate([np.zeros((1, n)), STEP * np.eye(n)])
        starts = np.array([moved(cut.starts, move * self.sigmas) for cut in cuts for move in moves])
        rows = np.tile(self.spread.z, (len(starts), 1))
        over = self._residuals(rows, replace(cuts[0], starts=starts))
        firsts = range(0, len(starts), n + 1)
        return [(over[:, first], _slopes(over[:, first : first + n + 1])) for first in firsts]

    def _residuals(self, rows: Array, own: Stretches) -> Array:
        """Residuals of the channels over the noise, (n_channel, n_row, n_sample)."""
        points = self._points(rows)
        columns = max(self.plant.parameters.sides, 1)
        found = lanes(self.problem, points, self.run, inputs=self.data.inputs(columns), substeps=self.substeps, own=own)
        return missed(self.problem, points, self.run, found, over_noise=True)

    def _points(self, rows: Array) -> Points:
        """Models (n_row, unknowns.size), with the effects of one that is extended."""
        points = Points.of(self.spread.unknowns, rows)
        if self.plant.effects is not None and points.effects is None:
            points = replace(points, effects=np.tile(self.plant.readings, (len(rows), 1)))
        return points

    def missed(self, cut: Stretches) -> dict[str, Array]:
        """Channel to (n_sample,) measured less simulated, SI units; nan where a stretch left table or range."""
        over = self._residuals(self.spread.z[None], replace(cut, starts=cut.starts[None]))
        return {n: v[0] * self.data.noise[n].sigma for n, v in zip(self.names, over, strict=True)}

    def _borne(self, cut: Stretches) -> NDArray[np.bool_]:
        """(n_stretch,) whether the model and its moves stay near the record over each."""
        base, slopes, finite = self._between_margins(cut)
        growth = self._growth(replace(cut, slopes=slopes))
        gentle = growth <= GENTLE
        if np.all(gentle | ~finite):
            return finite
        whole = replace(cut, slopes=slopes)
        near = _all(self._near(whole.without_starts(np.nan_to_num(base[:, None]))[:, 0]), cut)
        squares = np.zeros(base.shape)
        for rows in self._at_once(self.spread.rows):
            over = self._residuals(rows, replace(cut, starts=cut.starts))
            finite &= _all(_finite(over), cut)
            over -= base[:, None]
            whole.leave_out_starts(_or_nothing(over))
            squares += np.einsum("crn,crn->cn", over, over)
        self._seen[_key(cut)] = finite
        near &= _all(self._near(np.sqrt(squares)), cut)
        return finite & (gentle | (near & (growth <= MOST_GROWTH)))

    def _growth(self, cut: Stretches) -> Array:
        """(n_stretch,) by which the position's answer to a start's position grows over each, RMS of the last quarter
        over that of the first; where the model leaves its table or range on the way, as if it grew on alike."""
        lengths = np.diff([*cut.begins, len(self.data.commands)])
        return np.asarray(np.exp(np.minimum(self._rates(cut) * lengths, MOST_LOG)))

    def _rates(self, cut: Stretches) -> Array:
        """(n_stretch,) of its growth a sample."""
        found = np.zeros(cut.begins.size)
        if self.data.mover == "locked":
            return found
        answer = cut.slopes[self.names.index(POSITION_COLUMN), 0]
        for n, part in enumerate(cut.parts(answer.size)):
            own = np.trim_zeros(answer[part], "b")
            quarter = max(1, own.size // 4)
            if not np.any(own[:quarter]):
                found[n] = np.inf
                continue
            found[n] = np.log(np.mean(own[-quarter:] ** 2) / np.mean(own[:quarter] ** 2)) / (2 * own.size)
        return found

    def _near(self, over: Array) -> NDArray[np.bool_]:
        """(n_sample,) whether differences over the noise (n_channel, n_sample) are small enough for a linear model."""
        p = self.plant.parameters
        near = np.ones(over.shape[1], dtype=bool)
        for name, values in zip(self.names, over, strict=True):
            size = np.abs(values) * self.data.noise[name].sigma
            if name == POSITION_COLUMN and p.sides:
                near &= size <= REACH * p.nominal_gap
            elif self.data.channels[name].quantity == "current":
                near &= size <= CURRENT_REACH * float(np.sqrt(np.mean(self.data.measured[name] ** 2)))
        return near


def guessed(plant: KernelPlant, data: RunData, begins: NDArray[np.intp], n_start: int) -> Stretches:
    """Stretches with starts by a parabola through the positions around, and currents as read or commanded."""
    half, x = LOOKED_AT // 2, data.measured[POSITION_COLUMN]
    starts = np.zeros((begins.size, 4))
    for n, begin in enumerate(begins):
        first = int(np.clip(begin - half, 0, x.size - LOOKED_AT))
        time = (np.arange(first, first + LOOKED_AT) - begin) / data.rate
        _, starts[n, 3], starts[n, 2] = np.polyfit(time, x[first : first + LOOKED_AT], 2)
    if data.mover == "locked":
        starts[:, 2], starts[:, 3] = x.mean(), 0.0
    for side in range(plant.parameters.sides):
        read = data.measured.get(Channel("current", side + 1).column)
        starts[:, side] = (read_current(plant, data, side) if read is None else read)[begins]
    return Stretches(begins, starts, np.zeros((len(data.measured), n_start, x.size)))


def _key(cut: Stretches) -> bytes:
    """What stretches and their starts are known by."""
    return cut.begins.tobytes() + cut.starts.tobytes()


def _finite(over: Array) -> NDArray[np.bool_]:
    """(n_sample,) whether all residuals (n_channel, n_row, n_sample) are numbers."""
    return np.isfinite(over.sum(axis=(0, 1)))


def _slopes(over: Array) -> Array:
    """(n_channel, n_start, n_sample) of residuals (n_channel, 1 + n_start, n_sample) behind moves of none and of each
    start."""
    return _or_nothing((over[:, 1:] - over[:, :1]) / STEP)


def _or_nothing(values: Array) -> Array:
    """The values, in place, 0 where one is no number."""
    return values if np.isfinite(values.sum()) else np.nan_to_num(values, copy=False)


def _all(samples: NDArray[np.bool_], cut: Stretches) -> NDArray[np.bool_]:
    return np.asarray(np.logical_and.reduceat(samples, cut.begins))


def _pairs(open_: NDArray[np.bool_]) -> NDArray[np.intp]:
    """First ones of the neighbours that may be joined, each in one pair."""
    found, n = [], 0
    while n + 1 < open_.size:
        joins = bool(open_[n] and open_[n + 1])
        if joins:
            found.append(n)
        n += 2 if joins else 1
    return np.array(found, dtype=np.intp)


def _after(
    cut: Stretches, joined: Stretches, keep: NDArray[np.intp], firsts: NDArray[np.intp]
) -> tuple[Stretches, NDArray[np.bool_]]:
    """The stretches with the joins that were borne, and which may be joined further: these alone."""
    stay = np.setdiff1d(np.arange(cut.begins.size), firsts + 1)
    starts = cut.starts.copy()
    starts[firsts] = joined.starts[np.searchsorted(keep, firsts)]
    open_ = np.isin(stay, firsts)
    return replace(cut, begins=cut.begins[stay], starts=starts[stay]), open_
