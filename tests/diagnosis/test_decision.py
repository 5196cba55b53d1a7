"""The rule that names: what is enough evidence, what must be left, what a believed parameter may do."""

from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from msl_fem.diagnosis import decision, effect_search
from msl_fem.diagnosis.conclusion import (
    EffectSearch,
    _about_starts,
    _compensating,
    _held_out,
    _named,
    _without_patches,
    main_cause,
)
from msl_fem.diagnosis.decision import (
    RELAXED,
    WORSE,
    Rule,
    _relative,
    _relaxed_gain,
    completes,
    disagrees,
    does_alone,
    excess_power,
    gauges,
    in_sight,
    n_accepted,
    of_its_own,
    stays_within,
)
from msl_fem.diagnosis.fit import FitPlan
from msl_fem.diagnosis.kind import ErrorSignal, PredictionError, held_out_against, held_out_worse, log_likelihood_gain
from msl_fem.diagnosis.likelihood import white
from msl_fem.diagnosis.null import NullDistribution
from msl_fem.diagnosis.refits import Refit
from msl_fem.diagnosis.search import SearchStage
from msl_fem.diagnosis.unknowns import EffectUnknown
from msl_fem.diagnosis.variants import Variant
from msl_fem.plant.plant import CURRENT_DRIVE, VOLTAGE_DRIVE


def stages(
    *gains: float | None,
    first: str = "time_delay",
    amount: str = "command",
    by_chance: NullDistribution = NullDistribution(),  # noqa: B008 - frozen
) -> list[Any]:
    variant = SimpleNamespace(effect=first, amounts=(SimpleNamespace(effect=first, name=amount),))
    bests = [None if g is None else SimpleNamespace(gain=g, variant=variant, fit=at(0.0)) for g in gains]
    return [SimpleNamespace(best=best, base=at(0.0), null=by_chance) for best in bests]


def at(*z: float) -> Any:
    """A fit whose believed parameters lie so many tolerances off, and an effect at 100."""
    return SimpleNamespace(z=np.array([*z, 100.0]), unknowns=SimpleNamespace(believed=[("zero", 1.0)] * len(z)))


def predicting(gain: float) -> Any:
    """A kind whose held-out runs become so much more probable where what is uncertain may move."""
    return SimpleNamespace(predictive_gain=lambda before, after: gain)


NOT_ASKED = predicting(-np.inf)
QUIET, LOUD, LOUDER = {"x": 1.02, "i": 1.0}, {"x": 3.0, "i": 1.1}, {"x": 10.0, "i": 2.0}


def test_excess_is_what_is_above_the_noise_in_all_channels() -> None:
    assert excess_power({"x": 3.0, "i": 0.9}) == pytest.approx(8.0)
    assert excess_power({"x": 3.0, "i": 2.0}) == pytest.approx(11.0)
    assert white(QUIET)
    assert not white(LOUD)


def test_effects_are_taken_as_long_as_they_bring_enough() -> None:
    rule = Rule()
    assert n_accepted(stages(8.9), [QUIET], rule) == 0
    assert n_accepted(stages(9.1, 3.0), [QUIET, QUIET], rule) == 1
    loud = NullDistribution(np.linspace(0.0, 10.0, 101))
    assert n_accepted(stages(9.5, by_chance=loud), [QUIET], rule) == 0, "surrogates bring 9.9 in one of a hundred"
    assert n_accepted(stages(10.5, 3.0, by_chance=loud), [QUIET, QUIET], rule) == 1
    assert n_accepted(stages(400.0, 25.0, None), [LOUD, QUIET, QUIET], rule) == 2
    assert n_accepted(stages(400.0, 23.0), [LOUD, QUIET], rule) == 1
    assert n_accepted(stages(9000.0, 26.0), [LOUD, QUIET], rule) == 1, "a fraction of what the first one brought"
    assert n_accepted(stages(1e6, 2000.0), [LOUDER, LOUD, QUIET], rule) == 2, "a loud channel is brought down"
    assert n_accepted(stages(1e6, 2000.0), [LOUDER, {"x": 1.4, "i": 1.0}, QUIET], rule) == 1
    gap = stages(9000.0, 26.0, first="gap_offset", amount="offset")
    assert n_accepted(gap, [LOUD, QUIET, QUIET], rule) == 2, "the gap's tolerance bounds what an offset can bring"


