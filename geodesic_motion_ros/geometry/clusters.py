"""Clusters of a point cloud: what hangs together, by cubes that touch, with a corner too.

What hangs together is covered by a few spheres: it is cut in two across an axis, where the volume of both spheres is
smallest, and the larger parts again, as long as that makes it smaller. A camera sees the front alone. So a sphere has
its front where the points begin, and is as deep as these are wide. Points on a ball are not cut: they are of that ball,
however little of it is seen.

A point may be the mean of those in a cube, with their covariance: a patch of a surface. It reaches sqrt(3) deviations
beyond its mean, as a flat face does; an edge or a corner reaches little farther, so that boxes are held too.
"""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

import numba
import numpy as np

from geodesic_motion_ros.geometry.point_clouds import POINTS, VECTOR, corners
from geodesic_motion_ros.geometry.voxels import NUMBERS, PLACES, WHOLE

#: Points are cut in two where the spheres of the parts have less than this share of the volume of theirs; but not where
#: they are inside of theirs by no more than this on average [m], nor where it is no larger than this [m].
_WORTH_CUTTING, _INSIDE, _SMALLEST = 0.85, 0.010, 0.05
#: So many patches or more are of a ball where they deviate from its surface by no more than this [m], and it is no
#: larger than so many times the sphere that holds them otherwise. Such a part counts with this share of its volume, so
#: that cuts find balls.
_BALL_PATCHES, BALL_DEVIATION, _BALL_SIZE, _BALL_SHARE = 8, 0.003, 1.5, 0.25
# Steps in which a ball is fit: it begins with one that is off by little.
_FIT_STEPS = 4
#: Along each axis a cut is looked for at multiples of this part of the length.
_CUTS = 6

# Points (n, 3) [m] and spreads (n, 6) [m^2], as of `Cluster.of`.
Known: TypeAlias = tuple[np.ndarray, np.ndarray]


class Cluster(NamedTuple):
    """What hangs together in a cloud.

    Attributes
    ----------
    centre, half : (3,) middle and half extents of the box along the axes around its points [m].
    points : (n, 3) that are seen [m]. covered : (m, 3) these, or all that are known of what stands [m].
    spheres : (k, 4) that cover those and what is behind them: centres, radii [m].
    ball : (4,) the ball that the points are of: centre, radius of a sphere that holds them [m]; None where there is
        none.
    stands : whether it is known to stand. number : the same in every cloud, 0 where it is not known. part_of : what it
        was a part of in the cloud before, or 0.
    """

    centre: tuple[float, float, float]
    half: tuple[float, float, float]
    points: np.ndarray
    covered: np.ndarray
    spheres: np.ndarray
    ball: np.ndarray | None = None
    stands: bool = False
    number: int = 0
    part_of: int = 0

    @classmethod
    def of(
        cls,
        points: np.ndarray,
        most: int,
        eye: np.ndarray | None,
        spreads: np.ndarray | None = None,
        known: Known | None = None,
    ) -> Cluster:
        """Make one of points (n, 3) [m] that are seen.

        most : of so many spheres at most.
        eye : (3,) [m] where they were seen from; None where that is unknown: nothing is taken to be behind them.
        spreads : (n, 6) xx, yy, zz, xy, xz, yz [m^2] of the covariance of those that each one is the mean of.
        known : the points and spreads that are known of what stands, and are covered; None: what is seen is covered.
        """
        seen_from = np.full(3, np.nan) if eye is None else np.ascontiguousarray(eye, dtype=float)
        patches = np.column_stack([points, np.zeros((len(points), 6)) if spreads is None else spreads])
        lower, upper = corners(points)
        middle, half = 0.5 * (lower + upper), 0.5 * (upper - lower)
        centre, radius, _, is_ball = _sphere(patches, seen_from)
        covered = points if known is None else known[0]
        spheres = _cover(patches if known is None else np.column_stack(known), most, seen_from)
        ball = np.array([*centre, radius]) if is_ball else None
        return cls(tuple(middle.tolist()), tuple(half.tolist()), points, covered, spheres, ball, known is not None)


