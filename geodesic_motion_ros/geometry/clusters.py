"""Clusters of a point cloud: what hangs together, by cubes that touch, with a corner too.

A cluster is covered by a few spheres: it is cut in two across an axis, where the larger of their spheres is smallest,
and so on, as long as that makes their volume smaller. A camera sees the front alone. So a sphere is moved away from it
until its front is where the points begin, and made larger until it holds them again: what is seen is taken to be as
deep as it is wide. Of a ball that makes the ball.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from geodesic_motion_ros.geometry.point_clouds import POINTS, VECTOR, corners
from geodesic_motion_ros.geometry.voxels import NUMBERS, PLACES, WHOLE

#: A sphere is halved where its parts have less than this share of its volume; but not where the points are inside of it
#: by no more than this on average [m], as noise makes those of the front of a ball; nor one that is no larger [m].
_WORTH_HALVING, _INSIDE, _SMALLEST = 0.85, 0.016, 0.04
#: Along each axis a cut is looked for at multiples of this part of the length.
_CUTS = 6


class Cluster(NamedTuple):
    """What hangs together in a cloud.

    Attributes
    ----------
    centre, half : (3,) middle and half extents of the box along the axes around its points [m].
    points : (n, 3) [m]. spheres : (k, 4) that cover them and what is behind them: centres, radii [m].
    stands : whether it is known to stand.
    """

    centre: tuple[float, float, float]
    half: tuple[float, float, float]
    points: np.ndarray
    spheres: np.ndarray
    stands: bool = False

    @classmethod
    def of(cls, points: np.ndarray, most: int, stands: bool, eye: np.ndarray | None) -> Cluster:
        """Make one of points (n, 3) [m].

        most : of so many spheres at most, a power of two.
        eye : (3,) [m] where they were seen from; None where that is unknown: nothing is taken to be behind them.
        """
        lower, upper = corners(points)
        seen_from = np.full(3, np.nan) if eye is None else np.ascontiguousarray(eye, dtype=float)
        middle, half = 0.5 * (lower + upper), 0.5 * (upper - lower)
        return cls(tuple(middle.tolist()), tuple(half.tolist()), points, _cover(points.copy(), most, seen_from), stands)


@numba.njit((PLACES, NUMBERS, WHOLE), cache=True, nogil=True)
def hanging_together(places: np.ndarray, cubes: np.ndarray, first: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Number what hangs together: of each cube at places (v, 3) (v,), and how many cubes each has (m,).

    cubes : 1 + the numbers of the cubes in a grid, others are 0 or less. first : (3,) place of its lower corner.
    """
    of_cube, waiting = np.full(len(places), -1), np.empty(len(places), dtype=np.int64)
    sizes, clusters = np.empty(len(places), dtype=np.int64), 0
    for start in range(len(places)):
        if of_cube[start] >= 0:
            continue
        of_cube[start], waiting[0], queued, size = clusters, start, 1, 0
        while queued > 0:
            queued -= 1
            cube = waiting[queued]
            size += 1
            i, j, k = places[cube, 0] - first[0], places[cube, 1] - first[1], places[cube, 2] - first[2]
            for a in range(i - 1, i + 2):
                for b in range(j - 1, j + 2):
                    for c in range(k - 1, k + 2):
                        other = cubes[a, b, c] - 1
                        if other >= 0 and of_cube[other] < 0:
                            of_cube[other] = clusters
                            waiting[queued] = other
                            queued += 1
        sizes[clusters] = size
        clusters += 1
    return of_cube, sizes[:clusters]


@numba.njit((POINTS, WHOLE, numba.int64), cache=True, nogil=True)
def cluster_radii(points: np.ndarray, of_point: np.ndarray, clusters: int) -> np.ndarray:
    """Find how far points (n, 3) of so many clusters are from the middles of their boxes at most: (m,) [m]."""
    boxes, squares = np.empty((clusters, 6)), np.zeros(clusters)
    boxes[:, :3], boxes[:, 3:] = np.inf, -np.inf
    for n in range(len(points)):
        box = boxes[of_point[n]]
        for axis in range(3):
            box[axis] = min(box[axis], points[n, axis])
            box[3 + axis] = max(box[3 + axis], points[n, axis])
    for n in range(len(points)):
        cluster, square = of_point[n], 0.0
        for axis in range(3):
            square += (points[n, axis] - 0.5 * (boxes[cluster, axis] + boxes[cluster, 3 + axis])) ** 2
        squares[cluster] = max(squares[cluster], square)
    return np.sqrt(squares)