def test_an_ornament_of_an_effect_that_fits_badly_is_not_taken() -> None:
    """The first leaves three times the noise; what then brings evidence but leaves it as loud is no cause."""
    rule = Rule()
    assert not completes(LOUD, {"x": 2.9, "i": 1.0})
    assert completes(LOUD, QUIET)
    assert n_accepted(stages(1000.0, 100.0), [LOUDER, LOUD, {"x": 2.9, "i": 1.0}], rule) == 1
    assert n_accepted(stages(1000.0, 900.0), [LOUDER, LOUD, QUIET], rule) == 2


def test_several_effects_that_leave_noise_alone_are_taken_though_none_completes_those_before() -> None:
    """Each of three takes about a third of the excess power; without the last of them none is named."""
    powers = [{"x": 10.0}, {"x": 8.0}, {"x": 5.0}, QUIET, QUIET]
    assert n_accepted(stages(9000.0, 8000.0, 7000.0, None), powers, Rule()) == 3
    assert n_accepted(stages(9000.0, 8000.0, None), powers, Rule()) == 1
    assert n_accepted(stages(9000.0, 8000.0, 7000.0), [*powers[:2], {"x": 7.5}, {"x": 2.0}], Rule()) == 1
    in_another_order = [*powers[:2], {"x": 7.9}, QUIET]
    assert n_accepted(stages(9000.0, 8000.0, 7000.0), in_another_order, Rule()) == 3, "the set leaves noise"


@pytest.mark.parametrize(("second", "left", "taken"), [(130.0, 1.4, 2), (90.0, 1.4, 1), (130.0, 1.6, 1)])
def test_a_strong_effect_counts_though_more_than_noise_is_left(second: float, left: float, taken: int) -> None:
    """It brings a tenth of the largest gain, and leaves half more than the noise at most: a real drive's friction keeps
    a structure of 70 times the noise, beside which much would bring as many nats."""
    powers = [LOUDER, {"x": 1.8, "i": 1.0}, {"x": left, "i": 1.0}]
    assert n_accepted(stages(1000.0, second), powers, Rule()) == taken


@pytest.mark.parametrize(("second", "left", "taken"), [(700.0, 1.4, 3), (500.0, 1.4, 1), (700.0, 1.6, 1)])
def test_strong_effects_count_together_though_a_little_more_than_noise_is_left(
    second: float, left: float, taken: int
) -> None:
    """Hysteresis, remanence that leaves half of the rest, and friction that leaves a third more than the noise."""
    powers = [{"x": 13.7, "i": 14.8}, {"x": 8.5, "i": 1.5}, {"x": 6.1, "i": 1.3}, {"x": left, "i": 1.2}]
    assert n_accepted(stages(6000.0, second, 800.0), powers, Rule()) == taken


@pytest.mark.parametrize(("second", "left", "taken"), [(600.0, 3.0, 2), (400.0, 3.0, 1), (600.0, 3.8, 1)])
def test_an_effect_as_large_as_the_first_is_no_rest_of_its_form(second: float, left: float, taken: int) -> None:
    """A drive's limit beside eddy currents, both in other forms: the second brings half of the first one's nats and
    takes a quarter of what is left at least, and less than a twentieth of all is left."""
    powers = [{"x": 30.0, "i": 1.0}, {"x": 4.0, "i": 1.0}, {"x": left, "i": 1.0}]
    assert n_accepted(stages(1000.0, second), powers, Rule()) == taken


@pytest.mark.parametrize(("position", "current", "taken"), [(1.05, 2.1, 2), (1.3, 2.1, 1), (1.05, 20.0, 1)])
def test_an_effect_that_brings_a_channel_to_its_noise_counts_though_another_channel_keeps_more(
    position: float, current: float, taken: int
) -> None:
    """A sensor's curvature beside coils whose voltages keep a little of their heat: 2 % of the first gain."""
    powers = [{"x": 3.7, "i": 80.0}, {"x": 3.3, "i": current}, {"x": position, "i": current}]
    assert n_accepted(stages(50e3, 900.0), powers, Rule()) == taken


@pytest.mark.parametrize(("gain", "named"), [(5.0, 2), (0.0, 1), (-3.0, 1)])
def test_where_more_than_noise_is_left_held_out_runs_have_to_become_better(gain: float, named: int) -> None:
    found = replace(searched(("periodic_disturbance", 1000.0), ("squeeze_film", 130.0)))
    rest = (LOUDER, {"x": 2.8, "i": 1.0}, {"x": 2.0, "i": 1.0})
    loud, notes = _named(NOT_ASKED, replace(found, excesses=rest), [50.0, gain])
    assert loud.taken == named
    assert any("held-out" in note for note in notes) == (named < 2)
    assert _named(NOT_ASKED, found, [50.0, gain])[0].taken == 2, "to the noise chance is enough"


