"""Fits that begin far from what is measured: heated at first, ended where no number says anything, begun anew."""

from dataclasses import dataclass, field, replace
from types import SimpleNamespace

import numpy as np
import pytest

from msl_fem.computing.gauss_newton import descend
from msl_fem.diagnosis import fit as fitting
from msl_fem.diagnosis import runs, scores, search
from msl_fem.diagnosis.fit import SANE, SHORT_WAY, STILL_HOT, FitPlan, beyond_sanity, fit
from msl_fem.diagnosis.fit_memory import FitMemory, fit_name
from msl_fem.diagnosis.likelihood import Columns
from msl_fem.diagnosis.noise import weights_of
from msl_fem.diagnosis.problem import Points
from msl_fem.diagnosis.refinement import NEAR, Refinement
from msl_fem.diagnosis.refits import SMALL, Refit
from msl_fem.diagnosis.runs import Runs
from msl_fem.diagnosis.scores import Score, ScoredVariants
from msl_fem.diagnosis.unknowns import EffectUnknown, Unknowns
from msl_fem.diagnosis.variants import Variant
from msl_fem.errors import ComputationError

CUBIC = Variant("stiffness_nonlinearity", (EffectUnknown("stiffness_nonlinearity", "cubic"),))
UNKNOWNS = Unknowns((("coil_resistance", 0.01), ("position_gain", 0.002)), 0, ())


@dataclass(frozen=True, eq=False)
class CutRecord:
    """A likelihood over stretches: 400 numbers in two halves, `strong` z0 tells the first, and `bent` z0^2 and next to
    nothing of z1 the second; what each round of new starts leaves is `shrinks` times what was left before."""

    data: np.ndarray
    strong: float = 1e3
    bent: float = 1e2
    shrinks: float = 1.0
    visited: list[np.ndarray] = field(default_factory=list)
    followed_at: list[np.ndarray] = field(default_factory=list)
    is_cut, begins, threads, threads_here = True, (), 1, 1
    labels = np.zeros(400, dtype=np.intp)

    def spectra(self, points: Points) -> np.ndarray:
        self.visited.extend(points.rows)
        z = points.rows[:, :2]
        halves = np.stack([self.strong * z[:, 0], self.bent * z[:, 0] ** 2 + 0.5 * z[:, 1]], axis=1)
        return self.data - np.repeat(halves, 200, axis=1)

    def spectra_and_starts(self, points: Points) -> tuple[np.ndarray, tuple[()], float]:
        return self.spectra(points), (), 0.0

    def weights(self, residual: np.ndarray, unknowns: Unknowns):
        return weights_of(residual, self.labels, np.array([100.0]))

    def nats_of_noise(self, unknowns: Unknowns, z: np.ndarray) -> float:
        return 0.0

    def followed(self, unknowns: Unknowns, z: np.ndarray) -> "CutRecord":
        self.followed_at.append(z)
        return replace(self, data=self.shrinks * self.data)

    def objective(self, unknowns: Unknowns, z: np.ndarray) -> float:
        residual = self.spectra(Points.of(unknowns, z[None]))[0]
        return self.weights(residual, unknowns).nats + unknowns.prior(z)[0]


def far() -> CutRecord:
    """Ten tolerances off: 10 000 times the noise."""
    noise = np.random.default_rng(3).standard_normal(400)
    return CutRecord(noise + 1e4)


def test_a_fit_that_begins_far_away_goes_there_without_detours(monkeypatch: pytest.MonkeyPatch) -> None:
    """The half that the first model does not tell would take the second number thousands of tolerances away."""
    record = far()
    found = fit(record, UNKNOWNS, np.zeros(2))  # type: ignore[arg-type]
    assert found.z == pytest.approx([10.0, 0.0], abs=0.2)
    assert found.weights.nats == pytest.approx(record.weights(found.residual, found.unknowns).nats), "the heat is gone"
    assert np.abs([z[1] for z in record.visited]).max() < 50
    assert found.sane is not None
    assert found.sane.z == pytest.approx(found.z)
    monkeypatch.setattr(fitting, "HOT", np.inf)
    cold = far()
    fit(cold, UNKNOWNS, np.zeros(2))  # type: ignore[arg-type]
    assert np.abs([z[1] for z in cold.visited]).max() > 1000


def test_a_fit_that_is_not_to_be_heated_ends_where_it_would_be() -> None:
    record = far()
    found = fit(record, UNKNOWNS, np.zeros(2), plan=FitPlan(heats=False))  # type: ignore[arg-type]
    assert found.sane is not None
    assert np.array_equal(found.z, np.zeros(2))
    assert len(record.followed_at) == 0
    near = CutRecord(far().data - 1e4)
    assert fit(near, UNKNOWNS, np.full(2, 1e-3), plan=FitPlan(heats=False)).sane is None  # type: ignore[arg-type]
    assert near.followed_at


