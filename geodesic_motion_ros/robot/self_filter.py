"""SelfFilter: sorts a cloud that a camera has seen into cubes, without the arm and what it holds.

The arm is the spheres of its collision model at the measured joints. A cube that lies outside of all padded spheres, or
inside one of them, is judged once, and in the others every point is.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numba
import numpy as np

from geodesic_motion_ros.geometry.line_of_sight import NEAREST, LineOfSight, square_of
from geodesic_motion_ros.geometry.voxels import NUMBERS, VoxelGrid
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.held_objects import HeldObject
from geodesic_motion_ros.robot.kinematics import MATRIX, VECTOR, Robot

#: What a cube that has no number is: not looked at yet; inside of a padded sphere; outside of all; neither.
_UNKNOWN, _INSIDE, _OUTSIDE, _PARTLY = 0, -1, -2, -3
#: Axes of the products xx, yy, zz, xy, xz, yz.
_FIRST, _SECOND = (0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2)
#: The arm's body extends so far beyond the tool's origin at most [m].
_BEYOND_TOOL = 0.2


@dataclass(frozen=True, eq=False)
class SortedCloud:
    """A cloud in cubes, without the arm and what is out of its reach.

    Attributes
    ----------
    places : (v, 3) of the cubes in the grid. counts : (v,) how many points each holds. means : (v, 3) [m] of these.
    spreads : (v, 6) xx, yy, zz, xy, xz, yz of their covariance [m^2].
    sight : what the camera sees, the arm too.
    out_of_reach, of_arm : how many points are left out.
    """

    places: np.ndarray
    counts: np.ndarray
    means: np.ndarray
    spreads: np.ndarray
    sight: LineOfSight
    out_of_reach: int
    of_arm: int


class SelfFilter:
    """Drops the points of an arm from clouds."""

    def __init__(self, robot: Robot, collision: CollisionModel) -> None:
        """collision : of the arm without objects in its hand."""
        self._robot = robot
        self._holding = lru_cache(maxsize=1)(lambda held: collision.holding(robot, held))

    def spheres(self, joints: np.ndarray, held: Sequence[HeldObject]) -> tuple[np.ndarray, np.ndarray]:
        """Place the spheres of the arm, those of its base too, and of what it holds, at joints (n,) [rad]: centres
        (S, 3) and radii (S,) [m].
        """
        model = self._holding(tuple(held))
        return model.positions(self._robot, joints[None])[0], model.radii

    def grid(self, edge: float, beyond: float) -> VoxelGrid:
        """Make the grid of cubes with an edge [m] that holds all that is so far [m] beyond the arm's body at most."""
        return VoxelGrid.around(self._robot.shoulder, self._robot.reach + _BEYOND_TOOL + beyond, edge)

    @staticmethod
    def touches(points: np.ndarray, spheres: tuple[np.ndarray, np.ndarray], by: float) -> np.ndarray:
        """Tell which points (m, 3) [m] are in spheres, or no farther from one than so much [m]: (m,) bool."""
        return _touching(np.ascontiguousarray(points), spheres[0], spheres[1] + by)

    def sort(
        self, points: np.ndarray, spheres: tuple[np.ndarray, np.ndarray], grid: VoxelGrid, eye: np.ndarray | None
    ) -> SortedCloud:
        """Sort points (n, 3) [m], finite, in the base frame.

        Parameters
        ----------
        spheres : centres (S, 3), radii (S,) [m]; what is in them is dropped. None of them: no cloud shows the arm.
        grid : what is farther from its centre than its radius is out of reach.
        eye : (3,) [m] where they were seen from; None where that is unknown.
        """
        centres, radii = spheres
        sight = LineOfSight.blank(eye)
        corners = np.zeros((2, 3))
        if len(radii):
            corners[0], corners[1] = np.min(centres - radii[:, None], axis=0), np.max(centres + radii[:, None], axis=0)
        places, counts, sums, near = _sort(
            np.ascontiguousarray(points), np.ascontiguousarray(centres), np.ascontiguousarray(radii), corners,
            np.asarray(grid.centre, dtype=float), grid.radius, grid.edge, grid.numbers(), grid.first, sight.eye,
            sight.nearest,
        )  # fmt: skip
        of_arm = near - int(np.sum(counts))
        offsets = sums / counts[:, None]
        spreads = offsets[:, 3:] - offsets[:, _FIRST] * offsets[:, _SECOND]
        means = grid.edge * places + offsets[:, :3]
        return SortedCloud(places, counts, means, spreads, sight, len(points) - near, of_arm)


