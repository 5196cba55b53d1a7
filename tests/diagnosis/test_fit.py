"""The fit with its noise colour and evidence, on a record for which all of it has a closed form."""

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from linear_record import CUBIC, FRICTION, OFFSET, LinearRecord, record, with_effect
from scipy.signal import butter, lfilter

from msl_fem.diagnosis.fit import FitPlan, fit, with_the_rest
from msl_fem.diagnosis.fit_memory import FitMemory
from msl_fem.diagnosis.gathered import GatheredRuns
from msl_fem.diagnosis.likelihood import Likelihood
from msl_fem.diagnosis.noise import (
    MISSTATED,
    PRIOR,
    WINDOWED_LINES,
    ceilings,
    loudness,
    make_bands,
    transformed,
    weights_of,
)
from msl_fem.diagnosis.problem import Points
from msl_fem.diagnosis.refinement import Refinement
from msl_fem.diagnosis.scores import Score, scores
from msl_fem.diagnosis.search import converged_base, peaks, ranked, search_stage
from msl_fem.diagnosis.unknowns import CAUCHY, EffectUnknown, Unknowns, factor
from msl_fem.diagnosis.variants import Variant
from msl_fem.errors import ComputationError


def test_lines_of_white_noise_have_its_variance() -> None:
    """An orthonormal transform: the sum of squares is kept, and each number of unit white noise has variance 1."""
    for n in (400, 401):
        noise = np.random.default_rng(2).standard_normal((300, n))
        lines = transformed(noise, n // 2 + 1)
        assert np.sum(lines**2, axis=1) == pytest.approx(np.sum(noise**2, axis=1), rel=1e-12)
        variance = lines.var(axis=0)
        imaginary_mean = n // 2 + 1
        assert variance[imaginary_mean] == 0
        assert np.delete(variance, [imaginary_mean, 2 * imaginary_mean - 1]) == pytest.approx(1.0, abs=0.4)


def test_bands_are_octaves_and_hold_every_line_once() -> None:
    bands = make_bands([4000, 1000], 1000.0, highest=300.0)
    assert bands.edges[-1] == 300
    assert bands.edges[0] == 0
    assert bands.edges[2:] / bands.edges[1:-1] == pytest.approx(2.0)
    assert [len(band) for band in bands.band_of] == list(bands.lines) == [1201, 301]
    f = np.arange(1201) / 4.0
    assert ((bands.edges[bands.band_of[0]] <= f) & (f <= bands.edges[bands.band_of[0] + 1])).all()


def test_the_lines_of_all_pieces_of_a_run_count_together() -> None:
    """65 lines, of which eight of one piece at least would make the lowest band."""
    one, many = (make_bands([128] * 79, 2e4, highest=1e4, longest=longest) for longest in (None, 79 * 128))
    assert np.unique(one.band_of[0][:16]).size == 1
    assert np.unique(many.band_of[0][:5]).size == 4  # the mean, 1, 2 and 3, 4
    assert np.unique(many.band_of[0]).tolist() == list(range(many.n_band))


def test_the_density_of_coloured_noise_is_found() -> None:
    residual = np.r_[3 * np.random.default_rng(3).standard_normal(5000), np.random.default_rng(4).standard_normal(5000)]
    labels = np.repeat([0, 1], 5000)
    weights = weights_of(residual, labels, np.full(2, np.inf))
    assert weights.density == pytest.approx([9.0, 1.0], rel=0.06)
    assert weights.root[[0, -1]] == pytest.approx([1 / 3, 1.0], rel=0.03)
    expected = sum((5000 + PRIOR) / 2 * np.log((q + PRIOR) / (5000 + PRIOR)) for q in np.bincount(labels, residual**2))
    assert weights.nats == pytest.approx(expected)


def test_noise_has_a_ceiling_in_the_lowest_octave_or_in_all() -> None:
    assert ceilings(6, 2, strict=True).tolist() == [100.0, 50.0, 25.0, 12.5, 10.0, 10.0] * 2
    assert ceilings(3, 2, strict=False).tolist() == [100.0, np.inf, np.inf] * 2
    assert ceilings(1, 1, strict=False).tolist() == [np.inf]


TWO_ERRORS = 1 + WINDOWED_LINES / np.sqrt(0.2 * 4001)
"""More than is seen in the highest fifth of the lines of 8000 samples, which a louder instrument may be."""


@pytest.mark.parametrize(
    ("times", "shown"), [(0.1, 1 / MISSTATED), (0.5, 0.5), (1.0, 1.0), (2.0, 2.0 * TWO_ERRORS), (30.0, MISSTATED)]
)
def test_how_loud_an_instrument_is_its_highest_frequencies_say(times: float, shown: float) -> None:
    """White noise of a known multiple of its stated sigma beside a slow error of thirty times it."""
    slow = 30 * np.sin(2 * np.pi * 3.5 * np.arange(8000) / 1000)
    noise = times * np.random.default_rng(5).standard_normal(8000)
    assert loudness([noise + slow]) == pytest.approx(shown, rel=0.05)


def test_a_filter_behind_an_instrument_makes_it_no_quieter() -> None:
    noise = lfilter(*butter(1, 0.2), np.random.default_rng(6).standard_normal(8000))
    assert loudness([noise / noise.std()]) == 1.0


@pytest.mark.parametrize("seed", range(10))
def test_short_runs_show_a_quieter_instrument_together(seed: int) -> None:
    """Beside a run whose highest frequencies hold an error of the model."""
    chance = np.random.default_rng(seed)
    runs = [0.5 * chance.standard_normal(size) for size in (4000, 1000, 1000, 1000)]
    error = 0.7 * np.sin(0.9 * np.pi * np.arange(1000))
    assert loudness([*runs, runs[-1] + error]) == pytest.approx(0.5, rel=0.06)


@pytest.mark.parametrize("seed", range(10))
def test_an_instrument_as_loud_as_stated_is_neither(seed: int) -> None:
    assert loudness([np.random.default_rng(seed).standard_normal(4000)]) == pytest.approx(1.0, abs=0.16)


def test_beyond_a_band_s_ceiling_a_residual_counts_by_its_square() -> None:
    """A density is the noise's as far as noise can be that loud: nats and their slope go on without a jump there."""
    labels, at, ceilings = np.repeat([0, 1], 16), np.ones(32), np.array([100.0, np.inf])
    at[:16] = np.sqrt((100 * (16 + PRIOR) - PRIOR) / 16)  # the density is its ceiling

    def nats(size: float, top: np.ndarray) -> float:
        return weights_of(np.where(labels == 0, size * at, at), labels, top).nats

    for size in (0.1, 0.5, 0.999):
        assert nats(size, ceilings) == pytest.approx(nats(size, np.full(2, np.inf)), rel=1e-12)
    assert nats(1.001, ceilings) - nats(1, ceilings) == pytest.approx(
        nats(1, ceilings) - nats(0.999, ceilings), rel=5e-3
    )
    q = 16 * at[0] ** 2
    assert nats(5, ceilings) - nats(2, ceilings) == pytest.approx(21 * q / (2 * 100), rel=1e-9)
    assert weights_of(5 * at, labels, ceilings).density[0] == 100
    assert nats(5, np.full(2, np.inf)) - nats(2, np.full(2, np.inf)) < 20, "where a drift would pass for noise"


def test_a_linear_fit_is_the_closed_form() -> None:
    """Posterior (J'J + I)^-1 J'y, and of the evidence the change from prior width 1 to any other is the known one."""
    it, unknowns = record(seed=5)
    found = fit(it, unknowns, np.zeros(3))  # type: ignore[arg-type]
    a = it.nuisances * found.weights.root[:, None]
    expected = np.linalg.solve(a.T @ a + np.eye(3), a.T @ (it.data * found.weights.root))
    assert found.z == pytest.approx(expected, abs=2e-3)
    assert found.converged
    quadratic = -found.weights.nats - expected @ expected / 2 - np.linalg.slogdet(a.T @ a + np.eye(3))[1] / 2
    assert found.log_evidence == pytest.approx(quadratic, abs=0.06)


def test_the_score_of_an_effect_is_what_its_refit_brings() -> None:
    """In a linear record both are the same integral; what differs is the noise's variance, estimated with each."""
    for size in (0.1, -0.2, 0.0):
        it, unknowns = record(seed=6, size=size)
        base = fit(it, unknowns, np.zeros(3))  # type: ignore[arg-type]
        variant = Variant("force_offset", (OFFSET,))
        score = scores(base, [variant])[0]
        full = fit(it, with_effect(unknowns, OFFSET), np.zeros(4))  # type: ignore[arg-type]
        gain = full.log_evidence - base.log_evidence
        assert score.gain == pytest.approx(gain, abs=0.03 * abs(gain) + 0.1)
        assert score.guess[0] == pytest.approx(full.z[3], abs=2e-3)
        assert (gain > 5) == (size != 0)


@pytest.mark.parametrize("size", [0.2, 0.1])
def test_beside_an_amount_as_it_is_all_else_moves_to_where_its_own_fit_ends(size: float) -> None:
    """The offset acts as the first of the three numbers does: with that where it was, the right amount makes it worse.
    The densities are those before the move, from which on S falls by more than the linear model's."""
    it, unknowns = record(seed=6, size=size)
    base = fit(it, unknowns, np.zeros(3))  # type: ignore[arg-type]
    more = with_effect(unknowns, OFFSET)
    full = fit(it, more, np.zeros(4))  # type: ignore[arg-type]
    as_it_is = np.append(base.z, full.z[3])
    least = with_the_rest(base, more, as_it_is)
    [residual] = it.spectra(Points.of(more, as_it_is[None]))
    assert it.weights(residual, more).nats + more.prior(as_it_is)[0] > base.objective - 0.1
    assert full.objective - 0.01 <= least <= full.objective + 0.05 * (base.objective - full.objective)
    assert with_the_rest(base, more, np.full(4, np.nan)) == np.inf


def test_of_two_effects_the_one_that_is_there_wins_and_nothing_costs_evidence() -> None:
    it, unknowns = record(seed=7, size=0.15, of="stiffness_nonlinearity")
    base = fit(it, unknowns, np.zeros(3))  # type: ignore[arg-type]
    variants = [Variant(one.effect, (one,)) for one in (OFFSET, CUBIC)]
    told: list[str] = []
    found = search_stage(base, variants, tell=told.append)
    assert "1 of 2; best so far " in told[1]
    assert told[1].endswith(" s left for a first look")
    assert "2 of 2; best so far stiffness_nonlinearity, " in told[2]
    assert "1 of 1; best so far stiffness_nonlinearity, " in told[3], "the other one is far behind"
    assert found.best is not None
    assert found.best.variant.effect == "stiffness_nonlinearity"
    assert found.refits[1].gain < -2
    assert [s.variant.effect for s in ranked(found.scores)] == ["stiffness_nonlinearity", "force_offset"]
    assert found.rivals(5.0) == []


def test_simulations_of_candidates_are_asked_for_where_those_of_all_meet(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each by itself, they would all be in the memory at the same time."""
    it, unknowns = record(seed=7, size=0.15, of="stiffness_nonlinearity")
    base = fit(it, unknowns, np.zeros(3))  # type: ignore[arg-type]
    variants = [Variant(one.effect, (one,)) for one in (OFFSET, CUBIC)]
    met, apart = [], []

    class Meeting(LinearRecord):
        def spectra(self, points: Points) -> np.ndarray:
            met.append(len(points.rows))
            return super().spectra(points)

    plain = LinearRecord.spectra

    def counted(likelihood: LinearRecord, points: Points) -> np.ndarray:
        if type(likelihood) is LinearRecord:
            apart.append(len(points.rows))
        return plain(likelihood, points)

    def gathering(likelihood: LinearRecord, runs: GatheredRuns | None) -> LinearRecord:
        return it if runs is None else Meeting(it.data, it.nuisances, it.of_effect)

    together = Refinement._together

    def alone_before(self: Refinement, step: Any, items: Any) -> Any:
        before = len(apart)
        found = together(self, step, items)
        assert len(apart) == before, "of candidates, nothing apart"
        return found

    monkeypatch.setattr(LinearRecord, "spectra", counted)
    monkeypatch.setattr(LinearRecord, "gathering", gathering)
    monkeypatch.setattr(Refinement, "_together", alone_before)
    search_stage(base, variants, tell=str)
    assert apart[0] == 2, "what all candidates bring in the linear model"
    assert len(met) > 3


def test_the_best_refit_alone_is_led_to_its_end_and_no_further_later() -> None:
    it, unknowns = record(seed=7, size=0.15, of="stiffness_nonlinearity")
    base = fit(it, unknowns, np.zeros(3))  # type: ignore[arg-type]
    refits = search_stage(base, [Variant(one.effect, (one,)) for one in (OFFSET, CUBIC)], tell=str).refits
    assert [refit.fit.finished for refit in refits] == [True, False]
    promising = replace(refits[0].fit, predicted=40.0)
    assert converged_base(promising) is promising, "whatever it promises"
    assert converged_base(replace(promising, finished=False)) is not promising


@pytest.mark.parametrize(("predicted", "stale"), [(5.0, True), (40.0, False)])
def test_a_fit_without_effects_that_is_near_its_end_keeps_its_columns(predicted: float, stale: bool) -> None:
    it, unknowns = record(seed=7)
    begun = fit(it, unknowns, np.full(3, 0.1), plan=FitPlan(most_steps=1))  # type: ignore[arg-type]
    found = converged_base(replace(begun, predicted=predicted))
    assert found.stale is stale
    assert found.converged


def test_refits_behind_the_best_let_their_jacobians_go_and_have_them_back_when_asked() -> None:
    """They are by far the largest of what a fit holds: ten of them at 10 kHz are 400 MB."""
    it, unknowns = record(seed=7, size=0.15, of="stiffness_nonlinearity")
    base = fit(it, unknowns, np.zeros(3))  # type: ignore[arg-type]
    refits = search_stage(base, [Variant(one.effect, (one,)) for one in (OFFSET, CUBIC)], tell=str).refits
    assert [refit.fit.columns.values is None for refit in refits] == [False, True]
    kept = refits[0].fit
    before, precision = kept.jacobian.copy(), kept.precision
    kept.lets_go()
    assert np.array_equal(kept.precision, precision)
    assert kept.columns.values is None, "what the record tells of each unknown is asked without it"
    assert replace(kept, finished=True).jacobian == pytest.approx(before, rel=1e-9, abs=1e-9)
    assert kept.columns.values is not None, "copies share it"


def test_a_fit_holds_no_simulations_of_others() -> None:
    it, unknowns = record(seed=7)
    found = fit(it, unknowns, np.zeros(3))  # type: ignore[arg-type]
    assert found.residual.base is None


def test_what_no_instrument_s_noise_can_be_is_told_octave_by_octave() -> None:
    """White noise of unit sigma, and in one octave a sine of ten times the least ceiling; what is below it is none. Of
    an instrument that is twice as loud as stated the ceiling is four times as high."""
    bands = make_bands([8000], 1000.0, highest=500.0)
    sine = np.sin(2 * np.pi * 40.0 * np.arange(8000) / 1000.0)
    noise = np.random.default_rng(5).standard_normal(8000)

    def told(size: float, loud: float = 1.0) -> list[str]:
        class Channels(Likelihood):
            labels, spent, channel_names = bands.band_of[0].repeat(2), 0.0, ["position_m"]  # type: ignore[assignment]

            def loudness(self, found: Any) -> dict[str, float]:
                return {"position_m": loud}

        lines = transformed(noise + size * sine, bands.lines[0]).reshape(2, -1).T.ravel()
        found: Any = SimpleNamespace(residual=lines, weights=SimpleNamespace(of_noise=1.0))
        return Channels(None, bands, 1).above_noise(found)  # type: ignore[arg-type]

    octave = bands.band_of[0] == bands.band_of[0][320]  # that of 40 Hz
    power = np.sum(octave) * 2 / 8000  # share of its numbers
    assert told(np.sqrt(2 * power * 5)) == []
    (said,) = told(np.sqrt(2 * power * 100))
    assert said.startswith("position: from 31.2 to 62.5 Hz 10 times the noise is left")
    assert told(np.sqrt(2 * power * 30), 0.5) == told(np.sqrt(2 * power * 30))
    assert told(np.sqrt(2 * power * 30), 2.0) == []
    assert len(told(np.sqrt(2 * power * 50), 2.0)) == 1


def test_an_interrupted_search_goes_on_where_its_fits_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    """Refits begin at what is kept: fewer simulations, the same evidence; what is of other unknowns is not taken."""
    it, unknowns = record(seed=7, size=0.15, of="stiffness_nonlinearity")
    base = fit(it, unknowns, np.zeros(3))  # type: ignore[arg-type]
    variants = [Variant(one.effect, (one,)) for one in (OFFSET, CUBIC)]
    kept: dict[str, Sequence[float]] = {}
    simulated: list[int] = []
    plain = LinearRecord.spectra

    def counted(likelihood: LinearRecord, points: Points) -> np.ndarray:
        simulated.append(len(points.rows))
        return plain(likelihood, points)

    monkeypatch.setattr(LinearRecord, "spectra", counted)
    first = search_stage(base, variants, tell=lambda _: None, memory=FitMemory(keep=kept.update))
    assert sorted(kept) == ["none: ", "none: force_offset (force)", "none: stiffness_nonlinearity (cubic)"]
    before = sum(simulated)
    again = search_stage(base, variants, tell=lambda _: None, memory=FitMemory(kept))
    assert sum(simulated) - before < before - 6
    assert first.best is not None
    assert again.best is not None
    assert again.best.gain == pytest.approx(first.best.gain, abs=1e-3)
    assert FitMemory(kept).end_of("none: ", replace(unknowns, n_table=4)) is None


def test_an_effect_that_cannot_be_negative_stays_at_nothing() -> None:
    friction = EffectUnknown("coulomb_friction", "force")
    assert friction.one_sided
    unknowns = Unknowns((), 0, (0,), (friction, OFFSET))
    assert unknowns.allowed(np.array([-0.3, -0.3])) == pytest.approx([0.0, -0.3])
    cost, slope, curvature = unknowns.prior(np.array([3.0, 0.0]))
    assert cost == pytest.approx(np.log(10.0) - 2 * CAUCHY)
    assert slope == pytest.approx([0.6, 0.0])
    assert curvature == pytest.approx([0.2, 2.0])


def test_beside_the_bound_of_an_amount_the_others_come_to_their_best() -> None:
    """An amount that would have to be below nothing acts nearly as a nuisance does, which has to do without it."""
    it, unknowns = record(seed=7)
    it.of_effect["coulomb_friction"] = it.nuisances[:, 0] + 0.1 * it.of_effect["stiffness_nonlinearity"]
    below = replace(it, data=it.data - it.of_effect["coulomb_friction"])
    found = fit(below, with_effect(unknowns, FRICTION), np.zeros(4), plan=FitPlan(most_steps=8))  # type: ignore[arg-type]
    without = fit(below, unknowns, np.zeros(3))  # type: ignore[arg-type]
    assert found.converged
    assert found.z == pytest.approx([*without.z, 0.0], abs=2e-3)


def test_a_shape_stays_within_three_widths_of_its_centre() -> None:
    resonance = EffectUnknown("structural_mode", "frequency", 80.0, 0.15)
    unknowns = Unknowns((), 0, (0,), (resonance,))
    for z, held in ((50.0, 3.0), (-50.0, -3.0), (2.5, 2.5)):
        assert unknowns.allowed(np.array([z])) == pytest.approx([held])


def test_small_tolerances_are_linear_and_large_ones_stay_positive() -> None:
    assert factor(0.005, -7.0) == pytest.approx(0.965)
    assert factor(0.2, -7.0) == pytest.approx(np.exp(-1.4))


def test_a_start_that_cannot_be_simulated_is_said() -> None:
    it, unknowns = record()
    it.data[3] = np.nan
    with pytest.raises(ComputationError, match="fails at the start"):
        fit(it, unknowns, np.zeros(3))  # type: ignore[arg-type]


def test_a_form_with_a_shape_that_the_best_ones_lack_is_tried_too() -> None:
    """A knee scores a sixth of a cube by a linear model, and brings more: once, and where there is a guess."""
    knee, low = (EffectUnknown("early_saturation", name) for name in ("knee_excess", "low_field_current"))

    def score(gain: float, *amounts: EffectUnknown, at: float | None = None, guess: float = 1.0) -> Score:
        shapes = () if at is None else (EffectUnknown("early_saturation", "knee_current", at, 1.0),)
        n = len(amounts)
        return Score(Variant("early_saturation", amounts, shapes), gain, np.full(n, guess), np.zeros(1), np.eye(n))

    straight = [score(676.0, low, knee), score(672.0, knee)]
    bent = [score(119.0, knee, at=6.0), score(114.0, low, knee, at=6.0)]
    assert ranked([*straight, *bent]) == [*straight, bent[0]]
    assert ranked([*straight, score(119.0, knee, at=6.0, guess=0.0)]) == straight
    assert ranked([*straight, score(300.0, EffectUnknown("early_saturation", "knee_shift"))]) == straight


def test_another_form_is_tried_from_a_quarter_of_the_best_score_on() -> None:
    """Of a lower knee one number scored 574 nats and brought 19, four scored 238 and brought 850."""

    def score(gain: float, *names: str) -> Score:
        amounts = tuple(EffectUnknown("early_saturation", name) for name in names)
        n = len(names)
        return Score(Variant("early_saturation", amounts), gain, np.ones(n), np.zeros(1), np.eye(n))

    shift, other = score(574.0, "knee_shift"), score(238.0, "low_field_current", "knee_excess")
    assert ranked([shift, other]) == [shift, other]
    assert ranked([shift, replace(other, gain=140.0)]) == [shift]


def test_a_peak_between_springs_that_score_more_is_tried_too() -> None:
    """The gains of a second resonance at 153 Hz over the grid: far above, its spring alone scores more."""
    grid = [100.0, 119.0, 140.0, 165.0, 195.0, 230.0, 271.0, 320.0, 526.0, 864.0, 1203.0, 1419.0]
    gains = [47.7, 155.5, 199.7, 294.3, 239.7, 280.0, 308.2, 359.3, 389.0, 365.6, 394.6, 387.4]
    share = EffectUnknown("structural_mode", "mass_share")

    def score(centre: float, gain: float) -> Score:
        variant = Variant("structural_mode", (share,), (EffectUnknown("structural_mode", "frequency", centre, 0.15),))
        return Score(variant, gain, np.ones(1), np.zeros(1), np.eye(1))

    every = sorted(map(score, grid, gains), key=lambda one: -one.gain)
    chosen = ranked(every)
    assert [one.variant.shapes[0].centre for one in chosen] == [1203.0, 526.0]
    assert [one.variant.shapes[0].centre for one in peaks(every, chosen)] == [165.0]
    flat = [score(centre, 300.0 - n) for n, centre in enumerate(grid)]
    assert not peaks(flat, ranked(flat))
