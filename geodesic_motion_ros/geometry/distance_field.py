"""DistanceField: how far every place of the workspace is from the nearest point of a cloud, at least.

Space is divided into cubes; a cube that holds points of the cloud is occupied. The field holds, for the middle of every
cube, the squared distance D^2 from the nearest middle of an occupied one, exactly (P. Felzenszwalb and D. Huttenlocher,
"Distance Transforms of Sampled Functions", Theory of Computing 2012), but no more than that of REACH. Between middles,

    D(p)^2 >= sum_i w_i D(p_i)^2 - sum_a u_a (1 - u_a) c^2

with the trilinear weights w of the eight middles p_i around p, shares u of an edge c along each axis: D^2 - |p|^2 is
the smallest of linear functions, so it is concave and no smaller than what is interpolated, and that |p|^2 is larger
when interpolated is what is taken off. A point of the cloud is within c sqrt(3) / 2 of the middle of its cube.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np

from geodesic_motion_ros.geometry.point_clouds import corners
from geodesic_motion_ros.utils.checked_numbers import real_array
from geodesic_motion_ros.utils.errors import PlanningError

#: Distances are computed up to here [m].
REACH = 0.3
#: Cubes are made larger where there would be more.
_MOST_CUBES = 1_000_000
#: What `field_approach` may lose [m].
_TOLERANCE = 1e-3


class DistanceField(NamedTuple):
    """Distances from a cloud; compiled kernels read it.

    Attributes
    ----------
    squares : (x, y, z) float32 squared distances of the middles of cubes from occupied ones [edges^2].
    placing : (15,) the matrix (3, 4), row by row, that turns a point into numbers of cubes along the axes, whole ones
        at their middles; then the edge of a cube [m], the radius [m] around middles of occupied cubes that holds the
        points' spheres, and the thickness [m] of what the cloud shows, as the ambient metric sees it.
    """

    squares: np.ndarray
    placing: np.ndarray

    @classmethod
    def none(cls) -> DistanceField:
        """Of a cloud without points."""
        return _NONE

    @classmethod
    def of(cls, points: np.ndarray, edge: float, radius: float, thickness: float) -> DistanceField:
        """From points (n, 3) [m], which should be no more than is near.

        Parameters
        ----------
        edge : of the cubes [m]; they are made larger where a million would not suffice.
        radius : of a sphere around every point [m].
        thickness : R of the ambient factor [m]: how early the soft metric feels the cloud.

        Raises
        ------
        PlanningError : a number is not finite, or edge, radius or thickness not positive.
        """
        points = np.ascontiguousarray(real_array("points of a cloud", points, ("n", 3)))
        if not np.all(np.isfinite(points)):
            raise PlanningError("points of a cloud must be finite")
        if not all(math.isfinite(value) and value > 0.0 for value in (edge, radius, thickness)):
            raise PlanningError(f"edge {edge}, radius {radius} and thickness {thickness} must be finite and positive")
        if not len(points):
            return cls.none()
        lower, upper = corners(points)
        edge = _edge(lower, upper, edge)
        margin = math.ceil(REACH / edge) + 1
        # Middles at whole multiples of the edge: a scene that stands has the same cubes in every cloud.
        first = np.rint(lower / edge).astype(np.int64) - margin
        shape = np.rint(upper / edge).astype(np.int64) + margin + 1 - first
        squares = _squares(points, first, shape, edge, math.floor((REACH / edge) ** 2))
        to_cubes = np.column_stack([np.eye(3) / edge, -first])
        surface = radius + 0.5 * math.sqrt(3.0) * edge
        return cls(squares, np.concatenate([to_cubes.ravel(), [edge, surface, thickness]]))

    @classmethod
    def of_cubes(cls, places: np.ndarray, edge: float, radius: float, thickness: float) -> DistanceField:
        """From cubes at places (n, 3), whole multiples of their edge [m], each of which stands for all points in it.

        radius, thickness : as of `of`.
        """
        if not len(places):
            return cls.none()
        middles = edge * places
        if _edge(*corners(middles), edge) > edge:
            # Middles of larger cubes are not those of these.
            radius += 0.5 * math.sqrt(3.0) * edge
        return cls.of(middles, edge, radius, thickness)

    def same_as(self, other: DistanceField) -> bool:
        """Whether another is the same field at the same place: of the same cloud, not of one that is alike."""
        return self.squares is other.squares and np.array_equal(self.placing, other.placing)

    def enlarged(self, by: float) -> DistanceField:
        """Of a cloud whose points have so much larger spheres around them [m]."""
        if not self.squares.size:
            return self
        placing = self.placing.copy()
        placing[13] += by
        return DistanceField(self.squares, placing)

    @property
    def edge(self) -> float:
        """Of a cube [m]."""
        return float(self.placing[12])

    @property
    def surface(self) -> float:
        """Radius [m] around the middles of occupied cubes that holds the spheres around the cloud's points."""
        return float(self.placing[13])

    @property
    def thickness(self) -> float:
        """Of what the cloud shows, as the ambient metric sees it [m]."""
        return float(self.placing[14])

    @property
    def occupied(self) -> np.ndarray:
        """Middles (n, 3) [m] of the occupied cubes."""
        if not self.squares.size:
            return np.empty((0, 3))
        to_cubes = self.placing[:12].reshape(3, 4)
        return np.linalg.solve(to_cubes[:, :3], np.argwhere(self.squares == 0.0).T - to_cubes[:, 3:]).T

    def moved(self, rotation: np.ndarray, translation: np.ndarray) -> DistanceField:
        """Seen from another frame: p -> rotation p + translation, (3, 3) and (3,) [m]."""
        if not self.squares.size:
            return self
        to_cubes = self.placing[:12].reshape(3, 4)
        turned = to_cubes[:, :3] @ rotation.T
        moved = np.column_stack([turned, to_cubes[:, 3] - turned @ translation])
        return DistanceField(self.squares, np.concatenate([moved.ravel(), self.placing[12:]]))