def test_a_round_goes_on_with_the_damping_of_the_one_before(monkeypatch: pytest.MonkeyPatch) -> None:
    first, last = [], iter([10.0, 1e7, 0.0, *[1.0] * 20])

    def noted(objective, point, settings, **more):
        first.append(settings.damping.first)
        return replace(descend(objective, point, settings, **more), damping=next(last), ending="no more steps", steps=1)

    monkeypatch.setattr(fitting, "descend", noted)
    fit(far(), UNKNOWNS, np.zeros(2), plan=FitPlan(most_steps=32))  # type: ignore[arg-type]
    assert first == [1.0, 10.0, 1e2, 1e-2]


def test_a_fit_goes_on_where_one_has_ended_with_what_that_knows() -> None:
    """To the same end as one that begins there with its columns, and nothing is simulated there once more."""
    data = np.concatenate([np.full(200, 3e3), np.repeat([30.0, -30.0], 100)]) + far().data - 1e4
    record = CutRecord(data, bent=30.0)
    begun = fit(record, UNKNOWNS, np.zeros(2), plan=FitPlan(most_steps=1))  # type: ignore[arg-type]
    record.visited.clear()
    on = fit(record, UNKNOWNS, begun.z, plan=FitPlan(fresh_end=False), goes_on=begun)  # type: ignore[arg-type]
    assert not any(np.array_equal(z[:2], begun.z) for z in record.visited)
    columns = begun.jacobian[:, :2]
    anew = fit(record, UNKNOWNS, begun.z, plan=FitPlan(fresh_end=False), nuisance_columns=columns)  # type: ignore[arg-type]
    assert any(np.array_equal(z[:2], begun.z) for z in record.visited)
    assert np.array_equal(on.z, anew.z)
    assert on.objective < begun.objective


@pytest.mark.parametrize(("steps", "stuck"), [(2, False), (4, True)])
def test_a_first_look_does_not_tell_that_a_fit_is_stuck(steps: int, stuck: bool) -> None:
    """In a narrow valley the first few trials lead up, and with more damping it goes on."""
    record = CutRecord(np.full(400, 3.0), strong=1.0)
    plain = record.spectra_and_starts

    def walled(points: Points) -> tuple[np.ndarray, tuple[()], float]:
        numbers, starts, far_from_them = plain(points)
        beyond = np.any(points.rows[:, :2] > 1e-2, axis=1, keepdims=True)
        return np.where(beyond, 1e3, numbers), starts, far_from_them

    object.__setattr__(record, "spectra_and_starts", walled)
    assert fit(record, UNKNOWNS, np.zeros(2), plan=FitPlan(most_steps=steps)).stuck is stuck  # type: ignore[arg-type]


def test_columns_of_the_very_point_where_a_round_ended_are_kept_for_the_next(monkeypatch: pytest.MonkeyPatch) -> None:
    """A model that is not stale has them; a round ends with such a one, unless it has no more steps."""
    models: list[tuple[str, int, bool]] = []
    plain_model, plain_followed = fitting._FitPosterior._model, CutRecord.followed

    def model(self, point, known: int, *, stale: bool):
        models.append(("model", known, stale))
        return plain_model(self, point, known, stale=stale)

    def followed(self, unknowns: Unknowns, z: np.ndarray) -> CutRecord:
        models.append(("followed", 0, False))
        return plain_followed(self, unknowns, z)

    monkeypatch.setattr(fitting._FitPosterior, "_model", model)
    monkeypatch.setattr(CutRecord, "followed", followed)
    data = np.concatenate([np.full(200, 4.0), np.repeat([9.0, -5.0], 100)])
    fit(CutRecord(data, strong=1.0, bent=1.0, shrinks=0.9), UNKNOWNS, np.zeros(2))  # type: ignore[arg-type]
    ends = [n for n, (what, *_) in enumerate(models[:-1]) if what == "followed"]
    fresh = [n for n in ends if not models[n - 1][2]]
    assert fresh
    assert [models[n + 1][1:] for n in fresh] == [(2, False)] * len(fresh)
    assert all(models[n + 1][1:] in {(0, False), (2, True)} for n in ends if n not in fresh)


def test_beside_what_a_missing_cause_costs_the_last_nats_are_left() -> None:
    data = np.concatenate([np.full(200, 4.0), np.repeat([9.0, -5.0], 100)])
    record = CutRecord(data, strong=1.0, bent=1.0)
    whole = fit(record, UNKNOWNS, np.zeros(2))  # type: ignore[arg-type]
    sooner = fit(record, UNKNOWNS, np.zeros(2), plan=FitPlan(share=0.1))  # type: ignore[arg-type]
    assert whole.predicted < 0.05 < sooner.predicted < 0.1 * sooner.objective
    assert sooner.simulations < whole.simulations


@pytest.mark.parametrize(
    ("off", "still_hot", "rounds"),
    [(5 * SANE, np.inf, (5, 7)), (0.5 * SANE, np.inf, (14, 14)), (5 * SANE, STILL_HOT, (3, 4)), (8.0, 10.0, (14, 14))],
)
def test_a_model_beyond_sanity_is_not_followed_for_the_last_nats(
    monkeypatch: pytest.MonkeyPatch, off: float, still_hot: float, rounds: tuple[int, int]
) -> None:
    """Each round of new starts takes 3 % of what is left, which no number explains; where the heat has gone and as
    much is left as that, none is looked at again."""
    monkeypatch.setattr(fitting, "STILL_HOT", still_hot)
    data = np.concatenate([np.full(200, 10 * off), np.repeat([300.0, -300.0], 100)])
    record = CutRecord(data, strong=10.0, bent=0.0, shrinks=0.985)
    fit(record, UNKNOWNS, np.array([off, 0.0]), plan=FitPlan(most_steps=120))  # type: ignore[arg-type]
    assert rounds[0] <= len(record.followed_at) <= rounds[1]


