"""When an effect is named: what its evidence must be, how much of the error it must explain.

An effect is named when its evidence is above a threshold, and above what surrogates of the record bring (`null`);
when what coincides with a believed parameter has left that parameter's tolerance far behind; when what the effects
leave is the noise, or a small part of what was there without them; and when runs that no fit has seen become no worse.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.diagnosis.estimates import effect_estimates
from msl_fem.diagnosis.likelihood import QUIET, Fit, white
from msl_fem.diagnosis.problem import FitProblem
from msl_fem.diagnosis.refits import Refit, strained
from msl_fem.diagnosis.search import SearchStage
from msl_fem.diagnosis.unknowns import EffectUnknown
from msl_fem.diagnosis.variants import Variant
from msl_fem.plant.effects import CATALOGUE
from msl_fem.plant.plant import VOLTAGE_DRIVE
from msl_fem.prediction import RunData
from msl_fem.prediction.run_data import POSITION_COLUMN
from msl_fem.record import Record

Excesses = Sequence[Mapping[str, float]]
"""Of the fits without effects, with the first, and so on: channel to residuals over the noise."""
LEFT_OVER = 0.05
"""Share of the excess power without effects that named ones may leave."""
FINISHED = 0.25
"""Share of the excess power that a further effect may leave, where the fit before was not white."""
ONE_OF_SEVERAL = 0.75
"""The same of one of several effects that leave nothing but noise in the end."""
LITTLE_MORE = 1.5
"""Times the noise that is left at most, where a strong further effect counts that does not finish."""
AGREES = 0.5
"""Share of the excess power that the best candidate takes, that the most probable one takes at least."""
TOLERANCES = 4.0
"""Tolerances of a believed parameter below which what coincides with it is no cause."""
LEAST_SHARE = 1e-5
"""Of the moving mass, that a second mass has at least."""
HIGHEST_MODE = 0.8
"""Of half the sampling rate, beyond which a second resonance is no cause."""
LEAST_LOST = 0.02
"""Of a command beyond a drive's limit, that is lost at least: less is no limit but a drive that is not quite linear."""
MOST_OF_IT = 0.6
"""Share of the excess power that a main cause accounts for."""
RELAXED = 10.0
"""Tolerances within which a believed parameter may lie where it is tried as another explanation."""
BY_CHANCE = 0.99
"""Share of surrogates without effects that a first effect has to surpass."""
TIE = 5.0
"""Nats within which two names cannot be told apart."""
WORSE = 10.0
"""Nats that held-out data may become less probable before a name is refused."""
OWN_OF_A_RUN = {effect.name for effect in CATALOGUE.values() if effect.wanders}
"""Effects that begin anew in every run: held-out runs cannot speak against them."""
EQUAL = 0.5
"""Share of the largest gain before, from which an effect is no rest of that one's form."""
BESIDE = 0.1
"""Share of the largest gain before that an effect has to bring to count where more than noise is left beside it."""
FAR_WITHIN = 0.5
"""Share of all that, up to which a refit that is not converged will not get there."""
PROMISING = 0.25
"""Share of its gain that the next step of such a refit promises, with which it is followed nevertheless."""
LEFT_OUT = 0.1
"""Of what effects of many forms leave out, what one of a single form does at most."""
WEAK = 0.03
"""Share of the largest gain before, below which what a further effect may come to decides whether it is followed."""
STRONG = 25.0  # the square of a number of standard errors at which the rest of an effect counts by itself
COINCIDING = {
    ("gap_offset", "offset"): "nominal_gap",
    ("fringing", "depth_error"): "magnetic_scale",
    ("fringing", "turns_error"): "magnetic_scale",
    ("coil_heating", "initial_rise"): "coil_resistance",
    ("thermal_history", "rise_1"): "coil_resistance",
    ("thermal_history", "rise_2"): "coil_resistance",
    ("thermal_history", "core_rise"): "coil_resistance",
    ("position_sensor_nonlinearity", "gain_error"): "position_gain",
    ("leakage_inductance", "share_1"): "leakage_inductance_1",
    ("leakage_inductance", "share_2"): "leakage_inductance_2",
    ("mutual_inductance", "share"): "mutual_inductance",
    ("remanent_flux", "current_1"): "command_zero_1",
    ("remanent_flux", "current_2"): "command_zero_2",
}
"""Parameters of effects that act as a believed parameter does."""
RIVALS = 0.25  # of the best gain, that a candidate has to be looked at by what it takes
LEAST_TOLD = 1e-9  # of a tolerance's precision, that data say at least
SHORTEST = 0.5  # s of all fit runs together
FEWEST = 3000  # samples of them
RESPONSE = 20.0  # times the noise: what the position has to move for anything to be seen


