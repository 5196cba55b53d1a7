"""The candidate in front is led to its end: once more from the belief, and in legs while they bring something."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from msl_fem.diagnosis.fit import FIRST_LOOK
from msl_fem.diagnosis.fit_memory import FitMemory
from msl_fem.diagnosis.likelihood import Columns, Fit
from msl_fem.diagnosis.problem import Points
from msl_fem.diagnosis.refinement import MORE_LEGS, SIZES, Refinement, _at_its_end, _is_behind, _may_lead
from msl_fem.diagnosis.refits import CATCHING_UP, RACED_STEPS, SCREENING_STEPS, Refit
from msl_fem.diagnosis.screening import Screening
from msl_fem.diagnosis.unknowns import EffectUnknown, Unknowns
from msl_fem.diagnosis.variants import Variant


class Sizes:
    """A likelihood that is highest where the last number is `SUITS`."""

    is_cut, threads, threads_here = False, 1, 1

    def gathering(self, meeting: object) -> "Sizes":
        return self

    def spectra(self, points: Points) -> np.ndarray:
        return 100 * (points.rows[:, -1:] - SUITS)

    def weights(self, residual: np.ndarray, unknowns: Unknowns) -> SimpleNamespace:
        return SimpleNamespace(nats=float(residual @ residual))

    def excess(self, found: Fit) -> dict[str, float]:
        return {"position_m": 4.0}


SUITS = 0.6
FRICTION = Variant("coulomb_friction", (EffectUnknown("coulomb_friction", "force"),))
UNKNOWNS = Unknowns((("moving_mass", 0.01), ("damping", 0.2)), 0, ())
BASE = Fit(
    UNKNOWNS,
    np.zeros(2),
    np.zeros(1),
    Columns(np.zeros((1, 2)), np.zeros((2, 2))),
    None,
    0.0,
    0.0,
    0.0,
    1,
    Sizes(),
)


def refit(z: list[float], gain: float, promised: float = 50.0) -> Refit:
    """A candidate at numbers of mass, damping and friction."""
    likelihood = Sizes()
    unknowns = replace(UNKNOWNS, effects=FRICTION.unknowns)
    numbers = (np.array(z), np.zeros(1), Columns(np.zeros((1, 3)), np.zeros((3, 3))), None, -gain, gain, promised, 1)
    return Refit(FRICTION, Fit(unknowns, *numbers, likelihood), gain)


@pytest.fixture
def fits(monkeypatch) -> list[np.ndarray]:
    """Where fits began: one from a strained mass gains a hundred nats, one from the belief comes to 5000 at once."""
    begun: list[np.ndarray] = []

    def fitted(self: Refinement, near: Fit, variant: Variant, z: np.ndarray, *rest: object) -> Refit:
        begun.append(z)
        if abs(z[0]) > 1:
            return refit(list(z), -near.objective + 100.0, near.predicted)
        return refit([0.1, 0.1, z[2]], 5000.0)

    monkeypatch.setattr(Refinement, "_refit", fitted)
    return begun


def led(z: list[float], *, leads: bool) -> Refit:
    return Refinement(BASE, lambda text: None, FitMemory()).converged(refit(z, 1000.0), leads=leads)


def test_a_strained_leader_begins_once_more_where_all_else_is_as_believed(fits) -> None:
    found = led([9.0, 5.0, 0.3], leads=True)
    assert found.gain == 5000.0
    assert found.fit.finished
    assert fits[0][:2].tolist() == [0.0, 0.0]
    nearest = np.abs(np.append(0.3 * SIZES, 0.3) - SUITS).min()
    assert abs(fits[0][2] - SUITS) == pytest.approx(nearest), "with the size of its amount that suits the belief"


def test_a_leader_goes_on_while_it_gains_and_others_take_one_leg(fits) -> None:
    led([3.0, 2.0, 0.3], leads=True)
    assert len(fits) == 1 + MORE_LEGS
    fits.clear()
    assert led([9.0, 5.0, 0.3], leads=False).gain == 1100.0
    assert len(fits) == 1
    fits.clear()
    Refinement(BASE, lambda text: None, FitMemory()).converged(refit([3.0, 2.0, 0.3], 1000.0, 0.1), leads=True)
    assert len(fits) == 1, "whose next steps promise nothing"


@pytest.mark.parametrize(
    ("how", "gain", "enough"),
    [
        ({"leads": True}, 1e6, 5.0),
        ({"leads": True}, 2e4, 2.0),
        ({"leads": True}, 1e3, 0.5),
        ({"behind": 16.0}, 1e3, 5.0),
        ({"behind": 14.0}, 1e3, 0.5),
        ({"behind": 1600.0}, 1e5, 500.0),
        ({"behind": 1400.0}, 1e5, 5.0),
    ],
)
def test_a_leader_begins_with_new_columns_and_is_led_nearly_to_its_end(
    monkeypatch, how: dict[str, Any], gain: float, enough: float
) -> None:
    """As is, with the columns that it has, one so near behind that what it has left undone may decide."""
    plans: list[Any] = []

    def fitted(self: Refinement, near: Fit, variant: Variant, z: np.ndarray, plan: Any, columns: object) -> Refit:
        plans.append(plan)
        return refit(list(z), gain, 0.0)

    monkeypatch.setattr(Refinement, "_refit", fitted)
    Refinement(BASE, lambda text: None, FitMemory()).converged(refit([0.1, 0.1, 0.3], gain), **how)
    assert [(one.fresh_begin, one.enough) for one in plans] == [("leads" in how, pytest.approx(enough))]


@pytest.mark.parametrize(("left", "most"), [(400.0, 1200.0), (600.0, 600.0)])
def test_what_was_left_to_the_end_may_be_more_than_it_promises(left: float, most: float) -> None:
    """Of 1e5 nats 500 are left to it; what goes on while it promises more has shown what comes of that."""
    assert _at_its_end(refit([0.1, 0.1, 0.3], 1e5, left)) == pytest.approx(1e5 + most)


def test_the_better_of_both_is_kept(fits, monkeypatch) -> None:
    monkeypatch.setattr("msl_fem.diagnosis.refinement.MORE_LEGS", 0)
    begin = refit([9.0, 5.0, 0.3], 6000.0)
    assert Refinement(BASE, lambda text: None, FitMemory()).converged(begin, leads=True).gain == 6100.0


@pytest.mark.parametrize("lost", [True, False])
@pytest.mark.parametrize("leaves_noise", [True, False])
def test_beside_a_lost_model_the_leader_s_other_forms_are_led_to_their_ends_too(
    monkeypatch, lost: bool, leaves_noise: bool
) -> None:
    """But where it leaves noise alone."""
    near = SimpleNamespace(jacobian=np.zeros((1, 1)), sane=None, unknowns=SimpleNamespace(n_nuisance=1))
    base: Any = SimpleNamespace(sane=near, unknowns=near.unknowns) if lost else near
    force, slip, mode = (
        SimpleNamespace(gain=gain, variant=SimpleNamespace(effect=effect))
        for gain, effect in ((3.0, "coulomb_friction"), (2.0, "coulomb_friction"), (2.5, "structural_mode"))
    )
    monkeypatch.setattr("msl_fem.diagnosis.refinement.leaves_noise", lambda one: leaves_noise)
    forms = Refinement(base, lambda text: None, FitMemory())._other_forms(force, [mode, slip])  # type: ignore[arg-type, list-item]
    assert forms == ([slip] if lost and not leaves_noise else [])


@pytest.mark.parametrize(
    ("before", "left", "led"), [(9.0, 2.0, [999.0, 998.0]), (9.0, 1.0, [998.0]), (1.0, 1.0, [999.0, 998.0])]
)
def test_beside_a_leader_that_leaves_noise_no_other_form_of_its_effect_is_led_to_its_end(
    monkeypatch, before: float, left: float, led: list[float]
) -> None:
    """Eddy currents with a form that is their own but for a number took as long again, to the same end. Where no more
    than noise is left before, that tells nothing: a fringing of 136 nats led with 80."""
    converged: list[float] = []
    mode = Variant("structural_mode", FRICTION.amounts)
    every = iter([(FRICTION, 1000.0), (FRICTION, 999.0), (mode, 998.0)])

    def screened(self: Refinement, score: Any) -> Refit:
        variant, gain = next(every)
        return replace(refit([0.1, 0.1, 0.1], gain, 0.0), variant=variant)

    def ended(self: Refinement, one: Refit, **how: object) -> Refit:
        converged.append(one.gain)
        return one

    monkeypatch.setattr(Refinement, "screened", screened)
    monkeypatch.setattr(Refinement, "screened_on", lambda self, one: one)
    monkeypatch.setattr(Refinement, "_together", lambda self, step, items: [step(item) for item in items])
    monkeypatch.setattr(Refinement, "converged", ended)
    monkeypatch.setattr(Fit, "excess", property(lambda self: {"position_m": left if self.unknowns.effects else before}))
    scores: Any = [SimpleNamespace(gain=1.0, variant=FRICTION)] * 3
    found = Refinement(BASE, lambda text: None, FitMemory()).best_first(scores)
    assert converged == [1000.0, *led]
    assert [one.gain for one in found] == [1000.0, 999.0, 998.0], "it is told as far as it came"


@pytest.mark.parametrize(("promised", "screened_on", "ended"), [(1.0, 0, 0), (50.0, 1, 0), (800.0, 1, 1)])
def test_beside_what_was_led_to_its_end_before_others_go_as_far_as_they_may_still_lead(
    monkeypatch, promised: float, screened_on: int, ended: int
) -> None:
    """Of 1000 nats, with another cause at 60: it ends after a first look, before the race, or is led to its end."""
    seen: list[str] = []

    def step(name: str) -> Any:
        def noted(self: Refinement, one: Refit, **how: object) -> Refit:
            seen.append(name)
            return one

        return noted

    other = replace(refit([0.1, 0.1, 0.1], 60.0, promised), variant=Variant("structural_mode", FRICTION.amounts))
    monkeypatch.setattr(Refinement, "screened", lambda self, score: other)
    monkeypatch.setattr(Refinement, "screened_on", step("on"))
    monkeypatch.setattr(Refinement, "converged", step("end"))
    monkeypatch.setattr(Refinement, "raced", lambda self, kept: kept)
    monkeypatch.setattr(Refinement, "_together", lambda self, step, items: [step(item) for item in items])
    monkeypatch.setattr(Fit, "excess", {"position_m": 2.0})
    score: Any = SimpleNamespace(gain=1.0, variant=other.variant)
    known = refit([0.1, 0.1, 0.1], 1000.0, 0.0)
    found = Refinement(BASE, lambda text: None, FitMemory()).best_first([score], [known])
    assert [one.gain for one in found] == [1000.0, 60.0]
    assert found[0] is known
    assert (seen.count("on"), seen.count("end")) == (screened_on, ended)


def test_what_was_led_before_may_stand_in_for_what_gains_make_up_for(monkeypatch) -> None:
    """As one that leads now: remanence far behind it is begun at the belief, and leads."""
    remanence = Variant("remanent_flux", FRICTION.amounts)
    other = replace(refit([0.1, 0.1, 0.1], 60.0, 0.0), variant=remanence)
    monkeypatch.setattr(Refinement, "screened", lambda self, score: other)
    monkeypatch.setattr(Refinement, "converged", lambda self, one, **how: one)
    monkeypatch.setattr(Refinement, "_stands_in", lambda self, leader: leader is known)
    monkeypatch.setattr(
        Refinement, "from_small_amounts", lambda self, one, *least, by_itself: replace(one, gain=2000.0)
    )
    monkeypatch.setattr(Refinement, "_together", lambda self, step, items: [step(item) for item in items])
    monkeypatch.setattr(Fit, "excess", {"position_m": 2.0})
    known = refit([0.1, 0.1, 0.1], 1000.0, 0.0)
    score: Any = SimpleNamespace(gain=1.0, variant=remanence)
    found = Refinement(BASE, lambda text: None, FitMemory()).best_first([score], [known])
    assert [(one.variant.effect, one.gain) for one in found] == [("remanent_flux", 2000.0), (FRICTION.effect, 1000.0)]


def test_a_candidate_whose_next_step_promises_the_lead_goes_on() -> None:
    """Remanence beside early saturation: 849 nats, 927 after a round that promises 413 more, the leader 1189."""
    before, after = refit([0.1, 0.1, 0.1], 848.9), refit([0.1, 0.1, 0.1], 926.8)
    promises = [replace(after, fit=replace(after.fit, predicted=nats)) for nats in (413.0, 100.0)]
    assert [_may_lead(before, one, 1189.1) for one in promises] == [True, False]
    bent = replace(promises[0], gain=860.0, fit=replace(promises[0].fit, next_step=2.0))
    assert not _may_lead(before, bent, 1189.1), "a promise that damping does not let it keep"
    idle = replace(promises[0], gain=before.gain + 1.0)
    assert not _may_lead(before, idle, 1189.1), "a promise alone is none"


def test_a_candidate_whose_damping_holds_it_back_is_not_promising() -> None:
    one = refit([0.1, 0.1, 0.1], 900.0, 413.0)
    held = replace(one, fit=replace(one.fit, next_step=0.5))
    assert [each.promising for each in (one, held)] == [True, False]
    assert held.fit.to_come(3) == 1.5
    assert replace(one.fit, predicted=-1.0).to_come(3) == 0.0


def test_a_candidate_that_will_not_count_is_not_raced(monkeypatch) -> None:
    one, other = refit([0.1, 0.1, 0.1], 20.0), refit([0.1, 0.1, 0.2], 30.0)
    moved: list[float] = []
    monkeypatch.setattr(Refinement, "refined", lambda self, each: moved.append(each.gain) or each)
    race = Refinement(BASE, lambda text: None, FitMemory(), lambda each: each.gain < 25.0)
    assert {each.gain for each in race.raced([one, other])} == {20.0, 30.0}
    assert moved == [30.0]


def test_a_candidate_that_cannot_come_near_the_best_is_not_raced(monkeypatch: pytest.MonkeyPatch) -> None:
    """Eddy currents of 32 500 nats beside a drive's lag of 77 000: three steps of 1000 nats lead nowhere."""
    leader, behind = refit([0.1, 0.1, 0.1], 77000.0, 1000.0), refit([0.1, 0.1, 0.2], 32500.0, 1000.0)
    nearer = refit([0.1, 0.1, 0.3], 36000.0, 1000.0)
    moved: list[float] = []
    monkeypatch.setattr(Refinement, "refined", lambda self, each: moved.append(each.gain) or each)
    raced = Refinement(BASE, lambda text: None, FitMemory()).raced([leader, behind, nearer])
    assert sorted(each.gain for each in raced) == [32500.0, 36000.0, 77000.0]
    assert moved == [77000.0, 36000.0]
    held = {each.gain: each.fit.columns.values is not None for each in raced}
    assert held == {77000.0: True, 36000.0: False, 32500.0: False}, "what leads keeps its columns"
    assert Refinement(BASE, lambda text: None, FitMemory()).raced([]) == []


