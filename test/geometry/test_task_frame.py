"""A skill in a task frame: exact for rigid frames, refused where the frame is none, checked against the arm's reach."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.contract.status import VerdictCode
from geodesic_motion_ros.geometry.quaternions import angle_between, normalise, to_rotation
from geodesic_motion_ros.geometry.task_frame import TaskFrame
from geodesic_motion_ros.motion.plan import Plan
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.robot.body_points import end_effector_poses
from geodesic_motion_ros.skill.skill import Skill

IDENTITY = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])


@pytest.fixture(scope="module")
def skill() -> Skill:
    return Skill.load("panda_pouring")


@pytest.fixture(scope="module")
def planner(skill) -> ReactivePlanner:
    return ReactivePlanner(skill)


@pytest.fixture(scope="module")
def reach_planner() -> ReactivePlanner:
    return ReactivePlanner(Skill.load("panda_reach_to_grasp"), PlannerSettings(grid_shape=(20, 20, 20)))


@pytest.fixture(autouse=True)
def _unmoved(planner):
    yield
    planner.set_task_frame(*IDENTITY)
    planner.clear_goal()


def stand_at_start(planner: ReactivePlanner) -> None:
    skill = planner.skill
    planned = planner.plan(*np.split(skill.start_pose, [3]), *np.split(skill.goal_pose, [3])).reference
    planner.stand_at(planned.positions[0], 0.0)


def tool_path(planner: ReactivePlanner, plan: Plan) -> np.ndarray:
    """Places (n, 3) of the tool."""
    return end_effector_poses(np.ascontiguousarray(plan.reference.positions), planner.robot.chain)[0]


def test_to_task_and_back_is_the_identity_and_agrees_with_rotation_matrices():
    random = np.random.default_rng(0)
    for _ in range(50):
        frame = TaskFrame(random.normal(size=3), normalise(random.normal(size=4)))
        positions, quaternions = random.normal(size=(9, 3)), normalise(random.normal(size=(9, 4)))
        back = frame.to_base(*frame.to_task(positions, quaternions))
        np.testing.assert_allclose(back[0], positions, atol=1e-12)
        np.testing.assert_allclose(back[1], quaternions, atol=1e-12)
        rotation = to_rotation(frame.quaternion)
        there = rotation.inv().apply(positions - frame.origin)
        np.testing.assert_allclose(frame.to_task(positions, quaternions)[0], there)
        turned = (rotation.inv() * to_rotation(quaternions)).as_matrix()
        ours = to_rotation(frame.to_task(positions, quaternions)[1]).as_matrix()
        np.testing.assert_allclose(ours, turned, atol=1e-12)


def test_a_goal_in_the_task_frame_moves_with_it_and_one_in_the_base_frame_stays(planner, skill):
    frame = TaskFrame(np.array([0.01, 0.01, 0.0]), normalise(np.array([1.0, 0.0, 0.0, 0.01])))
    goal = np.split(skill.goal_pose, [3])
    for in_task_frame, expected in ((True, frame.to_base(*goal)), (False, goal)):
        planner.set_task_frame(*IDENTITY)
        stand_at_start(planner)
        assert planner.set_goal(*goal, in_task_frame).ok
        assert planner.set_task_frame(frame.origin, frame.quaternion).ok
        plan = planner.tick(0.0)
        position, quaternion = planner.robot.forward(plan.reference.positions[-1])
        np.testing.assert_allclose(position, expected[0], atol=1e-6)
        assert angle_between(quaternion, expected[1]) < 1e-6


def test_the_path_in_a_moved_frame_is_the_moved_path(planner, skill):
    """Of the tool: the arm holds it in another posture, and passes it at other times."""
    ends = *np.split(skill.start_pose, [3]), *np.split(skill.goal_pose, [3])
    here = tool_path(planner, planner.plan(*ends))
    random, answered = np.random.default_rng(1), 0
    for _ in range(8):
        frame = TaskFrame(random.uniform(-0.05, 0.05, 3), normalise(np.array([1.0, *random.normal(scale=0.1, size=3)])))
        planner.set_task_frame(frame.origin, frame.quaternion)
        plan = planner.plan(*frame.to_base(*ends[:2]), *frame.to_base(*ends[2:]))
        if plan.reference is None:
            assert "the arm cannot hold" in plan.verdict.reason, plan.verdict
            continue
        answered += 1
        distances, _ = cKDTree(frame.points_to_base(here)).query(tool_path(planner, plan))
        # Both are smoothed in joint space, and sampled at the knots.
        assert np.max(distances) < 0.01
    assert answered > 3


@pytest.mark.parametrize("frame", [(np.zeros(3), np.zeros(4)), (np.full(3, np.nan), IDENTITY[1])])
def test_a_frame_that_is_none_is_refused_and_the_old_one_stays(planner, skill, frame):
    stand_at_start(planner)
    assert planner.set_goal(*np.split(skill.goal_pose, [3]), in_task_frame=True).ok
    verdict = planner.set_task_frame(*frame)
    assert verdict.code is VerdictCode.BAD_INPUT
    assert "task frame" in verdict.reason
    plan = planner.tick(0.0)
    goal = planner.robot.forward(plan.reference.positions[-1])[0]
    np.testing.assert_allclose(goal, skill.goal_pose[:3], atol=1e-6)


def test_a_frame_out_of_reach_is_said_with_the_distance_and_drops_the_goal(planner, skill):
    stand_at_start(planner)
    assert planner.set_goal(*np.split(skill.goal_pose, [3]), in_task_frame=True).ok
    verdict = planner.set_task_frame(np.array([1.5, 0.0, 0.0]), IDENTITY[1])
    assert verdict.code is VerdictCode.GOAL_OUT_OF_SUPPORT
    assert "from the shoulder" in verdict.reason
    assert planner.tick(0.0).verdict.code is VerdictCode.NO_GOAL


def test_a_whole_arm_skill_has_no_task_frame_but_the_base_frame(reach_planner):
    verdict = reach_planner.set_task_frame(np.array([0.1, 0.0, 0.0]), IDENTITY[1])
    assert verdict.code is VerdictCode.BAD_INPUT
    assert reach_planner.set_task_frame(*IDENTITY).ok
