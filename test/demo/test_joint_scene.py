"""The demo of whole-arm skills on every shipped arm: which scene it is, that it is fair, and that it can be drawn."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from geodesic_motion_ros.demo import demo_pictures
from geodesic_motion_ros.demo.demo_node import scene_of
from geodesic_motion_ros.demo.demo_run import Recording
from geodesic_motion_ros.demo.demo_scene import DemoScene
from geodesic_motion_ros.demo.elbow_scene import ElbowScene
from geodesic_motion_ros.demo.joint_scene import JointScene
from geodesic_motion_ros.planning.arm_clearance import configuration_clearance
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