@pytest.mark.parametrize(("gain", "beside", "enough"), [(12.0, False, 0.06), (1000.0, False, 0.5), (12.0, True, 0.5)])
def test_a_leader_is_led_as_far_as_what_is_asked_of_it_needs(
    monkeypatch: pytest.MonkeyPatch, gain: float, beside: bool, enough: float
) -> None:
    plans: list[Any] = []

    def fitted(self: Refinement, near: Fit, variant: Variant, z: np.ndarray, plan: Any, columns: object) -> Refit:
        plans.append((plan.enough, near, z))
        return refit(list(z), gain, 0.0)

    monkeypatch.setattr(Refinement, "_refit", fitted)
    base = replace(BASE, unknowns=replace(UNKNOWNS, effects=FRICTION.unknowns)) if beside else BASE
    one = refit([0.1, 0.1, 0.1], gain)
    Refinement(base, lambda text: None, FitMemory()).converged(one, leads=True)
    assert plans[0][0] == pytest.approx(enough)
    assert plans[0][1] is one.fit
    assert plans[0][2] is one.fit.z, "so that it goes on there"


def test_a_leader_that_goes_on_does_so_with_the_columns_it_has(monkeypatch: pytest.MonkeyPatch) -> None:
    taken: list[Any] = []
    made: list[Refit] = []

    def fitted(self: Refinement, near: Fit, variant: Variant, z: np.ndarray, plan: object, columns: Any) -> Refit:
        taken.append(near.columns.values is not None and z is near.z)
        made.append(refit(list(z), -near.objective + 100.0, near.predicted))
        return made[-1]

    monkeypatch.setattr(Refinement, "_refit", fitted)
    led([0.1, 0.1, 0.3], leads=True)
    assert len(taken) == 1 + MORE_LEGS
    assert all(taken)
    assert [one.fit.columns.values is None for one in made] == [*[True] * MORE_LEGS, False], "of the last one alone"