@numba.njit(cache=True, nogil=True)
def _distances(points: np.ndarray, middle: np.ndarray) -> tuple[float, float]:
    """Return how far the farthest of points (n, 3) is from a middle (3,), and how far they are on average [m]."""
    square, sum_ = 0.0, 0.0
    for n in range(len(points)):
        x, y, z = points[n, 0] - middle[0], points[n, 1] - middle[1], points[n, 2] - middle[2]
        away = x * x + y * y + z * z
        square, sum_ = max(square, away), sum_ + np.sqrt(away)
    return np.sqrt(square), sum_ / len(points)


@numba.njit(cache=True, nogil=True)
def _sphere(points: np.ndarray, eye: np.ndarray) -> tuple[np.ndarray, float, float]:
    """Find a sphere that holds points (n, 3) and what is behind them, seen from an eye (3,): its middle and radius,
    and how far inside of it the points are on average.
    """
    lower, upper = corners(points)
    middle = 0.5 * (lower + upper)
    (radius, mean), away = _distances(points, middle), middle - eye
    distance = np.sqrt(np.sum(away**2))
    # Neither where it is not known from where they were seen, nor from among them.
    if not distance > radius:
        return middle, radius, radius - mean
    away /= distance
    front = 0.0
    for n in range(len(points)):
        x, y, z = points[n, 0] - middle[0], points[n, 1] - middle[1], points[n, 2] - middle[2]
        front = max(front, -(x * away[0] + y * away[1] + z * away[2]))
    moved = middle + (radius - front) * away
    radius, mean = _distances(points, moved)
    return moved, radius, radius - mean


@numba.njit(cache=True, nogil=True)
def _sort_by(points: np.ndarray, axis: int, where: float) -> int:
    """Sort points (n, 3) so that those below a place [m] on an axis are first, and return how many these are."""
    half = 0
    for n in range(len(points)):
        if points[n, axis] < where:
            for k in range(3):
                points[n, k], points[half, k] = points[half, k], points[n, k]
            half += 1
    return half


@numba.njit(cache=True, nogil=True)
def _part(points: np.ndarray, eye: np.ndarray) -> int:
    """Sort points (n, 3) into two parts, by the cut across an axis with which the larger of their spheres is smallest,
    and return how many the first one has.
    """
    lower, upper = corners(points)
    best, best_axis, best_where = np.inf, 0, upper[0]
    for axis in range(3):
        for cut in range(1, _CUTS):
            where = lower[axis] + cut / _CUTS * (upper[axis] - lower[axis])
            half = _sort_by(points, axis, where)
            if half == 0 or half == len(points):
                continue
            larger = max(_sphere(points[:half], eye)[1], _sphere(points[half:], eye)[1])
            if larger < best:
                best, best_axis, best_where = larger, axis, where
    return _sort_by(points, best_axis, best_where)


@numba.njit((numba.types.Array(numba.float64, 2, "C"), numba.int64, VECTOR), cache=True, nogil=True)
def _cover(points: np.ndarray, most: int, eye: np.ndarray) -> np.ndarray:
    """Cover points (n, 3), which are sorted for that, by so many spheres at most, a power of two: (k, 4) [m].

    eye : (3,) [m] where they were seen from; nan where that is unknown.
    """
    # The halves of node i of the tree are 2 i + 1 and 2 i + 2.
    nodes, inner = 2 * most - 1, most - 1
    ranges, spheres = np.zeros((nodes, 2), dtype=np.int64), np.zeros((nodes, 4))
    least, halved = np.full(nodes, np.inf), np.zeros(nodes, dtype=np.bool_)
    ranges[0, 1] = len(points)
    for node in range(nodes):
        begin, end = ranges[node]
        if begin == end:
            continue
        spheres[node, :3], radius, inside = _sphere(points[begin:end], eye)
        spheres[node, 3] = radius
        if node < inner and radius > _SMALLEST and inside > _INSIDE:
            half = begin + _part(points[begin:end], eye)
            ranges[2 * node + 1, 0], ranges[2 * node + 1, 1] = begin, half
            ranges[2 * node + 2, 0], ranges[2 * node + 2, 1] = half, end
    for node in range(nodes - 1, -1, -1):
        if ranges[node, 0] < ranges[node, 1]:
            least[node] = spheres[node, 3] ** 3
            if node < inner:
                both = least[2 * node + 1] + least[2 * node + 2]
                if both < _WORTH_HALVING * least[node]:
                    least[node], halved[node] = both, True
    chosen, count = np.empty((most, 4)), 0
    waiting, queued = np.zeros(nodes, dtype=np.int64), 1
    while queued > 0:
        queued -= 1
        node = waiting[queued]
        if halved[node]:
            waiting[queued], waiting[queued + 1] = 2 * node + 1, 2 * node + 2
            queued += 2
        else:
            chosen[count] = spheres[node]
            count += 1
    return chosen[:count]
