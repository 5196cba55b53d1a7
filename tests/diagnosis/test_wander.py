"""A zero that wanders: its density beside the noise's, and what is left of it."""

import numpy as np
import pytest
from diagnosed import TABLE, bench_record
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.signal import lfilter

from msl_fem.computing.arrays import Array
from msl_fem.diagnosis.likelihood import Likelihood
from msl_fem.diagnosis.noise import PRIOR, make_bands, transformed, weights_of
from msl_fem.diagnosis.runs import dynamic_runs
from msl_fem.diagnosis.unknowns import EffectUnknown, Unknowns
from msl_fem.diagnosis.wander import COST, WanderLines, with_wander
from msl_fem.prediction import ModelHypothesis, run_data

N, RATE = 4000, 1e3
BANDS = make_bands([N], RATE, highest=RATE / 2)
TURN = np.pi * np.maximum(np.arange(BANDS.lines[0]), 0.5) / N
LINES = WanderLines(np.arange(2 * BANDS.lines[0]), np.tile(np.sin(TURN) * RATE / np.pi, 2))
CEILINGS = np.array([100.0, *[np.inf] * (BANDS.n_band - 1)])
NOTHING = np.zeros(BANDS.n_band)
DRIFT = EffectUnknown("sensor_drift", "rate")


def labels() -> NDArray[np.intp]:
    found = np.tile(BANDS.band_of[0], 2)
    found[BANDS.lines[0]] = found[0]
    return found


def residual(*, rms: float, seed: int) -> Array:
    """White noise and a path through two low-passes of 0.1 Hz, without its mean and slope; the lines of both."""
    rng = np.random.default_rng(seed)
    pole = np.exp(-2 * np.pi * 0.1 / RATE)
    path = rng.standard_normal(N + 20_000)
    for _ in range(2):
        path = lfilter([1 - pole], [1.0, -pole], path)
    path = path[20_000:] / path.std()
    time = np.arange(N)
    path -= np.polyval(np.polyfit(time, path, 1), time)
    return transformed(rms * path + rng.standard_normal(N), BANDS.lines[0])


@pytest.mark.parametrize("rms", [3.0, 100.0, 3000.0])
def test_beside_a_wander_the_noise_is_what_it_is(rms: float) -> None:
    values = residual(rms=rms, seed=4)
    plain = weights_of(values, labels(), CEILINGS)
    found = with_wander(plain, values, labels(), CEILINGS, NOTHING, LINES)
    assert found.nats < plain.nats - 20
    assert found.wander is not None
    left = np.sqrt(np.sum(values**2 * (1 - found.wander)) / N)
    assert left == pytest.approx(1.0, abs=0.06)
    assert np.sqrt(np.sum(values**2) / N) > 1.15
    assert np.all(found.density < 3), "the path is no noise"
    assert np.mean((values * found.root) ** 2) == pytest.approx(1.0, abs=0.1)


def _gain_in_pieces(count: int, longest: int | None, *, seed: int) -> float:
    """Nats of a wander beside noise of which a tenth is of first order below 20 Hz, as at 20 kHz over 79 stretches."""
    rate, n = 20e3, 512
    rng, pole = np.random.default_rng(seed), np.exp(-2 * np.pi * 20 / rate)
    slow = lfilter([1.0], [1.0, -pole], np.sqrt(1 - pole**2) * rng.standard_normal(count * n + 10_000))[10_000:]
    noise = np.sqrt(0.9) * rng.standard_normal(count * n) + np.sqrt(0.1) * slow
    bands = make_bands([n] * count, rate, highest=rate / 2, longest=longest)
    rows = transformed(noise.reshape(count, n), bands.lines[0])
    values, band_of = rows.ravel(), np.tile(np.tile(bands.band_of[0], 2), count)
    frequency = rate / np.pi * np.sin(np.pi * np.maximum(np.arange(bands.lines[0]), 0.5) / n)
    lines = WanderLines(np.arange(values.size), np.tile(np.tile(frequency, 2), count))
    limits = np.array([100.0, *[np.inf] * (bands.n_band - 1)])
    plain = weights_of(values, band_of, limits)
    return plain.nats - with_wander(plain, values, band_of, limits, np.zeros(bands.n_band), lines).nats


