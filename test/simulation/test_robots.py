"""Every shipped robot is one that the world can hold and move."""

from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_ros.certification.certificate import ArmCertifier
from geodesic_motion_ros.certification.declared_scene import DeclaredScene
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.robot.collision_model import CollisionModel, self_clearances
from geodesic_motion_ros.robot.description import shipped_robots
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.robot.limits import JointLimits
from geodesic_motion_ros.simulation.world import ArmWorld
from geodesic_motion_ros.trajectory.timing import timed_joint_reference
from geodesic_motion_ros.trajectory.trajectory import JointReference
from geodesic_motion_ros.trajectory.trajectory_player import JointWaypoints

TABLE = DeclaredScene.from_name("table")


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


def certified_motions(name: str, count: int) -> list[JointReference]:
    """Motions from ready to drawn postures, at full speed, certified clear of the arm itself and of its table."""
    robot, random = Robot.named(name), np.random.default_rng(0)
    certifier, limits = ArmCertifier(robot, CollisionModel.named(name), TABLE), JointLimits.of(robot)
    found: list[JointReference] = []
    while len(found) < count:
        goal = robot.ready + 0.35 * (robot.sample(1, random)[0] - robot.ready)
        share = np.linspace(0.0, 1.0, 30)[:, None]
        path = robot.ready + share * (goal - robot.ready)
        reference = timed_joint_reference(path, np.zeros((30, 1)), limits)
        assert reference is not None
        certificate = certifier.certify(reference, Obstacles.none(), 0.0)
        if min(certificate.self_clearance.min(), certificate.scene_clearance.min()) > 0.0:
            found.append(reference)
    return found


@pytest.mark.parametrize("name", shipped_robots())
def test_a_certified_motion_of_a_shipped_robot_is_played_clear_of_itself(name: str) -> None:
    """On its table it gets there within its limits, and no mesh meets another one. The control: folded, meshes do."""
    with ArmWorld(scene=TABLE, robot=name) as world:
        for reference in certified_motions(name, 3):
            world.reset(reference.positions[0])
            world.set_joint_trajectory(JointWaypoints(reference.times, reference.positions, reference.velocities))
            while world.time < reference.duration + 0.2:
                world.step()
                assert world.own_clearance()[0] > 0.0
            np.testing.assert_allclose(world.joint_positions, reference.positions[-1], atol=2e-3)
        model, drawn = CollisionModel.named(name), world.robot.sample(2000, np.random.default_rng(0))
        overlaps, _ = self_clearances(model.positions(world.robot, drawn), model.radii, model.self_pairs)
        folded = []
        for posture in drawn[np.argsort(overlaps)[:20]]:
            world.reset(posture)
            folded.append(world.own_clearance()[0])
        assert min(folded) < 0.0
