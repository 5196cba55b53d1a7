"""How far the straight lines between a map's gaps may lie above its curve, and how wrong the curve may be."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
ERROR_REACH = 1  # gaps on either side whose relative errors count, as a difference of two meshes may pass through zero


def neighbours_counted(current: Array, error: Array) -> Array:
    """(n_level, n_gap) A: each error, of the current, at least as large as that of the neighbouring gaps."""
    relative = np.where(np.isnan(current), 0.0, error / np.where(np.isnan(current), 1.0, current))
    padded = np.pad(relative, ((0, 0), (ERROR_REACH, ERROR_REACH)), mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * ERROR_REACH + 1, axis=1)
    return np.asarray(windows.max(axis=2) * np.nan_to_num(current))


def chord_allowance(
    gap: Array, current: Array, slope: Array, *, error: Array, section: tuple[tuple[str, ...], ...]
) -> Array:
    """(n_level, n_gap) A: the errors of the currents, and how far the curve may sag below its chords.

    A chord's slope exceeds the curve's at its left end by a, and lies below that at its right end by b. A convex curve
    stays above both its tangents, so below the chord by at most h a b/(a + b) <= h max(a, b)/2, h the interval; a
    concave one above the chord; of a cubic with one turning point it is 4/27 h max(a, b). Where the loading section
    changes within, twice that. A node takes the larger allowance of its two intervals.
    """
    h = np.diff(gap)
    chord = np.diff(current, axis=1) / h
    # a node without a slope lies beyond the map's end, where the curve is cut: that only lowers chords
    left = np.nan_to_num(chord - slope[:, :-1], nan=0.0)
    right = np.nan_to_num(slope[:, 1:] - chord, nan=0.0)
    names = np.array(section)
    share = np.where(names[:, 1:] == names[:, :-1], 0.5, 1.0)
    sag = share * h * np.maximum(np.maximum(left, right), 0.0) + np.maximum(error[:, :-1], error[:, 1:])
    return np.asarray(np.maximum(np.pad(sag, ((0, 0), (1, 0))), np.pad(sag, ((0, 0), (0, 1)))))
