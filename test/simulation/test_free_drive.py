"""Free drive: the arm floats, goes where a hand pulls it, and is held again."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from geodesic_motion_ros.geometry.quaternions import angle_between, rotate_by
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.simulation.world import ArmWorld
from geodesic_motion_ros.trajectory.trajectory_player import JointWaypoints
from geodesic_motion_ros.utils.errors import RobotError


@pytest.fixture(params=[100.0, 240.0, 1000.0], ids=lambda rate: f"{rate:.0f} Hz")
def world(request: pytest.FixtureRequest) -> Iterator[ArmWorld]:
    with ArmWorld(rate_hz=request.param) as world:
        world.begin_free_drive()
        yield world


def run(world: ArmWorld, seconds: float) -> None:
    for _ in range(round(seconds / world.dt)):
        world.step()


def test_a_free_arm_floats_where_it_is(world: ArmWorld) -> None:
    run(world, 2.0)
    np.testing.assert_allclose(world.joint_positions, world.robot.ready, atol=1e-3)


def test_an_arm_without_compensation_falls() -> None:
    """The control: it is gravity that is compensated."""
    from geodesic_motion_ros.simulation import free_drive

    with ArmWorld() as world, pytest.MonkeyPatch.context() as patch:
        patch.setattr(free_drive.FreeDrive, "torque", lambda self, hand: None)
        world.begin_free_drive()
        run(world, 0.5)
        assert np.abs(world.joint_positions - world.robot.ready).max() > 0.2


def test_the_tool_comes_to_where_the_hand_pulls_it_and_stays_when_it_lets_go(world: ArmWorld) -> None:
    position, quaternion = world.tool_pose()
    wanted = position + [0.05, 0.1, -0.05], rotate_by(np.array([0.0, 0.2, 0.4]), quaternion)
    world.pull(*wanted)
    run(world, 4.0)
    reached = world.tool_pose()
    assert np.linalg.norm(reached[0] - wanted[0]) < 1e-3
    assert angle_between(reached[1], wanted[1]) < 0.01
    world.let_go()
    run(world, 1.0)
    np.testing.assert_allclose(world.tool_pose()[0], reached[0], atol=1e-3)


def test_an_arm_that_is_pushed_comes_to_rest(world: ArmWorld) -> None:
    position, quaternion = world.tool_pose()
    world.pull(position + [0.0, 0.2, 0.0], quaternion)
    run(world, 0.3)
    world.let_go()
    assert np.abs(world.joint_velocities).max() > 0.05
    run(world, 1.5)
    assert np.abs(world.joint_velocities).max() < 1e-3


@pytest.mark.parametrize("world", [240.0, 1000.0], indirect=True, ids=["240 Hz", "1000 Hz"])
def test_a_hand_cannot_pull_a_joint_beyond_its_limits(world: ArmWorld) -> None:
    """At 100 Hz PyBullet's limits give by up to 0.1 rad under such a pull."""
    position, quaternion = world.tool_pose()
    for angle in np.linspace(0.0, -2.9, 60):
        world.pull(position, rotate_by(np.array([0.0, 0.0, angle]), quaternion))
        run(world, 0.05)
    assert angle_between(world.tool_pose()[1], quaternion) > 1.5
    robot = Robot.named("panda")
    assert np.all(world.joint_positions >= robot.lower - 0.01)
    assert np.all(world.joint_positions <= robot.upper + 0.01)


def test_a_free_arm_refuses_commands_and_one_that_is_held_refuses_the_hand(world: ArmWorld) -> None:
    pose = world.tool_pose()
    waypoints = JointWaypoints(np.array([1.0]), world.robot.ready[None])
    with pytest.raises(RobotError, match="in free drive"):
        world.set_target_pose(*pose)
    with pytest.raises(RobotError, match="in free drive"):
        world.set_joint_trajectory(waypoints)
    world.end_free_drive()
    world.set_joint_trajectory(waypoints)
    with pytest.raises(RobotError, match="not in free drive"):
        world.pull(*pose)


def test_the_motors_hold_the_arm_where_it_is_when_free_drive_ends(world: ArmWorld) -> None:
    position, quaternion = world.tool_pose()
    world.pull(position + [0.0, 0.15, 0.0], quaternion)
    run(world, 0.5)
    before = world.joint_positions
    world.end_free_drive()
    run(world, 1.0)
    assert np.abs(world.joint_velocities).max() < 1e-3
    np.testing.assert_allclose(world.joint_positions, before, atol=0.15)
    assert np.abs(world.joint_positions - world.robot.ready).max() > 0.05


def test_a_reset_ends_free_drive(world: ArmWorld) -> None:
    world.reset()
    with pytest.raises(RobotError, match="not in free drive"):
        world.pull(*world.tool_pose())