def test_of_a_race_the_best_alone_keeps_its_columns(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is led on with them; of the others each would fill the memory."""
    columns: list[bool] = []
    every = [refit([0.1, 0.1, n / 10], gain, 0.0) for n, gain in enumerate((900.0, 1000.0, 800.0))]
    screened = iter(every)
    monkeypatch.setattr(Refinement, "screened", lambda self, score: next(screened))
    monkeypatch.setattr(Refinement, "screened_on", lambda self, refit: refit)
    monkeypatch.setattr(Refinement, "_together", lambda self, step, items: [step(item) for item in items])

    def converged(self: Refinement, one: Refit, *, leads: bool) -> Refit:
        columns.extend(each.fit.columns.values is not None for each in every)
        return one

    monkeypatch.setattr(Refinement, "converged", converged)
    scores: Any = [SimpleNamespace(gain=1.0, variant=FRICTION)] * 3
    Refinement(BASE, lambda text: None, FitMemory()).best_first(scores)
    assert columns[:3] == [False, True, False]


EDDIES = [
    Variant(
        "eddy_currents",
        (EffectUnknown("eddy_currents", "time_constant"),),
        (EffectUnknown("eddy_currents", "diffusion_time", centre=centre, width=1.0),),
    )
    for centre in (0.1, 1.0, 10.0)
]


@pytest.mark.parametrize(("strains", "left", "tried"), [(9.0, 4.0, 2), (0.0, 4.0, 0), (9.0, 1.0, 0)])
def test_a_leader_that_leaves_more_than_noise_is_begun_at_other_shapes(
    monkeypatch, strains: float, left: float, tried: int
) -> None:
    """Where the model without it is bent: here one of them leaves noise alone, and leads."""
    begun: list[float] = []

    def of(variant: Variant, gain: float, excess: float) -> Refit:
        fit = replace(refit([0.0, 0.0, 0.3, 0.0], gain, 0.0).fit, unknowns=replace(UNKNOWNS, effects=variant.unknowns))
        fit.__dict__["excess"] = {"position_m": excess}
        return Refit(variant, fit, gain)

    def as_believed(self: Refinement, near: Refit, variant: Variant, plan: object) -> Refit:
        begun.append(variant.shapes[0].centre)
        return of(variant, 9000.0, 1.05) if variant is EDDIES[2] else of(variant, 2000.0, 3.0)

    monkeypatch.setattr(Refinement, "_as_believed", as_believed)
    monkeypatch.setattr(Refinement, "_on", lambda self, one: pytest.fail("one leaves noise alone"))
    monkeypatch.setattr(Refinement, "converged", lambda self, one, leads: one)
    base = replace(BASE, z=np.array([strains, 0.0]))
    race = Refinement(base, lambda text: None, FitMemory(), variants=(*EDDIES, FRICTION))
    found = race._of_other_shapes(of(EDDIES[0], 5000.0, left))
    assert sorted(begun) == [1.0, 10.0][:tried]
    assert found.variant is (EDDIES[2] if tried else EDDIES[0])


def test_where_no_amount_goes_with_a_shape_the_leader_stays(monkeypatch) -> None:
    slide = [
        Variant(FRICTION.effect, FRICTION.amounts, (EffectUnknown(FRICTION.effect, "presliding", at, 1.0),))
        for at in (1e-6, 1e-5)
    ]
    leader = replace(refit([0.0, 0.0, 0.3], 5000.0), variant=slide[0])
    leader.fit.__dict__["excess"] = {"position_m": 4.0}
    race = Refinement(replace(BASE, z=np.array([9.0, 0.0])), lambda text: None, FitMemory(), variants=slide)
    assert race._of_other_shapes(leader) is leader


def test_a_leader_that_leaves_more_than_noise_goes_on_for_nats_that_are_little_of_its_gain(fits) -> None:
    """Each leg brings 100 nats of 300 000, and promises 50."""
    leader = replace(refit([9.0, 0.0, 0.3], 3e5), variant=EDDIES[0])
    leader.fit.__dict__["excess"] = {"position_m": 4.0}
    race = Refinement(replace(BASE, z=np.array([9.0, 0.0])), lambda text: None, FitMemory(), variants=EDDIES)
    assert leader.enough > 50.0
    found = race._to_the_end(leader)
    assert len(fits) == MORE_LEGS
    assert found.gain > leader.gain
    fits.clear()
    leader.fit.__dict__["excess"] = {"position_m": 1.0}
    assert race._to_the_end(leader) is leader
    assert not fits


def test_while_candidates_are_screened_those_far_behind_let_their_columns_go() -> None:
    """As soon as another one is far ahead; where none gains anything, all keep them."""
    for gains, kept in ([(100.0, 20.0, 40.0), (True, False, True)], [(-1.0, -9.0), (True, True)]):
        screening = Screening(lambda text: None, len(gains), "screening", _is_behind)
        every = [screening.ends(FRICTION, refit([0.0, 0.0, 0.3], gain)) for gain in gains]
        assert [one is not None and one.fit.columns.values is not None for one in every] == list(kept)


@pytest.mark.parametrize(
    ("gains", "promised", "hopeless", "further"),
    [
        ([1000.0, 90.0, 90.0], [0.1, 1.0, 5.0], (), [0, 2]),  # the second stays below a tenth of the best
        ([1000.0, 90.0, 500.0], [9.0, 9.0, 9.0], (2,), [0, 1]),
        ([-5.0, -90.0, -1.0], [0.1, 0.1, 0.1], (), [0, 1, 2]),  # which none is where nothing gains
    ],
)
def test_what_is_hopeless_or_far_behind_after_a_first_look_is_screened_no_further(
    monkeypatch, gains: list[float], promised: list[float], hopeless: tuple[int, ...], further: list[int]
) -> None:
    plans: list[Any] = []
    first = [refit([0.1, 0.1, n / 10], gain, more) for n, (gain, more) in enumerate(zip(gains, promised, strict=True))]
    begun = iter(first)

    def fitted(self: Refinement, near: Fit, variant: Variant, z: np.ndarray, plan: Any, columns: object) -> Refit:
        assert columns is not None or (z is near.z and near.columns.values is not None)
        plans.append((round(10 * z[2]), plan.most_steps))
        return next(begun) if plan.most_steps == FIRST_LOOK else refit(list(z), -near.objective, near.predicted)

    monkeypatch.setattr(Refinement, "_refit", fitted)
    monkeypatch.setattr(Refinement, "raced", lambda self, kept: list(kept))
    monkeypatch.setattr(Refinement, "converged", lambda self, one, *, leads: one)
    monkeypatch.setattr(Refinement, "_together", lambda self, step, items: [step(item) for item in items])
    monkeypatch.setattr("msl_fem.diagnosis.refinement.started", lambda near, score, likelihood: np.zeros(3))
    scores: Any = [SimpleNamespace(gain=1.0, variant=FRICTION)] * len(gains)
    hopeless_ones = [first[n] for n in hopeless]
    race = Refinement(BASE, lambda text: None, FitMemory(), lambda one: one in hopeless_ones)
    found = race.best_first(scores)
    went_on = [n for n in further if promised[n] >= 5.0]  # what promises less has been screened
    assert [plan for plan in plans if plan[1] != FIRST_LOOK] == [(n, SCREENING_STEPS - FIRST_LOOK) for n in went_on]
    assert len(found) == len(gains)
    assert all(one.fit.columns.values is None for n, one in enumerate(first) if n not in further)


@pytest.mark.parametrize(
    ("leaves_noise", "bends", "left", "lost", "looked_at"),
    [
        (True, 0.1, 4.0, False, [10.0, 6.0]),
        (False, 0.1, 4.0, False, [10.0, 6.0, 2.0, 1.0]),
        (True, 9.0, 4.0, False, [10.0, 6.0, 2.0, 1.0]),
        (True, 0.1, 1.05, False, [10.0, 6.0, 2.0, 1.0]),
        (True, 0.1, 4.0, True, [10.0, 6.0, 2.0, 1.0]),
    ],
)
def test_beside_one_in_front_that_leaves_noise_and_bends_nothing_no_other_is_looked_at(
    monkeypatch, leaves_noise: bool, bends: float, left: float, lost: bool, looked_at: list[float]
) -> None:
    """Where the base leaves more than noise: else a linear score tells which are better by a little."""
    seen: list[float] = []

    def screened(self: Refinement, score: Any) -> Refit:
        seen.append(score.gain)
        return refit([bends, 0.1, 0.1], 100.0 * score.gain, 0.0)

    monkeypatch.setattr(Refinement, "screened", screened)
    monkeypatch.setattr(Refinement, "screened_on", lambda self, one: one)
    monkeypatch.setattr("msl_fem.diagnosis.refinement.leaves_noise", lambda one: leaves_noise)
    monkeypatch.setattr(Sizes, "excess", lambda self, found: {"position_m": left})
    race = Refinement(replace(BASE), lambda text: None, FitMemory())
    race.lost = lost
    scores: Any = [SimpleNamespace(gain=gain, variant=FRICTION) for gain in (10.0, 6.0, 2.0, 1.0)]
    further, ended = race._screened(scores)
    assert sorted(seen, reverse=True) == looked_at
    assert len(further) + len(ended) == len(looked_at)


@pytest.mark.parametrize(("stands_in", "looked_at"), [(True, [10.0, 1.0, 0.5]), (False, [10.0])])
def test_beside_one_that_may_stand_in_for_what_gains_make_up_for_that_is_looked_at_too(
    monkeypatch, stands_in: bool, looked_at: list[float]
) -> None:
    seen: list[float] = []

    def screened(self: Refinement, score: Any) -> Refit:
        seen.append(score.gain)
        return refit([0.1, 0.1, 0.1], 100.0 * score.gain, 0.0)

    monkeypatch.setattr(Refinement, "screened", screened)
    monkeypatch.setattr(Refinement, "screened_on", lambda self, one: one)
    monkeypatch.setattr(Refinement, "takes_all", lambda self, one: True)
    asked: list[float] = []
    monkeypatch.setattr(Refinement, "_stands_in", lambda self, one: asked.append(one.gain) or stands_in)
    remanence = Variant("remanent_flux", FRICTION.amounts)
    every = ((10.0, FRICTION), (2.0, FRICTION), (1.0, remanence), (0.5, remanence))
    scores: Any = [SimpleNamespace(gain=g, variant=v) for g, v in every]
    Refinement(BASE, lambda text: None, FitMemory())._screened(scores)
    assert seen == looked_at
    assert asked == [1000.0], "once: it simulates"


@pytest.mark.parametrize(
    ("left", "bends", "cut", "takes_all"),
    [
        (-700.0, 0.1, True, True),
        (-600.0, 0.1, True, False),
        (-700.0, 9.0, True, False),
        (-700.0, 0.1, False, False),
    ],
)
def test_a_candidate_may_take_nearly_all_before_it_leaves_noise(
    monkeypatch, left: float, bends: float, cut: bool, takes_all: bool
) -> None:
    """Of 1800 nats above noise, which is at -900, by an instrument that is quieter than stated: 200 or 300 are left."""
    monkeypatch.setattr(Sizes, "nats_of_noise", lambda self, unknowns, z: -900.0, raising=False)
    monkeypatch.setattr(Sizes, "is_cut", cut)
    race = Refinement(replace(BASE, objective=900.0), lambda text: None, FitMemory())
    one = refit([bends, 0.1, 0.1], 100.0)
    assert race.takes_all(replace(one, fit=replace(one.fit, objective=left))) is takes_all


@pytest.mark.parametrize(("takes_all", "running"), [(True, ["near"]), (False, ["far", "near", "other shape"])])
def test_beside_one_that_takes_nearly_all_what_may_come_near_it_goes_on_and_no_other_beginning_of_it(
    monkeypatch, takes_all: bool, running: list[str]
) -> None:
    moved: list[Refit] = []
    monkeypatch.setattr(Refinement, "refined", lambda self, one: moved.append(one) or one)
    monkeypatch.setattr(Refinement, "_together", lambda self, step, items: [step(item) for item in items])
    monkeypatch.setattr(Refinement, "takes_all", lambda self, one: takes_all)
    friction, other = Variant("force_offset", DRIVES["both"].unknowns), Variant("gap_offset", DRIVES["slew"].unknowns)
    every = {
        "leader": refit([0.1, 0.1, 0.3], 1000.0, 2.0),
        "other shape": refit([0.1, 0.1, 0.5], 990.0),
        "near": replace(refit([0.1, 0.1, 0.3], 900.0, 100.0), variant=friction),
        "far": replace(refit([0.1, 0.1, 0.3], 800.0, 20.0), variant=other),
    }
    Refinement(BASE, lambda text: None, FitMemory()).raced(list(every.values()))
    names = {id(one): name for name, one in every.items()}
    assert sorted(names[id(one)] for one in moved) == running


def test_a_promise_counts_as_far_as_the_damping_lets_it_be_kept() -> None:
    """Along a bent valley steps are short."""
    free = refit([0.1, 0.1, 0.3], 50.0, 24.0)
    damped = replace(free, fit=replace(free.fit, next_step=1.3))
    assert free.reach == 50.0 + CATCHING_UP * 24.0
    assert damped.reach == 50.0 + CATCHING_UP * 1.3 * RACED_STEPS


LAG, SLEW = (EffectUnknown("amplifier_bandwidth", name) for name in ("lag", "slew_time"))
DETUNED = EffectUnknown("amplifier_bandwidth", "bandwidth_error")
DRIVES = {name: Variant("amplifier_bandwidth", amounts) for name, amounts in
          {"slew": (SLEW,), "both": (LAG, SLEW), "detuned": (DETUNED,)}.items()}  # fmt: skip
LOST_SHARE = EffectUnknown("drive_limit", "lost_share")
LIMIT, CORNER = (EffectUnknown("drive_limit", name, at, 0.1) for name, at in (("limit", 5.0), ("corner", 0.6)))
DRIVES |= {
    "sharp": Variant("drive_limit", (LOST_SHARE,), (LIMIT,)),
    "smooth": Variant("drive_limit", (LOST_SHARE,), (LIMIT, CORNER)),
    "elsewhere": Variant("drive_limit", (LOST_SHARE,), (replace(LIMIT, centre=7.0), CORNER)),
}


def drive(name: str, z: list[float], gain: float) -> Refit:
    """A candidate of a drive at numbers of mass, damping and its own."""
    variant = DRIVES[name]
    unknowns, n = replace(UNKNOWNS, effects=variant.unknowns), len(z)
    numbers = (np.array(z), np.zeros(1), Columns(np.zeros((1, n)), np.zeros((n, n))), None, -gain, gain, 50.0, 1)
    return Refit(variant, Fit(unknowns, *numbers, Sizes()), gain)


@pytest.mark.parametrize(("comes_to", "kept"), [(9500.0, "both"), (8000.0, "slew")])
@pytest.mark.parametrize("came_to", [8500.0, 8995.0])
def test_a_leader_is_begun_with_further_amounts_where_it_is(monkeypatch, comes_to: float, kept: str, came_to: float):
    """A slew limit leads; beside it the lag has a way that it had not at nothing. Where both came near, it is left."""
    begun: list[list[float]] = []

    def fitted(self: Refinement, near: Fit, variant: Variant, z: np.ndarray, *rest: object) -> Refit:
        begun.append(z.tolist())
        return drive("both", z.tolist(), comes_to)

    monkeypatch.setattr(Refinement, "_refit", fitted)
    monkeypatch.setattr(Refinement, "converged", lambda self, refit, *, leads: refit)
    leader = drive("slew", [0.1, 0.2, 0.3], 9000.0)
    others = [drive("both", [5.0, 5.0, 0.0, 0.9], came_to), drive("detuned", [0.0, 0.0, 1.0], 700.0)]
    found = Refinement(BASE, lambda text: None, FitMemory())._fuller(leader, others)
    if came_to == 8995.0:
        assert (found, begun) == (leader, [])
    else:
        assert begun == [[0.1, 0.2, 0.0, 0.3]]
        assert found.variant == DRIVES[kept]
    assert Refinement(BASE, lambda text: None, FitMemory())._fuller(leader, others[1:]) is leader


@pytest.mark.parametrize(("stuck", "reach"), [(True, 100.0), (False, 100.0 + 50.0 * CATCHING_UP)])
def test_a_candidate_none_of_whose_steps_led_down_comes_no_further(stuck: bool, reach: float) -> None:
    """Whatever it is promised, as beside a mover that sticks."""
    found = refit([0.1, 0.1, 0.1], 100.0)
    assert replace(found, fit=replace(found.fit, stuck=stuck)).reach == reach


def test_the_race_ends_where_one_alone_goes_on_and_leads(fits, monkeypatch) -> None:
    """It is led to its end anyway; one that is behind another goes on."""
    steps: list[float] = []

    def refined(self: Refinement, one: Refit) -> Refit:
        steps.append(one.gain)
        return replace(one, gain=one.gain + 500.0)

    monkeypatch.setattr(Refinement, "refined", refined)
    race = Refinement(BASE, lambda text: None, FitMemory())
    assert race.raced([refit([3.0, 2.0, 0.3], 5000.0)])[0].gain == 5500.0
    assert len(steps) == 1
    steps.clear()
    still = replace(refit([3.0, 2.0, 0.2], 6700.0, 0.1), variant=Variant("structural_mode", ()))
    race.raced([refit([3.0, 2.0, 0.3], 5000.0), still])
    assert steps == [5000.0, 5500.0, 6000.0, 6500.0]


def test_a_leader_is_begun_with_a_further_shape_where_it_is(monkeypatch) -> None:
    """A limit that sets in at once leads, and from there the corner has a way; not where its limit is another one."""
    begun: list[list[float]] = []

    def fitted(self: Refinement, near: Fit, variant: Variant, z: np.ndarray, *rest: object) -> Refit:
        begun.append(z.tolist())
        return drive("smooth", z.tolist(), 12000.0)

    monkeypatch.setattr(Refinement, "_refit", fitted)
    monkeypatch.setattr(Refinement, "converged", lambda self, refit, *, leads: refit)
    leader = drive("sharp", [0.1, 0.2, 0.3, 0.4], 9000.0)
    race = Refinement(BASE, lambda text: None, FitMemory())
    assert race._fuller(leader, [drive("elsewhere", [0.0, 0.0, 0.5, 0.0, 0.0], 8000.0)]) is leader
    found = race._fuller(leader, [drive("smooth", [5.0, 5.0, 0.9, 0.9, 0.9], 8000.0)])
    assert begun == [[0.1, 0.2, 0.3, 0.4, 0.0]]
    assert found.variant == DRIVES["smooth"]
    monkeypatch.setattr(Fit, "excess", {"position_m": 1.0})
    quiet = drive("sharp", [0.1, 0.2, 0.3, 0.4], 9000.0)
    assert race._fuller(quiet, [drive("smooth", [5.0, 5.0, 0.9, 0.9, 0.9], 8000.0)]) is quiet, "it leaves noise alone"
