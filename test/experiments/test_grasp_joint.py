"""Families of grasps, small: what is blocked is refused, what is left is taken, and families are told apart."""

from __future__ import annotations

import json

import numpy as np
import pytest

from geodesic_motion_ros.errors import ParameterError
from geodesic_motion_ros.experiments.grasp_joint import (
    GraspJointReport,
    GraspJointSettings,
    SkillReport,
    draw_grasp_joint,
    family_energies,
)
from geodesic_motion_ros.experiments.grasp_joint_scenes import meeting_scenes, separated_scenes
from geodesic_motion_ros.joint_planner import JointSpacePlanner
from geodesic_motion_ros.manifold.joint_training import JointTrainingSettings, train_joint_space_skill
from geodesic_motion_ros.planner_settings import JointPlannerSettings
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.tables import write_json

COARSE = JointPlannerSettings(grid_shape=(30, 30, 30))
SMALL = JointTrainingSettings(
    steps=700, hidden=(64, 32), samples=80, kernels=100, batch=128, precision_samples=2, precision_iterations=60
)
ROBOT = Robot.panda()


@pytest.fixture(scope="module")
def report(stored, separated_demonstrations, reach_skill) -> GraspJointReport:
    skill = stored("separated", lambda: train_joint_space_skill(separated_demonstrations, ROBOT, SMALL))
    separated = JointSpacePlanner(skill, COARSE)
    # Its families meet at both ends alone.
    meeting = JointSpacePlanner(reach_skill, COARSE)
    box = (20, 20, 20)
    skills = (
        SkillReport("separated", 0, 2, family_energies(separated.skill, box), separated_scenes(separated)),
        SkillReport("meeting", 0, 2, family_energies(reach_skill, box), meeting_scenes(meeting)),
    )
    return GraspJointReport(GraspJointSettings(3, (0,), COARSE), skills, {"separated": separated, "meeting": meeting})


def test_what_is_blocked_is_refused_and_what_is_left_is_taken(report) -> None:
    scenes = report.skills[0].scenes
    assert [(scene.name, scene.family) for scene in scenes] == [
        ("free", 0), ("free", 1), ("way 0 blocked", 0), ("way 0 blocked", 1), ("way 1 blocked", 0),
        ("way 1 blocked", 1), ("goal blocked", 0), ("goal blocked", 1),
    ]  # fmt: skip
    assert [bool(scene.passed) for scene in scenes] == [True, True, False, True, True, False, False, False]
    for scene in scenes:
        assert scene.as_expected, (scene.name, scene.family, scene.passed, scene.reason, scene.clearance)
        if scene.reference is not None and len(scene.radii):
            assert scene.certified <= scene.clearance + 1e-4


def test_families_that_do_not_meet_half_way_have_no_hybrid(report) -> None:
    of = {scene.name: scene for scene in report.skills[1].scenes}
    assert of["first of 0 blocked"].passed == (1,)
    assert of["first of 0 blocked"].clearance > 0.0
    for name in ("hybrid, 1 then 0", "hybrid, 0 then 1"):
        assert of[name].reference is None
        assert not of[name].as_expected
    assert of["both blocked"].as_expected


def test_a_wall_stands_between_families_that_never_meet(report) -> None:
    energies = report.skills[0].energies
    assert np.min(energies.across) > 20.0 * np.max(energies.within)
    assert np.max(np.diag(energies.dearest)) < energies.edge_limit
    # The control: there is none between those that begin and end alike.
    joined = report.skills[1].energies
    assert np.max(joined.across) < 2.0 * np.max(joined.within)


def test_what_is_handed_over_is_complete(report, tmp_path) -> None:
    content = json.loads(write_json(tmp_path / "figures.json", report.as_dict()).read_text())
    assert [len(skill["scenes"]) for skill in content["skills"]] == [8, 5]
    table = report.table()
    assert table.count("refused  ") == sum(scene.reference is None for skill in report.skills for scene in skill.scenes)
    assert table.count(" NO") == 2
    draw_grasp_joint(report, tmp_path / "grasp_joint.png")
    assert (tmp_path / "grasp_joint.png").read_bytes().startswith(b"\x89PNG")


def test_settings_that_do_not_fit_are_refused() -> None:
    with pytest.raises(ParameterError, match="at least 2"):
        GraspJointSettings(shown=1)
    with pytest.raises(ParameterError, match="seeds"):
        GraspJointSettings(seeds=())
