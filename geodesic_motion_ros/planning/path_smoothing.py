"""Smoothing of a path: of the latent polyline that a search has found, and of the poses decoded from it."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter1d

from geodesic_motion_ros.demonstrations.curves import Pose, arc_length_fractions
from geodesic_motion_ros.graph.transport import carried
from geodesic_motion_ros.quaternions import normalise, rotation_vector_between


def resample_latent(path: np.ndarray, spacing: float, minimum: int = 40) -> np.ndarray:
    """Points (n, d) evenly spaced by latent arc length on a polyline (m, d), at most `spacing` apart, ends kept."""
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    count = max(minimum, int(np.ceil(length[-1] / spacing)) + 1)
    at = np.linspace(0.0, length[-1], count)
    return np.stack([np.interp(at, length, column) for column in path.T], axis=1)


def smooth_latent(points: np.ndarray, width: float) -> np.ndarray:
    """Gaussian smoothing of an evenly spaced curve (n, d) with both ends fixed.

    `width` is the Gaussian's standard deviation in samples, at most a quarter of the curve. The curve is
    continued beyond each end by point reflection, which is odd about the end, so the filtered one passes through it.
    """
    if width <= 0.0:
        return points
    width = min(width, (len(points) - 1) / 4.0)
    pad = int(np.ceil(4.0 * width))
    before = 2.0 * points[0] - points[pad:0:-1]
    after = 2.0 * points[-1] - points[-2 : -pad - 2 : -1]
    smooth = gaussian_filter1d(np.concatenate([before, points, after]), width, axis=0, truncate=4.0)[pad:-pad]
    smooth[0], smooth[-1] = points[0], points[-1]
    return smooth


def smooth_poses(positions: np.ndarray, quaternions: np.ndarray, width: float) -> tuple[np.ndarray, np.ndarray]:
    """The same for a pose curve (n, 3), (n, 4) in one hemisphere; rotations between neighbours must be small."""
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
