"""When a goal or a task frame that is told again is the same, and when it is too near to turn off the way for."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from geodesic_motion_ros.aim import Aim
from geodesic_motion_ros.query import Pose
from geodesic_motion_ros.task_frame import TaskFrame

UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])
FRAME = TaskFrame(np.array([0.5, 0.1, 0.0]), np.array([np.cos(0.2), 0.0, 0.0, np.sin(0.2)]))
GOAL = Pose(np.array([0.3, 0.0, 0.2]), UPRIGHT)


def turned(angle: float) -> np.ndarray:
    return np.array([np.cos(0.5 * angle), 0.0, 0.0, np.sin(0.5 * angle)])


def test_the_same_said_again_is_the_same() -> None:
    aim = Aim(GOAL, True, FRAME)
    again = Aim(Pose(GOAL.position.copy(), -UPRIGHT), True, TaskFrame(FRAME.origin.copy(), -FRAME.quaternion))
    assert aim.is_same(again)
    assert aim.is_near(again)
    assert Aim.none().is_same(Aim.none())


@pytest.mark.parametrize("changed", [
    Aim(GOAL, False, FRAME),
    Aim(None, True, FRAME),
    Aim(Pose(GOAL.position + 2e-6, UPRIGHT), True, FRAME),
    Aim(Pose(GOAL.position, turned(3e-6)), True, FRAME),
    Aim(GOAL, True, TaskFrame(FRAME.origin + 2e-6, FRAME.quaternion)),
    Aim(GOAL, True, TaskFrame(FRAME.origin, turned(0.4 + 3e-6))),
])  # fmt: skip
def test_what_differs_is_not_the_same(changed: Aim) -> None:
    assert not changed.is_same(Aim(GOAL, True, FRAME))


@pytest.mark.parametrize("in_task_frame", [True, False])
def test_what_moves_the_goal_by_little_is_near(in_task_frame: bool) -> None:
    aim = Aim(GOAL, in_task_frame, FRAME)
    for shift, near in ((1e-3, True), (3e-3, False)):
        moved = TaskFrame(FRAME.origin + [shift, 0.0, 0.0], FRAME.quaternion)
        assert dataclasses.replace(aim, frame=moved).is_near(aim) is near
        goal = Pose(GOAL.position + [shift, 0.0, 0.0], UPRIGHT)
        assert dataclasses.replace(aim, goal=goal).is_near(aim) is near


def test_a_frame_that_turns_counts_at_the_goal() -> None:
    far = Aim(Pose(np.array([2.0, 0.0, 0.0]), UPRIGHT), True, FRAME)
    near = Aim(GOAL, True, FRAME)
    frame = TaskFrame(FRAME.origin, turned(0.4 + 3e-3))
    assert dataclasses.replace(near, frame=frame).is_near(near)
    assert not dataclasses.replace(far, frame=frame).is_near(far)


def test_a_goal_of_the_base_frame_ends_where_it_did_when_the_frame_moves() -> None:
    moved = TaskFrame(FRAME.origin + 1e-3, FRAME.quaternion)
    for in_task_frame in (True, False):
        aim = Aim(GOAL, in_task_frame, FRAME)
        assert dataclasses.replace(aim, frame=moved).ends_with(aim) is not in_task_frame
    assert not Aim.none().ends_with(Aim.none())