@pytest.mark.parametrize(
    ("off", "heats", "rounds"), [(5.0, False, (1, 1)), (5.0, True, (3, 14)), (0.2, False, (3, 14))]
)
def test_a_fit_without_a_heat_ends_where_it_is_not_back_at_possible_numbers_soon(
    off: float, heats: bool, rounds: tuple[int, int]
) -> None:
    """It is not hot, and each round of new starts brings more than a little."""
    data = np.concatenate([np.full(200, off * SANE), np.repeat([3.0, -3.0], 100)])
    record = CutRecord(data, strong=1.0, bent=0.0, shrinks=0.94)
    plan = FitPlan(most_steps=120, heats=heats)
    found = fit(record, UNKNOWNS, np.array([off * SANE, 0.0]), plan=plan)  # type: ignore[arg-type]
    assert found.sane is None
    assert rounds[0] <= len(record.followed_at) <= rounds[1]
    assert SHORT_WAY == 2, "the starts are moved between two rounds once"


def test_where_a_fit_was_last_at_possible_numbers_is_kept() -> None:
    """It begins at the belief and ends beyond 20 tolerances; heated, its first rounds are within them."""
    record = CutRecord(np.random.default_rng(3).standard_normal(400) + 5e4)
    found = fit(record, UNKNOWNS, np.zeros(2))  # type: ignore[arg-type]
    assert found.z[0] > SANE
    assert found.sane is not None
    assert found.sane.sane is None
    assert np.abs(found.sane.z).max() <= SANE
    assert fit(CutRecord(record.data - 5e4), UNKNOWNS, np.zeros(2)).sane is None  # type: ignore[arg-type]


def test_causes_are_scored_where_the_base_was_last_at_possible_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    """What cannot be simulated there is told."""
    told, at = [], []
    monkeypatch.setattr(fitting.Fit, "excess", {"position_m": 9.0})

    def scored(found: fitting.Fit, tried: object) -> ScoredVariants:
        at.append(found)
        return ScoredVariants(dropped=("coulomb_friction",))

    monkeypatch.setattr(search, "scored", scored)
    near = base_at([1.0, 0.0])
    stage = search.search_stage(base_at([2 * SANE, 0.0], near), [CUBIC], tell=told.append)
    assert at == [near]
    assert stage.base.z[0] == 2 * SANE
    assert any("cannot be simulated here: coulomb_friction" in text for text in told)


def test_only_a_model_without_effects_is_beyond_sanity() -> None:
    assert beyond_sanity(UNKNOWNS, np.array([0.0, -1.1 * SANE]))
    assert not beyond_sanity(UNKNOWNS, np.array([0.9 * SANE, -0.9 * SANE]))
    assert not beyond_sanity(replace(UNKNOWNS, effects=CUBIC.unknowns), np.array([0.0, -2 * SANE, 0.0]))


def test_a_cause_is_dropped_where_none_of_its_variants_can_be_simulated(monkeypatch: pytest.MonkeyPatch) -> None:
    """One whose other variant shows nothing is not: it can be simulated."""
    quadratic = Variant("stiffness_nonlinearity", (EffectUnknown("stiffness_nonlinearity", "quadratic"),))
    friction = Variant("coulomb_friction", (EffectUnknown("coulomb_friction", "force"),))
    columns = {"cubic": np.nan, "quadratic": 0.0, "force": np.nan}

    def signatures(found: fitting.Fit, amounts: list[tuple[EffectUnknown, object]]) -> np.ndarray:
        return np.tile([columns[one.name] for one, _ in amounts], (400, 1))

    monkeypatch.setattr(scores, "signatures", signatures)
    found = fit(far(), UNKNOWNS, np.zeros(2))  # type: ignore[arg-type]
    at = scores.scored(found, [CUBIC, quadratic, friction], null=False)
    assert at.scores == ()
    assert at.dropped == ("coulomb_friction",)


def test_no_stretches_are_chosen_at_a_model_beyond_sanity(monkeypatch: pytest.MonkeyPatch) -> None:
    ended = SimpleNamespace(z=np.array([0.0, 2 * SANE]), likelihood="where it ended", sane="before that")
    monkeypatch.setattr(runs, "fit", lambda *one, **more: ended)
    monkeypatch.setattr(Runs, "renewed", lambda *one: pytest.fail("stretches are chosen anew"))
    monkeypatch.setattr(Runs, "begun", lambda *one: None)
    kind = Runs(None, None, UNKNOWNS, (), None, (), cuts=(SimpleNamespace(),))  # type: ignore[arg-type]
    settled = kind.settled(str)
    assert settled.likelihood == "where it ended"
    assert settled.begin is ended.z
    assert settled.sane == "before that"


