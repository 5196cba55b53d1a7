"""Periodic flux densities: rates by two routes, closed loops against a slow twin, waveforms that must be refused."""

import numpy as np
import pytest
from sheets_and_waveforms import sine, triangle

from msl_fem.errors import InputError
from msl_fem.losses import FluxWaveform, closed_loops

GENERATOR = np.random.default_rng(5)


def test_rates_of_a_sine() -> None:
    b, f = 1.3, 60.0
    wave = sine(b, f)
    assert wave.mean_square_rate == pytest.approx((2 * np.pi * f * b) ** 2 / 2, rel=1e-12)
    assert wave.mean_rate_to_3_2 == pytest.approx(8.763363 * (f * b) ** 1.5, rel=1e-6)
    assert wave.harmonics[1] == pytest.approx(b, rel=1e-12)


def test_two_routes_to_the_rate_of_a_triangle() -> None:
    """(4 f B)^2: exact by the time integral, approached by the Fourier series as its sum of 1/k^2 goes on."""
    wave = triangle(0.8, 100.0, samples=512)
    assert wave.mean_square_rate_by_time == pytest.approx((4 * 100.0 * 0.8) ** 2, rel=1e-12)
    errors = [triangle(0.8, 100.0, samples=n).resolution_error for n in (256, 512, 1024)]
    assert errors[0] < 0.01
    assert np.log2(errors[0] / errors[1]) == pytest.approx(1.0, abs=0.15)
    assert np.log2(errors[1] / errors[2]) == pytest.approx(1.0, abs=0.15)


def test_the_time_route_converges_with_the_second_order() -> None:
    errors = [sine(1.0, 50.0, samples=n).resolution_error for n in (64, 128)]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.15)


def test_loops_of_a_wave_with_minor_loops() -> None:
    """By hand: from 1 down to -1 with a rise from -0.2 to 0.3 on the way, and back up."""
    path = np.interp(np.arange(64) / 64, [0, 0.25, 0.375, 0.5, 1.0], [1.0, -0.2, 0.3, -1.0, 1.0])
    swings = closed_loops(path)
    assert swings.size == 2
    assert swings == pytest.approx([0.5, 2.0])


def preisach_loss(b: np.ndarray, cells: int) -> float:
    """The slow twin: relays with thresholds alpha > beta on a grid, all of one weight, each of which loses alpha - beta
    a switching; a loop of the swing s then loses s^3/3 a period in the limit of fine cells.
    """
    edges = np.linspace(-1, 1, cells, endpoint=False) + 1 / cells
    beta, alpha = np.meshgrid(edges, edges)
    there = alpha > beta
    up, loss = np.zeros_like(there), 0.0
    for n, value in enumerate(np.tile(b, 2)):
        switched = there & (((value >= alpha) & ~up) | ((value <= beta) & up))
        up ^= switched
        loss += float((alpha - beta)[switched].sum()) if n >= b.size else 0.0
    return loss * (2 / cells) ** 2


@pytest.mark.parametrize("harmonics", [1, 3, 9])
def test_loops_lose_what_relays_lose(harmonics: int) -> None:
    t = np.arange(128) / 128
    parts = GENERATOR.normal(size=(2, harmonics)) / np.arange(1, harmonics + 1) ** 0.7
    b = sum(p * np.cos(2 * np.pi * k * t) + q * np.sin(2 * np.pi * k * t) for k, (p, q) in enumerate(parts.T, 1))
    b = b / np.abs(b).max() * 0.99
    swings = closed_loops(b)
    assert harmonics == 1 or swings.size > 1
    assert np.sum(swings**3) / 3 == pytest.approx(preisach_loss(b, 200), rel=0.04)


def test_loops_do_not_depend_on_where_the_period_begins() -> None:
    b = np.cumsum(GENERATOR.normal(size=200))
    b -= np.linspace(0, b[-1] - b[0], 200)
    for shift in (1, 77, 150):
        assert closed_loops(np.roll(b, shift)) == pytest.approx(closed_loops(b), rel=1e-9)
    assert closed_loops(np.repeat(b, 2)) == pytest.approx(closed_loops(b), rel=1e-9)
    assert closed_loops(-b) == pytest.approx(closed_loops(b), rel=1e-9)


def test_a_constant_has_neither_rate_nor_loop() -> None:
    wave = FluxWaveform(np.full(64, 0.7), 50.0)
    assert wave.mean_square_rate == pytest.approx(0.0, abs=1e-18)
    assert np.sum(wave.loop_swings) == 0.0
    rounding = FluxWaveform(0.7 + 1e-16 * GENERATOR.normal(size=64), 50.0)
    assert np.sum(rounding.loop_swings) < 1e-12


@pytest.mark.parametrize(
    ("b", "said"),
    [
        (np.sin(2 * np.pi * np.arange(20) / 20), "give 32"),
        (np.sin(2 * np.pi * 0.8 * np.arange(256) / 256), "not periodic"),
        (np.sin(2 * np.pi * 100 * np.arange(256) / 256), "not resolved"),
        (GENERATOR.normal(size=4096), "not resolved"),
        (np.r_[np.zeros(100), np.nan, np.zeros(100)], "sample 100 of the waveform is not a number"),
        (np.ones((2, 64)), "in one row"),
    ],
)
def test_waveforms_that_are_refused(b: np.ndarray, said: str) -> None:
    with pytest.raises(InputError, match=said):
        FluxWaveform(b, 50.0)


def test_a_frequency_that_is_none() -> None:
    with pytest.raises(InputError, match="frequency of 0 Hz"):
        sine(1.0, 0.0)
