"""Spheres that cover an arm's collision meshes, as the sphere file of a robot's folder has them.

A convex mesh is covered by few spheres by greedy set cover (Chvatal 1979): of all candidate spheres take the one that
covers most of what is still bare, until nothing is. Candidates have their centres on a grid inside the mesh and stick
out of none of its planes by more than a given protrusion. What has to be covered are small triangles of the surface,
each by one sphere, and the grid points inside; a sphere that holds the corners of a triangle holds all of it, so
nothing of the surface stays bare between samples. At last every sphere shrinks as far as the others allow.
"""

from __future__ import annotations

import math

import numba
import numpy as np
from scipy.spatial import ConvexHull

from geodesic_motion_ros.utils.errors import ParameterError

PROTRUSION = 0.03
"""How far [m] spheres may stick out of the planes of a mesh, unless set otherwise."""
TRIANGLE = 0.4
"""Longest edge, in protrusions, of the surface triangles that one sphere has to cover."""
SPACING = 1.0 / 3.0
"""Distance, in protrusions, between the grid points that centres are chosen from."""
SAME_RADIUS = 1e-9
"""Radii that differ by no more [m] are equal."""
MESH_MARGIN = 0.001
"""Radius [m] that PyBullet adds to a mesh."""
DECIMALS = 4
"""Digits [m] to which a sphere file is rounded, radii upwards."""


def file_spheres(vertices: np.ndarray, protrusion: float) -> np.ndarray:
    """Spheres (S, 4) as a file has them: those of `cover` with PyBullet's margin, rounded without losing anything."""
    spheres = cover(vertices, protrusion)
    centres = np.round(spheres[:, :3], DECIMALS)
    moved = np.linalg.norm(centres - spheres[:, :3], axis=1)
    radii = np.ceil((spheres[:, 3] + moved + MESH_MARGIN) * 10**DECIMALS) / 10**DECIMALS
    return np.column_stack([centres, radii]) + 0.0  # which turns -0.0 into 0.0


def cover(vertices: np.ndarray, protrusion: float = PROTRUSION) -> np.ndarray:
    """Spheres (S, 4), centre and radius [m], that hold the whole convex hull of vertices (V, 3) [m].

    No sphere sticks out of a plane of the hull by more than `protrusion` [m]. The same vertices give the same spheres
    on the same machine; on another one, rounding may choose differently between candidates that cover equally much.

    Raises
    ------
    ParameterError : the hull is so thin, compared with the protrusion, that no grid point lies inside near enough.
    """
    hull = ConvexHull(vertices)
    centres = _grid(vertices, SPACING * protrusion)
    depths = np.min(-(centres @ hull.equations[:, :3].T) - hull.equations[:, 3], axis=1)
    centres, depths = centres[depths > 0.0], depths[depths > 0.0]
    triangles = _subdivided(vertices[hull.simplices], TRIANGLE * protrusion)
    edges = triangles[:, 1:] - triangles[:, :1]
    sizes = 0.5 * np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    # far less than the surface, yet enough to decide between spheres that cover no more of it
    sizes = np.concatenate([sizes, np.full(len(centres), 1e-9 * np.sum(sizes))])
    # whole numbers, whose sums depend on no order: equals are equal, and a mirrored body has mirrored spheres
    sizes = np.round(sizes * (1e12 / np.sum(sizes))).astype(np.int64)
    radii = depths + protrusion
    corners, corner_of = np.unique(triangles.reshape(-1, 3), axis=0, return_inverse=True)
    targets = corners, np.ascontiguousarray(corner_of.reshape(-1, 3)), centres
    chosen, covered = _chosen(centres, radii, *targets, sizes)
    if not covered:
        raise ParameterError(
            f"protrusion is {protrusion} m: with centres {SPACING * protrusion:.4f} m apart that do not cover a body "
            f"of {np.round(np.ptp(vertices, axis=0), 3).tolist()} m; take another one"
        )
    reaches = np.array([_reaches(centre, *targets) for centre in centres[chosen]])
    return _shrunk(centres[chosen], radii[chosen], reaches)


@numba.njit(cache=True, nogil=True)
def _distance(one: np.ndarray, other: np.ndarray) -> float:
    return math.sqrt((one[0] - other[0]) ** 2 + (one[1] - other[1]) ** 2 + (one[2] - other[2]) ** 2)