def _edge(lower: np.ndarray, upper: np.ndarray, edge: float) -> float:
    """Return an edge of cubes [m], or the smallest with which there are not too many around corners (3,) [m]."""
    return max(edge, float(np.prod(upper - lower + 2.0 * (REACH + edge)) / _MOST_CUBES) ** (1.0 / 3.0))


_NONE = DistanceField(np.empty((0, 0, 0), dtype=np.float32), np.zeros(15))


@numba.njit(cache=True, nogil=True)
def _squares(points: np.ndarray, first: np.ndarray, shape: np.ndarray, edge: float, most: float) -> np.ndarray:
    """Squared distances [edges^2], at most `most`, of the cubes from those that hold points (n, 3)."""
    result = _occupied(points, first, shape, edge, most)
    longest = max(shape[0], max(shape[1], shape[2]))
    line, best = np.empty(longest, dtype=np.float32), np.empty(longest, dtype=np.float32)
    at, begins = np.empty(longest, dtype=np.int64), np.empty(longest + 1)
    for i in range(shape[0]):
        for j in range(shape[1]):
            line[: shape[2]] = result[i, j]
            if _lower_envelope(line, shape[2], most, best, at, begins):
                result[i, j] = best[: shape[2]]
    for i in range(shape[0]):
        for k in range(shape[2]):
            line[: shape[1]] = result[i, :, k]
            if _lower_envelope(line, shape[1], most, best, at, begins):
                result[i, :, k] = best[: shape[1]]
    # Along the first axis the next number of a line is far away in memory: slices are copied, and worked on at once.
    slice_ = np.empty((shape[2], shape[0]), dtype=np.float32)
    for j in range(shape[1]):
        for i in range(shape[0]):
            slice_[:, i] = result[i, j]
        for k in range(shape[2]):
            if _lower_envelope(slice_[k], shape[0], most, best, at, begins):
                slice_[k] = best[: shape[0]]
        for i in range(shape[0]):
            result[i, j] = slice_[:, i]
    return result


@numba.njit(cache=True, nogil=True)
def _occupied(points: np.ndarray, first: np.ndarray, shape: np.ndarray, edge: float, most: float) -> np.ndarray:
    """0 for the cubes that hold points (n, 3) [m], `most` for the others."""
    result = np.full((shape[0], shape[1], shape[2]), np.float32(most))
    for n in range(len(points)):
        i, j, k = np.rint(points[n, 0] / edge), np.rint(points[n, 1] / edge), np.rint(points[n, 2] / edge)
        result[int(i) - first[0], int(j) - first[1], int(k) - first[2]] = 0.0
    return result