@pytest.mark.parametrize(
    ("at", "promised", "renews"), [(2 * SANE, 1e4, False), (2 * SANE, 1.0, True), (1.0, 1e4, True)]
)
def test_a_beginning_that_is_at_no_end_beyond_sanity_leads_nowhere(
    monkeypatch: pytest.MonkeyPatch, at: float, promised: float, renews: bool
) -> None:
    """No stretches are chosen there."""
    ended = SimpleNamespace(z=np.array([at, 0.0]), sane=None, predicted=promised)
    monkeypatch.setattr(runs, "fit", lambda *one, **more: ended)
    monkeypatch.setattr(runs, "map_beside", lambda *one: None)
    monkeypatch.setattr(runs, "_likelihood", lambda *one, **more: (None, UNKNOWNS))
    monkeypatch.setattr(runs, "_loses", lambda *one: False)
    monkeypatch.setattr(Runs, "renewed", lambda self, found: "chosen anew")

    @dataclass(frozen=True)
    class Problem:
        stretches: tuple[object, ...] = ()
        coarse: None = None

    likelihood = SimpleNamespace(problem=Problem(), substeps=1)
    kind = Runs(None, likelihood, UNKNOWNS, (), None, (), "a record")  # type: ignore[arg-type]
    assert kind.begun(str) == ("chosen anew" if renews else None)

    def fails(*one: object, **more: object) -> None:
        raise ComputationError("the simulation fails at the start of the fit")

    monkeypatch.setattr(runs, "fit", fails)
    assert kind.begun(str) is None, "a start may lie where the model leaves its table"


def candidate(z: list[float], gain: float, likelihood: object) -> Refit:
    unknowns = replace(UNKNOWNS, effects=CUBIC.unknowns)
    numbers = (np.array(z), np.zeros(1), Columns(np.zeros((1, 3)), np.zeros((3, 3))), None, -gain, gain, 0.0, 1)
    return Refit(CUBIC, fitting.Fit(unknowns, *numbers, likelihood), gain)


@pytest.fixture
def begun(monkeypatch: pytest.MonkeyPatch) -> list[np.ndarray]:
    """Where candidates began anew; each comes to 5000 nats, to 4000 from an amount above nothing."""
    found: list[np.ndarray] = []

    def fitted(self: Refinement, near, variant: Variant, z: np.ndarray, *rest: object) -> Refit:
        found.append(z)
        return candidate(list(z), 4000.0 if z[-1] > 0 else 5000.0, near.likelihood)

    monkeypatch.setattr(Refinement, "_refit", fitted)
    return found


class Amounts:
    """A likelihood that is highest where an amount is 0.1 below nothing."""

    is_cut, threads, threads_here = False, 1, 1

    def gathering(self, meeting: object) -> "Amounts":
        return self

    def excess(self, found: fitting.Fit) -> dict[str, float]:
        return {"position_m": 9.0}

    def spectra(self, points: Points) -> np.ndarray:
        return (100 * (points.rows[:, -1:] + 0.1)).repeat(2, axis=1)

    def weights(self, residual: np.ndarray, unknowns: Unknowns) -> SimpleNamespace:
        return SimpleNamespace(nats=float(residual @ residual))


def base_at(z: list[float], sane: fitting.Fit | None = None) -> fitting.Fit:
    numbers = (np.array(z), np.zeros(1), Columns(np.zeros((1, 2)), np.zeros((2, 2))), None, 0.0, 0.0, 0.0, 1)
    return fitting.Fit(UNKNOWNS, *numbers, Amounts(), finished=True, sane=sane)


def refinement(base_z: list[float], *, sane: fitting.Fit | None = None) -> Refinement:
    return Refinement(base_at(base_z, sane), str, FitMemory())


def test_a_candidate_begins_at_the_belief_with_the_small_amount_that_suits_it(begun) -> None:
    anew = refinement([2 * SANE, 0.0]).from_small_amounts(candidate([2 * SANE, 9.0, 5.0], 100.0, Amounts()))
    assert anew.gain == 5000.0
    above, below = [0.0, 0.0, SMALL[0]], [0.0, 0.0, -SMALL[1]]
    assert [z.tolist() for z in begun] == [below, above, below], "each sign, and what came furthest goes on"
    better = candidate([2 * SANE, 9.0, 5.0], 6000.0, Amounts())
    assert refinement([2 * SANE, 0.0]).from_small_amounts(better) is better


@pytest.mark.parametrize(("left", "times"), [(1.0, 3), (9.0, 4)])
def test_beside_one_that_leaves_noise_nothing_else_that_began_at_the_belief_goes_on(
    monkeypatch: pytest.MonkeyPatch, left: float, times: int
) -> None:
    """Two signs, and those that may still lead."""
    begun: list[np.ndarray] = []

    def fitted(self: Refinement, near, variant: Variant, z: np.ndarray, plan: FitPlan, columns: object) -> Refit:
        begun.append(z)
        found = candidate(list(z), 4000.0 if z[-1] > 0 else 5000.0, near.likelihood)
        return replace(found, fit=replace(found.fit, predicted=1000.0 if plan.most_steps < 20 else 0.0))

    monkeypatch.setattr(Refinement, "_refit", fitted)
    monkeypatch.setattr(fitting.Fit, "excess", {"position_m": left})
    refinement([2 * SANE, 0.0]).from_small_amounts(candidate([2 * SANE, 9.0, 5.0], 100.0, Amounts()))
    assert len(begun) == times