@pytest.mark.parametrize(("gain", "predicted", "hopeless"), [(20.0, 1.0, True), (20.0, 2.0, False), (30.0, 0.0, False)])
def test_a_refit_that_cannot_come_to_what_a_further_effect_needs_is_not_led_on(
    gain: float, predicted: float, hopeless: bool
) -> None:
    fit: Any = SimpleNamespace(predicted=predicted, to_come=lambda steps: predicted, stuck=False)
    refit = Refit(Variant("time_delay", ()), fit, gain)
    assert Rule().out_of_reach(stages(1000.0), refit, LOUDER) is hopeless
    assert not Rule().out_of_reach([], refit, LOUDER), "a first effect needs less"


@pytest.mark.parametrize(
    ("gain", "predicted", "left", "nowhere"),
    [
        (20.0, 0.0, 1.95, True),
        (31.0, 0.0, 1.95, False),
        (20.0, 3.7, 1.95, False),
        (20.0, 0.0, 1.8, False),
        (10.0, 0.0, 1.9, True),
        (10.0, 6.0, 1.9, False),
    ],
    ids=["weak", "strong enough", "may become strong", "takes enough", "takes too little", "may take enough"],
)
def test_a_weak_effect_that_takes_too_little_is_not_followed(
    gain: float, predicted: float, left: float, nowhere: bool
) -> None:
    """Of 2 times the noise three quarters of the excess power may be kept, which is 1.80 times the noise; an effect
    below 3 % of 1000 nats has to come to that, what it may still take in proportion to its nats."""
    fit: Any = SimpleNamespace(to_come=lambda steps: predicted, stuck=False, excess={"x": left, "i": 1.0})
    refit = Refit(Variant("time_delay", ()), fit, gain)
    excesses = [LOUDER, {"x": 2.0, "i": 1.0}]
    assert Rule().leads_nowhere(stages(1000.0), refit, excesses) is nowhere
    assert not Rule().leads_nowhere([], refit, [excesses[1]]), "a first effect is followed"
    assert not Rule().leads_nowhere(stages(1000.0), refit, [LOUDER, QUIET]), "beside noise its nats count alone"


def test_an_effect_beside_noise_alone_needs_a_share_of_the_first_one_s_nats() -> None:
    """Beside more than noise it may bring a channel down to it, and what tolerances bound needs none."""
    offset, friction = (
        Variant(effect, (EffectUnknown(effect, name),))
        for effect, name in (("gap_offset", "offset"), ("coulomb_friction", "force"))
    )
    rule, quiet = Rule(), {"x": 1.0, "i": 1.4}
    assert rule.needed([], friction, quiet) == rule.threshold
    assert rule.needed(stages(50e3), friction, quiet) == pytest.approx(150.0)
    assert rule.needed(stages(50e3), offset, quiet) == rule.further
    assert rule.needed(stages(50e3), friction, {"x": 1.0, "i": 1.6}) == rule.further
    assert rule.needed(stages(1e3), friction, quiet) == rule.further
    assert rule.needed(stages(50e3, first="coil_heating"), friction, quiet) == rule.further, "heat has one form"
    assert rule.needed(stages(200e3, first="coil_heating"), friction, quiet) == pytest.approx(60.0)


def candidate(effect: str, gain: float, loud: float) -> Any:
    return SimpleNamespace(gain=gain, variant=SimpleNamespace(effect=effect), fit=SimpleNamespace(excess={"x": loud}))


@pytest.mark.parametrize(("loud", "other"), [(9.0, "coulomb_friction"), (3.0, "")])
def test_evidence_and_what_is_taken_from_the_excess_have_to_agree(loud: float, other: str) -> None:
    """The most probable effect leaves nine tenths of the error, and a less probable one hardly any."""
    refits = (candidate("structural_mode", 60_000, loud), candidate("coulomb_friction", 34_000, 2.0))
    stage = SearchStage(None, (), refits)  # type: ignore[arg-type]
    assert disagrees(stage, {"x": 10.0}) == other
    assert not disagrees(stage, QUIET)


