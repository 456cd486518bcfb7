"""LineOfSight: how far a camera sees in every direction, by one of its clouds.

Directions from the eye are sorted into the squares of a cube's six sides, half a degree wide, and the nearest point of
each square is known. What is behind it is hidden. What is before all points of a square and of those beside it would be
seen, were it there: it is seen through. Where a square holds no point nothing is known.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np

from geodesic_motion_ros.geometry.point_clouds import POINTS, VECTOR

#: Squares along an edge of a side.
SQUARES = 180
#: What is nearer or farther than a point by no more than this [m] is neither before nor behind it: noise, and surfaces
#: that are seen at a flat angle.
TOLERANCE = 0.05
NEAREST = numba.types.Array(numba.float32, 3, "C")


class LineOfSight(NamedTuple):
    """What one cloud shows of what can be seen.

    Attributes
    ----------
    eye : (3,) [m] where it was seen from. nearest : (6, SQUARES, SQUARES) squared distance of the nearest point [m^2];
        inf where there is none.
    """

    eye: np.ndarray
    nearest: np.ndarray

    @classmethod
    def blank(cls, eye: np.ndarray | None) -> LineOfSight:
        """Make one without a point; eye : None where that is unknown: nothing is hidden, and nothing seen through."""
        unknown = np.full(3, np.nan)
        sides = 0 if eye is None else 6
        return cls(
            unknown if eye is None else np.ascontiguousarray(eye, dtype=float),
            np.full((sides, SQUARES, SQUARES), np.inf, dtype=np.float32),
        )

    def hides(self, points: np.ndarray) -> np.ndarray:
        """Tell which points (n, 3) [m] are behind what is seen: (n,) bool."""
        distances, nearest, _ = self._look(points)
        return nearest < distances - TOLERANCE

    def hides_beside(self, points: np.ndarray) -> np.ndarray:
        """Tell which points (n, 3) [m] are behind what is seen, or beside such a place: (n,) bool."""
        distances, _, around = self._look(points)
        return around < distances - TOLERANCE

    def sees_through(self, points: np.ndarray) -> np.ndarray:
        """Tell in which places (n, 3) [m] something would be seen, and is not: (n,) bool."""
        distances, _, around = self._look(points)
        return np.isfinite(around) & (around > distances + TOLERANCE)

    def _look(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        if not len(self.nearest):
            return np.zeros(len(points)), *np.full((2, len(points)), np.inf)
        return _look(np.ascontiguousarray(points), self.eye, self.nearest)


@numba.njit(cache=True, nogil=True, inline="always")
def square_of(x: float, y: float, z: float) -> tuple[int, int, int]:
    """Find side, row and column of the direction (x, y, z)."""
    a, b, c = abs(x), abs(y), abs(z)
    if a >= b and a >= c:
        side, longest, u, v = 0 if x > 0.0 else 1, a, y, z
    elif b >= c:
        side, longest, u, v = 2 if y > 0.0 else 3, b, x, z
    else:
        side, longest, u, v = 4 if z > 0.0 else 5, c, x, y
    half = 0.5 * SQUARES
    # An eye is in no square, and what is where it is in any.
    scale = half / longest if longest > 0.0 else 0.0
    row, column = int(half + scale * u), int(half + scale * v)
    return side, min(row, SQUARES - 1), min(column, SQUARES - 1)


@numba.njit((POINTS, VECTOR, NEAREST), cache=True, nogil=True)
def _look(points: np.ndarray, eye: np.ndarray, nearest: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Find distances of points (n, 3) from the eye, of what is nearest in their squares, and in those around, (n,)."""
    distances, own, around = np.empty(len(points)), np.empty(len(points)), np.empty(len(points))
    for n in range(len(points)):
        x, y, z = points[n, 0] - eye[0], points[n, 1] - eye[1], points[n, 2] - eye[2]
        side, row, column = square_of(x, y, z)
        distances[n], own[n] = math.sqrt(x * x + y * y + z * z), math.sqrt(nearest[side, row, column])
        least = np.inf
        for i in range(max(0, row - 1), min(SQUARES, row + 2)):
            for j in range(max(0, column - 1), min(SQUARES, column + 2)):
                least = min(least, nearest[side, i, j])
        around[n] = math.sqrt(least)
    return distances, own, around
