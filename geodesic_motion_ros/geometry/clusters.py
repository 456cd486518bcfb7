"""Clusters of a point cloud: what hangs together, by cubes that touch, with a corner too.

A cluster is covered by a few spheres: it is halved along its longest side, and so on, where that makes their volume
smaller. A camera sees the front alone. So a sphere is moved away from it until its front is where the points begin, and
made larger until it holds them again: what is seen is taken to be as deep as it is wide. Of a ball that makes the ball.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numba
import numpy as np

from geodesic_motion_ros.geometry.point_clouds import POINTS, VECTOR, corners

#: What is seen in fewer cubes may be an error of the camera, and is too small for a velocity.
FEWEST_CUBES = 4
#: A cluster is made of so many spheres at most, a power of two; one is halved where its parts have less than this share
#: of its volume.
MOST_PARTS, _WORTH_HALVING = 8, 0.85
#: Cubes are made larger where there would be more.
_MOST_CUBES = 8_000_000
_CUBES = numba.types.Array(numba.int32, 3, "C")
_NUMBERS = numba.types.Array(numba.int32, 1, "C")
_PLACES = numba.types.Array(numba.int32, 2, "C")


class Cluster(NamedTuple):
    """What hangs together in a cloud.

    Attributes
    ----------
    centre, half : (3,) middle and half extents of the box along the axes around its points [m].
    spheres : (k, 4) that cover the points and what is behind them: centres, radii [m].
    """

    centre: tuple[float, float, float]
    half: tuple[float, float, float]
    spheres: np.ndarray


@dataclass(frozen=True, eq=False)
class SplitCloud:
    """A cloud in two parts.

    Attributes
    ----------
    clusters : the largest first, by their cubes. rest : (k, 3) [m] the points that are in none of them.
    """

    clusters: tuple[Cluster, ...]
    rest: np.ndarray


def split_cloud(
    points: np.ndarray, edge: float, largest: float, most: int, viewpoint: np.ndarray | None = None
) -> SplitCloud:
    """Take the clusters out of a cloud (n, 3) [m], finite.

    Parameters
    ----------
    edge : of the cubes [m]; they are made larger where there would be too many.
    largest : what has a point farther [m] from its middle remains in the rest, as a table does.
    most : of so many clusters at most; what is beyond them remains too.
    viewpoint : (3,) [m] where it was seen from; None where that is unknown: nothing is taken to be behind the points.
    """
    points = np.ascontiguousarray(points)
    if not len(points):
        return SplitCloud((), points)
    lower, upper = corners(points)
    edge = max(edge, float(np.cbrt(np.prod(upper - lower + edge) / _MOST_CUBES)))
    # Cubes at whole multiples of the edge, with an empty one around them all.
    first = np.floor(lower / edge).astype(np.int32) - 1
    cubes = np.zeros(tuple(np.floor(upper / edge).astype(np.int32) - first + 2), dtype=np.int32)
    of_point, places = _sort_into_cubes(points, edge, first, cubes)
    of_cube, sizes = _join(places, cubes)
    boxes, radii = _bound(points, of_point, of_cube, len(sizes))
    fits = np.flatnonzero((radii <= largest) & (sizes >= FEWEST_CUBES))
    chosen = fits[np.argsort(-sizes[fits], kind="stable")][:most]
    if not len(chosen):
        return SplitCloud((), points)
    rank = np.full(len(sizes), len(chosen), dtype=np.int64)
    rank[chosen] = np.arange(len(chosen))
    of_point = rank[of_cube[of_point]]
    taken = np.flatnonzero(of_point < len(chosen))
    taken = taken[np.argsort(of_point[taken], kind="stable")]
    begins = np.searchsorted(of_point[taken], np.arange(len(chosen) + 1))
    eye = np.full(3, np.nan) if viewpoint is None else np.ascontiguousarray(viewpoint, dtype=float)
    clusters = []
    for i, begin, end in zip(chosen, begins[:-1], begins[1:], strict=True):
        middle, half = 0.5 * (boxes[i, :3] + boxes[i, 3:]), 0.5 * (boxes[i, 3:] - boxes[i, :3])
        spheres = _cover(points[taken[begin:end]], eye)
        clusters.append(Cluster(tuple(middle.tolist()), tuple(half.tolist()), spheres))
    return SplitCloud(tuple(clusters), points[of_point == len(chosen)])


@numba.njit((POINTS, numba.float64, _NUMBERS, _CUBES), cache=True, nogil=True)
def _sort_into_cubes(
    points: np.ndarray, edge: float, first: np.ndarray, cubes: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Number the cubes that hold points (n, 3): of each point (n,), and where each is, (c, 3).

    first : (3,) of the cubes, all 0, in which 1 + the numbers are written.
    """
    of_point, places, count = np.empty(len(points), dtype=np.int32), np.empty((1024, 3), dtype=np.int32), 0
    for n in range(len(points)):
        i = int(np.floor(points[n, 0] / edge)) - first[0]
        j = int(np.floor(points[n, 1] / edge)) - first[1]
        k = int(np.floor(points[n, 2] / edge)) - first[2]
        if cubes[i, j, k] == 0:
            if count == len(places):
                larger = np.empty((2 * count, 3), dtype=np.int32)
                larger[:count] = places
                places = larger
            places[count, 0], places[count, 1], places[count, 2] = i, j, k
            count += 1
            cubes[i, j, k] = count
        of_point[n] = cubes[i, j, k] - 1
    return of_point, places[:count]