@numba.njit((PLACES, NUMBERS, WHOLE, WHOLE, POINTS, numba.float64), cache=True, nogil=True)
def hanging_together(
    places: np.ndarray, cubes: np.ndarray, first: np.ndarray, kinds: np.ndarray, means: np.ndarray, gap: float
) -> tuple[np.ndarray, np.ndarray]:
    """Number what hangs together: of each cube at places (v, 3) (v,), and how many cubes each has (m,).

    cubes : 1 + the numbers of the cubes in a grid, others are 0 or less. first : (3,) place of its lower corner.
    kinds : (v,) those of different kinds do not hang together, nor do those whose means (v, 3) are farther apart than
    a gap [m].
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
                        if other < 0 or of_cube[other] >= 0 or kinds[other] != kinds[cube]:
                            continue
                        square = 0.0
                        for axis in range(3):
                            square += (means[other, axis] - means[cube, axis]) ** 2
                        if square <= gap**2:
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
def _extent(patch: np.ndarray, x: float, y: float, z: float) -> float:
    """Return how far points reach beyond their mean along a direction, times its length [m]."""
    square = x * x * patch[3] + y * y * patch[4] + z * z * patch[5]
    square += 2.0 * (x * y * patch[6] + x * z * patch[7] + y * z * patch[8])
    return np.sqrt(3.0 * max(0.0, square))


@numba.njit(cache=True, nogil=True)
def _distances(patches: np.ndarray, middle: np.ndarray) -> tuple[float, float]:
    """Return how far the farthest point of patches (n, 9) is from a middle (3,), and how far their own ones are on
    average [m].
    """
    farthest, sum_ = 0.0, 0.0
    for n in range(len(patches)):
        patch = patches[n]
        x, y, z = patch[0] - middle[0], patch[1] - middle[1], patch[2] - middle[2]
        away = np.sqrt(x * x + y * y + z * z)
        if away > 0.0:
            away += _extent(patch, x, y, z) / away
        farthest, sum_ = max(farthest, away), sum_ + away
    return farthest, sum_ / len(patches)


@numba.njit(cache=True, nogil=True)
def _ball_distances(patches: np.ndarray, middle: np.ndarray) -> tuple[float, float]:
    """Return what `_distances` does, of patches of a ball around a middle (3,): how far most of them reach beyond their
    means across its surface is noise of the camera.
    """
    reaches, extents = np.empty(len(patches)), np.empty(len(patches))
    for n in range(len(patches)):
        x, y, z = patches[n, 0] - middle[0], patches[n, 1] - middle[1], patches[n, 2] - middle[2]
        away = np.sqrt(x * x + y * y + z * z)
        extents[n] = _extent(patches[n], x, y, z) / away if away > 0.0 else 0.0
        reaches[n] = away + extents[n]
    noise = np.median(extents)
    return np.max(reaches) - noise, np.mean(reaches) - noise


@numba.njit(cache=True, nogil=True)
def _across(away: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Make two directions (3,) that are perpendicular to one and to each other."""
    one = np.zeros(3)
    one[np.argmin(np.abs(away))] = 1.0
    one -= away * np.sum(one * away)
    one /= np.sqrt(np.sum(one**2))
    return one, np.cross(away, one)


@numba.njit(cache=True, nogil=True)
def _range(patches: np.ndarray, axis: np.ndarray) -> tuple[float, float]:
    """Return from where to where patches (n, 9) reach along a direction (3,) [m]."""
    low, high = np.inf, -np.inf
    for n in range(len(patches)):
        patch = patches[n]
        at = patch[0] * axis[0] + patch[1] * axis[1] + patch[2] * axis[2]
        extent = _extent(patch, axis[0], axis[1], axis[2])
        low, high = min(low, at - extent), max(high, at + extent)
    return low, high