@numba.njit(cache=True, nogil=True)
def _lower_envelope(
    line: np.ndarray, length: int, most: float, best: np.ndarray, at: np.ndarray, begins: np.ndarray
) -> bool:
    """best[i] = min_j line[j] + (i - j)^2, at most `most`; False where all of the line is `most` and stays so.

    The parabolas that are lowest somewhere stand in `at`, from where on each is lowest in `begins`.
    """
    count = 0
    for j in range(length):
        if line[j] >= most:
            continue
        begin = -np.inf
        while count > 0:
            before = at[count - 1]
            begin = 0.5 * ((line[j] - line[before]) / (j - before) + j + before)
            if begin > begins[count - 1]:
                break
            count -= 1
            begin = -np.inf
        at[count], begins[count] = j, begin
        count += 1
    if count == 0:
        return False
    begins[count] = np.inf
    lowest = 0
    for i in range(length):
        while begins[lowest + 1] < i:
            lowest += 1
        away = i - at[lowest]
        best[i] = min(line[at[lowest]] + away * away, most)
    return True


@numba.njit(cache=True, nogil=True)
def field_distance(x: float, y: float, z: float, squares: np.ndarray, placing: np.ndarray) -> float:
    """Signed distance [m] of a point from the spheres around a cloud's points, at least; for a field with points.

    It is continuous, and REACH less the surface's radius where no point is nearer than that.
    """
    i, u = _cube(placing[0] * x + placing[1] * y + placing[2] * z + placing[3], squares.shape[0])
    j, v = _cube(placing[4] * x + placing[5] * y + placing[6] * z + placing[7], squares.shape[1])
    k, w = _cube(placing[8] * x + placing[9] * y + placing[10] * z + placing[11], squares.shape[2])
    square = 0.0
    for a in range(2):
        along_x = u if a == 1 else 1.0 - u
        for b in range(2):
            along_xy = along_x * (v if b == 1 else 1.0 - v)
            square += along_xy * ((1.0 - w) * squares[i + a, j + b, k] + w * squares[i + a, j + b, k + 1])
    square -= u * (1.0 - u) + v * (1.0 - v) + w * (1.0 - w)
    return placing[12] * math.sqrt(max(square, 0.0)) - placing[13]


@numba.njit(cache=True, nogil=True)
def _cube(at: float, count: int) -> tuple[np.uint32, float]:
    """Number of a cube and share of the step to the next, of so many along an axis.

    Beyond the rim, where no point of the cloud is near, the distance is that on the rim.
    """
    at = min(max(at, 0.0), count - 1.0)
    number = min(np.uint32(at), np.uint32(count - 2))
    return number, at - number


@numba.njit(cache=True, nogil=True)
def field_distances(points: np.ndarray, squares: np.ndarray, placing: np.ndarray) -> np.ndarray:
    """`field_distance` of points (n, 3): (n,) [m]."""
    result = np.empty(len(points))
    for i in range(len(points)):
        result[i] = field_distance(points[i, 0], points[i, 1], points[i, 2], squares, placing)
    return result


@numba.njit(cache=True, nogil=True)
def field_approach(begin: np.ndarray, end: np.ndarray, squares: np.ndarray, placing: np.ndarray, worth: float) -> float:
    """Lower bound [m] of the signed distance of a segment, from begin (3,) to end (3,), from the spheres of a cloud.

    It is 1 mm less than the smallest that `field_distance` tells along the segment at most; where that is not below
    `worth` [m], it is `worth`.

    Pieces are halved until they are shorter than 2 mm, or so far that no place on them is nearer than what is known:
    within a distance l of a point the true distance is smaller by l at most.
    """
    dx, dy, dz = end[0] - begin[0], end[1] - begin[1], end[2] - begin[2]
    length = math.sqrt(dx * dx + dy * dy + dz * dz)
    # One piece waits on every level: segments of up to a thousand kilometres.
    middles, halves = np.empty(32), np.empty(32)
    middles[0], halves[0], waiting = 0.5, 0.5, 1
    nearest = worth
    while waiting > 0:
        waiting -= 1
        middle, half = middles[waiting], halves[waiting]
        at = begin[0] + middle * dx, begin[1] + middle * dy, begin[2] + middle * dz
        bound = field_distance(at[0], at[1], at[2], squares, placing) - half * length
        if bound >= nearest:
            continue
        if half * length <= _TOLERANCE:
            nearest = bound
            continue
        half *= 0.5
        middles[waiting], halves[waiting] = middle - half, half
        middles[waiting + 1], halves[waiting + 1] = middle + half, half
        waiting += 2
    return nearest
