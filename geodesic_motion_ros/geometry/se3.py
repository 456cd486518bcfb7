"""Poses moved by displacements: a translation [m] and a rotation vector [rad], both in the base frame."""

from __future__ import annotations

import math

import numba
import numpy as np


def carried(
    positions: np.ndarray, quaternions: np.ndarray, displacements: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Copies of poses (n, 3), (n, 4), moved by displacements (n, 6)."""
    moved, turned = np.array(positions, order="C"), np.array(quaternions, order="C")
    _carry_all(moved, turned, displacements)
    return moved, turned


@numba.njit(cache=True, nogil=True)
def carry(position: np.ndarray, quaternion: np.ndarray, displacement: np.ndarray) -> None:
    """In place: x + D_x and exp(D_r) q, for a displacement D (6,)."""
    for j in range(3):
        position[j] += displacement[j]
    x, y, z = displacement[3], displacement[4], displacement[5]
    angle = math.sqrt(x * x + y * y + z * z)
    scale = 0.5 if angle < 1e-9 else math.sin(0.5 * angle) / angle
    a, b, c, d = math.cos(0.5 * angle), scale * x, scale * y, scale * z
    w, i, j, k = quaternion[0], quaternion[1], quaternion[2], quaternion[3]
    quaternion[0] = a * w - b * i - c * j - d * k
    quaternion[1] = a * i + b * w + c * k - d * j
    quaternion[2] = a * j - b * k + c * w + d * i
    quaternion[3] = a * k + b * j - c * i + d * w


@numba.njit(cache=True, nogil=True)
def _carry_all(positions: np.ndarray, quaternions: np.ndarray, displacements: np.ndarray) -> None:
    for i in range(len(displacements)):
        carry(positions[i], quaternions[i], displacements[i])
