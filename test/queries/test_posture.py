"""Postures: what is solved has the poses that were requested, and changes no more than they ask for."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from geodesic_motion_ros.geometry.quaternions import angle_between, continuous_signs
from geodesic_motion_ros.queries.posture import Posture, solve_beside, solve_nodes, solve_path
from geodesic_motion_ros.robot.body_points import end_effector_poses
from geodesic_motion_ros.robot.inverse_kinematics import pose_error
from geodesic_motion_ros.robot.kinematics import Robot

PANDA = Robot.named("panda")


def poses_of(robot: Robot, configurations: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    positions, quaternions = end_effector_poses(np.ascontiguousarray(configurations), robot.chain)
    return positions, continuous_signs(quaternions)


def line(robot: Robot, length: float = 0.2, samples: int = 60) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Poses along a straight line across the arm, with the orientation of its beginning, and where it begins (eta,)."""
    start = robot.ready.copy() if len(robot.joint_names) == 7 else np.array([0.2, 0.4, 0.9, 0.3, 0.8, 0.1])
    position, quaternion = robot.forward(start)
    positions = position + np.linspace(0.0, length, samples)[:, None] * [0.0, 1.0, 0.2]
    return positions, np.tile(quaternion, (samples, 1)), start


def assert_holds(robot: Robot, configurations: np.ndarray, positions: np.ndarray, quaternions: np.ndarray) -> None:
    there, turned = poses_of(robot, configurations)
    np.testing.assert_allclose(there, positions, atol=1e-5)
    assert np.max(angle_between(turned, quaternions)) < 1e-5


@pytest.mark.parametrize("joints", [7, 6])
def test_a_path_is_followed_by_steps_of_least_norm(joints: int, six: Robot) -> None:
    robot = PANDA if joints == 7 else six
    positions, quaternions, start = line(robot, 0.2 if joints == 7 else 0.1)
    path = solve_path(robot, positions, quaternions, start)
    assert path.refusal(robot) is None
    assert_holds(robot, path.configurations, positions, quaternions)
    np.testing.assert_allclose(path.configurations[0], start, atol=1e-6)
    steps = np.diff(path.configurations, axis=0)
    # 0.2 m in 60 samples: no joint turns by more than a few hundredths.
    assert np.max(np.abs(steps)) < 0.05
    if joints == 6:
        assert not np.any(path.nulls)
        return
    np.testing.assert_allclose(np.linalg.norm(path.nulls, axis=1), 1.0)
    for configuration, null in zip(path.configurations, path.nulls, strict=True):
        assert np.max(np.abs(robot.jacobian(configuration) @ null)) < 1e-8
    assert np.all(np.sum(path.nulls[1:] * path.nulls[:-1], axis=1) > 0.9)
    # A step of least norm has nothing of the null vector.
    np.testing.assert_allclose(np.sum(path.nulls[:-1] * steps, axis=1), 0.0, atol=1e-5)


def test_an_arm_of_five_joints_is_brought_to_positions_and_turned_as_near_as_it_can(six: Robot) -> None:
    """No motion that keeps the position turns the tool nearer to what was requested, which it cannot hold."""
    five = Robot.from_urdf(six.urdf, "l0", "l5")
    start = np.array([0.2, 0.4, 0.9, 0.3, 0.8])
    position, quaternion = five.forward(start)
    positions = position + np.linspace(0.0, 0.1, 30)[:, None] * [0.0, 1.0, 0.2]
    path = solve_path(five, positions, np.tile(quaternion, (30, 1)), start)
    assert path.refusal(five) is None
    there, turned = poses_of(five, path.configurations)
    np.testing.assert_allclose(there, positions, atol=2e-6)
    assert np.max(angle_between(turned, quaternion)) > 0.01
    for configuration in path.configurations:
        slopes = five.jacobian(configuration)
        error = pose_error(*five.forward(configuration), position, quaternion)[3:]
        still = np.linalg.svd(slopes[:3])[2][3:].T
        assert np.max(np.abs((slopes[3:] @ still).T @ error)) < 5e-3


