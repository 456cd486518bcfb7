"""A closed skill over DDS: round after round with the twin, until that is not to be any more; the status says which."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from bench import Bench
from rclpy.parameter import Parameter

from geodesic_motion_ros.demonstrations.demonstrations import Demonstration, Demonstrations
from geodesic_motion_ros.learning.settings import TrainingSettings
from geodesic_motion_ros.learning.training import train_skill
from geodesic_motion_ros.nodes.planner_node import PlannerNode
from geodesic_motion_ros.nodes.twin_node import TwinNode
from geodesic_motion_ros.robot.inverse_kinematics import solve
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill.skill import Skill


@pytest.fixture(scope="module")
def closed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A skill of circles of about 10 cm, learned in a few steps, on disk."""
    angle = 2.0 * np.pi * np.linspace(0.0, 1.0, 120)
    shape = np.stack([np.cos(angle), np.sin(angle), np.zeros(120)], axis=1)
    down = np.tile([0.0, 1.0, 0.0, 0.0], (120, 1))
    items = [
        Demonstration([0.5, 0.0, 0.4] + share * 0.1 * shape, down, np.linspace(0.0, 3.0, 120), f"{share}")
        for share in (0.9, 1.0, 1.1)
    ]
    settings = TrainingSettings(closed=True, steps=400, precision_iterations=60)
    skill = train_skill(Demonstrations(tuple(items), frame="panda_link0"), settings, "circles")
    return skill.save(tmp_path_factory.mktemp("skills") / "circles")


def test_rounds_are_made_until_they_are_not_to_be_and_the_status_says_which(bench: Bench, closed: Path) -> None:
    skill = Skill.load(closed)
    start = solve(Robot.named("panda"), skill.start_pose[:3], skill.start_pose[3:])
    bench.watch_planner()
    bench.add(TwinNode, initial_joint_positions=start.tolist())
    planner = bench.add(
        PlannerNode, skill=str(closed), state_timeout=5.0, resume_timeout=60.0, latency=0.1, latent_view_rate=0.0,
        periodic=True,
    )  # fmt: skip
    bench.wait_for_code("NO_GOAL")
    assert bench.status()["round"] == "0"
    bench.send_goal(skill.goal_pose)
    bench.wait(lambda: bench.status()["round"] == "3", "the third round")
    assert "round 3" in bench.status()["reason"]
    assert planner.set_parameters([Parameter("periodic", value=False)])[0].successful
    bench.wait(lambda: bench.status()["code"] == "OK" and bench.at_goal(), "rest at the goal")
    assert bench.status()["round"] in ("3", "4")
