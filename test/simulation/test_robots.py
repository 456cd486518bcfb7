"""Every shipped robot is one that the world can hold and move."""

from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_ros.robot.description import shipped_robots
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.simulation.world import ArmWorld


@pytest.mark.parametrize("name", shipped_robots())
def test_a_shipped_robot_follows_its_tool_in_the_world(name: str) -> None:
    robot = Robot.named(name)
    position, quaternion = robot.forward(robot.ready)
    goal = position + [0.0, 0.05, -0.03]
    with ArmWorld(robot=name) as world:
        np.testing.assert_allclose(world.tool_pose()[0], position, atol=1e-6)
        for _ in range(240):
            world.set_target_pose(goal, quaternion)
            for _ in range(2):
                world.step()
        np.testing.assert_allclose(world.tool_pose()[0], goal, atol=1e-3)
        assert world.own_clearance()[0] > 0.0
