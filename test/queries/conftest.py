"""A planner of paths on a small skill that fans out, and the path between its own ends."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from geodesic_motion_ros.contract.status import Refusal
from geodesic_motion_ros.queries.pose_path import PosePath, PosePathPlanner
from geodesic_motion_ros.skill.skill import Skill


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
