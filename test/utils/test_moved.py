"""Old import paths warn and work while what they gave still exists; old calls name the new ones."""

from __future__ import annotations

from importlib import import_module

import numpy as np
import pytest

from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.errors import PlanningError


@pytest.fixture(scope="module")
def planner() -> ReactivePlanner:
    return ReactivePlanner(Skill.load("panda_pouring"))


@pytest.mark.parametrize(
    ("old", "new", "name"),
    [
        ("planner", "planning.planner", "ReactivePlanner"),
        ("planner_settings", "planning.settings", "PlannerSettings"),
        ("query", "planning.pose_query", "QueryBuilder"),
    ],
)
def test_an_old_path_warns_and_gives_what_stands_at_the_new_one(old: str, new: str, name: str) -> None:
    with pytest.warns(DeprecationWarning, match=f"geodesic_motion_ros.{new}"):
        found = getattr(import_module(f"geodesic_motion_ros.{old}"), name)
    assert found is getattr(import_module(f"geodesic_motion_ros.{new}"), name)


def test_what_is_no_more_is_an_import_error_that_names_what_to_use() -> None:
    with pytest.raises(ImportError, match=r"use geodesic_motion_ros\.planning\.planner\.ReactivePlanner"):
        from geodesic_motion_ros.joint_planner import JointSpacePlanner  # noqa: F401
    with pytest.raises(ImportError, match=r"planner_settings\.MOVING_MULTIPLE is no more"):
        from geodesic_motion_ros.planner_settings import MOVING_MULTIPLE  # noqa: F401


def test_a_tick_with_a_pose_names_the_new_call(planner: ReactivePlanner) -> None:
    position, quaternion = np.split(planner.skill.start_pose, [3])
    with pytest.raises(PlanningError, match=r"stand_at\(q, now\)"):
        planner.tick(position, quaternion)


def test_a_plan_has_the_poses_of_the_tool(planner: ReactivePlanner) -> None:
    skill = planner.skill
    plan = planner.plan(*np.split(skill.start_pose, [3]), *np.split(skill.goal_pose, [3]))
    positions, quaternions = plan.tool_poses
    assert positions.shape == (len(plan.reference.times), 3)
    for i in (0, len(positions) // 2, -1):
        position, quaternion = planner.robot.forward(plan.reference.positions[i])
        np.testing.assert_allclose(positions[i], position, atol=1e-12)
        assert abs(quaternions[i] @ quaternion) == pytest.approx(1.0)
    assert np.all(np.sum(quaternions[1:] * quaternions[:-1], axis=1) > 0.0)
    assert planner.tick(0.0).tool_poses is None