def test_by_itself_a_candidate_is_begun_with_all_signs_at_the_same_time(begun, monkeypatch) -> None:
    together, counts = Refinement._together, []
    monkeypatch.setattr(
        Refinement, "_together", lambda self, step, items: counts.append(len(items)) or together(self, step, items)
    )
    race = refinement([2 * SANE, 0.0])
    anew = race.from_small_amounts(candidate([2 * SANE, 9.0, 5.0], 100.0, Amounts()), by_itself=True)
    assert anew.gain == 5000.0
    assert counts == [2, 2], "where each is likeliest, and begun there"
    assert sorted(z[-1] for z in begun[:2]) == [-SMALL[1], SMALL[0]]
    assert begun[2][-1] == -SMALL[1]


def test_of_three_amounts_the_four_likeliest_signs_are_tried(begun) -> None:
    """Of eight: each costs a fit, and most come to the same end."""
    amounts = tuple(EffectUnknown("sensor_drift", name) for name in ("offset", "rate", "acceleration"))
    one = candidate([2 * SANE, 9.0, 0.0, 0.0, 5.0], 100.0, Amounts())
    drift = Variant("sensor_drift", amounts)
    fitted = replace(one.fit, unknowns=replace(UNKNOWNS, effects=drift.unknowns))
    refinement([2 * SANE, 0.0]).from_small_amounts(replace(one, variant=drift, fit=fitted), by_itself=True)
    tried = [tuple(np.sign(z[2:])) for z in begun[:4]]
    assert len(set(tried)) == 4
    assert {way[-1] for way in tried} == {-1.0}, "those that go where the record is"
    assert all(np.array_equal(z, begun[0]) or z.tolist() in [a.tolist() for a in begun[:4]] for z in begun)
    begun.clear()
    refinement([2 * SANE, 0.0]).from_small_amounts(replace(one, variant=drift, fit=fitted))
    assert len({tuple(np.sign(z[2:])) for z in begun}) == 2, "beside others"


def test_an_amount_that_is_none_below_nothing_has_one_sign(begun) -> None:
    """With the other one it would begin at nothing."""
    heating = Variant("coil_heating", (EffectUnknown("coil_heating", "rise_per_joule"),))
    assert heating.amounts[0].one_sided
    one = candidate([2 * SANE, 9.0, 5.0], 100.0, Amounts())
    fitted = replace(one.fit, unknowns=replace(UNKNOWNS, effects=heating.unknowns))
    refinement([2 * SANE, 0.0]).from_small_amounts(replace(one, variant=heating, fit=fitted), by_itself=True)
    assert {z[-1] for z in begun} == {SMALL[0]}


@pytest.mark.parametrize(("by_itself", "legs"), [(False, 1), (True, 2)])
def test_beside_others_no_way_is_believed_more_than_one_before_has_kept(monkeypatch, by_itself, legs: int) -> None:
    """Each promises 2000 nats, and the first comes to 50 of them: 5000 are out of reach."""
    gone: list[Refit] = []

    def fitted(self: Refinement, near, variant: Variant, z: np.ndarray, *rest: object) -> Refit:
        found = candidate(list(z), 4000.0, near.likelihood)
        return replace(found, fit=replace(found.fit, predicted=2000.0))

    def on(self: Refinement, one: Refit) -> Refit:
        gone.append(one)
        return replace(one, gain=4050.0, fit=replace(one.fit, predicted=0.0))

    monkeypatch.setattr(Refinement, "_refit", fitted)
    monkeypatch.setattr(Refinement, "_on", on)
    one = candidate([2 * SANE, 9.0, 5.0], 100.0, Amounts())
    refinement([2 * SANE, 0.0]).from_small_amounts(one, least=5000.0, by_itself=by_itself)
    assert len(gone) == legs


@pytest.mark.parametrize("stuck", [True, False])
def test_what_no_step_leads_down_from_goes_no_further(begun, monkeypatch, stuck: bool) -> None:
    """However much the linear model promises there."""
    plain = Refinement._refit

    def stays(self: Refinement, *which: object) -> Refit:
        found = plain(self, *which)  # type: ignore[arg-type]
        return replace(found, gain=-1e7, fit=replace(found.fit, predicted=1e9, stuck=stuck))

    monkeypatch.setattr(Refinement, "_refit", stays)
    refinement([2 * SANE, 0.0]).from_small_amounts(candidate([2 * SANE, 9.0, 5.0], 100.0, Amounts()))
    assert (len(begun) == 2) is stuck, "but the two signs"