@pytest.mark.parametrize(("axes", "reached"), [("001", True), ("010", False)])
def test_an_arm_in_a_plane_is_displaced_in_it_and_not_out_of_it(axes: str, reached: bool, tmp_path: Path) -> None:
    joints = "".join(
        f'<link name="l{i + 1}"/><joint name="j{i}" type="revolute"><parent link="l{i}"/><child link="l{i + 1}"/>'
        f'<origin xyz="{0.3 * (i > 0)} 0 0"/><axis xyz="{" ".join(axes)}"/>'
        '<limit lower="-2.8" upper="2.8" velocity="2" effort="9"/></joint>'
        for i in range(3)
    )
    tool = '<link name="tool"/><joint name="t" type="fixed"><parent link="l3"/><child link="tool"/>'
    (tmp_path / "flat.urdf").write_text(
        f'<robot name="flat"><link name="l0"/>{joints}{tool}<origin xyz="0.3 0 0"/></joint></robot>'
    )
    flat = Robot.from_urdf(tmp_path / "flat.urdf", "l0", "tool")
    start = np.array([0.2, 0.5, 0.7])
    position, quaternion = flat.forward(start)
    path = solve_path(flat, position + [[0.0, 0.0, 0.0], [0.0, 0.03, 0.0]], np.tile(quaternion, (2, 1)), start)
    assert path.reached.tolist() == [True, reached]


def test_swivels_move_the_arm_along_its_null_vectors_and_leave_the_tool() -> None:
    positions, quaternions, start = line(PANDA)
    still = solve_path(PANDA, positions, quaternions, start)
    turned = solve_path(PANDA, positions, quaternions, start, np.full(len(positions), 0.01))
    assert turned.refusal(PANDA) is None
    assert_holds(PANDA, turned.configurations, positions, quaternions)
    assert np.linalg.norm(turned.configurations[-1] - still.configurations[-1]) > 0.3


def test_a_path_on_which_joints_trade_off_is_followed_without_a_jump() -> None:
    """With the second joint at zero the first and the third turn about one axis."""
    joint = np.linspace(-0.3, 0.3, 80)
    demonstrated = np.tile(PANDA.ready, (80, 1))
    demonstrated[:, 1] = joint
    positions, quaternions = poses_of(PANDA, demonstrated)
    path = solve_path(PANDA, positions, quaternions, demonstrated[0])
    assert path.refusal(PANDA) is None
    assert np.max(np.abs(np.diff(path.configurations, axis=0))) < 0.05


def test_what_cannot_be_reached_is_named_with_its_place_and_reason() -> None:
    positions, quaternions, start = line(PANDA, 1.2, 200)
    assert "it does not reach the poses" in solve_path(PANDA, positions, quaternions, start).refusal(PANDA).reason
    twisted = np.linspace(0.0, 4.0, 200)[:, None] * np.eye(7)[6] + PANDA.ready
    path = solve_path(PANDA, *poses_of(PANDA, twisted), PANDA.ready.copy())
    objection = path.refusal(PANDA).reason
    assert "the arm cannot hold the path from" in objection
    assert "limit of joint 'panda_joint" in objection
    first = np.flatnonzero(~path.reached)[0]
    assert f"from {100 * first / 199:.0f} to" in objection


def test_poses_beside_a_path_are_reached_in_its_posture() -> None:
    positions, quaternions, start = line(PANDA)
    path = solve_path(PANDA, positions, quaternions, start)
    tau = np.linspace(0.0, 1.0, len(positions))
    posture = Posture(tau, path.configurations, path.nulls)
    beside = positions + [0.03, 0.0, -0.02]
    found = solve_beside(PANDA, beside, quaternions, start, posture, tau)
    assert found.refusal(PANDA) is None
    assert_holds(PANDA, found.configurations, beside, quaternions)
    off = np.sum(path.nulls * (found.configurations - path.configurations), axis=1)
    np.testing.assert_allclose(off, 0.0, atol=1e-5)


def test_nodes_follow_from_their_neighbours_and_lost_ones_are_reported() -> None:
    """A chain of nodes that leaves the path at its middle; the last of them is out of reach."""
    positions, quaternions, start = line(PANDA)
    path = solve_path(PANDA, positions, quaternions, start)
    posture = Posture(np.linspace(0.0, 1.0, len(positions)), path.configurations, path.nulls)
    count = 12
    chain = positions[30] + np.linspace(0.0, 0.1, count)[:, None] * [1.0, 0.0, 0.0]
    chain[-1] += [2.0, 0.0, 0.0]
    tau = np.full(count, 30 / 59)
    first = np.array([0, *range(1, 2 * count - 2, 2), 2 * count - 2])
    inner = (node for i in range(1, count - 1) for node in (i - 1, i + 1))
    neighbour = np.array([1, *inner, count - 2], dtype=np.int32)
    found, reached = solve_nodes(
        PANDA, chain, np.tile(quaternions[0], (count, 1)), posture, tau, np.array([0]), first, neighbour
    )
    assert reached.tolist() == [True] * (count - 1) + [False]
    assert_holds(PANDA, found[:-1], chain[:-1], np.tile(quaternions[0], (count - 1, 1)))
    np.testing.assert_allclose(found[-1], path.configurations[30], atol=1e-9)
