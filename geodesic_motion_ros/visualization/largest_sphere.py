"""The largest sphere that stands on a motion and is still passed, place by place.

At evenly spaced places of the tool's path one sphere stands with its centre on it, and is passed where there is a
certified motion from the skill's start to its goal. Near the ends of the path the arm itself has no room: a sphere that
touches the arm at start or goal stops any planner, and how large that is stands beside it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geodesic_motion_ros.certification.arm_clearance import obstacle_clearance
from geodesic_motion_ros.geometry.curves import arc_length_fractions
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.trajectory.trajectory import JointReference, interpolated

#: Radii are multiples of the first [m], which is finer than the margins; none is larger than the other.
STEP, LARGEST = 0.005, 0.12
#: Places of the tool's path are between these shares of its length.
INTERIOR = (0.05, 0.95)
#: Samples of the path that places are taken from.
_SAMPLES = 400


@dataclass(frozen=True, eq=False)
class SpherePlaces:
    """Places on the tool's path along one motion, n of them.

    Attributes
    ----------
    shares : (n,) of the path's length. centres : (n, 3) [m].
    free : (n,) radius [m] of the largest sphere that touches the arm neither at the start nor at the goal; 0 inside.
    """

    shares: np.ndarray
    centres: np.ndarray
    free: np.ndarray

    @classmethod
    def of_motion(cls, planner: ReactivePlanner, motion: JointReference, count: int) -> SpherePlaces:
        """Return evenly spaced places of a motion of the planner's arm."""
        postures = motion.samples(np.linspace(0.0, motion.duration, _SAMPLES))[0]
        tool = np.array([planner.robot.forward(posture)[0] for posture in postures])
        shares = np.linspace(*INTERIOR, count)
        centres = interpolated(shares, arc_length_fractions(tool), tool)
        free = [_free_ends(planner, postures[[0, -1]], centre) for centre in centres]
        return cls(shares, centres, np.array(free))


def find_largest_passed(
    planner: ReactivePlanner, centre: np.ndarray, free: float, passed: float = 0.0
) -> tuple[float, str]:
    """Return the radius [m] of the largest sphere at a centre (3,) [m] that the planner passes between the ends of its
    skill, and why one that is larger by STEP is not passed; "" where LARGEST is passed. By bisection: that what is
    smaller is passed, too, is taken for granted. The planner keeps the last sphere tried as its only obstacle.

    Parameters
    ----------
    free : of the place, as of `SpherePlaces`: where the bisection begins.
    passed : a radius [m] that is known to be passed, a multiple of STEP.
    """
    skill = planner.skill
    ends = (*np.split(skill.start_pose, [3]), *np.split(skill.goal_pose, [3]))
    low, high, reason = round(passed / STEP), round(LARGEST / STEP) + 1, ""
    # One that touches start or goal, and the next larger one: many places are settled by these two.
    first = [min(int(free / STEP), high - 2) + 1, low + 1]
    while high - low > 1:
        tried = first.pop(0) if first else (low + high) // 2
        if not low < tried < high:
            continue
        planner.set_obstacles(centre[None], np.array([tried * STEP]))
        plan = planner.plan(*ends)
        if plan.reference is None:
            high, reason = tried, plan.verdict.reason
        else:
            low = tried
    return low * STEP, reason


def _free_ends(planner: ReactivePlanner, ends: np.ndarray, centre: np.ndarray) -> float:
    """Distance [m] of a point from the arm at both ends (2, eta), 0 inside."""
    point = Obstacles.of_spheres(centre[None], np.zeros(1))
    return max(0.0, min(obstacle_clearance(planner.collision, planner.robot, end, point)[0] for end in ends))
