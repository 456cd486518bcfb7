"""The cubic spline through points, with ends of three kinds.

Its second derivative is continuous, and linear between knots. An end piece is a parabola, the same cubic as the next
piece ("not a knot"), or has a slope. A path that is cut off bends at its new begin as it bent there before, which it
would not with a second derivative of 0. The second derivatives at the knots solve a tridiagonal system (C. de Boor, "A
Practical Guide to Splines", ch. IV).
"""

from __future__ import annotations

import numba
import numpy as np

#: The second derivative at an end is a sum of those at the next two knots, times such numbers, and of a constant.
_PARABOLA, _SLOPE = (1.0, 0.0), (-0.5, 0.0)


def spline_bends(knots: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return the second derivatives (n, d) at knots (n,), increasing, of the spline through values (n, d) whose end
    pieces are parabolas; two points make a line.
    """
    if len(knots) == 2:
        return np.zeros_like(values)
    return _bends(knots, values, np.array([_PARABOLA, _PARABOLA]), np.zeros((2, values.shape[1])))


def spline_bends_between(
    knots: np.ndarray, values: np.ndarray, begin: np.ndarray | None, end: np.ndarray | None
) -> np.ndarray:
    """Return the second derivatives (n, d) at knots (n,), increasing, of the spline through values (n, d).

    begin, end : its slopes (d,) there; None: the end piece is the same cubic as the next, which takes four points.
    """
    pieces, chords = np.diff(knots), np.diff(values[[0, 1, -2, -1]], axis=0)[::2]
    first, at_begin = _end(begin, pieces[:2], chords[0])
    last, at_end = _end(end, pieces[:-3:-1], chords[1])
    return _bends(knots, values, np.array([first, last]), np.stack([at_begin, -at_end]))


def _end(slope: np.ndarray | None, pieces: np.ndarray, chord: np.ndarray) -> tuple[tuple[float, float], np.ndarray]:
    """Weights and constant (d,) of an end with a slope; the lengths of its pieces, and the chord (d,) of the outer."""
    piece = float(pieces[0])
    if slope is None:
        share = piece / float(pieces[1])
        return (1.0 + share, -share), np.zeros_like(chord)
    return _SLOPE, 3.0 / piece * (chord / piece - slope)


@numba.njit(cache=True, nogil=True)
def _bends(knots: np.ndarray, values: np.ndarray, weights: np.ndarray, constants: np.ndarray) -> np.ndarray:
    """The second derivatives (n, d), where those at the ends are sums with weights (2, 2) and constants (2, d)."""
    count, size = values.shape
    bends, factors = np.empty((count, size)), np.empty(count)
    bends[0], factors[0] = constants[0], -weights[0, 0]
    for i in range(1, count - 1):
        before, after = knots[i] - knots[i - 1], knots[i + 1] - knots[i]
        pivot = 2.0 * (before + after) - before * factors[i - 1]
        # The first one counts the next but one, too.
        factors[i] = (after + (before * weights[0, 1] if i == 1 else 0.0)) / pivot
        for j in range(size):
            turn = (values[i + 1, j] - values[i, j]) / after - (values[i, j] - values[i - 1, j]) / before
            bends[i, j] = (6.0 * turn - before * bends[i - 1, j]) / pivot
    # The last one is a sum of two that depend on it themselves.
    next_one, pivot = weights[1, 0], 1.0 + weights[1, 0] * factors[count - 2]
    if count > 3:
        next_one -= weights[1, 1] * factors[count - 3]
        pivot = 1.0 + next_one * factors[count - 2]
    for j in range(size):
        value = constants[1, j] + next_one * bends[count - 2, j]
        if count > 3:
            value += weights[1, 1] * bends[count - 3, j]
        bends[count - 1, j] = value / pivot
    for i in range(count - 2, -1, -1):
        for j in range(size):
            bends[i, j] -= factors[i] * bends[i + 1, j]
    if count > 2:
        for j in range(size):
            bends[0, j] += weights[0, 1] * bends[2, j]
    return bends


@numba.njit(cache=True, nogil=True)
def spline_samples(knots: np.ndarray, values: np.ndarray, bends: np.ndarray, at: np.ndarray) -> np.ndarray:
    """The spline and its first and second derivatives (3, k, d) at `at` (k,); its end pieces go on beyond the ends."""
    count, size = values.shape
    result = np.empty((3, len(at), size))
    for k in range(len(at)):
        i = min(max(int(np.searchsorted(knots, at[k], side="right")) - 1, 0), count - 2)
        h, x = knots[i + 1] - knots[i], at[k] - knots[i]
        for j in range(size):
            b = bends[i, j]
            change = (bends[i + 1, j] - b) / h
            slope = (values[i + 1, j] - values[i, j]) / h - h * (2.0 * b + bends[i + 1, j]) / 6.0
            result[0, k, j] = values[i, j] + x * (slope + x * (b / 2.0 + x * change / 6.0))
            result[1, k, j] = slope + x * (b + x * change / 2.0)
            result[2, k, j] = b + x * change
    return result
