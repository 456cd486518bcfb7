"""Old import paths warn and work while what they gave still exists; old calls name the new ones."""

from __future__ import annotations

from importlib import import_module

import numpy as np
import pytest

from geodesic_motion_ros import ReactivePlanner, Skill
from geodesic_motion_ros.utils.moved import OLD_PATHS, PACKAGE


@pytest.fixture(scope="module")
def planner() -> ReactivePlanner:
    return ReactivePlanner(Skill.load("panda_pouring"))


@pytest.mark.parametrize(
    ("old", "new", "name"),
    [
        ("planner", "planning.planner", "ReactivePlanner"),
        ("planner_settings", "planning.settings", "PlannerSettings"),
        ("query", "planning.pose_query", "Pose"),
        ("errors", "utils.errors", "GeodesicMotionError"),
        ("verdict", "planning.status", "VerdictCode"),
        ("skill", "skill.skill", "Skill"),
        ("obstacles", "obstacles.obstacles", "Obstacles"),
        ("manifold.training", "learning.training", "train_task_space_skill"),
        ("manifold.training", "learning.settings", "TrainingSettings"),
    ],
)
def test_an_old_path_warns_and_gives_what_stands_at_the_new_one(old: str, new: str, name: str) -> None:
    with pytest.warns(DeprecationWarning, match=f"{PACKAGE}.{old} is now {PACKAGE}.{new};") as warned:
        found = getattr(import_module(f"{PACKAGE}.{old}"), name)
    assert found is getattr(import_module(f"{PACKAGE}.{new}"), name)
    assert warned[0].filename == __file__


@pytest.mark.parametrize("new", sorted(set(OLD_PATHS.values())))
def test_a_new_path_leads_somewhere(new: str) -> None:
    import_module(f"{PACKAGE}.{new}")


def test_what_is_no_more_is_an_import_error_that_names_what_to_use() -> None:
    with pytest.raises(ImportError, match=r"use geodesic_motion_ros\.planning\.planner\.ReactivePlanner"):
        from geodesic_motion_ros.joint_planner import JointSpacePlanner  # noqa: F401
    with pytest.raises(ImportError, match=r"planner_settings\.MOVING_MULTIPLE is no more"):
        from geodesic_motion_ros.planner_settings import MOVING_MULTIPLE  # noqa: F401
    with pytest.raises(ImportError, match=r"use geodesic_motion_ros\.planning\.pose_query\.PoseQueryBuilder"):
        from geodesic_motion_ros.query import QueryBuilder  # noqa: F401


def test_a_path_that_never_was_is_not_found() -> None:
    with pytest.raises(ModuleNotFoundError):
        import_module(f"{PACKAGE}.whatever")
    with pytest.raises(ImportError):
        from geodesic_motion_ros.skill import Whatever  # noqa: F401


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