@dataclass(frozen=True)
class Ended:
    """A fit by where it ended and what it leaves."""

    z: np.ndarray
    excess: dict[str, float]


@dataclass(frozen=True)
class Ceilings:
    """A likelihood that knows what the belief leaves."""

    believed: float
    strict: bool = False

    def excess(self, found: Ended) -> dict[str, float]:
        return {"x": self.believed, "i": 1.0} if not found.z.any() else found.excess


@pytest.mark.parametrize(
    ("believed", "strictly", "left"),
    [(28.0, 20.0, 20.0), (28.0, 2000.0, 918.0), (1000.0, 20.0, 918.0)],
    ids=["worse than the belief", "no better with ceilings", "better than the belief"],
)
def test_a_fit_that_is_worse_than_the_belief_is_made_anew_with_ceilings(
    monkeypatch: pytest.MonkeyPatch, believed: float, strictly: float, left: float
) -> None:
    def fit(likelihood: Ceilings, *_: object, plan: object) -> Ended:
        assert likelihood.strict
        return Ended(np.ones(2), {"x": strictly, "i": 1.0})

    monkeypatch.setattr(effect_search, "fit", fit)
    kind: Any = SimpleNamespace(likelihood=Ceilings(believed), unknowns=None)
    first: Any = Ended(np.ones(2), {"x": 918.0, "i": 1.0})
    assert max(effect_search.not_worse(kind, np.zeros(2), first, FitPlan()).excess.values()) == left


def test_beside_a_wandering_sensor_a_large_gain_counts_though_nothing_finishes_what_it_leaves() -> None:
    powers = [LOUDER, LOUD, {"x": 2.9, "i": 1.0}]
    assert n_accepted(stages(1000.0, 130.0, first="sensor_drift"), powers, Rule()) == 2
    assert n_accepted(stages(1000.0, 90.0, first="sensor_drift"), powers, Rule()) == 1


def test_a_large_gain_counts_that_brings_believed_parameters_back_to_their_tolerances() -> None:
    powers = [LOUDER, {"x": 2.3, "i": 1.0}, {"x": 2.2, "i": 1.0}]

    def taken(gain: float, before: tuple[float, ...], after: tuple[float, ...]) -> int:
        two = stages(1000.0, gain)
        two[1].base, two[1].best.fit = at(*before), at(*after)
        return n_accepted(two, powers, Rule())

    assert taken(130.0, (-29.9, 3.0), (0.0, 1.5)) == 2
    assert taken(90.0, (-29.9, 3.0), (0.0, 1.5)) == 1, "small"
    assert taken(130.0, (-29.9, 3.0), (-20.0, 1.5)) == 1, "not back"
    assert taken(130.0, (3.9, 3.0), (0.0, 1.5)) == 1, "were within"


def searched(*refits: tuple[str, float]) -> EffectSearch:
    """A search that has taken all of these effects, each to the noise."""
    found = [SimpleNamespace(best=SimpleNamespace(gain=g, variant=SimpleNamespace(effect=e))) for e, g in refits]
    n = len(refits)
    return EffectSearch((None,) * (n + 1), tuple(found), (LOUD, *[QUIET] * n), n)  # type: ignore[arg-type]


@pytest.mark.parametrize(("left", "patchwork"), [(101.0, True), (40.0, False), (None, False)])
def test_several_effects_are_a_patchwork_where_a_function_explains_more_than_the_last_of_them(
    left: float | None, patchwork: bool
) -> None:
    found: list[Any] = [] if left is None else [SimpleNamespace(gain=left)]
    kind: Any = SimpleNamespace(dependences=lambda *_, few, threads: found)
    model: Any = None
    three = searched(("cubic", 992.0), ("film", 137.0), ("tilt", 42.7))
    assert _compensating(kind, three, model, threads=1) is patchwork
    assert not _compensating(kind, searched(("cubic", 992.0), ("film", 137.0)), model, threads=1)
    assert not _compensating(kind, searched(("cubic", 992.0)), model, threads=1)
    ornament = searched(("cubic", 992.0), ("film", 20.0))
    assert not _compensating(kind, ornament, model, threads=1), "the first does alone"
    loud = replace(ornament, excesses=(LOUDER, LOUD, QUIET))
    assert _compensating(kind, loud, model, threads=1) is (left is not None)


