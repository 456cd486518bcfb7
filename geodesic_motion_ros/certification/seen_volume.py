"""SeenVolume, in which a detour may lead an arm whose obstacle source does not see everything.

A sphere of the arm is inside where

- one box of the declared scene's list `seen` holds all of it: that is empty for ever, or the source observes it
  wholly; or
- its centre is within `BASE_ALLOWANCE` of where that of the same sphere passes along the base path: there the arm would
  be without a detour, too.

Where it evades beside the graph the place at which it stands counts in the place of the base path. Both are
conservative: a sphere across two boxes that touch is outside, and so is one where only other parts of the arm
pass. The volume does not move: a motion that was certified in it stays so, and so does a stop along its path. Where a
detour was left a demonstrated path leads on to the goal, and nothing keeps that inside.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np

from geodesic_motion_ros.geometry.shapes import no_solids, solid_distance
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.trajectory.trajectory import interpolated

#: A sphere may be this far from where it passes along the base path [m]. Half the spacing of its samples takes 2.5 mm
#: of that, the path's bends between the samples of a detour's frame up to as much, and `SEARCH_DEPTH` the rest.
BASE_ALLOWANCE = 0.01
#: Searches keep spheres this deep inside [m]: the path that they find is smoothed afterwards.
SEARCH_DEPTH = 0.005
#: The certificate requires this depth at the places that it checks [m]: its step is no shorter.
_LEAST_DEPTH = 1e-3
#: Between two samples of the base path no sphere moves farther [m].
_SPACING = 0.005


class SeenVolume(NamedTuple):
    """The volume in which the S spheres of an arm may be on a detour (setting `unseen`); compiled kernels read it.

    Attributes
    ----------
    everything : there is nothing that is not seen; the rest is empty then.
    boxes : (b, 16) rows as of `geometry/shapes.py`.
    passed : (S, m, 3) centres of the spheres along the base path [m].
    """

    everything: bool
    boxes: np.ndarray
    passed: np.ndarray

    @classmethod
    def unbounded(cls) -> SeenVolume:
        """Return the volume of everything."""
        return cls(True, no_solids(), np.empty((0, 0, 3)))

    @classmethod
    def of_base_path(cls, base: np.ndarray, boxes: np.ndarray, robot: Robot, collision: CollisionModel) -> SeenVolume:
        """Return the volume of boxes (b, 16), and of what an arm passes along configurations (k, eta) of a base path.
        """
        steps = np.linalg.norm(np.diff(collision.positions(robot, base), axis=0), axis=2)
        lengths = np.append(0.0, np.cumsum(np.max(steps, axis=1)))
        even = np.linspace(0.0, lengths[-1], math.ceil(lengths[-1] / _SPACING) + 1)
        passed = collision.positions(robot, interpolated(even, lengths, base))
        return cls(False, boxes, np.ascontiguousarray(passed.swapaxes(0, 1)))


@numba.njit(cache=True, nogil=True)
def seen_depth(x: float, y: float, z: float, sphere: int, radius: float, seen: SeenVolume, wanted: float) -> float:
    """Return how deep [m] a sphere of the arm with its centre at a point is inside, negative where it sticks out.

    It changes by no more than the centre moves. Where it is not below `wanted` [m] it may be any number from there on
    up to what it is.
    """
    boxes, passed = seen.boxes, seen.passed
    deepest = -math.inf
    for b in range(len(boxes)):
        deepest = max(deepest, -solid_distance(x, y, z, boxes, b) - radius)
        if deepest >= wanted:
            return deepest
    near, nearest = max(BASE_ALLOWANCE - wanted, 0.0) ** 2, math.inf
    for k in range(passed.shape[1]):
        dx, dy, dz = x - passed[sphere, k, 0], y - passed[sphere, k, 1], z - passed[sphere, k, 2]
        nearest = min(nearest, dx * dx + dy * dy + dz * dz)
        if nearest <= near:
            break
    return max(deepest, BASE_ALLOWANCE - math.sqrt(nearest))


@numba.njit(cache=True, nogil=True)
def is_inside(
    placed: np.ndarray, x: float, y: float, z: float, radii: np.ndarray, spheres: np.ndarray, seen: SeenVolume
) -> bool:
    """Whether those of an arm's spheres (S, 3), (S,) that are listed (k,) are inside by `SEARCH_DEPTH`, displaced by
    (x, y, z) [m].
    """
    for s in spheres:
        depth = seen_depth(placed[s, 0] + x, placed[s, 1] + y, placed[s, 2] + z, s, radii[s], seen, SEARCH_DEPTH)
        if depth < SEARCH_DEPTH:
            return False
    return True


@numba.njit(cache=True, nogil=True)
def first_unseen(
    placed: np.ndarray, bulges: np.ndarray, radii: np.ndarray, moving: np.ndarray, seen: SeenVolume
) -> tuple[int, int]:
    """Return the first interval between knots in which a sphere of `moving` (k,) may not be inside, and that sphere;
    -1, -1 where all always are.

    Parameters
    ----------
    placed, bulges : (n, S, 3), (n - 1, S) as of `SweptSpheres`. radii : (S,) [m].

    A sphere that is inside by more than its bulge stays so for as long as it moves by no more than the rest: from there
    it is looked at again.
    """
    for i in range(len(bulges)):
        for s in moving:
            x, y, z = placed[i, s]
            dx, dy, dz = placed[i + 1, s] - placed[i, s]
            length, bulge, moved = math.sqrt(dx * dx + dy * dy + dz * dz), bulges[i, s], 0.0
            while moved <= length:
                share = moved / length if length > 0.0 else 0.0
                depth = seen_depth(
                    x + share * dx, y + share * dy, z + share * dz, s, radii[s], seen, bulge + _LEAST_DEPTH
                )
                if depth < bulge + _LEAST_DEPTH:
                    return i, s
                moved += depth - bulge
    return -1, -1
