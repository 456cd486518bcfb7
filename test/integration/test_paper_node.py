"""The node with the paper's planner takes the place of `planner`, in simulation."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bench import PATIENCE
from rclpy.parameter import Parameter

from geodesic_motion_ros.nodes.twin_node import TwinNode
from geodesic_motion_ros.paper.paper_node import PaperNode
from geodesic_motion_ros.skill.skill import Skill

CONFIG = Path(__file__).resolve().parents[2] / "config"
#: Of a machine that may be busy.
PATIENT = {
    "simulation_only": True, "state_timeout": 5.0, "resume_timeout": 60.0, "obstacle_timeout": 30.0,
    "tracking_tolerance": 0.3, "tracking_tolerance_angle": 3.0, "latency": 0.1, "latent_view_rate": 0.0,
}  # fmt: skip


@pytest.fixture
def skill() -> Skill:
    return Skill.load("paper_pouring")


def test_it_moves_the_twin_to_the_goal_and_says_that_nothing_is_certified(bench, skill) -> None:
    bench.watch_planner()
    twin = bench.add(TwinNode, skill=skill.name)
    bench.add(PaperNode, skill=skill.name, **PATIENT)
    bench.wait_for_code("NO_GOAL")
    begun = bench.status()
    bench.send_goal(skill.goal_pose)

    def arrived() -> bool:
        status: dict[str, Any] = bench.status()
        return status["code"] == "OK" and float(status["time_to_goal"]) == 0.0 and float(status["speed"]) < 1e-3

    bench.wait(arrived, "the arm at rest at the goal")
    status = bench.status()
    assert begun["guarded"] == status["guarded"] == "nothing"
    assert "nothing is certified" in status["reason"]
    position, _ = twin.world.tool_pose()
    # The node of the graph that is nearest to the goal, and an arm that follows it.
    allowed = float(status["goal_offset"]) + 0.02
    assert np.linalg.norm(position - skill.goal_pose[:3]) < allowed < 0.1


def test_it_keeps_its_speed_and_takes_other_timeouts(bench, skill) -> None:
    node = bench.add(PaperNode, skill=skill.name, **PATIENT)
    assert not node.set_parameters([Parameter("speed_scale", value=0.1)])[0].successful
    assert node.set_parameters([Parameter("state_timeout", value=1.0)])[0].successful
    assert node.cycle.state_timeout == 1.0


def test_it_does_not_start_where_a_real_arm_may_hear_it(bench) -> None:
    process = bench.launch("paper_node", where="paper")
    _, errors = process.communicate(timeout=PATIENCE)
    assert process.returncode == 1
    (line,) = [line for line in errors.splitlines() if line.startswith("paper_planner: ")]
    assert "certifies nothing and may lead through obstacles: set simulation_only to true" in line
    assert "Traceback" not in errors


def test_its_parameter_file_is_none_of_the_planner(bench) -> None:
    """Who starts the other program with it must not get a certified planner of zeta = 1e9."""
    process = bench.launch("planner_node", "--ros-args", "--params-file", str(CONFIG / "paper.yaml"))
    _, errors = process.communicate(timeout=PATIENCE)
    assert "planner: parameter simulation_only does not exist" in errors
