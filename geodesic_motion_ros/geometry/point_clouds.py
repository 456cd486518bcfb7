"""Passes over the points of large clouds, as fast as memory is: numpy's take ten times as long along short rows."""

from __future__ import annotations

import math

import numba
import numpy as np

#: What was seen and is not seen any more counts for so long [s] after it was last seen, unless that is ruled out.
MOMENT = 0.5
#: Written signatures: compiled at the first import, not with the first cloud.
VECTOR = numba.types.Array(numba.float64, 1, "C", readonly=True)
POINTS = numba.types.Array(numba.float64, 2, "C", readonly=True)


@numba.njit((POINTS, POINTS, VECTOR), cache=True, nogil=True)
def carry_finite(points: np.ndarray, rotation: np.ndarray, origin: np.ndarray) -> tuple[np.ndarray, float]:
    """Copy the finite ones of points (n, 3) [m], R p + o, and find the largest coordinate before that: (k, 3), [m].

    rotation, origin : R (3, 3) and o (3,) [m] of their frame in another one.
    """
    carried, count, largest = np.empty((len(points), 3)), 0, 0.0
    for n in range(len(points)):
        x, y, z = points[n, 0], points[n, 1], points[n, 2]
        if not (math.isfinite(x) and math.isfinite(y) and math.isfinite(z)):
            continue
        largest = max(largest, max(abs(x), max(abs(y), abs(z))))
        for row in range(3):
            carried[count, row] = origin[row] + rotation[row, 0] * x + rotation[row, 1] * y + rotation[row, 2] * z
        count += 1
    return carried[:count], largest


@numba.njit((POINTS,), cache=True, nogil=True)
def corners(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Find the smallest and the largest coordinates (3,) of points (n, 3) or more, of which there is one at least."""
    lower, upper = points[0, :3].copy(), points[0, :3].copy()
    for n in range(1, len(points)):
        for axis in range(3):
            lower[axis] = min(lower[axis], points[n, axis])
            upper[axis] = max(upper[axis], points[n, axis])
    return lower, upper