@pytest.mark.parametrize(
    ("last", "left", "kept"),
    [(29.0, {2: 40.0}, 2), (31.0, {2: 40.0}, 1), (29.0, {2: 1001.0}, 1)],
    ids=["next to nothing", "more than that", "and so without it"],
)
def test_of_a_patchwork_last_effects_that_bring_next_to_nothing_go_alone(
    last: float, left: dict[int, float], kept: int
) -> None:
    three = searched(("cubic", 992.0), ("loop", 1000.0), ("hum", last))
    three = replace(three, fits=(0, 1, 2, 3), excesses=(LOUDER, LOUD, QUIET, QUIET))  # type: ignore[arg-type]
    kind: Any = SimpleNamespace(
        dependences=lambda fit, model, few, threads: [SimpleNamespace(gain=left.get(fit, 45.0))]
    )
    models: Any = [None] * 4
    assert _compensating(kind, three, None, threads=1)  # type: ignore[arg-type]
    assert _without_patches(kind, three, models, threads=1).taken == kept


def test_an_effect_does_alone_what_one_behind_it_brings_next_to_nothing_to() -> None:
    assert does_alone(stages(9850.0, 36.8), [LOUD, QUIET, QUIET])
    assert does_alone(stages(9850.0, 36.8, 500.0), [LOUD, QUIET, QUIET]), "the third is not taken"
    assert not does_alone(stages(9850.0, 36.8, 500.0), [LOUD, QUIET, QUIET, QUIET])
    assert not does_alone(stages(9850.0, 36.8, 30.0), [LOUD, QUIET, QUIET, QUIET]), "two may stand for one"
    assert not does_alone(stages(992.0, 36.8), [LOUD, QUIET, QUIET])
    assert not does_alone(stages(9850.0, 36.8), [LOUDER, LOUD, QUIET])
    assert not does_alone(stages(None), [LOUD])


def test_a_drift_is_of_each_run_s_own_so_held_out_runs_do_not_speak_against_it() -> None:
    named, notes = _named(NOT_ASKED, searched(("sensor_drift", 6000.0)), [-500.0])
    assert named.taken == 1
    assert "each run's own" in notes[0]
    named, notes = _named(NOT_ASKED, searched(("squeeze_film", 6000.0)), [-500.0])
    assert named.taken == 0
    assert "makes held-out runs worse" in notes[0]


@pytest.mark.parametrize(("predicted", "named"), [(7.5, 2), (-9.0, 2), (-11.0, 1)])
def test_what_held_out_runs_lose_by_the_fit_s_uncertainty_refuses_no_name(predicted: float, named: int) -> None:
    """At a resonance that the fit runs pass by, numbers as fitted lose more than their effect brings."""
    found = searched(("time_delay", 21435.0), ("early_saturation", 849.0))
    told, notes = _named(predicting(predicted), found, [15545.0, -59.0])
    assert told.taken == named
    assert ("lose 59 nats" in notes[0] and f"{predicted:+.3g}" in notes[0]) == (named == 2)
    loud = replace(found, excesses=(LOUDER, {"x": 2.8, "i": 1.0}, {"x": 2.0, "i": 1.0}))
    more = _named(predicting(predicted), loud, [15545.0, -59.0])[0].taken
    assert more == (2 if predicted > 0 else 1), "beside more than noise they have to become better"


@pytest.mark.parametrize(("lost", "named"), [(7928.0, 1), (390.0, 2)])
def test_what_a_further_effect_costs_many_times_over_no_uncertainty_of_its_own_excuses(lost: float, named: int) -> None:
    """What is left of friction whose rise near standstill is hardly told looks like a slow force for a while."""
    found = searched(("coulomb_friction", 9844.0), ("periodic_disturbance", 39.9))
    told, notes = _named(predicting(367.0), found, [56688.0, -lost])
    assert told.taken == named
    assert ("makes held-out runs worse" in notes[0]) == (named == 1)
    first = searched(("structural_mode", 39.9))
    assert _named(predicting(367.0), first, [-lost])[0].taken == 1, "of the first the uncertainty is its own"


@pytest.mark.parametrize("effect", ["sensor_drift", "squeeze_film"])
def test_no_effect_may_leave_a_fifth_of_the_excess_power(effect: str) -> None:
    left = {"x": 4.2, "i": 2.0}
    found = replace(searched((effect, 1385.0)), excesses=(LOUDER, left))
    assert _named(NOT_ASKED, found, [100.0])[0].taken == 0


