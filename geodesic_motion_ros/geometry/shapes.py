"""Solids: boxes, capsules and whatever a box rounded by a sphere can be, as obstacles.

One shape says all: a box with half extents h, turned by a rotation R about its centre c, and grown by a radius r. A box
has r = 0, a capsule h = (0, 0, l), a sphere h = 0. The signed distance of a point p from its surface is

    d(p) = |max(q, 0)| + min(max_i q_i, 0) - r,   q = |R^T (p - c)| - h,

a convex function of p, for the solid is convex. Compiled code reads solids as rows of 16 numbers: centre (3), half
extents (3), radius (1), rotation (9, row by row; its columns are the box's axes).
"""

from __future__ import annotations

import math

import numba
import numpy as np

#: Numbers of a row.
NUMBERS = 16
#: What `solid_approach` may lose [m].
_TOLERANCE = 5e-4


def no_solids() -> np.ndarray:
    """Rows (0, 16)."""
    return np.empty((0, NUMBERS))


def solid_rows(centres: np.ndarray, rotations: np.ndarray, half_extents: np.ndarray, radii: np.ndarray) -> np.ndarray:
    """Rows (b, 16) of solids with centres (b, 3) [m], rotations (b, 3, 3), half extents (b, 3) and radii (b,) [m]."""
    turned = np.reshape(rotations, (-1, 9))
    return np.concatenate([centres, half_extents, np.reshape(radii, (-1, 1)), turned], axis=1).astype(float)


def solids_moved(solids: np.ndarray, rotation: np.ndarray, translation: np.ndarray) -> np.ndarray:
    """Solids (b, 16) after p -> rotation p + translation, (3, 3) and (3,) [m]."""
    moved = solids.copy()
    moved[:, :3] = solids[:, :3] @ rotation.T + translation
    moved[:, 7:] = (rotation @ solids[:, 7:].reshape(-1, 3, 3)).reshape(-1, 9)
    return moved


def bounding_radii(solids: np.ndarray) -> np.ndarray:
    """Radii (b,) [m] of spheres around the centres that hold solids (b, 16)."""
    return np.linalg.norm(solids[:, 3:6], axis=1) + solids[:, 6]


def thicknesses(solids: np.ndarray) -> np.ndarray:
    """Radii (b,) [m] of the largest spheres inside solids (b, 16): min_i h_i + r."""
    return solids[:, 3:6].min(axis=1, initial=math.inf) + solids[:, 6]


def cylinder_distances(points: np.ndarray, radius: float, height: float) -> np.ndarray:
    """Signed distances (n,) [m] of points (n, 3) from a cylinder about the origin, its axis z, negative inside."""
    beside = np.hypot(points[:, 0], points[:, 1]) - radius
    beyond = np.abs(points[:, 2]) - 0.5 * height
    outside = np.hypot(np.maximum(beside, 0.0), np.maximum(beyond, 0.0))
    return outside + np.minimum(np.maximum(beside, beyond), 0.0)


@numba.njit(cache=True, nogil=True)
def solid_distance(x: float, y: float, z: float, solids: np.ndarray, b: int) -> float:
    """Signed distance [m] of a point from the surface of solid b of (., 16), negative inside."""
    dx, dy, dz = x - solids[b, 0], y - solids[b, 1], z - solids[b, 2]
    squared, largest = 0.0, -math.inf
    for axis in range(3):
        along = solids[b, 7 + axis] * dx + solids[b, 10 + axis] * dy + solids[b, 13 + axis] * dz
        q = abs(along) - solids[b, 3 + axis]
        largest = max(largest, q)
        if q > 0.0:
            squared += q * q
    return math.sqrt(squared) + min(largest, 0.0) - solids[b, 6]


@numba.njit(cache=True, nogil=True)
def solid_distances(points: np.ndarray, solids: np.ndarray) -> np.ndarray:
    """Smallest signed distance [m] of points (n, 3) from any of the solids (b, 16): (n,), inf without solids."""
    result = np.full(len(points), np.inf)
    for b in range(len(solids)):
        for i in range(len(points)):
            result[i] = min(result[i], solid_distance(points[i, 0], points[i, 1], points[i, 2], solids, b))
    return result


@numba.njit(cache=True, nogil=True)
def solid_approach(begin: np.ndarray, end: np.ndarray, solids: np.ndarray, b: int, worth: float) -> float:
    """Lower bound [m] of the signed distance of a segment, from begin (3,) to end (3,), from solid b of (., 16).

    It is 0.5 mm less than the smallest distance at most; where that is not below `worth` [m], it may be any number from
    `worth` on.

    The distance is convex along the segment: the smallest lies beside the smallest of three samples. In an interval of
    length l it is no more than l / 2 smaller than in its middle.
    """
    x, y, z = begin[0], begin[1], begin[2]
    dx, dy, dz = end[0] - x, end[1] - y, end[2] - z
    middle, half = 0.5, 0.5
    length = math.sqrt(dx * dx + dy * dy + dz * dz)
    nearest = solid_distance(x + middle * dx, y + middle * dy, z + middle * dz, solids, b)
    while half * length > _TOLERANCE and nearest - half * length < worth:
        half *= 0.5
        for side in (-half, half):
            share = middle + side
            distance = solid_distance(x + share * dx, y + share * dy, z + share * dz, solids, b)
            if distance < nearest:
                middle, nearest = share, distance
                break
    return nearest - half * length