@dataclass(frozen=True)
class Rule:
    """Thresholds in nats, and how many effects are looked for.

    A further effect also has to bring `share` of what the first one brought: so much may come from what the first one's
    equation leaves out, and `LEFT_OUT` of that where it has one form (`Effect.one_form`). Not so of what coincides with
    a believed parameter: its tolerance bounds what it can bring, however far it has left that; and not of what brings a
    channel down to noise in which much was left (`quietens`), which no rest of a form does.
    `finished` is the share of the excess power that it may leave, where the fit before was not quiet; `several` that of
    one of several, which have to leave noise alone in the end.
    """

    threshold: float = 9.0
    further: float = 24.0
    share: float = 0.003
    finished: float = FINISHED
    several: float = ONE_OF_SEVERAL
    most: int = 4

    def needed(self, stages: Sequence[SearchStage], variant: Variant, left: Mapping[str, float]) -> float:
        """Nats that a variant of the stage after these has to bring at least, beside a fit that leaves so many times
        the noise in each channel."""
        if not stages:
            return self.threshold
        by_itself = _bounded(variant) or any(value > LITTLE_MORE for value in left.values())
        return max(self._further(stages, by_itself=by_itself), of_a_form(variant, stages))

    def _further(self, stages: Sequence[SearchStage], *, by_itself: bool) -> float:
        first = stages[0].best
        if by_itself or first is None:
            return self.further
        left_out = LEFT_OUT if CATALOGUE[first.variant.effect].one_form else 1.0
        return max(self.further, left_out * self.share * first.gain)

    def enough(self, stages: Sequence[SearchStage], n: int, excesses: Excesses) -> bool:
        """Whether the best effect of stage n brings enough; without what it leaves it brings nothing down to noise."""
        best, first = stages[n].best, stages[0].best
        if best is None or first is None:
            return False
        if n == 0:
            return best.gain >= max(self.threshold, stages[n].null.quantile(BY_CHANCE))
        by_itself = _bounded(best.variant) or (n + 1 < len(excesses) and quietens(*excesses[n : n + 2]))
        return best.gain >= self._further(stages, by_itself=by_itself)

    def out_of_reach(self, stages: Sequence[SearchStage], refit: Refit, left: Mapping[str, float]) -> bool:
        """Whether a refit that is not converged will not come to what the stage after these has to bring (`needed`)."""
        return refit.reach < self.needed(stages, refit.variant, left)

    def searches_on(self, stages: Sequence[SearchStage], n: int, excesses: Excesses) -> bool:
        """Whether more is looked for beside the best effect of stage n: it may be one of several."""
        return self.goes_on(stages, n, excesses) or completes(excesses[n], excesses[n + 1], self.several)

    def leads_nowhere(self, stages: Sequence[SearchStage], refit: Refit, excesses: Excesses) -> bool:
        """Whether a refit behind these stages is weak, and takes too little of what they leave for the search to go on
        with it (`searches_on`), what it may still come to in proportion."""
        gains = [stage.best.gain for stage in stages if stage.best is not None]
        if not 0 < refit.gain <= refit.reach < WEAK * max(gains, default=0.0):
            return False
        after = refit.may_leave(excesses[-1])
        granted = SearchStage(refit.fit, (), (replace(refit, gain=refit.reach),))
        return not self.searches_on([*stages, granted], len(stages), [*excesses, after])

    def goes_on(self, stages: Sequence[SearchStage], n: int, excesses: Excesses) -> bool:
        """Whether the best effect of stage n is no spurious addition to those before: it completes them (`completes`),
        or of all that was there without effects no more is left than named ones may leave, and it brings a channel down
        to noise, or with a large gain leaves little more than noise in all or brings believed parameters back to their
        tolerances (`restores`), or is as large as any of them and takes a good part. What is of a run's own, a
        wandering sensor, leaves a rest that no other effect completes: beside it a large gain counts.
        """
        first, best = stages[0].best, stages[n].best
        if n == 0 or completes(excesses[n], excesses[n + 1], self.finished) or first is None or best is None:
            return True
        large = strong(stages, n)
        if large and first.variant.effect in OWN_OF_A_RUN:
            return True
        little = large and max(excesses[n + 1].values()) <= LITTLE_MORE
        settles = quietens(excesses[n], excesses[n + 1])
        equal = strong(stages, n, EQUAL) and completes(excesses[n], excesses[n + 1], self.several)
        if share_left(excesses, n + 1) > LEFT_OVER:
            return False
        return little or settles or equal or (large and restores(stages[n].base, best.fit))


