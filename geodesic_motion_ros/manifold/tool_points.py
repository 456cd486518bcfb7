"""Points fixed to the tool, where obstacles are felt, and how far they move while the tool does."""

from __future__ import annotations

import numba
import numpy as np


@numba.njit(cache=True, nogil=True)
def place_points(position: np.ndarray, quaternion: np.ndarray, points: np.ndarray, out: np.ndarray) -> None:
    """Write p + R(q) t for tool points t (K, 3) into out (K, 3): R t = t + 2 w (v x t) + 2 v x (v x t)."""
    w, x, y, z = quaternion[0], quaternion[1], quaternion[2], quaternion[3]
    for k in range(len(points)):
        tx, ty, tz = points[k, 0], points[k, 1], points[k, 2]
        cx, cy, cz = y * tz - z * ty, z * tx - x * tz, x * ty - y * tx
        out[k, 0] = position[0] + tx + 2.0 * (w * cx + y * cz - z * cy)
        out[k, 1] = position[1] + ty + 2.0 * (w * cy + z * cx - x * cz)
        out[k, 2] = position[2] + tz + 2.0 * (w * cz + x * cy - y * cx)


@numba.njit(cache=True, nogil=True)
def tool_points(positions: np.ndarray, quaternions: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Points (K, 3) fixed in the tool frame [m], seen from the base at tool poses (n, 3), (n, 4): (n, K, 3)."""
    out = np.empty((len(positions), len(points), 3))
    for i in range(len(positions)):
        place_points(positions[i], quaternions[i], points, out[i])
    return out
