"""Clearance of a path of poses from obstacles that stand where they are, between its samples too."""

from __future__ import annotations

import math

import numba
import numpy as np

from geodesic_motion_ros.geometry.distance_field import field_approach
from geodesic_motion_ros.geometry.shapes import solid_approach
from geodesic_motion_ros.obstacles.obstacles import Obstacles


@numba.njit(cache=True, nogil=True)
def segment_distance(begin: np.ndarray, end: np.ndarray, point: np.ndarray) -> float:
    """Return the distance [m] from a point (3,) to the segment between two points (3,)."""
    along, length = 0.0, 0.0
    for j in range(3):
        step = end[j] - begin[j]
        along += (point[j] - begin[j]) * step
        length += step * step
    share = 0.0 if length == 0.0 else min(1.0, max(0.0, along / length))
    squared = 0.0
    for j in range(3):
        gap = begin[j] + share * (end[j] - begin[j]) - point[j]
        squared += gap * gap
    return math.sqrt(squared)


def curve_clearances(
    points: np.ndarray, point_radii: np.ndarray, allowances: np.ndarray, obstacles: Obstacles
) -> np.ndarray:
    """Return the guaranteed clearance [m] of every stretch between successive samples, (n - 1,); inf without obstacles.

    Parameters
    ----------
    points : (n, K, 3) body points [m] at the samples; point_radii : (K,) [m].
    allowances : (n - 1, K) how far [m] a body point may leave the straight segment between two samples.
    obstacles : where they stand.

    The distance is that of the whole segment, less the allowance: a lower bound of the true clearance. From a point
    cloud it is known up to the reach of its field.
    """
    return _curve_clearances(
        points, point_radii, allowances, obstacles.centres, obstacles.radii, obstacles.solids, *obstacles.cloud
    )


@numba.njit(cache=True, nogil=True)
def _curve_clearances(
    points: np.ndarray,
    point_radii: np.ndarray,
    allowances: np.ndarray,
    centres: np.ndarray,
    radii: np.ndarray,
    solids: np.ndarray,
    squares: np.ndarray,
    placing: np.ndarray,
) -> np.ndarray:
    result = np.full(len(points) - 1, np.inf)
    for i in range(len(points) - 1):
        for k in range(points.shape[1]):
            for o in range(len(radii)):
                distance = segment_distance(points[i, k], points[i + 1, k], centres[o])
                result[i] = min(result[i], distance - radii[o] - point_radii[k] - allowances[i, k])
            inside = point_radii[k] + allowances[i, k]
            for b in range(len(solids)):
                bound = solid_approach(points[i, k], points[i + 1, k], solids, b, result[i] + inside)
                result[i] = min(result[i], bound - inside)
            if squares.size > 0:
                bound = field_approach(points[i, k], points[i + 1, k], squares, placing, result[i] + inside)
                result[i] = min(result[i], bound - inside)
    return result


def rotation_allowance(angles: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return how far tool points leave the chord while the tool turns by `angles` [rad] between samples, (n - 1, K)
    [m].

    Between samples the position is interpolated linearly and the orientation along the great circle, so a tool point at
    distance r from the tool's origin has an acceleration of r angle^2 in the interpolation parameter; a curve with
    second derivative at most c stays within c / 8 of its chord.
    """
    return np.linalg.norm(points, axis=1)[None, :] * (angles**2 / 8.0)[:, None]