@numba.njit(cache=True, nogil=True)
def _ball(patches: np.ndarray) -> tuple[np.ndarray, float]:
    """Fit a ball to the means of patches (n, 9), four at least: its middle, and the deviation of the means from its
    surface [m]; inf where they are on a plane.

    With m = the mean of all means p, |p - m|^2 = 2 (p - m) . c + d is linear in c and d = r^2 - |c|^2, where m + c is
    the middle and r the radius: least squares (I. Kasa, "A circle fitting procedure and its error analysis", IEEE
    Transactions on Instrumentation and Measurement 1976).
    """
    count, mean = len(patches), np.zeros(3)
    for n in range(count):
        mean += patches[n, :3] / count
    products, right, square = np.zeros((3, 3)), np.zeros(3), 0.0
    for n in range(count):
        away = patches[n, :3] - mean
        from_mean = np.sum(away**2)
        square += from_mean / count
        for row in range(3):
            right[row] += 0.5 * away[row] * from_mean
            for column in range(3):
                products[row, column] += away[row] * away[column]
    a, b, c = products[0], products[1], products[2]
    determinant = np.sum(a * np.cross(b, c))
    if not determinant > 1e-9 * square**3 * count**3:
        return mean, np.inf
    offset = (right[0] * np.cross(b, c) + right[1] * np.cross(c, a) + right[2] * np.cross(a, b)) / determinant
    middle, radius, error = mean + offset, np.sqrt(square + np.sum(offset**2)), 0.0
    for n in range(count):
        error += (np.sqrt(np.sum((patches[n, :3] - middle) ** 2)) - radius) ** 2 / count
    return middle, np.sqrt(error)


@numba.njit((POINTS, VECTOR, numba.float64, numba.float64), cache=True, nogil=True)
def ball_of_radius(points: np.ndarray, expected: np.ndarray, radius: float, weight: float) -> tuple[np.ndarray, float]:
    """Fit a ball of a radius [m] to points (n, 3) [m], whose middle is expected at (3,) [m], which counts as so many
    points: its middle, and the deviation of points from its surface [m].

    Gauss-Newton: with distances d and directions u of the points from the middle c, w the weight and e what is
    expected, (w 1 + sum u u^T) (c' - c) = sum (d - radius) u + w (e - c).
    """
    found = expected.copy()
    for _ in range(_FIT_STEPS):
        products, right = (weight + 1e-9) * np.eye(3), weight * (expected - found)
        for n in range(len(points)):
            away = points[n] - found
            distance = max(np.sqrt(np.sum(away**2)), 1e-9)
            for row in range(3):
                right[row] += (1.0 - radius / distance) * away[row]
                for column in range(3):
                    products[row, column] += away[row] * away[column] / distance**2
        found += np.linalg.solve(products, right)
    error = 0.0
    for n in range(len(points)):
        error += (np.sqrt(np.sum((points[n] - found) ** 2)) - radius) ** 2 / len(points)
    return found, np.sqrt(error)


@numba.njit((numba.types.Array(numba.float64, 2, "C"), VECTOR), cache=True, nogil=True)
def _sphere(patches: np.ndarray, eye: np.ndarray) -> tuple[np.ndarray, float, float, bool]:
    """Find a sphere that holds patches (n, 9) and what is behind them, seen from an eye (3,): its middle and radius,
    how far inside of it the farthest points of each are on average, and whether it is a ball that they are of.
    """
    lower, upper = corners(patches)
    middle = 0.5 * (lower + upper)
    (radius, mean), away = _distances(patches, middle), middle - eye
    distance = np.sqrt(np.sum(away**2))
    # Neither where it is not known from where they were seen, nor from among them.
    if not distance > radius:
        return middle, radius, radius - mean, False
    away /= distance
    (one, other), (front, back) = _across(away), _range(patches, away)
    (left, right), (down, up) = _range(patches, one), _range(patches, other)
    wide = 0.0
    for n in range(len(patches)):
        patch = patches[n]
        x = patch[0] * one[0] + patch[1] * one[1] + patch[2] * one[2] - 0.5 * (left + right)
        y = patch[0] * other[0] + patch[1] * other[1] + patch[2] * other[2] - 0.5 * (down + up)
        square = x * x + y * y
        if square > 0.0:
            toward = (x * one + y * other) / np.sqrt(square)
            wide = max(wide, np.sqrt(square) + _extent(patch, toward[0], toward[1], toward[2]))
    deep = front + max(wide, 0.5 * (back - front))
    middle = deep * away + 0.5 * (left + right) * one + 0.5 * (down + up) * other
    radius, mean = _distances(patches, middle)
    if len(patches) >= _BALL_PATCHES:
        ball, deviation = _ball(patches)
        if deviation <= BALL_DEVIATION:
            ball_radius, ball_mean = _ball_distances(patches, ball)
            if ball_radius <= _BALL_SIZE * radius:
                return ball, ball_radius, ball_radius - ball_mean, True
    return middle, radius, radius - mean, False


