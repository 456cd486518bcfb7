"""What is planned: ends, obstacles, what is refused; scenes come with a control."""

from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_ros.deadline import Deadline
from geodesic_motion_ros.planner import Plan
from geodesic_motion_ros.verdict import Verdict, VerdictCode

NOTHING = (np.empty((0, 3)), np.empty(0))


def test_out_of_time_no_further_attempt_is_made(planner, monkeypatch):
    """A first attempt that fails is followed by another, but for the deadline."""
    certified, refused = planner._solver._certified, []

    def picky(*arguments):
        if not refused:
            refused.append(arguments)
            return Plan(None, Verdict(VerdictCode.NO_FEASIBLE_PATH, "not this one"))
        return certified(*arguments)

    start, goal = planner.skill.start_pose, planner.skill.goal_pose
    planner.set_goal(goal[:3], goal[3:])
    monkeypatch.setattr(planner._solver, "_certified", picky)
    plan = planner.tick(start[:3], start[3:], 0.0, Deadline(-np.inf))
    assert plan.verdict.code is VerdictCode.DEADLINE_MISSED
    assert plan.verdict.reason == "out of time: not this one"
    assert plan.reference is None
    refused.clear()
    assert planner.tick(start[:3], start[3:], 0.0, Deadline(np.inf)).verdict.ok


@pytest.mark.parametrize(
    ("position", "quaternion", "words"),
    [
        ([np.nan, 0, 0], [1, 0, 0, 0], "finite"),
        ([0.4, 0, np.inf], [1, 0, 0, 0], "finite"),
        ([0.4, 0, 1e200], [1, 0, 0, 0], "at most 1000"),
        ([0.4, 0, 0.3], [1e160, 0, 0, 0], "at most 1000"),
        ([0.4, 0, 0.3], [0, 0, 0, 0], "zero"),
        ([0.4, 0], [1, 0, 0, 0], "expected"),
    ],
)
def test_bad_poses_are_refused_with_the_reason_and_change_nothing(planner, position, quaternion, words):
    start, goal = planner.skill.start_pose, planner.skill.goal_pose
    planner.set_goal(goal[:3], goal[3:])
    for verdict in (
        planner.set_goal(np.array(position), np.array(quaternion)),
        planner.tick(np.array(position), np.array(quaternion)).verdict,
        planner.plan(start[:3], start[3:], np.array(position), np.array(quaternion)).verdict,
    ):
        assert verdict.code is VerdictCode.BAD_INPUT
        assert words in verdict.reason
    assert planner.tick(start[:3], start[3:]).verdict.ok


def test_a_goal_far_from_the_demonstrations_is_refused_with_its_distance(planner):
    start, goal = planner.skill.start_pose, planner.skill.goal_pose
    planner.set_goal(goal[:3], goal[3:])
    verdict = planner.set_goal(goal[:3] + [0.0, 0.3, 0.0], goal[3:])
    assert verdict.code is VerdictCode.GOAL_OUT_OF_SUPPORT
    assert verdict.goal_offset > 0.2
    assert "maximum_offset" in verdict.reason
    np.testing.assert_allclose(planner.tick(start[:3], start[3:]).reference.positions[-1], goal[:3], atol=1e-9)


def test_a_start_far_from_the_demonstrations_is_refused(planner):
    goal = planner.skill.goal_pose
    planner.set_goal(goal[:3], goal[3:])
    plan = planner.tick(goal[:3] + [0.0, 0.0, 0.5], goal[3:])
    assert plan.verdict.code is VerdictCode.START_OUT_OF_SUPPORT


def test_without_a_goal_there_is_no_reference(planner):
    start = planner.skill.start_pose
    plan = planner.tick(start[:3], start[3:])
    assert plan.reference is None
    assert plan.verdict.code is VerdictCode.NO_GOAL