def _bounded(variant: Variant) -> bool:
    """Whether all that a variant changes coincides with believed parameters, whose tolerances bound what it brings."""
    return all((amount.effect, amount.name) in COINCIDING for amount in variant.amounts)


def excess_power(excess: Mapping[str, float]) -> float:
    """The channels' residual powers over the noise's, what is above 1 of each, together."""
    return sum(max(value**2 - 1, 0.0) for value in excess.values())


def share_left(excesses: Excesses, taken: int) -> float:
    """Share of the excess power without effects that is left with so many."""
    without = excess_power(excesses[0])
    return excess_power(excesses[taken]) / without if without > 0 else 0.0


def too_much_left(effects: Sequence[str], excesses: Excesses) -> str:
    """Why effects that were taken, in their order, are not named: they leave neither noise nor a small part of what was
    there without them. Empty where they do."""
    taken = len(effects)
    left = share_left(excesses, taken)
    if not taken or white(excesses[taken]) or left <= LEFT_OVER:
        return ""
    power = f"{100 * left:.3g} % of the excess power is left"
    return f"nearest in the catalogue: {', '.join(effects)}; not named, since {power}"


def stays_within(problem: FitProblem, refit: Refit) -> bool:
    """Whether a refit that is not converged is far from being more than a believed parameter within tolerances, and its
    next step promises no large part of what it has gained: with that it may go far."""
    if refit.fit.predicted > PROMISING * refit.gain:
        return False
    return not leaves_tolerance(problem, refit.fit, refit.variant.effect, share=FAR_WITHIN)


def leaves_tolerance(problem: FitProblem, fit: Fit, effect: str, *, share: float = 1.0) -> bool:
    """Whether an effect of a fit is more than a believed parameter within a share of `TOLERANCES` of its own.

    Where gauges alone tell the gap, an offset of it is no more than their zero.
    """
    sigmas = dict(fit.unknowns.believed)
    if "static_gap_zero" in sigmas:
        sigmas.setdefault("nominal_gap", sigmas["static_gap_zero"] / problem.plant.parameters.nominal_gap)
    estimates = effect_estimates(fit)[effect]
    amounts, apart = 0, []
    for row, unknown in enumerate(fit.unknowns.effects, fit.unknowns.n_nuisance):
        if unknown.effect != effect or unknown.width:
            continue
        amounts += 1
        sigma = known_within(sigmas, unknown)
        if sigma is None:
            apart.append(row)
        else:
            moved = abs(_relative(problem, unknown, estimates[unknown.name].value - unknown.base))
            if sigma and moved >= share * TOLERANCES * sigma:
                return True
    if not apart:
        return False
    z = fit.z[apart]
    covariance = np.linalg.inv(fit.precision)[np.ix_(apart, apart)]
    strong = float(z @ np.linalg.solve(covariance, z))
    return strong >= share**2 * STRONG or len(apart) == amounts


def known_within(sigmas: Mapping[str, float], unknown: EffectUnknown) -> float | None:
    """One sigma of the believed parameter that an amount coincides with, or of what is believed of itself, whichever is
    larger, relative or as the amount is stated; 0 where that is known exactly, None where it coincides with nothing."""
    own = sigmas.get(f"{unknown.effect}.{unknown.name}", 0.0) * abs(unknown.base)
    believed = COINCIDING.get((unknown.effect, unknown.name))
    if believed is None:
        return own or None
    return max(sigmas.get(believed, 0.0), own)


def beyond_tolerances(problem: FitProblem, stage: SearchStage) -> SearchStage:
    """A stage without refits that are no more than a believed parameter within its tolerances."""

    def counts(refit: Refit) -> bool:
        return refit.gain <= 0 or leaves_tolerance(problem, refit.fit, refit.variant.effect)

    return replace(stage, refits=tuple(filter(counts, stage.refits)))


