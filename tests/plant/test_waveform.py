"""Signals of unit size: their derivatives, their spectra, their peaks."""

import numpy as np
import pytest

from msl_fem.errors import ComputationError, InputError
from msl_fem.plant import waveforms as waveform

SMOOTH = {
    "sine": lambda t: waveform.sine(t, frequency=3.0),
    "linear sweep": lambda t: waveform.swept_sine(t, frequencies=(1.0, 20.0), duration=1.0, logarithmic=False),
    "logarithmic sweep": lambda t: waveform.swept_sine(t, frequencies=(20.0, 1.0), duration=1.0, logarithmic=True),
    "sweep that stands": lambda t: waveform.swept_sine(t, frequencies=(5.0, 5.0), duration=1.0, logarithmic=True),
    "faded": lambda t: waveform.faded(waveform.sine(t, frequency=3.0), t, duration=1.0, fade=0.2),
}


@pytest.mark.parametrize("name", SMOOTH)
def test_derivatives_are_those_of_the_signal(name: str) -> None:
    """Central differences over h are off by a multiple of h^2: halving h quarters the error."""
    t = np.linspace(0.01, 0.99, 97)  # off the ends and the seams of the fade

    def error(h: float) -> tuple[float, float]:
        before, here, after = (SMOOTH[name](t + s) for s in (-h, 0.0, h))
        slope, curve = (after[0] - before[0]) / (2 * h), (after[0] - 2 * here[0] + before[0]) / h**2
        return np.abs(slope - here[1]).max(), np.abs(curve - here[2]).max()

    coarse, fine = error(2e-4), error(1e-4)
    assert np.log2(coarse[0] / fine[0]) == pytest.approx(2.0, abs=0.15)
    assert np.log2(coarse[1] / fine[1]) == pytest.approx(2.0, abs=0.15)


def test_a_sweep_runs_from_its_first_to_its_last_frequency() -> None:
    """The frequency is the slope of the phase: amplitude of the slope over 2 pi."""
    t = np.linspace(0, 4, 400_001)
    for logarithmic, middle in ((False, (5 + 150) / 2), (True, np.sqrt(5 * 150))):
        s, ds, _ = waveform.swept_sine(t, frequencies=(5.0, 150.0), duration=4.0, logarithmic=logarithmic)
        phase = np.unwrap(np.arctan2(s, ds / (2 * np.pi * 50)))  # grows with the phase, equal every quarter turn
        turns = (phase[-1] - phase[0]) / (2 * np.pi)
        expected = 4 * ((5 + 150) / 2 if not logarithmic else (150 - 5) / np.log(150 / 5))
        assert turns == pytest.approx(expected, abs=0.25)
        frequency = np.sqrt(ds**2 / np.maximum(1 - s**2, 1e-300)) / (2 * np.pi)
        upright = np.abs(s) < 0.5
        for at, value in ((0.0, 5.0), (2.0, middle), (4.0, 150.0)):
            nearest = np.flatnonzero(upright)[np.argmin(np.abs(t[upright] - at))]
            assert frequency[nearest] == pytest.approx(value, rel=0.02)
        assert np.abs(s).max() == pytest.approx(1.0, abs=1e-3)


def test_a_fade_starts_and_ends_at_rest() -> None:
    t = np.linspace(0, 1, 1001)
    window = waveform.faded(np.array([np.ones(1001), np.zeros(1001), np.zeros(1001)]), t, duration=1.0, fade=0.2)
    assert window[0, [0, 100, 200, 500, 800, 900, 1000]] == pytest.approx([0, 0.5, 1, 1, 1, 0.5, 0], abs=1e-12)
    assert window[1, [0, 200, 500, 1000]] == pytest.approx(0, abs=1e-10)