@pytest.mark.parametrize(
    ("left", "moved", "told", "begin"),
    [
        (1.0, 0.0, {}, [100.0, 90.0]),
        (9.0, 0.0, {}, [100.0, 90.0, 30.0]),
        (1.0, 9.0, {}, [100.0, 90.0, 30.0]),
        (9.0, 9.0, {"of_part": True}, [100.0, 90.0]),
        (9.0, 0.0, {"ends": {CUBIC: np.zeros(3)}}, [100.0, 90.0, 30.0]),
        (1.0, 0.0, {"ends": {CUBIC: np.zeros(3)}}, []),
    ],
    ids=["all taken", "more than noise", "bent", "nearly all of a part", "known, and more", "known, and all taken"],
)
def test_beside_a_lost_model_what_is_far_behind_one_that_takes_all_does_not_begin_again(
    monkeypatch, left: float, moved: float, told: dict[str, object], begin: list[float]
) -> None:
    """Others go on if they promise to come as far as the one in front has."""
    asked: list[tuple[float, float, bool]] = []

    def anew(self: Refinement, one: Refit, least: float = -np.inf, *, by_itself: bool = False) -> Refit:
        asked.append((one.gain, least, by_itself))
        return replace(one, gain=one.gain + 1.0)

    monkeypatch.setattr(Refinement, "from_small_amounts", anew)
    monkeypatch.setattr(fitting.Fit, "excess", {"position_m": left})
    monkeypatch.setattr(fitting.Fit, "nats_of_noise", -105.0)  # 5 below what the one in front leaves, 105 below all
    base = base_at([2 * SANE, 0.0], base_at([1.0, 0.0]))
    race = Refinement(base, str, FitMemory(), **told)  # type: ignore[arg-type]
    every = [candidate([moved, 0.0, 5.0], gain, Amounts()) for gain in (100.0, 90.0, 30.0)]
    kept, behind = race._lost_from_small_amounts(every)
    assert [one for one, *_ in asked] == begin
    assert [rest for _, *rest in asked] == [[-np.inf, True], *[[101.0 - NEAR, False]] * 2][: len(asked)]
    assert not behind
    assert sorted(one.gain for one in kept) == [30.0 + (30.0 in begin), 90.0 + bool(begin), 100.0 + bool(begin)]
    assert race._lost_from_small_amounts([]) == ([], [])


@pytest.mark.parametrize(
    ("lost", "stuck", "said", "first"),
    [(True, True, 400.0, -5.0), (True, True, 90.0, 100.0), (True, False, 400.0, 100.0), (False, True, 400.0, None)],
    ids=["says more", "says less", "went on", "not lost"],
)
def test_beside_a_lost_model_what_could_not_move_begins_anew_where_the_linear_model_says_more_of_it(
    monkeypatch: pytest.MonkeyPatch, lost: bool, stuck: bool, said: float, first: float | None
) -> None:
    """Heating on a levitator, the linear model's best: no way from its beginning could be simulated, and a disturbance,
    a heating of what that left and a force had its place."""
    begun: list[tuple[float, bool]] = []

    def anew(self: Refinement, one: Refit, least: float = -np.inf, *, by_itself: bool = False) -> Refit:
        begun.append((one.gain, by_itself))
        return replace(one, gain=one.gain + 1000.0)

    best, still = candidate([0.0, 0.0, 5.0], 100.0, Amounts()), candidate([0.0, 0.0, 1.0], -5.0, Amounts())
    film = Variant("squeeze_film", (EffectUnknown("squeeze_film", "damping"),))
    unknowns = replace(UNKNOWNS, effects=film.unknowns)
    still = replace(still, variant=film, fit=replace(still.fit, stuck=stuck, unknowns=unknowns))
    monkeypatch.setattr(Refinement, "_screened", lambda self, scores, led: ([best, still], []))
    monkeypatch.setattr(Refinement, "from_small_amounts", anew)
    monkeypatch.setattr(Refinement, "raced", lambda self, kept: kept)
    monkeypatch.setattr(Refinement, "converged", lambda self, one, **how: one)
    monkeypatch.setattr(fitting.Fit, "excess", {"position_m": 1.0})
    base = base_at([2 * SANE, 0.0], base_at([1.0, 0.0]) if lost else None)
    scores = [Score(best.variant, 300.0, np.zeros(1), np.zeros(2), np.eye(1))]
    scores += [Score(still.variant, said, np.zeros(1), np.zeros(2), np.eye(1))]
    found = Refinement(base, str, FitMemory()).best_first(scores)
    assert begun[:1] == ([] if first is None else [(first, True)])
    assert len(found) == 2


