"""Frames and Jacobians of the Panda against PyBullet, pytorch-kinematics and finite differences."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pybullet_data
import pytest

from geodesic_motion_ros.geometry.quaternions import rotation_vector_between, to_rotation
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.simulation.physics_client import PhysicsClient
from geodesic_motion_ros.utils.errors import RobotError

SLIDER = """<robot name="slider">
  <link name="base"/><link name="arm"/><link name="tool"/>
  <joint name="turn" type="revolute"><parent link="base"/><child link="arm"/>
    <origin xyz="0 0 1" rpy="0.3 0.2 0.1"/>
    <axis xyz="0 1 1"/><limit lower="-1" upper="2" velocity="1.5" effort="1"/></joint>
  <joint name="push" type="prismatic"><parent link="arm"/><child link="tool"/>
    <origin xyz="0.2 0 0" rpy="0 0.4 0"/>
    <axis xyz="1 0 0"/><limit lower="0.1" upper="0.3" velocity="0.2" effort="1"/></joint>
</robot>"""


@pytest.fixture(scope="module")
def robot() -> Robot:
    return Robot.named("panda")


@pytest.fixture(scope="module")
def configurations(robot: Robot) -> np.ndarray:
    return robot.sample(50, np.random.default_rng(3))


@pytest.fixture(params=["panda", "slider"])
def any_robot(request: pytest.FixtureRequest, tmp_path: Path) -> Robot:
    if request.param == "panda":
        return Robot.named("panda")
    path = tmp_path / "slider.urdf"
    path.write_text(SLIDER)
    return Robot.from_urdf(path, "base", "tool")


def test_link_frames_agree_with_pybullet(robot: Robot, configurations: np.ndarray) -> None:
    client = PhysicsClient()
    try:
        arm = client.loadURDF(
            str(Path(pybullet_data.getDataPath()) / "franka_panda" / "panda.urdf"), useFixedBase=True
        )
        infos = [client.getJointInfo(arm, index) for index in range(client.getNumJoints(arm))]
        joints = {info[1].decode(): info[0] for info in infos}
        links = {info[12].decode(): info[0] for info in infos}
        for q in configurations:
            for name, value in zip(robot.joint_names, q, strict=True):
                client.resetJointState(arm, joints[name], value)
            rotations, origins = robot.link_frames(q)
            for link, rotation, origin in zip(robot.link_names[1:], rotations[1:], origins[1:], strict=True):
                state = client.getLinkState(arm, links[link], computeForwardKinematics=True)
                np.testing.assert_allclose(origin, state[4], atol=1e-6)
                theirs = np.reshape(client.getMatrixFromQuaternion(state[5]), (3, 3))
                np.testing.assert_allclose(rotation, theirs, atol=1e-6)
    finally:
        client.disconnect()


def test_forward_and_jacobian_agree_with_pytorch_kinematics(robot: Robot, configurations: np.ndarray) -> None:
    torch = pytest.importorskip("torch")
    pytorch_kinematics = pytest.importorskip("pytorch_kinematics")
    text = (Path(pybullet_data.getDataPath()) / "franka_panda" / "panda.urdf").read_bytes()
    chain = pytorch_kinematics.build_serial_chain_from_urdf(text, "panda_grasptarget").to(dtype=torch.float64)
    frames = chain.forward_kinematics(torch.tensor(configurations)).get_matrix().numpy()
    jacobians = chain.jacobian(torch.tensor(configurations)).numpy()
    for q, frame, jacobian in zip(configurations, frames, jacobians, strict=True):
        position, quaternion = robot.forward(q)
        np.testing.assert_allclose(position, frame[:3, 3], atol=1e-6)
        np.testing.assert_allclose(to_rotation(quaternion).as_matrix(), frame[:3, :3], atol=1e-6)
        np.testing.assert_allclose(robot.jacobian(q), jacobian, atol=1e-6)


def test_jacobian_is_the_derivative_of_the_pose(any_robot: Robot) -> None:
    step = 1e-5
    for q in any_robot.sample(20, np.random.default_rng(4)):
        numeric = np.empty((6, len(q)))
        for joint in range(len(q)):
            shift = step * np.eye(len(q))[joint]
            (before, turned_before), (after, turned_after) = (
                any_robot.forward(q - shift),
                any_robot.forward(q + shift),
            )
            numeric[:3, joint] = (after - before) / (2.0 * step)
            numeric[3:, joint] = rotation_vector_between(turned_before, turned_after) / (2.0 * step)
        np.testing.assert_allclose(any_robot.jacobian(q), numeric, atol=1e-6)


def test_quaternion_is_that_of_the_last_rotation(any_robot: Robot) -> None:
    for q in any_robot.sample(200, np.random.default_rng(5)):
        _, quaternion = any_robot.forward(q)
        assert quaternion[0] >= 0.0
        np.testing.assert_allclose(
            to_rotation(quaternion).as_matrix(), any_robot.link_frames(q)[0][-1], atol=1e-12
        )


def test_panda_carries_the_limits_of_the_datasheet(robot: Robot) -> None:
    assert robot.joint_names == tuple(f"panda_joint{number}" for number in range(1, 8))
    np.testing.assert_array_equal(robot.velocity_limits, [2.175] * 4 + [2.61] * 3)
    np.testing.assert_array_equal(robot.acceleration_limits, [15, 7.5, 10, 12.5, 15, 20, 20])
    np.testing.assert_array_equal(robot.jerk_limits, [7500, 3750, 5000, 6250, 7500, 10000, 10000])
    np.testing.assert_array_equal(robot.lower[3], -3.0718)
    np.testing.assert_array_equal(robot.upper[5], 3.7525)


def test_reach_is_a_tight_upper_bound(robot: Robot) -> None:
    """No random posture reaches farther; the farthest of many comes near."""
    tools = np.array([robot.forward(q)[0] for q in robot.sample(20000, np.random.default_rng(6))])
    distances = np.linalg.norm(tools - robot.shoulder, axis=1)
    assert distances.max() <= robot.reach
    assert distances.max() > 0.97 * robot.reach
    assert all(robot.within_reach(tool) for tool in tools[:100])
    assert not robot.within_reach(robot.shoulder + [0.0, robot.reach + 0.01, 0.0])


def test_reach_of_an_arm_whose_farthest_point_is_known(tmp_path: Path) -> None:
    path = tmp_path / "slider.urdf"
    path.write_text(SLIDER.replace('rpy="0 0.4 0"', ""))
    slider = Robot.from_urdf(path, "base", "tool")
    farthest = max(
        np.linalg.norm(slider.forward(np.array([turn, 0.3]))[0] - slider.shoulder)
        for turn in np.linspace(-1, 2, 3001)
    )
    assert slider.reach == pytest.approx(farthest, abs=1e-6)


def test_limits_cannot_be_altered(robot: Robot) -> None:
    with pytest.raises(ValueError, match="read-only"):
        robot.lower[0] = 0.0


@pytest.mark.parametrize(
    ("positions", "message"),
    [
        (np.zeros(6), r"shape \(6,\): expected \(7,\)"),
        (np.zeros(7), "panda_joint4"),
        (np.array([0, 0, 0, -1, np.nan, 1, 0]), "panda_joint5"),
    ],
)
def test_joint_positions_that_do_not_fit_are_named(robot: Robot, positions: np.ndarray, message: str) -> None:
    with pytest.raises(RobotError, match=message):
        robot.checked(positions)


def test_an_endless_position_is_refused_where_a_joint_has_no_limits(tmp_path: Path) -> None:
    path = tmp_path / "wheel.urdf"
    path.write_text(SLIDER.replace('type="revolute"', 'type="continuous"'))
    wheel = Robot.from_urdf(path, "base", "tool")
    assert np.isinf(wheel.upper[0])
    np.testing.assert_array_equal(wheel.checked(np.array([100.0, 0.1])), [100.0, 0.1])
    with pytest.raises(RobotError, match=wheel.joint_names[0]):
        wheel.checked(np.array([np.inf, 0.1]))


def test_checked_positions_are_a_copy(robot: Robot) -> None:
    positions = robot.ready.copy()
    robot.checked(positions)[0] = 1.0
    np.testing.assert_array_equal(positions, robot.ready)


def test_an_unknown_tool_link_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "slider.urdf"
    path.write_text(SLIDER)
    with pytest.raises(RobotError, match=r"'gripper'.*base, arm, tool"):
        Robot.from_urdf(path, "base", "gripper")