@numba.njit(cache=True, nogil=True)
def _reaches(centre: np.ndarray, corners: np.ndarray, corner_of: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Radii (T + G,) [m] from which on a sphere about a centre holds each triangle, corner_of (T, 3), and each point.
    """
    around = np.empty(len(corners))
    for corner in range(len(corners)):
        around[corner] = _distance(centre, corners[corner])
    found = np.empty(len(corner_of) + len(points))
    for i in range(len(corner_of)):
        found[i] = max(around[corner_of[i, 0]], around[corner_of[i, 1]], around[corner_of[i, 2]])
    for i in range(len(points)):
        found[len(corner_of) + i] = _distance(centre, points[i])
    return found


@numba.njit(cache=True, nogil=True)
def _chosen(
    centres: np.ndarray, radii: np.ndarray, corners: np.ndarray, corner_of: np.ndarray, points: np.ndarray,
    sizes: np.ndarray,
) -> tuple[np.ndarray, bool]:  # fmt: skip
    """Numbers of the spheres that greedy set cover takes, and whether they hold all, targets as of `_reaches`.

    Of those that gain equally much the smallest is taken. What a sphere gains shrinks as others are taken: so the gains
    of earlier rounds are bounds, and only those are worked out again that may be the largest (M. Minoux, "Accelerated
    greedy algorithms", 1978).
    """
    gains = np.full(len(centres), np.iinfo(np.int64).max)
    # what is still bare stands first: triangles with their sizes, and points, by columns, with theirs
    faces, areas = corner_of.copy(), sizes[: len(corner_of)].copy()
    places, worths = points.T.copy(), sizes[len(corner_of) :].copy()
    at, holds, inside = corners.T.copy(), np.empty(len(corners), np.bool_), np.empty(len(points), np.bool_)
    taken = np.empty(len(sizes), dtype=np.int64)
    count, triangles, others = 0, len(areas), len(worths)
    while triangles + others > 0:
        best, most, rest = -1, 0, np.sum(worths[:others])
        for number in np.argsort(-gains, kind="mergesort"):
            if gains[number] < max(most, 1):
                break
            _hold(centres[number], radii[number], at, len(holds), holds)
            gain = 0
            for i in range(triangles):
                if holds[faces[i, 0]] and holds[faces[i, 1]] and holds[faces[i, 2]]:
                    gain += areas[i]
            if gain + rest < most:  # it cannot be the best: a bound of its gain is enough
                gains[number] = gain + rest
                continue
            _hold(centres[number], radii[number], places, others, inside)
            for i in range(others):
                gain += worths[i] if inside[i] else 0
            gains[number] = gain
            if gain > most or (gain == most > 0 and radii[number] < radii[best] - SAME_RADIUS):
                best, most = number, gain
        if best < 0:
            return taken[:count], False
        taken[count] = best
        count += 1
        _hold(centres[best], radii[best], at, len(holds), holds)
        left = 0
        for i in range(triangles):
            if not (holds[faces[i, 0]] and holds[faces[i, 1]] and holds[faces[i, 2]]):
                areas[left] = areas[i]
                for k in range(3):
                    faces[left, k] = faces[i, k]
                left += 1
        triangles = left
        _hold(centres[best], radii[best], places, others, inside)
        left = 0
        for i in range(others):
            if not inside[i]:
                worths[left] = worths[i]
                for k in range(3):
                    places[k, left] = places[k, i]
                left += 1
        others = left
    return taken[:count], True


@numba.njit(cache=True, nogil=True)
def _hold(centre: np.ndarray, radius: float, places: np.ndarray, count: int, held: np.ndarray) -> None:
    """Fill in which of the first `count` places, columns (3, n), a sphere holds."""
    for i in range(count):
        x, y, z = centre[0] - places[0, i], centre[1] - places[1, i], centre[2] - places[2, i]
        held[i] = math.sqrt(x * x + y * y + z * z) <= radius


def _grid(vertices: np.ndarray, spacing: float) -> np.ndarray:
    """Grid points (G, 3) in the box of vertices, symmetric about its middle."""
    lowest, highest = vertices.min(axis=0), vertices.max(axis=0)
    counts = np.floor(0.5 * (highest - lowest) / spacing).astype(int)
    steps = [spacing * np.arange(-count, count + 1) for count in counts]
    return np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1).reshape(-1, 3) + 0.5 * (lowest + highest)


def _subdivided(triangles: np.ndarray, longest: float) -> np.ndarray:
    """Triangles (T, 3, 3) halved at their longest edges until none is longer than `longest`."""
    finished = []
    while len(triangles):
        lengths = np.linalg.norm(triangles - np.roll(triangles, -1, axis=1), axis=2)
        long = lengths.max(axis=1) > longest
        finished.append(triangles[~long])
        rows, first = np.arange(np.sum(long)), np.argmax(lengths[long], axis=1)
        one, other, opposite = (triangles[long][rows, (first + number) % 3] for number in range(3))
        middle = 0.5 * (one + other)
        triangles = np.concatenate([np.stack([one, middle, opposite], 1), np.stack([middle, other, opposite], 1)])
    return np.concatenate(finished)


def _shrunk(centres: np.ndarray, radii: np.ndarray, reaches: np.ndarray) -> np.ndarray:
    """Spheres (S, 4) that hold the same together: each, the largest first, keeps what no other holds."""
    radii = radii.copy()
    for sphere in np.argsort(-radii, kind="stable"):
        others = np.arange(len(radii)) != sphere
        alone = ~np.any(reaches[others] <= radii[others, None], axis=0)
        radii[sphere] = np.max(reaches[sphere, alone], initial=0.0)
    return np.column_stack([centres, radii])[radii > 0.0]