def test_a_candidate_whose_end_cannot_be_simulated_where_it_is_taken_up_begins_as_if_it_were_new(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """An interrupted diagnosis knows where its fits ended, and not over which stretches."""
    tried: list[float] = []

    def fitted(self: Refinement, near: fitting.Fit, variant: Variant, z: np.ndarray, *rest: object) -> Refit:
        tried.append(z[-1])
        if z[-1] == 7.0:
            raise ComputationError("the simulation fails at the start of the fit")
        return candidate(list(z), 50.0, near.likelihood)

    monkeypatch.setattr(Refinement, "_refit", fitted)
    monkeypatch.setattr("msl_fem.diagnosis.refinement.started", lambda near, *which: np.array([0.0, 0.0, 1.0]))
    race = refinement([1.0, 0.0])
    race.memory.ended(fit_name(race.base.unknowns, CUBIC.name), np.array([0.0, 0.0, 7.0]))
    found = race.screened(Score(CUBIC, 1.0, np.zeros(1), np.zeros(2), np.eye(1)))
    assert tried == [7.0, 1.0]
    assert found is not None
    assert found.gain == 50.0


def test_what_will_not_come_to_the_least_that_counts_goes_no_further(begun) -> None:
    one = candidate([2 * SANE, 9.0, 5.0], 100.0, Amounts())
    assert refinement([2 * SANE, 0.0]).from_small_amounts(one, least=6000.0).gain == 5000.0
    assert len(begun) == 2


def test_all_that_begin_at_the_belief_share_the_nuisances_columns(monkeypatch) -> None:
    given: list[object] = []

    def fitted(self: Refinement, near, variant: Variant, z: np.ndarray, plan: FitPlan, columns: object) -> Refit:
        given.append(columns)
        return candidate(list(z), 5000.0, near.likelihood)

    monkeypatch.setattr(Refinement, "_refit", fitted)
    monkeypatch.setattr(fitting.Fit, "excess", {"position_m": 1.0})
    refinement([2 * SANE, 0.0]).from_small_amounts(candidate([2 * SANE, 9.0, 5.0], 100.0, Amounts()))
    assert given[0] is given[1]
    assert given[0].shape == (2, 2)  # type: ignore[union-attr]
    assert given[2] is None, "what goes on has those of where it is"
    monkeypatch.setattr(Amounts, "spectra", lambda self, points: np.full((len(points.rows), 2), np.nan))
    given.clear()
    refinement([2 * SANE, 0.0]).from_small_amounts(candidate([2 * SANE, 9.0, 5.0], 100.0, Amounts()))
    assert given[0] is None, "none where the belief cannot be simulated"


@pytest.mark.parametrize(
    ("legs", "ends"),
    [
        (((-9e4, 2e4), (-3e4, 2e4), (3e3, 2e3), (4e3, 0.0)), 4e3),
        (((-9e4, 2e4), (-3e4, 1e3)), 100.0),
        (((-9e4, 2e4), (-3e4, 2e4), (-3e4, 2e4)), 100.0),
    ],
    ids=["as long as it may", "until it promises too little", "until a leg brings nothing"],
)
def test_what_begins_far_off_goes_on_as_long_as_it_may_lead(monkeypatch, legs, ends: float) -> None:
    """Steps from a long way back: below nothing after the first legs, it leads in the end."""
    below, above = iter(legs), candidate([0.0, 0.0, 1.0], -1e6, Amounts())

    def fitted(self: Refinement, near, variant: Variant, z: np.ndarray, *rest: object) -> Refit:
        if z[-1] > 0:
            return above
        gain, promised = next(below)
        found = candidate(list(z), gain, near.likelihood)
        return replace(found, fit=replace(found.fit, predicted=promised))

    monkeypatch.setattr(Refinement, "_refit", fitted)
    anew = refinement([2 * SANE, 0.0]).from_small_amounts(candidate([2 * SANE, 9.0, 5.0], 100.0, Amounts()))
    assert anew.gain == ends
    assert next(below, None) is None


@pytest.mark.parametrize(("sane", "times"), [(base_at([1.0, 0.0]), 3), (None, 0)])
def test_candidates_begin_anew_beside_a_base_beyond_sanity_alone(begun, monkeypatch, sane, times: int) -> None:
    screened = candidate([0.0, 0.0, 5.0], 100.0, Amounts())
    race = refinement([2 * SANE, 0.0], sane=sane)
    monkeypatch.setattr(Refinement, "screened", lambda self, score: screened)
    monkeypatch.setattr(Refinement, "screened_on", lambda self, refit: refit)
    monkeypatch.setattr(Refinement, "converged", lambda self, one, **how: one)
    found = race.best_first([SimpleNamespace(variant=CUBIC, gain=100.0)])  # type: ignore[list-item]
    assert len(begun) == times
    assert found[0].gain == (5000.0 if times else 100.0)


def test_what_lags_behind_after_it_began_anew_goes_no_further(begun, monkeypatch) -> None:
    """Beside a model that nothing can be no gain is above nothing at first: those begin anew whose score, where its
    numbers were last possible, is a quarter of the best; then one leads."""
    anew = iter([candidate([0.0, 0.0, 5.0], gain, Amounts()) for gain in (9000.0, 100.0)])
    race = refinement([2 * SANE, 0.0], sane=base_at([1.0, 0.0]))
    monkeypatch.setattr(Refinement, "screened", lambda self, score: candidate([0.0, 0.0, 5.0], -10.0, Amounts()))
    monkeypatch.setattr(Refinement, "screened_on", lambda self, refit: refit)
    monkeypatch.setattr(Refinement, "from_small_amounts", lambda self, refit, *_, **__: next(anew))
    raced: list[float] = []
    monkeypatch.setattr(Refinement, "raced", lambda self, kept: raced.extend(one.gain for one in kept) or list(kept))
    monkeypatch.setattr(Refinement, "converged", lambda self, one, **how: one)
    scored = [SimpleNamespace(variant=CUBIC, gain=gain) for gain in (1000.0, 300.0, 200.0)]
    found = race.best_first(scored)  # type: ignore[arg-type]
    assert raced == [9000.0]
    assert [one.gain for one in found] == [9000.0, 100.0]


def test_remanence_that_leaves_noise_is_not_begun_anew(monkeypatch) -> None:
    """It stands in for none of its other forms, and beside itself brings nothing."""
    monkeypatch.setattr("msl_fem.diagnosis.refinement.scored", lambda *_, **__: pytest.fail("is asked of others"))
    likelihood = SimpleNamespace(is_cut=False, excess=lambda fit: {"x": 1.0})
    leader = replace(candidate([2 * SANE, 9.0, 5.0], 1000.0, likelihood), variant=Variant("remanent_flux", ()))
    assert not refinement([2 * SANE, 0.0])._stands_in(leader)


@pytest.mark.parametrize("behind", [False, True])
@pytest.mark.parametrize(
    ("left", "brings", "moved", "begins"),
    [
        (2.0, -5.0, 2 * SANE, True),
        (2.0, -5.0, 3.4, True),
        (1.05, 20.0, 2 * SANE, False),
        (1.05, 93.0, 2 * SANE, True),
        (1.05, 93.0, 2.0, False),
        (2.0, 93.0, 2.0, False),
    ],
)
def test_what_gains_make_up_for_begins_anew_where_the_leader_leaves_more_than_noise(
    monkeypatch, left: float, brings: float, moved: float, begins: bool, behind: bool
) -> None:
    """By its size, or by what that brings beside it, and a believed parameter has moved by 2.5 tolerances; beside an
    effect as without one. It had been eliminated, and leads in the end."""
    likelihood = SimpleNamespace(is_cut=False, excess=lambda fit: {"x": left})
    leader = candidate([moved, 9.0, 5.0], 1000.0, likelihood)
    kept = Variant("remanent_flux", CUBIC.amounts)
    screened = iter([leader, replace(candidate([moved, 9.0, 5.0], 10.0, Amounts()), variant=kept)])
    monkeypatch.setattr(Refinement, "_together", lambda self, step, items: [step(one) for one in items])
    monkeypatch.setattr(Refinement, "screened", lambda self, score: next(screened))
    monkeypatch.setattr(Refinement, "screened_on", lambda self, refit: refit)
    monkeypatch.setattr(Refinement, "converged", lambda self, one, **how: one)
    monkeypatch.setattr(Refinement, "_fuller", lambda self, leader, others: leader)

    def anew(self: Refinement, one: Refit, least: float, *, by_itself: bool = False) -> Refit:
        return replace(one, gain=20 * least) if by_itself else one

    def beside(found: fitting.Fit, tried: list[Variant], *, null: bool) -> SimpleNamespace:
        assert found is leader.fit
        assert tried == [kept]
        return SimpleNamespace(scores=[SimpleNamespace(gain=brings)])

    monkeypatch.setattr(Refinement, "from_small_amounts", anew)
    monkeypatch.setattr("msl_fem.diagnosis.refinement.scored", beside)
    scores = [SimpleNamespace(variant=one, gain=100.0) for one in (CUBIC, kept)]
    race = refinement([moved, 0.0])
    race.variants = CUBIC, kept
    race.base = replace(race.base, unknowns=replace(UNKNOWNS, effects=CUBIC.unknowns if behind else ()))
    found = race.best_first(scores)  # type: ignore[arg-type]
    gains = [(one.variant.effect, one.gain) for one in found]
    first, last = ("remanent_flux", 5000.0 if begins else 10.0), ("stiffness_nonlinearity", 1000.0)
    assert gains == ([first, last] if begins else [last, first])


@pytest.mark.parametrize(
    ("effect", "moved", "left", "behind", "begins"),
    [
        ("force_offset", 2 * SANE, 1.05, True, True),
        ("stiffness_nonlinearity", 2 * SANE, 1.05, True, False),
        ("force_offset", 3.9, 1.05, True, False),
        ("force_offset", 2 * SANE, 2.0, True, False),
        ("force_offset", 2 * SANE, 1.05, False, False),
    ],
    ids=["held up", "another effect", "not far off", "more than noise is left", "a first effect"],
)
def test_a_force_that_a_weight_makes_up_for_begins_at_the_belief_beside_others_that_leave_noise(
    monkeypatch, effect: str, moved: float, left: float, behind: bool, begins: bool
) -> None:
    base = base_at([moved, 0.0])
    unknowns = replace(UNKNOWNS, effects=CUBIC.unknowns if behind else ())
    race = refinement([moved, 0.0])
    race.base = replace(base, unknowns=unknowns)
    monkeypatch.setattr(Amounts, "excess", lambda self, found: {"position_m": left})
    monkeypatch.setattr(Refinement, "from_small_amounts", lambda self, one: replace(one, gain=108.0))
    one = replace(candidate([moved, 9.0, 5.0], -4.5, Amounts()), variant=Variant(effect, CUBIC.amounts))
    [found] = race._held_up([one])
    assert found.gain == (108.0 if begins else -4.5)
