"""The demo of a skill of the tool: its scene is fair, and its pictures can be drawn."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest

from geodesic_motion_ros.nodes import demo_pictures, hand_scene
from geodesic_motion_ros.nodes.demo_run import Recording
from geodesic_motion_ros.nodes.hand_scene import HandScene
from geodesic_motion_ros.planning.path_clearance import segment_distance
from geodesic_motion_ros.robot.inverse_kinematics import solve
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill import Skill


@pytest.fixture(scope="module")
def scene() -> HandScene:
    return HandScene(Skill.load("panda_pouring"))


def test_the_obstacle_moves_from_outside_into_the_undisturbed_motion(scene: HandScene) -> None:
    nominal, obstacle = scene.nominal, scene.obstacle
    meeting = hand_scene.MEETING_SHARE * nominal.duration
    tool, _ = nominal.sample(meeting)
    before = min(np.linalg.norm(nominal.positions - obstacle.position(0.0), axis=1))
    assert before > 0.1
    assert np.linalg.norm(obstacle.position(meeting) - tool) < obstacle.radius + 0.02
    assert not np.allclose(obstacle.position(0.0), obstacle.position(0.5))


def test_half_of_the_demonstrations_pass_the_obstacle(scene: HandScene) -> None:
    """The scene leaves room: the tool's way in most demonstrations keeps outside of the sphere at rest."""
    obstacle, skill = scene.obstacle, scene.skill
    end = np.array(obstacle.end)
    free = 0
    for code in skill.codes[: len(skill.codes) // 2]:
        positions = skill.decoder.decode(code).positions
        nearest = min(segment_distance(a, b, end) for a, b in itertools.pairwise(positions))
        free += nearest > obstacle.radius
    assert free >= len(skill.codes) // 4


def test_pictures_are_drawn_of_recorded_runs(scene: HandScene, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(demo_pictures, "_STRIP_FRAMES", 2)
    monkeypatch.setattr(demo_pictures, "_GIF_FRAMES", 2)
    robot, times = Robot.panda(), np.arange(0.0, scene.nominal.duration, 0.1)
    free, around = Recording(), Recording()
    for recording in (free, around):
        recording.pose_times = recording.joint_times = times.tolist()
        poses = [scene.nominal.sample(time) for time in times]
        recording.positions, recording.quaternions = map(list, zip(*poses, strict=True))
        ends = [solve(robot, *pose) for pose in (poses[0], poses[-1])]
        recording.joints = list(np.linspace(*ends, len(times)))
    around.obstacle_times, around.obstacles = times.tolist(), [scene.obstacle.position(time) for time in times]
    scene.draw({"no_obstacle": free, "avoidance_off": around, "avoidance_on": around}, tmp_path)
    assert {file.name for file in tmp_path.iterdir()} == {"latent.png", "paths.png", "strip.png", "arm.gif"}