@numba.njit(cache=True, nogil=True)
def _volume(radius: float, is_ball: bool) -> float:
    """Return what the volume of a sphere counts for."""
    return radius**3 * (_BALL_SHARE if is_ball else 1.0)


@numba.njit(cache=True, nogil=True)
def _sort_by(patches: np.ndarray, axis: int, where: float) -> int:
    """Sort patches (n, 9) so that those below a place [m] on an axis are first, and return how many these are."""
    half = 0
    for n in range(len(patches)):
        if patches[n, axis] < where:
            for k in range(9):
                patches[n, k], patches[half, k] = patches[half, k], patches[n, k]
            half += 1
    return half


@numba.njit(cache=True, nogil=True)
def _part(patches: np.ndarray, eye: np.ndarray) -> int:
    """Sort patches (n, 9) into two parts, by the cut across an axis with which the volume of both spheres is smallest,
    and return how many the first one has.
    """
    lower, upper = corners(patches)
    best, best_axis, best_where = np.inf, 0, upper[0]
    for axis in range(3):
        for cut in range(1, _CUTS):
            where = lower[axis] + cut / _CUTS * (upper[axis] - lower[axis])
            half = _sort_by(patches, axis, where)
            if half == 0 or half == len(patches):
                continue
            one, other = _sphere(patches[:half], eye), _sphere(patches[half:], eye)
            volume = _volume(one[1], one[3]) + _volume(other[1], other[3])
            if volume < best:
                best, best_axis, best_where = volume, axis, where
    return _sort_by(patches, best_axis, best_where)


@numba.njit((numba.types.Array(numba.float64, 2, "C"), numba.int64, VECTOR), cache=True, nogil=True)
def _cover(patches: np.ndarray, most: int, eye: np.ndarray) -> np.ndarray:
    """Cover patches (n, 9), which are sorted for that, by so many spheres at most: (k, 4) [m].

    eye : (3,) [m] where they were seen from; nan where that is unknown.
    """
    # A tree: the two parts of a node are its first part and the node after that; 0 for none.
    first_part, count = np.zeros(2 * most, dtype=np.int64), 1
    ranges, spheres = np.zeros((2 * most, 2), dtype=np.int64), np.zeros((2 * most, 4))
    # How large those are that may be cut, and which are balls.
    sizes, balls = np.zeros(2 * most), np.zeros(2 * most, dtype=np.bool_)
    ranges[0, 1] = len(patches)
    spheres[0, :3], spheres[0, 3], inside, balls[0] = _sphere(patches, eye)
    sizes[0] = spheres[0, 3] if inside > _INSIDE else 0.0
    while count + 1 < 2 * most:
        node = int(np.argmax(sizes[:count]))
        if not sizes[node] > _SMALLEST:
            break
        begin, end = ranges[node]
        half = begin + _part(patches[begin:end], eye)
        first_part[node], sizes[node] = count, 0.0
        for first, last in ((begin, half), (half, end)):
            ranges[count, 0], ranges[count, 1] = first, last
            spheres[count, :3], spheres[count, 3], inside, balls[count] = _sphere(patches[first:last], eye)
            sizes[count] = spheres[count, 3] if inside > _INSIDE else 0.0
            count += 1
    # Parts that are not smaller together are left out.
    least, whole = np.empty(count), np.ones(count, dtype=np.bool_)
    for node in range(count - 1, -1, -1):
        least[node], part = _volume(spheres[node, 3], balls[node]), first_part[node]
        if part > 0 and least[part] + least[part + 1] < _WORTH_CUTTING * least[node]:
            least[node], whole[node] = least[part] + least[part + 1], False
    chosen = np.zeros(count, dtype=np.bool_)
    chosen[0] = True
    for node in range(count):
        if chosen[node] and not whole[node]:
            part = first_part[node]
            chosen[node], chosen[part], chosen[part + 1] = False, True, True
    return spheres[:count][chosen]
