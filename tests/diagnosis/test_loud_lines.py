"""Lines and resonances that stand out of what is left of a run, whole or over stretches."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from msl_fem.diagnosis.noise import in_time, transformed
from msl_fem.diagnosis.residual_spectrum import RestSpectrum, loud_lines, resonances, spectra_of_rest

RATE, COUNT, HUM = 5e3, 20_000, 90.2  # Hz, samples, Hz


def left(begins: list[int], amplitude: float, lines: float = 1.0) -> tuple[Any, Any]:
    """White noise and a hum, by the lines of each stretch up to a share of all, as a likelihood and its fit have them;
    behind them a map's row."""
    chance = np.random.default_rng(4)
    hum = amplitude * np.sin(2 * np.pi * HUM * np.arange(COUNT) / RATE + 0.3)
    channels = {"position_m": chance.standard_normal(COUNT) + hum, "current_1_A": chance.standard_normal(COUNT)}
    parts = [slice(a, b) for a, b in zip(begins, [*begins[1:], COUNT], strict=True)]
    count = [int(lines * ((part.stop - part.start) // 2 + 1)) for part in parts]
    numbers = [transformed(v[part], n) for part, n in zip(parts, count, strict=True) for v in channels.values()]
    run = SimpleNamespace(rate=RATE, commands=np.zeros((COUNT, 1)))
    problem = SimpleNamespace(runs=(run,), pieces=[(0, part) for part in parts], channels=lambda run: list(channels))
    likelihood = SimpleNamespace(problem=problem, bands=SimpleNamespace(lines=tuple(count)))
    residual = np.concatenate([*numbers, [3.0]])
    return likelihood, SimpleNamespace(residual=residual, weights=SimpleNamespace(root=np.ones(residual.size)))


@pytest.mark.parametrize("begins", [[0], list(range(0, COUNT, 256))])
@pytest.mark.parametrize("lines", [1.0, 0.6])
def test_a_hum_far_below_the_noise_is_found_over_stretches_as_over_a_whole_run(begins: list[int], lines: float) -> None:
    """It is in all of them, with one phase; a stretch of its own shows nothing of it."""
    first, *_ = loud_lines(spectra_of_rest(*left(begins, 0.3, lines)))
    assert first == pytest.approx(HUM, abs=0.02)
    quiet = loud_lines(spectra_of_rest(*left(begins, 0.0, lines)))
    assert all(abs(frequency - HUM) > 1.0 for frequency in quiet)


@pytest.mark.parametrize("n", [64, 65])
def test_values_come_back_from_all_of_their_lines(n: int) -> None:
    values = np.random.default_rng(1).standard_normal(n)
    assert in_time(transformed(values, n // 2 + 1), n) == pytest.approx(values, abs=1e-12)
    few = in_time(transformed(values, 9), n)
    assert transformed(few, 9) == pytest.approx(transformed(values, 9), abs=1e-12)


def ringing(*modes: tuple[float, float], hum: float = 0.0, seconds: float = 4.0, seed: int = 5) -> list[RestSpectrum]:
    """White noise, noise that rings at modes of frequencies in Hz and amplitudes, 1.5 % damped, and a hum."""
    n = round(seconds * RATE)
    chance = np.random.default_rng(seed)
    total = chance.standard_normal(n) + hum * np.sin(2 * np.pi * HUM * np.arange(n) / RATE)
    shaped = np.fft.rfft(chance.standard_normal(n))
    ratio = np.fft.rfftfreq(n, 1 / RATE)[:, None] / np.array([frequency for frequency, _ in modes] or [1.0])
    answer = 1 / np.abs(1 - ratio**2 + 0.03j * ratio)
    total += np.fft.irfft(shaped * (answer @ np.array([size for _, size in modes] or [0.0])), n)
    numbers = transformed(total, n // 2 + 1)
    return [RestSpectrum(numbers[: n // 2 + 1] ** 2 + numbers[n // 2 + 1 :] ** 2, RATE / n)]


@pytest.mark.parametrize("frequency", [121.0, 181.7, 640.0])
def test_a_resonance_is_found_within_half_of_its_width(frequency: float) -> None:
    """From a point of the grid, 9 % away at most, a fit of a resonance of 1.5 % leads elsewhere."""
    assert resonances(ringing((frequency, 0.2))) == (pytest.approx(frequency, rel=0.01),)


def test_the_two_that_tell_most_are_taken_and_no_hum_is_one() -> None:
    found = resonances(ringing((181.7, 0.3), (640.0, 0.2), (1500.0, 0.06), hum=3.0))
    assert sorted(found) == [pytest.approx(181.7, rel=0.01), pytest.approx(640.0, rel=0.01)]


def test_noise_has_next_to_none_and_a_short_run_none() -> None:
    assert sum(len(resonances(ringing(seed=seed))) for seed in range(20)) <= 6
    assert resonances(ringing((640.0, 0.3), seconds=0.05)) == ()
    assert resonances([]) == ()
