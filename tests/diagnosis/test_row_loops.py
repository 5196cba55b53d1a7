"""The loops over rows of residuals against the formulas that they stand for, written with arrays."""

import numpy as np
import pytest

from msl_fem.diagnosis.noise import transformed
from msl_fem.diagnosis.row_loops import add_squares, put_gram, put_lines, put_missed, put_moves, put_slope

CHANCE = np.random.default_rng(11)


def test_what_is_missed_is_measured_less_what_the_instrument_would_read() -> None:
    row, measured, read = np.empty(7), CHANCE.standard_normal(7), CHANCE.standard_normal(7)
    put_missed(row, measured, read, 1.1, -0.2, 0.5)
    assert row == pytest.approx((measured - 1.1 * read + 0.2) / 0.5, rel=1e-14)


@pytest.mark.parametrize("lengths", [(1, 2, 3), (4, 5, 16), (8,)])
def test_moves_of_starts_are_those_of_the_normal_equations(lengths: tuple[int, ...]) -> None:
    """Of stretches of any length, whole fours or not; what they leave is put in place where it is asked for."""
    begins, n_sample = np.cumsum([0, *lengths[:-1]]), sum(lengths)
    slopes, over = CHANCE.standard_normal((2, 3, n_sample)), CHANCE.standard_normal((2, 4, n_sample))
    inverse = CHANCE.standard_normal((len(lengths), 3, 3))
    expected, left = np.empty((4, len(lengths), 3)), over.copy()
    for m, (begin, length) in enumerate(zip(begins, lengths, strict=True)):
        part = slice(begin, begin + length)
        asked = np.einsum("ckn,crn->rk", slopes[:, :, part], over[:, :, part])
        expected[:, m] = -asked @ inverse[m].T
        left[:, :, part] += np.einsum("rk,ckn->crn", expected[:, m], slopes[:, :, part])
    moves, kept = np.empty_like(expected), over.copy()
    put_moves(moves, over, slopes, begins, inverse, False)
    assert moves == pytest.approx(expected, rel=1e-12, abs=1e-12)
    assert np.array_equal(over, kept)
    put_moves(moves, over, slopes, begins, inverse, True)
    assert moves == pytest.approx(expected, rel=1e-12, abs=1e-12)
    assert over == pytest.approx(left, rel=1e-12, abs=1e-12)


@pytest.mark.parametrize(("n", "lines"), [(8, 5), (8, 4), (9, 5), (9, 2)])
def test_lines_of_white_noise_have_its_variance_and_keep_its_power(n: int, lines: int) -> None:
    """All lines together have the power of the samples (Parseval); their order is piece, channel, real, imaginary."""
    values = CHANCE.standard_normal((2, 3, 4, n))
    numbers = np.empty((3, 4 * 2 * 2 * lines))
    put_lines(numbers, np.fft.rfft(values), n)
    if lines == n // 2 + 1:
        assert np.sum(numbers**2, axis=1) == pytest.approx(np.sum(values**2, axis=(0, 2, 3)), rel=1e-12)
    each = numbers.reshape(3, 4, 2, 2 * lines)
    assert each == pytest.approx(np.moveaxis(transformed(values, lines), 0, 2), rel=1e-12)
    turn = 2 * np.pi * np.arange(n) / n
    assert each[0, 1, 1, 1] == pytest.approx(np.sqrt(2 / n) * values[1, 0, 1] @ np.cos(turn), abs=1e-12)
    assert each[0, 1, 1, lines + 1] == pytest.approx(-np.sqrt(2 / n) * values[1, 0, 1] @ np.sin(turn), abs=1e-12)
    assert each[2, 3, 0, 0] == pytest.approx(values[0, 2, 3].sum() / np.sqrt(n), abs=1e-12)


def test_a_slope_is_kept_in_the_precision_of_its_column() -> None:
    before, behind = CHANCE.standard_normal((2, 5))
    column = np.empty(5, dtype=np.float32)
    put_slope(column, behind, before, 0.25)
    assert np.array_equal(column, ((behind - before) / 0.25).astype(np.float32))


def test_squares_are_summed_by_label() -> None:
    """Of labels in runs of any length, the last and single ones too."""
    labels = np.array([2, 2, 0, 0, 0, 2, 1])
    numbers, count, power = CHANCE.standard_normal(7), np.full(4, 0.5), np.ones(4)
    add_squares(count, power, numbers, labels)
    assert count == pytest.approx(0.5 + np.bincount(labels, minlength=4))
    assert power == pytest.approx(1.0 + np.bincount(labels, weights=numbers**2, minlength=4), rel=1e-14)


def test_the_gram_matrix_of_each_stretch_is_that_of_its_slopes() -> None:
    slopes, begins = CHANCE.standard_normal((2, 3, 23)), np.array([0, 4, 13])
    gram = np.empty((3, 3, 3))
    put_gram(gram, slopes, begins)
    for m, (begin, end) in enumerate([(0, 4), (4, 13), (13, 23)]):
        own = slopes[:, :, begin:end]
        assert gram[m] == pytest.approx(np.einsum("can,cbn->ab", own, own), rel=1e-12)
