"""The cubic spline through points whose first and last pieces are parabolas.

Its second derivative is continuous, linear between knots, and constant on the end pieces: a path that is cut off bends
at its new begin as it bent there before, which it would not with a second derivative of 0. The values at the knots
solve a tridiagonal system (C. de Boor, "A Practical Guide to Splines", ch. IV).
"""

from __future__ import annotations

import numba
import numpy as np


@numba.njit(cache=True, nogil=True)
def spline_bends(knots: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Second derivatives (n, d) at knots (n,), increasing, of the spline through values (n, d); two make a line."""
    count, size = values.shape
    bends, factors = np.zeros((count, size)), np.zeros(count)
    if count == 2:
        return bends
    factors[0] = -1.0
    for i in range(1, count - 1):
        before, after = knots[i] - knots[i - 1], knots[i + 1] - knots[i]
        pivot = 2.0 * (before + after) - before * factors[i - 1]
        factors[i] = after / pivot
        for j in range(size):
            turn = (values[i + 1, j] - values[i, j]) / after - (values[i, j] - values[i - 1, j]) / before
            bends[i, j] = (6.0 * turn - before * bends[i - 1, j]) / pivot
    for j in range(size):
        bends[-1, j] = bends[-2, j] / (1.0 + factors[-2])
    for i in range(count - 2, -1, -1):
        for j in range(size):
            bends[i, j] -= factors[i] * bends[i + 1, j]
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