@pytest.mark.parametrize(("frequency", "rate"), [(3.0, 10e3), (3.0, 2.5e3), (7.0, 1e4), (0.3, 3e3)])
def test_a_square_wave_has_equal_halves(frequency: float, rate: float) -> None:
    """Rounding of f t must not move an edge: half periods differ by the one sample that 1/(2 f) leaves over."""
    s = waveform.square(np.arange(int(10 / frequency * rate)) / rate, frequency=frequency)[0]
    assert set(s) == {1.0, -1.0}
    assert s[0] == 1.0
    halves = np.diff(np.flatnonzero(np.diff(s)))
    assert halves.max() - halves.min() <= (0 if (rate / (2 * frequency)).is_integer() else 1)


def test_a_triangle_starts_at_zero_and_rises() -> None:
    t = np.arange(2000) / 10e3
    s, ds, dds = waveform.triangle(t, frequency=5.0)
    assert s[[0, 250, 500, 1000, 1500]] == pytest.approx([0, 0.5, 1, 0, -1], abs=1e-12)
    assert ds[[0, 499, 500, 1499, 1500]] == pytest.approx([20, 20, -20, -20, 20])
    assert np.abs(np.diff(s)).max() == pytest.approx(20 / 10e3)
    assert not dds.any()


@pytest.mark.parametrize(
    ("count", "lines"), [(4000, range(1, 201)), (4001, range(1, 1999)), (64, range(1, 4, 2)), (9, [1])]
)
def test_noise_is_exactly_flat_and_bounded(count: int, lines) -> None:
    lines = np.array(lines)
    s, ds, dds = waveform.flat_noise(lines, count=count, rate=1e3, generator=np.random.default_rng(4))
    spectrum = np.abs(np.fft.rfft(s)) / count
    flat = 1 / np.sqrt(2 * lines.size)
    assert spectrum[lines] == pytest.approx(np.full(lines.size, flat), rel=1e-9)
    spectrum[lines] = 0
    assert spectrum.max() < 1e-12
    assert np.sqrt(np.mean(s**2)) == pytest.approx(1.0, rel=1e-12)
    assert np.abs(s).max() <= waveform.crest_bound(lines.size) <= 3.0
    w = 2 * np.pi * 1e3 / count * lines
    assert np.sqrt(np.mean(ds**2)) == pytest.approx(np.sqrt(np.mean(w**2)), rel=1e-9)
    assert np.sqrt(np.mean(dds**2)) == pytest.approx(np.sqrt(np.mean(w**4)), rel=1e-9)


def test_noise_derivatives_are_those_of_the_signal() -> None:
    s, ds, _ = waveform.flat_noise(np.arange(1, 6), count=5000, rate=1e3, generator=np.random.default_rng(4))
    slope = (np.roll(s, -1) - np.roll(s, 1)) * 1e3 / 2
    assert np.abs(slope - ds).max() < 1e-4 * np.abs(ds).max()


def test_noise_is_nearly_normal() -> None:
    """Only the tails beyond 3 are missing: moments and shares of a normal distribution cut there."""
    s = waveform.flat_noise(np.arange(1, 5001), count=40_000, rate=1e4, generator=np.random.default_rng(5))[0]
    assert np.mean(s**3) == pytest.approx(0.0, abs=0.05)
    assert np.mean(s**4) == pytest.approx(3.0, abs=0.25)
    assert np.mean(np.abs(s) < 1) == pytest.approx(0.683, abs=0.01)
    assert np.mean(np.abs(s) > 2) == pytest.approx(0.0455, abs=0.01)


def test_a_line_at_half_the_rate_is_refused() -> None:
    with pytest.raises(InputError, match="not below half the rate"):
        waveform.flat_noise(np.array([5]), count=10, rate=1.0, generator=np.random.default_rng(1))


def test_peaks_that_stay_too_high_are_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(waveform, "LARGEST_CREST", 1.01)
    with pytest.raises(ComputationError, match="keep the peaks below"):
        waveform.flat_noise(np.arange(1, 9), count=64, rate=1.0, generator=np.random.default_rng(1))