def in_sight(problem: FitProblem, stage: SearchStage) -> SearchStage:
    """A stage without refits that are not what their names say: second resonances that have no mass, or lie where a
    record shows next to nothing, drive limits beyond which next to nothing is lost, and heatings of coils that begin
    warm and nothing heats, which have a history."""

    def counts(refit: Refit) -> bool:
        effect = refit.variant.effect
        if effect not in {"structural_mode", "coil_heating", "drive_limit"}:
            return True
        told = effect_estimates(refit.fit)[effect]
        if effect == "structural_mode":
            heavy = "mass_share" in told and told["mass_share"].value >= LEAST_SHARE
            return heavy and told["frequency"].value <= HIGHEST_MODE * problem.plant.rate / 2
        if effect == "coil_heating":
            return not {"rise_per_joule", "initial_rise"} <= told.keys() or told["rise_per_joule"].low > 0
        return told["lost_share"].value >= LEAST_LOST

    return replace(stage, refits=tuple(filter(counts, stage.refits)))


def of_its_own(stage: SearchStage, before: Sequence[SearchStage]) -> SearchStage:
    """A stage without refits that are the small deviation of an effect before from its form."""
    return replace(stage, refits=tuple(one for one in stage.refits if one.gain >= of_a_form(one.variant, before)))


def of_a_form(variant: Variant, before: Sequence[SearchStage]) -> float:
    """Nats below which a variant may be no more than the deviation of an effect of the stages before from its form:
    mutual flux over the position beside mutual flux, a little of another lag beside one whose order is not quite its
    own, remanence beside loops that a model nearly follows; minus infinity where it deviates from none."""
    gains = {one.best.variant.effect: one.best.gain for one in before if one.best is not None}
    shares = CATALOGUE[variant.effect].deviation_of
    return max((share * gains[name] for name, share in shares.items() if name in gains), default=-np.inf)


def _relative(problem: FitProblem, unknown: EffectUnknown, value: float) -> float:
    """An effect's parameter over the believed value of what it coincides with, or in units of a zero's: a current in
    volts where voltages are commanded."""
    plant = problem.plant.parameters
    if unknown.effect == "remanent_flux" and plant.drive == VOLTAGE_DRIVE:
        return value * plant.resistance
    return value / plant.nominal_gap if unknown.name == "offset" else value


def strong(stages: Sequence[SearchStage], n: int, share: float = BESIDE) -> bool:
    """Whether the best effect of stage n brings a share of what any before it did: what is left of a cause that has
    another form than the catalogue's seldom does."""
    gains = [0.0 if stage.best is None else stage.best.gain for stage in stages[: n + 1]]
    return gains[n] >= share * max(gains)


def does_alone(stages: Sequence[SearchStage], excesses: Excesses) -> bool:
    """Whether the first effect leaves noise, and one more, of the fits that there are, brings next to nothing beside
    it: that says nothing against it. Two more may stand for a weak one that is neither."""
    gains = [0.0 if stage.best is None else stage.best.gain for stage in stages[: len(excesses) - 1]]
    return 1 <= len(gains) <= 2 and white(excesses[1]) and sum(gains[1:]) < WEAK * gains[0]


def completes(before: Mapping[str, float], after: Mapping[str, float], share: float = FINISHED) -> bool:
    """Whether one effect more is no spurious addition to those before: they were enough, or it leaves little of what
    they left."""
    return white(before) or white(after) or excess_power(after) <= share * excess_power(before)


def quietens(before: Mapping[str, float], after: Mapping[str, float]) -> bool:
    """Whether one effect more leaves noise alone in a channel in which more than `LITTLE_MORE` was left."""
    return any(value > LITTLE_MORE and after[name] <= QUIET for name, value in before.items())


def restores(before: Fit, after: Fit) -> bool:
    """Whether one effect more brings believed parameters, one of which was `strained`, back to where they are believed:
    what they made up for is no residual of any channel."""
    strayed, left = (fit.z[: len(fit.unknowns.believed)] for fit in (before, after))
    return strained(before) and _beyond_one(left) <= FINISHED * _beyond_one(strayed)


def _beyond_one(z: Array) -> float:
    """What squares of numbers that are normal leave above their mean of 1, together."""
    return float(np.sum(np.maximum(z**2 - 1, 0.0)))


def n_accepted(stages: Sequence[SearchStage], excesses: Excesses, rule: Rule) -> int:
    """How many of the stages' best effects are taken: as many as complete those before, or together, in whatever order,
    leave noise alone, or little more where all are strong.

    Parameters
    ----------
    excesses : (n_stage + 1,) without any effect, with the first, and so on
    """
    taken, each_completes = 0, True
    for n in range(min(len(stages), len(excesses) - 1)):
        if not rule.enough(stages, n, excesses):
            break
        each_completes &= rule.goes_on(stages, n, excesses)
        if each_completes or white(excesses[n + 1]) or _strong_together(stages, n, excesses):
            taken = n + 1
    return taken


