"""Smoothing of a path: of the latent polyline that a search has found, and of the poses decoded from it."""

from __future__ import annotations

import math

import numba
import numpy as np

from geodesic_motion_ros.geometry.curves import Pose, arc_length_fractions
from geodesic_motion_ros.geometry.quaternions import normalise, rotation_vector_between
from geodesic_motion_ros.geometry.se3 import carried
from geodesic_motion_ros.manifold.metric_field import evenly


def resample_latent(path: np.ndarray, spacing: float, minimum: int = 40) -> np.ndarray:
    """Return points (n, d) evenly spaced by latent arc length on a polyline (m, d), at most `spacing` apart, ends kept.

    Of a polyline of one point, as of a tool that is at its goal, that point `minimum` times.
    """
    if len(path) == 1:
        return np.repeat(path, minimum, axis=0)
    length = float(np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))[-1])
    return evenly(path, max(minimum, math.ceil(length / spacing) + 1) - 1)


def smooth_latent(points: np.ndarray, width: float) -> np.ndarray:
    """Smooth, by a Gaussian, an evenly spaced curve (n, d) with both ends fixed.

    `width` is the Gaussian's standard deviation in samples, at most a quarter of the curve. The curve is
    continued beyond each end by point reflection, which is odd about the end, so the filtered one passes through it.
    """
    if width <= 0.0:
        return points
    width = min(width, (len(points) - 1) / 4.0)
    weights = np.exp(-0.5 * (np.arange(int(4.0 * width + 0.5) + 1) / width) ** 2)
    return _filtered(np.ascontiguousarray(points), weights / (2.0 * np.sum(weights) - weights[0]))


@numba.njit(cache=True, nogil=True)
def _filtered(points: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Points (n, d) as weighted means of those up to r < n samples away on both sides, weights (r + 1,)."""
    last = len(points) - 1
    result = points.copy()
    for i in range(1, last):
        for a in range(points.shape[1]):
            mean = weights[0] * points[i, a]
            for k in range(1, len(weights)):
                before, after = points[abs(i - k), a], points[last - abs(last - i - k), a]
                if k > i:
                    before = 2.0 * points[0, a] - before
                if k > last - i:
                    after = 2.0 * points[last, a] - after
                mean += weights[k] * (before + after)
            result[i, a] = mean
    return result


def smooth_poses(positions: np.ndarray, quaternions: np.ndarray, width: float) -> tuple[np.ndarray, np.ndarray]:
    """Smooth, as `smooth_latent` does, a pose curve (n, 3), (n, 4) in one hemisphere; rotations between neighbours must
    be small.
    """
    smooth = smooth_latent(np.concatenate([positions, quaternions], axis=1), width)
    return np.ascontiguousarray(smooth[:, :3]), normalise(smooth[:, 3:])


def correct_ends(
    positions: np.ndarray, quaternions: np.ndarray, start: Pose, goal: Pose
) -> tuple[np.ndarray, np.ndarray]:
    """Move a pose curve (n, 3), (n, 4) so that it begins and ends at the given poses (position, quaternion).

    Both offsets, of position and of rotation vector, fade linearly with arc length towards the other end.
    """
    at_start, at_goal = (
        np.concatenate([position - positions[at], rotation_vector_between(quaternions[at], quaternion)])
        for at, (position, quaternion) in ((0, start), (-1, goal))
    )
    share = arc_length_fractions(positions)[:, None]
    return carried(positions, quaternions, (1.0 - share) * at_start + share * at_goal)
