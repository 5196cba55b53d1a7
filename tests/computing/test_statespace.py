"""Linear systems in state space."""

import numpy as np
import pytest
from scipy.linalg import expm

from msl_fem.computing.statespace import StateSpace
from msl_fem.errors import InputError


def oscillator() -> StateSpace:
    """x'' + 2 x' + 400 x = u."""
    return StateSpace(np.array([[0.0, 1.0], [-400.0, -2.0]]), np.array([[0.0], [1.0]]), np.eye(1, 2), np.zeros((1, 1)))


def test_poles_and_response_of_an_oscillator() -> None:
    system = oscillator()
    assert sorted(system.poles, key=lambda p: p.imag) == pytest.approx([-1 - 1j * 399**0.5, -1 + 1j * 399**0.5])
    assert system.is_stable
    frequency = np.array([0.0, 3.0, 10.0])
    s = 2j * np.pi * frequency
    assert system.response(frequency)[:, 0, 0] == pytest.approx(1 / (s**2 + 2 * s + 400), rel=1e-12)


def test_a_sampled_system_is_exact_at_the_instants() -> None:
    system = oscillator()
    sampled = system.sampled(0.02)
    both = expm(0.02 * np.block([[system.A, system.B], [np.zeros((1, 3))]]))
    assert np.hstack([sampled.A, sampled.B]) == pytest.approx(both[:2], rel=1e-12)
    assert sampled.poles == pytest.approx(np.exp(0.02 * system.poles))
    assert sampled.is_stable
    assert sampled.sampling_period == 0.02
    slow = 0.5  # Hz, far below the rate: the hold's delay of half a sample remains
    held = system.response(slow) * np.exp(-1j * np.pi * slow * 0.02) * np.sinc(slow * 0.02)
    assert sampled.response(slow) == pytest.approx(held, rel=1e-3)


def test_stability_has_its_own_border_in_each_time() -> None:
    growing = StateSpace(np.array([[0.5]]), np.eye(1), np.eye(1), np.zeros((1, 1)))
    assert not growing.is_stable
    assert StateSpace(growing.A, growing.B, growing.C, growing.D, 1.0).is_stable


def test_matrices_that_do_not_fit_are_refused() -> None:
    with pytest.raises(InputError, match=r"C has the shape \(1, 3\), with the others it must be \(1, 2\)"):
        StateSpace(np.eye(2), np.ones((2, 1)), np.ones((1, 3)), np.zeros((1, 1)))
    with pytest.raises(InputError, match="1 names of states for 2"):
        StateSpace(np.eye(2), np.ones((2, 1)), np.ones((1, 2)), np.zeros((1, 1)), states=("x",))
    with pytest.raises(InputError, match="sampling_period 0 s"):
        StateSpace(np.eye(2), np.ones((2, 1)), np.ones((1, 2)), np.zeros((1, 1)), 0.0)
    with pytest.raises(InputError, match="sampled already"):
        oscillator().sampled(0.1).sampled(0.1)
