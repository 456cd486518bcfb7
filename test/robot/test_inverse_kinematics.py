"""Inverse kinematics reaches what can be reached, never leaves the limits, and names what cannot be."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from geodesic_motion_ros.geometry.quaternions import rotate_by, rotation_vector_between
from geodesic_motion_ros.robot.inverse_kinematics import differential_step, pose_error, solve, twist_step
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.utils.errors import RobotError

ROBOT = Robot.named("panda")


def error_of(q: np.ndarray, position: np.ndarray, quaternion: np.ndarray) -> tuple[float, float]:
    error = pose_error(*ROBOT.forward(q), position, quaternion)
    return float(np.linalg.norm(error[:3])), float(np.linalg.norm(error[3:]))


def test_random_reachable_poses_are_solved_inside_the_limits() -> None:
    for q in ROBOT.sample(300, np.random.default_rng(11)):
        position, quaternion = ROBOT.forward(q)
        found = solve(ROBOT, position, quaternion)
        distance, angle = error_of(found, position, quaternion)
        assert distance < 1e-4
        assert angle < np.radians(0.1)
        assert np.all(found >= ROBOT.lower)
        assert np.all(found <= ROBOT.upper)


def test_the_solution_is_the_same_each_time_and_near_a_good_start() -> None:
    start = ROBOT.ready + 0.1
    position, quaternion = ROBOT.forward(ROBOT.ready + 0.12)
    first, second = (solve(ROBOT, position, quaternion, start) for _ in range(2))
    np.testing.assert_array_equal(first, second)
    assert np.max(np.abs(first - start)) < 0.1


def test_both_signs_of_a_quaternion_are_one_orientation() -> None:
    position, quaternion = ROBOT.forward(ROBOT.ready + 0.2)
    np.testing.assert_allclose(
        solve(ROBOT, position, quaternion), solve(ROBOT, position, -quaternion), atol=1e-12
    )


def test_pose_error_is_the_rotation_vector_between() -> None:
    generator = np.random.default_rng(12)
    for _ in range(100):
        first, second = generator.normal(size=(2, 4))
        first, second = first / np.linalg.norm(first), second / np.linalg.norm(second)
        error = pose_error(np.zeros(3), first, np.ones(3), second)
        np.testing.assert_allclose(error[:3], 1.0)
        np.testing.assert_allclose(error[3:], rotation_vector_between(first, second), atol=1e-9)


@pytest.mark.parametrize(
    ("position", "quaternion", "message"),
    [
        ((2.0, 0.0, 0.5), (1.0, 0.0, 0.0, 0.0), r"2\.\d+ m from the shoulder: the tool .* reaches 0\.9"),
        ((0.8, 0.0, 0.4), (0.5**0.5, 0.0, -(0.5**0.5), 0.0), "no joint positions within the limits reach"),
        ((np.nan, 0.0, 0.5), (1.0, 0.0, 0.0, 0.0), "target position"),
        ((0.4, 0.0, 0.5), (0.0, 0.0, 0.0, 0.0), "target quaternion"),
        ((0.4, 0.0, 0.5), (1.0, 0.0, 0.0), "target quaternion"),
    ],
)
def test_what_cannot_be_reached_is_named(position: tuple, quaternion: tuple, message: str) -> None:
    with pytest.raises(RobotError, match=message):
        solve(ROBOT, np.array(position), np.array(quaternion))


@settings(max_examples=200, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), dt=st.floats(1e-3, 0.05))
def test_a_step_never_leaves_position_or_velocity_limits(seed: int, dt: float) -> None:
    """From anywhere inside, the edges included, towards anywhere."""
    generator = np.random.default_rng(seed)
    q = np.clip(ROBOT.sample(1, generator)[0] * generator.uniform(1.0, 2.0), ROBOT.lower, ROBOT.upper)
    position, quaternion = ROBOT.forward(ROBOT.sample(1, generator)[0])
    velocities = differential_step(ROBOT, q, position, quaternion, dt, gain=generator.uniform(1.0, 1.0 / dt))
    assert np.all(np.abs(velocities) <= ROBOT.velocity_limits + 1e-9)
    assert np.all(q + velocities * dt >= ROBOT.lower - 1e-9)
    assert np.all(q + velocities * dt <= ROBOT.upper + 1e-9)


def test_steps_converge_to_the_target() -> None:
    q = ROBOT.ready.copy()
    position, quaternion = ROBOT.forward(q)
    position, quaternion = position + [0.1, -0.2, -0.1], rotate_by(np.array([0.2, 0.3, -0.4]), quaternion)
    for _ in range(400):
        q = q + 0.01 * differential_step(ROBOT, q, position, quaternion, 0.01)
    distance, angle = error_of(q, position, quaternion)
    assert distance < 1e-4
    assert angle < 1e-3


def test_feed_forward_moves_the_tool_with_the_twist() -> None:
    twist = np.array([0.1, -0.05, 0.02, 0.1, 0.2, -0.1])
    position, quaternion = ROBOT.forward(ROBOT.ready)
    velocities = differential_step(ROBOT, ROBOT.ready, position, quaternion, 0.01, feed_forward=twist)
    np.testing.assert_allclose(ROBOT.jacobian(ROBOT.ready) @ velocities, twist, atol=1e-4)


def test_the_posture_moves_the_arm_but_not_the_tool() -> None:
    posture = ROBOT.ready + [0.5, 0.0, -0.5, 0.0, 0.0, 0.0, 0.0]
    velocities = twist_step(ROBOT, ROBOT.ready, np.zeros(6), 0.01, posture=posture)
    assert np.linalg.norm(velocities) > 0.05
    np.testing.assert_allclose(ROBOT.jacobian(ROBOT.ready) @ velocities, 0.0, atol=1e-4)


def test_a_joint_at_its_limit_leaves_the_work_to_the_others() -> None:
    """With one of seven joints stuck, six still move the tool exactly."""
    q = ROBOT.ready.copy()
    q[0] = ROBOT.upper[0]
    twist = np.array([-0.05, 0.05, 0.0, 0.0, 0.0, 0.3])
    velocities = twist_step(ROBOT, q, twist, 0.01, posture_gain=0.0)
    assert velocities[0] <= 1e-9
    np.testing.assert_allclose(ROBOT.jacobian(q) @ velocities, twist, atol=2e-3)