def followed(rms: float) -> PredictionError:
    return PredictionError("sweep", "held-out", "position_m", rms, rms / 1e-5, 5e-8, 1000, 1e-5)


def test_the_gain_on_held_out_runs_counts_nothing_below_the_noise() -> None:
    assert log_likelihood_gain([followed(1e-7)], [followed(5e-8)]) == pytest.approx(1000 * np.log(2))
    assert log_likelihood_gain([followed(4.9e-8)], [followed(4e-8)]) == 0
    assert log_likelihood_gain([followed(1e-7)], [followed(np.inf)]) == -np.inf


def fitted(truth: np.ndarray, *, columns: np.ndarray) -> Any:
    """The most probable believed parameters under unit priors, data = columns truth, no noise."""
    precision = columns.T @ columns + np.eye(truth.size)
    z = np.linalg.solve(precision, columns.T @ (columns @ truth))
    names = (("mass", 0.01), ("voltage_gain_1", 0.01), ("voltage_gain_2", 0.01))
    return SimpleNamespace(unknowns=SimpleNamespace(believed=names), precision=precision, z=z)


def test_an_instrument_that_explains_as_much_as_an_effect_is_its_partner() -> None:
    """Both voltages eight tolerances off, known to a quarter of one: 58 nats of the 64 squares of each go away where
    they may be as far off, less the logarithm of the wider prior."""
    base = fitted(np.array([0.0, -8.0, -8.0]), columns=4 * np.eye(3))
    assert gauges(base, 50.0) == ("voltage_gain",)
    assert gauges(base, 80.0) == ()
    assert gauges(fitted(np.zeros(3), columns=4 * np.eye(3)), 50.0) == ()


def test_a_wider_prior_gains_what_two_normal_distributions_differ_by() -> None:
    """By integrating likelihood times prior over the parameter."""
    z, told = -1.5, 9.0
    mean = (told + 1) / told * z
    at = np.linspace(-80, 80, 400_001)
    like = np.exp(-told * (at - mean) ** 2 / 2)
    narrow = np.trapezoid(like * np.exp(-(at**2) / 2), at)
    wide = np.trapezoid(like * np.exp(-((at / RELAXED) ** 2) / 2) / RELAXED, at)
    found = _relaxed_gain(np.array([[1 / (told + 1)]]), np.array([z]))
    assert found == pytest.approx(np.log(wide / narrow), rel=1e-6)


def error_signal(values: np.ndarray) -> ErrorSignal:
    return ErrorSignal("sweep", "held-out", "position_m", values, deviation=1.0, floor=1.0, rate=1e3)


def test_held_out_blocks_speak_against_what_is_worse_all_over_and_not_against_chance() -> None:
    chance = np.random.default_rng(4)
    noise = chance.standard_normal(4000)
    before = [error_signal(noise)]
    assert held_out_worse(before, [error_signal(1.05 * noise)])
    assert not held_out_worse(before, [error_signal(0.95 * noise)])
    assert not held_out_worse(before, [error_signal(noise + 0.01 * chance.standard_normal(4000))])
    lost = noise.copy()
    lost[7] = np.nan
    assert held_out_worse(before, [error_signal(lost)])


