"""The demo of whole-arm skills on every shipped arm: which scene it is, that it is fair, and that it can be drawn."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from geodesic_motion_ros.certification.arm_clearance import configuration_clearance
from geodesic_motion_ros.certification.declared_scene import DeclaredScene
from geodesic_motion_ros.demo import demo_pictures, demo_scene
from geodesic_motion_ros.demo.demo_node import main, scene_of
from geodesic_motion_ros.demo.demo_run import Recording
from geodesic_motion_ros.demo.demo_scene import DemoScene
from geodesic_motion_ros.demo.elbow_scene import ElbowScene
from geodesic_motion_ros.demo.joint_scene import JointScene
from geodesic_motion_ros.skill.skill import Skill


@pytest.fixture(scope="module", params=["ur5_reach", "fr3_reach_to_grasp", "iiwa14_reach_to_grasp"])
def scene(request: pytest.FixtureRequest) -> DemoScene:
    return scene_of(Skill.load(request.param), None)


def clearance(scene: DemoScene, time: float) -> float:
    """Between the undisturbed arm and the obstacle at a time [m]."""
    planner, obstacle = scene.planner, scene.obstacle
    configuration, at = scene.nominal.sample(time)[0], obstacle.position(time)[None]
    return configuration_clearance(planner.collision, planner.robot, configuration, at, np.array([obstacle.radius]))[0]


def test_six_joints_have_the_obstacle_at_the_hand_and_seven_at_the_elbow(scene: DemoScene) -> None:
    joints = len(scene.planner.robot.joint_names)
    assert type(scene) is {6: JointScene, 7: ElbowScene}[joints]


@pytest.mark.parametrize("name", ["panda_reach_to_grasp", "fr3_reach_to_grasp", "iiwa14_reach_to_grasp"])
def test_the_elbow_needs_families_on_either_side(name: str) -> None:
    skill = Skill.load(name)
    assert ElbowScene.suits(skill)
    for family in (0, 1):
        rows = skill.canonical.modes == family
        alone = replace(
            skill.canonical, modes=skill.canonical.modes[rows], configurations=skill.canonical.configurations[rows]
        )
        assert not ElbowScene.suits(replace(skill, canonical=alone))


@pytest.mark.parametrize("name", ["panda_wide_reach", "panda_insertion", "ur5_reach", "panda_pouring", "paper_reach"])
def test_skills_without_such_families_have_the_obstacle_at_the_hand(name: str) -> None:
    assert not ElbowScene.suits(Skill.load(name))


def test_an_arm_of_seven_joints_with_its_elbow_on_one_side_is_met_at_the_hand() -> None:
    scene = scene_of(Skill.load("panda_wide_reach"), DeclaredScene.empty())
    assert type(scene) is JointScene
    assert clearance(scene, 0.0) >= demo_scene.ROOM
    assert min(clearance(scene, time) for time in scene.nominal.times) <= -demo_scene.DEPTH
    planner, resting, start, goal = scene.planner, scene.obstacle, scene.skill.start_pose, scene.goal
    assert len(planner.obstacles.radii) == 0
    planner.set_obstacles(np.array([resting.end]), np.array([resting.radius]))
    assert planner.plan(start[:3], start[3:], goal[:3], goal[3:]).verdict.ok


def test_a_skill_without_a_fair_obstacle_is_refused_before_anything_starts(
    tmp_path: Path, monkeypatch, capsys
) -> None:
    monkeypatch.setattr(demo_scene, "ROOM", 5.0)  # nowhere is that far from the arm
    assert main(["--skill", "ur5_reach", "--out", str(tmp_path)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("demo: skill ur5_reach: the demo has no sphere for it that is 500 cm from the arm")
    assert "give --scene" in line
    assert list(tmp_path.iterdir()) == []


def test_a_skill_that_does_not_fit_the_scene_is_refused_with_what_to_give(tmp_path: Path, capsys) -> None:
    assert main(["--skill", "panda_wide_reach", "--out", str(tmp_path)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "inside 'table' of the scene" in line
    assert "give --scene, which is table here" in line


def test_the_undisturbed_arm_begins_free_and_would_be_hit(scene: DemoScene) -> None:
    assert clearance(scene, 0.0) > 0.05
    assert min(clearance(scene, time) for time in scene.nominal.times) < -0.02


def test_pictures_are_drawn_of_its_own_arm(scene: DemoScene, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(demo_pictures, "_STRIP_FRAMES", 2)
    monkeypatch.setattr(demo_pictures, "_GIF_FRAMES", 2)
    times = np.arange(0.0, scene.nominal.duration, 0.1)
    moved = Recording()
    moved.pose_times = moved.joint_times = moved.obstacle_times = times.tolist()
    moved.joints = [scene.nominal.sample(time)[0] for time in times]
    moved.positions = [scene.planner.robot.forward(joints)[0] for joints in moved.joints]
    moved.obstacles = [scene.obstacle.position(time) for time in times]
    scene.draw({"no_obstacle": moved, "avoidance_off": moved, "avoidance_on": moved}, tmp_path)
    assert {file.name for file in tmp_path.iterdir()} == {"latent.png", "paths.png", "strip.png", "arm.gif"}
