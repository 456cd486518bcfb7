"""Aim: the goal that a stream of poses is to reach, in the task frame as it stands, and how far it is from another.

What tracks an object tells where it is at its rate, moved or not, and each time a little elsewhere: a way that is
looked for anew for that may turn off the present motion, and the tool would stop.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geodesic_motion_ros.quaternions import angle_between
from geodesic_motion_ros.query import Pose
from geodesic_motion_ros.task_frame import TaskFrame

#: Poses are the same, told again, up to so much [m], [rad].
_SAME = (1e-6, 1e-6)
#: A goal that moves no further than this [m], [rad] is gone to when the tool rests: as long as it moves, its way stays.
_HARDLY_MOVED = (2e-3, 1e-2)


@dataclass(frozen=True, eq=False)
class Aim:
    """A goal as it was given, None before the first, and whether that was in the task frame, with which it moves."""

    goal: Pose | None
    in_task_frame: bool
    frame: TaskFrame

    @classmethod
    def none(cls) -> Aim:
        """No goal, and the task frame is the base frame."""
        return cls(None, False, TaskFrame.identity())

    def in_task(self) -> Pose:
        """The goal in the task frame."""
        assert self.goal is not None
        return self.goal if self.in_task_frame else to_task(self.frame, self.goal)

    def _in_base(self) -> Pose:
        assert self.goal is not None
        return to_base(self.frame, self.goal) if self.in_task_frame else self.goal

    def is_same(self, other: Aim) -> bool:
        """Whether it says what the other one says."""
        ends = [Pose(aim.frame.origin, aim.frame.quaternion) for aim in (self, other)]
        if not _within(*ends, _SAME) or (self.goal is None) is not (other.goal is None):
            return False
        if self.goal is None or other.goal is None:
            return True
        return self.in_task_frame is other.in_task_frame and _within(self.goal, other.goal, _SAME)

    def ends_with(self, other: Aim) -> bool:
        """Whether both goals are the same place of the base frame: then it need not be gone to when the tool rests."""
        return self.goal is not None and other.goal is not None and _within(self._in_base(), other._in_base(), _SAME)

    def is_near(self, other: Aim) -> bool:
        """Whether both goals are hardly apart, seen from the base frame and from the task frame."""
        if self.goal is None or other.goal is None:
            return False
        pairs = (self._in_base(), other._in_base()), (self.in_task(), other.in_task())
        return all(_within(*pair, _HARDLY_MOVED) for pair in pairs)


def to_task(frame: TaskFrame, pose: Pose) -> Pose:
    """A pose of the base frame as the task frame sees it."""
    return Pose(*frame.to_task(pose.position, pose.quaternion))


def to_base(frame: TaskFrame, pose: Pose) -> Pose:
    """A pose of the task frame as the base frame sees it."""
    return Pose(*frame.to_base(pose.position, pose.quaternion))


def _within(one: Pose, other: Pose, limits: tuple[float, float]) -> bool:
    distance = float(np.linalg.norm(one.position - other.position))
    return distance <= limits[0] and float(angle_between(one.quaternion, other.quaternion)) <= limits[1]
