"""SelfFilter: takes the arm, and what it holds, out of a point cloud that a camera has seen.

The arm is the spheres of its collision model at the measured joints. Points are sorted into cubes first: a cube that
lies outside of all padded spheres, or inside one of them, is judged once, and in the others every point is.

What comes into the padding looks like the arm. So points that were outside and touch the padded arm
now are remembered for a moment.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numba
import numpy as np

from geodesic_motion_ros.geometry.point_clouds import MOMENT
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.held_objects import HeldObject
from geodesic_motion_ros.robot.kinematics import MATRIX, VECTOR, Robot

#: Points that are not farther from the padded arm [m] may touch it at the next cloud: 1 m/s at 10 clouds a second.
_AROUND = 0.1
#: Cubes are made larger where there would be more.
_MOST_CUBES = 1_000_000
#: Kinds of cubes: not looked at yet; outside of all padded spheres; inside one; neither. A cube that holds points
#: outside has `_SEEN` added.
_UNKNOWN, _OUTSIDE, _INSIDE, _PARTLY, _SEEN = 0, 1, 2, 3, 4


@dataclass(frozen=True, eq=False)
class Remembered:
    """Points outside of the arm, one of each cube around it.

    Attributes
    ----------
    points : (m, 3) [m] in the base frame. seen : (m,) when they were last seen [s].
    held : what the hand held.
    """

    points: np.ndarray
    seen: np.ndarray
    held: tuple[HeldObject, ...] = ()

    @classmethod
    def nothing(cls) -> Remembered:
        return cls(np.zeros((0, 3)), np.zeros(0))


@dataclass(frozen=True, eq=False)
class FilteredCloud:
    """A cloud without the arm.

    Attributes
    ----------
    points : (k, 3) [m] those outside of the arm, then those that are remembered.
    of_arm : how many were dropped. remembered : how many points are remembered.
    memory : for the next cloud.
    """

    points: np.ndarray
    of_arm: int
    remembered: int
    memory: Remembered


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

    def remove(
        self,
        points: np.ndarray,
        joints: np.ndarray,
        held: Sequence[HeldObject],
        padding: float,
        edge: float,
        time: float,
        before: Remembered,
    ) -> FilteredCloud:
        """Drop the points within the padded arm, and add what touches it and was seen a moment ago.

        Where the hand holds something else than before, nothing is remembered: what was an obstacle may be in the hand.

        Parameters
        ----------
        points : (n, 3) [m], finite, in the base frame.
        joints : (eta,) [rad] that were measured when the cloud was taken.
        padding : the spheres are so much larger [m].
        edge : of the cubes [m]. Of what is remembered one point is kept in each, and what is not farther than that from
            the padding touches it.
        time : when the cloud was taken [s].
        before : what the cloud before has left in memory.
        """
        points, held = np.ascontiguousarray(points), tuple(held)
        centres, radii = self.spheres(joints, held)
        padded = radii + padding
        lower = np.min(centres - padded[:, None], axis=0) - _AROUND
        sides = np.max(centres + padded[:, None], axis=0) + _AROUND - lower
        edge = max(edge, float(np.cbrt(np.prod(sides) / _MOST_CUBES)))
        cubes = np.zeros(tuple(np.ceil(sides / edge).astype(int)), dtype=np.uint8)
        kept, new = _outside(points, centres, padded, lower, edge, cubes)
        still = (before.seen >= time - MOMENT) & (before.seen <= time) & (before.held == held)
        candidates, seen = before.points[still], before.seen[still]
        touching = _touching(candidates, centres, padded + edge, lower, edge, cubes)
        remembered, seen = candidates[touching], seen[touching]
        memory = Remembered(np.concatenate([kept[new], remembered]), np.append(np.full(len(new), time), seen), held)
        whole = np.concatenate([kept, remembered]) if len(remembered) else kept
        return FilteredCloud(whole, len(points) - len(kept), len(remembered), memory)


@numba.njit(cache=True, nogil=True, inline="always")
def _cube(x, y, z, lower, edge, cubes):
    """Find the numbers of the cube around a point; -1 where there is none."""
    a, b, c = (x - lower[0]) / edge, (y - lower[1]) / edge, (z - lower[2]) / edge
    if 0.0 <= a < cubes.shape[0] and 0.0 <= b < cubes.shape[1] and 0.0 <= c < cubes.shape[2]:
        return int(a), int(b), int(c)
    return -1, -1, -1


@numba.njit(cache=True, nogil=True)
def _kind(middle, centres, radii, half):
    """Classify a cube with a middle (x, y, z), all of which is within `half` [m] of that."""
    kind = _OUTSIDE
    for s in range(len(radii)):
        x, y, z = middle[0] - centres[s, 0], middle[1] - centres[s, 1], middle[2] - centres[s, 2]
        square = x * x + y * y + z * z
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
_CUBES = numba.types.Array(numba.uint8, 3, "C")


@numba.njit((MATRIX, MATRIX, VECTOR, VECTOR, numba.float64, _CUBES), cache=True, nogil=True)
def _outside(points, centres, radii, lower, edge, cubes):
    """Copy those of points (n, 3) that are outside of all spheres, and number one of them in each cube: (k, 3), (m,).

    lower : (3,) corner of the cubes (x, y, z), whose kinds are written.
    """
    kept, count = np.empty_like(points), 0
    chosen, different = np.empty(min(len(points), cubes.size), dtype=np.int64), 0
    half = 0.5 * np.sqrt(3.0) * edge
    for n in range(len(points)):
        x, y, z = points[n, 0], points[n, 1], points[n, 2]
        i, j, k = _cube(x, y, z, lower, edge, cubes)
        if i >= 0:
            if cubes[i, j, k] == _UNKNOWN:
                middle = lower[0] + (i + 0.5) * edge, lower[1] + (j + 0.5) * edge, lower[2] + (k + 0.5) * edge
                cubes[i, j, k] = _kind(middle, centres, radii, half)
            kind = cubes[i, j, k] & _PARTLY
            if kind == _INSIDE or (kind == _PARTLY and _is_inside(x, y, z, centres, radii)):
                continue
            if cubes[i, j, k] < _SEEN:
                cubes[i, j, k] += _SEEN
                chosen[different] = count
                different += 1
        kept[count, 0], kept[count, 1], kept[count, 2] = x, y, z
        count += 1
    return kept[:count], chosen[:different]


@numba.njit((MATRIX, MATRIX, VECTOR, VECTOR, numba.float64, _CUBES), cache=True, nogil=True)
def _touching(points, centres, radii, lower, edge, cubes):
    """Tell which points (m, 3) are in one of the spheres, but in no cube that holds new points: (m,) bool."""
    touching = np.zeros(len(points), dtype=np.bool_)
    for n in range(len(points)):
        x, y, z = points[n, 0], points[n, 1], points[n, 2]
        i, j, k = _cube(x, y, z, lower, edge, cubes)
        if i < 0 or cubes[i, j, k] < _SEEN:
            touching[n] = _is_inside(x, y, z, centres, radii)
    return touching
