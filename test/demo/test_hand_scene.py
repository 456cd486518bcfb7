"""The demo of a skill of the tool: its scene is fair, and its pictures can be drawn."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest

from geodesic_motion_ros.certification.path_clearance import segment_distance
from geodesic_motion_ros.demo import demo_pictures, hand_scene
from geodesic_motion_ros.demo.demo_run import Recording
from geodesic_motion_ros.demo.hand_scene import HandScene
from geodesic_motion_ros.skill.skill import Skill


@pytest.fixture(scope="module")
def scene() -> HandScene:
    return HandScene(Skill.load("panda_pouring"))


def tool_at(scene: HandScene, time: float) -> np.ndarray:
    """Where the undisturbed motion has the tool (3,) [m]."""
    return scene.planner.robot.forward(scene.nominal.sample(time)[0])[0]


def test_the_obstacle_moves_from_outside_into_the_undisturbed_motion(scene: HandScene) -> None:
    nominal, obstacle = scene.nominal, scene.obstacle
    meeting = hand_scene.MEETING_SHARES[0] * nominal.duration
    path = [tool_at(scene, time) for time in np.linspace(0.0, nominal.duration, 100)]
    tool = tool_at(scene, meeting)
    assert min(np.linalg.norm(np.array(path) - obstacle.position(0.0), axis=1)) > 0.1
    assert np.linalg.norm(obstacle.position(meeting) - tool) < obstacle.radius + 0.02
    assert not np.allclose(obstacle.position(0.0), obstacle.position(0.5))


def test_half_of_the_demonstrations_pass_the_obstacle(scene: HandScene) -> None:
    """The scene leaves room: the tool's path in most demonstrations keeps outside of the sphere at rest."""
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
    times = np.arange(0.0, scene.nominal.duration, 0.1)
    free, around = Recording(), Recording()
    for recording in (free, around):
        recording.pose_times = recording.joint_times = times.tolist()
        recording.joints = [scene.nominal.sample(time)[0] for time in times]
        poses = [scene.planner.robot.forward(joints) for joints in recording.joints]
        recording.positions, recording.quaternions = map(list, zip(*poses, strict=True))
    around.obstacle_times, around.obstacles = times.tolist(), [scene.obstacle.position(time) for time in times]
    scene.draw({"no_obstacle": free, "avoidance_off": around, "avoidance_on": around}, tmp_path)
    assert {file.name for file in tmp_path.iterdir()} == {"latent.png", "paths.png", "strip.png", "arm.gif"}