@numba.njit(cache=True, nogil=True)
def _kind(x, y, z, centres, radii, half):
    """Classify a cube with a middle (x, y, z), all of which is within `half` [m] of that."""
    kind = _OUTSIDE
    for s in range(len(radii)):
        a, b, c = x - centres[s, 0], y - centres[s, 1], z - centres[s, 2]
        square = a * a + b * b + c * c
        if radii[s] >= half and square <= (radii[s] - half) ** 2:
            return _INSIDE
        if square <= (radii[s] + half) ** 2:
            kind = _PARTLY
    return kind


@numba.njit(cache=True, nogil=True)
def _is_inside(x, y, z, centres, radii):
    """Whether a point is in one of the spheres, or on it."""
    for s in range(len(radii)):
        a, b, c = x - centres[s, 0], y - centres[s, 1], z - centres[s, 2]
        if a * a + b * b + c * c <= radii[s] * radii[s]:
            return True
    return False


# Written signatures: compiled at the first import, not with the first cloud.
@numba.njit((MATRIX, MATRIX, VECTOR), cache=True, nogil=True)
def _touching(points, centres, radii):
    """Tell which points (m, 3) are in one of the spheres: (m,) bool."""
    touching = np.zeros(len(points), dtype=np.bool_)
    for n in range(len(points)):
        touching[n] = _is_inside(points[n, 0], points[n, 1], points[n, 2], centres, radii)
    return touching


@numba.njit(
    (MATRIX, MATRIX, VECTOR, MATRIX, VECTOR, numba.float64, numba.float64, NUMBERS, numba.int64[::1], VECTOR, NEAREST),
    cache=True, nogil=True,
)  # fmt: skip
def _sort(points, centres, radii, corners, centre, reach, edge, cubes, first, eye, nearest):
    """Sort points (n, 3) into cubes: where these are (v, 3), how many points each holds (v,), the sums of their offsets
    from its middle and of products of these (v, 9); and how many points are within reach.

    corners : (2, 3) of the box around the spheres. cubes : of the grid, all 0, in which 1 + the numbers are written.
    """
    most = min(len(points), cubes.size)
    places, sums = np.empty((most, 3), dtype=np.int64), np.empty((most, 9))
    counts, partly = np.empty(most, dtype=np.int64), np.empty(most, dtype=np.bool_)
    found, near, half, per = 0, 0, 0.5 * math.sqrt(3.0) * edge, 1.0 / edge
    for n in range(len(points)):
        x, y, z = points[n, 0], points[n, 1], points[n, 2]
        if len(nearest):
            a, b, c = x - eye[0], y - eye[1], z - eye[2]
            side, row, column = square_of(a, b, c)
            nearest[side, row, column] = min(nearest[side, row, column], np.float32(a * a + b * b + c * c))
        if (x - centre[0]) ** 2 + (y - centre[1]) ** 2 + (z - centre[2]) ** 2 > reach * reach:
            continue
        near += 1
        # Nothing is as slow as `round`.
        i, j, k = math.floor(x * per + 0.5), math.floor(y * per + 0.5), math.floor(z * per + 0.5)
        a, b, c = i - first[0], j - first[1], k - first[2]
        code = cubes[a, b, c]
        if code == _UNKNOWN:
            u, v, w = i * edge, j * edge, k * edge
            code = _OUTSIDE
            if (
                corners[0, 0] - half <= u <= corners[1, 0] + half
                and corners[0, 1] - half <= v <= corners[1, 1] + half
                and corners[0, 2] - half <= w <= corners[1, 2] + half
            ):
                code = _kind(u, v, w, centres, radii, half)
            cubes[a, b, c] = code
        if code == _INSIDE:
            continue
        if (code == _PARTLY or (code > 0 and partly[code - 1])) and _is_inside(x, y, z, centres, radii):
            continue
        if code < 0:
            places[found, 0], places[found, 1], places[found, 2] = i, j, k
            sums[found], counts[found] = 0.0, 0
            partly[found] = code == _PARTLY
            found += 1
            cubes[a, b, c] = code = found
        number = code - 1
        a, b, c = x - i * edge, y - j * edge, z - k * edge
        of_cube = sums[number]
        of_cube[0] += a
        of_cube[1] += b
        of_cube[2] += c
        of_cube[3] += a * a
        of_cube[4] += b * b
        of_cube[5] += c * c
        of_cube[6] += a * b
        of_cube[7] += a * c
        of_cube[8] += b * c
        counts[number] += 1
    return places[:found], counts[:found], sums[:found], near
