"""A skill in a task frame: exact for rigid frames, refused where the frame is none, checked against the arm's reach."""

from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_ros.planner import ReactivePlanner
from geodesic_motion_ros.quaternions import angle_between, normalise, to_rotation
from geodesic_motion_ros.reference import ReferenceFollower
from geodesic_motion_ros.task_frame import TaskFrame
from geodesic_motion_ros.verdict import VerdictCode

IDENTITY = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])


@pytest.fixture(scope="module")
def planner(fan_skill):
    return ReactivePlanner(fan_skill)


@pytest.fixture(autouse=True)
def _unmoved(planner):
    yield
    planner.set_task_frame(*IDENTITY)
    planner.set_obstacles(np.empty((0, 3)), np.empty(0))
    planner.clear_goal()


def near_frame(random: np.random.Generator) -> TaskFrame:
    """A frame that leaves the task within the arm's reach: turned about the vertical, tilted and shifted a little."""
    turn = normalise(np.array([1.0, *(random.normal(size=3) * [0.05, 0.05, 0.8])]))
    return TaskFrame(random.uniform(-0.05, 0.05, 3), turn)


def ends(skill, random: np.random.Generator) -> list[np.ndarray]:
    moved = skill.start_pose[:3] + random.normal(scale=0.01, size=3)
    return [moved, skill.start_pose[3:], skill.goal_pose[:3] + random.normal(scale=0.01, size=3), skill.goal_pose[3:]]


def test_to_task_and_back_is_the_identity_and_agrees_with_rotation_matrices():
    random = np.random.default_rng(0)
    for _ in range(50):
        frame = TaskFrame(random.normal(size=3), normalise(random.normal(size=4)))
        positions, quaternions = random.normal(size=(9, 3)), normalise(random.normal(size=(9, 4)))
        back = frame.to_base(*frame.to_task(positions, quaternions))
        np.testing.assert_allclose(back[0], positions, atol=1e-12)
        np.testing.assert_allclose(back[1], quaternions, atol=1e-12)
        rotation = to_rotation(frame.quaternion)
        np.testing.assert_allclose(frame.points_to_task(positions), rotation.inv().apply(positions - frame.origin))
        turned = (rotation.inv() * to_rotation(quaternions)).as_matrix()
        ours = to_rotation(frame.to_task(positions, quaternions)[1]).as_matrix()
        np.testing.assert_allclose(ours, turned, atol=1e-12)


def test_the_answer_in_a_moved_frame_is_the_moved_answer(planner, fan_skill):
    random = np.random.default_rng(1)
    answered = 0
    for _ in range(100):
        frame, (start, turned, goal, goal_turned) = near_frame(random), ends(fan_skill, random)
        centres = fan_skill.start_pose[:3] + random.uniform([-0.1, 0.1, -0.1], [0.2, 0.5, 0.2], (3, 3))
        planner.set_task_frame(*IDENTITY)
        planner.set_obstacles(centres, np.full(3, 0.02))
        here = planner.plan(start, turned, goal, goal_turned)
        planner.set_task_frame(frame.origin, frame.quaternion)
        planner.set_obstacles(frame.points_to_base(centres), np.full(3, 0.02))
        there = planner.plan(*frame.to_base(start, turned), *frame.to_base(goal, goal_turned))
        assert there.verdict.code is here.verdict.code
        if here.reference is None:
            continue
        answered += 1
        positions, quaternions = frame.to_base(here.reference.positions, here.reference.quaternions)
        np.testing.assert_allclose(there.reference.positions, positions, atol=1e-6)
        assert angle_between(there.reference.quaternions, quaternions).max() < 1e-6
        np.testing.assert_allclose(there.reference.times, here.reference.times, atol=1e-6)
        assert there.verdict.clearance == pytest.approx(here.verdict.clearance, abs=1e-9)
    assert answered > 50


def test_a_goal_in_the_task_frame_moves_with_it_and_one_in_the_base_frame_stays(planner, fan_skill):
    frame = TaskFrame(np.array([0.01, 0.01, 0.0]), normalise(np.array([1.0, 0.0, 0.0, 0.01])))
    goal = fan_skill.goal_pose[:3], fan_skill.goal_pose[3:]
    start = fan_skill.start_pose[:3], fan_skill.start_pose[3:]
    for in_task_frame, expected in ((True, frame.to_base(*goal)[0]), (False, goal[0])):
        planner.set_task_frame(*IDENTITY)
        assert planner.set_goal(*goal, in_task_frame).ok
        assert planner.set_task_frame(frame.origin, frame.quaternion).ok
        plan = planner.tick(*start)
        np.testing.assert_allclose(plan.reference.positions[-1], expected, atol=1e-9)


def test_a_frame_that_moves_in_motion_bends_the_reference_from_where_the_arm_is(planner, fan_skill):
    assert planner.set_goal(fan_skill.goal_pose[:3], fan_skill.goal_pose[3:], in_task_frame=True).ok
    follower = ReferenceFollower(planner.settings.speed)
    follower.reset(fan_skill.start_pose[:3], fan_skill.start_pose[3:])
    for step in range(150):
        plan = planner.tick(follower.position, follower.quaternion, follower.speed)
        assert plan.reference is not None, plan.verdict
        np.testing.assert_allclose(plan.reference.positions[0], follower.position, atol=1e-9)
        before = follower.position
        follower.accept(plan.reference)
        follower.advance(0.01)
        assert np.linalg.norm(follower.position - before) <= 1.01 * 0.01 * planner.settings.speed
        planner.set_task_frame(np.array([0.0002 * step, 0.0, 0.0]), IDENTITY[1])
    # In motion the last of the frames, which took the goal hardly further, is not followed yet.
    goal = fan_skill.goal_pose[:3] + [0.0298, 0.0, 0.0]
    np.testing.assert_allclose(plan.reference.positions[-1], goal, atol=2.3e-3)
    for _ in range(600):
        plan = planner.tick(follower.position, follower.quaternion, follower.speed)
        assert plan.reference is not None, plan.verdict
        follower.accept(plan.reference)
        follower.advance(0.01)
    np.testing.assert_allclose(follower.position, goal, atol=1e-6)


@pytest.mark.parametrize("frame", [(np.zeros(3), np.zeros(4)), (np.full(3, np.nan), IDENTITY[1])])
def test_a_frame_that_is_none_is_refused_and_the_old_one_stays(planner, fan_skill, frame):
    assert planner.set_goal(fan_skill.goal_pose[:3], fan_skill.goal_pose[3:], in_task_frame=True).ok
    verdict = planner.set_task_frame(*frame)
    assert verdict.code is VerdictCode.BAD_INPUT
    assert "task frame" in verdict.reason
    plan = planner.tick(fan_skill.start_pose[:3], fan_skill.start_pose[3:])
    np.testing.assert_allclose(plan.reference.positions[-1], fan_skill.goal_pose[:3], atol=1e-9)


def test_a_frame_out_of_reach_is_said_with_the_distance(planner, fan_skill):
    planner.set_task_frame(np.array([1.5, 0.0, 0.0]), IDENTITY[1])
    verdict = planner.set_goal(fan_skill.goal_pose[:3], fan_skill.goal_pose[3:], in_task_frame=True)
    assert verdict.code is VerdictCode.GOAL_OUT_OF_SUPPORT
    assert "from the shoulder" in verdict.reason
