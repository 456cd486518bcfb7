"""New goals of a stream on a canonical sheet, and where a motion may start."""

from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_ros.planner import ReactivePlanner
from geodesic_motion_ros.quaternions import angle_between, rotate_by
from geodesic_motion_ros.query import Pose
from geodesic_motion_ros.reference import ReferenceFollower
from geodesic_motion_ros.verdict import VerdictCode

PERIOD = 0.01


@pytest.fixture
def planner(canonical_fan_skill) -> ReactivePlanner:
    return ReactivePlanner(canonical_fan_skill)


def displaced(pose: np.ndarray, offset: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Position and quaternion of a pose (7,) carried by an offset (6,)."""
    return pose[:3] + offset[:3], rotate_by(offset[3:], pose[3:])


def test_a_motion_may_start_where_a_plan_is_not_refused_for_its_start(planner):
    random, skill = np.random.default_rng(0), planner.skill
    answers = []
    for _ in range(30):
        ends = *np.split(skill.start_pose, [3]), *np.split(skill.goal_pose, [3])
        reference = planner.plan(*ends).reference
        position, quaternion = reference.sample(random.uniform(0.0, reference.duration))
        pose = Pose(position + random.normal(scale=0.04, size=3), quaternion)
        refused = planner.plan(pose.position, quaternion, *np.split(skill.goal_pose, [3])).verdict.code
        answers.append(planner._queries.may_start(pose))
        assert answers[-1] == (refused is not VerdictCode.START_OUT_OF_SUPPORT)
    assert 5 < sum(answers) < 25


def test_a_new_goal_in_motion_bends_the_way_without_a_jump(planner):
    sheet, goal = planner.skill.canonical, planner.skill.goal_pose
    start = planner.skill.start_pose
    follower = ReferenceFollower(planner.settings.speed)
    follower.reset(start[:3], start[3:])
    goals = [displaced(goal, sign * 0.8 * sheet.goal_offsets[row]) for row, sign in ((0, 1), (2, 1), (4, 1), (5, 1))]
    limit = planner.settings.acceleration * PERIOD
    positions, quaternions, speeds = [follower.position.copy()], [follower.quaternion.copy()], [0.0]
    for step in range(700):
        if step % 40 == 0 and step // 40 < len(goals):
            assert planner.set_goal(*goals[step // 40]).ok
        plan = planner.tick(follower.position, follower.quaternion, follower.speed)
        assert plan.verdict.ok, plan.verdict
        follower.accept(plan.reference)
        follower.advance(PERIOD)
        positions.append(follower.position.copy())
        quaternions.append(follower.quaternion.copy())
        speeds.append(follower.speed)
    steps = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    assert steps.max() <= planner.settings.speed * PERIOD * 1.05
    assert angle_between(np.array(quaternions[1:]), np.array(quaternions[:-1])).max() < 0.02
    assert np.abs(np.diff(speeds)).max() <= 2.0 * limit
    assert min(speeds[60:200]) > 0.5 * planner.settings.speed
    np.testing.assert_allclose(follower.position, goals[-1][0], atol=1e-5)


def test_a_new_goal_without_a_way_brings_the_moving_arm_to_rest(planner):
    start, goal = planner.skill.start_pose, planner.skill.goal_pose
    follower = ReferenceFollower(planner.settings.speed)
    follower.reset(start[:3], start[3:])
    assert planner.set_goal(goal[:3], goal[3:]).ok
    for _ in range(100):
        follower.accept(planner.tick(follower.position, follower.quaternion, follower.speed).reference)
        follower.advance(PERIOD)
    assert follower.speed > 0.8 * planner.settings.speed
    assert planner.set_goal(start[:3], start[3:]).ok
    planner.set_obstacles(start[None, :3], [0.03])
    braking = int(2.0 * planner.settings.speed / planner.settings.acceleration / PERIOD)
    for _ in range(braking):
        plan = planner.tick(follower.position, follower.quaternion, follower.speed)
        assert plan.verdict.code is VerdictCode.NO_FEASIBLE_PATH
        if follower.speed == 0.0:
            break
        assert plan.reference is not None, f"no ramp at {follower.speed} m/s"
        follower.accept(plan.reference)
        follower.advance(PERIOD)
    assert follower.speed == 0.0