def test_coloured_noise_over_stretches_is_no_wander() -> None:
    """Where eight lines of one stretch make a band, the colour within it passes for a path."""
    assert all(_gain_in_pieces(79, 79 * 512, seed=seed) < 5 for seed in (1, 2, 3))
    assert _gain_in_pieces(79, None, seed=1) > 100


def test_the_noise_that_a_report_draws_has_the_wander_in_its_lowest_octaves() -> None:
    class Channels(Likelihood):
        labels, channel_names = labels(), ["position_m"]  # type: ignore[assignment]

    values = residual(rms=100.0, seed=4)
    plain = weights_of(values, labels(), CEILINGS)
    found = with_wander(plain, values, labels(), CEILINGS, NOTHING, LINES)
    likelihood = Channels(None, BANDS, 1)  # type: ignore[arg-type]
    (edges, drawn), (_, noise) = (likelihood.noise_spectra(of)["position_m"] for of in (found, plain))
    assert edges is BANDS.edges
    lines = values[(labels() == 0) & (values != 0)][1:]  # without the mean
    lowest = np.log(lines**2)
    assert np.log(drawn[0]) == pytest.approx(lowest.mean() + 1.27, abs=1.0)  # of chi^2 with one degree of freedom
    assert drawn[-1] == pytest.approx(1.0, abs=0.2)
    assert noise == pytest.approx(plain.density)


def test_noise_alone_pays_for_a_wander_that_is_not_there() -> None:
    gains = []
    for seed in range(20):
        values = residual(rms=0.0, seed=seed)
        plain = weights_of(values, labels(), CEILINGS)
        gains.append(plain.nats - with_wander(plain, values, labels(), CEILINGS, NOTHING, LINES).nats)
    assert max(gains) < 1.0
    assert min(gains) > -COST - 0.5


def test_the_densities_are_those_that_a_general_minimiser_finds() -> None:
    values = residual(rms=30.0, seed=7)
    plain = weights_of(values, labels(), CEILINGS)
    found = with_wander(plain, values, labels(), CEILINGS, NOTHING, LINES)

    def nats(logs: Array) -> float:
        density = np.minimum(np.exp(logs[2:]), CEILINGS)
        whole = density[labels()] + np.exp(logs[0]) / LINES.frequency**2 + np.exp(logs[1]) / LINES.frequency**4
        prior = PRIOR * np.sum(np.log(density) + 1 / density)
        return float(np.sum(np.log(whole) + values**2 / whole) + prior) / 2

    count = np.bincount(labels()) + PRIOR
    starts = [np.concatenate([np.log(sizes), np.zeros(BANDS.n_band)]) for sizes in ((0.01, 10.0), (1.0, 1.0))]
    least = min(float(minimize(nats, start, method="Powell").fun) for start in starts)
    assert found.nats - COST == pytest.approx(least - count.sum() / 2, abs=0.3)


def test_numbers_that_went_into_starts_count_for_none() -> None:
    values, spent = residual(rms=30.0, seed=7), np.array([6.0, *NOTHING[1:]])
    few, many = (
        with_wander(weights_of(values, labels(), CEILINGS, s), values, labels(), CEILINGS, s, LINES)
        for s in (NOTHING, spent)
    )
    assert many.nats < few.nats - 2


def test_a_drift_takes_its_wander_from_what_is_left_of_the_position_alone() -> None:
    record = bench_record(seed=11, rate=2e3).record
    runs = [run_data(record, run) for run in record.runs]
    kind = dynamic_runs(record, ModelHypothesis(record.actuator, TABLE), runs)
    unknowns = Unknowns(kind.unknowns.believed, kind.unknowns.n_table, kind.unknowns.starts, (DRIFT,))
    lines = kind.likelihood.wander_lines("position_m")
    names = kind.likelihood.channel_names
    bands = kind.likelihood.labels[lines.places] // kind.likelihood.bands.n_band
    assert set(bands) == {names.index("position_m")}
    assert (unknowns.wanders, kind.unknowns.wanders) == ("position_m", "")
    numbers = np.random.default_rng(1).standard_normal(kind.likelihood.labels.size)
    assert kind.likelihood.weights(numbers, kind.unknowns).wander is None
    share = kind.likelihood.weights(numbers, unknowns).wander
    assert share is not None
    assert not np.any(np.delete(share, lines.places))
