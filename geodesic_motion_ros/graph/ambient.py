"""The ambient metric: how obstacles stretch the space around the robot's body points.

The paper's factor of an obstacle with radius r at o is m(p) = 1 + zeta exp(-|p - o|^2 / (2 r^2)); several obstacles
add. The Gaussian never ends, so it is shifted to reach zero, continuously, at CUTOFF widths:

    m(p) = 1 + zeta sum_o max(0, (exp(-|p - o|^2 / (2 s^2)) - c) / (1 - c)),   c = exp(-CUTOFF^2 / 2)

Beyond the cut m is exactly 1: an obstacle that leaves also leaves no trace in the weights.
"""

from __future__ import annotations

import math

import numba
import numpy as np

#: Distance, in Gaussian widths, at which an obstacle's influence has fallen to nothing (from 1.1 % before the shift).
CUTOFF = 3.0
_SHIFT = math.exp(-0.5 * CUTOFF**2)


@numba.njit(cache=True, nogil=True)
def ambient_factor(
    x: float,
    y: float,
    z: float,
    point_radius: float,
    centres: np.ndarray,
    radii: np.ndarray,
    strength: float,
    width_ratio: float,
) -> float:
    """Ambient factor m >= 1 of a body point (x, y, z) [m].

    Parameters
    ----------
    point_radius : of the sphere that the point carries [m].
    centres, radii : (o, 3), (o,) obstacles [m]. The Gaussian's width is s = width_ratio (radius + point radius):
        the obstacle grown by the body, as seen by the body's centre.
    strength : zeta.
    """
    factor = 1.0
    for o in range(len(radii)):
        width = width_ratio * (radii[o] + point_radius)
        dx, dy, dz = x - centres[o, 0], y - centres[o, 1], z - centres[o, 2]
        squared = dx * dx + dy * dy + dz * dz
        if squared < (CUTOFF * width) ** 2:
            factor += strength * (math.exp(-0.5 * squared / (width * width)) - _SHIFT) / (1.0 - _SHIFT)
    return factor


@numba.njit(cache=True, nogil=True)
def clearances(
    points: np.ndarray, point_radii: np.ndarray, centres: np.ndarray, radii: np.ndarray, within: float
) -> np.ndarray:
    """Smallest surface-to-surface distance [m] from each row of body points (n, K, 3) to any obstacle, (n,).

    Negative inside; inf where no obstacle is nearer than `within` [m].
    """
    result = np.full(len(points), np.inf)
    for o in range(len(radii)):
        for k in range(points.shape[1]):
            both = radii[o] + point_radii[k]
            reach = (both + within) ** 2
            for i in range(len(points)):
                dx = points[i, k, 0] - centres[o, 0]
                dy = points[i, k, 1] - centres[o, 1]
                dz = points[i, k, 2] - centres[o, 2]
                squared = dx * dx + dy * dy + dz * dz
                if squared < reach:
                    result[i] = min(result[i], math.sqrt(squared) - both)
    return result
