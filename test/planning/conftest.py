"""A planner of paths on a small skill that fans out, and the path between its own ends; an arm of six joints."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from geodesic_motion_ros.planning.pose_path import PosePath, PosePathPlanner
from geodesic_motion_ros.planning.status import Refusal
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill.skill import Skill

#: Six joints in a row: base, shoulder, elbow, and three of a wrist.
SIX = """<robot name="six"><link name="l0"/>{}</robot>"""
AXES, LENGTHS = ("0 0 1", "0 1 0", "0 1 0", "0 0 1", "0 1 0", "0 0 1"), (0.3, 0.1, 0.4, 0.2, 0.2, 0.05)


class FanPlanner(PosePathPlanner):
    """A planner that plans between its skill's mean start and mean goal."""

    def answer(self) -> PosePath | Refusal:
        """The path from the mean start to the mean goal, or why there is none."""
        start, goal = self.skill.start_pose, self.skill.goal_pose
        return self.plan(start[:3], start[3:], goal[:3], goal[3:])

    def nominal(self) -> PosePath:
        """That path, which there must be."""
        path = self.answer()
        assert isinstance(path, PosePath), path
        return path

    def refusal(self) -> Refusal:
        """Why there is none, which there must not be."""
        verdict = self.answer()
        assert isinstance(verdict, Refusal)
        return verdict

    def middle(self) -> np.ndarray:
        """Position (3,) [m] halfway along the path."""
        positions = self.nominal().positions
        return positions[len(positions) // 2]


@pytest.fixture(scope="session")
def shared_planner(fan_skill: Skill) -> FanPlanner:
    return FanPlanner(fan_skill)


@pytest.fixture
def planner(shared_planner: FanPlanner) -> FanPlanner:
    shared_planner.set_obstacles(np.empty((0, 3)), np.empty(0))
    return shared_planner


@pytest.fixture
def another(fan_skill: Skill) -> Callable[..., FanPlanner]:
    """another(*settings) is a planner of its own."""
    return lambda *settings: FanPlanner(fan_skill, *settings)


@pytest.fixture(scope="session")
def six(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    joints = "".join(
        f'<link name="l{i + 1}"/><joint name="j{i}" type="revolute"><parent link="l{i}"/><child link="l{i + 1}"/>'
        f'<origin xyz="0 0 {length}"/><axis xyz="{axis}"/>'
        '<limit lower="-2.8" upper="2.8" velocity="2" effort="9"/></joint>'
        for i, (axis, length) in enumerate(zip(AXES, LENGTHS, strict=True))
    )
    file = tmp_path_factory.mktemp("six") / "six.urdf"
    file.write_text(SIX.format(joints))
    return Robot.from_urdf(file, "l0", "l6")