def _strong_together(stages: Sequence[SearchStage], n: int, excesses: Excesses) -> bool:
    """Whether the best effects of the stages up to n are strong, every one, and leave little more than noise."""
    little = max(excesses[n + 1].values()) <= LITTLE_MORE and share_left(excesses, n + 1) <= LEFT_OVER
    return little and all(strong(stages, m) for m in range(1, n + 1))


def disagrees(stage: SearchStage, before: Mapping[str, float]) -> str:
    """The effect that takes far more of the excess power than the most probable one does; empty where none does, or
    nothing but noise is there."""
    best = stage.best
    if best is None or white(before):
        return ""
    most, name = 0.0, ""
    own = excess_power(before) - excess_power(best.fit.excess)
    for rival in stage.rivals(best.gain * (1 - RIVALS)):
        taken = excess_power(before) - excess_power(rival.fit.excess)
        if taken > most:
            most, name = taken, rival.variant.effect
    return name if own < AGREES * most else ""


def undecidable_because(record: Record, data: Sequence[RunData]) -> str:
    """Why nothing can be decided; empty where it can be."""
    fitted = [run for run in data if run.role == "fit"]
    if not fitted:
        return "no dynamic run has the role fit"
    if not any(run.role == "held-out" for run in data):
        return "no run is held out, so no gain could be shown; give one run the role held-out"
    stuck = [text for text in record.warnings if "clipped" in text or "stuck" in text]
    if stuck:
        return f"a sensor is stuck or clipped: {stuck[0]}"
    too_few = _too_few([len(run.commands) for run in fitted], fitted[0].rate)
    if too_few:
        return too_few
    if max(float(np.ptp(run.commands, axis=0).max()) for run in fitted) == 0:
        return "the commands of the fit runs never change; excite the plant"
    moved = 0.0
    if any(run.mover == "locked" for run in fitted):
        return ""
    for run in fitted:
        moved = max(moved, float(run.measured[POSITION_COLUMN].std() / run.noise[POSITION_COLUMN].sigma))
    if moved < RESPONSE:
        return f"the position moves by {moved:.3g} times its noise; at least {RESPONSE:g} times are needed, excite more"
    return ""


def too_few_because(problem: FitProblem) -> str:
    """Why what counts of the fit runs does not do; empty where it does."""
    return _too_few([part.stop - part.start for _, part in problem.pieces], problem.plant.rate)


def _too_few(lengths: Sequence[int], rate: float) -> str:
    samples, seconds = sum(lengths), sum(lengths) / rate
    if samples >= FEWEST and seconds >= SHORTEST:
        return ""
    return f"the fit runs hold {samples} samples in {seconds:.3g} s; at least {FEWEST} in {SHORTEST:g} s are needed"


def gauges(base: Fit, gain: float) -> tuple[str, ...]:
    """Believed parameters (of both sides together) that would explain a record nearly as well as an effect of a gain
    does, were they `RELAXED` tolerances wide.

    From the Gauss-Newton matrix P of all unknowns at the fit without the effect: with V the block of P^-1 of some of
    them, the data alone say that they lie at m = H^-1 (H + 1) z with precision H = V^-1 - 1, and a normal prior s
    times as wide changes the log evidence by log N(m; 0, H^-1 + s^2) - log N(m; 0, H^-1 + 1).
    """
    groups: dict[str, list[int]] = {}
    for row, (name, _) in enumerate(base.unknowns.believed):
        groups.setdefault(name.removesuffix("_1").removesuffix("_2"), []).append(row)
    covariance = np.linalg.inv(base.precision)
    found = []
    for name, rows in groups.items():
        block = np.asarray(covariance[np.ix_(rows, rows)], dtype=np.float64)
        if _relaxed_gain(block, base.z[rows]) >= gain - TIE:
            found.append(name)
    return tuple(found)


def _relaxed_gain(block: Array, z: Array) -> float:
    """Nats by which unknowns at z with this covariance gain from a prior `RELAXED` times as wide."""
    told, vectors = np.linalg.eigh(np.linalg.inv(block) - np.eye(z.size))
    told = np.maximum(told, LEAST_TOLD)
    mean = (told + 1) / told * (vectors.T @ z)
    narrow, wide = 1 / told + 1, 1 / told + RELAXED**2
    return float(np.sum(mean**2 * (1 / narrow - 1 / wide) - np.log(wide / narrow)) / 2)
