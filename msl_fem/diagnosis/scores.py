"""What each effect would bring to a fit, by the linear model around it (`linear_model`): the evidence of all variants.

Its matrix G tells how far apart an effect and all that is unknown are: the noncentrality of an effect of given size a
is a'Ga (a case of Kay, Statistical Signal Processing II, 1998, ch. 6).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from msl_fem.computing.arrays import Array, Slopes
from msl_fem.computing.malloc import give_back
from msl_fem.computing.threads import in_threads
from msl_fem.diagnosis.likelihood import Fit
from msl_fem.diagnosis.linear_model import Background
from msl_fem.diagnosis.null import AmountPlaces, NullDistribution, null_distribution
from msl_fem.diagnosis.problem import Points
from msl_fem.diagnosis.row_loops import put_slopes
from msl_fem.diagnosis.unknowns import STEP_OF_AMOUNTS, EffectUnknown
from msl_fem.diagnosis.variants import Variant

Shapes = tuple[EffectUnknown, ...]
Amount = tuple[EffectUnknown, Shapes]
"""An amount, and the shapes around which it acts."""
AT_ONCE = 32  # amounts that are simulated together


@dataclass(frozen=True, eq=False)
class Score:
    """A variant at a converged fit.

    Attributes
    ----------
    gain : nats of log evidence, of the linear model
    guess : (n_amount,) z at which it is highest; `shift` how far all that was unknown before moves then
    own : (n_amount, n_amount) what the record tells of the amounts alone, when all else is unknown
    signature : (n_number, n_amount) weighted columns, where they were asked for
    """

    variant: Variant
    gain: float
    guess: Array
    shift: Array
    own: Array
    signature: Slopes | None = None


@dataclass(eq=False)
class AmountColumns:
    """Columns (n_number, n_amount) of amounts at a fit, weighted as there, less what the unknowns there make up for,
    with how far the nuisances (n_nuisance, n_amount) move for that; and where each amount stands.

    They do for the scores of another fit of the same stretches: an effect of some per cent changes what is an amount's
    own by as much. As they are simulated they would not: of a flexure's relaxation the stiffness makes up for all but a
    thousandth, and what is its own at one fit is lost in what another spring makes of the rest at the next.
    """

    places: Mapping[Amount, int]
    weighted: Slopes
    moved: Array
    root: Array
    begins: tuple[bytes, ...]

    def without(self, others: "AmountColumns") -> "AmountColumns":
        """Those of amounts that others have not."""
        own = [amount for amount in self.places if amount not in others.places]
        at = [self.places[amount] for amount in own]
        places = {amount: n for n, amount in enumerate(own)}
        return replace(self, places=places, weighted=self.weighted[:, at], moved=self.moved[:, at])

    def suit(self, found: Fit) -> bool:
        """Whether they are of the numbers of another fit."""
        return self.begins == found.likelihood.begins and len(self.weighted) == found.residual.size

    def lets_go(self) -> None:
        """The columns, together as large as all Jacobians: without them these suit no fit."""
        self.weighted = self.weighted[:0].copy()

    def of(self, found: Fit, amounts: Sequence[Amount]) -> tuple[Slopes, Array]:
        """The columns of amounts, not weighted, and how far the unknowns of a fit (n_unknown, n_amount) move already
        with each; those of which there are none are simulated at the fit."""
        new = [n for n, amount in enumerate(amounts) if amount not in self.places]
        simulated = signatures(found, [amounts[n] for n in new]) if new else None
        raw: Slopes = np.empty((len(amounts), found.residual.size), dtype=np.float32).T  # by columns, as simulated ones
        moved = np.zeros((found.unknowns.size, len(amounts)))

        def put(n: int) -> None:
            np.divide(self.weighted[:, self.places[amounts[n]]], self.root, out=raw[:, n], casting="same_kind")
            moved[: len(self.moved), n] = self.moved[:, self.places[amounts[n]]]

        # one after the other: together they are as large as all Jacobians
        in_threads(put, [n for n, one in enumerate(amounts) if one in self.places], found.likelihood.threads)
        if simulated is not None:
            raw[:, new] = simulated
        return raw, moved


@dataclass(frozen=True, eq=False)
class ScoredVariants:
    """All variants that can be seen at a fit, best first, what any of them brings by chance there, the effects none of
    whose variants can be simulated there, and the columns of all amounts."""

    scores: tuple[Score, ...] = ()
    null: NullDistribution = field(default_factory=NullDistribution)
    dropped: tuple[str, ...] = ()
    columns: AmountColumns | None = None


def score_of(background: Background, variant: Variant, places: Sequence[int]) -> Score:
    """The score of a variant whose amounts stand at these places."""
    best = background.best(places, np.array([one.one_sided for one in variant.amounts], dtype=bool))
    own = background.own[np.ix_(places, places)]
    return Score(variant, best.gain, best.amounts, best.shift, own)


def scores(found: Fit, tried: Sequence[Variant]) -> list[Score]:
    """All variants at a fit that can be seen there, best first, with their signatures."""
    return list(scored(found, tried, null=False, with_columns=True).scores)


def scored(
    found: Fit,
    tried: Sequence[Variant],
    *,
    null: bool = True,
    with_columns: bool = False,
    near: AmountColumns | None = None,
) -> ScoredVariants:
    """The variants at a fit; `null` is what they bring by chance, `with_columns` asks for their signatures. `near` are
    columns of a fit near by, that do where they are of the same stretches."""
    if not tried:
        return ScoredVariants()
    give_back()  # before what is as large as all Jacobians
    amounts = list(dict.fromkeys((amount, variant.shapes) for variant in tried for amount in variant.amounts))
    raw, moved = (signatures(found, amounts), None) if near is None or not near.suit(found) else near.of(found, amounts)
    seen = seen_columns(raw)
    failed = np.array([not (shown or np.isfinite(raw[:, n]).all()) for n, shown in enumerate(seen)], dtype=bool)
    raw[:, ~seen] = 0.0
    weighted = (raw * found.weights.root[:, None]).astype(np.float32) if with_columns else raw
    background = Background(found, raw, moved)
    place = {amount: n for n, amount in enumerate(amounts)}
    made, amount_places = [], []
    followed = set()
    for variant in tried:
        places = [place[one, variant.shapes] for one in variant.amounts]
        if not failed[places].any():
            followed.add(variant.effect)
        if seen[places].all():
            score = score_of(background, variant, places)
            made.append(replace(score, signature=weighted[:, places]) if with_columns else score)
            one_sided = tuple(one.one_sided for one in variant.amounts)
            amount_places.append(AmountPlaces(tuple(places), one_sided))
    by_chance = null_distribution(background.own, amount_places) if null else NullDistribution()
    dropped = dict.fromkeys(variant.effect for variant in tried if variant.effect not in followed)
    along = background.along[: found.unknowns.n_nuisance]
    columns = AmountColumns(place, background.own_columns, along, found.weights.root, found.likelihood.begins)
    return ScoredVariants(tuple(sorted(made, key=lambda s: -s.gain)), by_chance, tuple(dropped), columns)


def seen_columns(raw: Slopes) -> NDArray[np.bool_]:
    """(n_amount,) which columns (n_number, n_amount) could be simulated and show anything."""
    return np.array([np.isfinite(column).all() and bool(np.any(column)) for column in raw.T], dtype=bool)


def signatures(found: Fit, amounts: Sequence[Amount]) -> Slopes:
    """(n_number, n_amount) slopes of the residual over each amount at nothing, around its shapes; nan where there is
    none. With all amounts at nothing shapes change nothing. Differences are of equal steps."""
    effects = np.tile(found.unknowns.effect_vector(found.z), (len(amounts) + 1, 1))
    times = np.full(len(effects), found.unknowns.times_steps)
    for n, (one, shapes) in enumerate(amounts, 1):  # behind the fit as it is
        for shape in shapes:
            effects[n, shape.place] = shape.centre
        effects[n, one.place] = one.value(np.array(STEP_OF_AMOUNTS))
        centres = {(shape.effect, shape.name): shape.centre for shape in shapes}
        times[n] = max(times[0], found.unknowns.times_steps_of(one.effect, one.name, centres))
    points = Points(found.unknowns, np.tile(found.z, (len(effects), 1)), effects, times)
    columns = np.empty((len(amounts), found.residual.size), dtype=np.float32)
    steps = np.array([found.likelihood.steps(int(one)) for one in times])
    for equal in np.unique(steps[1:]):
        rows, base = 1 + np.flatnonzero(steps[1:] == equal), found.residual
        alike = replace(points, times=np.full(times.size, times[rows].max()))
        if equal != steps[0]:
            rows = np.append(0, rows)  # the fit as it is, among them
        for at in range(0, rows.size, AT_ONCE):
            own = rows[at : at + AT_ONCE]
            moved = found.likelihood.spectra(alike.only(own))
            first = int(own[0] == 0)
            if first:
                base = moved[0].copy()
            each = [columns[n - 1] for n in own[first:]]
            put_slopes(each, moved[first:], base, [STEP_OF_AMOUNTS] * len(each), threads=found.likelihood.threads)
            del moved
    return columns.T