def test_a_further_name_has_to_be_confirmed_where_a_first_one_need_only_not_be_refuted() -> None:
    """Worse in the one block where a sweep meets a resonance: chance by the blocks' scatter, yet no confirmation."""
    noise = np.random.default_rng(4).standard_normal(4000)
    at_resonance = noise * np.where(np.arange(4000) // 200 == 7, 1.5, 1.0)
    better, worse = [error_signal(0.9 * noise)], [error_signal(at_resonance)]
    assert held_out_against([[error_signal(noise)], worse]) == [False]
    assert held_out_against([[error_signal(1.2 * noise)], [error_signal(noise)], worse]) == [False, True]
    assert held_out_against([[error_signal(1.2 * noise)], [error_signal(noise)], better]) == [False, False]


@pytest.mark.parametrize(("gain", "own"), [(390.0, False), (410.0, True)])
def test_what_deviates_from_the_form_of_an_effect_is_no_cause_beside_it_unless_it_is_large(
    gain: float, own: bool
) -> None:
    """Mutual flux that goes with the position a little, a delay beside a drive's pole; beside another effect the same
    is a cause."""

    def stage(*refits: tuple[str, float]) -> SearchStage:
        found = [SimpleNamespace(gain=g, variant=SimpleNamespace(effect=e)) for e, g in refits]
        return SearchStage(None, (), tuple(found))  # type: ignore[arg-type]

    for first, other in (("mutual_inductance", "cross_coupling"), ("amplifier_bandwidth", "time_delay")):
        later = stage((other, gain), ("squeeze_film", 30.0))
        for before, counts in ((first, own), ("armature_tilt", True)):
            worse = stage((other, -2.0))
            assert of_its_own(worse, [stage(("armature_tilt", 4000.0))]).refits == worse.refits
            left = of_its_own(later, [stage((before, 4000.0))]).refits
            assert [one.variant.effect for one in left] == ([other] if counts else []) + ["squeeze_film"]


def test_a_refit_that_will_be_the_deviation_of_a_form_at_most_is_not_led_to_its_end() -> None:
    """A delay beside a pole has to bring more than remanence beside hysteresis, whose loops a model nearly follows."""

    def found(effect: str, gain: float, reach: float) -> Any:
        return SimpleNamespace(gain=gain, reach=reach, variant=Variant(effect, (EffectUnknown(effect, "any"),)))

    for first, effect, least in (
        ("amplifier_bandwidth", "time_delay", 400.0),
        ("magnetic_hysteresis", "remanent_flux", 40.0),
        ("magnetic_hysteresis", "sensor_drift", 40.0),
        ("magnetic_hysteresis", "squeeze_film", Rule().further),
    ):
        before = [SearchStage(None, (), (found(first, 4000.0, 4000.0),))]  # type: ignore[arg-type]
        for reach, hopeless in ((least - 1.0, True), (least + 1.0, False)):
            refit = found(effect, reach - 5.0, reach)
            assert Rule().out_of_reach(before, refit, {}) is hopeless
            reached = SearchStage(None, (), (found(effect, reach, reach),))  # type: ignore[arg-type]
            assert (not of_its_own(reached, before).refits) == (hopeless and effect != "squeeze_film")


def test_where_a_zero_wanders_the_other_channels_confirm() -> None:
    """A drift of 30 times the noise: a change of the size of the noise that meets its path makes the reading worse."""
    chance = np.random.default_rng(3)
    current = replace(error_signal(chance.standard_normal(4000)), channel="current_1_A")
    drift = 30.0 * np.sin(np.linspace(0.0, 3.0, 4000))
    worse = [error_signal(drift + 1.0), replace(current, values=0.99 * current.values)]
    models = [[error_signal(drift), current], [error_signal(drift), current], worse]
    for first, channel, against in (("squeeze_film", "", True), ("sensor_drift", "position_m", False)):
        two = searched((first, 900.0), ("armature_tilt", 60.0))
        final = followed_whole(channel)
        gains, told = _held_out(models, replace(two, fits=(*two.fits[:-1], final)))
        assert told == [False, against]
        assert (gains[1] < 0) == against
    wandering = searched(("armature_tilt", 900.0), ("sensor_drift", 60.0))
    final = followed_whole("position_m")
    assert _held_out(models, replace(wandering, fits=(*wandering.fits[:-1], final)))[1] == [False, True]


def followed_whole(wanders: str, *, cut: bool = False) -> Any:
    """A fit of runs from start to end, or over stretches, beside a reading whose zero wanders."""
    return SimpleNamespace(unknowns=SimpleNamespace(wanders=wanders), likelihood=SimpleNamespace(is_cut=cut))


@pytest.mark.parametrize(("cut", "drift", "refuses"), [(True, 31660.0, False), (True, 506.0, True), (False, 9e3, True)])
def test_where_a_wander_tells_the_starts_of_stretches_no_channel_refuses_another_name(
    cut: bool, drift: float, refuses: bool
) -> None:
    """A sensor's lag of 3046 nats beside a drift: a current that the wrong starts move errs by 1 % more."""
    chance = np.random.default_rng(3)
    current = replace(error_signal(chance.standard_normal(4000)), channel="current_1_A")
    position = error_signal(30.0 * np.sin(np.linspace(0.0, 3.0, 4000)))
    models = [[position, current], [position, current], [position, replace(current, values=1.02 * current.values)]]
    two = searched(("sensor_drift", drift), ("position_sensor_lag", 3046.0))
    final = followed_whole("position_m", cut=cut)
    found = replace(two, fits=(*two.fits[:-1], final))
    gains, against = _held_out(models, found)
    assert against == [False, refuses]
    assert gains[1] < -WORSE, "what is told is what they lose"
    told = _about_starts(found, gains)
    assert [f"with position_sensor_lag held-out runs lose {-gains[1]:.3g} nats" in note for note in told] == (
        [] if refuses else [True]
    )


def test_the_main_cause_takes_most_of_the_excess_whatever_else_is_left() -> None:
    left = {"x": 4.0, "i": 1.0}  # 15 of the excess power of 102
    found = replace(searched(("squeeze_film", 6000.0)), excesses=(LOUDER, left))
    main = main_cause(found, [False])
    assert main is not None
    assert (main.effect, main.explained_power) == ("squeeze_film", pytest.approx(1 - 15 / 102))
    assert main.rest == pytest.approx(15 / 102)
    assert main_cause(found, [True]) is None, "held-out data speak against it"
    assert main_cause(replace(found, excesses=(LOUDER, {"x": 8.0, "i": 1.0})), [False]) is None


def is_in_sight(effect: str, told: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> bool:
    """Whether a stage keeps a refit of such estimates; else the one behind it is its best."""
    monkeypatch.setattr(decision, "effect_estimates", lambda fit: {effect: told})
    refit: Any = Refit(SimpleNamespace(effect=effect), None, 60_000.0)  # type: ignore[arg-type]
    other: Any = Refit(SimpleNamespace(effect="time_delay"), None, 34_000.0)  # type: ignore[arg-type]
    stage = SearchStage(None, (), (refit, other))  # type: ignore[arg-type]
    problem: Any = SimpleNamespace(plant=SimpleNamespace(rate=1e4))
    best = in_sight(problem, stage).best
    assert best in (refit, other)
    return best is refit


@pytest.mark.parametrize(
    ("share", "frequency", "kept"), [(0.01, 900.0, True), (0.01, 4500.0, False), (1e-7, 900.0, False)]
)
def test_a_mode_without_mass_or_out_of_sight_is_no_cause(
    share: float, frequency: float, kept: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    mode = {"mass_share": SimpleNamespace(value=share), "frequency": SimpleNamespace(value=frequency)}
    assert is_in_sight("structural_mode", mode, monkeypatch) is kept


@pytest.mark.parametrize(
    ("heating", "kept"),
    [({"rise_per_joule": 1e-4, "initial_rise": 0.1}, True), ({"rise_per_joule": 0.0, "initial_rise": 0.1}, False),
     ({"rise_per_joule": 0.0}, True), ({"initial_rise": 0.1}, True)],
    ids=["heated", "warm", "its heat alone", "its begin alone"],
)  # fmt: skip
def test_a_coil_that_begins_warm_and_nothing_heats_has_a_history(
    heating: dict[str, float], kept: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Which makes the same of its resistance."""
    told = {name: SimpleNamespace(value=low, low=low) for name, low in heating.items()}
    assert is_in_sight("coil_heating", told, monkeypatch) is kept


@pytest.mark.parametrize(("lost", "kept"), [(0.13, True), (1e-3, False)])
def test_a_limit_beyond_which_next_to_nothing_is_lost_is_none(
    lost: float, kept: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    limit = {"lost_share": SimpleNamespace(value=lost), "limit": SimpleNamespace(value=8.0)}
    assert is_in_sight("drive_limit", limit, monkeypatch) is kept


def test_a_refit_whose_next_step_promises_much_is_not_given_up_for_a_tolerance(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(decision, "leaves_tolerance", lambda *_, share: False)
    for promised, given_up in ((413.0, False), (20.0, True)):
        refit: Any = SimpleNamespace(
            fit=SimpleNamespace(predicted=promised), gain=926.8, variant=SimpleNamespace(effect="x")
        )
        problem: Any = None
        assert stays_within(problem, refit) is given_up


@pytest.mark.parametrize(("drive", "told"), [("voltage", 0.06), ("current", 0.03)])
def test_remanence_is_compared_with_a_zero_in_the_units_of_the_commands(drive: str, told: float) -> None:
    """30 mA in a coil of 2 ohm are 60 mV of a voltage's zero."""
    code = {"voltage": VOLTAGE_DRIVE, "current": CURRENT_DRIVE}[drive]
    plant = SimpleNamespace(drive=code, resistance=2.0, nominal_gap=1e-3)
    problem: Any = SimpleNamespace(plant=SimpleNamespace(parameters=plant))
    assert _relative(problem, EffectUnknown("remanent_flux", "current_1"), 0.03) == pytest.approx(told)