@numba.njit((_PLACES, _CUBES), cache=True, nogil=True)
def _join(places: np.ndarray, cubes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Number what hangs together: of each cube at places (c, 3), and how many cubes each has."""
    of_cube, waiting = np.full(len(places), -1, dtype=np.int32), np.empty(len(places), dtype=np.int32)
    sizes, clusters = np.empty(len(places), dtype=np.int64), 0
    for start in range(len(places)):
        if of_cube[start] >= 0:
            continue
        of_cube[start], waiting[0], queued, size = clusters, start, 1, 0
        while queued > 0:
            queued -= 1
            cube = waiting[queued]
            size += 1
            i, j, k = places[cube, 0], places[cube, 1], places[cube, 2]
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


@numba.njit((POINTS, _NUMBERS, _NUMBERS, numba.int64), cache=True, nogil=True)
def _bound(
    points: np.ndarray, of_point: np.ndarray, of_cube: np.ndarray, clusters: int
) -> tuple[np.ndarray, np.ndarray]:
    """Find the boxes of so many clusters of points (n, 3), lower and upper corners (m, 6), and their radii (m,) [m]."""
    boxes, squares = np.empty((clusters, 6)), np.zeros(clusters)
    boxes[:, :3], boxes[:, 3:] = np.inf, -np.inf
    for n in range(len(points)):
        box = boxes[of_cube[of_point[n]]]
        for axis in range(3):
            box[axis] = min(box[axis], points[n, axis])
            box[3 + axis] = max(box[3 + axis], points[n, axis])
    for n in range(len(points)):
        cluster, square = of_cube[of_point[n]], 0.0
        for axis in range(3):
            square += (points[n, axis] - 0.5 * (boxes[cluster, axis] + boxes[cluster, 3 + axis])) ** 2
        squares[cluster] = max(squares[cluster], square)
    return boxes, np.sqrt(squares)


@numba.njit(cache=True, nogil=True)
def _middle(points: np.ndarray) -> tuple[np.ndarray, int]:
    """Find the middle of the box around points (n, 3), and its longest axis."""
    box = np.empty((2, 3))
    box[0], box[1] = points[0], points[0]
    for n in range(1, len(points)):
        for axis in range(3):
            box[0, axis] = min(box[0, axis], points[n, axis])
            box[1, axis] = max(box[1, axis], points[n, axis])
    return 0.5 * (box[0] + box[1]), int(np.argmax(box[1] - box[0]))


@numba.njit(cache=True, nogil=True)
def _farthest(points: np.ndarray, middle: np.ndarray) -> float:
    """Return how far the farthest of points (n, 3) is from a middle (3,) [m]."""
    square = 0.0
    for n in range(len(points)):
        x, y, z = points[n, 0] - middle[0], points[n, 1] - middle[1], points[n, 2] - middle[2]
        square = max(square, x * x + y * y + z * z)
    return np.sqrt(square)


@numba.njit(cache=True, nogil=True)
def _sphere(points: np.ndarray, middle: np.ndarray, eye: np.ndarray) -> tuple[np.ndarray, float]:
    """Find a sphere that holds points (n, 3) around a middle (3,), and what is behind them seen from an eye (3,)."""
    radius, away = _farthest(points, middle), middle - eye
    distance = np.sqrt(np.sum(away**2))
    # Neither where it is not known from where they were seen, nor from among them.
    if not distance > radius:
        return middle, radius
    away /= distance
    front = 0.0
    for n in range(len(points)):
        x, y, z = points[n, 0] - middle[0], points[n, 1] - middle[1], points[n, 2] - middle[2]
        front = max(front, -(x * away[0] + y * away[1] + z * away[2]))
    moved = middle + (radius - front) * away
    return moved, _farthest(points, moved)


@numba.njit((numba.types.Array(numba.float64, 2, "C"), VECTOR), cache=True, nogil=True)
def _cover(points: np.ndarray, eye: np.ndarray) -> np.ndarray:
    """Cover points (n, 3), which are sorted for that, by `MOST_PARTS` spheres at most: (k, 4) [m].

    eye : (3,) [m] where they were seen from; nan where that is unknown.
    """
    # The halves of node i of the tree are 2 i + 1 and 2 i + 2.
    nodes, inner = 2 * MOST_PARTS - 1, MOST_PARTS - 1
    ranges, spheres = np.zeros((nodes, 2), dtype=np.int64), np.zeros((nodes, 4))
    least, halved = np.full(nodes, np.inf), np.zeros(nodes, dtype=np.bool_)
    ranges[0, 1] = len(points)
    for node in range(nodes):
        begin, end = ranges[node]
        if begin == end:
            continue
        middle, axis = _middle(points[begin:end])
        spheres[node, :3], spheres[node, 3] = _sphere(points[begin:end], middle, eye)
        if node < inner and spheres[node, 3] > 0.0:
            half = begin
            for n in range(begin, end):
                if points[n, axis] < middle[axis]:
                    for k in range(3):
                        points[n, k], points[half, k] = points[half, k], points[n, k]
                    half += 1
            ranges[2 * node + 1, 0], ranges[2 * node + 1, 1] = begin, half
            ranges[2 * node + 2, 0], ranges[2 * node + 2, 1] = half, end
    for node in range(nodes - 1, -1, -1):
        if ranges[node, 0] < ranges[node, 1]:
            least[node] = spheres[node, 3] ** 3
            if node < inner:
                both = least[2 * node + 1] + least[2 * node + 2]
                if both < _WORTH_HALVING * least[node]:
                    least[node], halved[node] = both, True
    chosen, count = np.empty((MOST_PARTS, 4)), 0
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
